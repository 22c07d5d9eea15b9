"""The table of `fastac scope`: which labels, trainings, stages and outputs each scene needs, and its area."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from threadpoolctl import threadpool_limits

from fastac.gateware.target.device import LUT_MARGIN, device_of, on_part
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.report.tables import markdown_table
from fastac.scenes.force_fits import FITS
from fastac.scenes.parts import PARTS
from fastac.scenes.schema import Scene
from fastac.store.record import read_record
from fastac.synth import fits
from fastac.synth.estimates import resources
from fastac.synth.estimates.stages import BESIDE_SAMPLES, stage_names
from fastac.synth.fits import random_pipeline

ABSENT = "–"
AREAS = {"lut": "look-up tables", "ramb36": "RAMB36"}
STEPS = {
    "data": "presses",
    "normals": "pixel network, float",
    "integers": "pixel network, bit-true",
    "force": "force model",
    "verilog": "elaboration and lint",
    "sim": "RTL simulation",
}
"""The build's steps whose wall time is shown, with their labels."""


@dataclass(frozen=True)
class Scope:
    """A scene, and the folder of its build, which need not exist."""

    scene: Scene
    folder: Path

    @cached_property
    def everything(self) -> Scene:
        """The same sensor, words and lanes with every output, by the paper's architecture."""
        content = self.scene.model_dump(mode="json")
        content["outputs"] = ["normals", "depth", "force_xyz", "force_map"]
        content["poisson"]["solver"] = "dst2d"
        content["force"] |= {"source": None, "kernel": "patch", "clamp": True, "fit": "displacement"}
        content["force"] |= {"dots": False, "band_mm": None, "deep_mm": None, "block_px": 1}
        content["training"] = {}  # some of which only scenes with fewer outputs may have
        return Scene.model_validate(content)

    def simulated(self) -> dict[str, str]:
        """The frames and labels that a dataset for the scene must hold."""
        scene = self.scene
        by_geometry = scene.training.labels == "geometry"
        curved = scene.sensor.geometry == "fingertip"
        return {
            "frames": f"{scene.sensor.source}, {','.join(scene.sensor.channel_names)}",
            "labels: normals": "yes" if by_geometry else ABSENT,
            "labels: depth": "yes" if scene.wants_solver and scene.sensor.source == "simulated" else ABSENT,
            "labels: skin at rest": "yes" if by_geometry and curved and scene.wants_slopes else ABSENT,
            "labels: force": ", ".join("xyz"[axis] for axis in scene.force_axes) or ABSENT,
            "demosaicing": "yes" if scene.sensor.frames == "raw10" else f"{ABSENT} (frames are channels)",
        }

    def paced(self) -> dict[str, str]:
        """How fast pixels may come, and how fast the camera sends them."""
        scene, camera = self.scene, self.scene.camera_clocks_per_pixel
        known = f"1 in {camera:.3g} clocks: {100 * scene.pace.margin(camera):+.0f}%" if camera else ABSENT
        taken = f"1 in {scene.fold} clocks" if scene.fold > 1 else str(scene.lanes)
        return {"hardware takes": taken, "camera sends, margin": known}

    def trained(self) -> dict[str, str]:
        scene, training = self.scene, self.scene.training
        width = "-".join(map(str, scene.network.hidden))
        if scene.network.train_width is not None:
            width += f" of {'-'.join(map(str, scene.network.trained))}"
        elif scene.network.prune is not None:
            width += " at most"
        force = ABSENT
        if scene.wants_force:
            k = scene.force.kernel_size
            facts = FITS[scene.force.fit]
            force = "weights of the slopes" if facts.of_slopes else f"kernels {k}×{k}"
            if facts.of_weights:
                force = "weights of the displacement"
            if scene.wants_dots:
                force += " and of the dots' shifts"
        learned = ["normals"] if training.labels == "geometry" else ["forces"]
        of_force = bool(training.force_weight or training.force_steps)
        learned += ["depth"] * bool(training.depth_weight) + ["forces"] * of_force
        return {
            "pixel network": f"{width}, from {' and '.join(learned)}",
            "teachers": str(training.teachers or ABSENT),
            "bit-true epochs": str(training.finetune_epochs or ABSENT),
            "force model": force,
        }

    @cached_property
    def pipeline(self) -> IntegerPipeline:
        return random_pipeline(self.scene)

    @cached_property
    def stages(self) -> dict[str, dict[str, float]]:
        factors, _ = resources.model_of(self.scene)
        return resources.predict(factors, resources.features(self.pipeline))

    def elaborated(self) -> dict[str, str]:
        """Look-up tables by stage."""
        return {
            name: f"{self.stages[name]['lut']:,.0f}" if name in self.stages else ABSENT
            for name in (*stage_names(), *(name for name in BESIDE_SAMPLES if name in self.stages))
        }

    def verified(self) -> dict[str, str]:
        """Values of a frame that the RTL simulation compares."""
        scene = self.scene
        pixels, axes = scene.sensor.height_px * scene.sensor.width_px, len(scene.force_axes)
        counts = {
            "normals": 3 * pixels if "normals" in scene.outputs else 0,
            "depth": scene.inner_px**2 if "depth" in scene.outputs else 0,
            "force": axes,
            "slip": 2 if scene.wants_slip else 0,
            "force map": axes * scene.inner_px**2 if scene.wants_force_map else 0,
        }
        return {name: f"{count:,}" if count else ABSENT for name, count in counts.items()}

    def area(self) -> dict[str, str]:
        """The estimated area of the design, beside that with every output."""
        mine, whole = (
            resources.estimate(found) for found in (self.pipeline, random_pipeline(self.everything))
        )
        dsp = device_of(self.scene).dsp_key
        found = {}
        for name, label in ({dsp: "DSP slices"} | AREAS).items():
            value, most = mine[name]["value"], whole[name]["value"]
            found[label] = f"{value:,g} of {most:,g}: {100 * (value / most - 1):+.0f}%"
        return found

    def parts(self) -> dict[str, str]:
        """Of each part, whether the design fits it: the shares that it takes, or what there is too little of.

        The pixel network, say, may be packed otherwise on each, but computes the same.
        """
        found = {}
        for name in PARTS:
            area = fits.area(on_part(self.pipeline, name))
            found[label(name)] = area.shares if area.fits else f"no: {area.shares}"
        return found

    def seconds(self) -> dict[str, str]:
        """The wall time of each step of the build when it last ran."""
        record, known = read_record(self.folder), {}
        for name, label in STEPS.items():
            needed = name != "force" or self.scene.wants_force
            built = f"{record[name]['seconds']:.0f} s" if name in record else "not built"
            known[label] = built if needed else ABSENT
        return known


def label(part: str) -> str:
    """A part's device and the boards that carry it."""
    device = part.split("-")[0].removesuffix("clg400").upper()
    return ", ".join([device, *PARTS[part].boards])


def table(scopes: Sequence[Scope]) -> str:
    """A Markdown table with a column for each scene."""
    sections = {
        "simulated or recorded": Scope.simulated,
        "pixels a clock": Scope.paced,
        "trained": Scope.trained,
        "elaborated, look-up tables": Scope.elaborated,
        "compared in RTL, values a frame": Scope.verified,
        "area, of that with everything": Scope.area,
        "fits, and takes of the part": Scope.parts,
        "wall time": Scope.seconds,
    }
    names = [scope.scene.name for scope in scopes]
    rows: list[list[str]] = []
    for title, section in sections.items():
        with threadpool_limits(1):  # more are slower: all products are small
            columns = [section(scope) for scope in scopes]
        rows.append([f"**{title}**", *("" for _ in names)])
        keys = dict.fromkeys(key for column in columns for key in column)  # a stage of one scene alone, too
        rows += [[key, *(column.get(key, ABSENT) for column in columns)] for key in keys]
    return "\n\n".join([markdown_table(["", *names], rows), *notes()])


def notes() -> list[str]:
    """Where the figures come from."""
    _, origins = resources.model(is_folded=True)
    labels = AREAS | {"dsp48e2": "DSP48E2", "dsp48e1": "DSP48E1"}
    return [
        f"“{ABSENT}”: not needed, so not there. Everything: the same sensor, words and lanes with normals,"
        " depth, three-axis force and force map, by the paper's architecture.",
        *(f"{labels[name]}: {origin}." for name, origin in origins.items()),
        "Parts: the same integers at the scene's words and lanes. “no”: `fastac build` refuses the scene with"
        f" this hardware.part, for DSP slices or block RAM, or for look-up tables that by estimate are more"
        f" than {100 * LUT_MARGIN:.0f}% too many. Block RAM here is what the memories need by formula.",
        "Wall time: measured when the build's step last ran, on whatever machine that was.",
    ]
