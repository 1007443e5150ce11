"""Tell what a Lambda of Keras computes, from the marshalled Python code in its config.

The code is never given to Python's `marshal`, nor run: a reader of its own returns constants, names
and instructions of Python 2.7 to 3.13 as data (CPython's `Python/marshal.c`). A Lambda is described
by a word, which is also what a user sets for an unclear one: see `WORDS`.
"""

import base64
import re
import struct
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from zoo.base.limits import is_ordinary
from zoo.extras.keras.keras_modules import ACTIVATIONS, RESIZE_METHODS

WORDS = (
    "identity, scale:DIVISOR:SUBTRACTED, atan, atan:FACTOR, resize:ROWS:COLUMNS, "
    "crop:TOP:BOTTOM, gray, tanh or another activation; with + between them, such as "
    "resize:66:200+scale:255:0.5, if it does several"
)
LEAST = 1e-9  # of a divisor or factor
GRAY = [0.2989, 0.5870, 0.1140]  # of tf.image.rgb_to_grayscale
MOST_BYTES, MOST_OBJECTS, MOST_LEVELS, MOST_STEPS = 100_000, 1_000, 20, 400
# Whole numbers before a code's eight objects, and objects after its first line, in Python 3.11,
# 3.8, 3.0 and 2.7.
LAYOUTS = ((5, 2), (6, 1), (5, 1), (4, 1))
SINGLE = {"N": None, "T": True, "F": False, ".": ...}
# Instructions as letters, of Python to 3.10, 3.11, 3.12 and 3.13 (CPython's `opcode`): x and s load
# and store a variable, c loads a constant, g and G a global name, . and A an attribute (G and A
# with a flag in the lowest bit of the argument), i and I import, f and k call, K names a call's
# keywords, t builds a tuple, : a slice, [ is an index, b an operator by its argument, n a minus, p
# drops a value, r returns.
_COMMON = {124: "x", 125: "s", 100: "c", 101: "g", 108: "i", 109: "I", 1: "p", 102: "t", 103: "t",
           133: ":", 25: "[", 11: "n", 83: "r", 9: ""}  # fmt: skip
_3_11 = _COMMON | {116: "G", 106: ".", 160: ".", 122: "b", 171: "f", 172: "K"}
_3_11 |= dict.fromkeys((0, 2, 149, 151, 166), "")
LETTERS = (
    {
        **_COMMON,
        **{116: "g", 106: ".", 160: ".", 131: "f", 161: "f", 141: "k"},
        **{23: "+", 55: "+", 24: "-", 56: "-", 20: "*", 57: "*"},
        **{21: "/", 27: "/", 29: "/", 58: "/"},
    },
    _3_11,
    _3_11 | {106: "A"},
    {
        **{85: "x", 110: "s", 83: "c", 92: "g", 91: "G", 82: "A", 75: "i", 74: "I", 53: "f"},
        **{57: "k", 52: "t", 47: "t", 50: ":", 5: "[", 45: "b", 42: "n", 32: "p", 36: "r"},
        **{88: "xx", 111: "sx", 112: "ss", **dict.fromkeys((0, 30, 34, 149), "")},
    },
)
OPERATORS = {0: "+", 10: "-", 5: "*", 11: "/", 13: "+", 23: "-", 18: "*", 24: "/"}
FUNCTIONS = {
    "multiply": "*", "mul": "*", "divide": "/", "div": "/", "truediv": "/", "truedivide": "/",
    "add": "+", "subtract": "-", "sub": "-",
}  # fmt: skip
MODULES = (
    "tf", "tensorflow", "K", "keras", "backend", "math", "image", "nn", "activations", "ktf", "np",
    "compat", "v1", "python", "ops",
)  # fmt: skip


@dataclass(frozen=True)
class Code:
    """A function's code: bytecode, constants, and names of globals, modules and attributes.

    Attributes:
        is_closed: whether it uses no variables of an outer function.
    """

    instructions: bytes
    constants: tuple
    names: list[str]
    is_closed: bool


def describe_lambda(config: dict) -> tuple[str | None, str]:
    """Return a word for what a Lambda computes, None if it is unclear, and a text on what it holds.

    Args:
        config: the layer's config, from an untrusted file.
    """
    function = config.get("function")
    if isinstance(function, dict):  # of Keras 3: a name, or a dict with the code
        function = function.get("config")
        function = function.get("code") if isinstance(function, dict) else function
    text = function[0] if isinstance(function, list) and function else function
    if not isinstance(text, str):
        return None, "no code in the file"
    if config.get("function_type") == "function" or re.fullmatch(r"[\w.]{1,100}", text):
        return _known_name(text), f"function {text:.60}"
    try:  # Keras 2.1 and later
        data = base64.b64decode(re.sub(r"\s", "", text), validate=True)
    except ValueError:
        data = text.encode("raw_unicode_escape")
    code = read_code(data)
    if code is None:
        return None, "code of an unknown version of Python"
    shown = [f"{constant:g}" for constant in code.constants if type(constant) in (int, float)]
    shape = config.get("batch_input_shape")
    rows = shape[1] if isinstance(shape, list) and len(shape) == 4 else None
    rows = rows if isinstance(rows, int) else None
    return _word(code, rows), ", ".join([*shown, *code.names])[:100] or "nothing"


def read_code(data: bytes) -> Code | None:
    """Return the code in marshalled bytes; None if they are no code of a known layout."""
    for whole, last in LAYOUTS if len(data) <= MOST_BYTES else ():
        try:
            reader = _Reader(data, whole, last)
            code = reader.read(0)
        except (ValueError, IndexError, TypeError, struct.error):
            continue
        if isinstance(code, Code) and reader.at == len(data):
            return code
    return None


class _Reader:
    """A reader of marshalled objects that returns texts as bytes."""

    def __init__(self, data: bytes, whole: int, last: int) -> None:
        self.data, self.whole, self.last = data, whole, last
        self.at = self.count = 0
        self.shared: list = []  # objects that later ones refer to
        self.interned: list = []  # of Python 2

    def read(self, depth: int) -> Any:
        """Return the next object; raise ValueError if it is of an unknown kind."""
        self.count += 1
        if depth > MOST_LEVELS or self.count > MOST_OBJECTS:
            raise ValueError("too many objects")
        (mark,) = self._take(1)
        index = len(self.shared)
        if mark & 0x80:
            self.shared.append(None)
        value = self._value(chr(mark & 0x7F), depth)
        if mark & 0x80:
            self.shared[index] = value
        return value

    def _value(self, kind: str, depth: int) -> Any:
        if kind in SINGLE:
            return SINGLE[kind]
        if kind == "i":
            return self._long()
        if kind == "g":
            return struct.unpack("<d", self._take(8))[0]
        if kind in "Rr":
            return (self.interned if kind == "R" else self.shared)[self._long()]
        if kind in "stuaAzZ":
            text = self._take(self._take(1)[0] if kind in "zZ" else self._long())
            if kind == "t":
                self.interned.append(text)
            return text
        if kind in "()":
            length = self._take(1)[0] if kind == ")" else self._long()
            return tuple(self.read(depth + 1) for _ in range(length))
        if kind != "c":
            raise ValueError(f"unknown kind {kind!r}")
        self._take(4 * self.whole)
        instructions, constants, names, _, free, *_ = [self.read(depth + 1) for _ in range(8)]
        self._long()  # first line
        for _ in range(self.last):
            self.read(depth + 1)
        if not isinstance(instructions, bytes) or not isinstance(constants, tuple):
            raise ValueError("no code")
        texts = [name.decode("utf-8", "replace") for name in names if isinstance(name, bytes)]
        # 3.11: a byte of flags for each variable; before: names.
        outer = [flags for flags in free if not isinstance(flags, int) or flags & 0xC0]
        return Code(instructions, constants, texts, not outer)

    def _take(self, count: int) -> bytes:
        piece = self.data[self.at : self.at + count]
        if count < 0 or len(piece) != count:
            raise ValueError("truncated")
        self.at += count
        return piece

    def _long(self) -> int:
        return struct.unpack("<i", self._take(4))[0]


@dataclass(frozen=True)
class _Value:
    """A number, or x after some steps and then `x * factor + offset`; a number's factor is 0."""

    factor: float
    offset: float
    steps: tuple[str, ...] = ()

    def after(self, step: str = "") -> tuple[str, ...]:
        """Return the words of all steps, the scale in its place, and one more."""
        if not is_ordinary(self.factor, least=LEAST) or not is_ordinary(self.offset):
            raise ValueError("no scale")
        steps = self.steps
        if steps[-1:] == ("atan",) and self.factor != 1 and not self.offset:
            steps = (*steps[:-1], f"atan:{_short(self.factor)}")
        elif (self.factor, self.offset) != (1, 0):
            steps = (*steps, f"scale:{_short(1 / self.factor)}:{_short(-self.offset)}")
        return (*steps, step) if step else steps


def _word(code: Code, rows: int | None) -> str | None:
    """Return the word for code of a known form, in the instructions of any version of Python.

    Args:
        code: function's code.
        rows: rows of its input, if they are known.
    """
    for wide in (False, True):
        for letters in LETTERS if code.is_closed else ():
            # Bytes of another version, or of no code, lead to any of these.
            with suppress(ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
                return "+".join(_steps(code, wide, letters, rows)) or "identity"
    return None


def _steps(code: Code, wide: bool, letters: dict[int, str], rows: int | None) -> tuple[str, ...]:
    """Return the words of what straight code computes; raise an error if it is another.

    Nothing is run: the few instructions of `LETTERS` are followed with `_Value`s.

    Args:
        code: function's code.
        wide: whether an instruction takes one or three bytes, as before Python 3.6, not two.
        letters: table of `LETTERS`.
        rows: rows of the function's input, if they are known.
    """
    stack: list[Any] = []
    variables: dict[int, Any] = {0: _Value(1.0, 0.0)}
    keywords: tuple = ()
    at, data = 0, code.instructions
    for _ in range(MOST_STEPS):
        operation, whole = data[at], int.from_bytes(data[at + 1 : at + 2 + wide], "little")
        at += (3 if operation >= 90 else 1) if wide else 2
        pair = letters[operation]
        numbers = (whole >> 4, whole & 15) if pair[1:] else (whole,)
        for letter, number in zip(pair, numbers, strict=False):
            match OPERATORS[number] if letter == "b" else letter:
                case "x":
                    stack.append(variables[number])
                case "s":
                    variables[number] = stack.pop()
                case "c":
                    stack.append(_constant(code.constants[number]))
                case "g" | "G":
                    stack.append(code.names[number >> (letter == "G")])
                case "." | "A":
                    stack.append(f"{stack.pop()}.{code.names[number >> (letter == 'A')]}")
                case "i":
                    stack[-2:] = [code.names[number]]
                case "I":
                    stack.append(f"{stack[-1]}.{code.names[number]}")
                case "p":
                    stack.pop()
                case "t":
                    stack.append(_taken(stack, number))
                case ":":
                    stack.append(slice(*_taken(stack, number)))
                case "[":
                    value, index = _taken(stack, 2)
                    stack.append(_cropped(value, index, rows))
                case "K":
                    keywords = code.constants[number]
                case "f" | "k":
                    keywords = stack.pop() if letter == "k" else keywords
                    pairs = _taken(stack, 2 * (number >> 8))  # of Python before 3.6
                    values = _taken(stack, number & 255)
                    count = len(values) - len(keywords)
                    named = dict(zip(keywords, values[count:], strict=True))
                    named |= dict(zip(pairs[::2], pairs[1::2], strict=True))
                    stack.append(_called(stack.pop(), values[:count], named))
                    keywords = ()
                case "n":
                    stack.append(_operated("-", _Value(0.0, 0.0), stack.pop()))
                case "r":
                    return stack.pop().after()
                case sign:
                    stack.append(_operated(sign, *_taken(stack, 2)))
    raise ValueError("too many instructions")


def _taken(stack: list[Any], count: int) -> tuple:
    """Remove the last values of a stack, and return them."""
    start = len(stack) - count
    if start < 0:
        raise ValueError("too few values")
    taken = tuple(stack[start:])
    del stack[start:]
    return taken


def _constant(constant: object, is_inner: bool = False) -> Any:
    """Return a constant: numbers as `_Value`, None and texts (bytes) as they are."""
    if isinstance(constant, tuple) and not is_inner:  # deeper ones may share 2^40 parts
        return tuple(_constant(part, True) for part in constant)
    if constant is None or isinstance(constant, bytes | bool):
        return constant
    if not is_ordinary(constant):
        raise ValueError("no ordinary number")
    return _Value(0.0, float(constant))


def _operated(sign: str, left: _Value, right: _Value) -> _Value:
    """Return the sum, difference, product or quotient; raise ValueError if it is no line."""
    a, b, c, d = left.factor, left.offset, right.factor, right.offset
    steps = left.steps if a else right.steps
    if a and c and (left.steps != right.steps or sign in "*/"):
        raise ValueError("no line")
    if sign in "+-":
        direction = 1 if sign == "+" else -1
        return _Value(a + direction * c, b + direction * d, steps)
    if sign == "*":
        return _Value(a * d + c * b, b * d, steps)
    if c:
        raise ValueError("no line")
    return _Value(a / d, b / d, steps)


def _called(path: str, values: tuple, named: dict) -> _Value:
    """Return the value of a call of a known function of a known module."""
    *modules, name = path.split(".")
    if name in FUNCTIONS and not named:
        return _operated(FUNCTIONS[name], *values)
    value, *rest = values
    if b"size" in named:
        rest.append(named.pop(b"size"))
    is_aligned = named.pop(b"align_corners", False)
    asked = named.pop(b"method", None)
    if named or not value.factor or not set(modules) <= set(MODULES):
        raise ValueError("unknown call")
    word = "gray" if name == "rgb_to_grayscale" else _known_name(name)
    if rest:
        sides = [side.offset for side in (rest[0] if len(rest) == 1 else rest) if not side.factor]
        is_size = len(sides) == 2 and all(side == int(side) and 1 < side <= 4096 for side in sides)
        is_known = name in ("resize", "resize_images", "resize_bilinear") and "image" in modules
        method = "linear" if name == "resize" and "v1" not in modules else "linear_tf1"
        method = "linear_corners" if is_aligned else method
        if asked is not None:
            is_known &= asked == b"area" or str(asked).endswith(".ResizeMethod.AREA")
            method = "area"
        word = f"resize:{sides[0]:g}:{sides[1]:g}:{method}" if is_size and is_known else None
    if word is None:
        raise ValueError("unknown call")
    return _Value(1.0, 0.0, value.after(word))


def _cropped(value: _Value, index: tuple, rows: int | None) -> _Value:
    """Return an image without some rows at its top and bottom, and with all columns."""
    images, kept, *others = [
        [bound and int(bound.offset) for bound in (cut.start, cut.stop, cut.step)] for cut in index
    ]
    top, stop = kept[0] or 0, kept[1] or 0
    if stop > 0:
        stop -= rows if rows is not None else -1  # unknown rows leave it above 0
    # A stop past the last column or channel keeps all.
    keeps_all = all(
        not first and not step and (last is None or last >= most)
        for (first, last, step), most in zip(others, (320, 3), strict=False)
    )
    if any(images) or kept[2] or top < 0 or stop > 0 or len(others) > 2 or not keeps_all:
        raise ValueError("no crop of rows")
    return _Value(1.0, 0.0, value.after(f"crop:{top}:{-stop}"))


def _known_name(name: str) -> str | None:
    last = name.rpartition(".")[2].replace("arctan", "atan")
    return last if last in ACTIVATIONS and last != "linear" else None


def _short(number: float) -> str:
    """Return a number without the last digits, where 1 / (1 / 255) is not 255.

    >>> _short(1 / (1 / 127.5)), _short(0.5)
    ('127.5', '0.5')
    """
    return f"{number:.12g}"


def specs_of_word(word: str) -> list[dict] | None:
    """Return a word's specs of layers; None if it is no word.

    >>> specs_of_word("crop:60:25")
    [{'layer': 'Cropping2D', 'cropping': [[60, 25], [0, 0]]}]
    """
    if "+" in word:
        parts = [specs_of_word(part) for part in word.split("+")]
        return None if None in parts else [spec for part in parts for spec in part or ()]
    name, *rest = word.split(":")
    method = rest.pop() if name == "resize" and rest and rest[-1] in RESIZE_METHODS else "linear"
    try:
        numbers = [float(text) for text in rest]
    except ValueError:
        return None
    if not all(map(is_ordinary, numbers)):
        return None
    whole = [int(number) for number in numbers if number.is_integer()]
    match name, numbers:
        case "identity" | "linear", []:
            return []
        case "gray", []:
            return [{"layer": "Gray", "weights": GRAY}]
        case "scale", [divisor, less] if abs(divisor) >= LEAST:
            return [{"layer": "Rescaling", "scale": 1 / divisor, "offset": -less}]
        case "atan", [factor]:
            specs: list[dict] = [{"layer": "Activation", "activation": "atan"}]
            return specs if factor == 1 else [*specs, {"layer": "Rescaling", "scale": factor}]
        case "resize", [_, _] if len(whole) == 2:
            return [{"layer": "Resize", "size": whole, "method": method}]
        case "crop", [_, _] if len(whole) == 2:
            return [{"layer": "Cropping2D", "cropping": [whole, [0, 0]]}]
        case _, [] if name in ACTIVATIONS:
            return [{"layer": "Activation", "activation": name}]
    return None
