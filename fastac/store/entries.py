"""Entries of the store: a folder with a step's outputs and its trace."""

import json
import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated, NotRequired

from pydantic import AfterValidator, TypeAdapter
from typing_extensions import TypedDict

from fastac.store.digest import path_digest
from fastac.store.files import digest_file
from fastac.store.steps import VALUE, Step, StepError

TRACE = "step.json"


def _relative(name: str) -> str:
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\0" in name:
        raise ValueError("not the name of something in the store")
    return name


Name = Annotated[str, AfterValidator(_relative)]
Digests = dict[str, str]


class _Output(TypedDict):
    digest: str
    folder: bool
    files: dict[Name, tuple[int, int, str]]


class _Table(TypedDict):
    entries: Digests
    names: NotRequired[list[str]]


class _Trace(TypedDict):
    """What `traces.make` writes, as far as it is used."""

    format: int
    step: str
    function: str
    arguments: dict[str, object]
    reads: dict[str, dict[str, object]]
    tables: dict[str, _Table]
    paths: dict[str, str | None]
    inner: dict[Name, Digests]
    outputs: dict[Name, _Output]
    seconds: float
    performed: str
    codes: Digests
    libraries: Digests
    symbols: Digests


_TRACE = TypeAdapter(_Trace)


@dataclass(frozen=True)
class Entry:
    """The result of one step: outputs that nobody may change."""

    folder: Path
    trace: Mapping

    @property
    def id(self) -> str:
        return f"{self.folder.parent.name}/{self.folder.name}"

    @property
    def seconds(self) -> float:
        """How long the step took when it was performed."""
        return self.trace["seconds"]

    @property
    def digests(self) -> dict[str, str]:
        return {name: output["digest"] for name, output in self.trace["outputs"].items()}

    def path(self, name: str) -> Path:
        if name not in self.trace["outputs"]:
            raise StepError(f"step {self.trace['step']}: no output {name!r}")
        return self.folder / name

    def digest(self, name: str) -> str:
        self.path(name)
        return self.digests[name]

    @property
    def value(self) -> object:
        """The result of a step without files."""
        return json.loads(self.path(VALUE).read_text(encoding="utf-8"))

    def damage(self) -> str | None:
        """What is wrong with the outputs, by their files' sizes and times, or None."""
        for name, output in self.trace["outputs"].items():
            path = self.folder / name
            if output["folder"] and sorted(_inside(path)) != sorted(output["files"]):
                return f"output {name} has other files"
            for file, (size, modified, _) in output["files"].items():
                try:
                    status = os.stat(path / file)
                except OSError:
                    return f"output {name} is missing"
                if (status.st_size, status.st_mtime_ns) != (size, modified):
                    return f"output {name} was changed"
        return None

    def verify(self) -> str | None:
        """Like `damage`, by the files' contents as well."""
        for name, output in self.trace["outputs"].items():
            for file, (_, _, digest) in output["files"].items():
                path = self.folder / name / file
                if path.is_file() and digest_file(path) != digest:
                    return f"output {name} was changed"
        return self.damage()

    def place(self, folder: Path) -> dict[str, Path]:
        """Put the outputs into a folder of the user's: hard links, or copies where there can be none.

        A file is replaced at once; a folder by two renamings. Linked files are read-only, and one that is
        written to nevertheless makes the entry invalid, so that the step is performed again.
        """
        folder.mkdir(parents=True, exist_ok=True)
        placed = {}
        for name, output in self.trace["outputs"].items():
            source, target = self.path(name), folder / name
            new = folder / f".{name}.{secrets.token_hex(4)}.part"
            try:
                if output["folder"]:
                    new.mkdir()
                for file in output["files"]:
                    (new / file).parent.mkdir(parents=True, exist_ok=True)
                    _link(source / file, new / file)
                _replace(new, target)
            finally:
                _remove(new)
            placed[name] = target
        return placed


def _link(source: Path, target: Path) -> None:
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)
        target.chmod(0o644)


def _replace(new: Path, target: Path) -> None:
    """Put `new` where `target` may be, whatever that is."""
    if not new.is_dir() and not (target.is_dir() and not target.is_symlink()):
        # Renaming one link of a file onto another does nothing; the caller removes the first.
        os.replace(new, target)
        return
    old = new.with_name(f"{new.name}.old")
    if target.is_symlink() or target.exists():
        os.replace(target, old)
    os.replace(new, target)
    _remove(old)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _inside(folder: Path) -> Iterator[str]:
    return (p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def seal(folder: Path, step: Step) -> dict[str, dict]:
    """Make a step's outputs read-only, drop all else, and say what there is: digests, sizes, times."""
    sealed = {}
    for name in step.written:
        path = folder / name
        if not path.exists():
            raise StepError(f"step {step.name}: its function wrote no {name}")
        links = [p for p in (path, *path.rglob("*")) if p.is_symlink()]
        if links:
            raise StepError(f"step {step.name}: output {links[0].relative_to(folder)} is a symbolic link")
        files = {}
        for file in sorted(_inside(path)) if path.is_dir() else ["."]:
            (path / file).chmod(0o444)
            status = os.stat(path / file)
            files[file] = [status.st_size, status.st_mtime_ns, path_digest(path / file)]
        sealed[name] = {"digest": path_digest(path), "folder": path.is_dir(), "files": files}
    for path in folder.iterdir():
        if path.name not in sealed:
            _remove(path)
    return sealed


def read(folder: Path) -> Entry | None:
    """The entry in a folder, or None for what is none: a damaged trace says nothing."""
    trace = folder / TRACE
    if trace.is_symlink():
        return None
    try:
        found = json.loads(trace.read_text(encoding="utf-8"))
        _TRACE.validate_python(found)
    except (OSError, ValueError, RecursionError):
        return None
    return Entry(folder, found)
