"""Logs as people have them, written byte for byte."""

import sys
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from datamodules.driving_log import BadRows, LogRow, read_log
from datamodules.steering_unit import SteeringUnit
from tests.recordings import format_number
from tests.refusals import refusal
from zoo.base.errors import InputError

CENTER = r"C:\me\IMG\center_2018_07_16_17_11_43_382.jpg"
LEFT, RIGHT = CENTER.replace("center", "left"), CENTER.replace("center", "right")
PATHS = f"{CENTER},{LEFT},{RIGHT}"
HEADER = "center,left,right,steering,throttle,brake,speed"
CENTRE_HEADER = HEADER.replace(",left,right", "")


def read_text(folder: Path, text: str | bytes, *options: object) -> list[LogRow]:
    log = folder / "driving_log.csv"
    log.write_bytes(text if isinstance(text, bytes) else text.encode())
    return list(read_log(log, *options))


NUMBERS = (0.25, 0.5, 0.0, 7.0)
ALL, CENTRE = (CENTER, LEFT, RIGHT), (CENTER, "", "")
BLANKS = ("IMG/center_1.jpg", "IMG/left_1.jpg", "IMG/right_1.jpg")
COMMA = (0.25, 1.0, 0.0, 30.19028)
ONE_ROW: dict[str, tuple[str | bytes, tuple, tuple]] = {
    "no header": (f"{PATHS},-0.25,0.5,0,30.19", ALL, (-0.25, 0.5, 0.0, 30.19)),
    "columns in another order": (
        f"steering,speed,brake,throttle,right,left,center\n-0.5,12,0.1,0.7,{RIGHT},{LEFT},{CENTER}",
        ALL,
        (-0.5, 0.7, 0.1, 12.0),
    ),
    "unknown column": (f"{HEADER},lap\n{PATHS},0.25,0.5,0,7,3", ALL, NUMBERS),
    "centre only, header": (f"{CENTRE_HEADER}\n{CENTER},0.25,0.5,0,7", CENTRE, NUMBERS),
    "centre only": (f"{CENTER},0.25,0.5,0,7", CENTRE, NUMBERS),
    "centre only, decimal commas": (f"{CENTER},0,25,1,0,30,19028", CENTRE, COMMA),
    "empty side cameras": (f"{CENTER},,,0.25,0.5,0,7", CENTRE, NUMBERS),
    "blanks": (f"{', '.join(BLANKS)}, 0.25, 0.5, 0, 7", BLANKS, NUMBERS),
    "byte order mark": (b"\xef\xbb\xbf" + f"{PATHS},0.25,0.5,0,7".encode(), ALL, NUMBERS),
    "quoted commas": (f'{PATHS},"-0,25","0,5","0","30,19"', ALL, (-0.25, 0.5, 0.0, 30.19)),
    "semicolons": (f"{PATHS.replace(',', ';')};0,25;0,5;0;7", ALL, NUMBERS),
    "semicolon in a name": (f"a;b{PATHS},0.25,0.5,0,7", (f"a;b{CENTER}", LEFT, RIGHT), NUMBERS),
    # A brake of 0.21 at 5 mph, or none at 21.5: throttle and brake are not both pressed.
    "commas, at speed": (f"{PATHS},0,5,1,0,21,5", ALL, (0.5, 1.0, 0.0, 21.5)),
    "no impossible speed": (f"{PATHS},0,1,0,30,19028", ALL, (0.0, 1.0, 0.0, 30.19028)),
    "a fork's reversing": (f"{PATHS},0,-0.5,0,2", ALL, (0.0, -0.5, 0.0, 2.0)),
    "full lock": (f"{PATHS},1,0,0,1", ALL, (1.0, 0.0, 0.0, 1.0)),
    "a hair beyond full lock": (f"{PATHS},1.0000001,0,0,1", ALL, (1.0000001, 0.0, 0.0, 1.0)),
    "full lock left": (f"{PATHS},-1,0,0,1", ALL, (-1.0, 0.0, 0.0, 1.0)),
    "tabs": (f"{PATHS},0.25,0.5,0,7".replace(",", "\t"), ALL, NUMBERS),
    "Excel's line": (f"sep=,\r\n{HEADER}\r\n{PATHS},0.25,0.5,0,7", ALL, NUMBERS),
    "Excel's semicolons": (f"sep=;\n{PATHS.replace(',', ';')};0,25;0,5;0;7", ALL, NUMBERS),
    "bars": (f"{PATHS},0.25,0.5,0,7".replace(",", "|"), ALL, NUMBERS),
    "tabs, decimal commas": (f"{PATHS},0;25,0;5,0,7".translate({44: 9, 59: 44}), ALL, NUMBERS),
    "centre only, semicolons": (f"{CENTER};0,25;0,5;0;7", CENTRE, NUMBERS),
    "blank first line": (f"\n{PATHS},0.25,0.5,0,7".replace(",", ";"), ALL, NUMBERS),
    "trailing comma": (f"{PATHS},0.25,0.5,0,7,", ALL, NUMBERS),
    "trailing commas": (f"{PATHS},0.25,0.5,0,7,,,", ALL, NUMBERS),
    "trailing comma, decimal commas": (f"{PATHS},0,25,1,0,30,19028,", ALL, COMMA),
    "trailing comma, header": (f"{HEADER},\n{PATHS},0.25,0.5,0,7,", ALL, NUMBERS),
    "trailing comma, header without": (f"{HEADER}\n{PATHS},0.25,0.5,0,7,", ALL, NUMBERS),
    "trailing comma, row without": (f"{HEADER},\n{PATHS},0.25,0.5,0,7", ALL, NUMBERS),
    "pandas": (f",0,1,2,3,4,5,6\n0,{PATHS},0.25,0.5,0,7", ALL, NUMBERS),
    "pandas without index": (f"0,1,2,3,4,5,6\n{PATHS},0.25,0.5,0,7", ALL, NUMBERS),
    "pandas, names": (f",{HEADER}\n0,{PATHS},0.25,0.5,0,7", ALL, NUMBERS),
    "index without a name": (f"{HEADER}\n0,{PATHS},0.25,0.5,0,7", ALL, NUMBERS),
    "index twice": (f"0,0,{PATHS},0.25,0.5,0,7", ALL, NUMBERS),
    "index, centre only": (f"0,{CENTER},0.25,0.5,0,7", CENTRE, NUMBERS),
    "more columns": (f"{PATHS},0.25,0.5,0,7,3,lap", ALL, NUMBERS),
    "more columns, header": (f"{HEADER}\n{PATHS},0.25,0.5,0,7,3", ALL, NUMBERS),
    "more columns, index": (f"0,{PATHS},0.25,0.5,0,7,3", ALL, NUMBERS),
    "quoted comma in a name": ('"a, b/1.jpg",,,0.25,0.5,0,7', ("a, b/1.jpg", "", ""), NUMBERS),
}


@pytest.mark.parametrize(("text", "paths", "numbers"), ONE_ROW.values(), ids=ONE_ROW)
def test_a_row_in_every_dialect(tmp_path, text, paths, numbers):
    (row,) = read_text(tmp_path, text + (b"\n" if isinstance(text, bytes) else "\n"))
    assert (row.paths, row.numbers) == (paths, numbers)


STANDING = f"{PATHS},0,0,0,0"
JOINED = [
    (f"{HEADER}\n{{}}\n{HEADER}\n{{}}", f"{PATHS},0.25,0.5,0,7"),
    (f"{{}}\n{HEADER.upper()}\n{{}}", f"{PATHS},0.25,0.5,0,7"),
    ("{}\nspeed,center,steering,brake,throttle\n{}", f"7,{CENTER},0.25,0,0.5"),
]


@pytest.mark.parametrize(("form", "second"), JOINED)
def test_a_header_in_the_middle_names_the_columns_below_it(tmp_path, form, second):
    text = form.format(f"{PATHS},0.25,0.5,0,7", second) + "\n"
    bad = BadRows()
    assert [row.numbers for row in read_text(tmp_path, text, bad)] == [NUMBERS, NUMBERS]
    (note,) = bad.notes
    assert f"row {len(text.splitlines()) - 1} " in note


NOTES = [
    (f"{PATHS},0.25,0.5,0,7".replace(",", "\t"), "separated by tabs"),
    (f"{PATHS},0.25,0.5,0,7".replace(",", ";"), "separated by semicolons"),
    (f"{PATHS},0.25,0.5,0,7".replace(",", "|"), "separated by bars"),
    (f"0,{PATHS},0.25,0.5,0,7,3", "taken for -,center,left,right,steering,throttle,brake,speed,-"),
]


@pytest.mark.parametrize(("row", "words"), NOTES)
def test_what_is_inferred_of_a_log_is_noted(tmp_path, row, words):
    bad = BadRows()
    assert len(read_text(tmp_path, f"{row}\n", bad)) == 1
    (note,) = bad.notes
    assert "driving_log.csv" in note
    assert words in note


def test_a_further_column_of_whole_numbers_is_no_part_of_a_decimal_comma(tmp_path):
    """The first row, of a standing car, has no point: the others tell."""
    rows = read_text(tmp_path, f"{STANDING},1\n{PATHS},0.25,0.5,0,7,1\n{STANDING},2\n")
    assert [row.numbers for row in rows] == [(0, 0, 0, 0), NUMBERS, (0, 0, 0, 0)]


def test_points_of_other_rows_do_not_end_decimal_commas(tmp_path):
    """Of two logs that were joined, one has decimal commas."""
    rows = read_text(tmp_path, f"{PATHS},0,25,1,0,30,19028\n{PATHS},0.25,0.5,0,7\n")
    assert [row.numbers for row in rows] == [COMMA, NUMBERS]


def test_lines_count_the_header_and_empty_lines_and_end_in_any_way(tmp_path):
    rows = read_text(tmp_path, f"{HEADER}\r\n{PATHS},0.1,0,0,1\r\n\n   \n{PATHS},0.2,0,0,2\n\n")
    assert [(row.line, row.numbers[0]) for row in rows] == [(2, 0.1), (5, 0.2)]


def test_folder_name_in_an_old_code_page(tmp_path):
    (row,) = read_text(tmp_path, "C:\\Ren\xe9\\IMG\\center_1.jpg,,,0.5,0,0,1\n".encode("latin-1"))
    assert row.paths[0].endswith("\\IMG\\center_1.jpg")
    assert row.numbers[0] == 0.5


def written_floats(low: float, high: float) -> st.SearchStrategy[float]:
    """Draw numbers as the simulator writes them."""
    return st.floats(low, high, width=32).map(lambda value: float(format_number(value)))


numbers_of_a_row = st.builds(
    lambda steering, pedals, speed: (steering, *pedals, speed),
    written_floats(-1, 1),
    # Throttle or brake, never both at once.
    written_floats(0, 1).flatmap(lambda pedal: st.sampled_from([(pedal, 0.0), (0.0, pedal)])),
    # Below a thousandth "0,1,2E-05" is ambiguous: its brake may be 0 or 0.1.
    written_floats(0, 31).map(lambda value: value if value > 0.001 else 0.0),
)


@given(numbers_of_a_row, st.floats(-0.04, 0.04))
@example((0.1, 0.0, 1.0, 0.0), 0.0)
@example((-3.278255e-07, 0.0, 0.0, 25.0), 0.0)
@example((0.01, 0.0, 0.0, 21.5), 0.0)
@example((1e-05, 1.0, 0.0, 4.0), 0.0)
@example((0.0, 0.0, 0.0, 1.175494e-38), 0.0)
def test_decimal_commas_round_trip(tmp_path_factory, numbers, nearby):
    """Seven digits as C# writes them, after a row of nearly the same speed."""
    folder = tmp_path_factory.mktemp("log")
    before = format_number(max(numbers[3] + nearby, 0))
    first = [f'"{number}"' for number in ("0", "0", "0", before.replace(".", ","))]
    fields = [format_number(number).replace(".", ",") for number in numbers]
    text = f"{PATHS},{','.join(first)}\n{PATHS},{','.join(fields)}\n"
    assert read_text(folder, text)[1].numbers == numbers


@given(numbers_of_a_row)
def test_semicolons_round_trip_any_numbers(tmp_path_factory, numbers):
    fields = [format_number(number).replace(".", ",") for number in numbers]
    text = f"{PATHS.replace(',', ';')};{';'.join(fields)}\n"
    (row,) = read_text(tmp_path_factory.mktemp("log"), text)
    assert row.numbers == numbers


GOOD = f"{PATHS},0,0,0,1\n"
REFUSED = [
    (f"{GOOD}{CENTER},{LEFT},{RIGHT},0\n", "row 2: 4 columns, expected 7"),
    (f"{GOOD}{PATHS},0,0,0\n", "row 2: 6 columns, expected 7"),
    (f"{GOOD}{PATHS},0.5,0.25,0.5,20.5,7.5,9.5,1.5,2,3\n", "row 2: 12 columns"),
    (HEADER.replace(",brake", "") + "\n", "row 1: the header names brake 0 times"),
    ("Center,Left,Right,Steering Angle,Throttle,Break,Speed\n", "(unknown: steering angle,break)"),
    *(
        (f"{GOOD}{PATHS},{text},0,0,1\n", f"row 2: steering is {text!r}")
        for text in ("NaN", "nan", "inf", "-Infinity", "", "left")
    ),
    (f"{PATHS},0,0,0,NaN\n", "row 1: speed is 'NaN'"),
    (f"{PATHS},1.01,0,0,1", "row 1: steering is 1.01, beyond"),
    (f"{PATHS},1.0000051,0,0,1", "row 1: steering is 1.0000051, beyond"),
    (f"{PATHS},0,0,0,200.00001", "row 1: speed is 200.00001, beyond"),
    (f"{PATHS},-25,0,0,1", "row 1: steering is -25, beyond"),
    (f"{GOOD}{PATHS},0,99,0,1\n", "row 2: throttle is 99, beyond -1..1"),
    (f"{GOOD}{PATHS},0,0,99,1\n", "row 2: brake is 99, beyond 0..1"),
    (f"{GOOD}{PATHS},0,0,-0.5,1\n", "row 2: brake is -0.5, beyond 0..1"),
    (f"{GOOD}{PATHS},0,0,0,-3\n", "row 2: speed is -3, beyond 0..200"),
    (f"{GOOD}{PATHS},0,0,0,1e300\n", "row 2: speed is 1e+300, beyond 0..200"),
    (f'{GOOD}{PATHS},"0","0","0","201,5"\n', "row 2: speed is 201.5, beyond 0..200"),
    (GOOD + '"' + "x" * 200_000 + "\n", "row 2: not a CSV row"),
    (GOOD * 7 + f'"{GOOD}' + GOOD * 99, "row 8: a quote opens here"),
    (GOOD * 7 + f'"{GOOD}' + GOOD * 1_099, "row 8: not a CSV row"),
    *((text, "the log has no rows") for text in ("", "\n\n", HEADER + "\n", "\ufeff")),
    *(
        (HEADER.replace("left", name) + f"\n{GOOD}", f"csv, row 1: ... {name} 2 times ... {HEADER}")
        for name in ("center", "right", "speed")
    ),
    ("filename,angle,kmh\n1.jpg,0.1,3\n", f"row 1: the header filename,angle,kmh ... {HEADER}"),
    (  # Row 8's quote ends at row 20's, and the thirteen rows would be read as one.
        GOOD * 7 + f'{CENTER},{LEFT},"{RIGHT},0,0,0,1\n' + GOOD * 11 + f'x",0,0,0,1\n{GOOD}',
        "row 8: a quote opens here ... row 20 ... delete the row",
    ),
]


@pytest.mark.parametrize(("text", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_what_is_wrong_is_named_with_file_and_row(tmp_path, text, words):
    message = refusal(read_text, tmp_path, text)
    for part in (f"{tmp_path}/driving_log.csv", *words.split(" ... ")):
        assert part in message
    if "beyond" in words and "steering" not in words:
        assert "delete the row" in message


def test_a_last_row_that_is_being_written_is_left_out(tmp_path):
    for half in (",0,0", ",0,0,0,", ",0,0,0,-"):
        assert [row.line for row in read_text(tmp_path, f"{PATHS},0,0,0,1\n{PATHS}{half}")] == [1]
    assert len(read_text(tmp_path, f"{PATHS},0,0,0,1,\n{PATHS},0,0,0,2,")) == 2, "more columns"
    for rest in (f"\n{PATHS},0,0,0,1\n", "\n"):
        within = refusal(read_text, tmp_path, f"{PATHS},0,0,0,1\n{PATHS},0,0{rest}")
        assert "row 2: 5 columns, expected 7" in within


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("header", ["", HEADER + "\n"], ids=["bare", "header"])
def test_utf_16_is_named_with_the_way_to_utf_8(tmp_path, encoding, header):
    message = refusal(read_text, tmp_path, f"{header}{PATHS},0,0,0,1\n".encode(encoding))
    assert message.startswith(f"{tmp_path}/driving_log.csv, row 1: ")
    assert "UTF-16" in message
    assert "iconv" in message
    assert "\0" not in message


@pytest.mark.parametrize("byte", [b"\xe9", b"\0"])
@pytest.mark.parametrize("camera", ["center", "left"])
def test_an_image_name_that_is_no_utf_8_names_the_row(tmp_path, byte, camera):
    text = f"{PATHS},0,0,0,1\n".encode()
    bad = text.replace(f"{camera}_".encode(), camera.encode() + byte)
    message = refusal(read_text, tmp_path, text + bad)
    assert f"{tmp_path}/driving_log.csv, row 2: " in message
    if byte != b"\0" or sys.version_info >= (3, 11):  # earlier, the csv module refuses a NUL
        assert "row 2: the image name" in message
        assert "UTF-8" in message
    message.encode()
    assert "\0" not in message


def test_a_column_name_that_is_no_utf_8_can_be_printed(tmp_path):
    text = f"{HEADER},temp\xe9rature\n{PATHS},0,0,0,1\n".encode("latin-1")
    refusal(read_text, tmp_path, text).encode()


def test_bad_rows_are_left_out_and_named(tmp_path):
    bad_rows = [f"{PATHS},left,0,0,1", f"{PATHS},0,0", f'"{PATHS},0,0,0,1', f'"{PATHS},2,0,0,1']
    text = "".join(f"{PATHS},0.{row},0,0,1\n{text}\n" for row, text in enumerate(bad_rows))
    bad = BadRows("skip")
    assert [row.numbers[0] for row in read_text(tmp_path, text, bad)] == [0.0, 0.1, 0.2]
    places = [fault.partition(":")[0] for fault in bad.faults]
    assert places == [f"{tmp_path}/driving_log.csv, row {line}" for line in (2, 4, 6)]


def test_a_log_of_bad_rows_alone_is_refused_even_if_they_are_skipped(tmp_path):
    with pytest.raises(InputError, match=r"row 1: steering is 'left'.*3 of 3 rows.*all rows"):
        read_text(tmp_path, f"{PATHS},left,0,0,1\n" * 3, BadRows("skip"))


def test_a_log_in_degrees_has_one_remedy_and_is_read_with_it(tmp_path):
    text = f"{PATHS},0,0,0,1\n{PATHS},2,0,0,1\n{PATHS},-12.5,0,0,1\n"
    with pytest.raises(InputError, match=r"row 2.*2 of 3 rows.*; .*data\.steering=\{unit: deg"):
        read_text(tmp_path, text)
    rows = read_text(tmp_path, text, None, SteeringUnit("deg", full=25.0, right="negative"))
    assert [row.numbers[0] for row in rows] == [0, -0.08, 0.5]
    (row,) = read_text(tmp_path, f"{PATHS},12,5,0,5,0,16\n", None, SteeringUnit("deg", full=25.0))
    assert row.numbers == (0.5, 0.5, 0, 16), "decimal commas"
