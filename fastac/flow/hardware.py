# amaranth: UnusedElaboratable=no
"""From a bundle to Verilog and Vivado's files, and through the simulator."""

import hashlib
import json
import subprocess
from pathlib import Path

import numpy as np

from fastac.gateware.host_interface import host_interface
from fastac.gateware.target.device import DeviceError
from fastac.gateware.target.elaboration import LINT_WAIVERS, to_rtlil, verilog_of
from fastac.gateware.target.register_files.write import write_register_files
from fastac.gateware.target.vivado import write_vivado_project
from fastac.gateware.top_zynq import TopZynq
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import Bundle
from fastac.sensor.dataset import Dataset
from fastac.sim import check_top as simulation
from fastac.sim.runner import EXECUTABLE, QUICK, use_verilator
from fastac.store.files import write_folder_atomically, write_json
from fastac.store.progress import watched
from fastac.synth import fits

NAME = "fastac"
REGISTERS = "registers"
"""Folder, beside the Verilog, of the register map in the forms that other tools read."""
SHORT_RUN_PX = 1 << 13
"""Runs with fewer pixels in all take less time with a simulator that is built without optimisation."""


class HardwareError(RuntimeError):
    """Hardware that cannot be built; the message is one line."""


def write_verilog(bundle: Bundle, folder: Path, *, progress: bool) -> None:
    """Elaborate the bundle's top-level into `folder`: Verilog, Vivado's script and constraints, registers.

    The folder appears whole or not at all. Verilator must lint the Verilog clean with -Wall but for the
    waivers in gateware/target/lint.vlt. Raises HardwareError with its first finding otherwise, and, before
    anything is elaborated, where the part has fewer DSP slices or block RAMs than the design needs, or by
    estimate clearly fewer look-up tables.
    """
    top = TopZynq(bundle)
    try:
        fits.area(bundle.pipeline).check()
    except DeviceError as error:
        raise HardwareError(f"{bundle.scene.name}: {error}") from None
    with watched("elaborating Verilog", enabled=progress):
        rtlil = to_rtlil(top, name=NAME)
        text = verilog_of(rtlil)
    with write_folder_atomically(folder) as temporary:
        hardware = bundle.scene.hardware
        write_vivado_project(text, temporary, hardware.clock_mhz, part=hardware.part, name=NAME)
        write_json(temporary / "hardware.json", describe(top, rtlil))
        write_register_files(interface(top), temporary / REGISTERS)
        with watched("linting", enabled=progress):
            lint(temporary / f"{NAME}.v")


def lint(source: Path) -> None:
    """Verilator -Wall with the project's waivers; raises HardwareError with the first finding."""
    use_verilator()
    done = subprocess.run(
        [EXECUTABLE, "--lint-only", "-Wall", "--top-module", NAME, LINT_WAIVERS, source],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise HardwareError(f"{source}: lint: {(done.stderr.splitlines() or ['failed'])[0]}")


def interface(top: TopZynq) -> dict:
    """Which design this is, for which part, and all that a host's driver must know of it."""
    return {
        "top": NAME,
        "bundle_sha256": top.bundle.digest,
        "part": top.bundle.scene.hardware.part,
        **host_interface(top),
    }


def interface_of(bundle: Bundle) -> dict:
    """`interface` of a bundle's hardware, of which nothing is elaborated."""
    return interface(TopZynq(bundle))


def describe(top: TopZynq, rtlil: str) -> dict:
    """What the design says of itself: formulas' values, the host's interface, and the hash of its netlist."""
    path = top.datapath
    latency = {"stage": path.stages, "initiation_interval": path.interval}
    if path.scene.force_beside_depth:
        latency["force_stage"] = path.force_stages
    if path.wants_force:
        latency["first_pixel_to_force"] = path.first_pixel_to_force
    if path.wants_interval:
        latency["force_to_half_widths"] = path.force_to_half_widths
    if path.wants_depth:
        latency["first_pixel_to_depth"] = path.first_pixel_to_depth
    if path.wants_normals:
        latency["first_pixel_to_normals"] = path.first_pixel_to_normals
    latency |= {f"first_pixel_to_{name}_packet": at for name, at in path.first_pixel_to_packet.items()}
    return {
        **interface(top),
        "rtlil_sha256": hashlib.sha256(rtlil.encode()).hexdigest(),
        "latency_cycles_by_formula": latency,
        "multipliers": path.multipliers,
    }


def check_verilog(bundle: Bundle, folder: Path) -> None:
    """Raise HardwareError unless `folder` holds the Verilog of this very bundle."""
    try:
        stated = str(json.loads((folder / "hardware.json").read_text())["bundle_sha256"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise HardwareError(f"{folder / 'hardware.json'}: {error!r}: no Verilog was written here") from None
    if stated != bundle.digest:
        raise HardwareError(
            f"{folder}: bundle_sha256 = {stated[:16]}…: the bundle's is {bundle.digest[:16]}…; write it again"
        )


def simulate(
    bundle: Bundle,
    data: Dataset,
    index: np.ndarray,
    verilog_folder: Path,
    folder: Path,
    *,
    trace: str | None = None,
    progress: bool,
) -> dict:
    """Frames `index` of a dataset through the Verilog in `verilog_folder`, back to back, all compared.

    trace : "saif" or "fst": kind of trace of the run, in `sim.check_top.trace_file(folder, NAME, trace)`
    The hardware starts with the bundle's background in its memory, and so does the reference.
    """
    check_verilog(bundle, verilog_folder)
    frames = data.frames[index]
    result = Emulator(bundle.pipeline).run(bundle.pipeline.seen(frames), progress=progress)
    source = verilog_folder / f"{NAME}.v"
    pixels = len(index) * bundle.scene.sensor.height_px * bundle.scene.sensor.width_px
    found = simulation.simulate(
        bundle,
        source,
        frames,
        result,
        folder,
        name=NAME,
        build_args=QUICK if pixels < SHORT_RUN_PX else (),
        trace=trace,
        progress=progress,
    )
    return found.as_dict()
