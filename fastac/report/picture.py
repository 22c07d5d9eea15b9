"""One picture of a finished build: a frame, what the integers find in it, and where the hardware's cycles go.

`fastac report FOLDER --picture FILE` draws it from the folder's report.json; the README shows that of scene
`paper`.
"""

from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from fastac.models import accuracy
from fastac.models.integer.bundle import Bundle
from fastac.report import timeline
from fastac.report.panels import panels
from fastac.report.timeline_chart import draw
from fastac.scenes.schema import AXES
from fastac.sensor.dataset import Dataset
from fastac.store.files import write_atomically

DPI = 100
UPPER_IN = 3.0
"""Height of the frame's images, in inches."""


def draw_force(axis, truth_n: np.ndarray, found_n: np.ndarray, shown: int, axis_name: str) -> None:
    """Force found against true force, (frames,) each in N, as points around the diagonal.

    shown : the place of the frame whose images stand beside; its point is marked
    """
    axis.plot(truth_n, found_n, ".", markersize=4, alpha=0.6)
    axis.plot(truth_n[shown], found_n[shown], "r*", markersize=9)
    ends = 1.15 * min(truth_n.min(), 0), 1.15 * max(truth_n.max(), 0)
    axis.plot(ends, ends, "k--", linewidth=0.8)
    axis.set_xlabel(f"true F_{axis_name}, N", fontsize=8)
    axis.set_title(f"F_{axis_name} found, N (★ this frame)", fontsize=9)
    axis.set_box_aspect(1)
    axis.set_anchor("N")


def write(path: Path, bundle: Bundle, data: Dataset, report: dict) -> None:
    """Draw a held-out frame that went through the simulated hardware into `path` (.png, .svg or .pdf).

    report : the content of the build's report.json. Of its frames it is that of the largest force, where
        forces are known. Beside it are the forces of all held-out frames, the integers' against the true.
    """
    scene = bundle.scene
    shown, held_out = np.array(report["rtl_vs_integer"]["frame_indices"]), data.indices("test")
    with_force = scene.wants_force and data.has_force(scene.force_axes)
    sample = shown[0]
    if with_force:
        sample = shown[np.abs(data.forces_n(shown, scene.force_axes)).max(axis=1).argmax()]
    emulator = accuracy.with_background_of(bundle.pipeline, data)
    shown_panels = panels(data, sample, emulator.run(data.frames[[sample]]), scene)
    stages = timeline.of_scene(scene, report["latency_cycles_by_formula"])
    count = len(shown_panels) + (len(scene.force_axes) if with_force else 0)
    below = 0.17 * len(stages) + 0.9
    figure = Figure(figsize=(2.3 * count, UPPER_IN + below), layout="constrained")
    upper, lower = figure.subfigures(2, height_ratios=[UPPER_IN, below])
    grid = upper.add_gridspec(1, count)
    for k, panel in enumerate(shown_panels):
        axis = upper.add_subplot(grid[k])
        axis.imshow(panel.pixels)
        axis.set_title(f"{panel.title}, {panel.unit}" if panel.unit else panel.title, fontsize=9)
        axis.set_axis_off()
        axis.set_anchor("N")
        if panel.unit:
            colours = ScalarMappable(Normalize(*panel.ends), panel.colours)
            bar = upper.colorbar(colours, ax=axis, shrink=0.9, pad=0.02, location="bottom", panchor=(0.5, 1))
            bar.ax.tick_params(labelsize=7)
    if with_force:
        truth = data.forces_n(held_out, scene.force_axes)
        found = emulator.run(data.frames[held_out], wanted=["force_n"]).force_n
        place = int(np.flatnonzero(held_out == sample)[0])
        for k, force_axis in enumerate(scene.force_axes):
            axis = upper.add_subplot(grid[len(shown_panels) + k])
            draw_force(axis, truth[:, k], found[:, k], place, AXES[force_axis])
            axis.tick_params(labelsize=7)
    axis = lower.add_subplot()
    draw(axis, stages)
    axis.xaxis.label.set_fontsize(8)
    axis.tick_params(axis="x", labelsize=7)
    axis.set_title(heading(report), fontsize=9)
    with write_atomically(path) as temporary:
        figure.savefig(temporary, dpi=DPI)


def heading(report: dict) -> str:
    """What the simulation of the hardware counted, in one line."""
    rtl, latency = report["rtl_vs_integer"], report["latency_cycles"]
    parts = [
        f"hardware against integers: {rtl['mismatches']} mismatches in {rtl['values_compared']:,} values"
    ]
    for key, label in (
        ("first_pixel_to_force", "first pixel → force"),
        ("first_pixel_to_depth", "first pixel → last depth"),
        ("initiation_interval", "a new frame every"),
    ):
        if key in latency:
            parts.append(f"{label}: {latency[key]:,} cycles")
    return "; ".join(parts)
