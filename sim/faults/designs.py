# amaranth: UnusedElaboratable=no
"""The small hardware of the fault campaign: every solver, lanes and output, weights of both kinds."""

import re
from pathlib import Path

from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.top_zynq import TopZynq
from fastac.models.random_bundle import random_bundle, recalibrated, scene
from fastac.store.files import write_text

NAME = "fastac"
SOURCE, FLOPS, OWN, OTHER = f"{NAME}.v", "registers.vlt", "own", "other"
DESIGNS = {
    "dst2d_1": {
        "outputs": ("normals", "depth", "force_z"),
        "channels": "bgr+nir",
        "mode": "absolute",
    },
    "dst2d_2": {"outputs": ("depth", "force_z"), "lanes": 2, "mode": "absolute", "bus_errors": "respond"},
    "dst2d_4": {
        "outputs": ("depth", "force_xyz", "force_map"),
        "lanes": 4,
        "mode": "difference",
        "weights": "baked",
    },
    "depth_2": {
        "outputs": ("normals", "depth"),
        "lanes": 2,
        "mode": "difference",
        "channels": "bgr+nir",
        "smoothing_px": 4,
    },
    "tridiagonal_1": {
        "outputs": ("normals", "depth", "force_x", "force_z", "force_map"),
        "solver": "tridiagonal",
        "mode": "difference",
    },
    "tridiagonal_2": {
        "outputs": ("depth", "force_xyz"),
        "solver": "tridiagonal",
        "kernel": "collapsed",
        "weights": "baked",
        "lanes": 2,
        "channels": "bgr+nir",
        "bus_errors": "respond",
    },
    "tridiagonal_4": {
        "outputs": ("depth", "force_x", "force_z", "force_map"),
        "solver": "tridiagonal",
        "mode": "difference",
        "lanes": 4,
        "size": 20,
    },
    "adjoint_1": {"outputs": ("force_xyz",), "solver": "adjoint", "weights": "baked"},
    "adjoint_2": {"outputs": ("force_xyz",), "solver": "adjoint", "lanes": 2, "bus_errors": "respond"},
    "adjoint_4": {
        "outputs": ("normals", "force_x", "force_z"),
        "solver": "adjoint",
        "mode": "difference",
        "lanes": 4,
        "channels": "bgr+nir",
    },
    "dots_2": {
        "outputs": ("force_xyz",),
        "solver": "adjoint",
        "dots": True,
        "bridge_dots": True,
        "lanes": 2,
        "channels": "bgr+nir",
    },
    "slip_1": {
        "outputs": ("depth", "force_x", "force_z", "slip"),
        "solver": "tridiagonal",
        "kernel": "collapsed",
        "band_mm": 0.001,
        "deep_mm": 0.003,
        "weights": "baked",
        "dots": True,
        "bridge_dots": True,
        "size": 24,
    },
    "normals_1": {"outputs": ("normals",), "weights": "baked", "bus_errors": "respond"},
    "normals_4": {"outputs": ("normals",), "lanes": 4, "weights": "baked", "smoothing_px": 8},
}
"""Arguments of `models.random_bundle.scene`; the name says the solver, or the last output, and the lanes."""
KEPT_THROUGH_RESETS = {
    "fastac.calibration": None,
    "fastac.datapath.background": {"capturing"},
    "fastac.registers": {"capture_background"},
}
"""Flip-flops that no power-up randomises: by module, all of them or those named. A calibration is kept
through resets on purpose, and so is the background, which these two bits would let be written."""


def elaborate(folder: Path, design: str) -> None:
    """A step: the bundle of a design, another calibration for it, its Verilog, and its flip-flops."""
    own = random_bundle(folder / OWN, scene(**DESIGNS[design]))
    recalibrated(folder / OTHER, own)
    verilog = to_verilog(TopZynq(own), name=NAME)
    write_text(folder / SOURCE, verilog)
    write_text(folder / FLOPS, public_flip_flops(verilog))


def public_flip_flops(verilog: str) -> str:
    """Verilator's control file by which a bench can read and write the flip-flops of Yosys' Verilog.

    Yosys declares what a clock sets with an initial value, and nothing else so.
    """
    module, lines = "", ["`verilator_config"]
    for line in verilog.splitlines():
        if found := re.match(r"module \\?(\S+?)\s*\(", line):
            module = found[1]
        elif found := re.match(r"  reg (?:\[\d+:\d+\] )?\\?(\S+) = ", line):
            kept = KEPT_THROUGH_RESETS.get(module, ())
            if kept is not None and found[1] not in kept:
                lines.append(f'public_flat_rw -module "{module}" -var "{found[1]}"')
    return "\n".join([*lines, ""])
