import numpy as np
import pytest

from fastac.scenes import schema as scenes
from fastac.sweep import front
from fastac.sweep.front import TradeError
from fastac.sweep.results import Results, ResultsError, Row


def row(key, *, scene=None, status="done", **metrics):
    return Row(key, status, {"key": key}, scene, metrics)


def test_the_front_is_what_nothing_beats():
    rng = np.random.default_rng(1)
    for metrics in (1, 2, 3):
        values = rng.integers(0, 6, (60, metrics))
        kept = front.is_on_front(values)
        assert kept.any()
        for k, value in enumerate(values):
            beaten = any((o <= value).all() and (o < value).any() for o in values)
            same = any((o == value).all() for o in values[:k])
            assert kept[k] == (not beaten and not same)


def test_a_front_is_ordered_and_leaves_out_what_lacks_a_metric():
    rows = [row("a", e=3, c=1), row("b", e=1, c=9), row("c", e=2, c=5), row("d", e=3, c=6), row("x", e=0)]
    assert [r.key for r in front.front(rows, ("e", "c"))] == ["a", "c", "b"]
    assert front.front([row("x", e=0)], ("e", "c")) == []


def test_best_designs_count_every_cost():
    costs = {"latency_cycles": 9, "dsp": 9, "energy_uj": 9.0}
    rows = [
        row("accurate", depth_mae_mm=1, **costs),
        row("frugal", depth_mae_mm=2, **costs | {"energy_uj": 1.0}),
        row("poor", depth_mae_mm=3, **costs),
    ]
    assert {r.key for r in front.best_designs(rows)} == {"accurate", "frugal"}
    rows.append(row("depthless", force_z_mae_n=1, **costs))
    assert {r.key for r in front.best_designs(rows)} == {"accurate", "frugal", "depthless"}
    with pytest.raises(TradeError, match="no point has an error"):
        front.best_designs([row("x", **costs)])


def test_what_speed_costs():
    rows = [
        row("slow", e=1.0, latency_cycles=1000),
        row("middle", e=1.5, latency_cycles=400),
        row("near", e=1.4, latency_cycles=600),
        row("quick", e=3.0, latency_cycles=100),
        row("silly", e=4.0, latency_cycles=200),
    ]
    found = front.faster(rows, "e")
    assert [(ratio, r.key) for ratio, r in found] == [(1.0, "slow"), (2.5, "middle"), (10.0, "quick")]
    assert front.faster([], "e") == []


class TestPick:
    ROWS = (
        row("a", depth_mae_mm=0.02, dsp=300, latency_cycles=10, energy_uj=2.0),
        row("b", depth_mae_mm=0.025, dsp=200, latency_cycles=20, energy_uj=2.0),
        row("c", depth_mae_mm=0.03, dsp=200, latency_cycles=20, energy_uj=1.0),
        row("d", dsp=1, latency_cycles=1, energy_uj=1.0),
    )
    BY = ("latency_cycles", "energy_uj")

    @pytest.mark.parametrize(
        ("text", "key"),
        [
            ("depth_mae_mm<0.03, dsp<220", "b"),
            ("depth_mae_mm<=0.03,dsp<=200", "c"),
            (" depth_mae_mm < 1e-1 ", "a"),
            ("depth_mae_mm>0.02, dsp>=200, energy_uj>1.5", "b"),
            ("dsp<10", "d"),
        ],
    )
    def test_limits(self, text, key):
        assert front.pick(self.ROWS, text, self.BY).key == key

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("depth<0.03", "--pick 'depth': no such metric; there are depth_mae_mm, dsp, energy_uj, latency"),
            ("dsp=3", "--pick 'dsp=3': expected a metric, one of < <= > >=, and a number"),
            ("dsp<", "--pick 'dsp<': expected"),
            ("dsp<3,", "--pick '': expected"),
            ("dsp<3 energy_uj<3", "--pick 'dsp<3 energy_uj<3': expected"),
            ("dsp<many", "--pick 'dsp<many': 'many' is no number"),
            ("dsp<nan", "--pick 'dsp<nan': expected a finite number"),
            ("__import__('os')<3", "--pick \"__import__('os')<3\": expected"),
            ("dsp<1", "--pick 'dsp<1': no design meets all limits; that on dsp leaves none"),
        ],
    )
    def test_questions_without_an_answer(self, text, message):
        with pytest.raises(TradeError) as caught:
            front.pick(self.ROWS, text, self.BY)
        assert str(caught.value).startswith(message)

    def test_what_is_best_must_be_a_metric(self):
        with pytest.raises(TradeError, match="--by 'speed': no such metric; there are "):
            front.pick(self.ROWS, "dsp<900", ["speed"])


def test_the_scene_is_ready_to_build(make_scene, tmp_path):
    scene = make_scene(numbers={"data_bits": 20}, outputs=["depth"], hardware={"pixels_per_clock": 2})
    best = row("a", scene=scene.model_dump(mode="json"), dsp=3, depth_mae_mm=0.0123456789)
    path = tmp_path / "new" / "chosen.toml"
    found = front.write_scene(best, path, "asked for")
    assert found == scenes.load(path)
    assert found.model_copy(update={"name": scene.name}) == scene
    assert found.name == "chosen"
    lines = path.read_text().splitlines()
    assert lines[:3] == ["# asked for", "# depth_mae_mm = 0.0123457", "# dsp = 3"]


@pytest.fixture
def results(make_scene, tmp_path):
    """Points of the tiny scene, the first as it is."""
    found = Results(tmp_path / "r.sqlite")
    base = make_scene().model_dump(mode="json")
    found.set_facts({"scene": base, "generation": "now"})

    def add(name, generation="now", **changes):
        scene = make_scene(name="other", **changes).model_dump(mode="json")
        found.add(Row(name, "done", changes, scene, {"dsp": 1}, generation=generation))

    add("base")
    add("short", numbers={"data_bits": 20})
    add("shorter", numbers={"data_bits": 16})
    add("both", numbers={"data_bits": 16, "kernel_bits": 4})
    add("old", generation="before", numbers={"data_bits": 17})
    for bits in (8, 4):
        for epochs in (0, 3):
            numbers = {"weight_bits": bits, "activation_bits": bits}
            add(f"{bits}, {epochs}", numbers=numbers, training={"finetune_epochs": epochs})
    return found


def test_one_key_at_a_time(results):
    found = front.one_at_a_time(front.read(results.path))
    assert [(v, r.key) for v, r in found["numbers.data_bits"]] == [
        (16, "shorter"),
        (20, "short"),
        (26, "base"),
    ]
    assert [(v, r.key) for v, r in found["numbers.activation_bits"]] == [(7, "base"), (8, "8, 3")]
    assert set(found) == {"numbers.data_bits", "numbers.activation_bits"}


def test_fine_tuning_beside_none(results):
    found = front.tuned(front.read(results.path))
    assert [r.key for _, r in found] == ["8, 0", "8, 3", "4, 0", "4, 3"]
    assert found[0][0]["numbers.weight_bits"] == 8
    assert found[0][0]["training.finetune_epochs"] == 0


def test_a_scene_is_found_whatever_its_name(results, make_scene):
    rows = front.read(results.path).done
    assert [r.key for r in rows if front.is_scene(r, make_scene(name="mine"))] == ["base"]


def test_results_without_a_point(tmp_path):
    with pytest.raises(ResultsError, match="no such file"):
        front.read(tmp_path / "none.sqlite")
    Results(tmp_path / "r.sqlite").add(row("a", status="failed"))
    with pytest.raises(TradeError, match=r"r\.sqlite: no point is done"):
        front.read(tmp_path / "r.sqlite")


def test_each_point_once(results, tmp_path):
    both = [front.read(results.path), front.read(results.path)]
    assert len(front.distinct(both)) == len(both[0].done)


@pytest.mark.parametrize(
    ("facts", "scene", "confirmed", "message"),
    [
        ({"scene": 3}, {}, {}, "facts: scene"),
        ({"origins": []}, {}, {}, "facts: origins"),
        ({}, {"name": 3}, {}, "point a: scene: name"),
        ({}, {"sensor": {}}, {}, "point a: scene: sensor.geometry: missing"),
        ({}, {}, {"is_exact": True}, "confirmation a: mismatches: missing"),
    ],
)
def test_results_that_cannot_be_shown(tmp_path, tiny_scene, facts, scene, confirmed, message):
    whole = tiny_scene.model_dump(mode="json")
    found = Results(tmp_path / "r.sqlite")
    found.set_facts({"scene": whole, "generation": ""} | facts)
    found.add(row("a", scene=whole | scene, dsp=3))
    if confirmed:
        found.confirm("a", confirmed)
    with pytest.raises(ResultsError) as caught:
        front.read(found.path)
    assert str(caught.value).startswith(f"{found.path}: {message}")
