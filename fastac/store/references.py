"""What one statement of a module refers to: names with their attributes, and strings that may name files."""

import ast
import re
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import IntEnum

CACHES = frozenset({"cache", "lru_cache", "cached_property"})
"""Decorators after which a function's body need not run in the step that calls it."""
_DOTTED = re.compile(r"\w+\.[\w.]*")
_NAMES_SOMETHING = re.compile(r"[\w./:-]{3,200}")
_parsing = threading.Lock()


def parsed(source: str | bytes, mode: str = "exec") -> ast.AST:
    """`ast.parse`, by one thread at a time: Python 3.11 counts the depths of all threads' trees together, and
    now and then raises SystemError where two are made at once (CPython issue 106905)."""
    with _parsing:
        return ast.parse(source, mode=mode)


class Use(IntEnum):
    """When a reference is followed; a higher one includes all that a lower one does."""

    ANNOTATION = 0
    LATER = 1  # in a function's body: when the step calls it
    IMPORT = 2  # at import, before any step begins
    CALL = 3  # at import, or once for many steps, within a call: all that it reaches may run then too


@dataclass(frozen=True)
class Import:
    """What an import binds a name to: a module, or an attribute of it."""

    module: str
    attribute: str | None = None

    def __str__(self) -> str:
        return self.module if self.attribute is None else f"{self.module}.{self.attribute}"


@dataclass(frozen=True)
class Reference:
    """A name and the attributes taken from it."""

    chain: tuple[str, ...]
    use: Use
    bound: Import | None = None
    """By an import inside the function, instead of at the module's top."""


@dataclass
class Found:
    """All that some statements refer to."""

    references: set[Reference] = field(default_factory=set)
    strings: set[str] = field(default_factory=set)
    prefixes: set[str] = field(default_factory=set)
    """Beginnings of strings that are put together at run time."""
    imports: set[Import] = field(default_factory=set)
    """Bound inside functions."""


def imports(statement: ast.Import | ast.ImportFrom, package: str) -> Iterator[tuple[str, Import]]:
    """Each name that an import binds; `*` for all of a module's. Relative ones start from `package`."""
    if isinstance(statement, ast.Import):
        for alias in statement.names:
            top = alias.name.split(".")[0]
            yield (alias.asname, Import(alias.name)) if alias.asname else (top, Import(top))
        return
    base = statement.module or ""
    if statement.level:
        parents = package.split(".")
        kept = parents[: len(parents) - statement.level + 1]
        base = ".".join([*kept, base] if base else kept)
    for alias in statement.names:
        yield alias.asname or alias.name, Import(base, alias.name)


def find(nodes: Iterable[ast.AST], package: str) -> Found:
    visitor = _Visitor(package)
    for node in nodes:
        visitor.visit(node)
    return visitor.found


class _Visitor(ast.NodeVisitor):
    def __init__(self, package: str):
        self.package = package
        self.found = Found()
        self.scopes: list[dict[str, Import | None]] = []
        self.use = Use.IMPORT

    def visit_as(self, use: Use, nodes: Iterable[ast.AST | None]) -> None:
        before, self.use = self.use, use
        for node in nodes:
            if node is not None:
                self.visit(node)
        self.use = before

    def executed(self) -> Use:
        """The use of what a call, a decorator or a subscript reaches."""
        return Use.CALL if self.use == Use.IMPORT else self.use

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        self.visit_as(self.executed(), node.decorator_list)
        self.arguments(node.args)
        self.annotation(node.returns)
        cached = any(_last_name(decorator) in CACHES for decorator in node.decorator_list)
        later = Use.CALL if cached or self.use == Use.CALL else Use.LATER
        self.scope(later, node.body, dict(_bound(node.args, node.body, self.package)))

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_Lambda(self, node: ast.Lambda) -> None:
        self.arguments(node.args)
        later = Use.CALL if self.use == Use.CALL else Use.LATER
        self.scope(later, [node.body], dict(_bound(node.args, [], self.package)))

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self.visit_as(self.executed(), node.decorator_list)
        for part in (*node.bases, *node.keywords, *node.body):
            self.visit(part)

    def scope(self, use: Use, nodes: Iterable[ast.AST], names: dict[str, Import | None]) -> None:
        self.scopes.append(names)
        self.visit_as(use, nodes)
        self.scopes.pop()

    def arguments(self, arguments: ast.arguments) -> None:
        for default in (*arguments.defaults, *arguments.kw_defaults):
            if default is not None:
                self.visit(default)
        for argument in _each_argument(arguments):
            self.annotation(argument.annotation)

    def annotation(self, node: ast.expr | None) -> None:
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            try:
                node = parsed(node.value, mode="eval").body
            except SyntaxError:
                return
        self.visit_as(Use.ANNOTATION, [node])

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        self.annotation(node.annotation)
        for part in (node.target, node.value):
            if part is not None:
                self.visit(part)

    def comprehension(self, node: ast.expr, *results: ast.expr) -> None:
        first, *others = node.generators
        self.visit(first.iter)
        parts = [*results, *(part for other in others for part in (other.iter, *other.ifs)), *first.ifs]
        targets = [name for generator in node.generators for name in ast.walk(generator.target)]
        names = {name.id: None for name in targets if isinstance(name, ast.Name)}
        self.scope(self.use, parts, names)

    def visit_ListComp(self, node: ast.ListComp | ast.SetComp | ast.GeneratorExp) -> None:
        self.comprehension(node, node.elt)

    visit_SetComp = visit_GeneratorExp = visit_ListComp

    def visit_DictComp(self, node: ast.DictComp) -> None:
        self.comprehension(node, node.key, node.value)

    def visit_Import(self, node: ast.Import | ast.ImportFrom) -> None:
        self.found.imports.update(bound for _, bound in imports(node, self.package))
        if isinstance(node, ast.Import):
            self.found.imports.update(Import(alias.name) for alias in node.names)

    visit_ImportFrom = visit_Import

    def visit_Name(self, node: ast.Name) -> None:
        if isinstance(node.ctx, ast.Load):
            self.refer((node.id,))

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        if isinstance(node.target, ast.Name):
            self.refer((node.target.id,))
        self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        chain, base = [node.attr], node.value
        while isinstance(base, ast.Attribute):
            chain.append(base.attr)
            base = base.value
        if isinstance(base, ast.Name):
            self.refer((base.id, *reversed(chain)))
        else:
            self.visit(base)

    def refer(self, chain: tuple[str, ...]) -> None:
        for scope in reversed(self.scopes):
            if chain[0] in scope:
                if scope[chain[0]] is not None:
                    self.found.references.add(Reference(chain, self.use, scope[chain[0]]))
                return
        self.found.references.add(Reference(chain, self.use))

    def visit_Call(self, node: ast.Call) -> None:
        use = self.executed()
        if isinstance(node.func, ast.Name) and node.func.id in ("isinstance", "issubclass"):
            # Asking for a class runs none of its code.
            self.visit_as(use, node.args[:1])
            self.visit_as(Use.ANNOTATION, node.args[1:])
            return
        self.visit_as(use, [node.func, *node.args, *node.keywords])
        self.joined(node.args)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self.visit_as(self.executed(), [node.value, node.slice])

    def visit_BinOp(self, node: ast.BinOp) -> None:
        self.generic_visit(node)
        parts: list[ast.expr] = []
        left: ast.expr = node
        while isinstance(left, ast.BinOp) and isinstance(left.op, ast.Div):
            parts.insert(0, left.right)
            left = left.left
        self.joined(parts)

    def joined(self, parts: list[ast.expr]) -> None:
        """The path that the last constants of a join of paths make."""
        names: list[str] = []
        for part in reversed(parts):
            if not (isinstance(part, ast.Constant) and isinstance(part.value, str)):
                break
            names.insert(0, part.value)
        if len(names) > 1:
            self.string("/".join(names))

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, str):
            self.string(node.value)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        self.generic_visit(node)
        first = node.values[0] if node.values else None
        if isinstance(first, ast.Constant) and _DOTTED.fullmatch(first.value):
            self.found.prefixes.add(first.value)

    def string(self, text: str) -> None:
        if _NAMES_SOMETHING.fullmatch(text):
            self.found.strings.add(text)


def _last_name(decorator: ast.expr) -> str:
    if isinstance(decorator, ast.Call):
        decorator = decorator.func
    return getattr(decorator, "attr", getattr(decorator, "id", ""))


def _each_argument(arguments: ast.arguments) -> Iterator[ast.arg]:
    yield from (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
    yield from (argument for argument in (arguments.vararg, arguments.kwarg) if argument)


def _bound(
    arguments: ast.arguments, body: list[ast.stmt], package: str
) -> Iterator[tuple[str, Import | None]]:
    """The names that are local to a function, with the import that binds them, if one does."""
    found: list[tuple[str, Import | None]] = [(a.arg, None) for a in _each_argument(arguments)]
    elsewhere: set[str] = set()
    nodes: list[ast.AST] = list(body)
    while nodes:
        node = nodes.pop()
        match node:
            case ast.Global() | ast.Nonlocal():
                elsewhere.update(node.names)
            case ast.Import() | ast.ImportFrom():
                found += imports(node, package)
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                found.append((node.name, None))
                continue
            case ast.Lambda():
                continue
            case ast.ListComp() | ast.SetComp() | ast.DictComp() | ast.GeneratorExp():
                found += ((n.target.id, None) for n in ast.walk(node) if isinstance(n, ast.NamedExpr))
                continue
            case ast.Name(ctx=ast.Store() | ast.Del()):
                found.append((node.id, None))
            case ast.ExceptHandler(name=str()) | ast.MatchAs(name=str()) | ast.MatchStar(name=str()):
                found.append((node.name, None))
            case ast.MatchMapping(rest=str()):
                found.append((node.rest, None))
        nodes.extend(ast.iter_child_nodes(node))
    # An import wins over a plain binding of the same name: then both meanings are possible.
    found.sort(key=lambda item: item[1] is not None)
    return ((name, bound) for name, bound in found if name not in elsewhere)
