"""Section "stages": latency, energy and accuracy of normals, depth and force on CPU, GPU and hardware.

Errors are from the image up to each stage, on the same test frames, in floats and in the hardware's integers.
The CPU's latencies are those of the float pipeline on this machine, one frame at a time as in a control loop;
the GPU's, where there is one, those of the same stages in torch. Cycles are counted in the simulated RTL.
Energy is measured by counters or absent; the hardware's is an estimate and labelled so.
"""

import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import torch
from threadpoolctl import threadpool_limits

from fastac.models.accuracy import with_background_of
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.floating.threads import single_thread
from fastac.models.floating.torch_pipeline import TorchPipeline
from fastac.report.figures import save_png
from fastac.report.paper import STAGES
from fastac.report.tables import Table, number
from fastac.scenes.schema import Scene
from fastac.sensor.samples import evenly_spaced
from fastac.store.files import write_json
from fastac.studies.benchmarks.rapl import NoCounters, PackageCounters
from fastac.studies.benchmarks.timing import fastest
from fastac.studies.reproduce.section import Finished, Known

TITLES = {
    "normals": "surface normals",
    "depth": "depth",
    "force": "force",
    "image_to_force": "image to force",
}
ERRORS = {
    "normals": "gradient_mae_mm_per_px",
    "depth": "depth_mae_mm",
    "force": "force_z_mae_n",
    "image_to_force": "force_z_mae_n",
}
FRAMES, REPEATS = 8, 10
"""Number of frames, timed one by one, and of passes over them, of which the fastest counts."""
ENERGY_S = 1.0
"""Duration for which a stage is repeated to measure its energy: the counters advance every millisecond."""

Stage = Callable[[], object]
"""Runs one stage on all timed frames once, one after the other."""


def lacks(build: Known) -> str | None:
    """One line that says why this section cannot be run on the build; None if it can."""
    scene = build.scene
    if scene.force_beside_depth:
        return "force.source = slopes: the force does not pass the depth"
    if not scene.wants_solver or not scene.wants_force:
        return f"outputs = {', '.join(scene.outputs)}: not all of normals, depth and force are found"
    return None


def cpu_stages(pipeline: FloatPipeline, frames: np.ndarray) -> dict[str, Stage]:
    """By stage, and for all three together, what runs it on the CPU on each of `frames` (frames, H, W, C)."""
    stages = pipeline.stages()
    slopes = [stages["normals"](frame).copy() for frame in frames]
    displacements = [stages["depth"](slope) for slope in slopes]

    def whole() -> None:
        for frame in frames:
            stages["force"](stages["depth"](stages["normals"](frame)))

    return _each(stages, frames, slopes, displacements) | {"image_to_force": whole}


def _each(stages: dict[str, Callable], *inputs) -> dict[str, Stage]:
    def over(stage: Callable, given) -> Stage:
        def run() -> None:
            for x in given:
                stage(x)

        return run

    return {name: over(stages[name], given) for name, given in zip(stages, inputs, strict=True)}


def device_stages(pipeline: TorchPipeline, frames: np.ndarray) -> dict[str, Stage]:
    """The same on a torch device: stages on data already there, the whole with transfers to and from it."""
    stages = pipeline.stages()
    images = [pipeline.to_device(frame) for frame in frames]
    slopes = [stages["normals"](image) for image in images]
    displacements = [stages["depth"](slope) for slope in slopes]

    def waiting(stage: Callable) -> Callable:
        def run(x) -> None:
            stage(x)
            pipeline.synchronise()

        return run

    def whole() -> None:
        for frame in frames:
            stages["force"](stages["depth"](stages["normals"](pipeline.to_device(frame)))).cpu()

    waited = {name: waiting(stage) for name, stage in stages.items()}
    return _each(waited, images, slopes, displacements) | {"image_to_force": whole}


@contextmanager
def one_core() -> Iterator[None]:
    """Restrict BLAS and torch to one thread: their threads poll for work, so that with more threads than free
    cores a frame takes many times as long."""
    with single_thread(), threadpool_limits(1, user_api="blas"):
        yield


@one_core()
def latencies_ms(runs: dict[str, Stage], count: int) -> dict[str, float]:
    """Latency of one frame by stage, from runs over `count` frames on one core."""
    return {name: 1e3 * fastest(run, REPEATS)[0] / count for name, run in runs.items()}


@one_core()
def energies_mj(runs: dict[str, Stage], count: int, counters: PackageCounters) -> dict[str, float]:
    """Energy of one frame by stage, from the packages' counters, idle power included."""
    found = {}
    for name, run in runs.items():
        done, start, before_uj = 0, time.monotonic(), counters.read_uj()
        while time.monotonic() - start < ENERGY_S:
            run()
            done += count
        found[name] = counters.spent_mj(before_uj, counters.read_uj()) / done
    return found


def processor() -> str:
    """The CPU's name by /proc/cpuinfo, or "CPU of unknown name"."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return "CPU of unknown name"
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else "CPU of unknown name"


def run(
    folder: Path, scene: Scene, bundle: Path, data: Path, report: Path, *, store: Path, progress: bool
) -> None:
    """Time the stages on this machine; cycles and errors are those of the build's JSON `report`."""
    build = Finished.read(scene, bundle, data, store=store, progress=progress)
    pipeline = with_background_of(FloatPipeline.from_bundle(build.bundle), build.data)
    index = evenly_spaced(build.data.indices("test"), FRAMES)
    frames, report = build.data.frames[index], json.loads(report.read_text())
    errors, clock_mhz = report["accuracy"], build.scene.hardware.clock_mhz
    axes = build.scene.force_axes
    of_z = "force_z_mae_n" if len(axes) > 1 else "force_mae_n"
    known = {**ERRORS, "force": of_z, "image_to_force": of_z} if 2 in axes else ERRORS

    def accuracy(kind: str) -> dict[str, float]:
        return {stage: errors[kind][key] for stage, key in known.items() if key in errors[kind]}

    runs, absent = cpu_stages(pipeline, frames), {}
    cpu = {
        "device": f"{processor()}, {os.cpu_count()} cores",
        "latency_ms": latencies_ms(runs, len(frames)),
        "latency_origin": "measured on this machine: NumPy and torch, float32, one frame at a time, one core",
        "accuracy": accuracy("float"),
    }
    try:
        cpu["energy_mj"] = energies_mj(runs, len(frames), PackageCounters())
        cpu["energy_origin"] = "measured on this machine: counters of its packages, idle share included"
    except NoCounters as error:
        absent["energy of the CPU"] = str(error)
    platforms = {"CPU": cpu}
    if build.scene.wants_darkness:
        absent["GPU"] = "the scene's dots are not found on a torch device"
    elif torch.cuda.is_available():
        gpu_stages = device_stages(TorchPipeline(pipeline, "cuda"), frames)
        platforms["GPU"] = {
            "device": torch.cuda.get_device_name(),
            "latency_ms": latencies_ms(gpu_stages, len(frames)),
            "latency_origin": "measured on this machine: torch, float32, one frame at a time; the whole"
            " from and to the host's memory",
            "accuracy": accuracy("float"),
        }
        absent["energy of the GPU"] = "torch has no counter of it"
    else:
        absent["GPU"] = "torch finds none on this machine"
    cycles = report["latency_cycles"]
    whole = {**cycles["stage"], "image_to_force": cycles["first_pixel_to_force"]}
    platforms["RTL"] = {
        "device": f"{report['device']['part']}, scene {build.scene.name}",
        "latency_cycles": whole,
        "latency_ms": {stage: 1e-3 * count / clock_mhz for stage, count in whole.items()},
        "latency_origin": f"{cycles['origin']}; ms: cycles / {clock_mhz:g} MHz, the scene's assumed clock",
        "accuracy": accuracy("integer"),
        "energy_mj": {"image_to_force": 1e-3 * report["energy_estimate_uj_per_frame"]["value"]},
        "energy_origin": report["energy_estimate_uj_per_frame"]["origin"],
    }
    content = {
        "timed_frames": len(frames),
        "test_frames": report["data"]["test_frames"],
        "rtl_vs_integer": {
            k: report["rtl_vs_integer"][k] for k in ("frames", "values_compared", "mismatches")
        },
        "platforms": platforms,
        "absent": absent,
    }
    draw(content, folder / "stages.png")
    write_json(folder / "stages.json", content)


PAPER_PLATFORM = {"CPU": "CPU", "GPU": "GPU", "RTL": "FPGA"}


def tables(content: dict) -> list[Table]:
    """One table: a row per stage and platform, beside the paper's figures."""
    rows = []
    for stage, title in TITLES.items():
        for name, platform in content["platforms"].items():
            paper = STAGES[stage][PAPER_PLATFORM[name]]
            error = next(key for key in paper if "mae" in key)
            cycles = platform.get("latency_cycles", {}).get(stage)
            ours = platform["accuracy"].get(stage)
            energy = platform.get("energy_mj", {}).get(stage)
            rows.append(
                [
                    title,
                    name,
                    "" if cycles is None else f"{cycles:,}",
                    number(platform["latency_ms"][stage]),
                    number(paper["latency_ms"]),
                    "" if ours is None else number(ours),
                    number(paper[error]),
                    error,
                    "" if energy is None else number(energy),
                    number(paper["energy_mj"]),
                ]
            )
    notes = [
        f"{name}: {known['device']}; {known['latency_origin']}."
        for name, known in content["platforms"].items()
    ]
    notes += [
        f"Energy, {name}: {known['energy_origin']}."
        for name, known in content["platforms"].items()
        if "energy_origin" in known
    ]
    notes += [f"No {name}: {why}." for name, why in content["absent"].items()]
    rtl = content["rtl_vs_integer"]
    notes.append("The RTL's stages overlap: its cycles are what each adds to the latency of the whole.")
    notes.append(
        f"RTL against integer model: {rtl['mismatches']} mismatches in {rtl['values_compared']:,} values,"
        f" {rtl['frames']} frames. Errors: {content['test_frames']} test frames, from the image to the stage."
    )
    head = ["stage", "platform", "cycles", "ms, ours", "ms, paper", "error, ours", "error, paper", "of"]
    return [Table("Stages", [*head, "mJ, ours", "mJ, paper"], rows, " ".join(notes))]


def draw(content: dict, path: Path) -> None:
    """Write a PNG: latencies by stage and platform, ours beside the paper's."""
    figure, axis = plt.subplots(figsize=(9, 3.6))
    at = np.arange(len(TITLES))
    names = list(content["platforms"])
    for k, name in enumerate(names):
        ours = [content["platforms"][name]["latency_ms"][stage] for stage in TITLES]
        theirs = [STAGES[stage][PAPER_PLATFORM[name]]["latency_ms"] for stage in TITLES]
        width = 0.8 / (2 * len(names))
        left = at - 0.4 + (2 * k + 0.5) * width
        axis.bar(left, ours, width, color=f"C{k}", label=f"{name}, ours")
        style = {"color": "white", "edgecolor": f"C{k}", "hatch": "//"}
        axis.bar(left + width, theirs, width, label=f"{PAPER_PLATFORM[name]}, the paper's", **style)
    axis.set_yscale("log")
    axis.set_xticks(at, TITLES.values())
    axis.set_ylabel("latency, ms; RTL: cycles / assumed clock")
    axis.legend(fontsize=7, ncols=6, loc="lower center", bbox_to_anchor=(0.5, 1))
    save_png(figure, path)
