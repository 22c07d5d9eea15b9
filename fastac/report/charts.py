"""The charts of a build's page: force found against true force, and the learning curves."""

import numpy as np
from matplotlib.ticker import MaxNLocator

from fastac.models.result import Result
from fastac.models.training.force import ridge
from fastac.report.vector import drawing, inline_svg, readable_scale
from fastac.scenes.schema import AXES

SERIES = {"float": ("o", "#3f83c5"), "integer": ("x", "#e07b28")}
"""Marker and colour of each pipeline; readable on light and on dark pages."""
TITLES = {
    "normals": "pixel network, in floats",
    "sums": "pixel network, on whole frames",
    "force_alone": "pixel network, on the force alone",
    "finetune": "pixel network, in integers",
    "force": "force model",
    "force_float": "force, last fit for the floats",
    "force_integer": "force, last fit for the integers",
}
UNITS = {"loss": "error of unit normals, sum of components", "mae_n": "force error, sum of the axes, N"}
COLOURS = {"train": "#3f83c5", "validation": "#e07b28"}
OF_STEP = {"sums": "error of normals, depth and force together"}
"""What a curve shows where its `UNITS` would say something else."""
AGAINST = {("finetune", "train"): "train, against the floats' normals"}
"""Curves whose targets are not the true values."""
LINES = ("#e07b28", "#3f83c5", "#4a9d5b", "#a05fb4", "#8a6d4f", "#6f7b87")


def force_charts(truth_n: np.ndarray, found: dict[str, Result], force_axes: tuple[int, ...]) -> list[str]:
    """For each axis an SVG: force found against true force, below it the error in mN.

    truth_n : (frames, axes); found : results by pipeline, "float" and "integer"
    """
    charts = []
    for k, force_axis in enumerate(force_axes):
        name, truth = f"F_{AXES[force_axis]}", truth_n[:, k]
        with drawing(4, 5.2, rows=2, sharex=True, height_ratios=[2, 1]) as (figure, (upper, lower)):
            ends = 1.1 * min(truth.min(), 0), 1.1 * max(truth.max(), 0)
            upper.plot(ends, ends, "--", linewidth=0.8, color="#888888", label="found = true")
            lower.axhline(0, linestyle="--", linewidth=0.8, color="#888888")
            for pipeline, (marker, colour) in SERIES.items():
                value = found[pipeline].force_n[:, k]
                style = {"markersize": 4, "color": colour, "alpha": 0.7}
                upper.plot(truth, value, marker, label=pipeline, **style)
                lower.plot(truth, 1e3 * (value - truth), marker, **style)
            upper.set_ylabel(f"{name} found, N")
            upper.legend(loc="upper left")
            lower.set_ylabel("found − true, mN")
            lower.set_xlabel(f"true {name}, N")
            for axis in (upper.xaxis, upper.yaxis, lower.yaxis):
                axis.set_major_locator(MaxNLocator(5))
            figure.align_ylabels()
            charts.append(inline_svg(figure))
    return charts


def curve_charts(floats: dict[str, np.ndarray]) -> list[str]:
    """An SVG for each training step whose history a bundle's floats hold, in the order of training."""
    names = {key.split(".")[1] for key in floats if key.startswith("history.")}
    ordered = sorted(names, key=lambda name: (list(TITLES).index(name) if name in TITLES else 99, name))
    return [_curves(name, _of(floats, name)) for name in ordered]


def _of(floats: dict[str, np.ndarray], name: str) -> dict[str, np.ndarray]:
    start = f"history.{name}."
    return {key.removeprefix(start): values for key, values in floats.items() if key.startswith(start)}


def _curves(name: str, curves: dict[str, np.ndarray]) -> str:
    with drawing(4.2, 3) as (figure, axis):
        axis.set_title(TITLES.get(name, name.replace("_", " ")), loc="left")
        if "regularisation" in curves:
            _choice(axis, curves)
        else:
            _epochs(axis, curves, name)
        axis.legend()
        return inline_svg(figure)


def _epochs(axis, curves: dict[str, np.ndarray], name: str) -> None:
    """Training and validation error over the epochs; a ring marks the smallest validation error."""
    epochs = curves["epoch"]
    shown = {key: values for key, values in curves.items() if key != "epoch"}
    for key, values in shown.items():
        split = key.split("_")[0]
        label = AGAINST.get((name, split), split)
        axis.plot(epochs, values, label=label, color=COLOURS.get(split), linewidth=1.4)
        if split == "validation":
            best = int(np.nanargmin(values))
            label = f"smallest: {values[best]:.3g}, epoch {epochs[best]:.0f}"
            axis.plot(epochs[best], values[best], "o", color=COLOURS[split], fillstyle="none", label=label)
    every = np.concatenate(list(shown.values()))
    readable_scale(axis.yaxis, np.nanmin(every), np.nanmax(every))
    axis.xaxis.get_major_locator().set_params(integer=True, nbins=6)
    axis.set_xlabel("epoch")
    measure = next(iter(shown)).split("_", 1)[-1]
    axis.set_ylabel(OF_STEP.get(name) or UNITS.get(measure, measure.replace("_", " ")))


def _averaged(axis, curves: dict[str, np.ndarray]) -> None:
    """The error of each regularisation on recordings left out, a line for each basis; rings mark those whose
    weights are averaged (models/training/force/smooth_weights.py), and the legend says each one's share.

    Weights are called symmetric where press_symmetry.py beside it made them so.
    """
    strengths, errors, shares = (curves[key] for key in ("regularisation", "validation_mae_n", "share"))
    sizes = curves["cosines"]
    for k, size in enumerate(np.unique(sizes)):
        part = sizes == size
        ring = int(shares[part].argmax())
        axis.plot(
            strengths[part],
            errors[part],
            color=LINES[k % len(LINES)],
            marker="o",
            fillstyle="none",
            markevery=[ring],
            label=f"{size:.0f} cosines: {shares[part][ring]:.0%}",
        )
    kind = "symmetric weights'" if curves.get("symmetric", np.zeros(1))[0] else "weights'"
    axis.set_xlabel(f"strength of the regularisation, and shares of the {kind} average")
    axis.set_ylabel("force error, recordings left out, N")
    readable_scale(axis.xaxis, strengths.min(), strengths.max())
    readable_scale(axis.yaxis, errors.min(), errors.max())


def _choice(axis, curves: dict[str, np.ndarray]) -> None:
    """The validation error of each regularisation that ridge regression tried, a line for each basis.

    A ring marks the choice. Weights are called polynomials where
    models/training/force/polynomial_weights.py made them so.
    """
    if "share" in curves:
        _averaged(axis, curves)
        return
    strengths, errors = curves["regularisation"], curves["validation_mae_n"]
    sizes = curves.get("cosines", np.zeros(len(strengths)))
    for k, size in enumerate(np.unique(sizes)):
        part = sizes == size
        label = f"{size:.0f} cosines" if size else "validation"
        axis.plot(strengths[part], errors[part], ".-", label=label, color=LINES[k % len(LINES)])
    chosen, why = int(np.argmin(errors)), "smallest"
    if "standard_error_n" in curves:
        rows = [dict(zip(curves, values, strict=True)) for values in zip(*curves.values(), strict=True)]
        chosen, why = rows.index(ridge.strongest(rows)), "chosen, as good within chance"
    axis.plot(strengths[chosen], errors[chosen], "o", fillstyle="none", color="#888888", markersize=9)
    axis.lines[-1].set_label(f"{why}: {errors[chosen]:.3g} N at {strengths[chosen]:.1g}")
    kind = f", polynomials of degree {curves['degree'][0]:.0f}" if "degree" in curves else ""
    axis.set_xlabel(f"strength of the regularisation{kind}")
    axis.set_ylabel(UNITS["mae_n"])
    readable_scale(axis.xaxis, strengths.min(), strengths.max())
    readable_scale(axis.yaxis, errors.min(), errors.max())
