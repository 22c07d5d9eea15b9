"""The code that a function depends on, found in the source, symbol by symbol.

Counted are definitions that are referred to, statements with side effects of all modules imported on the way,
files and modules that strings name, and the versions of imported libraries. Not followed are settings classes
where only annotations name them, and tables of kinds: what a step reads of those is recorded when it runs.
"""

import ast
import platform
import re
import sys
import threading
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from fastac.store.digest import path_digest, stamp
from fastac.store.files import content_hash
from fastac.store.libraries import Libraries
from fastac.store.modules import Definition, Module, Modules
from fastac.store.names import Names, Target
from fastac.store.references import Found, Use

_FILE = re.compile(r"[\w./-]+")
_QUOTED = re.compile(r"""["'<]([\w./-]+\.\w+)["'>]""")
_TEMPLATES = frozenset({".j2", ".html", ".h", ".hpp", ".c", ".cc", ".cpp", ".v", ".sv"})
"""Files that may include each other by name."""


class CodeError(ValueError):
    """A function whose code cannot be found; the message is one line."""


class EditedError(RuntimeError):
    """Code on disk that is not what this process has imported; the message is one line."""


@dataclass(frozen=True)
class Closure:
    """What one function, class or entry of a table depends on."""

    symbols: Mapping[str, str]
    """Digest by symbol or file."""
    libraries: Mapping[str, str]
    """Version by distribution, and Python's."""
    tables: frozenset[str] = frozenset()
    """Tables of kinds that it may look up, `module:kind`; what it looks up is recorded when it runs."""

    @cached_property
    def digest(self) -> str:
        return content_hash(dict(self.symbols), dict(self.libraries))


@dataclass
class _Walk:
    """One closure while it is collected."""

    symbols: dict[str, str] = field(default_factory=dict)
    uses: dict[Target, Use] = field(default_factory=dict)
    imported: set[str] = field(default_factory=set)
    distributions: set[str] = field(default_factory=set)
    touched: set[str] = field(default_factory=set)
    folders: set[str] = field(default_factory=set)
    files: set[Path] = field(default_factory=set)
    tables: set[str] = field(default_factory=set)
    work: list[tuple[Target, Use]] = field(default_factory=list)


class Code:
    """The source below some root packages.

    `watchable` and `kinds` name the base of settings classes and the class of tables of kinds. `since`, in
    nanoseconds, is when the process began to import the source; by default, now.
    """

    def __init__(
        self,
        roots: Mapping[str, Path] | None = None,
        *,
        watchable: str = "fastac.scenes.watched.Watchable",
        kinds: str = "fastac.store.kinds.Kinds",
        since: int | None = None,
    ):
        self.modules = Modules(roots or {"fastac": Path(__file__).parents[1]})
        self.libraries = Libraries(next(iter(self.modules.roots)))
        self.resolver = Names(self.modules, watchable, kinds)
        self._known: dict[str, tuple[Closure, set[str], set[Path]]] = {}
        self._stamps: dict[Path, tuple[int, ...] | None] = {}
        self._loaded: dict[str, str] = {}
        self._started = time.time_ns() if since is None else since
        self._lock = threading.RLock()

    def refresh(self) -> None:
        """Notice files that changed since."""
        with self._lock:
            self.modules.refresh()
            self.resolver.refresh()
            now = {path: _stamp(path) for path in self._stamps}
            changed = {path for path, before in self._stamps.items() if now[path] != before}
            self._known = {start: known for start, known in self._known.items() if not known[2] & changed}
            self._stamps = {path: stamp for path, stamp in now.items() if path not in changed}

    def closure(self, start: str) -> Closure:
        """Of `module:name` or of a table's entry, `module:kind[name]`; raises CodeError if there is none."""
        with self._lock:
            if start not in self._known:
                walk = _Walk()
                self._begin(start, walk)
                while walk.work:
                    self._expand(*walk.work.pop(), walk)
                versions = self.libraries.versions(walk.imported, walk.distributions)
                versions["python"] = ".".join(platform.python_version_tuple()[:2])
                paths = {m.path for name in walk.touched if (m := self.modules.get(name))} | walk.files
                closure = Closure(dict(sorted(walk.symbols.items())), versions, frozenset(walk.tables))
                self._known[start] = closure, walk.touched, paths
                self._stamps.update((path, _stamp(path)) for path in paths - self._stamps.keys())
            return self._known[start][0]

    def all_kinds(self, starts: Iterable[str]) -> dict[str, Closure]:
        """The closures of functions and of every entry that they can choose from tables of kinds."""
        pending, found = list(starts), {}
        with self._lock:
            while pending:
                if (start := pending.pop()) in found:
                    continue
                found[start] = self.closure(start)
                for table in found[start].tables:
                    names = self.names(table)
                    pending += [f"{table}[{name}]" for name in (names if isinstance(names, list) else [""])]
        return found

    def loaded(self, start: str) -> Closure:
        """The closure, if this process runs what the files hold; raises EditedError if they were edited.

        Which code a process has imported cannot be seen in the files once they are edited. What it was given
        is therefore kept: on first use no imported file may be younger than the process.
        """
        with self._lock:
            closure = self.closure(start)
            if start not in self._loaded:
                modules = (self.modules.get(name) for name in self._known[start][1] if name in sys.modules)
                for module in modules:
                    if module is not None and module.stamp[1] > self._started:
                        raise EditedError(f"{module.path} is younger than this process: start it again")
                self._loaded[start] = closure.digest
            if self._loaded[start] != closure.digest:
                raise EditedError(f"the code of {start} was edited while this process ran: start it again")
            return closure

    def names(self, table: str) -> object:
        """What stands for the names of a table of kinds, `module:kind`: they, or the code that makes them."""
        name, _, kind = table.partition(":")
        with self._lock:
            module = self.modules.get(name) if self.modules.owns(name) else None
            statement, literal = self.resolver.find_table(module, kind) if module else (None, None)
            if literal is not None:
                return list(literal)
            return Definition((statement,), module.package).text_digest if statement else "unknown"

    def _begin(self, start: str, walk: _Walk) -> None:
        name, _, symbol = start.partition(":")
        module = self.modules.get(name) if self.modules.owns(name) else None
        if module is None:
            raise CodeError(f"{start}: no module of this project")
        kind, bracket, entry = symbol.partition("[")
        if bracket:
            self._touch(name, walk)
            self._table_entry(module, kind, entry.removesuffix("]"), walk)
            return
        symbol = symbol.split(".")[0]
        if not any(isinstance(b, ast.AST) for b in module.bindings.get(symbol, ())):
            raise CodeError(f"{start}: not defined at the top level of {module.path}")
        walk.work.append((Target(name, symbol), Use.LATER))

    def _table_entry(self, module: Module, kind: str, entry: str, walk: _Walk) -> None:
        """What one entry of a table depends on: its value in the literal, or else the whole statement."""
        statement, literal = self.resolver.find_table(module, kind)
        if statement is None:
            walk.work.append((Target(module.name), Use.CALL))
            return
        nodes = (statement,) if literal is None else (literal[entry],) if entry in literal else ()
        definition = Definition(nodes, module.package)
        self._count(f"{module.name}.{kind}[{entry}]", module, definition, Use.IMPORT, walk)

    def _expand(self, target: Target, use: Use, walk: _Walk) -> None:
        """Count what is referred to, once for each way of using it that asks for more."""
        if target.external:
            walk.imported.add(target.module.split(".")[0])
            return
        if use == Use.ANNOTATION:
            if target.name is not None and self.resolver.is_settings(target):
                return
            use = Use.LATER
        module = self.modules.get(target.module)
        if target.name is not None and use == Use.LATER:
            nodes = module.definition(target.name).nodes
            tables = [self.resolver.table(module, node) for node in nodes]
            if tables and all(tables):
                self._touch(target.module, walk)
                walk.tables |= {f"{target.module}:{table.args[0].value}" for table in tables}
                return
        reach = Use.CALL if use == Use.CALL else Use.LATER
        if walk.uses.get(target, -1) >= reach:
            return
        walk.uses[target] = reach
        self._touch(target.module, walk)
        if target.name is None:
            label, definition = f"{target.module} (all of it)", module.whole
            for star in module.stars:
                self._follow(self.resolver.whole(star), reach, walk)
        else:
            label, definition = str(target), module.definition(target.name)
        self._count(label, module, definition, reach, walk)

    def _touch(self, name: str, walk: _Walk) -> None:
        """Count what importing a module runs: its packages', its own and its imports' side effects."""
        pending = [name]
        while pending:
            name = pending.pop()
            if name in walk.touched or not self.modules.owns(name):
                continue
            walk.touched.add(name)
            if "." in name:
                pending.append(name.rpartition(".")[0])
            module = self.modules.get(name)
            if module is None:
                continue
            if module.effects:
                self._count(f"{name} (statements)", module, module.side_effects, Use.CALL, walk)
            for star in module.stars:
                self._follow(self.resolver.whole(star), Use.LATER, walk)
            pending += self.resolver.imported_modules(module.imported)

    def _follow(self, targets: Iterable[Target], use: Use, walk: _Walk) -> None:
        walk.work += ((target, use) for target in targets)

    def _count(self, label: str, module: Module, definition: Definition, use: Use, walk: _Walk) -> None:
        found, meanings = definition.found, []
        for reference in found.references:
            targets = self.resolver.resolve(module, reference, lambda name: self._touch(name, walk))
            meanings += ([reference.chain[0], str(target)] for target in targets)
            # An annotation stays one, however the definition is used.
            inherits = use == Use.CALL and reference.use != Use.ANNOTATION
            self._follow(targets, Use.CALL if inherits else reference.use, walk)
        for name in self.resolver.imported_modules(found.imports):
            self._touch(name, walk)
        walk.symbols[label] = content_hash(definition.text_digest, sorted(meanings))[:16]
        self._strings(module, found, walk)

    def _strings(self, module: Module, found: Found, walk: _Walk) -> None:
        for text in found.strings:
            dotted = text.partition(":")[0]
            if "." in dotted and self.modules.owns(dotted):
                self._follow(self.resolver.named(dotted), Use.CALL, walk)
            if self.libraries.is_distribution(text) and text not in self.modules.roots:
                walk.distributions.add(text)
            if _FILE.fullmatch(text):
                self._named_file(module, text, walk)
        for prefix in found.prefixes:
            package = prefix.rpartition(".")[0]
            if self.modules.owns(package) and self.modules.is_folder(package):
                for name in self.modules.below(package):
                    self._follow([Target(name)], Use.CALL, walk)

    def _named_file(self, module: Module, text: str, walk: _Walk) -> None:
        """Count a file or a folder of data that a string names, from the module's folder up to the root's.

        What Python keeps of sources that it has compiled does not count.
        """
        folder, root = module.path.parent, self.modules.roots[module.name.split(".")[0]]
        if text.startswith("/") or {"..", "__pycache__"}.intersection(text.split("/")):
            return
        for place in (folder, *(p for p in folder.parents if p == root or root in p.parents)):
            path = place / text
            label = f"file {root.name}/{path.relative_to(root).as_posix()}"
            if label in walk.symbols or not path.exists() or path.suffix in (".py", ".pyc"):
                continue
            if path.is_dir() and (not text.strip("./") or any(path.glob("*.py"))):
                continue
            walk.symbols[label] = path_digest(path)[:16]
            walk.files |= {path, *path.rglob("*")}
            if path.suffix in _TEMPLATES:
                for included in set(_QUOTED.findall(path.read_text(errors="replace"))):
                    self._named_file(module, included, walk)


def _stamp(path: Path) -> tuple[int, ...] | None:
    try:
        return stamp(path)
    except FileNotFoundError:
        return None
