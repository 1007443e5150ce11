"""Functions that are registered by a decorator: drivezoo's, and those of the user's parts."""

import sys
from collections.abc import Iterator, Mapping
from typing import TypeVar

from zoo.base.parts import import_part, registering_parts

Entry = TypeVar("Entry")


class Registry(Mapping[str, Entry]):
    """Registered entries by name: drivezoo's first, then those of parts and installed packages.

    The user names parts with `parts=`; a package names modules as entry points of the group
    `drivezoo.KINDs`. They are imported when the registry is first read after they were named.

    Args:
        kind: kind of the entries in a word, such as `metric`.
    """

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self._entries: dict[str, tuple[str, Entry]] = {}  # module and entry, by name

    def add(self, name: str, entry: Entry, module: str) -> None:
        """Add an entry that a module registers.

        Raises:
            ValueError: another module has an entry of that name, or another entry has that label.
        """
        # A cell of a notebook may register its function again.
        if self._entries.get(name, (module,))[0] != module:
            raise ValueError(f"{self.kind} {name}: already registered; rename the function")
        others = [other for key, (_, other) in self._entries.items() if key != name]
        if getattr(entry, "label", None) in [getattr(other, "label", "") for other in others]:
            raise ValueError(f"{self.kind} {name}: another {self.kind} has its label; change it")
        self._entries[name] = module, entry

    def own(self) -> list[str]:
        """Return the names of drivezoo's own entries."""
        return [name for name, (module, _) in self._entries.items() if module.startswith("zoo.")]

    def __getitem__(self, name: str) -> Entry:
        """Return an entry; parts are imported only if it is none of the known ones."""
        if name not in self._entries:
            self._import_parts()
        return self._entries[name][1]

    def __iter__(self) -> Iterator[str]:
        self._import_parts()
        return iter(sorted(self._entries, key=lambda name: name not in self.own()))

    def __len__(self) -> int:
        self._import_parts()
        return len(self._entries)

    def _import_parts(self) -> None:
        """Import the parts that may register entries.

        Raises:
            InputError: a part cannot be imported.
        """
        named, installed = registering_parts(f"drivezoo.{self.kind}s")
        for part in (*named, *installed):
            count, is_known = len(self._entries), part.module in sys.modules
            import_part(part, part.module)
            if part in installed and not is_known and len(self._entries) == count:
                print(f"{part.name}: registers no {self.kind}", file=sys.stderr)
