"""The networks' pages in `docs/models` agree with the code."""

import re
from pathlib import Path

import pytest

from benchmarks.model_tables import (
    NetworkFacts,
    layer_table,
    layers_mark,
    networks_table,
    pages_by_network,
)
from zoo.list import zoo_table

PAGES = Path(__file__).parents[1] / "docs" / "models"
UPDATE = "run python benchmarks/model_tables.py"
DOCUMENTED = pages_by_network(PAGES)


@pytest.fixture(scope="module")
def networks() -> dict[str, NetworkFacts]:
    return {name: NetworkFacts(name) for name in DOCUMENTED}


def between(text: str, begin: str, end: str) -> str:
    return text.partition(f"{begin}\n")[2].partition(f"\n{end}")[0]


@pytest.mark.parametrize("name", DOCUMENTED)
def test_one_page_has_the_layers_of_a_network(name: str, networks: dict[str, NetworkFacts]) -> None:
    pages = [page for page in PAGES.glob("*.md") if layers_mark(name) in page.read_text()]
    assert len(pages) == 1, f"{layers_mark(name)} must stand on one page"
    text = pages[0].read_text()
    table = between(text, layers_mark(name), "<!-- end of layers -->")
    assert table == layer_table(networks[name]), UPDATE
    counts = [int(cell.replace(",", "")) for cell in re.findall(r"([\d,]+) \|$", table, re.M)]
    assert sum(counts) == networks[name].parameters
    assert f"**{networks[name].parameters:,}**" in table
    assert f"`model={name}`" in text


def test_the_index_has_the_figures_that_the_command_prints(
    networks: dict[str, NetworkFacts], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(PAGES.parents[1])
    table = between(
        (PAGES / "index.md").read_text(), "<!-- networks -->", "<!-- end of networks -->"
    )
    assert table == networks_table(list(networks.values()), DOCUMENTED), UPDATE
    printed = {
        row[0]: row[1:] for row in zip(*(c.cells for c in zoo_table()[0].columns), strict=True)
    }
    for name in networks:
        figures = printed[name]
        (line,) = [line for line in table.splitlines() if line.startswith(f"| [`{name}`]")]
        assert line.endswith(f"| {' | '.join(figures)} |")


@pytest.mark.parametrize("page", sorted(PAGES.glob("[!i]*.md")), ids=lambda page: page.name)
def test_a_page_has_what_a_reader_looks_for(page: Path) -> None:
    headings = re.findall(r"^## (.+)$", page.read_text(), re.M)
    for heading in ("Layers", "Differences", "Results", "Vary", "Cite"):
        assert any(one.startswith(heading) for one in headings), heading
    assert headings[-1] == "Next"
