"""Figures of reconstructed test objects: a PNG per object, and one HTML page with rotatable point clouds.

The page embeds its script and needs no network.
"""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from fastac.report.figures import save_png
from fastac.report.plotly_look import LAYOUT, SPACE_AXIS, config
from fastac.report.render import render
from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import pixel_centres_mm, rest_depth_mm
from fastac.studies.demos.reconstruction import ObjectResult

CONFIG = config("toImage", "orbitRotation", "zoom3d", "pan3d", "resetCameraDefault3d")
EYE = {"x": 1.9, "y": -2.7, "z": 2.3}
"""Where the camera stands first, so that the whole skin is in view."""
ARROWS = 400
"""About the largest number of force arrows in a plot: each stands for a square of pixels."""
LONGEST = 8
"""The longest arrow is 1/LONGEST of the image's width."""


def _step(count: int) -> int:
    """Side in pixels of the squares that reduce `count` loaded pixels to about ARROWS."""
    return max(int(np.ceil(np.sqrt(count / ARROWS))), 1)


def arrows(force_n: np.ndarray, depth_mm: np.ndarray, sensor: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """Arrows of a force map (H, W, 3) in N: their feet (n, 3) in mm on the skin, their forces (n, 3).

    The map is summed over squares of pixels; squares without normal force get no arrow.
    """
    x, y = pixel_centres_mm(sensor)
    step = _step(int((force_n[..., 2] > 0).sum()))
    beyond = [(0, -size % step) for size in depth_mm.shape]
    blocks = [(size + more) // step for size, (_, more) in zip(depth_mm.shape, beyond, strict=True)]

    def squares(image: np.ndarray, mode: str) -> np.ndarray:
        whole = np.pad(image, [*beyond, (0, 0)][: image.ndim], mode=mode)
        return whole.reshape(blocks[0], step, blocks[1], step, *image.shape[2:]).swapaxes(1, 2)

    total = squares(force_n, "constant").sum(axis=(2, 3))
    feet = np.stack([squares(image, "edge").mean(axis=(2, 3)) for image in (x, y, depth_mm)], axis=-1)
    loaded = total[..., 2] > 0
    return feet[loaded], total[loaded]


def force_maps(item: ObjectResult) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """By name, force maps (H, W, 3) in N and the depths (H, W) in mm of the skin that they act on.

    The true map and those of the bundles whose scene has a three-axis force map; zero on the boundary.
    """
    maps = {"truth": (item.truth.force_map_n, item.truth.pressed.depth_mm)}
    for name, found in item.found.items():
        image = found.result.force_map_n
        if image is not None and image.shape[1] == 3:
            maps[name] = (
                np.pad(np.moveaxis(image[0], 0, -1), [(1, 1), (1, 1), (0, 0)]),
                found.result.depth_mm[0],
            )
    return maps


def draw(item: ObjectResult, path: Path) -> None:
    """Write a PNG, a row for the truth and for each bundle: input, normals, displacement, error, points."""
    rest, truth, forces = rest_depth_mm(item.sensor), item.truth.pressed, force_maps(item)
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
        axis.set_title(f"{name}: point cloud, mm" + (", force" if name in forces else ""), fontsize=7)
        axis.tick_params(labelsize=5)
        if name in forces:
            feet, force = arrows(*forces[name], item.sensor)
            longest = np.linalg.norm(force, axis=1).max(initial=np.finfo(float).tiny)
            scale = item.sensor.width_px * item.sensor.pitch_mm / LONGEST / longest
            axis.quiver(*feet.T, *(force * scale).T, color="tab:blue", linewidth=0.6)
    figure.suptitle(f"{item.name}, {truth.pose['load_n']:g} N, simulated", fontsize=9)
    save_png(figure, path)


def _cloud(item: ObjectResult, depth: np.ndarray) -> go.Scatter3d:
    x, y = pixel_centres_mm(item.sensor)
    displacement = rest_depth_mm(item.sensor) - depth
    style = {"size": 1.8, "color": displacement.ravel(), "colorscale": "Plasma", "cmin": 0}
    return go.Scatter3d(x=x.ravel(), y=y.ravel(), z=depth.ravel(), mode="markers", marker=style)


def _forces(item: ObjectResult, force_n: np.ndarray, depth_mm: np.ndarray) -> tuple[go.Surface, go.Cone]:
    """The deformed skin, coloured by the magnitude of the force, and three-axis force vectors as cones."""
    x, y = pixel_centres_mm(item.sensor)
    size = np.linalg.norm(force_n, axis=-1) * 1e3
    skin = go.Surface(x=x, y=y, z=depth_mm, surfacecolor=size, colorscale="Viridis", showscale=False)
    feet, force = arrows(force_n, depth_mm, item.sensor)
    cones = dict(zip("xyzuvw", (*feet.T, *force.T), strict=True))
    return skin, go.Cone(**cones, anchor="tail", colorscale="Blues", showscale=False, sizemode="scaled")


def page(shown: list[ObjectResult]) -> str:
    """The HTML page: per object the true and all reconstructed point clouds, and forces on the skin."""
    shown_objects = []
    for item in shown:
        depths = {"truth": item.truth.pressed.depth_mm}
        depths |= {name: found.result.depth_mm[0] for name, found in item.found.items()}
        forces = force_maps(item)
        titles = [f"{name}: depth, mm" for name in depths] + [f"{name}: three-axis force" for name in forces]
        specs = [[{"type": "scene"}] * len(titles)]
        figure = make_subplots(rows=1, cols=len(titles), specs=specs, subplot_titles=titles)
        for column, depth in enumerate(depths.values(), start=1):
            figure.add_trace(_cloud(item, depth), row=1, col=column)
        for column, known in enumerate(forces.values(), start=len(depths) + 1):
            for trace in _forces(item, *known):
                figure.add_trace(trace, row=1, col=column)
        figure.update_scenes(
            aspectmode="data", camera_eye=EYE, xaxis=SPACE_AXIS, yaxis=SPACE_AXIS, zaxis=SPACE_AXIS
        )
        figure.update_layout(showlegend=False, height=480, margin={"t": 60, "b": 10}, **LAYOUT)
        script = "inline" if not shown_objects else False
        html = figure.to_html(full_html=False, include_plotlyjs=script, config=CONFIG)
        load = item.truth.pressed.pose["load_n"]
        shown_objects.append((f"{item.name}, {load:g} N, simulated", html))
    return render("studies/demos/objects.html.j2", objects=shown_objects)
