import os
from concurrent.futures import ThreadPoolExecutor

import pytest

from fastac.sweep import pools
from fastac.sweep import run as sweeps
from fastac.sweep import spec as sweep_spec
from fastac.sweep.points import Setting
from fastac.sweep.pools import Pool, SweepError
from fastac.sweep.results import Results


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    """What a worker sets for itself is not for other tests."""
    for name in pools.THREAD_VARIABLES:
        monkeypatch.setenv(name, "1")


def one_thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1)


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.mark.long
@pytest.mark.full
def test_local_processes(tiny_toml, tiny_file, cache, tmp_path):
    """Two processes measure what one does."""
    (tmp_path / "tiny.toml").write_text(tiny_toml)
    (tmp_path / "spec.toml").write_text('scene = "tiny.toml"\n[axes]\n"numbers.data_bits" = [20, 26]')
    spec, base = sweep_spec.load(tmp_path / "spec.toml")
    setting = Setting(str(cache), str(tiny_file), "test", 3)
    found = {}
    with pools.local_pool(2) as local:
        for name, pool in {"inline": Pool(one_thread, 1), "local": local}.items():
            results = Results(tmp_path / f"{name}.sqlite")
            sweeps.run(spec, base, tmp_path, results, setting, pool, progress=False)
            found[name] = {row.key: row.metrics for row in results.rows()}
    assert len(found["local"]) == 2
    assert found["local"] == found["inline"]


def test_this_process_has_its_variables_back(monkeypatch):
    known, *others = pools.THREAD_VARIABLES
    monkeypatch.setenv(known, "3")
    for name in others:
        monkeypatch.delenv(name)
    with pools.this_process() as pool:
        assert pool.slots == 1
        pool.start().submit(pools.single_threaded).result()
        assert os.environ[known] == "1"
    assert [os.environ.get(name) for name in pools.THREAD_VARIABLES] == ["3", None, None]


def test_no_scheduler():
    with (
        pytest.raises(SweepError, match="--scheduler nonsense://here: no scheduler answers: "),
        pools.dask_pool("nonsense://here"),
    ):
        pass


@pytest.mark.full
def test_a_dask_cluster(tiny_toml, tiny_file, cache, tmp_path):
    distributed = pytest.importorskip("distributed")
    (tmp_path / "tiny.toml").write_text(tiny_toml)
    (tmp_path / "spec.toml").write_text('scene = "tiny.toml"\n[axes]\n"numbers.data_bits" = [20, 26]')
    spec, base = sweep_spec.load(tmp_path / "spec.toml")
    setting, results = Setting(str(cache), str(tiny_file), "test", 3), Results(tmp_path / "r.sqlite")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None
        ) as cluster,
        pools.dask_pool(cluster.scheduler_address) as pool,
    ):
        assert pool.slots == 2
        counts = sweeps.run(spec, base, tmp_path, results, setting, pool, progress=False)
    assert counts == {"done": 2, "infeasible": 0, "failed": 0, "known": 0}
