# amaranth: UnusedElaboratable=no
"""Only what a scene needs is built; latencies and intervals follow the formulas."""

import re
from pathlib import Path

import pytest

from fastac.gateware.datapath import Datapath
from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.top_zynq import TopZynq
from fastac.models.random_bundle import random_bundle, scene
from fastac.scenes.model_schema import Numbers
from fastac.scenes.schema import Hardware, load

SCENES = Path(__file__).parents[2] / "scenes"
EVERYTHING = ("normals", "depth", "force_z")
BEYOND = {"solver": "tridiagonal", "kernel": "collapsed", "weights": "baked"}
WANTED = {
    "depth": {"outputs": ("depth",)},
    "depth, difference": {"outputs": ("depth",), "mode": "difference", "weights": "baked"},
    "force": {"outputs": ("force_z",)},
    "force, difference": {"outputs": ("force_z",), "mode": "difference", "weights": "baked"},
    "normals and depth": {"outputs": ("normals", "depth")},
    "normals": {"outputs": ("normals",)},
    "everything": {"outputs": EVERYTHING},
    "force map": {"outputs": ("force_z", "force_map"), "solver": "tridiagonal"},
    "collapsed": {"outputs": ("force_z",), "kernel": "collapsed"},
    "fast": {"outputs": ("depth", "force_xyz"), "mode": "difference", **BEYOND},
    "adjoint": {"outputs": ("force_xyz",), "solver": "adjoint", "weights": "baked"},
    "adjoint, loadable": {"outputs": ("normals", "force_x"), "solver": "adjoint"},
    "dots": {"outputs": ("force_xyz",), "solver": "adjoint", "dots": True, "bridge_dots": True, "size": 24},
    "bridged": {"outputs": ("depth",), "bridge_dots": True, **BEYOND},
    "slip": {"outputs": ("force_z", "slip"), "dots": True, "size": 24, **BEYOND},
    "interval": {"outputs": ("force_xyz",), "solver": "adjoint", "coverage": 0.9},
}
"""Scenes that need different parts; below, for each part the scenes that need it."""
ADJOINT = {"adjoint", "adjoint, loadable", "dots", "interval"}
SLOPES = set(WANTED) - {"normals"}
SOLVER = SLOPES - ADJOINT
TRIDIAGONAL = {"force map", "fast", "bridged", "slip"}
DEPTH = {"depth", "depth, difference", "normals and depth", "everything", "fast", "bridged"}
BRIDGED = {"dots", "bridged"}
DOTS = {"dots", "slip"}
DARK = BRIDGED | DOTS
DISPLACEMENT = {"force", "force, difference", "everything", "force map", "collapsed", "fast", "slip"}
FORCE = DISPLACEMENT | ADJOINT
PATCH = DISPLACEMENT - {"collapsed", "fast", "slip"}
LOADABLE = {name for name, wanted in WANTED.items() if wanted.get("weights") != "baked"}
NORMALS = {"normals and depth", "normals", "everything", "adjoint, loadable"}
NEEDED = {
    "datapath.guard": set(WANTED),
    "datapath.background": set(WANTED),
    "datapath.mlp": set(WANTED),
    "datapath.validity": set(WANTED),
    "datapath.validity.change_count": set(WANTED),
    "datapath.validity.gradient_count": SLOPES,
    "datapath.validity.displacement_count": DISPLACEMENT,
    "datapath.divider": SLOPES,
    "datapath.solver": SOLVER,
    "datapath.solver.row_forward": SOLVER,
    "datapath.solver.to_columns": SOLVER - TRIDIAGONAL,
    "datapath.solver.division": SOLVER - TRIDIAGONAL,
    "datapath.solver.elimination": TRIDIAGONAL,
    "datapath.solver.reversal": TRIDIAGONAL,
    "datapath.depth_output": DEPTH,
    "datapath.depth_output.rest": {"depth, difference", "fast"},
    "datapath.darkness": DARK,
    "datapath.bridge": BRIDGED,
    "datapath.dots": DOTS,
    "datapath.validity.dots_count": DOTS,
    "datapath.pixels_fork": DARK,
    "datapath.darkness_fork": {"dots"},
    "depth_tags": DEPTH,
    "force_map_tags": {"force map"},
    "datapath.displacement": DISPLACEMENT,
    "datapath.displacement.rest": DISPLACEMENT - {"force, difference", "fast"},
    "datapath.force_stream": FORCE,
    "datapath.force_stream.generator": PATCH,
    "datapath.force_stream.response.kernels": PATCH,
    "datapath.force_stream.weights": FORCE - PATCH,
    "datapath.normals_fork": NORMALS - {"normals"},
    "datapath.dots.fork": {"slip"},
    "datapath.displacement_fork": {"slip"},
    "datapath.slip_stream": {"slip"},
    "datapath.slip_stream.contact": {"slip"},
    "datapath.slip_stream.sums": {"slip"},
    "datapath.slip_stream.ratio": {"slip"},
    "datapath.interval_stream": {"interval"},
    "datapath.solution_fork": {"everything", "fast"},
    "registers.timer": set(WANTED),
}
ABSENT = {
    "transposer": SOLVER - TRIDIAGONAL,
    "to_columns": SOLVER - TRIDIAGONAL,
    "to_rows": SOLVER - TRIDIAGONAL,
    "column_": SOLVER - TRIDIAGONAL,
    "elimination": TRIDIAGONAL,
    "generator": PATCH,
    "kernels": PATCH,
    "response": PATCH,
    "displacement": DISPLACEMENT,
    "force": FORCE,
    "solver": SOLVER,
    "divider": SLOPES,
    "calibration": LOADABLE,
    "dark": DARK,
    "bridge": BRIDGED,
    "dots": DOTS,
    "slip": {"slip"},
    "interval": {"interval"},
}
"""Words that module names may contain only in these scenes: no remains of a part under another name."""
PORTS = {
    "s_axis": set(WANTED),
    "s_axil": set(WANTED),
    "m_axis_depth": DEPTH,
    "m_axis_normals": NORMALS,
    "m_axis_force_map": {"force map"},
}
WORDS = {
    r"\bforce_z\b": FORCE - {"adjoint, loadable"},
    r"\bforce_x\b": ADJOINT | {"fast"},
    r"\bforce_y\b": {"adjoint", "fast", "dots", "interval"},
    r"\bhalf_width_z\b": {"interval"},
    r"\bforce_z_high\b": FORCE - {"adjoint, loadable"},
    r"\bfirst_to_force\b": FORCE,
    r"\bfirst_to_depth\b": DEPTH,
    r"\bfirst_to_normals\b": NORMALS,
}
"""Names of signals of loadable registers that the Verilog may contain only in these scenes."""


@pytest.mark.parametrize("name", WANTED)
@pytest.mark.quick(
    "everything",
    "force map",
    "adjoint, loadable",
    "slip",
    mutate=["depth, difference", "force", "normals"],
)
def test_only_what_the_scene_requires_is_built(tmp_path, name):
    bundle = random_bundle(tmp_path / "bundle", scene(**WANTED[name]), hidden=(2,))
    top = TopZynq(bundle)
    text = to_verilog(top, name="fastac")
    modules = {
        match.replace("\\", "").removeprefix("fastac.")
        for match in re.findall(r"^module (\S+) ?\(", text, re.MULTILINE)
    }
    for part, needed in NEEDED.items():
        assert (part in modules) == (name in needed), part
    for part, needed in ABSENT.items():
        assert name in needed or not any(part in module for module in modules), part
    ports = re.search(r"^module fastac\((.*?)\);", text, re.MULTILINE | re.DOTALL)[1].split(", ")
    for prefix, needed in PORTS.items():
        assert any(port.startswith(f"{prefix}_") for port in ports) == (name in needed), prefix
    known = {"clk", "rst", "interrupt"}
    assert not [port for port in ports if port not in known and not port.startswith(tuple(PORTS))]
    for word, needed in WORDS.items():
        assert bool(re.search(word, text)) == (name in needed), word

    registers = {register.name for register in top.identity.registers}
    needed_by = {"FORCE": FORCE, "DEPTH": DEPTH, "NORMALS": NORMALS, "CALIBRATION": LOADABLE}
    needed_by |= {"SLIP": {"slip"}, "HALF_WIDTH": {"interval"}}
    for kind, needed in needed_by.items():
        assert any(kind in register for register in registers) == (name in needed), kind
    multipliers = top.datapath.multipliers
    assert ("depth" in multipliers, "force" in multipliers) == (name in SOLVER, name in FORCE)
    assert bool(multipliers["normals"]) == (name in LOADABLE)
    assert multipliers.get("slip", 0) == 4 * (name == "slip")
    assert multipliers.get("interval", 0) == (name == "interval")


def test_a_bundle_without_the_interval_that_its_scene_wants(tmp_path):
    pipeline = random_bundle(tmp_path / "bundle", scene(**WANTED["interval"])).pipeline
    with pytest.raises(ValueError, match=r"force\.coverage = 0\.9: the pipeline has no interval"):
        Datapath(pipeline.replace(interval=None))


SHIPPED = {
    "paper": ({"solver.to_columns", "solver.division", "force_stream.generator"}, {"solver.elimination"}),
    "fast": (
        {"solver.elimination", "depth_output", "force_stream.weights"},
        {"solver.to_columns", "solver.to_rows", "solver.division", "generator", "response", "calibration"},
    ),
    "force": (
        {"divider", "force_stream.weights"},
        {"solver", "depth", "displacement", "generator", "response", "calibration"},
    ),
}
"""For each shipped scene: modules that must exist, and words that no module name may contain."""
PORTS_OF_SHIPPED = {"paper": {"m_axis_depth"}, "fast": {"m_axis_depth"}, "force": set()}


@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.quick("paper")
def test_what_shipped_scenes_leave_out(tmp_path, name):
    """The scene's file with a smaller image."""
    shipped = load(SCENES / f"{name}.toml")
    small = shipped.sensor.model_copy(update={"height_px": 24, "width_px": 24})
    top = TopZynq(random_bundle(tmp_path / "b", shipped.model_copy(update={"sensor": small}), hidden=(2,)))
    text = to_verilog(top, name="fastac")
    modules = [m.replace("\\", "") for m in re.findall(r"^module (\S+) ?\(", text, re.MULTILINE)]
    present, absent = SHIPPED[name]
    for part in present:
        assert f"fastac.datapath.{part}" in modules, part
    for word in absent:
        assert not [module for module in modules if word in module], word
    ports = re.search(r"^module fastac\((.*?)\);", text, re.MULTILINE | re.DOTALL)[1].split(", ")
    outputs = {port.rsplit("_", 1)[0] for port in ports if port.startswith("m_axis_")}
    assert outputs == PORTS_OF_SHIPPED[name]
    assert bool(top.datapath.multipliers["normals"]) == (name == "paper")


@pytest.fixture(scope="module")
def paper(tmp_path_factory):
    """The pipeline of a scene at full size: 128×128 pixels, N = 126, the paper's network and kernels."""
    numbers = Numbers(gradient_fraction_bits=14, slope_limit=4).model_dump()
    wanted = scene(EVERYTHING, size=128, channels="bgr+nir", kernel_size=5, numbers=numbers)
    return random_bundle(tmp_path_factory.mktemp("paper") / "bundle", wanted, hidden=(16, 16, 16)).pipeline


def at(pipeline, lanes: int, **changes) -> Datapath:
    settings = Hardware(pixels_per_clock=lanes)
    return Datapath(
        pipeline.replace(scene=pipeline.scene.model_copy(update={"hardware": settings, **changes}))
    )


@pytest.mark.parametrize("lanes", [1, 2, 4])
@pytest.mark.full
def test_cycles_at_full_size(paper, lanes):
    """Latencies computed by hand for W = 128, N = 126, K = 5 and B beats per row."""
    path, rows, row = at(paper, lanes), 126, -(-126 // lanes)
    frame = 128 * 128 // lanes
    # Guard, background, four tiles with their adder trees, three requantisations, skid buffer.
    normals = 2 + 3 + (5 + 3) + 3 * (5 + 4) + 3 * 6 + 1
    # The last source needs its look-ahead of rows and columns, and 5 clocks.
    source = 127 * 128 // lanes + (row - 1) + (2 if lanes == 1 else 1) + 5 + 1
    transform = 5 + 6 + (row - 1)
    transposition = 3 + rows * row - 1
    stages = {
        "normals": normals,
        "gradients": 17 + 2,
        "source": source,
        "row_forward": transform,
        "to_columns": transposition,
        "column_forward": transform + 1,
        "division": path.solver.division.latency + 1,
        "column_inverse": transform,
        "to_rows": transposition,
        "row_inverse": transform,
        "solution_buffer": 1,
        # Subtraction from rest with its ROM; patches look 2 rows and columns ahead; trees over K² and lanes.
        "force": 4 + 2 * row + -(-2 // lanes) + 3 + (5 + 5) + (lanes.bit_length() - 1) + 1,
    }
    assert path.stages == stages
    total = sum(stages.values())
    assert path.first_pixel_to_force == total
    assert path.first_pixel_to_depth == total - stages["force"] + 1
    assert path.first_pixel_to_normals == normals + frame - 1
    assert path.interval == frame
    assert path.multipliers == {
        # Two products per DSP48E2 except in the last layer (12 bits), and one per activation.
        "normals": lanes * ((6 * 16 + 16 * 16 + 16 * 16) // 2 + 16 * 3 + 3 * 16),
        "depth": lanes * (4 * 63 + 1),
        "force": lanes * 25,
    }
    budget, interval = {1: (50_000, 16_640), 2: (25_000, 8_320), 4: (12_600, 4_160)}[lanes]
    assert total <= budget
    assert path.interval <= interval
    assert lanes > 1 or sum(path.multipliers.values()) <= 1968 // 2


@pytest.mark.full
def test_absent_outputs_add_no_latency(paper):
    def of(*outputs: str) -> Datapath:
        return at(paper, 1, outputs=outputs)

    whole = of(*EVERYTHING)
    assert of("force_z").first_pixel_to_force == whole.first_pixel_to_force
    depth = of("depth")
    assert "force" not in depth.stages
    assert depth.first_pixel_to_depth == sum(depth.stages.values()) + 1 == whole.first_pixel_to_depth
    normals = of("normals")
    assert normals.stages == {"normals": normals.first_pixel_to_normals}
    assert normals.first_pixel_to_normals == whole.first_pixel_to_normals
    assert normals.interval == 128 * 128
