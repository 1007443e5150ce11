"""Logs as people have them, written byte for byte."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from datamodules.driving_log import ROWS_AT_ONCE, BadRows, LogRow, read_log, read_log_columns
from tests.recordings import format_number
from zoo.base.errors import InputError

CENTER = r"C:\me\IMG\center_2018_07_16_17_11_43_382.jpg"
LEFT, RIGHT = CENTER.replace("center", "left"), CENTER.replace("center", "right")
PATHS = f"{CENTER},{LEFT},{RIGHT}"
HEADER = "center,left,right,steering,throttle,brake,speed"


def read_text(folder: Path, text: str | bytes) -> list[LogRow]:
    log = folder / "driving_log.csv"
    log.write_bytes(text if isinstance(text, bytes) else text.encode())
    rows = list(read_log(log))
    assert rows == columns_as_rows(log), "both readers agree"
    return rows


def refusal(folder: Path, text: str) -> str:
    with pytest.raises(InputError) as caught:
        read_text(folder, text)
    message = str(caught.value)
    with pytest.raises(InputError) as again:
        read_log_columns(folder / "driving_log.csv")
    assert str(again.value) == message, "both readers agree"
    assert "\n" not in message
    return message


def test_row_without_header(tmp_path):
    (row,) = read_text(tmp_path, f"{PATHS},-0.25,0.5,0,30.19\n")
    assert row == LogRow(1, (CENTER, LEFT, RIGHT), (-0.25, 0.5, 0.0, 30.19))


def test_header_is_not_a_row_and_lines_count_from_it(tmp_path):
    rows = read_text(tmp_path, f"{HEADER}\n{PATHS},0.1,0,0,1\n{PATHS},0.2,0,0,2\n")
    assert [(row.line, row.numbers[0]) for row in rows] == [(2, 0.1), (3, 0.2)]


@pytest.mark.parametrize("first", ["speed", "steering"])
def test_header_with_columns_in_another_order(tmp_path, first):
    values = {"center": CENTER, "left": LEFT, "right": RIGHT}
    values |= {"steering": "-0.5", "throttle": "0.7", "brake": "0.1", "speed": "12"}
    names = [first, *(name for name in reversed(values) if name != first)]
    text = f"{','.join(names)}\n{','.join(values[name] for name in names)}\n"
    (row,) = read_text(tmp_path, text)
    assert row.paths == (CENTER, LEFT, RIGHT)
    assert row.numbers == (-0.5, 0.7, 0.1, 12.0)


def test_header_with_a_column_of_a_fork_that_we_do_not_know(tmp_path):
    (row,) = read_text(tmp_path, f"{HEADER},lap\n{PATHS},0.25,0,0,1,3\n")
    assert row.numbers == (0.25, 0.0, 0.0, 1.0)


def test_header_of_a_centre_only_recording(tmp_path):
    text = f"center,steering,throttle,brake,speed\n{CENTER},0.25,0.5,0,7\n"
    (row,) = read_text(tmp_path, text)
    assert row.paths == (CENTER, "", "")
    assert row.numbers == (0.25, 0.5, 0.0, 7.0)


def test_centre_only_without_header(tmp_path):
    (row,) = read_text(tmp_path, f"{CENTER},0.25,0.5,0,7\n")
    assert (row.paths, row.numbers) == ((CENTER, "", ""), (0.25, 0.5, 0.0, 7.0))


def test_centre_only_without_header_and_with_decimal_commas(tmp_path):
    (row,) = read_text(tmp_path, f"{CENTER},0,25,1,0,30,19028\n")
    assert (row.paths, row.numbers) == ((CENTER, "", ""), (0.25, 1.0, 0.0, 30.19028))


def test_empty_columns_of_side_cameras(tmp_path):
    (row,) = read_text(tmp_path, f"{CENTER},,,0.25,0.5,0,7\n")
    assert (row.paths, row.numbers) == ((CENTER, "", ""), (0.25, 0.5, 0.0, 7.0))


def test_blanks_before_left_and_right(tmp_path):
    (row,) = read_text(tmp_path, "IMG/center_1.jpg, IMG/left_1.jpg, IMG/right_1.jpg, 0, 0, 0, 2\n")
    assert row.paths == ("IMG/center_1.jpg", "IMG/left_1.jpg", "IMG/right_1.jpg")


def test_byte_order_mark(tmp_path):
    (row,) = read_text(tmp_path, b"\xef\xbb\xbf" + f"{PATHS},0,0,0,1\n".encode())
    assert row.paths[0] == CENTER


def test_folder_name_in_an_old_code_page(tmp_path):
    text = "C:\\Ren\xe9\\IMG\\center_1.jpg,,,0.5,0,0,1\n".encode("latin-1")
    (row,) = read_text(tmp_path, text)
    assert row.paths[0].endswith("\\IMG\\center_1.jpg")
    assert row.numbers[0] == 0.5


def test_windows_line_ends(tmp_path):
    rows = read_text(tmp_path, f"{PATHS},0.1,0,0,1\r\n{PATHS},0.2,0,0,2\r\n")
    assert [row.numbers[3] for row in rows] == [1.0, 2.0]


def test_empty_lines_are_passed_over_and_counted(tmp_path):
    rows = read_text(tmp_path, f"{PATHS},0,0,0,1\n\n   \n{PATHS},0,0,0,2\n\n")
    assert [row.line for row in rows] == [1, 4]


def test_quoted_decimal_commas(tmp_path):
    (row,) = read_text(tmp_path, f'{PATHS},"-0,25","0,5","0","30,19"\n')
    assert row.numbers == (-0.25, 0.5, 0.0, 30.19)


def test_semicolons_between_decimal_commas(tmp_path):
    (row,) = read_text(tmp_path, f"{PATHS.replace(',', ';')};-0,25;0,5;0;30,19\n")
    assert (row.paths[2], row.numbers) == (RIGHT, (-0.25, 0.5, 0.0, 30.19))


def steering_numbers() -> st.SearchStrategy[float]:
    return st.floats(-1, 1, width=32).map(lambda value: float(format_number(value)))


def pedals() -> st.SearchStrategy[tuple[float, float]]:
    """Draw throttle and brake as the simulator writes them: never both at once."""
    press = st.floats(0, 1, width=32).map(lambda value: float(format_number(value)))
    return st.tuples(press, st.booleans()).map(
        lambda one: (one[0], 0.0) if one[1] else (0.0, one[0])
    )


numbers_of_a_row = st.builds(
    lambda steering, pedal, speed: (steering, *pedal, speed),
    steering_numbers(),
    pedals(),
    # Below a thousandth "0,1,2E-05" is ambiguous: its brake may be 0 or 0.1.
    st.floats(0, 31).map(lambda value: float(format_number(value)) if value > 0.001 else 0.0),
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


def test_decimal_commas_of_a_log_that_starts_at_speed(tmp_path):
    """A brake of 0.21 at 5 mph, or none at 21.5: throttle and brake are not both pressed."""
    (row,) = read_text(tmp_path, f"{PATHS},0,5,1,0,21,5\n")
    assert row.numbers == (0.5, 1.0, 0.0, 21.5)


@pytest.mark.parametrize("columns", [4, 6])
def test_wrong_number_of_columns_names_file_and_row(tmp_path, columns):
    short = ",".join([*PATHS.split(","), "0", "0", "0"][:columns])
    message = refusal(tmp_path, f"{PATHS},0,0,0,1\n{short}\n")
    assert f"{tmp_path}/driving_log.csv, row 2: {columns} columns, expected 7" in message


def test_a_log_that_ends_within_a_row_says_which_row_to_delete(tmp_path):
    message = refusal(tmp_path, f"{PATHS},0,0,0,1\n{PATHS},0,0")
    assert "row 2: 5 columns, expected 7" in message
    assert "ends within this row; correct or delete the row" in message
    within = refusal(tmp_path, f"{PATHS},0,0,0,1\n{PATHS},0,0\n{PATHS},0,0,0,1\n")
    assert "ends within" not in within
    assert "row 2: 5 columns, expected 7" in within


def test_too_many_columns_name_file_and_row(tmp_path):
    message = refusal(tmp_path, f"{PATHS},0,0,0,1\n{PATHS},0.5,0.25,0.5,20.5,7.5,9.5,1.5,2,3\n")
    assert f"{tmp_path}/driving_log.csv, row 2: 12 columns" in message


def test_extra_column_with_decimal_points_is_refused(tmp_path):
    message = refusal(tmp_path, f"{PATHS},0.5,0.25,0,20.5,7\n")
    assert "row 1" in message
    assert "four numbers" in message


def test_header_without_a_column_names_it(tmp_path):
    assert "no column brake" in refusal(tmp_path, HEADER.replace(",brake", "") + "\n")


@pytest.mark.parametrize("text", ["NaN", "nan", "inf", "-Infinity", "", "left"])
def test_steering_that_is_no_finite_number_names_row_and_value(tmp_path, text):
    message = refusal(tmp_path, f"{PATHS},0,0,0,1\n{PATHS},{text},0,0,1\n")
    assert f"row 2: steering is {text!r}" in message


def test_speed_that_is_no_finite_number_names_it(tmp_path):
    assert "speed is 'NaN'" in refusal(tmp_path, f"{PATHS},0,0,0,NaN\n")


@pytest.mark.parametrize("steering", ["1.01", "-25"])
def test_steering_beyond_one_names_the_row(tmp_path, steering):
    assert f"row 1: steering is {steering}, beyond" in refusal(
        tmp_path, f"{PATHS},{steering},0,0,1"
    )


@pytest.mark.parametrize("steering", ["1", "-1"])
def test_full_lock_is_accepted(tmp_path, steering):
    (row,) = read_text(tmp_path, f"{PATHS},{steering},0,0,1\n")
    assert row.numbers[0] == float(steering)


@pytest.mark.parametrize("text", ["", "\n\n", HEADER + "\n", "\ufeff"])
def test_log_without_rows(tmp_path, text):
    assert "the log has no rows" in refusal(tmp_path, text)


def test_field_that_csv_cannot_read_names_the_row(tmp_path):
    endless = '"' + "x" * 200_000
    message = refusal(tmp_path, f"{PATHS},0,0,0,1\n{endless}\n")
    assert "row 2: not a CSV row" in message


@pytest.mark.parametrize("blank", [None, ROWS_AT_ONCE + 5])
def test_a_log_of_several_chunks(tmp_path, blank):
    lines = [f"{PATHS},{row % 100 / 100},0,0,{row % 30}" for row in range(2 * ROWS_AT_ONCE + 10)]
    if blank:
        lines.insert(blank, "")
    rows = read_text(tmp_path, HEADER + "\n" + "\n".join(lines))
    assert len(rows) == 2 * ROWS_AT_ONCE + 10
    assert rows[-1].line == len(lines) + 1


@pytest.mark.parametrize("name", ["center", "right", "speed"])
def test_header_that_names_a_column_twice_is_refused(tmp_path, name):
    names = HEADER.split(",")
    names[1] = name
    message = refusal(tmp_path, f"{','.join(names)}\n{PATHS},0,0,0,1\n")
    assert f"{tmp_path}/driving_log.csv, row 1: " in message
    assert f" {name} more than once" in message
    assert HEADER in message


@pytest.mark.parametrize(
    ("numbers", "found"),
    [
        ("0,99,0,1", "throttle is 99, beyond -1..1"),
        ("0,0,99,1", "brake is 99, beyond 0..1"),
        ("0,0,-0.5,1", "brake is -0.5, beyond 0..1"),
        ("0,0,0,-3", "speed is -3, beyond 0..200"),
        ("0,0,0,1e300", "speed is 1e+300, beyond 0..200"),
        ('"0","0","0","201,5"', "speed is 201.5, beyond 0..200"),
    ],
)
def test_a_number_beyond_its_range_names_row_value_and_range(tmp_path, numbers, found):
    message = refusal(tmp_path, f"{PATHS},0,0,0,1\n{PATHS},{numbers}\n")
    assert f"{tmp_path}/driving_log.csv, row 2: {found}" in message
    assert "delete the row" in message


def test_reversing_of_a_fork_is_accepted(tmp_path):
    (row,) = read_text(tmp_path, f"{PATHS},0,-0.5,0,2\n")
    assert row.numbers[1] == -0.5


def test_decimal_commas_are_not_read_as_an_impossible_speed(tmp_path):
    """30.19028 mph, not 19,028."""
    (row,) = read_text(tmp_path, f"{PATHS},0,1,0,30,19028\n")
    assert row.numbers == (0.0, 1.0, 0.0, 30.19028)


def test_semicolons_in_a_folder_name(tmp_path):
    (row,) = read_text(tmp_path, f"{PATHS.replace('IMG', 'a;b')},0,0,0,2\n")
    assert row.paths[0] == CENTER.replace("IMG", "a;b")


def rows_with_quotes(*where: int) -> str:
    """Write 120 rows; the named ones (from 1) begin with a quote."""
    rows = range(1, 121)
    return "".join(f"{chr(34) * (row in where)}{PATHS},0,0,0,{row % 30}\n" for row in rows)


def test_two_stray_quotes_that_swallow_rows_are_refused_where_they_open(tmp_path):
    """Row 8's quote ends at row 20's, and the thirteen rows would be read as one."""
    inside = f"{PATHS},0,0,0,1\n" * 7 + f'{CENTER},{LEFT},"{RIGHT},0,0,0,1\n'
    inside += f"{PATHS},0,0,0,1\n" * 11 + f'x",0,0,0,1\n{PATHS},0,0,0,1\n'
    message = refusal(tmp_path, inside)
    assert "row 8: a quote opens here" in message
    assert "row 20" in message
    assert "delete the row" in message


def test_a_quote_that_never_closes_is_refused_where_it_opens(tmp_path):
    assert "row 8: a quote opens here" in refusal(tmp_path, rows_with_quotes(8))


def test_a_quote_that_runs_on_too_far_for_csv_is_refused_where_it_opens(tmp_path):
    text = rows_with_quotes(8) + f"{PATHS},0,0,0,1\n" * 1_000
    assert "row 8: not a CSV row" in refusal(tmp_path, text)


def test_a_folder_with_a_comma_in_quotes_is_read(tmp_path):
    (row,) = read_text(tmp_path, '"a, b/center_1.jpg","a, b/left_1.jpg",,0,0,0,1\n')
    assert row.paths == ("a, b/center_1.jpg", "a, b/left_1.jpg", "")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("header", ["", HEADER + "\n"], ids=["bare", "header"])
def test_utf_16_is_named_with_the_way_to_utf_8(tmp_path, encoding, header):
    message = refusal(tmp_path, f"{header}{PATHS},0,0,0,1\n".encode(encoding))
    assert message.startswith(f"{tmp_path}/driving_log.csv, row 1: ")
    assert "UTF-16" in message
    assert "iconv" in message
    assert "\0" not in message


@pytest.mark.parametrize("byte", [b"\xe9", b"\0"])
@pytest.mark.parametrize("camera", ["center", "left"])
def test_an_image_name_that_is_no_utf_8_names_the_row(tmp_path, byte, camera):
    text = f"{PATHS},0,0,0,1\n".encode()
    bad = text.replace(f"{camera}_".encode(), camera.encode() + byte)
    message = refusal(tmp_path, text + bad)
    assert f"{tmp_path}/driving_log.csv, row 2: " in message
    if byte != b"\0" or sys.version_info >= (3, 11):  # earlier, the csv module refuses a NUL
        assert "row 2: the image name" in message
        assert "UTF-8" in message
    message.encode()
    assert "\0" not in message


def test_a_column_name_that_is_no_utf_8_can_be_printed(tmp_path):
    text = f"{HEADER},temp\xe9rature\n{PATHS},0,0,0,1\n".encode("latin-1")
    refusal(tmp_path, text).encode()


PIECES = [*HEADER.split(","), *PATHS.split(","), f"{PATHS},0,0,0,1\n", f"{HEADER}\n"]
PIECES += ["0", "1", "-1", "0,5", "0.5", "99", "1e300", "nan", " ", ";", *",,,", *"\n\n", '"']
ODD_BYTES = [b"\0", b"\xe9", b"\xff\xfe", b"\xc3\xaf"]


@given(st.lists(st.sampled_from([*(piece.encode() for piece in PIECES), *ODD_BYTES]), max_size=30))
def test_both_readers_agree_on_any_log(tmp_path_factory, pieces):
    """The quick reader returns what `read_log` does, or raises the same InputError."""
    log = tmp_path_factory.mktemp("log") / "driving_log.csv"
    log.write_bytes(b"".join(pieces))
    assert outcome(log, lambda one: list(read_log(one))) == outcome(log, columns_as_rows)


def columns_as_rows(log: Path) -> list[LogRow]:
    columns = read_log_columns(log)
    paths, numbers = zip(*columns.paths, strict=True), map(tuple, columns.numbers.tolist())
    return list(map(LogRow, columns.line.tolist(), paths, numbers))


def outcome(log: Path, read: Callable[[Path], list[LogRow]]) -> list[LogRow] | str:
    try:
        return read(log)
    except InputError as error:
        return str(error)


def test_bad_rows_are_left_out_and_named(tmp_path):
    log = tmp_path / "driving_log.csv"
    bad_rows = [f"{PATHS},left,0,0,1", f"{PATHS},0,0", f'"{PATHS},0,0,0,1', f'"{PATHS},2,0,0,1']
    log.write_text("".join(f"{PATHS},0.{row},0,0,1\n{one}\n" for row, one in enumerate(bad_rows)))
    bad = BadRows("skip")
    rows = list(read_log(log, bad))
    assert [row.numbers[0] for row in rows] == [0.0, 0.1, 0.2]
    assert [fault.partition(":")[0] for fault in bad.faults] == [
        f"{log}, row {line}" for line in (2, 4, 6)
    ]


def test_a_log_of_bad_rows_alone_is_refused_even_if_they_are_skipped(tmp_path):
    log = tmp_path / "driving_log.csv"
    log.write_text(f"{PATHS},left,0,0,1\n" * 3)
    with pytest.raises(InputError, match=r"row 1: steering is 'left'.*3 of 3 rows.*all rows"):
        read_log_columns(log, BadRows("skip"))


@pytest.mark.parametrize(
    ("angle", "remedy"), [("12.5", "by 25$"), ("-90", "by 25 times the ratio")]
)
def test_a_steering_in_degrees_has_one_remedy_for_all_rows(tmp_path, angle, remedy):
    text = f"{PATHS},0,0,0,1\n{PATHS},2,0,0,1\n{PATHS},{angle},0,0,1\n"
    with pytest.raises(InputError, match=f"row 2.*2 of 3 rows.*divide the column {remedy}"):
        read_text(tmp_path, text)


def test_a_header_of_another_format_is_named_with_the_columns_that_are_needed(tmp_path):
    message = refusal(tmp_path, "filename,steer_angle,velocity\n1.jpg,0.1,3\n")
    assert "row 1: the header filename,steer_angle,velocity" in message
    assert HEADER in message
