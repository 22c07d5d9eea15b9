"""Damaged records of steps: what they say is not believed, and the step is performed again."""

import json
import tempfile
from functools import cache
from pathlib import Path

import fuzzing
import pytest
from fuzzing import Case, Link, Reader
from hypothesis import strategies as st
from mutations import changed_bytes, texts

from fastac.store.record import RECORD, read_record
from fastac.store.steps import Step
from fastac.store.store import Store

FRAGMENTS = (b"[" * 100_000, b'{"a":' * 3000, b"9" * 5000, b"NaN", b"\xff", b"null", b",", b"../../../../etc")


def step() -> Step:
    """A step whose value is known: there is no record in an empty folder."""
    return Step("record", read_record, {}, ())


@cache
def sample() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        Store(Path(folder)).perform(step())
        files = [path for path in Path(folder).glob("record/**/*") if path.is_file()]
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@st.composite
def stores(draw) -> Case:
    """A store with one entry, whose trace or value is damaged, missing, or a link."""
    files: dict = dict(sample())
    name = draw(st.sampled_from(tuple(files)))
    match draw(st.integers(0, 5)):
        case 0:
            files[name] = draw(st.sampled_from((Link("/etc/hostname"), Link("nowhere"), Link("."))))
        case 1:
            del files[name]
        case _ if name.endswith("step.json"):
            content = files[name]
            files[name] = draw(texts([json.loads(content)], json.dumps, [content], FRAGMENTS))
        case _:
            files[name] = draw(changed_bytes([files[name]], FRAGMENTS))
    return {f"store/{key}": content for key, content in files.items()}


@cache
def code():
    return Store(Path()).code


def perform(folder: Path) -> None:
    """The step's value, whatever the store holds; raises what is no error of a file."""
    store = Store(folder / "store", code())
    store.why(step())
    found = store.value(step())
    if found != {}:
        raise AssertionError(f"the step's value is {found!r}")
    store.verify()
    if store.value(step()) != {}:
        raise AssertionError("the step has another value after a check of the store")


def read_build(folder: Path) -> None:
    if not isinstance(read_record(folder), dict):
        raise AssertionError("a record that is none")


RECORDS = changed_bytes([b'{"data": {"entry": "data/a-b", "seconds": 1.5}}'], FRAGMENTS)
READERS = [
    Reader("store of steps", stores(), perform, count=10_000, quick=20),
    Reader("record of a build", RECORDS.map(lambda content: {RECORD: content}), read_build),
]


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_bad_files(reader, tmp_path):
    fuzzing.quick(reader, tmp_path)
