import json
import os

import pytest
from toy_steps import slopes

from fastac.store.steps import Step, StepError


def test_an_exception_leaves_nothing(toy):
    toy.write(
        "failing.py", "def fail(folder):\n    (folder / 'a').write_text('')\n    raise OSError('full')\n"
    )
    with pytest.raises(OSError, match="full"):
        toy.store().perform(Step("fail", toy.module("failing").fail, {}, ("a",)))
    assert not list(toy.kept.rglob("a"))
    assert not list((toy.kept / ".part").iterdir())


def test_a_missing_output_is_an_error(toy):
    with pytest.raises(StepError, match=r"wrote no other\.txt"):
        toy.store().perform(Step("bench", toy.function("bench"), {}, ("other.txt",)))


@pytest.mark.parametrize("harm", ["truncate", "remove", "same size"])
def test_a_damaged_output_is_redone(toy, harm):
    path = toy.store().perform(slopes(toy)).path("slopes.txt")
    path.chmod(0o644)
    if harm == "remove":
        path.unlink()
    else:
        path.write_text("" if harm == "truncate" else "20")
    assert "output slopes.txt" in toy.store().why(slopes(toy))
    entry = toy.store().perform(slopes(toy))
    assert entry.path("slopes.txt").read_text() == "19"
    assert len(list((toy.kept / "slopes").iterdir())) == 1


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("outputs",), {}),
        (("outputs",), 3),
        (("outputs", "slopes.txt", "files"), {"../../secret": [2, 3, "x"]}),
        (("outputs", "slopes.txt", "files"), {".": []}),
        (("tables",), None),
        (("codes",), [1]),
        (("reads", "scene"), "x"),
        (("inner",), {"../../elsewhere": {}}),
        (("seconds",), "long"),
    ],
)
def test_a_damaged_trace_says_nothing(toy, keys, value):
    trace = toy.store().perform(slopes(toy)).folder / "step.json"
    content = json.loads(trace.read_text())
    place = content
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    trace.write_text(json.dumps(content))
    entry = toy.store().perform(slopes(toy))
    assert entry.path("slopes.txt").read_text() == "19"
    assert entry.trace["seconds"] >= 0
    assert toy.store().is_current(slopes(toy))


@pytest.mark.parametrize("text", ["[" * 100_000, "9" * 5000, "null"])
def test_a_trace_that_cannot_be_read(toy, text):
    trace = toy.store().perform(slopes(toy)).folder / "step.json"
    trace.write_text(text)
    assert toy.store().perform(slopes(toy)).path("slopes.txt").read_text() == "19"


def test_a_trace_elsewhere_is_not_followed(toy, tmp_path):
    trace = toy.store().perform(slopes(toy)).folder / "step.json"
    trace.rename(tmp_path / "step.json")
    trace.symlink_to(tmp_path / "step.json")
    assert not toy.store().is_current(slopes(toy))
    assert toy.store().perform(slopes(toy)).path("slopes.txt").read_text() == "19"


def test_verify_finds_what_sizes_and_times_hide(toy):
    path = toy.store().perform(slopes(toy)).path("slopes.txt")
    status = path.stat()
    path.chmod(0o644)
    path.write_text("20")
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert toy.store().is_current(slopes(toy))
    assert len(toy.store().verify()) == 1
    assert toy.store().perform(slopes(toy)).path("slopes.txt").read_text() == "19"
    assert toy.store().verify() == []


def test_an_edit_of_a_placed_file(toy, tmp_path):
    build = tmp_path / "build"
    build.mkdir()
    (build / "slopes.txt").write_text("the user's own")
    placed = toy.store().perform(slopes(toy)).place(build)["slopes.txt"]
    assert placed.read_text() == "19"
    toy.store().perform(slopes(toy)).place(build)
    assert [p.name for p in build.iterdir()] == ["slopes.txt"]
    placed.chmod(0o644)
    placed.write_text("77")
    entry = toy.store().perform(slopes(toy))
    assert entry.path("slopes.txt").read_text() == "19"
    entry.place(build)
    assert placed.read_text() == "19"
