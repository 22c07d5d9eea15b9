"""Simulators of the same Verilog, arguments and tools are compiled once; those kept are whole and limited."""

import os
from concurrent.futures import ThreadPoolExecutor

import pytest

from fastac.sim import runner, simulators


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    folder = tmp_path / "simulators"
    monkeypatch.setattr(simulators, "CACHE", folder)
    return folder


def kept(cache) -> set[str]:
    return {path.name for path in cache.iterdir() if path.suffix != ".lock"}


def test_an_unchanged_design_is_not_compiled_again(tmp_path, cache, monkeypatch):
    made = []
    take = runner.RuntimeObjects.take
    monkeypatch.setattr(
        runner.RuntimeObjects, "take", lambda self: made.append(self.folder.name) or take(self)
    )

    def build(folder: str, out: str = "b <= a", arguments=runner.QUICK):
        (tmp_path / folder).mkdir(exist_ok=True)
        source = tmp_path / folder / "follower.v"
        source.write_text(
            f"module follower(input clk, input a, output reg b); always @(posedge clk) {out}; endmodule\n"
        )
        runner.build(source, "follower", tmp_path / folder / "build", build_args=arguments)
        return (tmp_path / folder / "build" / "follower").read_bytes()

    first = build("first")
    assert build("second") == first
    assert build("first") == first
    assert len(made) == 1
    # Another text, then the first again in the same folder; other arguments.
    other = build("first", "b <= ~a")
    assert other != first
    assert build("first") == first
    assert len(made) == 2
    build("third", arguments=(*runner.QUICK, "-DUNUSED=1"))
    assert len(made) == 3
    assert len(kept(cache)) == 3


def test_a_build_that_fails_keeps_nothing(tmp_path, cache):
    source = tmp_path / "wrong.v"
    source.write_text("module wrong(input clk); nonsense\n")
    with pytest.raises(RuntimeError):
        runner.build(source, "wrong", tmp_path / "build")
    assert not (tmp_path / "build" / "wrong").exists()
    assert kept(cache) == set()


def test_those_who_want_the_same_one_wait_for_the_first(tmp_path, cache):
    made = []

    def one(k: int) -> bytes:
        executable = tmp_path / str(k)

        def make():
            made.append(k)
            executable.write_bytes(b"simulator")

        assert simulators.take_or_make("name", executable, make) == (k != made[0])
        return executable.read_bytes()

    with ThreadPoolExecutor(4) as pool:
        assert set(pool.map(one, range(8))) == {b"simulator"}
    assert len(made) == 1


def test_what_nobody_has_used_for_longest_goes_first(tmp_path, cache, monkeypatch):
    monkeypatch.setattr(simulators, "LIMIT_BYTES", 250)
    executable = tmp_path / "executable"

    def make(name: str) -> bool:
        return simulators.take_or_make(name, executable, lambda: executable.write_bytes(bytes(100)))

    assert [make("a"), make("b")] == [False, False]
    for name in "ab":
        os.utime(cache / name, (1, 1))
    assert [make("a"), make("c")] == [True, False]
    assert kept(cache) == {"a", "c"}
