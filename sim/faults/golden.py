# amaranth: UnusedElaboratable=no
"""What the bench of the fault campaign is given: settings, faults, and the golden results of all frames."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.gateware.calibration import calibration_words
from fastac.gateware.top_zynq import TopZynq
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import bundle as bundles
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.frame_validity import suspects
from fastac.models.random_bundle import frames as random_frames
from fastac.sim.check_top import bench_settings, expected_words
from fastac.sim.faults.designs import OTHER, OWN
from fastac.sim.faults.frame_rules import FrameRules
from fastac.sim.faults.script import MILD, STRONG, Fault, Shape

TIMEOUT = 160
"""FRAME_TIMEOUT in clocks: longer than any pause that the generator makes on purpose."""
SPANS = (*([5, 10, 8, 3] * MILD)[:MILD], *([120, 255, 200] * STRONG)[:STRONG])
"""Largest differences from the background of the bank's images."""


@dataclass(frozen=True, eq=False)
class Hardware:
    """A design's bundle, with its calibrations and golden models."""

    own: Bundle
    other: Bundle
    top: TopZynq

    @classmethod
    def load(cls, own: Path, other: Path) -> "Hardware":
        bundle = bundles.load(own)
        return cls(bundle, bundles.load(other), TopZynq(bundle))

    @property
    def shape(self) -> Shape:
        height, width, _ = self.own.pipeline.background.shape
        return Shape(
            height, width // self.top.lanes, len(self.top.outputs), loadable=self.top.datapath.loadable
        )

    @property
    def bank(self) -> np.ndarray:
        """The images that the frames are made of, (images, H, W, C)."""
        return random_frames(self.own.pipeline.background, SPANS)

    @property
    def calibrations(self) -> dict[str, Bundle]:
        return {OWN: self.own, OTHER: self.other} if self.shape.loadable else {OWN: self.own}

    def settings(self, seed: int) -> dict:
        """What the bench must know of the hardware."""
        top, shape = self.top, self.shape
        identity, path = top.identity, top.datapath
        registers = {register.name: register.offset for register in identity.registers}
        general = bench_settings(top)
        constants = {name: general["identity"][name] for name in ("ID", "GEOMETRY")}
        constants["VERSION"] = identity.version
        if shape.loadable:
            constants |= {
                "CALIBRATION_LAYOUT": identity.calibration_layout,
                "CALIBRATION_WORDS": identity.calibration_words,
                "CALIBRATION": 0,
            }
        streams = {
            output.name: {
                "rows": output.rows,
                "beats": output.beats,
                "octets": output.octets,
                "void_octets": output.void_octets,
                "tagged": output.tagged,
                "row_order": output.row_order,
            }
            for output in top.outputs
        }
        return {
            "seed": seed,
            "timeout": TIMEOUT,
            "height": shape.height,
            "line_beats": shape.line_beats,
            "streams": streams,
            "axes": list(identity.axes),
            "registers": registers,
            "read_only": [r.name for r in identity.registers if r.access == "ro"],
            "constants": constants,
            "absent": sorted(set(range(0, 256, 4)) - set(registers.values())),
            "bus_errors": identity.bus_errors,
            "guard": ["datapath", "guard", "state"],
            "saturations": ["gradient_saturated", "displacement_saturated"],
            "hash": {name: bundle.hash_word for name, bundle in self.calibrations.items()},
            "words": {
                name: calibration_words(bundle, self.own).tolist()
                for name, bundle in (self.calibrations.items() if path.loadable else ())
            },
        }

    def results(self, images: np.ndarray) -> dict[str, np.ndarray]:
        """The golden model's results for images, with both calibrations, as the bench reads them."""
        arrays, scene = {}, self.own.scene
        for name, bundle in self.calibrations.items():
            result = Emulator(bundle.pipeline).run(bundle.pipeline.seen(images))
            words = expected_words(self.top, result)
            for output in self.top.outputs:
                found = words[output.name].reshape(len(images), output.rows, output.columns, -1)
                void = output.beats * output.lanes - output.columns
                found = np.pad(found, ((0, 0), (0, 0), (0, void), (0, 0))).astype("<i4")
                arrays[f"{name}/{output.name}"] = found.reshape(len(images), output.rows * output.beats, -1)
            none = np.zeros((len(images), 0), np.int64)
            arrays[f"{name}/force"] = result.force_raw if scene.wants_force else none
            if scene.wants_slip:
                slip = np.stack([result.slip_words, result.slip_dots], axis=1)
                arrays[f"{name}/force"] = np.concatenate([result.force_raw, slip], axis=1)
            arrays[f"{name}/validity"] = result.validity
            arrays[f"{name}/suspect"] = suspects(result.validity)
            never = np.zeros(len(images), bool)
            displaced = self.top.datapath.wants_displacement
            arrays[f"{name}/saturated"] = np.stack(
                [
                    result.gradient_saturated > 0 if scene.wants_slopes else never,
                    result.displacement_saturated > 0 if displaced else never,
                ],
                axis=1,
            )
        return arrays


def frames_of(fault: Fault, shape: Shape) -> dict[int, tuple[tuple, bool]]:
    """{first beat: (sources, bad)} of every frame that can come of a fault's beats.

    What a frame holds depends on its first beat and those after it alone, whenever a reset comes.
    """
    rules, found = FrameRules(shape.height, shape.line_beats), []
    stops = [event["at"] for event in fault.events if event["do"] == "stop"]
    for k, (*_, last, start, _) in enumerate(fault.beats):
        for _ in range(stops.count(k)):
            rules.silence()
        frame = rules.beat(k, last=bool(last), start=bool(start), enabled=True)
        if frame is not None:
            found.append(frame)
    rules.silence()
    return {frame.start: (tuple(frame.sources), frame.bad) for frame in found}


def image_of(sources: tuple, fault: Fault, bank: np.ndarray, lanes: int) -> np.ndarray:
    """The image that a frame with these sources is, (H, W, C)."""
    _, height, width, channels = bank.shape
    beats = bank.reshape(len(bank), height, width // lanes, lanes, channels)
    image = np.empty((len(sources), lanes, channels), np.uint8)
    for k, (beat, repeated) in enumerate(sources):
        source, row, x, *_ = fault.beats[beat]
        image[k] = beats[source, row, x, -1] if repeated else beats[source, row, x]
    return image.reshape(height, width, channels)


def prepare(hardware: Hardware, chosen: list[Fault], seed: int, folder: Path) -> None:
    """Write the bench's files."""
    bank, lanes, shape = hardware.bank, hardware.top.lanes, hardware.shape
    images, content = [], []
    for fault in chosen:
        rows = {}
        for start, (sources, bad) in frames_of(fault, shape).items():
            rows[start] = [len(images), bad]
            images.append(image_of(sources, fault, bank, lanes))
        content.append([fault.as_dict(), rows])
    octets = bank.reshape(len(bank), shape.height, shape.line_beats, -1)
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / "frames.npz", bank=octets, **hardware.results(np.array(images)))
    (folder / "settings.json").write_text(json.dumps(hardware.settings(seed)))
    (folder / "faults.json").write_text(json.dumps(content))
