"""Installed distributions behind imported names, with all that they require, and their versions."""

import importlib.metadata
import os
import re
import sys
from collections.abc import Iterable
from functools import cache

_REQUIREMENT = re.compile(r"\s*([A-Za-z0-9][\w.-]*)\s*(?:\[([^\]]*)\])?[^;]*(?:;(.*))?", re.DOTALL)
_EXTRA = re.compile(r"""extra\s*==\s*['"]([^'"]+)['"]""")


def normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


class Libraries:
    """Versions of what is installed; each distribution is read once."""

    def __init__(self, project: str):
        self._providers: dict[str, list[str]] | None = None
        self._versions: dict[str, str] = {}
        self._closures: dict[str, frozenset[str]] = {}
        # Extras that the project asks for install tools that a library then starts by name.
        self._extras: dict[str, set[str]] = {}
        for name, extras, _ in _required(project):
            self._extras.setdefault(name, set()).update(extras)
        self._installed = frozenset(_installed())

    def is_distribution(self, text: str) -> bool:
        return normalised(text) in self._installed

    def versions(self, imported: Iterable[str], distributions: Iterable[str] = ()) -> dict[str, str]:
        """Version by distribution of top-level imports and named distributions, and of what they require."""
        names: set[str] = set()
        for top in imported:
            for distribution in self._distributions(top):
                names |= self._closure(distribution)
        for distribution in distributions:
            names |= self._closure(normalised(distribution))
        for name in names - self._versions.keys():
            self._versions[name] = _version(name)
        return {name: self._versions[name] for name in sorted(names)}

    def _distributions(self, top: str) -> list[str]:
        if top in sys.stdlib_module_names:
            return []
        if normalised(top) in self._installed:
            return [normalised(top)]
        if self._providers is None:
            self._providers = dict(importlib.metadata.packages_distributions())
        # A name that nothing provides still counts, so that installing it later is noticed.
        return sorted({normalised(name) for name in self._providers.get(top, [top])})

    def _closure(self, distribution: str) -> frozenset[str]:
        if distribution not in self._closures:
            found, work = set(), [(distribution, frozenset(self._extras.get(distribution, ())))]
            done: set[tuple[str, frozenset[str]]] = set()
            while work:
                item = work.pop()
                if item in done:
                    continue
                done.add(item)
                name, extras = item
                found.add(name)
                for required, asked, marker in _required(name):
                    needed = _EXTRA.findall(marker)
                    wanted = not needed or extras & set(needed)
                    if wanted and required in self._installed:
                        work.append((required, asked | self._extras.get(required, set())))
            self._closures[distribution] = frozenset(found)
        return self._closures[distribution]


@cache
def _required(distribution: str) -> tuple[tuple[str, frozenset[str], str], ...]:
    """What a distribution requires: name, extras, marker."""
    try:
        lines = importlib.metadata.distribution(distribution).requires or []
    except importlib.metadata.PackageNotFoundError:
        return ()
    parts = (_REQUIREMENT.match(line).groups() for line in lines)
    return tuple(
        (normalised(name), frozenset(re.findall(r"[^,\s]+", extras or "")), marker or "")
        for name, extras, marker in parts
    )


def _version(distribution: str) -> str:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return "missing"


def _installed() -> Iterable[str]:
    """Names of all installed distributions, from the folders that describe them."""
    for place in sys.path:
        if os.path.isdir(place):
            for entry in os.listdir(place):
                if entry.endswith((".dist-info", ".egg-info")):
                    yield normalised(entry.rpartition(".")[0].split("-")[0])
