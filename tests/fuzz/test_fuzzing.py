"""The bench itself finds every kind of bad end."""

import importlib.util
import signal
import subprocess
import sys
import time
from pathlib import Path

import fuzzing
import pytest
from fuzzing import BadEndError, Bench, Link, Reader
from hypothesis import strategies as st

CASE = {"a.txt": b"text"}


def bench(tmp_path, read, **given) -> Bench:
    return Bench(Reader("a reader", st.just(CASE), read, **given), tmp_path)


def refuse(folder):
    raise ValueError(f"{folder / 'a.txt'}: no good")


def test_a_result_and_a_refusal_are_counted(tmp_path):
    good, bad = bench(tmp_path / "a", lambda folder: None), bench(tmp_path / "b", refuse)
    good.drive(CASE)
    bad.drive(CASE)
    assert (good.tally.results, bad.tally.results) == (1, 0)
    assert bad.tally.refused == {"ValueError": 1}


def unknown_key(folder):
    return {}["key"]


def two_lines(folder):
    raise ValueError(f"{folder / 'a.txt'}: no\ngood")


def no_name(folder):
    raise ValueError("no good")


def no_text(folder):
    raise OSError


def no_terminal_shows_it(folder):
    raise ValueError(f"{folder}: \ud800")


def leaves_half_a_file(folder):
    (folder / fuzzing.OUTPUT).mkdir()
    (folder / fuzzing.OUTPUT / "half.h5").write_bytes(b"half")
    refuse(folder)


def leaves_a_temporary_file(folder):
    (folder / ".data.17.part.h5").write_bytes(b"half")
    refuse(folder)


def reads_elsewhere(folder):
    (folder.parent / "other.txt").write_text("other")
    return (folder / "../other.txt").read_text()


def follows_a_link(folder):
    return (folder / "link").read_text()


@pytest.mark.parametrize(
    ("read", "match"),
    [
        (unknown_key, "traceback: KeyError"),
        (two_lines, "not one line"),
        (no_name, "names no file"),
        (no_text, "not one line"),
        (no_terminal_shows_it, "no terminal can show it"),
        (leaves_half_a_file, "left out/half.h5 behind"),
        (leaves_a_temporary_file, r"left \.data\.17\.part\.h5 behind"),
        (reads_elsewhere, "opened .*other.txt"),
        (follows_a_link, "opened .*outside.txt"),
    ],
)
def test_bad_ends(tmp_path, read, match):
    (tmp_path / "outside.txt").write_text("outside")
    with pytest.raises(BadEndError, match=match):
        bench(tmp_path, read).drive(CASE | {"link": Link("../outside.txt")})


def test_what_takes_long(tmp_path, monkeypatch):
    monkeypatch.setattr(fuzzing, "LIMIT_S", 0.05)

    def busy(folder):
        began = time.process_time()
        while time.process_time() < began + 0.1:
            pass

    with pytest.raises(BadEndError, match="took"):
        bench(tmp_path, busy).drive(CASE)


def test_the_command_line_is_asked_too(tmp_path):
    def other(folder):
        return ["build", folder / "no such scene.toml"]

    found = bench(tmp_path / "a", refuse, command=other)
    found.drive(CASE)
    assert found.tally.commands == 1
    with pytest.raises(BadEndError, match="-h: 0"):
        bench(tmp_path / "b", refuse, command=lambda folder: ["-h"]).drive(CASE)


def test_a_batch_is_the_same_each_time(tmp_path):
    def read(folder):
        seen.append((folder / "a.txt").read_bytes())
        refuse(folder)

    seen: list[bytes] = []
    reader = Reader("a reader", st.binary().map(lambda content: {"a.txt": content}), read)
    first = fuzzing.run_batch(reader, tmp_path / "a", 5, 50)
    again, seen = seen, []
    second = fuzzing.run_batch(reader, tmp_path / "b", 5, 50)
    assert again == seen
    assert first.inputs == second.inputs == len(seen) >= 50
    assert len(set(seen)) > 20


def test_failures_of_a_batch_are_collected_and_kept(tmp_path):
    reader = Reader("a reader", st.just(CASE), unknown_key)
    found = fuzzing.run_batch(reader, tmp_path / "a", 5, 3, keep=tmp_path / "bad")
    assert found.failures[0].startswith("a reader: traceback: KeyError")
    assert (tmp_path / "bad" / "1" / "a.txt").read_bytes() == b"text"


HANGS = """
import re, sys
from pathlib import Path
sys.path.insert(0, {shared!r})
import fuzzing
from hypothesis import strategies as st

fuzzing.LIMIT_S = 0.3
reader = fuzzing.Reader("a reader", st.just({{"a": b""}}), lambda folder: re.match("(a*)*b", "a" * 64))
fuzzing.run_batch(reader, Path({folder!r}), 1, 1, kill=True)
"""


def test_what_hangs_in_c_code_is_killed(tmp_path):
    """A regular expression that Python cannot interrupt; signals would wait for its end."""
    script = HANGS.format(shared=str(Path(fuzzing.__file__).parent), folder=str(tmp_path))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert done.returncode == -signal.SIGPROF, done.stderr


@pytest.fixture
def campaign(monkeypatch, tmp_path):
    """The campaign's module, with its results in a folder of the test's own."""
    path = Path(__file__).with_name("campaign.py")
    spec = importlib.util.spec_from_file_location("fuzz_campaign", path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "FOLDER", tmp_path / "fuzz")
    return module


def test_a_batch_that_does_not_end_well_is_a_failure(campaign):
    reader = Reader("no reader of this name", st.just(CASE), refuse)
    found = campaign.run_apart(campaign.Batch(reader, 1, 5), "code")
    assert found.failures[0].startswith("no reader of this name: seed 1: ended with 1")
    assert campaign.table({reader.name: found}).rows[0][6] == 1


def test_finished_batches_are_kept_while_the_code_is_the_same(campaign, tmp_path, monkeypatch):
    reader = Reader("a reader", st.just(CASE), refuse)
    batch = campaign.Batch(reader, 1, 5)
    monkeypatch.setattr(campaign, "MEMORY_BYTES", 1 << 40)
    campaign.run_here(batch, "code")
    found = campaign.run_apart(batch, "code")
    assert (found.inputs, found.refused["ValueError"], found.failures) == (1, 1, [])
    assert campaign.run_apart(batch, "other code").failures


def test_every_reader_has_a_name_of_its_own(campaign):
    names = [reader.name for reader in campaign.readers()]
    assert len(set(names)) == len(names) >= 20
    small = ("scene", "bundle's description", "labels of photographs", "calibration image")
    assert all(reader.count >= 20_000 for reader in campaign.readers() if reader.name in small)
