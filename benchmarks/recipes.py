"""Recipes that `benchmarks/results.py` trains: its table's rows, and variations.

*published* is the recipe of a publication, from `conf/experiment`. The others were chosen by their
drives on the lake, with training seeds that the table does not use, and checked on the mountain.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Recipe:
    """A row of the table: a network and its training settings.

    Attributes:
        model: name of the network.
        setting: `published`, or the settings that differ.
        overrides: overrides of `drivezoo train`.
        seeds: largest number of training seeds.
        in_table: False for recipes that only serve to compare offline metrics.
    """

    model: str
    setting: str
    overrides: tuple[str, ...]
    seeds: int = 3
    in_table: bool = True

    @property
    def name(self) -> str:
        return f"{self.model}-{self.setting.replace(',', '').replace(' ', '_')}"


# The last epoch of a schedule, not the one with the best validation MSE. The latter is often the
# first epoch, because an expert's rows on the centreline reward a network that hardly steers.
LAST = ("schedule=cosine", "callbacks=published", "callbacks.best.monitor=train/loss")
BENDS = "augment=[brightness,bend]"
HALF = "trainer.precision=bf16-mixed"
NO_BONNET = ("data.crop=[60,40]", "data.offset=0.4", "optim.lr=0.003", "trainer.max_epochs=20")


def recipes() -> list[Recipe]:
    """Return the recipes of the table, then the variations."""
    return [*table_recipes(), *variations()]


def table_recipes() -> list[Recipe]:
    """Return each network's published recipe, then the one with which it drives best."""
    cropped = (
        *LAST,
        BENDS,
        "data.crop=[50,20]",
        "data.samples_per_epoch=4800",
        "trainer.max_epochs=8",
    )
    best = ("data.samples_per_epoch=6400", "trainer.max_epochs=6", "schedule=cosine")
    random_features = (
        *LAST,
        "model.weights=null",
        "model.size=[32,80]",
        "data.crop=[50,20]",
        "augment=[]",
        "data.samples_per_epoch=6400",
        "trainer.max_epochs=6",
        "optim.lr=0.0003",
    )
    strip = ("experiment=linear15", "data.offset=0.4")
    return [
        Recipe("lenet", "published", ("experiment=lenet",)),
        Recipe("lenet", "with bends", ("experiment=lenet", BENDS)),
        Recipe("nvidia", "published", ("experiment=pilotnet",), seeds=2),
        Recipe("nvidia", "with bends", ("model=nvidia", BENDS, *best)),
        Recipe("nvidia", "with bends, bf16", ("model=nvidia", BENDS, *best, HALF)),
        Recipe("commaai", "published, quick", ("experiment=commaai", "quick=true")),
        Recipe("commaai", "with bends, cropped", ("model=commaai", *cropped)),
        Recipe("tiny", "published", ("experiment=tiny41",)),
        Recipe("tiny", "no bonnet", ("experiment=tiny41", *LAST, *NO_BONNET, "model.dropout=0")),
        Recipe("tiny63", "published", ("experiment=tiny63",)),
        Recipe("tiny63", "no bonnet", ("experiment=tiny63", *LAST, *NO_BONNET)),
        Recipe("vgg", "random features", ("model=vgg", *random_features)),
        Recipe("linear", "ours, 33 numbers", (*strip, "model.size=[2,16]", "data.crop=[55,40]")),
        Recipe("linear", "ours, 21 numbers", (*strip, "model.size=[2,10]", "data.crop=[55,40]")),
        Recipe("linear", "ours, 15 numbers", strip),
        Recipe("linear", "ours, 11 numbers", (*strip, "model.size=[1,10]")),
    ]


def variations() -> list[Recipe]:
    """Return better and worse recipes, to test whether a metric can distinguish them."""
    bases = {
        "lenet": ("model=lenet", "quick=true", "quick_samples=3200"),
        "tiny": ("experiment=tiny41", "trainer.max_epochs=10"),
        "nvidia": ("model=nvidia", "quick=true", "quick_samples=3200"),
    }
    changes = {
        "plain": (),
        "centre camera": ("data.cameras=[center]",),
        "small offset": ("data.offset=0.1",),
        "large offset": ("data.offset=0.5",),
        "bends": (BENDS,),
        "one epoch": ("trainer.max_epochs=1",),
    }
    return [
        Recipe(model, f"{setting}, {split}", (*base, f"data.split={split}", *more), 1, False)
        for model, base in bases.items()
        for split in ("blocks", "random")
        for setting, more in changes.items()
    ]
