"""Writes report.json and the page report.html of a finished build."""

from pathlib import Path

import numpy as np

from fastac.models import accuracy
from fastac.models.integer.bundle import Bundle
from fastac.models.result import Result
from fastac.report import surface, timeline
from fastac.report.charts import curve_charts, force_charts
from fastac.report.content import content, summary_rows
from fastac.report.headline import headlines
from fastac.report.panels import more_panels, panels
from fastac.report.render import render
from fastac.report.timeline_chart import chart
from fastac.scenes.schema import AXES, Scene
from fastac.sensor.dataset import Dataset
from fastac.store.files import write_json, write_text


def place_of_main(data: Dataset, shown: np.ndarray, scene: Scene) -> int:
    """Which of the samples `shown` stands at the top: that of the largest force where forces are known."""
    if not (scene.wants_force and data.has_force(scene.force_axes)):
        return 0
    return int(np.abs(data.forces_n(shown, scene.force_axes)).max(axis=1).argmax())


def caption(data: Dataset, sample: int, found: Result, place: int, scene: Scene) -> str:
    """What the main frame is, with the force found in it and the true one."""
    parts = [f"Frame {sample}, held out, as the hardware's integers see it"]
    if found.force_n is not None:
        names = ", ".join(f"F_{AXES[axis]}" for axis in scene.force_axes)
        parts.append(f"{names} found: {_newtons(found.force_n[place])}")
        if data.has_force(scene.force_axes):
            parts.append(f"true: {_newtons(data.forces_n([sample], scene.force_axes)[0])}")
    return "; ".join(parts) + "."


def _newtons(force_n: np.ndarray) -> str:
    return ", ".join(f"{value:.3f}" for value in force_n) + " N"


def write(folder: Path, bundle: Bundle, data: Dataset) -> None:
    """Write report.json and report.html into the build folder."""
    report, scene = content(folder, bundle), bundle.scene
    shown = np.array(report["rtl_vs_integer"]["frame_indices"])
    _, results = accuracy.compare_pipelines(bundle, data, shown, progress=False)
    found, main = results["integer"], place_of_main(data, shown, scene)
    frames = [
        (
            f"frame {sample}",
            panels(data, sample, found, scene, k) + more_panels(data, sample, found, scene, k),
        )
        for k, sample in enumerate(shown)
    ]
    forces = []
    if scene.wants_force and data.has_force(scene.force_axes):
        index = data.indices("test")
        _, everything = accuracy.compare_pipelines(bundle, data, index, progress=False)
        forces = force_charts(data.forces_n(index, scene.force_axes), everything, scene.force_axes)
    stages = timeline.of_scene(scene, report["latency_cycles_by_formula"])
    page = render(
        "report/build.html.j2",
        report=report,
        rows=summary_rows(report),
        headlines=headlines(report),
        hero={
            "panels": panels(data, shown[main], found, scene, main),
            "caption": caption(data, shown[main], found, main, scene),
            "place": main,
        },
        view=surface.view(scene, shown, found) if found.depth_mm is not None else None,
        most_rise=surface.MOST_RISE,
        chart=chart(stages),
        modules=timeline.modules(stages),
        frames=frames,
        force_charts=forces,
        curves=curve_charts(bundle.floats),
    )
    write_json(folder / "report.json", report)
    write_text(folder / "report.html", page)
