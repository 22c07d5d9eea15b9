# amaranth: UnusedElaboratable=no
"""The top level through its AXI ports: bit-exact outputs, latencies, faults; one simulator per scene."""

from itertools import product

import numpy as np
import pytest
from faulty_frames import check_faults
from top_hardware import MILD, Hardware, check_frames

from fastac.gateware.cycle_model import CycleModel
from fastac.gateware.datapath import Datapath
from fastac.gateware.force.force_sum import ForceSum
from fastac.gateware.mlp_mvm import MvmCore
from fastac.models.emulator.pipeline import Emulator
from fastac.models.random_bundle import NUMBERS, scene


@pytest.mark.long
def test_normals_depth_and_force(tmp_path):
    """The paper's architecture, with normals: absolute depth, four channels, one pixel per clock."""
    hardware = Hardware(tmp_path, outputs=("normals", "depth", "force_z"), channels="bgr+nir")
    check_frames(hardware)
    check_faults(hardware)


@pytest.mark.full
def test_tridiagonal_force_map_and_two_axes(tmp_path):
    """Last row first, and with void lanes: 18 columns are 4.5 beats of four lanes."""
    hardware = Hardware(
        tmp_path,
        outputs=("depth", "force_x", "force_z", "force_map"),
        channels="bgr+nir",
        solver="tridiagonal",
        mode="difference",
        weights="baked",
        lanes=4,
        size=20,
    )
    check_frames(hardware)
    check_faults(hardware)


ADJOINT = {"outputs": ("force_xyz",), "solver": "adjoint", "lanes": 2}


@pytest.mark.full
def test_adjoint_force(tmp_path):
    check_frames(Hardware(tmp_path, **ADJOINT))


@pytest.mark.full
def test_adjoint_faults(tmp_path):
    check_faults(Hardware(tmp_path, **ADJOINT))


BESIDE = {
    "outputs": ("depth", "force_xyz"),
    "solver": "tridiagonal",
    "mode": "difference",
    "lanes": 2,
    "source": "slopes",
}


@pytest.mark.full
def test_force_of_slopes_before_the_depth(tmp_path):
    """The force as early as the adjoint's, with rows of the weights in the order of the slopes, though the
    last row of depth comes first."""
    hardware = Hardware(tmp_path, **BESIDE)
    path = hardware.top.datapath
    alone = CycleModel(scene(("force_xyz",), solver="adjoint", lanes=2), hidden=(4,))
    assert path.first_pixel_to_force == alone.first_pixel_to_force < path.first_pixel_to_depth - path.beats
    check_frames(hardware)
    check_faults(hardware)


@pytest.mark.full
def test_force_of_slopes_and_dots_before_the_depth(tmp_path):
    settings = {"solver": "dst2d", "dots": True, "bridge_dots": True, "weights": "baked"}
    hardware = Hardware(tmp_path, **BESIDE | settings)
    check_frames(hardware)
    check_faults(hardware)


DOTS = {"outputs": ("force_xyz",), "solver": "adjoint", "dots": True, "bridge_dots": True}


@pytest.mark.full
def test_force_of_slopes_and_dots(tmp_path):
    """Dots are known last; with bridged slopes, and with faults of camera and host."""
    hardware = Hardware(tmp_path, **DOTS)
    assert hardware.top.datapath.stages["dots"] > ForceSum.latency
    check_frames(hardware)
    check_faults(hardware)


@pytest.mark.full
def test_force_of_displacement_beyond_bends_and_dots(tmp_path):
    """The dots wait for the displacement."""
    hardware = Hardware(
        tmp_path,
        outputs=("depth", "force_xyz"),
        channels="bgr+nir",
        solver="tridiagonal",
        mode="difference",
        kernel="collapsed",
        weights="baked",
        lanes=2,
        size=32,
        dots=True,
        bridge_dots=True,
        band_mm=0.001,
        deep_mm=(0.003, 0.006),
        block_px=4,
    )
    assert hardware.top.datapath.stages["dots"] == ForceSum.latency
    check_frames(hardware)


@pytest.mark.long
def test_half_widths_of_forces(tmp_path):
    """Of slopes, whose measures are known last; weights and base are those of the first calibration."""
    hardware = Hardware(tmp_path, **ADJOINT | {"coverage": 0.9})
    stream = hardware.top.datapath.interval_stream
    assert list(stream.groups) == ["features", "slopes"]
    assert hardware.top.datapath.force_to_half_widths == stream.latency
    check_frames(hardware)


@pytest.mark.full
def test_half_widths_beside_depth_and_dots(tmp_path):
    hardware = Hardware(tmp_path, **BESIDE | {"dots": True, "weights": "baked", "coverage": 0.8})
    check_frames(hardware)
    check_faults(hardware)


SLIPPING = {
    "outputs": ("depth", "force_x", "force_z", "slip"),
    "channels": "bgr+nir",
    "solver": "tridiagonal",
    "mode": "difference",
    "kernel": "collapsed",
    "lanes": 2,
    "size": 24,
    "dots": True,
}


@pytest.mark.full
def test_slip(tmp_path):
    """Dots wait for the displacement, whose last row comes first, and the force for the spread."""
    hardware = Hardware(tmp_path, **SLIPPING)
    assert hardware.top.datapath.stages["slip"] > 0
    found = Emulator(hardware.pipeline).run(hardware.frames(*MILD, 120, 255))
    assert len(np.unique(found.slip_words)) == 3
    assert 0 < found.slipping.sum() < len(found.slipping)
    check_frames(hardware)


@pytest.mark.full
def test_slip_faults(tmp_path):
    check_faults(Hardware(tmp_path, **SLIPPING))


@pytest.mark.full
def test_force_of_patches_and_dots(tmp_path):
    settings = {"dots": True, "bridge_dots": True, "lanes": 2}
    check_frames(Hardware(tmp_path, outputs=("force_x", "force_z"), **settings))


@pytest.mark.parametrize("activation_bits", [9, 10])
@pytest.mark.full
def test_a_part_whose_multipliers_are_narrower(tmp_path, activation_bits):
    """The same integers, whether products of the last layer share a DSP48E1 or, longer by a bit, do not."""
    settings = {
        "outputs": ("depth", "force_xyz"),
        "solver": "tridiagonal",
        "kernel": "collapsed",
        "mode": "difference",
        "numbers": NUMBERS | {"activation_bits": activation_bits},
    }
    hardware = Hardware(tmp_path, part="xc7z020clg400-1", **settings)
    default = Datapath(hardware.pipeline.replace(scene=scene(**settings)))
    packed = [
        [core.packing for core in path.mlp.cores[0].values() if isinstance(core, MvmCore)]
        for path in (hardware.top.datapath, default)
    ]
    assert packed[0][0] is not None
    assert (packed[0][1] is not None) == (activation_bits == 9)
    assert packed[1][1] is not None
    assert packed[0] != packed[1]
    check_frames(hardware)


@pytest.mark.full
def test_depth_over_bridged_slopes_without_a_force(tmp_path):
    check_frames(Hardware(tmp_path, outputs=("depth",), bridge_dots=True, lanes=4))


@pytest.mark.full
def test_normals_depth_and_force_map(tmp_path):
    hardware = Hardware(
        tmp_path,
        outputs=("normals", "depth", "force_x", "force_z", "force_map"),
        channels="bgr+nir",
        lanes=2,
    )
    check_frames(hardware)
    check_faults(hardware)


@pytest.mark.full
def test_normals_alone(tmp_path):
    """Without force and depth, the normal map is a frame's result."""
    hardware = Hardware(tmp_path, outputs=("normals",), lanes=4, channels="bgr+nir")
    check_frames(hardware)
    check_faults(hardware)


@pytest.mark.full
def test_tridiagonal_collapsed_kernels(tmp_path):
    hardware = Hardware(
        tmp_path,
        outputs=("depth", "force_xyz"),
        channels="bgr+nir",
        solver="tridiagonal",
        kernel="collapsed",
        weights="baked",
        lanes=2,
    )
    check_frames(hardware)
    check_faults(hardware)


@pytest.mark.full
def test_force_map_with_larger_kernels(tmp_path):
    settings = {"solver": "tridiagonal", "kernel_size": 5, "mode": "difference", "weights": "baked"}
    check_frames(
        Hardware(tmp_path, outputs=("depth", "force_y", "force_z", "force_map"), lanes=4, size=24, **settings)
    )


@pytest.mark.full
def test_odd_size_backward_differences_and_floor(tmp_path):
    settings = {"divergence": "backward", "rounding": "floor", "clamp": False, "kernel_size": 3}
    check_frames(Hardware(tmp_path, outputs=("depth", "force_z"), size=17, **settings))


PAPER = [
    (lanes, weights, mode, (1, 3, 5, 7)[(k + shift) % 4])
    for shift, lanes in enumerate((1, 2, 4))
    for k, (weights, mode) in enumerate(product(("loadable", "baked"), ("absolute", "difference")))
]
"""(lanes, weights, mode, kernel size): all of the first three, every kernel size with each lanes."""


@pytest.mark.parametrize(("lanes", "weights", "mode", "kernel_size"), PAPER)
@pytest.mark.full
def test_lanes_weights_modes_and_kernels(tmp_path, lanes, weights, mode, kernel_size):
    settings = {"lanes": lanes, "weights": weights, "mode": mode, "kernel_size": kernel_size}
    check_frames(Hardware(tmp_path, outputs=("depth", "force_z"), **settings))


BEYOND = [
    (lanes, solver, kernel, size)
    for solver, kernel, sizes in (
        ("tridiagonal", "patch", (16, 16, 24)),
        ("tridiagonal", "collapsed", (16, 20, 24)),
        ("dst2d", "collapsed", (16, 16, 16)),
        ("adjoint", "collapsed", (16, 16, 16)),
    )
    for lanes, size in zip((1, 2, 4), sizes, strict=True)
]


@pytest.mark.parametrize(("lanes", "solver", "kernel", "size"), BEYOND)
@pytest.mark.full
def test_lanes_solvers_and_kernels(tmp_path, lanes, solver, kernel, size):
    outputs = ("force_xyz",) if solver == "adjoint" else ("depth", "force_y", "force_z")
    settings = {"lanes": lanes, "solver": solver, "kernel": kernel, "size": size}
    settings |= {"mode": "difference", "weights": "baked", "clamp": solver == "tridiagonal"}
    check_frames(Hardware(tmp_path, outputs=outputs, **settings))
