"""Texts of strangers in a comment of C: no control character ends it."""

import re

from tests.zoo.base.test_file_text import spoiled
from zoo.extras.car.c_source import c_comment


def outside_comments(text: str) -> str:
    """Return C without its comments, by the order of the standard: trigraphs, splices, comments."""
    text = text.replace("??/", "\\")
    return re.sub(r"/\*.*?\*/", "", re.sub(r"\\[ \t]*\n", "", text), flags=re.DOTALL).strip()


def test_a_c_comment_is_not_ended() -> None:
    ends = ("*/ int e; /*", "*\\\n/ int e;", "*??/\n/ int e;", "/*", "*\\/ int e;")
    for text in spoiled(*ends):
        comment = c_comment(text)
        assert not outside_comments(f"/*\n{comment}\n */"), ascii(text)
        assert comment.isascii()
