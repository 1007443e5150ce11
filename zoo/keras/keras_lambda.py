"""Tell what a Lambda of Keras computes, from the marshalled Python code in its config.

The code is never given to Python's `marshal`, nor run: a reader of its own returns constants, names
and instructions of Python 2.7 to 3.13 as data (CPython's `Python/marshal.c`). A Lambda is described
by a word, which is also what a user sets for an unclear one: see `WORDS`.
"""

import base64
import re
import struct
from dataclasses import dataclass
from typing import Any

from zoo.base.limits import is_ordinary
from zoo.models.image_layers import RESIZE_METHODS
from zoo.models.value_layers import ACTIVATIONS

WORDS = (
    "identity, scale:DIVISOR:SUBTRACTED, atan, atan:FACTOR, resize:ROWS:COLUMNS, "
    "crop:TOP:BOTTOM, gray, tanh or another activation"
)
LEAST = 1e-9  # of a divisor or factor
GRAY = [0.2989, 0.5870, 0.1140]  # of tf.image.rgb_to_grayscale
MOST_BYTES, MOST_OBJECTS, MOST_LEVELS, MOST_STEPS = 100_000, 1_000, 20, 100
# Whole numbers before a code's eight objects, and objects after its first line, in Python 3.11,
# 3.8, 3.0 and 2.7.
LAYOUTS = ((5, 2), (6, 1), (5, 1), (4, 1))
SINGLE = {"N": None, "T": True, "F": False, ".": ...}
# Instructions as letters, before Python 3.13 and in 3.13: x is the argument, c a constant, b an
# operator by its argument, n a minus, f a call, t a tuple; others only bring names.
LETTERS = (
    {
        **{124: "x", 100: "c", 122: "b", 23: "+", 24: "-", 20: "*", 21: "/", 27: "/", 11: "n"},
        **{131: "f", 161: "f", 171: "f", 102: "t", 103: "t", 83: "r"},
        **dict.fromkeys((0, 2, 106, 116, 151, 160, 166), ""),
    },
    {85: "x", 83: "c", 45: "b", 36: "r", 0: "", 149: ""},
)
OPERATORS = {0: "+", 10: "-", 5: "*", 11: "/", 13: "+", 23: "-", 18: "*", 24: "/"}
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
    shown = [f"{one:g}" for one in code.constants if type(one) in (int, float)]
    return _word(code), ", ".join([*shown, *code.names])[:100] or "nothing"


def read_code(data: bytes) -> Code | None:
    """Return the code in marshalled bytes; None if they are no code of a known layout."""
    for whole, last in LAYOUTS if len(data) <= MOST_BYTES else ():
        try:
            reader = _Reader(data, whole, last)
            found = reader.read(0)
        except (ValueError, IndexError, TypeError, struct.error):
            continue
        if isinstance(found, Code) and reader.at == len(data):
            return found
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
        place = len(self.shared)
        if mark & 0x80:
            self.shared.append(None)
        found = self._value(chr(mark & 0x7F), depth)
        if mark & 0x80:
            self.shared[place] = found
        return found

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
        texts = [one.decode("utf-8", "replace") for one in names if isinstance(one, bytes)]
        # 3.11: a byte of flags for each variable; before: names.
        outer = [one for one in free if not isinstance(one, int) or one & 0xC0]
        return Code(instructions, constants, texts, not outer)

    def _take(self, count: int) -> bytes:
        found = self.data[self.at : self.at + count]
        if count < 0 or len(found) != count:
            raise ValueError("truncated")
        self.at += count
        return found

    def _long(self) -> int:
        return struct.unpack("<i", self._take(4))[0]


def _word(code: Code) -> str | None:
    """Return the word for code of a known form, in the instructions of any version of Python."""
    for wide in (False, True):
        for letters in LETTERS:
            form, constants = _form(code, wide, letters)
            values = [one for many in constants for one in _values(many)]
            if not code.is_closed or not form.endswith("r") or not all(map(is_ordinary, values)):
                continue
            word = _called(code.names, form, values) if code.names else _line(form[:-1], values)
            if word:
                return word
    return None


def _form(code: Code, wide: bool, letters: dict[int, str]) -> tuple[str, list]:
    """Return the instructions as letters, and the constants that they use; "?" is another.

    Args:
        code: function's code.
        wide: whether an instruction takes one or three bytes, as before Python 3.6, not two.
        letters: table of `LETTERS`.
    """
    form, constants, at, data = "", [], 0, code.instructions
    while at < len(data) and len(form) < MOST_STEPS:
        operation, argument = data[at], int.from_bytes(data[at + 1 : at + 2 + wide], "little")
        at += (3 if operation >= 90 else 1) if wide else 2
        letter = letters.get(operation, "?")
        if letter == "b":
            letter = OPERATORS.get(argument, "?")
        if letter == "c" and argument < len(code.constants):
            constants.append(code.constants[argument])
        elif letter == "c" or (letter == "x" and argument):
            letter = "?"
        form += letter
    return form, constants


def _values(constant: object) -> tuple:
    return constant if isinstance(constant, tuple) else (constant,)


def _line(form: str, constants: list[float]) -> str | None:
    """Return the word for a * x + b, from pairs (a, b) in place of the values of a stack."""
    left = iter(constants)
    stack: list[tuple[float, float]] = []
    try:
        for letter in form:
            if letter in "xc":
                stack.append((1.0, 0.0) if letter == "x" else (0.0, float(next(left))))
                continue
            c, d = stack.pop()
            a, b = (0.0, 0.0) if letter == "n" else stack.pop()
            if letter in "+-n":
                sign = 1 if letter == "+" else -1
                stack.append((a + sign * c, b + sign * d))
            elif letter == "*" and not (a and c):
                stack.append((a * d + c * b, b * d))
            elif letter == "/" and not c:
                stack.append((a / d, b / d))
            else:
                return None
        ((factor, offset),) = stack
    except (IndexError, ValueError, ZeroDivisionError):
        return None
    if not is_ordinary(factor, least=LEAST) or not is_ordinary(offset):
        return None
    return "identity" if stack == [(1, 0)] else f"scale:{_short(1 / factor)}:{_short(-offset)}"


def _called(names: list[str], form: str, numbers: list[float]) -> str | None:
    """Return the word for code that does nothing but call a function on x."""
    called = [one for one in names if one not in MODULES]
    form = form.replace("t", "")
    if len(called) == 2 and called[0] in ("mul", "multiply") and form in ("xfcfr", "cxffr"):
        called, form = called[1:], "xfc*r"
    if form in ("xfc*r", "cxf*r") and called in (["atan"], ["arctan"]):
        return f"atan:{_short(numbers[0])}"
    if form == "xfr" and len(called) == 1:
        return "gray" if called == ["rgb_to_grayscale"] else _known_name(called[0])
    sizes = [f"{one:g}" for one in numbers if one == int(one) and 1 < one <= 4096]
    is_resize = called in (["resize"], ["resize_images"], ["resize_bilinear"]) and "image" in names
    if is_resize and form in ("xcfr", "xccfr") and len(sizes) == len(numbers) == 2:
        is_old = called != ["resize"] or "v1" in names
        return f"resize:{':'.join(sizes)}:{'linear_tf1' if is_old else 'linear'}"
    return None


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
    name, *rest = word.split(":")
    method = rest.pop() if name == "resize" and rest and rest[-1] in RESIZE_METHODS else "linear"
    try:
        numbers = [float(one) for one in rest]
    except ValueError:
        return None
    if not all(map(is_ordinary, numbers)):
        return None
    whole = [int(one) for one in numbers if one.is_integer()]
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
