"""The errors over the number of presses, as a table and as a picture."""

from pathlib import Path

import matplotlib
import numpy as np

from fastac.report.figures import save_png
from fastac.report.tables import Table, mean_and_spread
from fastac.tune.page import labelled

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def values(content: dict, count: int, metric: str) -> np.ndarray:
    """An error of each draw of so many presses, (draws,)."""
    return np.array([errors[metric] for errors in content["errors"][str(count)]])


def metrics_of(content: dict) -> list[str]:
    """The errors that there are."""
    return list(content["errors"][str(content["counts"][0])][0])


def table(content: dict) -> Table:
    """A row for each number of presses, a column for each error."""
    metrics, rows = metrics_of(content), []
    for count in content["counts"]:
        each = [values(content, count, metric) for metric in metrics]
        rows.append([count, *map(mean_and_spread, each)])
    note = (
        f"Floats, on the others of {content['units']}; mean and standard deviation over {content['draws']}"
        " choices, each with a seed of its own."
    )
    return Table("Errors by presses learned from", ["presses", *map(labelled, metrics)], rows, note)


def write(content: dict, path: Path) -> None:
    """Write the picture: a plot for each error, with all choices as dots and their mean as a line."""
    metrics, counts = metrics_of(content), content["counts"]
    figure, axes = plt.subplots(1, len(metrics), figsize=(4.2 * len(metrics), 3.4), squeeze=False)
    for metric, axis in zip(metrics, axes[0], strict=True):
        each = [values(content, count, metric) for count in counts]
        axis.plot(counts, [e.mean() for e in each], "o-", color="#3f83c5", markersize=4, linewidth=1.2)
        for count, e in zip(counts, each, strict=True):
            axis.plot([count] * len(e), e, ".", color="#3f83c5", alpha=0.4)
        axis.set(xscale="log", xlabel="presses learned from", ylabel=labelled(metric), ylim=(0, None))
        axis.set_xticks(counts, [str(count) for count in counts])
        axis.minorticks_off()
        axis.grid(alpha=0.2)
    figure.tight_layout()
    save_png(figure, path)
    plt.close(figure)
