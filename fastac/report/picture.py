"""One picture of a finished build: a frame, what the integers find in it, and where the hardware's cycles go.

`fastac report FOLDER --picture FILE` draws it from the folder's report.json; the README shows that of scene
`paper`.
"""

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from fastac.models import accuracy
from fastac.models.integer.bundle import Bundle
from fastac.models.result import Result
from fastac.scenes.schema import AXES
from fastac.sensor.dataset import Dataset
from fastac.store.files import write_atomically

DPI = 100


def rgb(frame: np.ndarray) -> np.ndarray:
    """A frame (H, W, 3 or 4) in B, G, R[, NIR] as an RGB picture (H, W, 3)."""
    return frame[..., 2::-1]


def draw_cycles(axis, stages: dict[str, int]) -> None:
    """Each stage's clock cycles one after the other as one bar on a Matplotlib axis."""
    left = 0
    for k, (name, cycles) in enumerate(stages.items()):
        axis.barh(0, cycles, left=left, color=colormaps["tab20"](k), label=f"{name}: {cycles:,}")
        left += cycles
    axis.set_xlim(0, left)
    axis.set_yticks([])
    axis.xaxis.set_major_formatter("{x:,.0f}")
    axis.set_xlabel("clock cycles from the first pixel")


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


def images(data: Dataset, sample: int, found: Result, labels: str) -> list[tuple[str, np.ndarray, dict]]:
    """Title, image and Matplotlib's keywords of each panel of frame `sample`, the only one in `found`.

    labels : the scene's `training.labels`; a network that has learned from forces alone finds no normals
    """
    frame = data.frames[sample]
    panels = [("input (RGB)", rgb(frame), {})]
    if frame.shape[-1] == 4:
        panels.append(("NIR", frame[..., 3], {"cmap": "gray", "vmin": 0, "vmax": 255}))
    if labels == "geometry":
        panels.append(("normals", (found.normals[0] + 1) / 2, {}))
    if found.depth_mm is not None:
        panels.append(("depth, mm", found.depth_mm[0], {"cmap": "viridis"}))
        panels.append(("displacement, mm", found.displacement_mm[0], {"cmap": "magma"}))
    return panels


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
    panels = images(data, sample, emulator.run(data.frames[[sample]]), scene.training.labels)
    count = len(panels) + (len(scene.force_axes) if with_force else 0)
    figure = Figure(figsize=(2.3 * count, 4.4), layout="constrained")
    grid = figure.add_gridspec(2, count, height_ratios=[5, 1])
    for k, (title, image, style) in enumerate(panels):
        axis = figure.add_subplot(grid[0, k])
        drawn = axis.imshow(image, **style)
        axis.set_title(title, fontsize=9)
        axis.set_axis_off()
        axis.set_anchor("N")
        if title.endswith("mm"):
            bar = figure.colorbar(drawn, ax=axis, shrink=0.9, pad=0.02, location="bottom", panchor=(0.5, 1))
            bar.ax.tick_params(labelsize=7)
    if with_force:
        truth = data.forces_n(held_out, scene.force_axes)
        found = emulator.run(data.frames[held_out], wanted=["force_n"]).force_n
        place = int(np.flatnonzero(held_out == sample)[0])
        for k, force_axis in enumerate(scene.force_axes):
            axis = figure.add_subplot(grid[0, len(panels) + k])
            draw_force(axis, truth[:, k], found[:, k], place, AXES[force_axis])
            axis.tick_params(labelsize=7)
    axis = figure.add_subplot(grid[1, :])
    draw_cycles(axis, report["latency_cycles_by_formula"]["stage"])
    axis.xaxis.label.set_fontsize(8)
    axis.tick_params(labelsize=7)
    figure.legend(*axis.get_legend_handles_labels(), fontsize=7, ncol=6, loc="outside lower center")
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
