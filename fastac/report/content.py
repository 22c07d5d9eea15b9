"""The content of report.json, and the rows of its summary."""

from pathlib import Path

from fastac.gateware.target.device import device_of
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.force_interval import INTERVAL
from fastac.report import build_files
from fastac.report import paper as paper_figures
from fastac.scenes.schema import AXES, Scene
from fastac.synth import synthesis_figures, vivado_reports
from fastac.synth.estimates import energy

LATENCY_ORIGIN = (
    "counted in the Verilator simulation of the top-level; stages: the design's formulas, whose"
    " sum the simulation confirms"
)
PRODUCTS = {
    "DSP48E2": "one per product, or per two that are packed",
    "DSP48E1": "one per product of 25 × 18 bits, or per two that are packed, and more for wider ones",
}


def estimated(value: float, formula: str) -> dict:
    """A figure of the report that a formula estimates, with its origin."""
    return {"value": value, "origin": f"estimated: {formula}"}


def content(folder: Path, bundle: Bundle) -> dict:
    """The report of a build from the files of its steps; figures that were not obtained are absent."""
    scene = bundle.scene
    errors = build_files.read(folder, "accuracy.json")
    simulated = build_files.read(folder, "sim.json")
    hardware = build_files.read(folder, "verilog/hardware.json")
    latency = simulated["latency_cycles"]
    clock = scene.hardware.clock_mhz
    at = f"cycles / {clock:g} MHz, the scene's assumed clock"
    times = {
        key: estimated(latency[key] / clock * 1e-3, at)
        for key in ("first_pixel_to_force", "first_pixel_to_depth", "initiation_interval")
        if key in latency
    }
    multipliers = hardware["multipliers"]
    device = device_of(scene)
    resources = {
        device.dsp_key: estimated(
            sum(multipliers.values()),
            f"{device.dsp.name} of the architecture: {PRODUCTS[device.dsp.name]}; synthesis may differ",
        ),
        f"{device.dsp_key}_by_module": estimated(multipliers, f"as {device.dsp_key}"),
    }
    resources |= synthesis_figures.resources(folder, hardware)
    reported = vivado_reports.read(folder, bundle.digest)
    return {
        "scene": scene.model_dump(mode="json"),
        "bundle_sha256": bundle.digest,
        "hidden_neurons": {"asked": list(scene.network.hidden), "kept": list(bundle.pipeline.hidden)},
        "data": {**bundle.pipeline.provenance, "test_frames": errors["frames"]},
        "frames_are": "simulated" if scene.sensor.source == "simulated" else "recorded photographs",
        "pace": pace(scene),
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
        **({INTERVAL: errors[INTERVAL]} if INTERVAL in errors else {}),
        "bounds": bounds(bundle),
        "resources": resources,
        **energy.estimate(bundle.pipeline),
        "device": device.totals,
        "paper": paper_figures.EDGE,
        **({"vivado": reported} if reported else {}),
    }


def pace(scene: Scene) -> dict:
    """Of pixels: how many the hardware takes in a clock, and beside a camera of a known rate, its margin."""
    found = {"pixels_per_clock": scene.pace.value}
    camera = scene.camera_clocks_per_pixel
    if camera is not None:
        found["camera_clocks_per_pixel"] = camera
        found["margin_percent"] = 100 * scene.pace.margin(camera)
    return found


def bounds(bundle: Bundle) -> dict:
    """Widths of the datapath's words with their largest possible value, or where they saturate.

    Of accumulators, slopes, the source, the solver's words and the displacement.
    """
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
    if pipeline.interval is not None:
        found["force.half_width"] = {
            "bound": max(pipeline.interval.half_bounds),
            "width_bits": pipeline.interval.half_width,
        }
    if pipeline.force is not None:
        found["force.accumulator"] = {"bound": pipeline.force_bound, "width_bits": pipeline.force_width}
    return found


def summary_rows(report: dict) -> list[tuple[str, str, str, str]]:
    """Rows (figure, ours, the paper's, origin of ours) of the summary on the page and in the terminal."""
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
    if "hidden_neurons" in report:
        asked, kept = (", ".join(map(str, report["hidden_neurons"][key])) for key in ("asked", "kept"))
        shown = asked if asked == kept else f"{asked} asked, {kept} kept"
        rows.append(("neurons of the hidden layers", shown, "16, 16, 16", "the scene, and the bundle"))
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
    rows += interval_rows(report.get(INTERVAL, {}), frames)
    resources = report["resources"]
    for key in ("lut", "dsp48e2", "dsp48e1", "ramb36", "uram288"):
        if key in resources:
            value = resources[key]["value"]
            share = 100 * value / report["device"][key]
            rows.append((key, f"{value:g} ({share:.1f}%)", "not stated", resources[key]["origin"]))
    uj = report["energy_estimate_uj_per_frame"]
    rows.append(("energy of a frame, estimate, µJ", f"{uj['value']:.3g}", "not stated", uj["origin"]))
    if "ecp5_clock_mhz" in resources:
        clock = resources["ecp5_clock_mhz"]
        rows.append(("clock of the slowest module on ECP5, MHz", f"{clock['value']:g}", "", clock["origin"]))
    if "vivado" in report:
        vivado = report["vivado"]
        for key, figure in vivado["figures"].items():
            origin = f"{figure['origin']} {vivado['tool']}, {vivado['part']}: {vivado['scope']}"
            rows.append((f"{key.replace('_', ' ')}, Vivado", f"{figure['value']:g}", "", origin))
    return rows


def interval_rows(found: dict, frames: str) -> list[tuple[str, str, str, str]]:
    """Rows of the summary on the intervals around forces, as `interval_accuracy.evaluate` found them."""
    if not found:
        return []
    asked, made_for = (f"{100 * found[key]:.3g}%" for key in ("asked", "coverage"))
    promise = made_for if made_for == asked else f"{asked} asked, {made_for} supported"
    how = "left out of a training each" if found["trainings"] else "of the validation split"
    origin = f"calibrated on {found['groups']} groups {how}, {found['frames']} frames"
    rows = [("forces within their intervals, promised", promise, "", origin)]
    for key, label in (("as_they_are", ""), ("drifted", " under drift")):
        counted = found.get(key, {})
        for axis, entry in counted.items():
            if axis in AXES:
                share, low, high = (100 * entry[k] for k in ("coverage", "coverage_from", "coverage_to"))
                value = f"{share:.1f}% ({low:.1f} to {high:.1f}), ± {entry['half_width_n']:.3g} N"
                origin = f"{frames}, {counted['groups']} groups; 95% confidence, mean half-width"
                rows.append((f"force_{axis} within its interval{label}", value, "", origin))
    return rows
