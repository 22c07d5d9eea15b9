import pytest

from fastac.sweep import front
from fastac.sweep.results import Results, Row
from fastac.sweep.seeds import headlines_table, seeds_table, trainings


@pytest.fixture
def source(make_scene, tmp_path):
    """Two networks of three trainings, one of a single training, as a sweep measures them."""
    results = Results(tmp_path / "r.sqlite")
    results.set_facts({"scene": make_scene().model_dump(mode="json"), "generation": "now"})
    for width, errors in ((8, (0.5, 0.6, 0.7)), (6, (0.55, 0.66, 0.77)), (4, (0.9,))):
        for seed, error in enumerate(errors, 1):
            scene = make_scene(network={"width": width}, training={"seed": seed}).model_dump(mode="json")
            axes = {"network.width": width, "training.seed": seed}
            metrics = {"normal_mae_deg": error, "dsp": 10 * width, "lut": 20000 + 100 * seed}
            results.add(Row(f"{width} {seed}", "done", axes, scene, metrics, generation="now"))
    return front.read(results.path)


def test_designs_are_grouped_over_seeds_alone(source):
    found = trainings(source.done)
    assert [[row.key for row in design.rows] for design in found] == [
        [f"{width} {seed}" for seed in (1, 2, 3)] for width in (8, 6)
    ]
    assert [design.design.axes for design in found] == [{"network.width": 8}, {"network.width": 6}]
    assert found[0].mean("normal_mae_deg") == pytest.approx(0.6)
    assert found[0].spread("normal_mae_deg") == pytest.approx(0.1)
    assert not found[0].has("depth_mae_mm")
    assert trainings(source.done[:1]) == []


def test_the_table_has_means_spreads_and_what_another_network_changes(source):
    table = seeds_table(source)
    assert table.head == ["design", "trainings", "normal_mae_deg", "dsp", "lut"]
    assert table.rows == [
        ["width 8", "3", "0.6 ± 0.1", "80", "20,200 ± 100"],
        ["width 6", "3", "0.66 ± 0.11 (+10.0%)", "60", "20,200 ± 100"],
    ]


def test_errors_of_floats_and_integers_have_their_spread_and_furthest_training(make_scene, tmp_path):
    results = Results(tmp_path / "r.sqlite")
    results.set_facts({"scene": make_scene().model_dump(mode="json"), "generation": "now"})
    for seed, (of_float, of_integer) in enumerate([(1.0, 1.2), (2.0, 1.8), (3.0, 3.6)], 1):
        scene = make_scene(training={"seed": seed}).model_dump(mode="json")
        metrics = {"float_normal_mae_deg": of_float, "normal_mae_deg": of_integer, "depth_mae_mm": 0.1}
        metrics |= {"float_force_z_mae_n": 0.25, "force_z_mae_n": 0.1 * seed, "force_z_nmae_percent": seed}
        results.add(Row(f"{seed}", "done", {"training.seed": seed}, scene, metrics, generation="now"))
    table = headlines_table(front.read(results.path))
    normals, force = table.rows  # the depth's float error is not known
    assert normals[1:] == ["3", "normal_mae_deg", "2 ± 1", "50.0%", "2.2 ± 1.2", "63.6%", "+10.0%", ""]
    assert force[1:] == ["3", "force_z_mae_n", "0.25", "0.0%", "0.2 ± 0.1", "50.0%", "-20.0%", "2 ± 1"]
