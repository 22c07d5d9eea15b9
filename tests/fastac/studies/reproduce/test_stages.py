"""Times and energies of stages: what is run, how often, and on which device."""

import pytest

from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.floating.torch_pipeline import TorchPipeline
from fastac.studies.reproduce import stages
from fastac.studies.reproduce.stages import (
    TITLES,
    cpu_stages,
    device_stages,
    energies_mj,
    latencies_ms,
    processor,
)


@pytest.fixture
def runs(tiny_bundle, tiny_data):
    pipeline, frames = FloatPipeline.from_bundle(tiny_bundle), tiny_data.frames[:3]
    return {
        "NumPy": cpu_stages(pipeline, frames),
        "torch": device_stages(TorchPipeline(pipeline, "cpu"), frames),
    }


@pytest.mark.parametrize("name", ["NumPy", "torch"])
def test_every_stage_has_a_time_of_one_frame(runs, name, monkeypatch):
    monkeypatch.setattr(stages, "REPEATS", 1)
    found = latencies_ms(runs[name], 3)
    assert list(found) == list(TITLES)
    assert all(0 < value < 1000 for value in found.values())


def test_a_latency_is_the_fastest_pass_s_share(monkeypatch):
    monkeypatch.setattr(stages, "fastest", lambda run, repeats: (0.5, 0.0))
    assert latencies_ms({"normals": lambda: None}, 8) == {"normals": 62.5}


def test_an_energy_is_that_of_the_frames_done(monkeypatch):
    done = []

    class Counters:
        def read_uj(self):
            return [7 * len(done)]

        def spent_mj(self, before, after):
            return 1e-3 * (after[0] - before[0])

    monkeypatch.setattr(stages, "ENERGY_S", 0.01)
    found = energies_mj({"depth": lambda: done.append(1)}, 2, Counters())
    assert found == {"depth": pytest.approx(0.0035)}
    assert done


def test_the_processor_has_a_name():
    assert processor().strip()
