# amaranth: UnusedElaboratable=no
"""The top level through its AXI ports: bit-exact outputs, latencies, faults; one simulator per scene."""

import json
from itertools import product

import numpy as np
import pytest
from top_hardware import MILD, NAME, Hardware, check_frames

from fastac.gateware.cycle_model import CycleModel
from fastac.gateware.datapath import Datapath
from fastac.gateware.force.force_sum import ForceSum
from fastac.gateware.mlp_mvm import MvmCore
from fastac.models.emulator.pipeline import Emulator
from fastac.models.random_bundle import NUMBERS, scene
from fastac.models.result import concatenate
from fastac.sim.check_top import SLIP, bench_settings, expected_words
from fastac.sim.runner import QUICK, build

SHORT_ROWS = 7
"""Rows of the image with the fault "frame_short"."""


def repaired(image: np.ndarray, fault: str, lanes: int) -> np.ndarray:
    """The image that FrameGuard makes of one with a fault of `faulty`: padded with the last pixel."""
    image = image.copy()
    if fault == "line_short":
        image[5, 3 * lanes :] = image[5, 3 * lanes - 1]
    elif fault == "line_short, the last":
        image[-1, lanes:] = image[-1, lanes - 1]
    elif fault.startswith("frame_short"):
        image[SHORT_ROWS:] = image[SHORT_ROWS - 1, -1]
    return image


def faulty(number: int, fault: str, height: int, line: int) -> list[list[int]]:
    """The lines (image, row, beats, tlast, tuser) of an image with a fault."""
    lines = [[number, row, line, 1, int(row == 0)] for row in range(height)]
    if fault == "line_short":
        lines[5][2] = 3
    elif fault == "line_short, the last":
        lines[-1][2] = 1
    elif fault == "line_long":
        lines[4][2] += 2
    elif fault == "line_long, no end":
        lines[4][3] = 0
    elif fault == "frame_short":
        lines = lines[:SHORT_ROWS]
    elif fault == "frame_long":
        lines += [[number, 0, line, 1, 0]] * 3
    elif fault == "no_start":
        lines = [[number, 0, line, 1, 0]] * 2
    return lines


def check_faults(hardware: Hardware) -> None:
    """Faulty input, resets and the host's controls; see sim/benches/top_faults.py."""
    pipeline, lanes = hardware.pipeline, hardware.top.lanes
    height, width, _ = pipeline.background.shape
    mild = list(hardware.frames(*MILD))
    images, scenarios = list(mild), {}

    def lines(number: int, fault: str = "") -> list[list[int]]:
        return faulty(number, fault, height, width // lanes)

    faults = ("line_short", "line_short, the last", "line_long", "line_long, no end", "frame_short")
    for fault in (*faults, "frame_long", "no_start"):
        kind = fault.split(",")[0]
        scenario = {"errors": [kind]}
        if kind == "no_start":
            scenario |= {"lines": lines(0, fault) + lines(1), "frames": [1], "bad": [0]}
        elif kind == "frame_long":
            scenario |= {"lines": lines(0, fault) + lines(1), "frames": [0, 1], "bad": [0, 0]}
        else:
            if fault == "line_long, no end":  # the next line is dropped, so the frame is too short
                scenario["errors"] = ["line_long", "frame_short"]
                images.append(np.concatenate([mild[1][:5], mild[1][6:], mild[1][-1:]]))
                images[-1][-1] = images[-1][-2, -1]
            else:
                images.append(repaired(mild[1], fault, lanes))
            twice = [len(images) - 1] * 2
            scenario |= {
                "lines": lines(0) + lines(1, fault) * 2 + lines(2) + lines(3),
                "frames": [0, *twice, 2, 3],
                "bad": [0, 1, 1, 0, 0],
            }
        scenarios[fault.replace(", ", "_").replace(" ", "_")] = scenario

    background = len(images)
    images.append(pipeline.background)
    images += list(hardware.frames(255, 60, 80, 40))
    # Extreme values in a corner pixel, which the solver does not use, to saturate slopes only.
    for values in product((0, 255), repeat=pipeline.background.shape[-1]):
        images.append(pipeline.background.copy())
        images[-1][0, 0] = values
    images = np.array(images)
    results = [Emulator(pipeline).run(images)]
    of_scene = {
        "gradient_saturated": pipeline.scene.wants_slopes,
        "displacement_saturated": pipeline.scene.force_from_displacement,
    }
    errors = [
        tuple(name for name, wanted in of_scene.items() if wanted and getattr(results[0], name)[k])
        + ("frame_suspect",) * bool(results[0].validity[k])
        for k in range(len(images))
    ]
    assert not any(errors[: len(MILD)])
    for scenario in scenarios.values():
        scenario["errors"] += {name for k in scenario["frames"] for name in errors[k]}
    saturating = {kinds: k for k, kinds in enumerate(errors) if kinds}
    if all(of_scene.values()):
        kinds = {tuple(name for name in names if name != "frame_suspect") for names in saturating} - {()}
        assert len(kinds) == 3, f"{list(saturating)}: one of each kind and both are wanted"
    assert any("frame_suspect" in kinds for kinds in saturating)

    # The following frames have the second frame as their background.
    captured = len(images)
    images = np.concatenate([images, mild[1:4]])
    results.append(Emulator(pipeline.replace(background=mild[1])).run(np.array(mild[1:4])))
    assert not results[1].gradient_saturated.any()
    assert not results[1].validity.any()
    result = concatenate(results)
    archive = {"frames": images, "validity": result.validity, **expected_words(hardware.top, result)}
    if pipeline.scene.wants_force:
        archive["force"] = result.force_raw
    if pipeline.interval is not None:
        archive["half_widths"] = result.force_half_width_raw
    if pipeline.scene.wants_slip:
        words = dict(zip(SLIP, (result.slip_words, result.slip_dots), strict=True))
        archive |= words | {"slipping": result.slipping}
    folder = hardware.folder / "faults"
    folder.mkdir()
    np.savez(folder / "frames.npz", **archive)
    settings = bench_settings(hardware.top) | {
        "timeout_cycles": 20_000,
        "row_order": next((o.row_order for o in hardware.top.outputs if o.tagged), None),
        "scenarios": scenarios,
        "short_rows": SHORT_ROWS,
        "background": background,
        "captured": captured,
        "after_capture": [captured + 1, captured + 2],
        "saturating": [[k, list(errors)] for errors, k in saturating.items()],
    }
    (folder / "settings.json").write_text(json.dumps(settings))
    runner = build(hardware.source, NAME, hardware.folder / "sim" / "build", build_args=QUICK)
    runner.test(
        hdl_toplevel=NAME,
        test_module="fastac.sim.benches.top_faults",
        build_dir=hardware.folder / "sim" / "build",
        extra_env={"BENCH": str(folder)},
    )


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


@pytest.mark.long
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
        deep_mm=0.003,
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
