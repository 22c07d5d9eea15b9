"""Tables of kinds: what a name in a scene stands for, such as a solver or a rig.

    SOLVERS = Kinds("solver", {"dst2d": Dst2d, "tridiagonal": Tridiagonal})

A step depends on the entries that it looks up, not on the table. The table is a top-level constant with a
literal dict, so that an entry's code can be found without running it.
"""

import sys
from collections.abc import Iterator, Mapping
from typing import TypeVar

from fastac.store.recording import listed, looked_up

Value = TypeVar("Value")


class UnknownKindError(KeyError):
    """A name that a table of kinds lacks; the message is one line that says what there is."""

    def __str__(self) -> str:
        return str(self.args[0])


class Kinds(Mapping[str, Value]):
    """A frozen mapping from names to what they stand for, whose use inside a step is recorded."""

    def __init__(self, kind: str, entries: Mapping[str, Value]):
        self.kind = kind
        self._entries = dict(entries)
        self.table = f"{sys._getframe(1).f_globals['__name__']}:{kind}"
        """Where the table is, for the step engine."""

    @property
    def names(self) -> tuple[str, ...]:
        """The names, for planners: looking at them is not recorded."""
        return tuple(self._entries)

    def __getitem__(self, name: str) -> Value:
        if name not in self._entries:
            self._list()
            raise UnknownKindError(f"{self.kind}: {name!r} is unknown; there is {', '.join(self._entries)}")
        looked_up(self.table, name)
        return self._entries[name]

    def __contains__(self, name: object) -> bool:
        self._list()
        return name in self._entries

    def __iter__(self) -> Iterator[str]:
        self._list()
        return iter(self._entries)

    def __len__(self) -> int:
        self._list()
        return len(self._entries)

    def __repr__(self) -> str:
        return f"Kinds({self.kind!r}, {list(self)})"

    def _list(self) -> None:
        listed(self.table, list(self._entries))
