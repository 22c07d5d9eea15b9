"""report.json, and the page a person would rather look at."""

import base64
import io
import json
from pathlib import Path

import jinja2
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from fastac import accuracy
from fastac.gateware.target.device import DEVICE
from fastac.models.integer.bundle import Bundle
from fastac.report import paper as paper_figures
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.store.steps import write_json
from fastac.synth import energy, synthesis

LATENCY_ORIGIN = (
    "counted in the Verilator simulation of the top-level; stages: the design's formulas, whose"
    " sum the simulation confirms"
)


def estimated(value: float, formula: str) -> dict:
    return {"value": value, "origin": f"estimated: {formula}"}


def content(folder: Path, bundle: Bundle) -> dict:
    """The report from what the build's steps have written; what was not obtained is absent."""
    scene = bundle.scene
    errors = json.loads((folder / "accuracy.json").read_text())
    simulated = json.loads((folder / "sim.json").read_text())
    hardware = json.loads((folder / "verilog" / "hardware.json").read_text())
    latency = simulated["latency_cycles"]
    clock = scene.hardware.clock_mhz
    at = f"cycles / {clock:g} MHz, the scene's assumed clock"
    times = {
        key: estimated(latency[key] / clock * 1e-3, at)
        for key in ("first_pixel_to_force", "first_pixel_to_depth", "initiation_interval")
        if key in latency
    }
    multipliers = hardware["multipliers"]
    resources = {
        "dsp48e2": estimated(
            sum(multipliers.values()),
            "DSP48E2 of the architecture: one per product, or per two that are packed; synthesis may differ",
        ),
        "dsp48e2_by_module": estimated(multipliers, "as dsp48e2"),
    }
    resources |= synthesis.resources(folder, hardware)
    return {
        "scene": scene.model_dump(mode="json"),
        "bundle_sha256": bundle.digest,
        "data": {**bundle.pipeline.provenance, "test_frames": errors["frames"]},
        "frames_are": "simulated" if scene.sensor.source == "simulated" else "recorded photographs",
        "latency_cycles": {**latency, "origin": LATENCY_ORIGIN},
        "latency_cycles_by_formula": hardware["latency_cycles_by_formula"],
        "latency_ms": times,
        "rtl_vs_integer": {
            "frames": simulated["frames"],
            "values_compared": simulated["values_compared"],
            "mismatches": simulated["mismatches"],
            "values_by_output": simulated["values_by_output"],
            "stream_markers_compared": simulated["markers_compared"],
            "frame_indices": simulated["frame_indices"],
            "error_flags": simulated["errors"],
        },
        "accuracy": {k: errors[k] for k in ("float", "integer", "growth_percent", "saturated_values")},
        "bounds": bounds(bundle),
        "resources": resources,
        **energy.estimate(bundle.pipeline),
        "device": DEVICE,
        "paper": paper_figures.EDGE,
    }


def bounds(bundle: Bundle) -> dict:
    """Every word of the datapath: its worst case and its width."""
    pipeline = bundle.pipeline
    found = {
        f"fc{k}.accumulator": {"bound": layer.accumulator_bound, "width_bits": layer.accumulator_width}
        for k, layer in enumerate(pipeline.layers)
    }
    ratio = pipeline.ratio
    found["slope"] = {
        "saturates_at": ratio.limit * 2.0**-ratio.fraction,
        "width_bits": ratio.width,
        "fraction_bits": ratio.fraction,
    }
    if pipeline.solver is not None:
        found["source"] = {"bound": pipeline.source.bound, "width_bits": pipeline.source.width}
        for stage in pipeline.solver.stages:
            found[stage.name] = {
                "bound_px": stage.bound_px,
                "width_bits": stage.format.width,
                "fraction_bits": stage.format.fraction,
            }
    if pipeline.quantiser is not None:
        found["displacement"] = {
            "saturates_at_mm": pipeline.quantiser.top * pipeline.displacement_mm_per_unit,
            "width_bits": pipeline.quantiser.bits,
        }
    if pipeline.force is not None:
        found["force.accumulator"] = {"bound": pipeline.force.bound, "width_bits": pipeline.force.width}
    return found


def _png(figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, bbox_inches="tight")
    plt.close(figure)
    return base64.b64encode(buffer.getvalue()).decode()


def _picture(frame: np.ndarray) -> np.ndarray:
    """B, G, R[, NIR] to an RGB picture."""
    return frame[..., 2::-1]


def frames_figure(data: Dataset, index: np.ndarray, results: dict, scene: Scene) -> str:
    """A row per frame: input, NIR, normals, depth found, displacement, depth error, force map."""
    rows = []
    for k, sample in enumerate(index):
        frame = data.frames[sample]
        panels = [("input (RGB)", _picture(frame), {})]
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
    figure, axes = plt.subplots(
        len(rows), len(rows[0]), figsize=(2.6 * len(rows[0]), 2.5 * len(rows)), squeeze=False
    )
    for k, panels in enumerate(rows):
        for axis, (title, image, style) in zip(axes[k], panels, strict=True):
            shown = axis.imshow(image, **style)
            axis.set_title(f"frame {index[k]}: {title}", fontsize=7)
            axis.set_xticks([])
            axis.set_yticks([])
            if "mm" in title or title.endswith("N"):
                figure.colorbar(shown, ax=axis, shrink=0.75).ax.tick_params(labelsize=6)
    return _png(figure)


def force_figure(data: Dataset, index: np.ndarray, results: dict, force_axes: tuple[int, ...]) -> str:
    """Force found against true force, axis by axis."""
    figure, panels = plt.subplots(1, len(force_axes), figsize=(4 * len(force_axes), 4), squeeze=False)
    for k, (panel, force_axis) in enumerate(zip(panels[0], force_axes, strict=True)):
        truth = data.forces_n(index, (force_axis,))[:, 0]
        for name, marker in (("float", "o"), ("integer", "x")):
            panel.plot(truth, results[name].force_n[:, k], marker, markersize=4, label=name, alpha=0.6)
        ends = 1.15 * min(truth.min(), 0), 1.15 * max(truth.max(), 0)
        panel.plot(ends, ends, "k--", linewidth=0.8)
        panel.set_xlabel(f"true F_{'xyz'[force_axis]}, N")
        panel.set_ylabel(f"found F_{'xyz'[force_axis]}, N")
    panels[0, 0].legend()
    return _png(figure)


def cycles_figure(report: dict) -> str:
    """Where the cycles go, stage by stage."""
    stages = report["latency_cycles_by_formula"]["stage"]
    figure, axis = plt.subplots(figsize=(8, 1.8))
    left = 0
    for k, (name, cycles) in enumerate(stages.items()):
        axis.barh(0, cycles, left=left, color=plt.cm.tab20(k), label=f"{name}: {cycles:,}")
        left += cycles
    axis.set_yticks([])
    axis.set_xlabel("clock cycles from the first pixel")
    axis.legend(fontsize=6, ncol=4, loc="upper center", bbox_to_anchor=(0.5, -0.35))
    return _png(figure)


def curves_figure(bundle: Bundle) -> str:
    """Learning curves of every training step."""
    names = sorted({key.split(".")[1] for key in bundle.floats if key.startswith("history.")})
    figure, axes = plt.subplots(1, max(len(names), 1), figsize=(4 * max(len(names), 1), 3), squeeze=False)
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
    return _png(figure)


def _choice(axis, curves: dict[str, np.ndarray]) -> None:
    """What ridge regression tried: the error over the regularisation, a line for each basis."""
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
    _, results = accuracy.compare(bundle, data, shown, progress=False)
    figures = [
        ("The frames that went through the hardware", frames_figure(data, shown, results, bundle.scene)),
        ("Where the cycles go", cycles_figure(report)),
        ("Training", curves_figure(bundle)),
    ]
    if bundle.scene.wants_force:
        index = data.indices("test")
        _, everything = accuracy.compare(bundle, data, index, progress=False)
        figures.insert(1, ("Force on the held-out grid", force_figure(data, index, everything, axes)))
    template = jinja2.Environment(
        loader=jinja2.PackageLoader("fastac", "."), autoescape=True, undefined=jinja2.StrictUndefined
    ).get_template("report.html.j2")
    page = template.render(report=report, figures=figures, rows=summary_rows(report))
    write_json(folder / "report.json", report)
    temporary = folder / ".report.html.part"
    temporary.write_text(page)
    temporary.replace(folder / "report.html")


def summary_rows(report: dict) -> list[tuple[str, str, str, str]]:
    """(what, ours, paper's, origin of ours) for the page and the terminal."""
    latency, rtl, errors = report["latency_cycles"], report["rtl_vs_integer"], report["accuracy"]
    paper, frames = report["paper"], report["frames_are"]
    rows = [
        (
            "RTL against integer model",
            f"{rtl['mismatches']} mismatches in {rtl['values_compared']:,} values, {rtl['frames']} frames",
            "not stated",
            "Verilator simulation",
        )
    ]
    for key, label in (
        ("first_pixel_to_force", "first pixel → force, cycles"),
        ("last_pixel_to_force", "last pixel → force, cycles"),
        ("first_pixel_to_depth", "first pixel → last depth, cycles"),
        ("first_pixel_to_normals", "first pixel → last normal, cycles"),
        ("initiation_interval", "a new frame every, cycles"),
    ):
        if key in latency:
            stated = f"about {paper['image_to_force_cycles_at_150_mhz']:,}" if key.endswith("force") else ""
            rows.append(
                (label, f"{latency[key]:,}", stated if "first" in key else "", "Verilator simulation")
            )
    for key, time in report["latency_ms"].items():
        stated = f"{paper['image_to_force_ms']}" if key == "first_pixel_to_force" else ""
        rows.append((f"{key.replace('_', ' ')}, ms", f"{time['value']:.4f}", stated, time["origin"]))
    for key, value in errors["float"].items():
        whole = errors["integer"][key]
        growth = errors["growth_percent"].get(key)
        change = "" if growth is None else f" ({growth:+.2f}%)"
        stated = ""
        # The paper's force is F_z; of several axes, force_mae_n is the mean.
        of_paper = {"force_z_mae_n": "force_mae_n"}.get(key, key)
        if of_paper in paper["float"] and not (key == "force_mae_n" and "force_z_mae_n" in errors["float"]):
            stated = f"{paper['float'][of_paper]} → {paper['integer'][of_paper]}"
        rows.append((f"{key}, float → integer", f"{value:.5g} → {whole:.5g}{change}", stated, frames))
    resources = report["resources"]
    for key in ("lut", "dsp48e2", "ramb36", "uram288"):
        if key in resources:
            value = resources[key]["value"]
            share = 100 * value / report["device"][key]
            rows.append((key, f"{value:g} ({share:.1f}%)", "not stated", resources[key]["origin"]))
    uj = report["energy_estimate_uj_per_frame"]
    rows.append(("energy of a frame, estimate, µJ", f"{uj['value']:.3g}", "not stated", uj["origin"]))
    if "ecp5_clock_mhz" in resources:
        clock = resources["ecp5_clock_mhz"]
        rows.append(("clock of the slowest module on ECP5, MHz", f"{clock['value']:g}", "", clock["origin"]))
    return rows
