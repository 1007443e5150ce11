"""Likely causes why a network does not drive, each with a command that may remove it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from zoo.verdict.evidence import Evidence

# Below these values a network rarely drives: docs/offline_metrics.md, docs/first_try.md.
STEERS_BACK = 0.08  # recovery response
ENOUGH_SAMPLES = 50_000
SMALL = 1_000  # a network with fewer parameters needs fewer samples
ROBUST = ("brightness", "shadow", "shift")
BONNET_ROWS = 20  # rows of the car's bonnet at the bottom of a frame
MOST_CAUSES = 3


@dataclass(frozen=True)
class Cause:
    """A likely reason why a network does not drive, and a command that may remove it."""

    text: str
    command: str | None = None


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
        return Cause(
            f"{text} It was trained on the centre camera alone.",
            evidence.again({"data.cameras": every}),
        )
    return Cause(text, evidence.again({"quick": None, "data.offset": "0.3"}))


def _quick(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    if not evidence.at("quick"):
        return None
    samples = evidence.number("train_samples")
    count = f" ({samples:,.0f} samples)" if samples else ""
    text = f"It was trained with quick=true{count}, which shortens the training."
    return Cause(text, evidence.again({"quick": None}))


def _few_samples(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    samples, size = evidence.number("train_samples"), evidence.number("parameters")
    epochs = evidence.number("epochs")
    if not samples or not size or not epochs or size < SMALL or samples >= ENOUGH_SAMPLES:
        return None
    if evidence.at("quick"):
        return None
    needed = int(-(-ENOUGH_SAMPLES * epochs // samples))
    more = evidence.again({"trainer.max_epochs": str(needed), "callbacks": "published"})
    return Cause(
        f"It was trained on {samples:,.0f} samples; a network of its size needs more.", more
    )


def _recording(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    findings = evidence.metrics.get("findings")
    texts = [one["text"] for one in findings or [] if isinstance(one, Mapping) and "text" in one]
    if not texts:
        return None
    used = evidence.at("data.augment", {})
    missing = not isinstance(used, Mapping) or not set(ROBUST) <= set(used)
    more = evidence.again({"quick": None, "augment": f"[{','.join(ROBUST)}]"}) if missing else None
    sentences = [f"{str(text).rstrip('.')}." for text in texts[:2]]
    return Cause(" ".join(["The recording:", *sentences]), more)


def _unseen(evidence: Evidence, tracks: Sequence[str]) -> Cause | None:
    from simulator.track_names import recorded_name

    passes = evidence.at("data.record.passes", [])
    recorded = {recorded_name(str(one.get("track"))) for one in passes if isinstance(one, Mapping)}
    unseen = [one for one in tracks if recorded and one not in recorded]
    if not unseen:
        return None
    names = " and ".join(unseen)
    used = evidence.at("data.augment", {})
    if isinstance(used, Mapping) and "bend" in used:
        return Cause(f"Its training images do not show the {names}; record more roads.", None)
    return Cause(
        f"Its training images do not show the {names}; augment=[brightness,bend] helps.",
        evidence.again({"augment": "[brightness,bend]"}),
    )


def _bonnet(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    crop = evidence.at("data.crop")
    if not isinstance(crop, list | tuple) or len(crop) != 2 or crop[1] >= BONNET_ROWS:
        return None
    better = f"[{crop[0]},25]"
    return Cause(
        f"data.crop=[{crop[0]},{crop[1]}] keeps the bonnet in the image, which never changes.",
        evidence.again({"data.crop": better}),
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
