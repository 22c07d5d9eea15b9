import os
import time
from pathlib import Path

from toy_steps import slopes, states, weights

from fastac.store.steps import Step
from fastac.store.store import DAY_S, open_store


def test_a_result_is_kept(toy):
    store = toy.store()
    assert store.why(slopes(toy)) == "never performed"
    assert states(toy, slopes(toy)) == [("slopes", "running")]
    assert states(toy, slopes(toy)) == [("slopes", "kept")]
    entry = store.perform(slopes(toy))
    assert entry.path("slopes.txt").read_text() == "19"
    assert store.is_current(slopes(toy))
    assert store.why(slopes(toy)) == "current"


def test_a_relative_folder_is_one_of_the_current_directory(tmp_path, monkeypatch):
    stores = []
    for name in ("a", "b", "a"):
        (tmp_path / name).mkdir(exist_ok=True)
        monkeypatch.chdir(tmp_path / name)
        stores.append(open_store(Path("store")))
    assert [store.folder for store in stores] == [tmp_path / name / "store" for name in ("a", "b", "a")]
    assert stores[0] is stores[2]


def test_a_step_that_another_process_performs_meanwhile(toy, monkeypatch):
    """It is found where the store looks for why it is not current."""
    store = toy.store()
    store.perform(slopes(toy))
    monkeypatch.setattr(store, "_current", lambda inputs: None)
    assert store.is_current(slopes(toy))


def test_copies_are_placed_where_links_cannot_be(toy, tmp_path, monkeypatch):
    def refuse(source, target):
        raise OSError("another file system")

    monkeypatch.setattr(os, "link", refuse)
    placed = toy.store().perform(slopes(toy)).place(tmp_path / "build")["slopes.txt"]
    placed.write_text("77")
    assert toy.store().is_current(slopes(toy))


FOLDERS = """
    def make(folder):
        (folder / "a/b").mkdir(parents=True)
        (folder / "a/b/c").write_text("1")
        (folder / "scratch").mkdir()
    """


def test_folders_are_outputs(toy, tmp_path):
    toy.write("folders.py", FOLDERS)
    step = Step("make", toy.module("folders").make, {}, ("a",))
    entry = toy.store().perform(step)
    assert sorted(p.name for p in entry.folder.iterdir()) == ["a", "step.json"]
    entry.place(tmp_path / "build")
    (tmp_path / "build/a/more").write_text("")
    assert (entry.place(tmp_path / "build")["a"] / "b/c").read_text() == "1"
    assert [p.name for p in (tmp_path / "build").iterdir()] == ["a"]
    assert [p.name for p in (tmp_path / "build/a").iterdir()] == ["b"]
    (entry.path("a") / "b/d").write_text("")
    assert toy.store().why(step) == "output a has other files"


def test_clean_removes_what_is_long_unused(toy):
    old = toy.store().perform(slopes(toy))
    toy.store().perform(weights(toy))
    long_ago = time.time() - 3 * DAY_S
    os.utime(old.folder / "step.json", (long_ago, long_ago))
    (toy.kept / ".part" / f"{'0' * 16}-left").mkdir()
    assert toy.store().clean(2) == [old.id]
    assert not toy.store().is_current(slopes(toy))
    assert toy.store().is_current(weights(toy))
    assert not list((toy.kept / ".part").iterdir())


def test_use_keeps_an_entry_from_being_cleaned(toy):
    entry = toy.store().perform(slopes(toy))
    os.utime(entry.folder / "step.json", (0, 0))
    toy.store().perform(slopes(toy))
    assert toy.store().clean(1) == []


def test_a_bucket_in_use_is_not_cleaned(toy):
    entry = toy.store().perform(slopes(toy))
    os.utime(entry.folder / "step.json", (0, 0))
    store = toy.store()
    with store._locked(entry.folder.name.partition("-")[0], lambda: None):
        assert toy.store().clean(1) == []
    assert toy.store().clean(1) == [entry.id]
