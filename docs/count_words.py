"""Count the words of the manual without tables, code blocks, images and HTML comments.

`python docs/count_words.py` prints a table of the README and the shelves, the toctrees of index.md.
`python docs/count_words.py --write` writes it into docs/architecture.md.
"""

import re
import sys
from pathlib import Path

from benchmarks.measuring import markdown_table, write_between

DOCS = Path(__file__).parent
SHELF = re.compile(r"^```\{toctree\}\n:caption: (\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
NO_PROSE = re.compile(
    r"^( *)```.*?^\1```$|<!--.*?-->|^ *\|[^\n]*$|!\[[^\]]*\]\([^)]*\)|(?<=\])\([^)]*\)|^\(\S+\)=$",
    re.DOTALL | re.MULTILINE,
)
# Between sentences: a stop, a new paragraph, the mark of a list's item, a heading.
END = re.compile(r"[.!?][*)\"]*(?=\s|$)|\n\s*\n|^ *(?:[-*]|\d+\.) |^#.*$", re.MULTILINE)


def count(pages: list[Path]) -> list[int]:
    """Return the number of pages, of words, and of words per sentence, headings apart."""
    text = "\n\n".join(NO_PROSE.sub("", page.read_text(encoding="utf-8")) for page in pages)
    words, *sentences = (len(re.findall(r"\S*\w\S*", part)) for part in (text, *END.split(text)))
    return [len(pages), words, round(sum(sentences) / max(1, sum(map(bool, sentences))))]


if __name__ == "__main__":
    shelves = {"README": [DOCS.parent / "README.md"]}
    for name, lines in SHELF.findall((DOCS / "index.md").read_text(encoding="utf-8")):
        pages = [DOCS / f"{line}.md" for line in lines.split("\n") if line[:1].isalpha()]
        groups = (page.parent.glob("*.md") if page.stem == "index" else [page] for page in pages)
        shelves[name] = [page for group in groups for page in group]
    shelves["total"] = [page for pages in shelves.values() for page in pages]
    rows = [[name, *map("{:,}".format, count(pages))] for name, pages in shelves.items()]
    table = markdown_table(["shelf", "pages", "words", "words a sentence"], rows)
    page, marker = DOCS / "architecture.md", "words of the manual"
    write_between(page, marker, table) if "--write" in sys.argv else print(table)
