"""Tables within pages: replace the text between two marker lines."""

from pathlib import Path


def write_between(page: Path, marker: str, text: str) -> None:
    """Replace what stands between `<!-- MARKER -->` and `<!-- end of ... -->` of a page.

    The last marker has the first word of `results of lenet`.

    Raises:
        SystemExit: the page has no such markers; the message names page and marker.
    """
    begin, end = f"<!-- {marker} -->", f"<!-- end of {marker.partition(' of ')[0]} -->"
    before, first, rest = page.read_text().partition(begin)
    _, last, after = rest.partition(end)
    if not first or not last:
        raise SystemExit(f"{page}: has no {begin} ... {end}; add both where the table belongs")
    page.write_text(f"{before}{begin}\n{text}\n{end}{after}")


def markdown_table(head: list[str], rows: list[list[str]], left: int = 1) -> str:
    """Return a table in Markdown whose first `left` columns are aligned to the left.

    >>> print(markdown_table(["name", "size"], [["a", "1"]]))
    | name | size |
    |---|---:|
    | a | 1 |
    """
    rule = ["---"] * left + ["---:"] * (len(head) - left)
    lines = [f"| {' | '.join(cells)} |" for cells in (head, *rows)]
    return "\n".join([lines[0], f"|{'|'.join(rule)}|", *lines[1:]])
