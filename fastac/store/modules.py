"""The project's own modules, found as files and parsed without importing them."""

import ast
import hashlib
import os
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path

from fastac.store.digest import stamp
from fastac.store.references import Found, Import, find, imports, parsed

Binding = ast.stmt | Import


class SourceError(ValueError):
    """Code that cannot be read; the message is one line that names the file."""


def dump(node: ast.AST) -> str:
    """A text of the code without positions, comments and docstrings, like `ast.dump` but faster."""
    parts: list[str] = []
    _dump(node, parts)
    return "".join(parts)


def _dump(node: object, parts: list[str]) -> None:
    if isinstance(node, ast.AST):
        parts.append(f"{type(node).__name__}(")
        for name in node._fields:
            value = getattr(node, name, None)
            if value is not None:
                parts.append(name)
                _dump(value, parts)
        parts.append(")")
    elif isinstance(node, list):
        parts.append("[")
        for item in node:
            if not _is_docstring(item):
                _dump(item, parts)
        parts.append("]")
    else:
        parts.append(f"{node!r},")


def _is_docstring(node: object) -> bool:
    """A string that stands alone: after a function's head as well as after a constant."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


class Definition:
    """Statements that belong together, with their digest and what they refer to."""

    def __init__(self, nodes: tuple[ast.AST, ...], package: str):
        self.nodes = nodes
        self._package = package

    @cached_property
    def text_digest(self) -> str:
        return hashlib.sha256("".join(map(dump, self.nodes)).encode()).hexdigest()

    @cached_property
    def found(self) -> Found:
        return find((node for node in self.nodes if not _is_docstring(node)), self._package)


class Module:
    """One parsed module: what each top-level name is bound to, and the statements with side effects."""

    def __init__(self, name: str, path: Path, is_package: bool):
        self.name, self.path, self.is_package = name, path, is_package
        self.package = name if is_package else name.rpartition(".")[0]
        self.stamp = stamp(path)
        try:
            self.statements = parsed(path.read_bytes()).body
        except SyntaxError as error:
            raise SourceError(f"{path}:{error.lineno}: {error.msg}") from None
        self.bindings: dict[str, list[Binding]] = {}
        self.imported: set[Import] = set()
        self.stars: list[str] = []
        self.effects: list[ast.stmt] = []
        for statement in self.statements:
            self._read(statement)
        self._definitions: dict[object, Definition] = {}

    def _read(self, statement: ast.stmt) -> None:
        match statement:
            case ast.Import() | ast.ImportFrom():
                self._import(statement)
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                self._bind(statement.name, statement)
            case ast.Assign() if all(map(_is_names, statement.targets)):
                self._bind_targets(statement, statement.targets)
            case ast.AnnAssign(target=ast.Name()):
                self._bind(statement.target.id, statement)
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                pass
            case ast.If() if _runs_as_script(statement.test):
                pass
            case _:
                self._effect(statement)

    def _import(self, statement: ast.Import | ast.ImportFrom) -> None:
        if isinstance(statement, ast.Import):
            self.imported.update(Import(alias.name) for alias in statement.names)
        for name, bound in imports(statement, self.package):
            self.imported.add(bound)
            if name == "*":
                self.stars.append(bound.module)
            else:
                self._bind(name, bound)

    def _effect(self, statement: ast.stmt) -> None:
        """A statement that always counts, and the names that it binds on its way."""
        self.effects.append(statement)
        nodes: list[ast.AST] = [statement]
        while nodes:
            node = nodes.pop()
            match node:
                case ast.Import() | ast.ImportFrom():
                    self._import(node)
                case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                    self._bind(node.name, statement)
                    continue
                case ast.Lambda():
                    continue
                case ast.Name(ctx=ast.Store()):
                    self._bind(node.id, statement)
            nodes.extend(ast.iter_child_nodes(node))

    def _bind_targets(self, statement: ast.stmt, targets: list[ast.expr]) -> None:
        for target in targets:
            for node in ast.walk(target):
                if isinstance(node, ast.Name):
                    self._bind(node.id, statement)

    def _bind(self, name: str, binding: Binding) -> None:
        known = self.bindings.setdefault(name, [])
        if binding not in known:
            known.append(binding)

    def definition(self, name: str) -> Definition:
        """All statements that bind a name."""
        if name not in self._definitions:
            nodes = tuple(b for b in self.bindings[name] if isinstance(b, ast.AST))
            self._definitions[name] = Definition(nodes, self.package)
        return self._definitions[name]

    @cached_property
    def whole(self) -> Definition:
        return Definition(tuple(self.statements), self.package)

    @cached_property
    def side_effects(self) -> Definition:
        return Definition(tuple(self.effects), self.package)


def _is_names(target: ast.expr) -> bool:
    if isinstance(target, ast.Tuple | ast.List):
        return all(map(_is_names, target.elts))
    return isinstance(target, ast.Name) or (isinstance(target, ast.Starred) and _is_names(target.value))


def _runs_as_script(test: ast.expr) -> bool:
    """`if __name__ == "__main__"`: never true in a module that a step imports."""
    return isinstance(test, ast.Compare) and isinstance(test.left, ast.Name) and test.left.id == "__name__"


class Modules:
    """The modules below some root packages, each parsed once until its file changes."""

    def __init__(self, roots: Mapping[str, Path]):
        self.roots = {name: Path(folder) for name, folder in roots.items()}
        self._parsed: dict[str, Module] = {}
        self._places: dict[str, tuple[Path, bool] | None] = {}

    def refresh(self) -> None:
        """Look at the files again: those that changed are parsed anew when next asked for."""
        self._places.clear()
        for name, module in list(self._parsed.items()):
            place = self._place(name)
            try:
                current = place is not None and place[0] == module.path and stamp(place[0]) == module.stamp
            except FileNotFoundError:
                current = False
            if not current:
                del self._parsed[name]

    def owns(self, name: str) -> bool:
        return name.split(".")[0] in self.roots

    def get(self, name: str) -> Module | None:
        """The module of this name, or None where no file has it; a folder alone is a module without code."""
        if name not in self._parsed:
            place = self._place(name)
            if place is None:
                return None
            self._parsed[name] = Module(name, *place)
        return self._parsed[name]

    def is_folder(self, name: str) -> bool:
        root, *parts = name.split(".")
        return root in self.roots and self.roots[root].joinpath(*parts).is_dir()

    def below(self, name: str) -> Iterator[str]:
        """Names of all modules in a package, at any depth."""
        root, *parts = name.split(".")
        folder = self.roots[root].joinpath(*parts)
        for place, folders, files in os.walk(folder, followlinks=True):
            folders.sort()
            inner = Path(place).relative_to(folder).parts
            for stem in sorted(file.removesuffix(".py") for file in files if file.endswith(".py")):
                yield ".".join([name, *inner, *([] if stem == "__init__" else [stem])])

    def _place(self, name: str) -> tuple[Path, bool] | None:
        if name not in self._places:
            root, *parts = name.split(".")
            self._places[name] = _file(self.roots[root].joinpath(*parts)) if root in self.roots else None
        return self._places[name]


def _file(stem: Path) -> tuple[Path, bool] | None:
    package = stem / "__init__.py"
    if package.is_file():
        return package, True
    module = stem.with_name(f"{stem.name}.py")
    return (module, False) if module.is_file() else None
