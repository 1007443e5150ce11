"""Likely causes why a network does not drive, each with changes of its training against it."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from zoo.verdict.evidence import Evidence

# Below these values a network rarely drives: docs/offline_metrics.md, docs/recipes.md.
STEERS_BACK = 0.08  # recovery response
ENOUGH_SAMPLES = 50_000
SMALL = 1_000  # a network with fewer parameters needs fewer samples
ROBUST = ("brightness", "shadow", "shift")
BENDS = ("brightness", "bend")
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
    found: list[Cause] = []
    for rule in RULES:
        # Config and metrics lack what a rule reads, or are another program's and hold anything.
        with suppress(TypeError, ValueError, LookupError, AttributeError, ArithmeticError):
            found += filter(None, [rule(evidence, tracks)])
    return found[:MOST_CAUSES]


def train_again(evidence: Evidence, causes: Sequence[Cause]) -> str | None:
    """Return the command that trained the network, with the changes of all causes.

    Returns:
        The command; None if no cause has a change, or the original command is unknown.
    """
    changes = {key: value for cause in reversed(causes) for key, value in cause.changes.items()}
    had = _augmentations(evidence)
    names = dict.fromkeys([*had, *(name for cause in causes for name in cause.augment)])
    if len(names) > len(had):
        changes["augment"] = f"[{','.join(names)}]"
    return evidence.again(changes) if changes else None


def _augmentations(evidence: Evidence) -> list[str]:
    """Return the names of the augmentations that the training had."""
    used = evidence.at("data.augment", {})
    return [str(name) for name in used] if isinstance(used, Mapping) else []


def _steers_back(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    responses = evidence.metrics["side_response"].values()
    response = [float(one) for one in responses if one is not None][-1]
    if response >= STEERS_BACK:
        return None
    if evidence.source is not None:  # the limit is in steering of Udacity's car
        return None
    text = (
        "It hardly steers back to the lane's centre: its recovery response to the side cameras is "
        f"{response:+.3f}; networks that drive have 0.2 or more."
    )
    if evidence.at("data.cameras") == ["center"]:
        every = "[center,left,right]"
        return Cause(f"{text} It was trained on the centre camera alone.", {"data.cameras": every})
    larger = max(0.3, round(float(evidence.at("data.offset", 0.0)) + 0.1, 3))
    return Cause(f"{text} A larger data.offset teaches it.", {"data.offset": f"{larger:g}"})


def _quick(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    if not evidence.at("quick"):
        return None
    return Cause("It was trained with quick=true, a short training.", {"quick": None})


def _few_samples(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    samples, epochs = evidence.metrics["train_samples"], evidence.metrics["epochs"]
    is_small = evidence.metrics["parameters"] < SMALL
    if is_small or samples >= ENOUGH_SAMPLES or evidence.at("quick"):
        return None
    more = {"trainer.max_epochs": str(-(-ENOUGH_SAMPLES * epochs // samples))}
    if not any(one.startswith("callbacks=") for one in evidence.overrides or ()):
        more["callbacks"] = "published"  # without early stopping
    return Cause(
        f"It was trained on {samples:,} samples; a network of its size needs more epochs.", more
    )


def _recording(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    # A finding's advice stands behind its semicolon; the training may have followed it.
    texts = [one["text"].partition("; ")[0] for one in evidence.metrics["findings"][:2]]
    if not texts:
        return None
    found = " ".join(f"{text.rstrip('.')}." for text in texts)
    if set(ROBUST) <= set(_augmentations(evidence)):
        return Cause(f"The recording: {found} drivezoo check names what to record.")
    remedy = f"augment=[{','.join(ROBUST)}] makes up for some of it."
    return Cause(f"The recording: {found} {remedy}", augment=ROBUST)


def _unseen(evidence: Evidence, tracks: Sequence[str]) -> Cause | None:
    from simulator.track_names import recorded_name

    passes = evidence.config["data"]["record"]["passes"]
    recorded = {recorded_name(str(one.get("track"))) for one in passes}
    unseen = [one for one in tracks if recorded and one not in recorded]
    if not unseen:
        return None
    text = f"Its training images do not show the {' and '.join(unseen)};"
    if "bend" in _augmentations(evidence):
        return Cause(f"{text} record more roads.")
    return Cause(f"{text} augment=[{','.join(BENDS)}] helps.", augment=BENDS)


# The likeliest first.
RULES: tuple[Callable[[Evidence, Sequence[str]], Cause | None], ...] = (
    _quick,
    _steers_back,
    _few_samples,
    _unseen,
    _recording,
)
