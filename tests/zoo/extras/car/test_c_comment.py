"""Texts of strangers in a comment of C: no control character ends it."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.zoo.base.test_file_text import spoiled
from zoo.extras.car.c_source import c_comment


def outside_comments(text: str) -> str:
    """Return C without its comments, by the order of the standard: trigraphs, splices, comments."""
    text = text.replace("??/", "\\")
    return re.sub(r"/\*.*?\*/", "", re.sub(r"\\[ \t]*\n", "", text), flags=re.DOTALL).strip()


ENDS_OF_A_COMMENT = ("*/ int e; /*", "*\\\n/ int e;", "*??/\n/ int e;", "/*", "*\\/ int e;")


def test_a_c_comment_is_not_ended() -> None:
    for text in spoiled(*ENDS_OF_A_COMMENT):
        comment = c_comment(text)
        assert not outside_comments(f"/*\n{comment}\n */"), ascii(text)
        assert comment.isascii()


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs a C compiler")
def test_a_compiler_sees_no_code_in_comments(tmp_path: Path) -> None:
    comments = "".join(f"/*\n{c_comment(text)}\n */\n" for text in spoiled(*ENDS_OF_A_COMMENT))
    (tmp_path / "a.c").write_text(f"{comments}int e;\n")
    words = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "a.c"]
    subprocess.run(words, check=True, cwd=tmp_path)
