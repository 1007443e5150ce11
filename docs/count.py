"""Count the lines of code of each room, and the words of the manual.

`python docs/count.py` prints the lines of code, docstrings and comments of the files that git
tracks, as they are on the disk, tests apart; and the words of the README and of the shelves, the
toctrees of index.md, without tables, code blocks, images and HTML comments.
`python docs/count.py --write` writes both into docs/architecture.md.
"""

import ast
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

from benchmarks.measuring import markdown_table, write_between

DOCS = Path(__file__).parent
ROOT, PAGE = DOCS.parent, DOCS / "architecture.md"
COLUMNS = ("files", "code", "docstrings", "comments", "blank")
TESTS, TOTAL = "tests", "total without tests"
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
SHELF = re.compile(r"^```\{toctree\}\n:caption: (\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
NO_PROSE = re.compile(
    r"^( *)```.*?^\1```$|<!--.*?-->|^ *\|[^\n]*$|!\[[^\]]*\]\([^)]*\)|(?<=\])\([^)]*\)|^\(\S+\)=$",
    re.DOTALL | re.MULTILINE,
)
# Between sentences: a stop, a new paragraph, the mark of a list's item, a heading.
END = re.compile(r"[.!?][*)\"]*(?=\s|$)|\n\s*\n|^ *(?:[-*]|\d+\.) |^#.*$", re.MULTILINE)


def count_lines(text: str) -> Counter[str]:
    """Return the number of lines of each kind in a Python source."""
    inside: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node) is not None:
            inside.update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    counts = Counter(files=1)
    for number, line in enumerate(text.splitlines(), 1):
        if number in inside:
            counts["docstrings"] += 1
        elif line.strip().startswith("#"):
            counts["comments"] += 1
        else:
            counts["code" if line.strip() else "blank"] += 1
    return counts


def count_rooms() -> dict[str, Counter[str]]:
    """Return the counts of the rooms, most code first, of the total and of the tests."""
    command = ["git", "ls-files", "*.py"]
    names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    rooms: dict[str, Counter[str]] = {}
    for name in names.splitlines():
        if not (ROOT / name).is_file():  # deleted, and not committed yet
            continue
        parts = name.split("/")
        room = TESTS if parts[0] == TESTS else "/".join(parts[:2] if parts[2:] else parts[:1])
        counts = count_lines((ROOT / name).read_text(encoding="utf-8"))
        for key in {room, TESTS if room == TESTS else TOTAL}:
            rooms.setdefault(key, Counter()).update(counts)
    last = {key: rooms.pop(key) for key in (TOTAL, TESTS)}
    return dict(sorted(rooms.items(), key=lambda room: -room[1]["code"])) | last


def count_words(pages: list[Path]) -> list[int]:
    """Return the number of pages, of words, and of words per sentence, headings apart."""
    text = "\n\n".join(NO_PROSE.sub("", page.read_text(encoding="utf-8")) for page in pages)
    words, *sentences = (len(re.findall(r"\S*\w\S*", part)) for part in (text, *END.split(text)))
    return [len(pages), words, round(sum(sentences) / max(1, sum(map(bool, sentences))))]


def shelves() -> dict[str, list[Path]]:
    """Return the pages of the README, of each shelf of the manual, and of all."""
    pages = {"README": [ROOT / "README.md"]}
    for name, lines in SHELF.findall((DOCS / "index.md").read_text(encoding="utf-8")):
        names = [DOCS / f"{line}.md" for line in lines.split("\n") if line[:1].isalpha()]
        groups = (page.parent.glob("*.md") if page.stem == "index" else [page] for page in names)
        pages[name] = [page for group in groups for page in group]
    return pages | {"total": [page for shelf in pages.values() for page in shelf]}


def tables() -> dict[str, str]:
    """Return both tables in Markdown, by their markers."""
    lines = [
        [room, *(f"{kinds[key]:,}" for key in COLUMNS)] for room, kinds in count_rooms().items()
    ]
    words = [[name, *map("{:,}".format, count_words(pages))] for name, pages in shelves().items()]
    return {
        "lines of code": markdown_table(["room", *COLUMNS], lines),
        "words of the manual": markdown_table(
            ["shelf", "pages", "words", "words a sentence"], words
        ),
    }


if __name__ == "__main__":
    for marker, table in tables().items():
        write_between(PAGE, marker, table) if "--write" in sys.argv else print(table, end="\n\n")
