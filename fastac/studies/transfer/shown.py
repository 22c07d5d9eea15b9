"""What the study of second units found, as a table and as a picture."""

from pathlib import Path

import matplotlib
import numpy as np

from fastac.report.figures import save_png
from fastac.report.tables import Table, mean_and_spread
from fastac.studies.transfer.study import AS_IS, METRICS, WAYS

matplotlib.use("Agg")
import matplotlib.pyplot as plt

COLOURS = ("#777777", "#3f83c5", "#4a9d5b", "#a05fb4", "#e07b28", "#8a6d4f")
"""Of the ways, in their order."""


def values(content: dict, way: str, count: int, metric: str) -> np.ndarray:
    """An error of each unit that has it, (units,); the network as it is knows no number of presses."""
    key = "0" if way == AS_IS else str(count)
    found = [of_unit[way].get(key, {}).get(metric) for of_unit in content["errors"].values()]
    return np.array([value for value in found if value is not None])


def metrics_of(content: dict) -> list[str]:
    """The errors that there are, in the order of METRICS."""
    every = [
        errors
        for ways in content["errors"].values()
        for counts in ways.values()
        for errors in counts.values()
    ]
    return [name for name in METRICS if any(name in errors for errors in every)]


def tables(content: dict) -> list[Table]:
    """A table for each error: a row for each way, a column for each number of presses."""
    found = []
    for metric in metrics_of(content):
        rows = []
        for way in WAYS:
            cells = []
            for count in content["counts"]:
                each = values(content, way, count, metric)
                cells.append(mean_and_spread(each) if len(each) else "")
            rows.append([way, *cells])
        head = ["", *(f"{count} press{'es' if count > 1 else ''}" for count in content["counts"])]
        note = f"Integers; mean and standard deviation over {content['units']} simulated units."
        found.append(Table(METRICS[metric], head, rows, note))
    return found


def write(content: dict, path: Path) -> None:
    """Write the picture: a plot for each error, its curves the ways over the number of presses."""
    metrics = metrics_of(content)
    figure, axes = plt.subplots(1, len(metrics), figsize=(4.2 * len(metrics), 3.4), squeeze=False)
    for metric, axis in zip(metrics, axes[0], strict=True):
        for way, colour in zip(WAYS, COLOURS, strict=True):
            known = [c for c in content["counts"] if len(values(content, way, c, metric))]
            means = [values(content, way, c, metric).mean() for c in known]
            style = "--" if way == AS_IS else "o-"
            axis.plot(known, means, style, color=colour, label=way, markersize=4, linewidth=1.2)
            if way != AS_IS:
                for c in known:
                    each = values(content, way, c, metric)
                    axis.plot([c] * len(each), each, ".", color=colour, alpha=0.4, markersize=3)
        axis.set(xscale="log", yscale="log", xlabel="presses of the second unit", ylabel=METRICS[metric])
        axis.set_xticks(content["counts"], [str(c) for c in content["counts"]])
        axis.minorticks_off()
        axis.grid(alpha=0.2)
    axes[0][0].legend(fontsize=7)
    figure.tight_layout()
    save_png(figure, path)
    plt.close(figure)
