"""Likely causes why a network does not drive, each with changes of its training against it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from zoo.verdict.evidence import Evidence

# Below these values a network rarely drives: docs/offline_metrics.md, docs/recipes.md.
STEERS_BACK = 0.08  # recovery response
ENOUGH_SAMPLES = 50_000
SMALL = 1_000  # a network with fewer parameters needs fewer samples
ROBUST = ("brightness", "shadow", "shift")
BENDS = ("brightness", "bend")
BONNET_ROWS = 20  # rows of the car's bonnet at the bottom of a frame
MOST_CAUSES = 3


@dataclass(frozen=True)
class Cause:
    """A likely reason why a network does not drive.

    Attributes:
        text: sentences that name the cause and what changes.
        changes: new values of keys of the training; None removes a key.
        augment: augmentations to train with, besides those that the training had.
    """

    text: str
    changes: Mapping[str, str | None] = field(default_factory=dict)
    augment: tuple[str, ...] = ()


def likely_causes(evidence: Evidence, tracks: Sequence[str]) -> list[Cause]:
    """Return at most three causes, the likeliest first.

    Args:
        evidence: config and metrics of the network.
        tracks: names of the tracks that the network does not drive.
    """
    found = []
    for rule in RULES:
        try:
            cause = rule(evidence, tracks)
        # Config and metrics of other programs may hold anything; the verdict must not fail.
        except (TypeError, ValueError, KeyError, IndexError, AttributeError):
            continue
        found += [cause] if cause else []
    return found[:MOST_CAUSES]


def train_again(evidence: Evidence, causes: Sequence[Cause]) -> str | None:
    """Return the command that trained the network, with the changes of all causes.

    Returns:
        The command; None if no cause has a change, or the original command is unknown.
    """
    changes: dict[str, str | None] = {}
    for cause in causes:
        changes |= {key: value for key, value in cause.changes.items() if key not in changes}
    wanted = [name for cause in causes for name in cause.augment]
    if more := [name for name in wanted if name not in _augmentations(evidence)]:
        names = dict.fromkeys([*_augmentations(evidence), *more])
        changes["augment"] = f"[{','.join(names)}]"
    return evidence.again(changes) if changes else None


def _augmentations(evidence: Evidence) -> list[str]:
    """Return the names of the augmentations that the training had."""
    used = evidence.at("data.augment", {})
    return [str(name) for name in used] if isinstance(used, Mapping) else []


def _imported(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    if evidence.at("model.weights") is None or evidence.at("trainer.max_epochs") != 0:
        return None
    return Cause(
        "Its weights come from another program, which perhaps trained on images other than those "
        f"of model.colour={evidence.at('model.colour')} and data.crop={evidence.at('data.crop')}, "
        "or on another pixel scale."
    )


def _steers_back(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    responses = evidence.metrics.get("side_response")
    values = [] if not isinstance(responses, Mapping) else list(responses.values())
    known = [float(one) for one in values if isinstance(one, int | float)]
    if not known or known[-1] >= STEERS_BACK:
        return None
    text = (
        "It hardly steers back to the lane's centre: its recovery response to the side cameras is "
        f"{known[-1]:+.3f}; networks that drive have 0.2 or more."
    )
    if list(evidence.at("data.cameras", [])) == ["center"]:
        every = "[center,left,right]"
        return Cause(f"{text} It was trained on the centre camera alone.", {"data.cameras": every})
    larger = max(0.3, round(float(evidence.at("data.offset", 0.0)) + 0.1, 3))
    return Cause(f"{text} A larger data.offset teaches it.", {"data.offset": f"{larger:g}"})


def _quick(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    if not evidence.at("quick"):
        return None
    samples = evidence.number("train_samples")
    count = f" ({samples:,.0f} samples)" if samples else ""
    text = f"It was trained with quick=true{count}, which shortens the training."
    return Cause(text, {"quick": None})


def _few_samples(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    samples, size = evidence.number("train_samples"), evidence.number("parameters")
    epochs = evidence.number("epochs")
    if not samples or not size or not epochs or size < SMALL or samples >= ENOUGH_SAMPLES:
        return None
    if evidence.at("quick"):
        return None
    needed = int(-(-ENOUGH_SAMPLES * epochs // samples))
    more = {"trainer.max_epochs": str(needed)}
    if not any(one.startswith("callbacks=") for one in evidence.overrides or ()):
        more["callbacks"] = "published"  # without early stopping
    return Cause(
        f"It was trained on {samples:,.0f} samples; a network of its size needs more epochs.", more
    )


def _recording(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    findings = evidence.metrics.get("findings")
    texts = [one["text"] for one in findings or [] if isinstance(one, Mapping) and "text" in one]
    if not texts:
        return None
    # A finding's advice stands behind its semicolon; the training may have followed it.
    sentences = [f"{str(text).partition('; ')[0].rstrip('.')}." for text in texts[:2]]
    missing = [name for name in ROBUST if name not in _augmentations(evidence)]
    if missing:
        sentences.append(f"augment=[{','.join(ROBUST)}] makes up for some of it.")
    else:
        sentences.append("drivezoo check names what to record.")
    return Cause(" ".join(["The recording:", *sentences]), augment=ROBUST if missing else ())


def _unseen(evidence: Evidence, tracks: Sequence[str]) -> Cause | None:
    from simulator.track_names import recorded_name

    passes = evidence.at("data.record.passes", [])
    recorded = {recorded_name(str(one.get("track"))) for one in passes if isinstance(one, Mapping)}
    unseen = [one for one in tracks if recorded and one not in recorded]
    if not unseen:
        return None
    names = " and ".join(unseen)
    if "bend" in _augmentations(evidence):
        return Cause(f"Its training images do not show the {names}; record more roads.")
    return Cause(
        f"Its training images do not show the {names}; augment=[{','.join(BENDS)}] helps.",
        augment=BENDS,
    )


def _bonnet(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    crop = evidence.at("data.crop")
    if not isinstance(crop, list | tuple) or len(crop) != 2 or crop[1] >= BONNET_ROWS:
        return None
    return Cause(
        f"data.crop=[{crop[0]},{crop[1]}] keeps the bonnet in the image, which never changes.",
        {"data.crop": f"[{crop[0]},25]"},
    )


# The likeliest first.
RULES: tuple[Callable[[Evidence, Sequence[str]], Cause | None], ...] = (
    _imported,
    _quick,
    _steers_back,
    _few_samples,
    _unseen,
    _recording,
    _bonnet,
)
