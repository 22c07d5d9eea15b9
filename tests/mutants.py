"""Fault injection for the test suite: how many small faults in the code `make test` finds.

    python tests/mutants.py [--seed N] [--count N] [--only K,K] [--depth STAGE] [--list]

A seed draws as many places from each package, each with one fault: a comparison turned, + for −, a constant
off by one, a condition negated, min for max, `and` for `or`, a return value dropped. Docstrings, type hints,
the texts of errors and whatever only a person reads are left out: no test should depend on them. Each fault
is put into a copy of the repository, and the tests run there that `make test` would run: first those at the
mirrored path, then those of the same folder, then those that import the module, then all, until one fails. A
test that fails without the fault as well does not count.
"""

import argparse
import ast
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("fastac", "models", "sensor", "gateware", "sim", "scenes")
DEPTHS = ("mirrored", "package", "importers", "all")
NEEDED = 0.9
TURNED = {
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
SWAPPED = {"min": "max", "max": "min", "any": "all", "all": "any", "minimum": "maximum", "maximum": "minimum"}
FOR_READERS = re.compile(
    r"^(help|desc|label|title|color|colour|figsize|dpi|linewidth|lw|alpha|fontsize|metavar|show_default|name|"
    r"progress|max_content_width|indent|loc|zorder|width_ratios|height_ratios|bbox_inches|layout|wspace|hspace)$"
)
"""Keywords whose values only a person looks at."""
FIGURES = re.compile(r"^(ax|axes|axis|figure|fig|plt|panel|plot|page|legend)$")
"""Variables of plots: how they look is nobody's bug."""


@dataclass(frozen=True)
class Fault:
    path: str
    line: int
    start: int
    end: int
    before: str
    after: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.before}  →  {self.after}"

    def apply(self, root: Path) -> None:
        path = root / self.path
        text = path.read_bytes()
        path.write_bytes(text[: self.start] + self.after.encode() + text[self.end :])


def faulty(node: ast.AST) -> Iterator[ast.AST]:
    """What may stand in a node's place."""
    match node:
        case ast.Compare(ops=[op]) if type(op) in TURNED:
            yield ast.Compare(node.left, [TURNED[type(op)]()], node.comparators)
        case ast.BinOp() if type(node.op) in TURNED and not any(map(_is_text, (node.left, node.right))):
            yield ast.BinOp(node.left, TURNED[type(node.op)](), node.right)
        case ast.BoolOp():
            yield ast.BoolOp(TURNED[type(node.op)](), node.values)
        case ast.Constant(value=int() as value) if not isinstance(value, bool):
            yield ast.Constant(value + 1)
        case ast.Call(func=ast.Name(id=name)) if name in SWAPPED:
            yield ast.Call(ast.Name(SWAPPED[name]), node.args, node.keywords)
        case ast.Call(func=ast.Attribute(attr=name, value=value)) if name in SWAPPED:
            yield ast.Call(ast.Attribute(value, SWAPPED[name]), node.args, node.keywords)
        case ast.Return(value=value) if value is not None and not isinstance(value, ast.Constant):
            yield ast.Return(ast.Constant(None))


def _is_text(node: ast.AST) -> bool:
    texts = (ast.JoinedStr, ast.List, ast.Tuple, ast.ListComp)
    return isinstance(node, texts) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


def _nodes(node: ast.AST) -> Iterator[ast.AST]:
    """A tree's nodes, without those that only a person reads."""
    match node:
        case ast.Raise() | ast.JoinedStr() | ast.Import() | ast.ImportFrom() | ast.Assert():
            return
        case ast.keyword(arg=str() as name) if FOR_READERS.match(name):
            return
        case ast.Expr(value=ast.Call(func=ast.Attribute(value=ast.Name(id=name)))) if FIGURES.match(name):
            return
        case ast.Call(func=ast.Attribute(attr="echo" | "subplots" | "savefig")):
            return
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _nodes(child)


def faults_of(path: str, text: str) -> list[Fault]:
    """Every fault that could be put into a source file."""
    starts = [0]
    for line in text.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def fault(node: ast.AST, after: str) -> Fault:
        start = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + node.end_col_offset
        before = text.encode()[start:end].decode()
        return Fault(path, node.lineno, start, end, " ".join(before.split()), after)

    found = []
    for node in _nodes(ast.parse(text)):
        for other in faulty(node):
            after = ast.unparse(ast.fix_missing_locations(other))
            found.append(fault(node, after if isinstance(other, ast.Return | ast.Constant) else f"({after})"))
        if isinstance(node, ast.If | ast.IfExp | ast.While) and not isinstance(node.test, ast.Constant):
            found.append(fault(node.test, f"(not ({ast.unparse(node.test)}))"))
    return found


def draw(seed: int, count: int) -> list[Fault]:
    """`count` faults, as many from each package."""
    rng, found = random.Random(seed), []
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    files = [name for name in tracked.stdout.split("\0") if name.endswith(".py")]
    for k, package in enumerate(PACKAGES):
        names = [name for name in files if name.startswith(f"{package}/")]
        faults = [fault for name in names for fault in faults_of(name, (ROOT / name).read_text())]
        found += rng.sample(faults, count * (k + 1) // len(PACKAGES) - count * k // len(PACKAGES))
    return found


def copy_of_repository(folder: Path) -> Path:
    """The tracked files, links as links, with the simulators and compiled runtime that are there."""
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in filter(None, tracked.stdout.split("\0")):
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, target, follow_symlinks=False)
    for cached in ("simulators", "verilator"):
        source = ROOT / "build" / "cache" / cached
        if source.is_dir():
            shutil.copytree(source, folder / "build" / "cache" / cached, copy_function=os.link)
    return folder


def test_folders(path: str) -> list[tuple[str, list[str]]]:
    """Which tests to run, the likeliest first: how far they are from the module, and their paths."""
    module = Path(path)
    mirrored = Path("tests") / module.with_name(f"test_{module.name}")
    name = ".".join(module.with_suffix("").parts)
    name = name if name.startswith("fastac.") else f"fastac.{name}"
    parent, _, stem = name.rpartition(".")
    uses = re.compile(rf"{re.escape(name)}\b|from {re.escape(parent)} import .*\b{stem}\b")
    tests = [p for p in sorted((ROOT / "tests").rglob("test_*.py")) if uses.search(p.read_text())]
    return [
        ("mirrored", [str(mirrored)] if (ROOT / mirrored).exists() else []),
        ("package", [str(mirrored.parent)] if (ROOT / mirrored.parent).is_dir() else []),
        ("importers", [str(p.relative_to(ROOT)) for p in tests]),
        ("all", ["tests"]),
    ]


def failing(root: Path, arguments: list[str]) -> list[str]:
    """The tests that fail in a copy of the repository, at least the first; ["…"] where none could start."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-m", "not full", "-p", "no:cacheprovider"]
    many = any((root / argument).is_dir() for argument in arguments)
    workers = ["-n", "auto", "--dist", "worksteal"] if many else []
    environment = os.environ | {"PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1"}
    ran = subprocess.run(
        [*command, *workers, *arguments], cwd=root, env=environment, capture_output=True, text=True
    )
    if ran.returncode in (0, 5):
        return []
    return re.findall(r"^(?:FAILED|ERROR) (.*?)(?: - .*)?$", ran.stdout, re.MULTILINE) or ["…"]


@cache
def sound(clean: Path, test: str) -> bool:
    """Whether a test passes without any fault."""
    return test == "…" or not failing(clean, [test])


def who_finds(fault: Fault, clean: Path, depth: str) -> tuple[str, str] | None:
    """How far from the fault the first test is that finds it, and its name; None if none does."""
    with tempfile.TemporaryDirectory(prefix="mutant-", ignore_cleanup_errors=True) as folder:
        root = copy_of_repository(Path(folder))
        fault.apply(root)
        for stage, tests in test_folders(fault.path)[: DEPTHS.index(depth) + 1]:
            unsound = []
            while tests:
                failed = failing(root, [*tests, *(f"--deselect={test}" for test in unsound)])
                finder = next((test for test in failed if sound(clean, test)), None)
                if finder:
                    return stage, finder
                if not failed:
                    break
                unsound += failed
    return None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=17)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument(
        "--only", type=lambda text: {int(k) for k in text.split(",")}, help="some of them: 0,7"
    )
    parser.add_argument("--depth", choices=DEPTHS, default="all", help="how far to look for a test")
    parser.add_argument("--list", action="store_true", help="print the faults and run nothing")
    options = parser.parse_args()
    faults = [
        (k, fault)
        for k, fault in enumerate(draw(options.seed, options.count))
        if options.only is None or k in options.only
    ]
    found = 0
    with tempfile.TemporaryDirectory(prefix="clean-", ignore_cleanup_errors=True) as folder:
        clean = copy_of_repository(Path(folder)) if not options.list else Path(folder)
        for k, fault in faults:
            print(f"{k:2d}  {fault}", flush=True)
            if options.list:
                continue
            finder = who_finds(fault, clean, options.depth)
            found += finder is not None
            print(f"    found ({finder[0]}): {finder[1]}" if finder else "    NOT FOUND", flush=True)
    if options.list:
        return 0
    print(f"{found} of {len(faults)} faults found, seed {options.seed}")
    return int(found < NEEDED * len(faults))


if __name__ == "__main__":
    sys.exit(main())
