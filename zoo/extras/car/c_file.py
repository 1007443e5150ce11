"""A checkpoint as a C99 file and its header: the view and the network, without a library.

The operations are those of the network's ONNX graph. All values lie in one array, `work`, and a
tensor is the array of its values' places in it. So an operation that only moves values, such as a
transposition, moves places here and needs no C. Images lie with their channels last.
"""

import copy
from dataclasses import replace
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.onnx_file import graph_bytes
from zoo.checkpoints.onnx_policy import IMAGES, SPEED
from zoo.extras.car.c_source import CSource, c_comment, c_number, read_parts
from zoo.extras.car.c_view import write_view
from zoo.models.memory import Memory
from zoo.models.network_facts import facts_of

if TYPE_CHECKING:
    import onnx

MOST = 127  # of a weight of 8 bits
MOST_LANES = 8  # outputs that are summed at a time: two vector registers of 128 bits
OTHERWISE = "name a file that ends in .onnx"
# Operations that only move values; onnx computes them on places.
MOVES = {"Flatten", "Gather", "Identity", "Reshape", "Slice", "Squeeze", "Transpose", "Unsqueeze"}
SCALARS = {"Add": "+", "Div": "/", "Mul": "*", "Sub": "-"}  # of a value and a constant
FUNCTIONS = {
    "Elu": "v > 0.0f ? v : {alpha} * (exponential(v) - 1.0f)",
    "LeakyRelu": "v > 0.0f ? v : {alpha} * v",
    "Relu": "v > 0.0f ? v : 0.0f",
    "Sigmoid": "1.0f / (1.0f + exponential(-v))",
    "Tanh": "1.0f - 2.0f / (exponential(2.0f * v) + 1.0f)",
}
ALPHA = {"Elu": 1.0, "LeakyRelu": 0.01}  # ONNX's defaults
POOLS = {"MaxPool": "pool_max", "AveragePool": "pool_mean", "GlobalAveragePool": "pool_mean"}


def rounded(checkpoint: Checkpoint) -> Checkpoint:
    """Return a checkpoint whose weights are whole numbers of 8 bits times a scale.

    Each output of a convolution or a dense layer has a scale: its largest weight is 127 times it.
    Biases stay.
    """
    import torch

    network = copy.deepcopy(checkpoint.network)
    with torch.no_grad():
        for parameter in network.parameters():
            if parameter.ndim > 1:
                whole, scale = whole_weights(parameter.numpy())
                parameter.copy_(
                    torch.from_numpy(whole * scale.reshape(-1, *[1] * (parameter.ndim - 1)))
                )
    return replace(checkpoint, network=network)


def whole_weights(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return weights [outputs, ...] as whole numbers -127..127, and the scale of each output."""
    flat = weights.reshape(len(weights), -1)
    scale = (np.abs(flat).max(1) / np.float32(MOST)).astype(np.float32)
    scale[scale == 0] = 1
    return np.rint(flat / scale[:, None]).reshape(weights.shape).astype(np.float32), scale


def c_source(checkpoint: Checkpoint, name: str, weights: str) -> str:
    """Return the C file of a checkpoint.

    Args:
        checkpoint: checkpoint; see `rounded` for how weights of 8 bits steer.
        name: name of the function and the header.
        weights: type of the stored weights, `float` or `int8`.

    Raises:
        InputError: the network takes several frames, returns a spread or a curvature, or has an
            operation that the file lacks; names the layer.
    """
    network, out = checkpoint.network, CSource()
    facts = facts_of(network)
    kind, upper = type(network).__name__, name.upper()
    if isinstance(network, Memory):
        raise InputError(f"{kind} keeps earlier frames, which a C file does not; {OTHERWISE}")
    if facts.predicts_spread:
        raise InputError(f"{kind} returns a spread, which a C file does not; {OTHERWISE}")
    write_view(checkpoint.view, out)
    out.need(f"type {weights}")
    graph = graph_bytes(checkpoint, one_frame=True)
    steering, *throttle = _Graph(graph, kind, out, weights).write()
    out.need("end")
    unknown = " || speed_mph != speed_mph" if facts.takes_speed else ""  # NaN
    lines = [
        f"float {name}(const uint8_t *rgb, int width, int height, float speed_mph)",
        "{",
        f"    if (!rgb || width != {upper}_WIDTH || height != {upper}_HEIGHT{unknown}) {{",
        *["        throttle = not_a_number();"] * len(throttle),
        "        return not_a_number();",
        "    }",
        "    view(rgb, work);",
        *(f"    {call}" for call in out.calls),
        *(f"    throttle = clipped(work[{number}]);" for number in throttle),
        f"    return clipped(work[{steering}]);",
        "}",
    ]
    if throttle:
        lines = ["static float throttle;", "", *lines]
        lines += ["", f"float {name}_throttle(void)", "{", "    return throttle;", "}"]
    head = f'/* Written by drivezoo export; {name}.h describes it. */\n#include "{name}.h"'
    return out.text(head, "\n".join(lines))


def c_header(checkpoint: Checkpoint, name: str, model_card: str) -> str:
    """Return the header of a C file, with a card for people as its comment."""
    facts, (rows, columns) = facts_of(checkpoint.network), checkpoint.view.frame
    values = {
        "name": name,
        "UPPER": name.upper(),
        "card": c_comment(model_card),
        "rows": rows,
        "columns": columns,
        "speed": "the car's speed, not NaN" if facts.takes_speed else "not used by this network",
    }
    parts = read_parts()
    text = Template(parts["header"]).substitute(values)
    throttle = Template(parts["header throttle"]).substitute(values)
    return text.replace("THROTTLE", f"{throttle}\n\n" if facts.outputs > 1 else "") + "\n"


class _Graph:
    """A graph whose operations are written as calls, one after the other.

    Args:
        graph: ONNX file with a batch of one.
        kind: network's class, for messages.
        out: file to write to, whose function `view` writes the first values of `work`.
        weights: type of the stored weights, `float` or `int8`.
    """

    def __init__(self, graph: bytes, kind: str, out: CSource, weights: str) -> None:
        import onnx

        self.onnx, self.kind, self.out, self.weights = onnx, kind, out, weights
        model = onnx.load_from_string(graph)
        self.graph, self.opset = model.graph, model.opset_import
        arrays = onnx.numpy_helper.to_array
        self.constants = {tensor.name: arrays(tensor) for tensor in self.graph.initializer}
        outputs = [len(constant) for constant in self.constants.values() if constant.ndim > 1]
        out.constants["LANES"] = min(MOST_LANES, max(outputs, default=1))
        self.places: dict[str, np.ndarray] = {}
        self.number = 0  # of the operation that is being written
        self.last = {
            name: number for number, node in enumerate(self.graph.node) for name in node.input
        }
        self.last |= {tensor.name: len(self.graph.node) for tensor in self.graph.output}

    def write(self) -> list[int]:
        """Write all operations; return the places of the network's outputs."""
        of = self.out.constants
        shape = of["VIEW_HEIGHT"], of["VIEW_WIDTH"], of["CHANNELS"]
        self.places[IMAGES] = self._channels_last(self._block(int(np.prod(shape))), *shape)
        if SPEED in self.last:
            start = self._block(1)
            self.places[SPEED] = np.array([start])
            self.out.calls.append(f"work[{start}] = speed_mph;")
        else:
            self.out.calls.append("(void)speed_mph;")
        for number, node in enumerate(self.graph.node):
            self.number = number
            self._write(node)
        return [int(index) for index in self.places[self.graph.output[0].name].ravel()]

    def _write(self, node: "onnx.NodeProto") -> None:
        operation, result = node.op_type, node.output[0]
        value_of = self.onnx.helper.get_attribute_value
        attributes = {attribute.name: value_of(attribute) for attribute in node.attribute}
        inputs = [name for name in node.input if name]
        moved = [name for name in inputs if name in self.places]
        constants = [self.constants[name] for name in inputs if name in self.constants]
        if operation == "Shape":
            self.constants[result] = np.array(self.places[inputs[0]].shape)
        elif operation == "Cast" and moved:
            self.places[result] = self.places[inputs[0]]
        elif not moved:
            self.constants[result] = self._evaluated(node, self.constants)
        elif operation in MOVES and moved == inputs[:1]:
            self.places[result] = self._evaluated(node, self.constants | self.places)
        elif operation == "Concat" and moved == inputs:
            joined = np.concatenate([self.places[name] for name in inputs], attributes["axis"])
            self.places[result] = self._copied(joined)
        elif operation in SCALARS and len(moved) == 1 and constants[0].size == 1:
            sides = ["v" if name in moved else c_number(constants[0].item()) for name in inputs]
            self._each(result, moved[0], f" {SCALARS[operation]} ".join(sides))
        elif operation in FUNCTIONS:
            alpha = c_number(attributes.get("alpha", ALPHA.get(operation, 0.0)))
            if "exponential" in FUNCTIONS[operation]:
                self.out.need("exponential")
            self._each(result, inputs[0], FUNCTIONS[operation].format(alpha=alpha))
        elif operation == "Conv" and attributes.get("group", 1) == 1 and moved == inputs[:1]:
            self._convolve(result, inputs[0], *constants, **attributes)
        elif operation == "Gemm" and attributes.get("transB") and moved == inputs[:1]:
            self._dense(result, inputs[0], *constants)
        elif operation == "MatMul" and moved == inputs[:1] and self.places[inputs[0]].ndim == 2:
            self._dense(result, inputs[0], constants[0].T)
        elif operation == "BatchNormalization" and moved == inputs[:1]:
            scale, bias, mean, variance = constants
            factor = scale / np.sqrt(variance + np.float32(attributes.get("epsilon", 1e-5)))
            weights, terms = np.diag(factor), bias - mean * factor
            if self.places[inputs[0]].ndim == 2:
                self._dense(result, inputs[0], weights, terms)
            else:
                self._convolve(result, inputs[0], weights[:, :, None, None], terms)
        elif operation in POOLS and self._is_plain(attributes):
            self._pool(result, inputs[0], POOLS[operation], **attributes)
        else:
            raise InputError(
                f"{self.kind}: its layer {_layer(node)} computes {operation}, which a C file "
                f"lacks; {OTHERWISE}"
            )

    def _evaluated(self, node: "onnx.NodeProto", arrays: dict[str, np.ndarray]) -> np.ndarray:
        from onnx.reference import ReferenceEvaluator

        feed = {name: arrays[name] for name in node.input if name}
        make = self.onnx.helper.make_function
        function = make("", "one", list(feed), node.output, [node], self.opset)
        outputs: Any = ReferenceEvaluator(function).run(None, feed, {})
        return outputs[0]

    @staticmethod
    def _is_plain(attributes: dict[str, Any]) -> bool:
        """Return whether a pooling is like torch's default one."""
        padded = any(attributes.get("pads", ())) and not attributes.get("count_include_pad", 1)
        return not padded and not attributes.get("ceil_mode")

    @staticmethod
    def _channels_last(start: int, height: int, width: int, channels: int) -> np.ndarray:
        """Return the places [1, channels, height, width] of an image."""
        places = start + np.arange(height * width * channels)
        return places.reshape(1, height, width, channels).transpose(0, 3, 1, 2)

    def _block(self, size: int) -> int:
        """Return the first place of as many that no value needs from now on."""
        needed = [
            (int(places.min()), int(places.max()) + 1)
            for name, places in self.places.items()
            if self.last.get(name, -1) >= self.number
        ]
        starts = sorted([0, *(end for _, end in needed)])
        start = next(
            at for at in starts if all(end <= at or at + size <= begin for begin, end in needed)
        )
        self.out.floats = max(self.out.floats, start + size)
        return start

    def _copied(self, places: np.ndarray) -> np.ndarray:
        """Write copies of values to a block of their own; return their places."""
        flat = places.ravel()
        start = self._block(len(flat))
        self.out.need("copy")
        done = 0
        while done < len(flat):
            steps = np.diff(flat[done:])
            changes = np.flatnonzero(steps != steps[:1])
            count = int(changes[0]) + 1 if len(changes) else len(flat) - done
            step = int(steps[0]) if count > 1 else 1
            target = start + done
            self.out.calls.append(f"copy(work + {flat[done]}, {step}, {count}, work + {target});")
            done += count
        copied, name = start + np.arange(len(flat)).reshape(places.shape), f"copied to {start}"
        self.places[name], self.last[name] = copied, self.number  # no result may stand there
        return copied

    def _each(self, result: str, name: str, expression: str) -> None:
        """Write a function of each value, in place where no other operation needs it."""
        places = self.places[name]
        low, high = int(places.min()), int(places.max()) + 1
        needed = [
            others
            for key, others in self.places.items()
            if self.last.get(key, -1) > self.number and others.min() < high and others.max() >= low
        ]
        if needed or high - low != places.size:
            places = self._copied(places)
            low, high = int(places.min()), int(places.max()) + 1
        self.out.calls.append(
            f"for (int i = {low}; i < {high}; i++) {{ float v = work[i]; work[i] = {expression}; }}"
        )
        self.places[result] = places

    def _dense(
        self, result: str, name: str, weights: np.ndarray, bias: np.ndarray | None = None
    ) -> None:
        """Write a dense layer: a convolution over one pixel, its channels in memory's order."""
        places = self.places[name].ravel()
        if places.max() - places.min() + 1 != len(places):
            places = self._copied(places)
        image = np.sort(places).reshape(1, -1, 1, 1)
        image_name = f"{name} in order"
        self.places[image_name], self.last[image_name] = image, self.number
        self._convolve(result, image_name, weights[:, np.argsort(places)][:, :, None, None], bias)
        self.places[result] = self.places[result].reshape(1, -1)

    def _convolve(
        self,
        result: str,
        name: str,
        weights: np.ndarray,
        bias: np.ndarray | None = None,
        **settings: Any,
    ) -> None:
        outputs, kernel = len(weights), weights.shape[2:]
        weights = weights.reshape(*weights.shape[:2], *[1] * (4 - weights.ndim), *kernel)
        scale, number = "0", self.number
        kind = "float" if self.weights == "float" else "int8_t"
        if self.weights == "int8":
            weights, scales = whole_weights(weights)
            scale = self.out.table(f"scale_{number}", "float", scales)
        # [outputs, channels, rows, columns] -> [blocks, rows, columns, channels, lanes]
        lanes = self.out.constants["LANES"]
        padded = np.concatenate([weights, np.zeros((-outputs % lanes, *weights.shape[1:]))])
        lying = padded.reshape(-1, lanes, *weights.shape[1:]).transpose(0, 3, 4, 2, 1).ravel()
        bias = np.zeros(outputs) if bias is None else bias
        tables = [
            self.out.table(f"weights_{number}", kind, lying),
            scale,
            self.out.table(f"bias_{number}", "float", bias),
        ]
        self._slide(result, name, "convolve", tables, outputs, kernel, settings)

    def _pool(self, result: str, name: str, function: str, **settings: Any) -> None:
        _, channels, *size = self.places[name].shape
        kernel = settings.get("kernel_shape", size)
        self._slide(result, name, function, [], channels, kernel, settings)

    def _slide(
        self,
        result: str,
        name: str,
        function: str,
        tables: list[str],
        outputs: int,
        kernel: Any,
        settings: dict[str, Any],
    ) -> None:
        """Write the call of a function that moves a window over an image, or over a line."""
        places = self.places[name]
        is_line = places.ndim == 3
        strides, dilations = (
            settings.get(key, [1] * len(kernel)) for key in ("strides", "dilations")
        )
        pads = settings.get("pads", [0] * 2 * len(kernel))
        if settings.get("auto_pad") == b"SAME_UPPER":  # torch's padding="same", of stride 1
            rest = (np.array(kernel) - 1) * dilations
            pads = [*rest // 2, *(rest + 1) // 2]
        image = places[0] if not is_line else places[0][:, None]
        steps = _steps(image)
        if not _are_even(image, steps):
            image = self._copied(image)
            steps = _steps(image)
        channels, *size = image.shape
        if is_line:
            kernel, strides, dilations = [1, *kernel], [1, *strides], [1, *dilations]
            pads = [0, pads[0], 0, pads[1]]
        counts = [
            (length + before + after - (reach - 1) * dilation - 1) // stride + 1
            for length, before, after, reach, dilation, stride in zip(
                size, pads[:2], pads[2:], kernel, dilations, strides, strict=True
            )
        ]
        start = self._block(counts[0] * counts[1] * outputs)
        numbers = [channels, *size, *steps, outputs, *counts, *kernel, *strides, *dilations]
        numbers += pads[:2]
        text = ", ".join(str(int(number)) for number in numbers)
        window = f"window_{self.number}"
        self.out.need("type window", "under", function)
        self.out.tables.append(f"static const window {window} = {{{text}}};")
        arguments = [f"&{window}", *tables, f"work + {int(image.min())}", f"work + {start}"]
        self.out.calls.append(f"{function}({', '.join(arguments)});")
        moved = self._channels_last(start, counts[0], counts[1], outputs)
        self.places[result] = moved[:, :, 0] if is_line else moved


def _steps(image: np.ndarray) -> list[int]:
    """Return the first steps between places [channels, rows, columns], along each axis."""
    return [
        int(np.take(image, 1, axis).flat[0] - image.flat[0]) if image.shape[axis] > 1 else 0
        for axis in range(3)
    ]


def _are_even(image: np.ndarray, steps: list[int]) -> bool:
    even = image.flat[0] + np.tensordot(steps, np.indices(image.shape), 1)
    return np.array_equal(even, image) and min(steps) >= 0


def _layer(node: "onnx.NodeProto") -> str:
    """Return the name of an operation's layer, as in a state dict.

    The exporter names an operation by its modules: /features/features.0/Conv.
    """
    modules = node.name.strip("/").split("/")[:-1]
    return modules[-1] if modules else node.name
