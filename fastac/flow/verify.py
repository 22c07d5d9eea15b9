# amaranth: UnusedElaboratable=no
"""The verification campaign: one trained model as hardware of several widths, each against the integers."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from fastac.flow.hardware import NAME
from fastac.gateware.cycle_model import multipliers
from fastac.gateware.target.device import device_of
from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.top_zynq import TopZynq
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import bundle as bundles
from fastac.models.integer.assemble import with_loadable
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.report.tables import text_table
from fastac.scenes.schema import Scene, SceneError, describe
from fastac.sensor.dataset import Dataset
from fastac.sim.check_top import simulate
from fastac.store.files import digest_file, read_json, write_atomically, write_json, write_text
from fastac.store.progress import watched
from fastac.store.steps import Step
from fastac.store.store import open_store

FILE = "verify.json"
BUNDLE, SOURCE, NOTE = "bundle", f"{NAME}.v", "note.json"
LIMITS = {"elaboration_s": 60, "build_s": 180, "simulation_s_per_frame": 20}
"""To be met on two cores."""
SPECIAL = ("black", "white", "checkerboard", "bright pixel", "missing pixels", "missing rows", "0 or 255")
MISSING = 0.05
"""Share of the pixels that are missing in a special frame."""
STALLED_FRAMES = 2
STALL = (0.3, 0.3)
"""Probabilities that the source of frames pauses, and that an output is not taken."""


def derive(bundle: Bundle, folder: Path, *, pace: int | str, weights: str | None = None) -> Bundle:
    """The same model for hardware of `pace` pixels a clock, as a bundle in `folder` with a hash of its own.

    weights : "loadable" or "baked", of the pixel network; as they are if None. Every integer that the model
        computes stays the same; words that hold any weights are wider than those for the given ones.
    pace : a value of `hardware.pixels_per_clock`
    Raises SceneError where the scene cannot have this pace.
    """
    content = bundle.scene.model_dump(mode="json")
    content["hardware"]["pixels_per_clock"] = pace
    pipeline = bundle.pipeline
    if weights is not None:
        content["hardware"]["weights"] = weights
        pipeline = with_loadable(pipeline, weights == "loadable")
    try:
        scene = Scene.model_validate(content)
    except ValidationError as error:
        raise SceneError(f"scene {bundle.scene.name}: {describe(error)}") from None
    return bundles.save(folder, pipeline.replace(scene=scene), bundle.floats)


def fit(bundle: Bundle, folder: Path, pace: int | str) -> tuple[Bundle, str]:
    """The model for a pace, with baked weights where loadable ones need more DSP slices than the part has
    and baked ones fewer than these.

    And a word on why they are not as the scene has them, or that the part is too small, or empty.
    """
    derived = derive(bundle, folder, pace=pace)
    device, needed = device_of(derived.scene), _multipliers(derived.pipeline)
    if needed <= device.dsps:
        return derived, ""
    if _multipliers(derived.pipeline, weights="baked") < needed:
        note = f"baked: loadable weights need {needed} of {device.dsps} {device.dsp.name}"
        return derive(bundle, folder, pace=pace, weights="baked"), note
    note = f"too large for the part, {needed} of {device.dsps} {device.dsp.name}: simulated all the same"
    return derived, note


def _multipliers(pipeline: IntegerPipeline, **hardware: str) -> int:
    """DSP slices of a pipeline's hardware, with other values of the scene's keys of `hardware`."""
    known = pipeline.scene
    scene = known.model_copy(update={"hardware": known.hardware.model_copy(update=hardware)})
    return sum(multipliers(scene, hidden=pipeline.hidden, solver=pipeline.solver).values())


def special_frames(background: np.ndarray) -> np.ndarray:
    """What no camera sends, (7, H, W, C): all black, all white, a checkerboard, one bright pixel, missing
    pixels, missing rows, and 0 or 255 at random in every channel, which makes the steepest slopes."""
    checkerboard = np.where(np.indices(background.shape[:2]).sum(axis=0) % 2, 255, 0)
    bright = background.copy()
    bright[background.shape[0] // 2, background.shape[1] // 2] = 255
    rng, pixels, rows = np.random.default_rng(1), background.copy(), background.copy()
    pixels[rng.random(background.shape[:2]) < MISSING] = 0
    rows[len(rows) // 2 : len(rows) // 2 + len(rows) // 8] = 0
    return np.stack(
        [
            np.zeros_like(background),
            np.full_like(background, 255),
            np.broadcast_to(checkerboard[..., None], background.shape).astype(np.uint8),
            bright,
            pixels,
            rows,
            rng.choice(np.array([0, 255], np.uint8), background.shape),
        ]
    )


def elaborate(folder: Path, bundle: Path, pace: int | str, *, progress: bool) -> None:
    """A step: the model for hardware of a pace as a bundle, its Verilog, and a word on its weights."""
    with watched(f"{pace} px/clock: elaborating", enabled=progress):
        derived, note = fit(bundles.load(bundle), folder / BUNDLE, pace)
        write_text(folder / SOURCE, to_verilog(TopZynq(derived), name=NAME))
    write_json(folder / NOTE, {"note": note})


def simulated(
    folder: Path,
    bundle: Path,
    verilog: Path,
    images: Path,
    stall: tuple[float, float],
    *,
    workplace: Path,
    build_args: tuple[str, ...],
    progress: bool,
) -> dict:
    """A step: frames through the Verilog of a bundle, every value compared; what a row says of the run.

    workplace : where simulator and logs are and stay
    """
    derived, frames = bundles.load(bundle), np.load(images, allow_pickle=False)
    expected = Emulator(derived.pipeline).run(derived.pipeline.seen(frames), progress=progress)
    found = simulate(
        derived,
        verilog,
        frames,
        expected,
        workplace,
        name=NAME,
        stall=tuple(stall),
        build_args=build_args,
        progress=progress,
    )
    row = {
        "weights": "loadable" if derived.pipeline.layers[0].loadable else "baked",
        "stalls": any(stall),
        "frames": found.frames,
        "values_compared": found.values_compared,
        "stream_markers_compared": found.markers_compared,
        "mismatches": found.mismatches,
        "first_mismatch": found.first_mismatch,
        "cycles": found.cycles,
        "latency_cycles": found.latency_cycles,
        "simulation_s_per_frame": found.wall_s["simulate"] / found.frames,
        "bundle_sha256": derived.digest,
        "verilog_sha256": digest_file(verilog),
    }
    if not any(stall):  # the stalled run has the simulator of the one before
        row["build_s"] = found.wall_s["build"]
    return row


def run(
    bundle: Path,
    data: Dataset,
    index: np.ndarray,
    paces: Sequence[int | str],
    folder: Path,
    *,
    store: Path,
    build_args: tuple[str, ...] = (),
    progress: bool,
) -> dict:
    """Frames `index` and the special ones through the hardware at each pace; writes verify.json.

    paces : values of `hardware.pixels_per_clock`
    At each, the frames go back to back, at the pace of a camera that is as fast as the hardware, then the
    first and the last of them with random stalls, pixels coming as fast as they are taken. Elaborations
    and simulations are steps of the store in the folder `store`.
    """
    model, kept = bundles.load(bundle), open_store(store)
    frames = np.concatenate([data.frames[index], special_frames(model.pipeline.background)])
    stalled = np.linspace(0, len(frames) - 1, STALLED_FRAMES, dtype=int)
    runs = []
    for name, chosen, stall in (("frames", slice(None), (0.0, 0.0)), ("stalled", stalled, STALL)):
        file = folder / f"{name}.npy"
        with write_atomically(file) as temporary:
            np.save(temporary, frames[chosen])
        runs.append({"images": file, "stall": stall})
    content = {
        "scene": model.scene.name,
        "bundle_sha256": model.digest,
        "frames_are": "simulated" if model.scene.sensor.source == "simulated" else "recorded photographs",
        "frame_indices": index.tolist(),
        "special_frames": len(frames) - len(index),
        "limits": LIMITS,
        "rows": [],
    }
    shown = {"progress": progress}
    for pace in paces:
        place = folder / f"px_{str(pace).replace('/', '_')}"
        design = Step("elaborate", elaborate, {"bundle": bundle, "pace": pace}, (BUNDLE, SOURCE, NOTE), shown)
        elaborated = kept.perform(design)
        elaborated.place(place)
        note = read_json(elaborated.path(NOTE))["note"]
        local = {"workplace": place, "build_args": build_args}
        hardware = {"bundle": design.output(BUNDLE), "verilog": design.output(SOURCE)}
        for stimulus in runs:
            step = Step("verify", simulated, hardware | stimulus, (), shown | local)
            row = {"pixels_per_clock": pace, "note": note, **kept.perform(step).value}
            if not row["stalls"]:
                row["elaboration_s"] = elaborated.seconds
            content["rows"].append(row)
            write_json(folder / FILE, content)
    return content


def table(content: dict) -> str:
    """The campaign for a terminal; a time beyond its limit is marked with an exclamation mark."""
    head = ("px/clock", "weights", "stalls", "frames", "values", "mismatches", "cycles", *LIMITS)
    rows = []
    for row in content["rows"]:
        times = [
            f"{row[key]:.1f}{'!' * (row[key] > limit)}" if key in row else "" for key, limit in LIMITS.items()
        ]
        counts = [f"{row[key]:,}" for key in ("frames", "values_compared", "mismatches", "cycles")]
        rows.append(
            (str(row["pixels_per_clock"]), row["weights"], "random" if row["stalls"] else "", *counts, *times)
        )
    notes = {
        f"{row['pixels_per_clock']} px/clock: {row['note']}": None for row in content["rows"] if row["note"]
    }
    return "\n".join([text_table(head, rows), *notes])
