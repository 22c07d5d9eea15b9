"""Traces: what a step was given and what it read, so that a later lookup can tell what changed since."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from fastac.store import entries
from fastac.store.closure import Closure, Code, CodeError
from fastac.store.digest import encoded, path_digest
from fastac.store.files import content_hash
from fastac.store.recording import Recording, recordings
from fastac.store.steps import Output, Settings, Step, is_settings, leaves, normalised

FORMAT = 1


@dataclass
class Inputs:
    """A step's arguments, taken apart: what counts, and what the function is given, by place."""

    step: Step
    arguments: dict[str, object] = field(default_factory=dict)
    given: dict[str, object] = field(default_factory=dict)
    settings: dict[str, Settings] = field(default_factory=dict)
    paths: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, step: Step, upstream: Mapping[Step, entries.Entry]) -> "Inputs":
        """Raises StepError for an argument that cannot be compared, FileNotFoundError for a missing path."""
        inputs = cls(step)
        for argument, value in step.arguments.items():
            for place, leaf in leaves(value, argument):
                inputs._add(place, leaf, upstream)
        return inputs

    def _add(self, place: str, leaf: object, upstream: Mapping[Step, entries.Entry]) -> None:
        if isinstance(leaf, Output):
            entry = upstream[leaf.step]
            self.arguments[place] = {"content": entry.digest(leaf.name)}
            leaf = entry.path(leaf.name)
        elif isinstance(leaf, Path):
            digest = path_digest(leaf)
            self.arguments[place] = {"content": digest}
            self.paths[str(leaf.absolute())] = digest
        elif is_settings(leaf):
            self.settings[place] = leaf
            schema = type(leaf.unwatched())
            self.arguments[place] = {"settings": f"{schema.__module__}:{schema.__qualname__}"}
        else:
            leaf = normalised(leaf, self.step.name, place)
            self.arguments[place] = encoded(leaf)
        self.given[place] = leaf

    @property
    def bucket(self) -> str:
        """What entries that differ in no plain argument and no file have in common."""
        return content_hash(self.step.name, self.step.code, list(self.step.written), self.arguments)[:16]

    @property
    def run(self) -> str:
        """The bucket and all settings: runs of which one is enough. Such a name locks the run."""
        whole = {place: settings.unwatched().model_dump_json() for place, settings in self.settings.items()}
        return self.bucket + content_hash(whole)[:8]

    def include(self, entry: entries.Entry) -> None:
        """Tell the steps around this one what it depends on, as if they had read it themselves."""
        for recording in recordings():
            with recording.lock:
                recording.codes.update(entry.trace["codes"])
                for table, found in entry.trace["tables"].items():
                    recording.entries.setdefault(table, set()).update(found["entries"])
                    if "names" in found:
                        recording.names[table] = found["names"]
                recording.paths.update({**self.paths, **entry.trace["paths"]})
                recording.inner.update({**entry.trace["inner"], entry.id: entry.digests})
        # Settings that are watched for a step around this one tell it here what this one has read.
        for place, reads in entry.trace["reads"].items():
            for path in reads:
                self.settings[place].value_at(path)


def make(inputs: Inputs, recording: Recording, code: Code, outputs: dict, seconds: float) -> dict:
    """The trace of a run. Raises EditedError if the code that ran is not the code that is there."""
    starts = {start: code.loaded(start) for start in (inputs.step.code, *sorted(recording.codes))}
    tables: dict[str, dict] = {}
    chosen: list[Closure] = []
    for table in sorted({*recording.entries, *recording.names}):
        found = {name: code.loaded(f"{table}[{name}]") for name in sorted(recording.entries.get(table, ()))}
        tables[table] = {"entries": {name: closure.digest for name, closure in found.items()}}
        if table in recording.names:
            tables[table]["names"] = code.names(table)
        chosen += found.values()
    symbols, libraries = _union((*starts.values(), *chosen))
    return {
        "format": FORMAT,
        "step": inputs.step.name,
        "function": inputs.step.code,
        "arguments": inputs.arguments,
        "reads": recording.reads,
        "tables": tables,
        "paths": recording.paths,
        "inner": recording.inner,
        "outputs": outputs,
        "seconds": seconds,
        "performed": datetime.now(UTC).isoformat(timespec="seconds"),
        "codes": {start: closure.digest for start, closure in starts.items()},
        "libraries": libraries,
        "symbols": symbols,
    }


def _union(closures: tuple[Closure, ...]) -> tuple[dict[str, str], dict[str, str]]:
    symbols = {name: digest for closure in closures for name, digest in closure.symbols.items()}
    libraries = {name: version for closure in closures for name, version in closure.libraries.items()}
    return dict(sorted(symbols.items())), dict(sorted(libraries.items()))


def differences(entry: entries.Entry, inputs: Inputs, code: Code, root: Path) -> Iterator[str]:
    """What changed since an entry of the same bucket was performed, a line each; nothing if it is current."""
    trace = entry.trace
    if trace.get("format") != FORMAT:
        yield "the store's format changed"
        return
    if set(trace["outputs"]) != set(inputs.step.written):
        yield "its outputs are others"
        return
    yield from _settings_changed(trace, inputs)
    yield from _code_changed(trace, code)
    yield from _inside_changed(trace, root)
    damage = entry.damage()
    if damage:
        yield damage


def _settings_changed(trace: Mapping, inputs: Inputs) -> Iterator[str]:
    for place, reads in trace["reads"].items():
        settings = inputs.settings[place].unwatched()
        for path, before in reads.items():
            try:
                now = encoded(settings.value_at(path))
            except Exception as error:  # a rule may raise anything for settings it does not fit
                now = {"missing": type(error).__name__}
            if json.dumps(now) != json.dumps(before) and not _same(settings, path, before):
                yield f"{place} {path} = {_shown(now)} was {_shown(before)}"


def _same(settings: Settings, path: str, before: object) -> bool:
    """Whether a new key at its default is all that changed: old results are read as if it had been there."""
    try:
        return settings.means_the_same(path, before)
    except Exception:  # a rule may raise anything for settings it does not fit
        return False


def _code_changed(trace: Mapping, code: Code) -> Iterator[str]:
    starts = dict(trace["codes"])
    for table, found in trace["tables"].items():
        starts |= {f"{table}[{name}]": digest for name, digest in found["entries"].items()}
        names = code.names(table)
        if "names" in found and names != found["names"]:
            yield f"kinds of {table.partition(':')[2]} = {_shown(names)} was {_shown(found['names'])}"
    now, missing = [], False
    for start, digest in starts.items():
        try:
            closure = code.closure(start)
        except CodeError as error:
            yield str(error)
            missing = True
            continue
        now.append(closure)
        missing = missing or closure.digest != digest
    if not missing:
        return
    symbols, libraries = _union(tuple(now))
    for name in sorted({*libraries, *trace["libraries"]}):
        version, before = libraries.get(name, "none"), trace["libraries"].get(name, "none")
        if version != before:
            yield f"library {name} {version} was {before}"
    for name in sorted({*symbols, *trace["symbols"]}):
        if symbols.get(name) != trace["symbols"].get(name):
            what = "changed" if name in symbols and name in trace["symbols"] else "is no longer used"
            what = "is newly used" if name not in trace["symbols"] else what
            yield f"{name} {what}" if name.startswith("file ") else f"code {name} {what}"
    yield "code changed"


def _inside_changed(trace: Mapping, root: Path) -> Iterator[str]:
    """Of the steps that were performed inside this one."""
    for path, before in trace["paths"].items():
        try:
            now = path_digest(Path(path))
        except FileNotFoundError:
            now = None
        if now != before:
            yield f"file {path} changed"
    for name, digests in trace["inner"].items():
        inner = entries.read(root / name)
        if inner is None or inner.digests != digests or inner.damage():
            yield f"the result of inner step {name.partition('/')[0]} is no longer there"


def arguments_changed(trace: Mapping, inputs: Inputs) -> Iterator[str]:
    """How the arguments differ from those of an entry of another bucket."""
    for place in (*inputs.arguments, *trace["arguments"].keys() - inputs.arguments.keys()):
        now, before = inputs.arguments.get(place), trace["arguments"].get(place)
        if json.dumps(now) != json.dumps(before):
            has_content = isinstance(now, dict) and "content" in now
            value = "has other content" if has_content else f"= {_shown(now)} was {_shown(before)}"
            yield f"{place} {value}"
    yield "other outputs"


def _shown(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)
