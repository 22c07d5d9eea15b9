"""Charts as SVG: axes with units, scales that suit the values, nothing that is fetched."""

import re
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from fastac.report import charts
from fastac.report.vector import drawing, inline_svg, readable_scale

EPOCHS = np.arange(1, 31)
CURVES = {
    "history.normals.epoch": EPOCHS,
    "history.normals.train_loss": 1.0 / EPOCHS**2,
    "history.normals.validation_loss": 1.1 / EPOCHS**2 + 1e-4 * EPOCHS,
    "history.force_integer.regularisation": 10.0 ** np.arange(-9, 1),
    "history.force_integer.validation_mae_n": np.array([5, 4, 3, 2, 1, 2, 3, 4, 5, 6.0]),
    "network.weight": np.zeros(3),
}


def texts(svg: str) -> list[str]:
    return re.findall(r"<text[^>]*>([^<]*)</text>", svg)


def test_a_curve_has_units_a_legend_and_its_best_epoch():
    normals, force = charts.curve_charts(CURVES)
    found = texts(normals)
    of_normals = "error of unit normals, sum of components"
    assert {"pixel network, in floats", "epoch", of_normals, "train", "validation"} <= set(found)
    best = int(np.argmin(CURVES["history.normals.validation_loss"]))
    assert f"smallest: {CURVES['history.normals.validation_loss'][best]:.3g}, epoch {best + 1}" in found
    found = texts(force)
    assert {
        "force error, sum of the axes, N",
        "strength of the regularisation",
        "smallest: 1 N at 1e-05",
    } <= set(found)
    assert "10⁻⁶" in found


def test_where_chance_explains_what_is_smallest_the_ring_is_around_the_choice():
    chance = {"history.force_integer.standard_error_n": np.full(10, 1.2)}
    found = texts(charts.curve_charts(CURVES | chance)[1])
    assert "chosen, as good within chance: 2 N at 0.0001" in found


def test_averaged_weights_say_their_shares():
    share = np.zeros(10)
    share[[1, 4, 7]] = 0.2, 0.7, 0.1
    averaged = {
        "history.force_integer.share": share,
        "history.force_integer.cosines": np.repeat([4, 6, 8], [3, 3, 4]),
    }
    for symmetric, kind in ((True, "symmetric weights'"), (False, "weights'")):
        curves = CURVES | averaged | {"history.force_integer.symmetric": np.full(10, symmetric)}
        found = texts(charts.curve_charts(curves)[1])
        assert {"4 cosines: 20%", "6 cosines: 70%", "8 cosines: 10%"} <= set(found)
        assert f"strength of the regularisation, and shares of the {kind} average" in found
        assert "force error, recordings left out, N" in found


def test_polynomials_say_their_degree():
    curves = CURVES | {"history.force_integer.degree": np.full(10, 4)}
    found = texts(charts.curve_charts(curves)[1])
    assert "strength of the regularisation, polynomials of degree 4" in found


def test_fine_tuning_says_what_it_is_against():
    curves = {key.replace("normals", "finetune"): value for key, value in CURVES.items()}
    assert "train, against the floats' normals".replace("'", "'") in texts(charts.curve_charts(curves)[0])


def test_no_history_no_chart():
    assert charts.curve_charts({"network.weight": np.zeros(3)}) == []


def test_force_found_against_true_force_for_each_axis():
    truth = np.array([[0.1, 1.0], [0.2, 2.0]])
    found = {name: SimpleNamespace(force_n=truth + 0.01) for name in ("float", "integer")}
    shown = charts.force_charts(truth, found, (0, 2))
    assert len(shown) == 2
    assert {"true F_x, N", "F_x found, N", "found − true, mN", "float", "integer"} <= set(texts(shown[0]))
    assert "true F_z, N" in texts(shown[1])


@pytest.mark.parametrize(
    ("low", "high", "scale", "labels"),
    [
        (0.02, 0.09, "linear", None),
        (0.0, 100.0, "linear", None),
        (0.02, 0.9, "log", ["0.02", "0.05", "0.1", "0.2", "0.5"]),
        (1e-9, 1.0, "log", ["10⁻⁸", "10⁻⁶", "10⁻⁴", "0.01", "1"]),
    ],
)
def test_scales_have_few_plain_labels(low, high, scale, labels):
    with drawing(4, 3) as (figure, axis):
        axis.plot([1, 2], [low, high])
        axis.set_ylim(low or None, high)
        readable_scale(axis.yaxis, low, high)
        axis.set_ylim(low or None, high)
        figure.draw_without_rendering()
        assert axis.get_yscale() == scale
        inside = [
            tick.label1.get_text()
            for tick in axis.yaxis.get_major_ticks()
            if low * 0.999 <= tick.get_loc() <= high * 1.001
        ]
        assert 3 <= len(inside) <= 10
        if labels:
            assert inside == labels
        assert not axis.yaxis.get_minorticklocs().size


def test_an_svg_takes_the_page_s_colour_and_fetches_nothing():
    with drawing(2, 2) as (figure, axis):
        axis.plot([1, 2], marker="o", label="a < b")
        axis.legend()
        svg = inline_svg(figure)
    assert svg.startswith("<svg")
    assert svg.endswith("</svg>")
    assert "currentColor" in svg
    assert "a &lt; b" in svg
    assert "http" not in svg
    assert not re.search(r"href=\"[^#]", svg)
    assert not plt.get_fignums()
