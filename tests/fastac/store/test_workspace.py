import json
import os
import time

import pytest

from fastac.store import sources as store_sources
from fastac.store.files import content_hash, digest_file, read_or_make, write_json
from fastac.store.sources import digest_sources
from fastac.store.workspace import Step, Workspace


class Bench:
    """Two steps, the second of which reads what the first wrote, and a log of what ran."""

    def __init__(self, folder):
        self.folder = folder
        self.ran, self.settings = [], {"first": 1, "second": 1}

    def write(self, name, *outputs):
        self.ran.append(name)
        for output in outputs:
            (self.folder / output).parent.mkdir(parents=True, exist_ok=True)
            (self.folder / output).write_text(name)

    def steps(self):
        return [
            Step(
                "first",
                lambda: self.write("first", "a.txt"),
                self.settings["first"],
                ("one/*.py",),
                ("a.txt",),
            ),
            Step(
                "second",
                lambda: self.write("second", "b/c.txt", "b/d/e.txt"),
                self.settings["second"],
                ("two/*.py",),
                ("b",),
                ("first",),
            ),
        ]

    def run(self) -> list[str]:
        """What ran; checks that exactly this was announced as running."""
        self.ran, announced = [], []
        place = Workspace(self.folder)
        for step in self.steps():
            place.perform(step, lambda name, current: announced.append((name, current)))
        assert announced == [(s.name, s.name not in self.ran) for s in self.steps()]
        return self.ran


@pytest.fixture
def bench(tmp_path, monkeypatch):
    for folder in ("one", "two"):
        (tmp_path / "project" / folder).mkdir(parents=True)
        (tmp_path / "project" / folder / "x.py").write_text("pass")
    monkeypatch.setattr(store_sources, "ROOT", tmp_path / "project")
    made = Bench(tmp_path / "build")
    made.folder.mkdir()
    assert made.run() == ["first", "second"]
    return made


def test_a_second_run_finds_everything_up_to_date(bench):
    assert bench.run() == []


def test_a_changed_setting_reruns_its_step_and_what_follows(bench):
    bench.settings["second"] = {"depth": [2]}
    assert bench.run() == ["second"]
    bench.settings["first"] = 2
    assert bench.run() == ["first", "second"]
    assert bench.run() == []


def test_a_changed_source_reruns_its_step_and_what_follows(bench, tmp_path):
    (tmp_path / "project" / "two" / "x.py").write_text("pass  # changed")
    assert bench.run() == ["second"]
    (tmp_path / "project" / "one" / "new.py").write_text("")
    assert bench.run() == ["first", "second"]
    (tmp_path / "project" / "one" / "new.py").rename(tmp_path / "project" / "one" / "renamed.py")
    assert bench.run() == ["first", "second"]
    (tmp_path / "project" / "one" / "notes.txt").write_text("not a source")
    assert bench.run() == []


@pytest.mark.parametrize(
    ("damage", "rerun"),
    [
        (lambda folder: (folder / "a.txt").unlink(), "first"),
        (lambda folder: (folder / "a.txt").write_text("longer than it was"), "first"),
        (lambda folder: os.utime(folder / "a.txt", (1, 1)), "first"),
        (lambda folder: (folder / "b/c.txt").unlink(), "second"),
        (lambda folder: (folder / "b/d/e.txt").write_text("2"), "second"),
        (lambda folder: (folder / "b/new.txt").touch(), "second"),
        (lambda folder: (folder / ".stamps/second.json").unlink(), "second"),
        (lambda folder: (folder / ".stamps/second.json").write_text("{"), "second"),
        (lambda folder: (folder / ".stamps/second.json").write_text("{}"), "second"),
    ],
)
def test_a_touched_output_is_made_again(bench, damage, rerun):
    damage(bench.folder)
    assert bench.run() == [rerun]
    assert bench.run() == []


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, RuntimeError])
def test_an_interrupted_step_runs_again(bench, interruption):
    """Even if it had finished before with the same settings, and left files that look complete."""
    (bench.folder / "a.txt").unlink()
    write, count = bench.write, []

    def interrupted(name, *outputs):
        write(name, *outputs)
        count.append(name)
        raise interruption

    bench.write = interrupted
    with pytest.raises(interruption):
        bench.run()
    assert count == ["first"]
    assert not (bench.folder / ".stamps" / "first.json").exists()
    assert (bench.folder / ".stamps" / "second.json").exists()
    bench.write = write
    assert bench.run() == ["first"]
    assert bench.run() == []


def test_a_step_that_writes_nothing_is_an_error(tmp_path):
    step = Step("idle", lambda: None, None, (), ("never.txt", "b"))
    with pytest.raises(RuntimeError, match=r"step idle: an output is missing: never.txt, b"):
        Workspace(tmp_path).perform(step, lambda name, current: None)
    assert not (tmp_path / ".stamps" / "idle.json").exists()


def test_a_moved_folder_is_still_up_to_date(bench, tmp_path):
    bench.folder.rename(tmp_path / "moved")
    bench.folder = tmp_path / "moved"
    assert bench.run() == []


def test_digests_depend_on_content_and_names_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(store_sources, "ROOT", tmp_path)
    (tmp_path / "a.py").write_text("1")
    before = digest_sources(("*.py",))
    time.sleep(0.01)
    (tmp_path / "a.py").write_text("1")
    assert digest_sources(("*.py",)) == before
    (tmp_path / "a.py").write_text("2")
    assert digest_sources(("*.py",)) != before
    # SHA-256 of "2"
    assert (
        digest_file(tmp_path / "a.py") == "d4735e3a265e16eee03f59718b9b5d03019c07d8b6c51f90da3a666eec13ab35"
    )


def test_the_build_s_own_patterns_match_files():
    from fastac.store.sources import HARDWARE_SOURCES, TRAINING_SOURCES

    sources = (*TRAINING_SOURCES, *HARDWARE_SOURCES)
    for pattern in (*sources, "sim/**/*.py", "fastac/report/*.py", "fastac/report/*.j2"):
        assert any(store_sources.ROOT.glob(pattern)), pattern


def test_json_is_whole_or_as_it_was(tmp_path):
    path = tmp_path / "new" / "x.json"
    write_json(path, {"a": [1, 2]})
    with pytest.raises(TypeError):
        write_json(path, {"a": object()})
    assert json.loads(path.read_text()) == {"a": [1, 2]}
    assert [p.name for p in path.parent.iterdir()] == ["x.json"]


def test_steps_are_timed(bench):
    place = Workspace(bench.folder)
    assert place.seconds("third") is None
    took = place.seconds("first")
    assert 0 <= took < 60
    bench.run()
    assert place.seconds("first") == took  # of the run that made it
    (bench.folder / ".stamps" / "first.json").write_text("[]")
    assert place.seconds("first") is None


def test_a_stamp_keeps_its_key(bench):
    place = Workspace(bench.folder)
    with pytest.raises(RuntimeError, match="step other: never performed"):
        place.stamped_key("other")
    key = place.stamped_key("first")
    assert len(key) == 64
    bench.run()
    assert place.stamped_key("first") == key


def test_what_is_there_is_not_made_again(tmp_path):
    made = []

    def make():
        made.append(1)
        return {"a": 1}

    for _ in range(2):
        assert read_or_make(tmp_path / "x.json", make) == {"a": 1}
    assert made == [1]


def test_a_content_s_hash_is_that_of_its_json():
    assert content_hash({"a": 1, "b": (2,)}) == content_hash({"b": [2], "a": 1})
    assert content_hash({"a": 1}) != content_hash({"a": 2})
    assert len(content_hash()) == 24
