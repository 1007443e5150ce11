"""Find what each layer of a Keras model does, and the scale of its pixels."""

from collections.abc import Iterator, Sequence

import numpy as np

from zoo.base.errors import InputError
from zoo.base.limits import is_ordinary
from zoo.base.terminal import printable
from zoo.extras.keras.keras_lambda import LEAST, WORDS, describe_lambda, specs_of_word
from zoo.extras.keras.keras_model import KerasLayer, KerasModel
from zoo.extras.keras.keras_specs import (
    RECURRENT,
    Spec,
    UnknownValueError,
    activation_specs,
    operator_specs,
    plain_kind,
    specs_of,
)

Scale = tuple[float, float]


LEAST_PIXELS = 5  # mean of pixels 0..255 that is none of scaled pixels
# A scale before these layers is the same as one at the network's input.
BEFORE_SCALE = ("Cropping2D", "Resize", "AveragePooling2D")
DONKEYCAR_SCALE = (255.0, 0.0)  # outside of its networks: `normalize_image` in donkeycar/utils.py


class Chain:
    """The specs of a model's layers.

    Attributes:
        specs: specs of all layers.
        owners: index of the layer in the model of each spec.
        scale: scale at the network's input; None if it is not known.
        understood: text on each layer of the model.
        assumed: label of the unclear Lambda that was taken as the scale; empty without one.
    """

    def __init__(
        self, model: KerasModel, scale: Sequence[float] | None, lambdas: Sequence[str] | None
    ) -> None:
        self.model = model
        self.scale = (float(scale[0]), float(scale[1])) if scale is not None else None
        self._given = self.scale is not None
        # Whether a scale is known without the user, which a layer of the file may change.
        self._scaled = model.is_donkeycar and not self._given
        self.scale = DONKEYCAR_SCALE if self._scaled else self.scale
        self.assumed = ""  # label of an unclear Lambda that was taken as the scale
        self._words = list(lambdas or [])
        self.specs: list[Spec] = []
        self.owners: list[int] = []
        self.understood: list[str] = []
        for index, layer in enumerate(model.layers):
            specs, understood = self._layer(layer, f"{model.path}: {self.label(index)}")
            self.specs += specs
            self.owners += [index] * len(specs)
            self.understood.append(understood)
        if self.scale in (None, DONKEYCAR_SCALE) and self._normalizes_pixels():
            self.scale = (1.0, 0.0)
        elif not self._given and self.scale and self.scale[0] == 1 and 0 < self.scale[1] <= 1:
            self.scale = None  # x - 0.5 follows an x / 255 outside the file
        if self._words:
            raise InputError(
                f"{model.path}: lambdas={','.join(map(str, lambdas or []))!s:.100} has more words "
                "than the file has unclear Lambdas; leave out the last"
            )

    def _normalizes_pixels(self) -> bool:
        """Return whether the input is normalized or scaled first, from values of 0..255."""
        before = (*BEFORE_SCALE, "ZeroPadding2D")  # of 0, which is another value after a scale
        pairs = zip(self.specs, self.owners, strict=True)
        later = (pair for pair in pairs if pair[0]["layer"] not in before)
        spec, owner = next(later, ({"layer": ""}, 0))
        layer = self.model.layers[owner]
        kind = plain_kind(layer.kind)
        if kind == "Normalization":
            mean, _ = _moments(layer)
        elif kind == "BatchNormalization" and layer.arrays:
            mean = layer.arrays[-2] if len(layer.arrays) > 1 else layer.arrays[0]
        elif spec["layer"] == "Rescaling":
            # The factor of x - 0.5 is 1; a list has one for each channel.
            factors = spec["scale"] if isinstance(spec.get("scale"), list) else [spec.get("scale")]
            return all(isinstance(n, int | float) and abs(n) < 1 / LEAST_PIXELS for n in factors)
        else:
            return False
        return bool(mean.size and mean.min() > LEAST_PIXELS and mean.max() < 255)

    def label(self, index: int) -> str:
        """Return a layer's position, name and class, for messages."""
        layer = self.model.layers[index]
        total, name, kind = len(self.model.layers), printable(layer.name), printable(layer.kind)
        return f"layer {index + 1} of {total}, {name:.60} ({kind:.60})"

    def _layer(self, layer: KerasLayer, label: str) -> tuple[list[Spec], str]:
        """Return a layer's specs, and a text on it."""
        text = ""
        if layer.kind == "Lambda":
            specs, text = self._lambda(layer, label)
        elif layer.kind == "Normalization":
            specs = [_normalization(layer, label)]
        else:
            specs = self._translated(layer, label)
        kept: list[Spec] = []
        for spec in specs:
            if spec["layer"] != "Rescaling" or not self._takes_scale(spec, kept, label):
                kept.append(spec)
        if len(kept) < len(specs):
            text = ", ".join([*([_described(kept)] if kept else []), self._scale_text()])
        specs = kept
        is_same = bool(specs) and specs[0].get("padding") == "same"
        if is_same and specs[0]["layer"] == "Conv2D" and self.model.backend == "theano":
            specs[0]["padding"] = "same_theano"
        return specs, text or _described(specs)

    def _translated(self, layer: KerasLayer, label: str) -> list[Spec]:
        operator = layer.config.get("function") if layer.kind == "TFOpLambda" else layer.kind
        try:
            specs = operator_specs(str(operator), layer.constants)
            if specs is None:
                specs = specs_of(layer.kind, layer.config, self.model.version)
        except UnknownValueError as error:
            raise InputError(f"{label}: {error}, which cannot be converted") from None
        if specs is None:
            what = "is an unknown layer; replace it in Keras, and save the model again"
            if layer.kind in RECURRENT:
                what = "needs several frames in a row; only networks of one image are converted"
            raise InputError(f"{label}: {what}")
        return specs

    def _lambda(self, layer: KerasLayer, label: str) -> tuple[list[Spec], str]:
        word, holds = describe_lambda(layer.config)
        if word is None and self._words:
            word = str(self._words.pop(0))
        elif word is None and self._given and not self._scaled and self._is_at_input(()):
            self._scaled = True
            self.assumed = label
            return [], f"taken as {self._scale_text()}; holds {holds}"
        if word is None:
            raise InputError(
                f"{label}: what it computes is not clear (its code holds {holds}, and is never "
                'run); set "scale=[divisor,subtracted]" if it computes pixel / divisor - '
                f'subtracted, or "lambdas=[WORD]" with one of {WORDS}'
            )
        specs = specs_of_word(word)
        if specs is None:
            raise InputError(f"{label}: lambdas={word!s:.60}: is none of {WORDS}; correct it")
        for spec in specs:
            if spec["layer"] == "Activation":  # of which one depends on the version
                (named,) = activation_specs(spec["activation"], self.model.version)
                spec |= named
        return specs, word

    def _is_at_input(self, before: Sequence[Spec]) -> bool:
        return all(spec["layer"] in BEFORE_SCALE for spec in [*self.specs, *before])

    def _scale_text(self) -> str:
        divisor, less = self.scale or (1.0, 0.0)
        return f"scale=[{divisor:g},{less:g}]: pixel / {divisor:g} - {less:g}"

    def _takes_scale(self, spec: Spec, before: Sequence[Spec], label: str) -> bool:
        """Take a rescaling as the network's scale; return False if its place forbids it.

        Args:
            spec: spec of the rescaling.
            before: specs of the same layer before it.
            label: layer, for messages.

        Raises:
            InputError: a number in it is not finite, or not of ordinary size.
        """
        factor, offset = spec.get("scale"), spec.get("offset", 0.0)
        plain = all(type(number) in (int, float) for number in (factor, offset))
        if not plain or not factor or not self._is_at_input(before):
            return False
        divisor, less = self.scale if self.scale and self._scaled else (1.0, 0.0)
        usual = is_ordinary(factor, LEAST) and is_ordinary(offset)
        divisor, less = (divisor / factor, less * factor - offset) if usual else (0.0, 0.0)
        if not is_ordinary(divisor, LEAST) or not is_ordinary(less):
            raise InputError(
                f"{label}: scale={factor!s:.40} offset={offset!s:.40}: its numbers must be finite "
                "and of ordinary size; correct them in Keras, and save the model again"
            )
        if not self._given:
            self.scale = (float(f"{divisor:.12g}"), float(f"{less:.12g}"))
        self._scaled = True
        return True


def _normalization(layer: KerasLayer, label: str) -> Spec:
    """Return the spec of a layer that subtracts a mean and divides by a deviation."""
    try:
        mean, variance = _moments(layer)
        if layer.config.get("invert") or len(mean) != len(variance):
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            f"{label}: has no mean and variance that can be converted; save the model again"
        ) from None
    factor = 1 / np.maximum(np.sqrt(np.maximum(variance, 0)), 1e-7)
    return {"layer": "Rescaling", "scale": factor.tolist(), "offset": (-mean * factor).tolist()}


def _moments(layer: KerasLayer) -> Iterator[np.ndarray]:
    """Yield mean and variance of a normalization, float64 [N] each."""
    constants = [layer.config.get("mean"), layer.config.get("variance")]
    arrays = layer.arrays[:2] if len(layer.arrays) > 1 else constants
    return (np.asarray(array, np.float64).reshape(-1) for array in arrays)


def _described(specs: list[Spec]) -> str:
    parts = [
        " ".join([spec["layer"], *(f"{k}={value}" for k, value in spec.items() if k != "layer")])
        for spec in specs
    ]
    return ", ".join(parts).replace(", ", ",") or "no effect in driving"
