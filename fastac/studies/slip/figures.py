"""Figure of the study of slip: the spread of the dots in contact against the share of nodes that stick."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D

from fastac.report.figures import save_png
from fastac.studies.slip.measurement import MOST_STICK, DragRecord

COLUMNS = 2


def spreads(by_object: Mapping[str, Sequence[DragRecord]], content: dict, path: Path) -> None:
    """A panel per object: the integers' spread as lines, one a drag, and the true shifts' as points.

    States with too few dots in contact have no spread and are not shown. `content` is that of slip.json.
    """
    loads = sorted({one.drag.load_n for records in by_object.values() for one in records})
    frictions = sorted({one.drag.friction for records in by_object.values() for one in records}, reverse=True)
    rows = -(-len(by_object) // COLUMNS)
    figure, grid = plt.subplots(
        rows, COLUMNS, figsize=(5.2 * COLUMNS, 3.8 * rows), squeeze=False, sharex=True, layout="constrained"
    )
    for panel in grid.flat[len(by_object) :]:
        panel.set_visible(False)
    for panel, (name, records) in zip(grid.flat, by_object.items(), strict=False):
        for one in records:
            colour, line = f"C{loads.index(one.drag.load_n)}", "-:"[frictions.index(one.drag.friction)]
            sticking, seen, true = (
                np.where(one.known, values, np.nan)
                for values in (100 * one.sticking, one.slip_px, one.true_slip_px)
            )
            panel.plot(sticking, seen, color=colour, linestyle=line, linewidth=1)
            panel.plot(sticking, true, ".", color=colour, markersize=3, alpha=0.5)
        panel.axhline(content["limit_px"], color="k", linestyle="--", linewidth=0.9)
        best = content["all"]["integers"]["best_limit"]
        if best is not None:
            panel.axhline(best, color="k", linestyle="-.", linewidth=0.9)
        panel.axvline(100 * MOST_STICK, color="0.6", linewidth=0.8)
        panel.set_title(name, fontsize=10)
        panel.set_ylabel("spread, px")
        panel.set_ylim(bottom=0)
    grid[0, 0].set_xlim(102, -2)
    for panel in grid[-1]:
        panel.set_xlabel("nodes in contact that stick, %")
    keys = [
        *(Line2D([], [], color=f"C{k}", label=f"F_z = {load:g} N") for k, load in enumerate(loads)),
        *(
            Line2D([], [], color="0.3", linestyle=line, label=f"friction {friction:g}")
            for line, friction in zip("-:", frictions, strict=False)
        ),
        Line2D([], [], color="0.3", linestyle="", marker=".", label="true shifts"),
        Line2D([], [], color="k", linestyle="--", linewidth=0.9, label="slip.limit_px"),
        Line2D([], [], color="k", linestyle="-.", linewidth=0.9, label="best limit"),
    ]
    grid[0, 0].legend(handles=keys, loc="upper left", fontsize=7)
    figure.suptitle(
        f"{content['scene']}: objects pulled along x until nearly all nodes slide; simulated", fontsize=9
    )
    save_png(figure, path)
