"""The words of the manual, which `docs/count_words.py` counts."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs"))
import count_words  # noqa: E402

PAGE = """# A heading

Three words [here](page.md). And `a=1` two!

<!-- runs -->
```console
drivezoo train
```

| a | table |
|---|---|

- An item
- Another
"""


def test_tables_code_and_comments_are_no_words(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    assert count_words.count([page]) == [1, 11, 2]  # nine words in four sentences


def test_the_guide_is_read_in_an_hour() -> None:
    guide = count_words.SHELF.findall((ROOT / "docs" / "index.md").read_text())[0]
    assert guide[0] == "Guide"
    pages = [ROOT / "docs" / f"{line}.md" for line in guide[1].split("\n") if line[:1].isalpha()]
    _, words, per_sentence = count_words.count(pages)
    assert words <= 6_000
    assert per_sentence <= 16
