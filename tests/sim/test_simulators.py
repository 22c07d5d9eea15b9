"""The cache of simulators: no design is compiled twice, entries are complete, the total size is limited."""

import os
from concurrent.futures import ThreadPoolExecutor

import pytest

from fastac.sim import runner, simulators


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    folder = tmp_path / "simulators"
    monkeypatch.setattr(simulators, "CACHE", folder)
    return folder


def cached_names(cache) -> set[str]:
    return {path.name for path in cache.iterdir() if path.suffix != ".lock"}


def test_an_unchanged_design_is_not_compiled_again(tmp_path, cache, monkeypatch):
    made = []
    install = runner.RuntimeObjects.install
    monkeypatch.setattr(
        runner.RuntimeObjects, "install", lambda self: made.append(self.folder.name) or install(self)
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
    # Another Verilog text, then the first again in the same folder, then other arguments.
    other = build("first", "b <= ~a")
    assert other != first
    assert build("first") == first
    assert len(made) == 2
    build("third", arguments=(*runner.QUICK, "-DUNUSED=1"))
    assert len(made) == 3
    assert len(cached_names(cache)) == 3


def test_failed_build_leaves_no_entry(tmp_path, cache):
    source = tmp_path / "wrong.v"
    source.write_text("module wrong(input clk); nonsense\n")
    with pytest.raises(RuntimeError):
        runner.build(source, "wrong", tmp_path / "build")
    assert not (tmp_path / "build" / "wrong").exists()
    assert cached_names(cache) == set()


def test_concurrent_requests_build_once(tmp_path, cache):
    made = []

    def one(k: int) -> bytes:
        executable = tmp_path / str(k)

        def make():
            made.append(k)
            executable.write_bytes(b"simulator")

        assert simulators.copy_or_build("name", executable, make) == (k != made[0])
        return executable.read_bytes()

    with ThreadPoolExecutor(4) as pool:
        assert set(pool.map(one, range(8))) == {b"simulator"}
    assert len(made) == 1


def test_least_recently_used_entries_are_deleted_first(tmp_path, cache, monkeypatch):
    monkeypatch.setattr(simulators, "LIMIT_BYTES", 250)
    executable = tmp_path / "executable"

    def make(name: str) -> bool:
        return simulators.copy_or_build(name, executable, lambda: executable.write_bytes(bytes(100)))

    assert [make("a"), make("b")] == [False, False]
    for name in "ab":
        os.utime(cache / name, (1, 1))
    assert [make("a"), make("c")] == [True, False]
    assert cached_names(cache) == {"a", "c"}
