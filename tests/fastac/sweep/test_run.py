import sqlite3
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from functools import partial

import pytest
import torch

from fastac.sweep import point_steps, pools
from fastac.sweep import run as sweeps
from fastac.sweep import spec as sweep_spec
from fastac.sweep.points import Setting, code_digest
from fastac.sweep.pools import Pool
from fastac.sweep.results import Results
from fastac.sweep.run import Grid, Sweep, perform
from fastac.sweep.spec import SpecError

SPEC = """
scene = "tiny.toml"
[[axes]]
"numbers.data_bits" = [20, 26]
"poisson.mode" = ["absolute", "difference"]
[[axes]]
"numbers.weight_bits" = [5]
"poisson.solver" = ["adjoint", "dst2d"]
"""


class Inline(Executor):
    """Runs a task as it comes; `before` may raise what a pool would."""

    def __init__(self, before=lambda task: None):
        self.before, self.tasks = before, []

    def submit(self, function, task):
        self.tasks.append((task["step"], task["scene"]["numbers"]["data_bits"]))
        future = Future()
        try:
            self.before(task)
            future.set_result(function(task))
        except BaseException as error:
            future.set_exception(error)
        return future


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    """What a worker sets for itself is not for other tests."""
    for name in pools.THREAD_VARIABLES:
        monkeypatch.setenv(name, "1")


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def bench(tiny_toml, tiny_file, cache, tmp_path):
    """A sweep of `text` on frames that are there, by an executor."""
    (tmp_path / "tiny.toml").write_text(tiny_toml)
    setting = Setting(str(cache), str(tiny_file), "test", 3)

    def run(executor, text=SPEC, folder=cache, slots=2):
        path = tmp_path / "spec.toml"
        path.write_text(text)
        spec, base = sweep_spec.load(path)
        results = Results(tmp_path / "r.sqlite")
        where = Setting(str(folder), *list(asdict(setting).values())[1:])
        pool = Pool(lambda: executor, slots)
        counts = sweeps.run(spec, base, tmp_path, results, where, pool, progress=False)
        return counts, results.rows()

    return run


def test_every_point_is_measured_and_kept(bench):
    executor = Inline()
    counts, rows = bench(executor)
    assert counts == {"done": 5, "infeasible": 1, "failed": 0, "known": 0}
    assert [row.error for row in rows if row.status == "infeasible"] == [
        "poisson.solver: 'adjoint' finds no depth; choose 'dst2d' or 'tridiagonal'"
    ]
    trained = [step for step, _ in executor.tasks if step]
    assert sorted(trained) == [
        "float_errors",
        "float_errors",
        "force_start",
        "integers",
        "integers",
        "normals",
    ]
    for row in rows:
        if row.status == "done":
            assert {"depth_mae_mm", "latency_cycles", "dsp", "lut", "ramb36", "energy_uj"} <= set(row.metrics)
    again = Inline()
    assert bench(again)[0] == {"done": 0, "infeasible": 0, "failed": 0, "known": 6}
    assert again.tasks == []


def test_a_specification_in_a_file(tiny_toml, tiny_file, cache, tmp_path, request):
    """In this process, which keeps its threads."""
    path, results = tmp_path / "spec.toml", tmp_path / "r.sqlite"
    path.write_text('scene = "tiny.toml"\nframes = 3\n[axes]\n"numbers.data_bits" = [20]\n')
    request.addfinalizer(partial(torch.set_num_threads, torch.get_num_threads()))
    torch.set_num_threads(2)
    (tmp_path / "tiny.toml").write_text(tiny_toml.replace("[sensor]", '[sensor]\nsource = "recorded"'))
    with pytest.raises(SpecError, match=r"spec.toml: data: missing: scene tiny is of a recorded sensor"):
        sweeps.explore(path, results, store=cache, workers=0, progress=False)
    assert not results.exists()
    (tmp_path / "tiny.toml").write_text(tiny_toml)
    path.write_text(f'data = "{tiny_file}"\n{path.read_text()}')
    counts = sweeps.explore(path, results, store=cache, workers=0, progress=False)
    assert counts == {"done": 1, "infeasible": 0, "failed": 0, "known": 0}
    [row] = Results(results).rows()
    assert row.axes == {"numbers.data_bits": 20}
    assert torch.get_num_threads() == 2


def test_an_error_cancels_what_is_under_way(bench, monkeypatch):
    class Slow(Inline):
        """Tasks stay under way; `shutdown` takes what that of any executor does."""

        def __init__(self):
            self.futures = []

        def submit(self, function, task):
            self.futures.append(Future())
            return self.futures[-1]

        def shutdown(self, wait=True):
            self.waited = wait

    def interrupted(*arguments, **settings):
        raise KeyboardInterrupt

    monkeypatch.setattr(sweeps, "wait", interrupted)
    executor = Slow()
    with pytest.raises(KeyboardInterrupt):
        bench(executor)
    assert executor.futures
    assert all(future.cancelled() for future in executor.futures)
    assert executor.waited is False


def test_what_failed_is_tried_again_and_stops_nothing(bench):
    def refuse(task):
        if task["scene"]["numbers"]["data_bits"] == 20 and task["step"] is None:
            raise OSError("no space left")

    counts, rows = bench(Inline(refuse))
    assert counts == {"done": 3, "infeasible": 1, "failed": 2, "known": 0}
    assert {row.error for row in rows if row.status == "failed"} == {"OSError: no space left"}
    counts, rows = bench(Inline())
    assert counts == {"done": 2, "infeasible": 0, "failed": 0, "known": 4}
    assert len(rows) == 6


def test_a_training_that_fails_takes_its_points_along(bench, tmp_path):
    def refuse(task):
        if task["step"] == "integers" and task["scene"]["numbers"]["weight_bits"] == 5:
            raise RuntimeError("diverged")

    counts, rows = bench(Inline(refuse), folder=tmp_path / "own")
    assert counts == {"done": 4, "infeasible": 1, "failed": 1, "known": 0}
    [failed] = [row for row in rows if row.status == "failed"]
    assert failed.axes["numbers.weight_bits"] == 5
    assert failed.error == "RuntimeError: diverged"


def test_a_process_that_is_killed_once_has_another_chance(bench):
    killed = []

    def kill(task):
        if not killed and task["step"] is None:
            killed.append(task)
            raise BrokenProcessPool("killed")

    counts, _ = bench(Inline(kill))
    assert killed
    assert counts["done"] == 5


def test_a_point_that_always_kills_its_process(bench):
    def kill(task):
        if task["step"] is None and task["scene"]["numbers"]["data_bits"] == 20:
            raise BrokenProcessPool("killed")

    counts, rows = bench(Inline(kill))
    assert counts["failed"] == 2
    assert {row.error for row in rows if row.status == "failed"} == {
        "its process was killed; is there enough memory?"
    }


def test_an_interrupted_sweep_keeps_what_was_done(bench, tmp_path):
    def interrupt(task):
        if task["step"] is None and len(Results(tmp_path / "r.sqlite").rows()) == 3:
            raise KeyboardInterrupt

    class Interrupted(Inline):
        def submit(self, function, task):
            interrupt(task)
            return super().submit(function, task)

    with pytest.raises(KeyboardInterrupt):
        bench(Interrupted())
    with sqlite3.connect(tmp_path / "r.sqlite") as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    connection.close()
    counts, _ = bench(Inline())
    assert counts["known"] == 3
    assert counts["done"] == 3


def test_a_worker_with_other_sources_refuses(tiny_scene, cache, tiny_file):
    setting = Setting(str(cache), str(tiny_file), "test", 3)
    task = {"scene": tiny_scene.model_dump(mode="json"), "setting": asdict(setting), "step": None}
    assert "other sources" in perform(task | {"code": "old"})["failed"]


def test_a_worker_tells_what_cannot_be_from_what_went_wrong(make_scene, cache, tiny_file, monkeypatch):
    def outcome(**changes):
        scene = make_scene(**changes).model_dump(mode="json")
        setting = asdict(Setting(str(cache), str(tiny_file), "test", 2))
        return perform({"scene": scene, "setting": setting, "step": None, "code": code_digest(cache)})

    assert set(outcome(network={"width": 64}, hardware={"pixels_per_clock": 4})) == {"infeasible"}

    def broken(pipeline):
        raise KeyError("missing")

    monkeypatch.setattr(point_steps, "latency", broken)
    assert outcome()["failed"].startswith("KeyError: 'missing' (test_run.py:")


def test_nothing_to_do(tmp_path, cache):
    results = Results(tmp_path / "r.sqlite")
    pool = Pool(Inline, 1)
    found = Sweep(results, Setting(str(cache), None, "test", 3), pool, Grid([]), progress=False).run()
    assert set(found.values()) == {0}
