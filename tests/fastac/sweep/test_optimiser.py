import pytest

from fastac.sweep import spec as sweep_spec
from fastac.sweep.optimiser import Optimiser
from fastac.sweep.results import Results, Row

SPEC = """
scene = "tiny.toml"
method = "optuna"
trials = 30
objectives = ["error", "cost"]
[axes]
"numbers.data_bits" = [12, 14, 16, 18, 20, 22, 24, 26]
"numbers.kernel_bits, numbers.displacement_bits" = [4, 6, 8, 10, 12]
"""


@pytest.fixture
def loaded(tiny_toml, tmp_path):
    (tmp_path / "tiny.toml").write_text(tiny_toml)
    (tmp_path / "spec.toml").write_text(SPEC)
    return (*sweep_spec.load(tmp_path / "spec.toml"), Results(tmp_path / "r.sqlite"), tmp_path)


def measured(point) -> Row:
    bits = point.scene.numbers
    metrics = {"error": 2.0**-bits.data_bits, "cost": bits.data_bits + bits.kernel_bits}
    return Row(sweep_spec.digest(point.content), "done", point.axes, None, metrics)


def go(loaded, most=100, slots=1):
    """Ask and tell until there is no more, or `most` times."""
    optimiser, asked = Optimiser(*loaded, slots), []
    while len(asked) < most and (point := optimiser.ask(0)) is not None:
        asked.append(point)
        row = measured(point)
        loaded[2].add(row)
        optimiser.tell(point, row)
    return asked


def test_so_many_trials(loaded):
    asked = go(loaded)
    assert len(asked) == 30
    assert all(p.scene.numbers.kernel_bits == p.scene.numbers.displacement_bits for p in asked)
    best = min(asked, key=lambda point: measured(point).metrics["cost"])
    assert best.scene.numbers.kernel_bits == 4


def test_the_seed_decides(loaded, tmp_path):
    spec, base, _, folder = loaded
    first = [p.axes for p in go(loaded)]
    again = [p.axes for p in go((spec, base, Results(tmp_path / "again.sqlite"), folder))]
    assert first == again


def test_what_was_tried_before_counts(loaded):
    assert len(go(loaded, most=12)) == 12
    assert len(go(loaded)) == 18
    assert go(loaded) == []
    assert len(loaded[2].trials()) == 30


def test_no_more_than_the_pool_holds(loaded):
    optimiser = Optimiser(*loaded, 2)
    assert optimiser.ask(1) is not None
    assert optimiser.ask(2) is None


def test_points_without_figures_are_told(loaded):
    optimiser = Optimiser(*loaded, 1)
    point = optimiser.ask(0)
    optimiser.tell(point, Row("a", "infeasible", point.axes, None, error="too short"))
    assert len(Optimiser(*loaded, 1).study.trials) == 1


def test_an_objective_that_is_not_measured(loaded):
    optimiser = Optimiser(*loaded, 1)
    point = optimiser.ask(0)
    with pytest.raises(ValueError, match="objectives: 'error': not measured; there are dsp"):
        optimiser.tell(point, Row("a", "done", point.axes, None, {"dsp": 1}))
