"""Reconstructed test objects to look at: a PNG for each, and one page with point clouds to turn.

The page holds its own script and needs no network.
"""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from fastac.objects import Shown
from sensor.geometry import pixel_centres_mm, rest_depth_mm

ARROWS = 400
"""Arrows of force that are drawn, at most: those of the pixels with the largest forces on a coarser grid."""


def _step(count: int) -> int:
    """Every so many pixels along each axis, so that about ARROWS are left."""
    return max(int(np.ceil(np.sqrt(count / ARROWS))), 1)


def arrows(item: Shown) -> tuple[np.ndarray, np.ndarray]:
    """Feet (n, 3) in mm on the pressed skin and forces (n, 3) in N: of squares of pixels, summed."""
    force, depth = item.truth.force_map_n, item.truth.pressed.depth_mm
    x, y = pixel_centres_mm(item.sensor)
    step = _step(int(item.truth.pressed.touching.sum()))
    height, width = (n // step * step for n in depth.shape)

    def squares(image: np.ndarray) -> np.ndarray:
        cut = image[:height, :width]
        return cut.reshape(height // step, step, width // step, step, *image.shape[2:]).swapaxes(1, 2)

    total = squares(force).sum(axis=(2, 3))
    feet = np.stack([squares(image).mean(axis=(2, 3)) for image in (x, y, depth)], axis=-1)
    loaded = total[..., 2] > 0
    return feet[loaded], total[loaded]


def _mm_per_n(item: Shown, force: np.ndarray) -> float:
    """Scale of the arrows: the longest is an eighth of the image."""
    return item.sensor.width_px * item.sensor.pitch_mm / 8 / np.linalg.norm(force, axis=1).max()


def draw(item: Shown, path: Path) -> None:
    """A PNG: of truth and of each bundle input, normals, displacement, its error, point cloud; and forces."""
    rest, truth = rest_depth_mm(item.sensor), item.truth.pressed
    rows = [("truth", None, truth.normals, truth.depth_mm)]
    for name, found in item.found.items():
        rows.append((name, found.frame, found.result.normals[0], found.result.depth_mm[0]))
    figure = plt.figure(figsize=(15, 3.1 * len(rows)))
    x, y = pixel_centres_mm(item.sensor)
    limit = (rest - truth.depth_mm).max()
    for row, (name, frame, normals, depth) in enumerate(rows):
        panels = [
            ("input (RGB)", None if frame is None else frame[..., 2::-1], {}),
            ("normals", (normals + 1) / 2, {}),
            ("displacement, mm", rest - depth, {"cmap": "magma", "vmin": 0, "vmax": limit}),
            (
                "depth error, mm",
                depth - truth.depth_mm,
                {"cmap": "coolwarm", "vmin": -limit / 4, "vmax": limit / 4},
            ),
        ]
        for column, (label, image, style) in enumerate(panels):
            if image is None or (row == 0 and label.startswith("depth error")):
                continue
            axis = figure.add_subplot(len(rows), 5, 5 * row + column + 1)
            shown = axis.imshow(np.clip(image, 0, 1) if label == "normals" else image, **style)
            axis.set_title(f"{name}: {label}", fontsize=7)
            axis.axis("off")
            if "mm" in label:
                figure.colorbar(shown, ax=axis, shrink=0.75).ax.tick_params(labelsize=6)
        axis = figure.add_subplot(len(rows), 5, 5 * row + 5, projection="3d")
        axis.scatter(x[::2, ::2], y[::2, ::2], depth[::2, ::2], c=(rest - depth)[::2, ::2], s=1, cmap="magma")
        axis.set_title(f"{name}: point cloud, mm" + (", force" if row == 0 else ""), fontsize=7)
        axis.tick_params(labelsize=5)
        if row == 0:
            feet, force = arrows(item)
            axis.quiver(*feet.T, *(force * _mm_per_n(item, force)).T, color="tab:blue", linewidth=0.6)
    figure.suptitle(f"{item.name}, {truth.pose['load_n']:g} N, simulated", fontsize=9)
    figure.savefig(path, dpi=110, bbox_inches="tight")
    plt.close(figure)


def _cloud(item: Shown, depth: np.ndarray) -> go.Scatter3d:
    x, y = pixel_centres_mm(item.sensor)
    sunk = rest_depth_mm(item.sensor) - depth
    style = {"size": 1.8, "color": sunk.ravel(), "colorscale": "Magma", "cmin": 0}
    return go.Scatter3d(x=x.ravel(), y=y.ravel(), z=depth.ravel(), mode="markers", marker=style)


def _forces(item: Shown) -> tuple[go.Surface, go.Cone]:
    """The pressed skin, coloured by the force on it, and the force's three axes as cones."""
    x, y = pixel_centres_mm(item.sensor)
    size = np.linalg.norm(item.truth.force_map_n, axis=-1) * 1e3
    skin = go.Surface(
        x=x, y=y, z=item.truth.pressed.depth_mm, surfacecolor=size, colorscale="Viridis", showscale=False
    )
    feet, force = arrows(item)
    cones = dict(zip("xyzuvw", (*feet.T, *force.T), strict=True))
    return skin, go.Cone(**cones, anchor="tail", colorscale="Blues", showscale=False, sizemode="scaled")


def page(shown: list[Shown]) -> str:
    """HTML: for each object the true and every found point cloud, and the force on the curved surface."""
    parts = []
    for item in shown:
        depths = {"truth": item.truth.pressed.depth_mm}
        depths |= {name: found.result.depth_mm[0] for name, found in item.found.items()}
        titles = [f"{name}: depth, mm" for name in depths] + ["three-axis force on the skin"]
        specs = [[{"type": "scene"}] * len(titles)]
        figure = make_subplots(rows=1, cols=len(titles), specs=specs, subplot_titles=titles)
        for column, depth in enumerate(depths.values(), start=1):
            figure.add_trace(_cloud(item, depth), row=1, col=column)
        for trace in _forces(item):
            figure.add_trace(trace, row=1, col=len(titles))
        figure.update_scenes(aspectmode="data")
        load = item.truth.pressed.pose["load_n"]
        figure.update_layout(title=f"{item.name}, {load:g} N, simulated", showlegend=False, height=480)
        parts.append(figure.to_html(full_html=False, include_plotlyjs=not parts))
    style = "<style>body { font-family: sans-serif; margin: 2em; }</style>"
    body = "\n".join(parts)
    return (
        f"<!doctype html><meta charset='utf-8'><title>Test objects</title>{style}<h1>Test objects</h1>{body}"
    )
