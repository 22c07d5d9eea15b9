"""What names mean: the definition, module or library that a reference in a module leads to."""

import ast
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from fastac.store.modules import Module, Modules
from fastac.store.references import Import, Reference, Use

Touch = Callable[[str], None] | None
"""Called with each module that a reference passes through."""


@dataclass(frozen=True)
class Target:
    """What a reference leads to: a top-level name of a module, a whole module, or something external."""

    module: str
    name: str | None = None
    external: bool = False

    def __str__(self) -> str:
        return self.module if self.name is None else f"{self.module}.{self.name}"


class Names:
    """Resolves references; `watchable` and `kinds` name the base of settings and the class of tables."""

    def __init__(self, modules: Modules, watchable: str, kinds: str):
        self.modules = modules
        self._watchable, self._kinds = watchable, kinds
        self._settings: dict[Target, bool] = {}

    def refresh(self) -> None:
        self._settings.clear()

    def table(self, module: Module, statement: ast.AST) -> ast.Call | None:
        """The call that makes a table of kinds, if the statement does."""
        value = getattr(statement, "value", None)
        if not isinstance(statement, ast.Assign | ast.AnnAssign) or not isinstance(value, ast.Call):
            return None
        chain = _chain(value.func)
        targets = self.resolve(module, Reference(chain, Use.IMPORT), None) if chain else []
        return value if any(str(target) == self._kinds for target in targets) else None

    def find_table(self, module: Module, kind: str) -> tuple[ast.stmt | None, dict[str, ast.expr] | None]:
        """The statement that makes a table, and the entries where they are a literal with constant names."""
        for name in module.bindings:
            for statement in module.definition(name).nodes:
                call = self.table(module, statement)
                if call is None or not call.args or getattr(call.args[0], "value", None) != kind:
                    continue
                given = call.args[1] if len(call.args) > 1 else None
                if not isinstance(given, ast.Dict):
                    return statement, None
                names = [getattr(key, "value", None) for key in given.keys]
                if not all(isinstance(name, str) for name in names):
                    return statement, None
                return statement, dict(zip(names, given.values, strict=True))
        return None, None

    def is_settings(self, target: Target) -> bool:
        """Whether this is a class below the watchable base."""
        if str(target) == self._watchable:
            return True
        if target not in self._settings:
            self._settings[target] = False  # ends a circle of bases
            module = self.modules.get(target.module) if self.modules.owns(target.module) else None
            nodes = module.definition(target.name).nodes if module and target.name in module.bindings else ()
            bases = [_chain(base) for node in nodes if isinstance(node, ast.ClassDef) for base in node.bases]
            found = (self.resolve(module, Reference(chain, Use.IMPORT), None) for chain in bases if chain)
            self._settings[target] = any(self.is_settings(base) for targets in found for base in targets)
        return self._settings[target]

    def imported_modules(self, imported: Iterable[Import]) -> Iterator[str]:
        for bound in imported:
            if self.modules.owns(bound.module):
                yield bound.module
                if bound.attribute and self.modules.get(str(bound)):
                    yield str(bound)

    def named(self, dotted: str) -> list[Target]:
        """The module that a string names, or whose attribute it names."""
        while "." in dotted:
            if self.modules.get(dotted):
                return [Target(dotted)]
            dotted = dotted.rpartition(".")[0]
        return []

    def resolve(self, module: Module, reference: Reference, touch: Touch) -> list[Target]:
        if reference.bound is not None:
            return self._imported(reference.bound, reference.chain[1:], touch)
        return self._member(module, reference.chain[0], reference.chain[1:], touch)

    def _member(self, module: Module, name: str, rest: tuple[str, ...], touch: Touch) -> list[Target]:
        """What a name at a module's top level means."""
        found: list[Target] = []
        for binding in module.bindings.get(name, ()):
            if isinstance(binding, Import):
                if str(binding) != f"{module.name}.{name}":
                    found += self._imported(binding, rest, touch)
                elif self.modules.get(str(binding)):
                    found += self._inside(str(binding), rest, touch)
            elif Target(module.name, name) not in found:
                found.append(Target(module.name, name))
        if not found:
            for star in module.stars:
                found += self.whole(star)
        return found

    def _imported(self, bound: Import, rest: tuple[str, ...], touch: Touch) -> list[Target]:
        if not self.modules.owns(bound.module):
            return [Target(str(bound), external=True)]
        if bound.attribute is not None:
            rest = (bound.attribute, *rest)
        return self._inside(bound.module, rest, touch)

    def _inside(self, name: str, rest: tuple[str, ...], touch: Touch) -> list[Target]:
        """What a chain of attributes of a module means; the whole module where that is unknown."""
        if touch is not None:
            touch(name)
        if not rest:
            return self.whole(name)
        module = self.modules.get(name)
        found = self._member(module, rest[0], rest[1:], touch) if module else []
        inner = f"{name}.{rest[0]}"
        if not found and (self.modules.get(inner) or self.modules.is_folder(inner)):
            return self._inside(inner, rest[1:], touch)
        return found or self.whole(name)

    def whole(self, name: str) -> list[Target]:
        if not self.modules.owns(name):
            return [Target(name, external=True)]
        return [Target(name)] if self.modules.get(name) else []


def _chain(node: ast.expr) -> tuple[str, ...]:
    """The names of `a.b.c`; none for any other expression."""
    parts: list[str] = []
    while isinstance(node, ast.Attribute):
        parts.insert(0, node.attr)
        node = node.value
    return (node.id, *parts) if isinstance(node, ast.Name) else ()
