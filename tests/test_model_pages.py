"""Pages of the manual about networks, settings and examples."""

import doctest
import importlib
import re
from pathlib import Path

import pytest
import yaml
from omegaconf import OmegaConf

from tests.layer_tables import (
    NetworkFacts,
    layer_table,
    layers_mark,
    networks_table,
    pages_by_network,
)
from zoo.base.compose import choices, compose_config
from zoo.base.conf_files import conf_folder
from zoo.commands.list import zoo_table

PAGES = Path(__file__).parents[1] / "docs" / "models"
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
    wanted = layer_table(networks[name])
    assert table == wanted, f"the table of {pages[0]} should be:\n{wanted}"
    assert f"`model={name}`" in text


def test_the_index_has_the_commands_figures(
    networks: dict[str, NetworkFacts], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(PAGES.parents[1])
    index = (PAGES / "index.md").read_text()
    table = between(index, "<!-- networks -->", "<!-- end of networks -->")
    wanted = networks_table(list(networks.values()), DOCUMENTED)
    assert table == wanted, f"the table of docs/models/index.md should be:\n{wanted}"
    cells = {key: row for key, *row in zip(*(c.cells for c in zoo_table()[0].columns), strict=True)}
    for name in networks:
        (line,) = [line for line in table.splitlines() if line.startswith(f"| [`{name}`]")]
        assert line.endswith(f"| {' | '.join(cells[name])} |")


@pytest.mark.parametrize("page", sorted(PAGES.glob("[!i]*.md")), ids=lambda page: page.name)
def test_a_page_has_what_a_reader_looks_for(page: Path) -> None:
    headings = re.findall(r"^## (.+)$", page.read_text(), re.M)
    for heading in ("Layers", "Differences", "Results", "Vary", "Cite"):
        assert any(text.startswith(heading) for text in headings), heading


PAGE = (Path(__file__).parents[1] / "docs" / "settings.md").read_text()
ROWS = re.findall(r"^\| `([\w.]+)` \| `([^`]+)` \|", PAGE, re.M)


@pytest.fixture(scope="module")
def config() -> dict:
    return compose_config([])


@pytest.mark.parametrize(("key", "default"), ROWS)
def test_a_default_is_the_configs(key: str, default: str, config: dict) -> None:
    defaults = OmegaConf.create(config)
    section, _, last = key.rpartition(".")
    if key != "experiment":  # it names the recipe and is no key of the composed config
        assert last in (OmegaConf.select(defaults, section) if section else defaults)
    assert OmegaConf.select(defaults, key) == yaml.safe_load(default)


def named_choices() -> list[tuple[str, str]]:
    """Return the groups and choices that the page names.

    They stand in headings and in lines that begin with `group=NAME`; those of `augment` in a table,
    those of `model` in the line below its heading.
    """
    pairs = []
    for line in PAGE.splitlines():
        if match := re.match(r"(?:## .*\()?`([a-z]+)=([a-z]\w*)`(.*)", line):
            group, first, rest = match.groups()
            pairs += [(group, name) for name in (first, *re.findall(r"`(\w+)`", rest))]
    _, _, augment = PAGE.partition("\n## Augmentation")
    names = re.findall(r"^\| `(\w+)` \|", augment.partition("\n## ")[0], re.M)
    pairs += [("augment", name) for name in names]
    (models,) = re.findall(r"^## Network .*\n\n(.*)\. Each", PAGE, re.M)
    return pairs + [("model", name) for name in re.findall(r"`(\w+)`", models)]


@pytest.mark.parametrize(("group", "name"), named_choices())
def test_a_named_choice_exists(group: str, name: str) -> None:
    assert name in choices(group), f"docs/settings.md names {group}={name}"


def test_the_recipes_with_fewer_quick_samples_are_named() -> None:
    (line,) = [line for line in PAGE.splitlines() if line.startswith("| `quick_samples`")]
    recipes = (conf_folder() / "experiment").glob("*.yaml")
    fewer = {path.stem for path in recipes if OmegaConf.load(path).get("quick_samples")}
    assert set(re.findall(r"`(\w+)`", line.partition("3,200")[2])) == fewer


def test_the_page_of_recipes_lists_each_recipe_once() -> None:
    page = (Path(__file__).parents[1] / "docs" / "recipes.md").read_text()
    table = page.partition("| recipe |")[2].partition("\n\n")[0]
    assert sorted(re.findall(r"^\| `(\w+)` \|", table, re.M)) == sorted(choices("experiment"))


def test_the_choices_are_found_on_the_page() -> None:
    groups = {group for group, _ in named_choices()}
    assert groups >= {"augment", "data", "loss", "model", "schedule", "trainer"}


REPOSITORY = Path(__file__).parents[1]
PACKAGES = ("datamodules", "drivezoo", "zoo")
MODULES = [
    ".".join(path.relative_to(REPOSITORY).with_suffix("").parts)
    for package in PACKAGES
    for path in sorted((REPOSITORY / package).rglob("*.py"))
    if re.search(r">>> (?!.*\+SKIP)", path.read_text(encoding="utf-8"))
]


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_run(name: str, here: Path) -> None:
    failed, tried = doctest.testmod(importlib.import_module(name))
    assert tried
    assert not failed


def test_examples_are_found_in_the_packages() -> None:
    # Those of drivezoo train or drive: they are skipped.
    assert {name.partition(".")[0] for name in MODULES} >= {"datamodules", "zoo"}
