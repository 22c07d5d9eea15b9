# amaranth: UnusedElaboratable=no
"""The top level of a random bundle, and its check through the AXI ports: all words, and all latencies."""

import json

import numpy as np

from fastac.gateware.bus.register_map import ERRORS
from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.top_zynq import TopZynq
from fastac.models.emulator.pipeline import Emulator
from fastac.models.random_bundle import frames, random_bundle, scene
from fastac.sim.check_top import SLIP, Report, simulate
from fastac.sim.runner import QUICK

NAME = "fastac"
MILD = (10, 5, 15, 20, 25)
"""Largest differences from the background of frames in which nothing saturates."""


class Hardware:
    """The Verilog of a random bundle, to be simulated in `folder`."""

    def __init__(self, folder, **wanted):
        self.folder = folder
        self.bundle = random_bundle(folder / "bundle", scene(**wanted))
        self.pipeline = self.bundle.pipeline
        self.top = TopZynq(self.bundle)
        self.source = folder / f"{NAME}.v"
        self.source.write_text(to_verilog(self.top, name=NAME))

    def frames(self, *spans: int) -> np.ndarray:
        return frames(self.pipeline.background, spans)

    def run(self, images: np.ndarray, stall=(0, 0)) -> Report:
        result = Emulator(self.pipeline).run(self.pipeline.seen(images))
        folder = self.folder / "sim"
        return simulate(
            self.bundle, self.source, images, result, folder, name=NAME, stall=stall, build_args=QUICK
        )


def check_frames(hardware: Hardware) -> None:
    """All output words, and all latencies as measured by the registers, by the testbench and by formula."""
    path, images = hardware.top.datapath, hardware.frames(*MILD, 120, 255)
    count, size, lanes = len(images), hardware.bundle.scene.inner_px, path.lanes
    axes = len(hardware.bundle.scene.force_axes)
    values = {
        "depth": count * size**2 if path.wants_depth else None,
        "force_map": count * size**2 * axes if path.wants_force_map else None,
        "normals": count * (size + 2) ** 2 * 3 if path.wants_normals else None,
        "force": count * axes,
        "half_widths": count * axes if path.wants_interval else None,
        "slip": count * len(SLIP) if hardware.bundle.scene.wants_slip else None,
    }
    values = {name: number for name, number in values.items() if number}
    result = Emulator(hardware.pipeline).run(hardware.pipeline.seen(images))
    saturated = {
        "gradient_saturated": path.pipeline.scene.wants_slopes and result.gradient_saturated.any(),
        "displacement_saturated": path.wants_displacement and result.displacement_saturated.any(),
    }
    assert not result.validity[: len(MILD)].any()
    assert result.validity[len(MILD) :].all()
    saturated["frame_suspect"] = True
    errors = sum(1 << ERRORS.index(name) for name, seen in saturated.items() if seen)
    for stall in ((0, 0), (0.5, 0.3), (0, 0.8)):
        found = hardware.run(images, stall)
        assert found.mismatches == 0, f"stall {stall}: {found.first_mismatch}"
        assert found.values_by_output == values
        assert found.errors == errors
        if stall != (0, 0):
            continue
        with np.load(hardware.folder / "sim" / "outputs.npz") as archive:
            seen = dict(archive)
        registers = json.loads((hardware.folder / "sim" / "registers.json").read_text())
        assert registers["frame_count"] == count
        assert registers["frame_errors"] == 0
        first_at, last_at = seen["first_at"], seen["last_at"]
        beats, fold = (size + 2) ** 2 // lanes, path.fold
        assert np.array_equal(last_at - first_at, [(beats - 1) * fold] * count)
        assert set(np.diff(first_at)) == {path.interval} == {beats * fold}
        latency = found.latency_cycles
        assert latency["initiation_interval"] == path.interval
        measured = {"INTERVAL": [0] + [path.interval] * (count - 1)}
        # The host reads the registers after the result, when these may be those of other frames.
        of_other_frames = ["INTERVAL"]
        if hardware.bundle.scene.force_beside_depth:
            of_other_frames.append("LATENCY_FIRST_PIXEL_TO_DEPTH")
        # The interrupt rises one clock after its result.
        result_at = seen["interrupt_at"] - 1
        for name in ("normals", "depth"):
            if name in values:
                stated = getattr(path, f"first_pixel_to_{name}")
                at = seen[f"{name}_at"].reshape(count, -1)[:, -1]
                assert np.array_equal(at - first_at, [stated] * count)
                assert latency[f"first_pixel_to_{name}"] == stated
                measured[f"LATENCY_FIRST_PIXEL_TO_{name.upper()}"] = [stated] * count
                if hardware.top.identity.result == name:
                    assert np.array_equal(result_at, at)
        if path.wants_force:
            stated = path.first_pixel_to_force
            assert np.array_equal(result_at - first_at, [stated] * count)
            assert latency["first_pixel_to_force"] == stated == sum(path.force_stages.values())
            assert latency["last_pixel_to_force"] == stated - (beats - 1) * fold
            measured["LATENCY_FIRST_PIXEL_TO_FORCE"] = [stated] * count
            measured["LATENCY_LAST_PIXEL_TO_FORCE"] = [stated - (beats - 1) * fold] * count
        assert sum(latency["stage"].values()) == result_at[0] - first_at[0]
        for name, stated in measured.items():
            column = [frame[name] for frame in registers["frames"]]
            if name not in of_other_frames:
                assert column == stated, name
            else:
                assert set(column) <= {0, *stated}, name
                assert column[-1] == stated[-1]
