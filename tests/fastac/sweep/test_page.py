import json
import re

import pytest
from PIL import Image

from fastac.sweep import front, plots
from fastac.sweep import page as trade_page
from fastac.sweep.results import Results, Row


@pytest.fixture
def shown(make_scene, tmp_path):
    results = Results(tmp_path / "r.sqlite")
    base = make_scene().model_dump(mode="json")
    origins = {"lut": "estimated: by <hand>"}
    setting = {"split": "test", "frames": 5}
    results.set_facts({"scene": base, "generation": "now", "origins": origins, "setting": setting})

    def add(key, metrics, **changes):
        scene = make_scene(**changes).model_dump(mode="json")
        results.add(Row(key, "done", {"numbers.data_bits": changes}, scene, metrics, generation="now"))

    for k, bits in enumerate((26, 20, 16)):
        metrics = {"depth_mae_mm": 0.01 * (k + 1), "latency_cycles": 1000 // (k + 1) ** 2, "dsp": 100 + k}
        add(f"point{bits}", metrics | {"energy_uj": 3.5, "lut": 12345}, numbers={"data_bits": bits})
    for epochs in (0, 3):
        tuned = {"numbers": {"weight_bits": 4, "activation_bits": 4}, "training": {"finetune_epochs": epochs}}
        metrics = {"depth_mae_mm": 0.02, "latency_cycles": 1000, "dsp": 90, "energy_uj": 2.0, "lut": 999}
        add(f"epochs{epochs}", metrics, **tuned)
    results.add(Row("bad", "infeasible", {"a": 1}, None, error="cannot <be>", generation="now"))
    found = {"is_exact": True, "mismatches": 0, "values_compared": 1234, "cycles_counted": {"a": 5}}
    results.confirm("point20", found)
    source = front.read(results.path)
    return trade_page.Trade([source], source.done, {"tiny": source.done[0]})


def test_the_page_holds_everything(shown, tmp_path):
    files = trade_page.write(shown, tmp_path / "page")
    assert [path.name for path in files] == ["trade.html", "trade_depth_mae_mm.png"]
    page = files[0].read_text()
    assert not re.search(r"<(script|link)[^>]* (src|href)=", page)  # nothing is fetched
    for text in (
        "cannot &lt;be&gt;",
        "by &lt;hand&gt;",
        "scene tiny",
        "simulated",
        "its own sensor and board",
    ):
        assert text in page
    assert "163,500" in page
    assert "<span>least: depth error, mm</span><b>0.01</b>" in page
    assert page.index("headlines") < page.index("plotly") < page.index("<table>")
    with Image.open(files[1]) as image:
        assert image.format == "PNG"
        assert image.width > 1000


def traces(figure) -> dict:
    return {
        trace["name"]: trace
        for trace in json.loads(figure.to_json())["data"]
        if trace.get("showlegend", True)
    }


def test_what_the_figure_marks(shown):
    found = traces(trade_page.figure(shown, "depth_mae_mm"))
    assert set(found) == {"designs", "front", "confirmed in RTL", "scene tiny", trade_page.PAPER_LABEL}
    assert len(found["designs"]["x"]) == 5
    assert len(found["confirmed in RTL"]["x"]) == 1
    assert found[trade_page.PAPER_LABEL]["x"] == [163_500]
    assert found[trade_page.PAPER_LABEL]["y"] == [0.0741]


def test_logarithmic_axes_have_plain_labels():
    assert {"0.005", "0.01", "0.02", "0.05"} <= set(plots.ticks([0.004, 0.0, 0.07])["ticktext"])
    assert plots.ticks([0.0]) == {}


def table(shown, start: str):
    [found] = [t for t in trade_page.tables(shown) if t.title.startswith(start)]
    return found


def test_the_price_of_speed(shown):
    found = table(shown, "The price of speed: depth error, mm")
    assert [row[:4] for row in found.rows] == [
        ["1.0×", "0.01", "", "1,000"],
        ["4.0×", "0.02", "+100.0%", "250"],
        ["9.0×", "0.03", "+50.0%", "111"],
    ]


def test_designs_on_the_fronts_by_pace(shown, make_scene):
    """A folded design is on the front for its DSP slices, and comes first; a worse one at a pixel a clock is
    not."""
    [source] = shown.sources
    metrics = {"depth_mae_mm": 0.01, "latency_cycles": 5000, "dsp": 7, "energy_uj": 3.5, "lut": 500}
    metrics["last_pixel_to_force_cycles"] = 300
    folded = make_scene(hardware={"pixels_per_clock": "1/4"}).model_dump(mode="json")
    worse = metrics | {"latency_cycles": 9000}
    rows = [Row("folded", "done", {}, folded, metrics), Row("worse", "done", {}, folded, worse)]
    table = trade_page.paces_table(trade_page.Trade([source], [*shown.rows, *rows]))
    assert table.head[:3] == ["pixels a clock", "designs", "depth_mae_mm"]
    assert table.rows == [
        ["1/4", "1 of 2", "0.01", "300", "5,000", "7", "500", "", "3.5"],
        ["1", "4 of 5", "0.01", "", "111", "90", "999", "", "2"],
    ]


def test_fine_tuning_is_a_table(shown):
    found = table(shown, "Bit-true fine-tuning")
    assert [row[:4] for row in found.rows] == [
        ["4", "4", "12", "post-training"],
        ["4", "4", "12", "bit-true fine-tuning, 3 epochs"],
    ]


def test_confirmed_and_failed_designs_are_tables(shown):
    assert table(shown, "Designs confirmed in RTL").rows[0][:3] == ["point20", "exact", "0 of 1,234"]
    assert table(shown, "Designs that are infeasible").rows == [["infeasible", "a 1", "cannot <be>"]]


def test_values_that_are_lists_of_numbers_are_shown():
    assert trade_page.named(Row("a", "done", {"protocol.loads_n": [0.5, 1.0]}, None)) == "loads_n 0.5+1.0"
