from dataclasses import asdict, replace
from pathlib import Path

import pytest

from fastac.flow import hardware
from fastac.gateware.cycle_model import cycles
from fastac.store.store import open_store
from fastac.sweep import confirm, front
from fastac.sweep.front import Source, TradeError
from fastac.sweep.points import PointModels, Setting, generation, point_key
from fastac.sweep.results import Results, Row
from fastac.sweep.spec import Point


@pytest.fixture(scope="module")
def models(make_scene, tiny_file, tmp_path_factory):
    """Of normals alone, with little training."""
    scene = make_scene(outputs=["normals"], training={"normals_epochs": 1, "finetune_epochs": 0})
    return PointModels(scene, Setting(str(tmp_path_factory.mktemp("store")), str(tiny_file), "test", 4))


@pytest.fixture
def source(models, tmp_path):
    results = Results(tmp_path / "r.sqlite")
    key = point_key(Point({}, models.scene).content, models.setting)
    now = generation(models.setting)
    scene = models.scene.model_dump(mode="json")
    results.set_facts({"setting": asdict(models.setting), "generation": now, "scene": scene})
    metrics = open_store(Path(models.setting.store)).value(models.point)
    results.add(Row(key, "done", {}, scene, metrics, generation=now))
    return front.read(results.path)


@pytest.fixture
def rtl(monkeypatch, models):
    """What a simulation would find; the Verilog is not of interest here."""
    known = cycles(models.scene)
    found = {
        "frames": 3,
        "values_compared": 99,
        "mismatches": 0,
        "first_mismatch": "",
        "latency_cycles": {
            "stage": known["stage"],
            "first_pixel_to_first_normal": 1,
            "first_pixel_to_normals": known["first_pixel_to_normals"],
            "initiation_interval": known["initiation_interval"],
        },
    }
    runs = []

    def simulate(bundle, data, index, *folders, progress):
        runs.append(index.tolist())
        return found

    monkeypatch.setattr(hardware, "write_verilog", lambda *arguments, **settings: None)
    monkeypatch.setattr(hardware, "simulate", simulate)
    return found, runs


def test_an_exact_design(source, rtl, tmp_path, models):
    found = confirm.confirm(source, source.done[0], tmp_path / "rtl", progress=False)
    assert found.is_exact
    assert found.cycles_counted == found.cycles_stated
    assert set(found.cycles_stated) == {"first_pixel_to_normals", "initiation_interval"}
    assert (tmp_path / "rtl" / "bundle" / "bundle.json").exists()
    [index] = rtl[1]
    assert len(index) == 3
    assert set(index) <= set(models.index.tolist())


def test_a_cycle_or_a_bit_too_many(source, rtl, tmp_path):
    rtl[0]["mismatches"] = 1
    assert not confirm.confirm(source, source.done[0], tmp_path / "rtl", progress=False).is_exact
    rtl[0]["mismatches"] = 0
    rtl[0]["latency_cycles"]["initiation_interval"] += 1
    assert not confirm.confirm(source, source.done[0], tmp_path / "rtl", progress=False).is_exact


def test_what_is_known_is_not_simulated_again(source, rtl, tmp_path):
    told = []

    def run():
        chosen = [(source, row) for row in source.done]
        tell = lambda row, content: told.append((row.key, content["is_exact"]))  # noqa: E731
        return confirm.run(chosen, 5, 1, tmp_path / "rtl", tell, progress=False)

    assert run() == run()
    assert len(rtl[1]) == 1
    assert told == [(source.done[0].key, True)] * 2
    assert source.results.confirmations()[source.done[0].key]["mismatches"] == 0


def test_figures_of_other_sources_are_refused(source, rtl, tmp_path):
    stale = replace(source.done[0], key="0" * 32)
    with pytest.raises(TradeError, match="have changed since: run fastac sweep again"):
        confirm.confirm(source, stale, tmp_path / "rtl", progress=False)
    wrong = replace(source.done[0], metrics=source.done[0].metrics | {"latency_cycles": 3})
    with pytest.raises(TradeError, match="its cycles are no longer 3"):
        confirm.confirm(source, wrong, tmp_path / "rtl", progress=False)


def test_designs_are_drawn_by_the_seed(source):
    designs = [(Source(None, {}, []), Row(f"{k:02d}", "done", {}, None)) for k in range(30)]
    first = confirm.choose(designs, 10, 1)
    assert first == confirm.choose(designs[::-1], 10, 1)
    assert first != confirm.choose(designs, 10, 2)
    assert len(confirm.choose(designs[:4], 10, 1)) == 4
