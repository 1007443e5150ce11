"""Translate a Keras layer's config to specs of `zoo.models.sequential`, for Keras 1, 2 and 3.

Values pass as they are: the network checks them when it is built.
"""

from zoo.checkpoints.keras_settings import TRANSLATIONS, WITH_ACTIVATION, Spec, UnknownValueError
from zoo.models.value_layers import ACTIVATIONS

# Names of Keras 1 and of aliases.
CLASSES = {
    "Convolution2D": "Conv2D",
    "AtrousConvolution2D": "Conv2D",
    "SeparableConvolution2D": "SeparableConv2D",
    "DepthwiseConvolution2D": "DepthwiseConv2D",
    "Convolution1D": "Conv1D",
    "MaxPool2D": "MaxPooling2D",
    "AvgPool2D": "AveragePooling2D",
    "MaxPool1D": "MaxPooling1D",
    "AvgPool1D": "AveragePooling1D",
    "GlobalAvgPool2D": "GlobalAveragePooling2D",
    "GlobalMaxPool2D": "GlobalMaxPooling2D",
    "BatchNormalizationV1": "BatchNormalization",
    "BatchNormalizationV2": "BatchNormalization",
}


# Orders of axes, of Keras 2 and 1.
ORDERS = {"channels_first": "channels_first", "th": "channels_first"}


ORDERS |= {"channels_last": "channels_last", "tf": "channels_last"}


# Layers that change nothing in driving, and need no place in the network.
IDENTITIES = (
    "InputLayer", "ActivityRegularization", "Masking", "Identity", "RandomContrast", "RandomFlip",
    "RandomBrightness", "RandomRotation", "RandomTranslation", "RandomZoom",
)  # fmt: skip


RECURRENT = ("LSTM", "GRU", "SimpleRNN", "RNN", "ConvLSTM2D", "Bidirectional", "TimeDistributed")


_ACTIVATIONS = {
    "silu": "swish",
    "hard_silu": "hard_swish",
    "hard_swish": "hard_swish",
    "relu6": "relu6",
}


# Operators of functional models, of Keras 2 (config's `function`) and Keras 3 (class).
OPERATORS = {
    "math.truediv": "/", "math.divide": "/", "TrueDivide": "/", "Divide": "/",
    "math.multiply": "*", "Multiply": "*",
    "math.subtract": "-", "Subtract": "-",
    "__operators__.add": "+", "math.add": "+", "Add": "+",
}  # fmt: skip


def specs_of(kind: str, config: dict, version: int) -> list[Spec] | None:
    """Return the specs of a Keras layer; None for an unknown class.

    Args:
        kind: its class in the file.
        config: its config in the file.
        version: Keras' major version.

    Raises:
        UnknownValueError: a setting has no counterpart.
    """
    if kind in IDENTITIES:
        return []
    kind = CLASSES.get(kind, kind)
    translate = TRANSLATIONS.get(kind)
    if translate is None:
        return None
    spec = {"layer": kind} | translate(config)
    if ORDERS.get(str(config.get("data_format", config.get("dim_ordering")))) == "channels_first":
        spec["data_format"] = "channels_first"
    more = []
    if kind in WITH_ACTIVATION:
        more = activation_specs(config.get("activation"), version)
        if len(more) == 1 and more[0]["layer"] == "Activation":
            spec["activation"], more = more[0]["activation"], []
    elif kind == "Activation":
        return activation_specs(config.get("activation"), version)
    return [{key: value for key, value in spec.items() if value is not None}, *more]


def operator_specs(name: str, constants: tuple[float, ...]) -> list[Spec] | None:
    """Return the specs of an operator with one number, such as `x / 127.5`; None for any other."""
    sign = OPERATORS.get(name)
    if sign is None or len(constants) != 1 or (sign == "/" and not constants[0]):
        return None
    (number,) = constants
    if sign in "*/":
        return [{"layer": "Rescaling", "scale": number if sign == "*" else 1 / number}]
    return [{"layer": "Rescaling", "scale": 1.0, "offset": number if sign == "+" else -number}]


def activation_specs(value: object, version: int) -> list[Spec]:
    """Return the specs of an activation: a name, or a layer or function with its config."""
    if isinstance(value, dict):
        name, config = value.get("class_name"), value.get("config")
        if isinstance(config, str):  # Keras 3: a function's name
            value = config
        elif isinstance(name, str) and isinstance(config, dict):
            specs = specs_of(name, config, version)
            if specs is not None:
                return specs
            value = name
    if value is None or value == "linear":
        return []
    if value == "hard_sigmoid" and version >= 3:
        return [{"layer": "Activation", "activation": "hard_sigmoid_3"}]
    name = _ACTIVATIONS.get(value, value) if isinstance(value, str) else ""
    if name not in ACTIVATIONS:
        raise UnknownValueError(f"its activation is {value!s:.60}")
    return [{"layer": "Activation", "activation": name}]
