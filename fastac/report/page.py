"""Writes report.json and the page report.html of a finished build."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from fastac.models import accuracy
from fastac.models.integer.bundle import Bundle
from fastac.report.content import content, summary_rows
from fastac.report.figures import base64_png
from fastac.report.picture import draw_cycles, rgb
from fastac.report.render import render
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.store.files import write_json, write_text


def frames_figure(data: Dataset, index: np.ndarray, results: dict, scene: Scene) -> str:
    """A row of panels for each frame: input, NIR, normals, depth, displacement, depth error, force map."""
    rows = []
    for k, sample in enumerate(index):
        frame = data.frames[sample]
        panels = [("input (RGB)", rgb(frame), {})]
        if frame.shape[-1] == 4:
            panels.append(("NIR", frame[..., 3], {"cmap": "gray", "vmin": 0, "vmax": 255}))
        found = results["integer"]
        if scene.training.labels == "geometry":  # of forces alone it learns no normals that mean anything
            panels.append(("normals, integer", (found.normals[k] + 1) / 2, {}))
        if found.depth_mm is not None:
            panels.append(("depth, integer, mm", found.depth_mm[k], {"cmap": "viridis"}))
            panels.append(("displacement, mm", found.displacement_mm[k], {"cmap": "magma"}))
            if data.depth_mm is not None:
                error = found.depth_mm[k] - data.depth_mm[sample]
                panels.append(("depth error, mm", error, {"cmap": "coolwarm"}))
        if found.force_map_n is not None:
            for axis, image in zip(scene.force_axes, found.force_map_n[k], strict=True):
                panels.append((f"F_{'xyz'[axis]} map, N", image, {"cmap": "coolwarm"}))
        rows.append(panels)
    figure = Figure(figsize=(2.6 * len(rows[0]), 2.5 * len(rows)))
    axes = figure.subplots(len(rows), len(rows[0]), squeeze=False)
    for k, panels in enumerate(rows):
        for axis, (title, image, style) in zip(axes[k], panels, strict=True):
            shown = axis.imshow(image, **style)
            axis.set_title(f"frame {index[k]}: {title}", fontsize=7)
            axis.set_xticks([])
            axis.set_yticks([])
            if "mm" in title or title.endswith("N"):
                figure.colorbar(shown, ax=axis, shrink=0.75).ax.tick_params(labelsize=6)
    return base64_png(figure)


def force_figure(data: Dataset, index: np.ndarray, results: dict, force_axes: tuple[int, ...]) -> str:
    """Force found against true force, a panel for each axis."""
    figure = Figure(figsize=(4 * len(force_axes), 4))
    panels = figure.subplots(1, len(force_axes), squeeze=False)
    for k, (panel, force_axis) in enumerate(zip(panels[0], force_axes, strict=True)):
        truth = data.forces_n(index, (force_axis,))[:, 0]
        for name, marker in (("float", "o"), ("integer", "x")):
            panel.plot(truth, results[name].force_n[:, k], marker, markersize=4, label=name, alpha=0.6)
        ends = 1.15 * min(truth.min(), 0), 1.15 * max(truth.max(), 0)
        panel.plot(ends, ends, "k--", linewidth=0.8)
        panel.set_xlabel(f"true F_{'xyz'[force_axis]}, N")
        panel.set_ylabel(f"found F_{'xyz'[force_axis]}, N")
    panels[0, 0].legend()
    return base64_png(figure)


def cycles_figure(report: dict) -> str:
    """The clock cycles of each stage."""
    figure = Figure(figsize=(8, 1.8))
    axis = figure.subplots()
    draw_cycles(axis, report["latency_cycles_by_formula"]["stage"])
    axis.legend(fontsize=6, ncol=4, loc="upper center", bbox_to_anchor=(0.5, -0.35))
    return base64_png(figure)


def curves_figure(bundle: Bundle) -> str:
    """Learning curves of every training step."""
    names = sorted({key.split(".")[1] for key in bundle.floats if key.startswith("history.")})
    figure = Figure(figsize=(4 * max(len(names), 1), 3))
    axes = figure.subplots(1, max(len(names), 1), squeeze=False)
    for axis, name in zip(axes[0], names, strict=False):
        curves = {
            key.removeprefix(f"history.{name}."): values
            for key, values in bundle.floats.items()
            if key.startswith(f"history.{name}.")
        }
        axis.set_title(name, fontsize=9)
        if "regularisation" in curves:
            _choice(axis, curves)
        else:
            epochs = curves.pop("epoch")
            for key, values in curves.items():
                axis.semilogy(epochs, values, label=key)
            axis.set_xlabel("epoch")
        axis.legend(fontsize=7)
    return base64_png(figure)


def _choice(axis, curves: dict[str, np.ndarray]) -> None:
    """The validation error of each regularisation that ridge regression tried, a line for each basis."""
    sizes = curves.get("cosines", np.zeros(len(curves["regularisation"])))
    for size in np.unique(sizes):
        part = sizes == size
        label = f"{size:.0f} cosines" if size else "validation"
        axis.loglog(curves["regularisation"][part], curves["validation_mae_n"][part], label=label)
    axis.set_xlabel("regularisation")
    axis.set_ylabel("validation MAE, sum of the axes, N")


def write(folder: Path, bundle: Bundle, data: Dataset) -> None:
    """Write report.json and report.html into the build folder."""
    report = content(folder, bundle)
    shown = np.array(report["rtl_vs_integer"]["frame_indices"])
    axes = bundle.scene.force_axes
    _, results = accuracy.compare_pipelines(bundle, data, shown, progress=False)
    figures = [
        ("The frames that went through the hardware", frames_figure(data, shown, results, bundle.scene)),
        ("Where the cycles go", cycles_figure(report)),
        ("Training", curves_figure(bundle)),
    ]
    if bundle.scene.wants_force:
        index = data.indices("test")
        _, everything = accuracy.compare_pipelines(bundle, data, index, progress=False)
        figures.insert(1, ("Force on the held-out grid", force_figure(data, index, everything, axes)))
    page = render("report/build.html.j2", report=report, figures=figures, rows=summary_rows(report))
    write_json(folder / "report.json", report)
    write_text(folder / "report.html", page)
