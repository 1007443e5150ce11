"""The kept configs of the tests are those that Hydra composes."""

import pytest

from tests import kept_compositions
from zoo.base.compose import compose_config

CHOICES = (
    ["model=tiny", "data.root=here", "seed=3"],
    ["augment=[shift,noise]", "callbacks=closed_loop", "~data.augment.shift"],
    ["experiment=lenet", "+callbacks.mine._target_=here.Mine"],
)


@pytest.mark.parametrize("overrides", CHOICES, ids=" ".join)
def test_kept_configs_are_composed(overrides: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    compose_config(overrides[:1])  # the same files, other values
    compose_config(overrides)["data"].clear()
    config = compose_config(overrides)
    monkeypatch.setattr(kept_compositions, "only_our_files", lambda sources: False)
    assert config == compose_config(overrides)


def test_a_choice_of_files_is_composed_once() -> None:
    compose_config(["model=tiny", "seed=1"])
    number = len(kept_compositions._kept)
    assert compose_config(["model=tiny", "seed=2"])["seed"] == 2
    assert len(kept_compositions._kept) == number > 0
