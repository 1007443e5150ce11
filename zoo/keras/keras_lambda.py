"""Tell what a Lambda of Keras computes, from the constants and names in its code.

The code is read as data (see `zoo.keras.marshalled_code`) and never run. A Lambda is
described by a word, which is also what a user sets for an unclear one: see `WORDS`.
"""

import base64
import re
from contextlib import suppress

from zoo.base.limits import is_ordinary
from zoo.keras.marshalled_code import Code, instructions, read_code
from zoo.models.image_layers import RESIZE_METHODS
from zoo.models.value_layers import ACTIVATIONS

WORDS = (
    "identity, scale:DIVISOR:SUBTRACTED, atan, atan:FACTOR, resize:ROWS:COLUMNS, "
    "crop:TOP:BOTTOM, gray, tanh or another activation"
)
LEAST = 1e-9  # of a divisor or factor
GRAY = [0.2989, 0.5870, 0.1140]  # of tf.image.rgb_to_grayscale
# Operations of x and constants, by Python's numbers before 3.11 and by BINARY_OP's arguments.
BINARY = {23: "+", 24: "-", 20: "*", 21: "/", 27: "/"}
BINARY_OP = {0: "+", 10: "-", 5: "*", 11: "/", 13: "+", 23: "-", 18: "*", 24: "/"}
# Python's numbers of operations, which 3.13 changed: argument, constant, BINARY_OP, return.
NUMBERS = ((124, 100, 122, 83), (85, 83, 45, 36))
SKIPPED = ((0, 151), (0, 149))  # CACHE and RESUME
NEGATIVE, RETURN = 11, 83
# Python's numbers of calls before 3.13, and of operations that only bring x, names and constants.
CALLS = (131, 161, 171)
PLAIN = (0, 2, 100, 102, 103, 106, 116, 124, 151, 160, 166)
MODULES = (
    "tf", "tensorflow", "K", "keras", "backend", "math", "image", "nn", "activations", "ktf", "np",
    "compat", "v1", "python", "ops",
)  # fmt: skip
# Constants in their order, where the operations are of an unknown Python version.
KNOWN = {(127.5, 1.0): (127.5, 1.0), (255.0, 0.5): (255.0, 0.5), (255.0,): (255.0, 0.0)}


def describe_lambda(config: dict) -> tuple[str | None, str]:
    """Return a word for what a Lambda computes, None if it is unclear, and a text on what it holds.

    Args:
        config: the layer's config, from an untrusted file.
    """
    function = config.get("function")
    if isinstance(function, dict):
        function = function.get("config", function)
        function = function.get("code", function) if isinstance(function, dict) else function
        if isinstance(function, dict):
            function = function.get("name", "")
    closure = function[2] if isinstance(function, list) and len(function) > 2 else None
    text = function[0] if isinstance(function, list) and function else function
    if not isinstance(text, str):
        return None, "no code in the file"
    if config.get("function_type") == "function" or re.fullmatch(r"[\w.]{1,100}", text):
        return _known_name(text), f"function {text:.60}"
    code = next((one for data in _decoded(text) if (one := read_code(data))), None)
    if code is None:
        return None, "code of an unknown version of Python"
    shown = [f"{one:g}" for one in _numbers(code.constants)]
    shown += [str(one) for one in code.names]
    return (None if closure else _word(code)), ", ".join(shown)[:100] or "nothing"


def _decoded(text: str) -> list[bytes]:
    """Return the bytes that a text may stand for, as Keras 2.1 and later, and 1.0 to 2.0, write."""
    found = []
    with suppress(ValueError):
        found.append(base64.b64decode(re.sub(r"\s", "", text), validate=True))
    for encoding in ("raw_unicode_escape", "latin-1"):
        with suppress(UnicodeEncodeError):
            found.append(text.encode(encoding))
    return found


def _known_name(name: str) -> str | None:
    last = name.rpartition(".")[2]
    return last if last in ("atan", *ACTIVATIONS) and last != "linear" else None


def _word(code: Code) -> str | None:
    numbers = _numbers(code.constants)
    if not all(map(is_ordinary, numbers)):
        return None
    if code.free or any(isinstance(one, Code) for one in code.constants):
        return None
    if code.names:
        return _word_of_names(code, numbers)
    line = _straight_line(code) or KNOWN_LINES.get(tuple(numbers))
    if line is None:
        return None
    factor, offset = line
    return "identity" if line == (1, 0) else f"scale:{_short(1 / factor)}:{_short(-offset)}"


KNOWN_LINES = {key: (1 / divisor, -less) for key, (divisor, less) in KNOWN.items()}


def _word_of_names(code: Code, numbers: list[float]) -> str | None:
    """Return the word for code that does nothing but call a function on x."""
    names = [str(one) for one in code.names]
    called = [one for one in names if one not in MODULES]
    calls, products = _calls(code)
    if any(isinstance(one, str) for one in _flat(code.constants)) or calls is None:
        return None
    if called and called[-1] in ("atan", "arctan") and len(numbers) < 2:
        by_function = calls == 2 and not products and called[0] in ("mul", "multiply")
        by_sign = calls == 1 and products and len(called) == 1
        if len(numbers) == 1 and (by_sign or by_function):
            return f"atan:{_short(numbers[0])}"
        return "atan" if not numbers and calls == len(called) == 1 and not products else None
    if calls != 1 or products or len(called) != 1:
        return None
    if called == ["rgb_to_grayscale"] and not numbers:
        return "gray"
    sizes = [one for one in numbers if one == int(one) and 1 < one <= 4096]
    if len(sizes) == len(numbers) == 2 and "image" in names:
        is_old = called[0] in ("resize_images", "resize_bilinear") or "v1" in names
        if is_old or called[0] == "resize":
            return f"resize:{sizes[0]:g}:{sizes[1]:g}:{'linear_tf1' if is_old else 'linear'}"
    return _known_name(called[0]) if not numbers else None


def _calls(code: Code) -> tuple[int | None, bool]:
    """Return the number of calls, and whether the result is a product of the last one.

    None stands for code with any other operation.
    """
    for wide in (False, True):
        found = [one for one in instructions(code, wide) if one[0] not in PLAIN]
        calls = [one for one in found if one[0] in CALLS]
        rest = [one for one in found if one[0] not in CALLS]
        if not found or found[-1][0] != RETURN or len(rest) > 2:
            continue
        if len(rest) == 1:
            return len(calls), False
        is_product = rest[0][0] == 20 or (rest[0][0] == 122 and rest[0][1] == 5)
        if is_product and found[-2] == rest[0]:
            return len(calls), True
    return None, False


def _straight_line(code: Code) -> tuple[float, float] | None:
    """Return a and b of code that computes a * x + b; None for any other."""
    for wide in (False, True):
        for numbers, skipped in zip(NUMBERS, SKIPPED, strict=True):
            try:
                found = _run_on_lines(code, wide, numbers, skipped)
            except (LookupError, ValueError, TypeError, ZeroDivisionError, OverflowError):
                continue
            if found is not None and is_ordinary(found[0], least=LEAST) and is_ordinary(found[1]):
                return found
    return None


def _run_on_lines(
    code: Code, wide: bool, numbers: tuple[int, ...], skipped: tuple[int, ...]
) -> tuple[float, float] | None:
    """Follow the operations with pairs (a, b) in place of tensors a * x + b."""
    variable, constant, binary, end = numbers
    stack: list[tuple[float, float]] = []
    for operation, argument in instructions(code, wide):
        if operation in skipped:
            continue
        if operation == end:
            return stack.pop() if len(stack) == 1 else None
        if operation == variable and argument == 0:
            stack.append((1.0, 0.0))
        elif operation == constant:
            stack.append((0.0, float(code.constants[argument])))
        elif operation == NEGATIVE:
            a, b = stack.pop()
            stack.append((-a, -b))
        elif operation in BINARY or operation == binary:
            sign = BINARY_OP[argument] if operation == binary else BINARY[operation]
            right, left = stack.pop(), stack.pop()
            stack.append(_combined(left, sign, right))
        else:
            return None
    return None


def _combined(
    left: tuple[float, float], sign: str, right: tuple[float, float]
) -> tuple[float, float]:
    (a, b), (c, d) = left, right
    if sign in "+-":
        factor = 1 if sign == "+" else -1
        return a + factor * c, b + factor * d
    if sign == "*" and not (a and c):
        return a * d + c * b, b * d
    if sign == "/" and not c:
        return a / d, b / d
    raise ValueError("not a straight line")


def _flat(constants: tuple) -> list:
    inner = (_flat(one) if isinstance(one, tuple) else [one] for one in constants)
    return [one for many in inner for one in many]


def _numbers(constants: tuple) -> list[float]:
    return [float(one) for one in _flat(constants) if type(one) in (int, float)]


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
    whole = [int(one) for one in numbers if one == one // 1 and abs(one) < 1e6]
    if name in ("identity", "linear") and not rest:
        return []
    if name == "gray" and not rest:
        return [{"layer": "Gray", "weights": GRAY}]
    if name == "scale" and len(numbers) == 2 and is_ordinary(numbers[0], least=LEAST):
        return [{"layer": "Rescaling", "scale": 1 / numbers[0], "offset": -numbers[1]}]
    if name == "atan" and len(numbers) == 1:
        specs: list[dict] = [{"layer": "Activation", "activation": "atan"}]
        return specs if numbers[0] == 1 else [*specs, {"layer": "Rescaling", "scale": numbers[0]}]
    if name == "resize" and len(rest) == len(whole) == 2:
        return [{"layer": "Resize", "size": whole, "method": method}]
    if name == "crop" and len(rest) == len(whole) == 2:
        return [{"layer": "Cropping2D", "cropping": [whole, [0, 0]]}]
    if name in ACTIVATIONS and not rest:
        return [{"layer": "Activation", "activation": name}]
    return None
