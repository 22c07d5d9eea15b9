# amaranth: UnusedElaboratable=no
"""CycleModel equals the Datapath that is built, which test_top_zynq.py compares with Verilator."""

import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from fastac.gateware.cycle_model import CycleModel, cycles, multipliers
from fastac.gateware.datapath import Datapath
from fastac.models.integer.dst2d import reciprocal_distance, reciprocals
from fastac.models.random_bundle import NUMBERS, random_bundle, scene
from fastac.scenes.model_schema import Network, Numbers
from fastac.scenes.schema import load

SCENES = Path(__file__).parents[2] / "scenes"
OPTIONS = {
    "outputs": (
        ("normals",),
        ("depth",),
        ("force_z",),
        ("normals", "depth"),
        ("normals", "force_y"),
        ("depth", "force_xyz"),
        ("force_x", "force_z", "force_map"),
        ("normals", "depth", "force_z", "force_map"),
    ),
    "size": (16, 18, 21, 24, 36),
    "lanes": (1, 2, 4, "1/2", "1/4", "1/8", "1/16"),
    "solver": ("dst2d", "tridiagonal", "adjoint"),
    "mode": ("absolute", "difference"),
    "divergence": ("central", "backward"),
    "kernel": ("patch", "collapsed"),
    "kernel_size": (1, 3, 5, 7),
    "weights": ("loadable", "baked"),
    "channels": ("bgr", "bgr+nir"),
    "clamp": (True, False),
    "source": (None, "slopes"),
    "numbers": (
        NUMBERS,
        {**Numbers().model_dump(), "gradient_fraction_bits": 6},
        {**NUMBERS, "activation_bits": 10, "weight_bits": 8, "last_weight_bits": 16, "slope_limit": 8},
        {**NUMBERS, "displacement_bits": 16, "kernel_bits": 12, "slope_weight_bits": 18},
    ),
    "smoothing_px": (0, 0, 2, 4, 8),
    "hidden": ((4,), (5, 3)),
}


def drawn(count: int) -> list[tuple[dict, object, tuple[int, ...]]]:
    """`count` valid scenes with random options: (options, scene, hidden layers)."""
    rng, found = random.Random(1), []
    while len(found) < count:
        chosen = {name: rng.choice(values) for name, values in OPTIONS.items()}
        wanted = dict(chosen)
        hidden = wanted.pop("hidden")
        try:
            found.append((chosen, scene(**wanted), hidden))
        except ValidationError:
            continue
    return found


def check(path: Datapath, model: CycleModel) -> None:
    assert model.beats == path.beats
    assert model.stages == path.stages
    assert model.modules == path.modules
    assert model.multipliers == path.multipliers
    assert model.interval == path.interval
    for name in ("normals", "depth", "force"):
        if getattr(path, f"wants_{name}"):
            key = f"first_pixel_to_{name}"
            assert getattr(model, key) == getattr(path, key)


@pytest.mark.parametrize("count", [60, 240])
@pytest.mark.quick("60")
def test_random_scenes(tmp_path, count):
    cases = drawn(count)
    for name, values in OPTIONS.items():
        for value in values:
            assert sum(chosen[name] == value for chosen, _, _ in cases) >= count // 50, (name, value)
    for k, (_, wanted, hidden) in enumerate(cases):
        path = Datapath(random_bundle(tmp_path / f"{k}", wanted, hidden=hidden).pipeline)
        check(path, CycleModel(wanted, hidden=hidden))


WITH_INTERVAL = (
    {"outputs": ("force_xyz",), "solver": "adjoint", "lanes": 4, "channels": "bgr+nir"},
    {"outputs": ("depth", "force_z"), "lanes": 2},
    {"outputs": ("depth", "force_x", "force_z"), "solver": "tridiagonal", "lanes": "1/4"},
)


def test_scenes_with_intervals(tmp_path):
    """The measures of their frames never wait for the one multiplier, even of the smallest image."""
    for k, options in enumerate(WITH_INTERVAL):
        wanted = scene(**options, coverage=0.9)
        path = Datapath(random_bundle(tmp_path / f"{k}", wanted).pipeline)
        model = CycleModel(wanted, hidden=(4,))
        check(path, model)
        assert path.multipliers["interval"] == 1
        assert model.force_to_half_widths == path.force_to_half_widths >= path.interval_stream.latency
        assert cycles(wanted, hidden=(4,))["force_to_half_widths"] == path.force_to_half_widths
        assert path.interval_stream.interval < path.beats * path.fold


def for_part(wanted, part):
    hardware = wanted.hardware.model_copy(update={"part": part})
    return wanted.model_copy(update={"hardware": hardware})


def test_random_scenes_with_dsp48e1(tmp_path):
    """As many slices as the design has; without the solver's words, which may be short, never fewer."""
    fewer = packed_otherwise = 0
    for k, (_, wanted, hidden) in enumerate(drawn(40)):
        small = for_part(wanted, "xc7z020clg400-1")
        pipeline = random_bundle(tmp_path / f"{k}", small, hidden=hidden).pipeline
        path, model = Datapath(pipeline), CycleModel(small, hidden=hidden)
        check(path, CycleModel(small, hidden=hidden, solver=pipeline.solver))
        assert all(model.multipliers[stage] >= number for stage, number in path.multipliers.items())
        fewer += model.multipliers != path.multipliers
        packed_otherwise += path.multipliers != multipliers(wanted, hidden=hidden)
    assert fewer
    assert packed_otherwise


def test_slices_of_long_words_on_25_bits(tmp_path):
    """Of words of 26 bits all products take two slices but those of the source, whose words are short."""
    numbers = {"gradient_fraction_bits": 14, "coefficient_fraction_bits": 17, "data_bits": 26}
    for solver, two in (("dst2d", 3 * 11 + 1), ("tridiagonal", 11 + 2)):
        wanted = for_part(scene(("depth",), size=24, solver=solver, numbers=numbers), "xc7z020clg400-1")
        pipeline = random_bundle(tmp_path / solver, wanted).pipeline
        assert {part.input_width for part in list(pipeline.solver.parts.values())[1:]} == {26}
        check(Datapath(pipeline), CycleModel(wanted, hidden=(4,)))
        assert Datapath(pipeline).multipliers["depth"] == 11 + 2 * two


def test_flat_rest_needs_no_table(tmp_path):
    wanted = scene(("depth", "force_z"), mode="difference")
    pipeline = random_bundle(tmp_path, wanted).pipeline
    flat = pipeline.replace(depth=replace(pipeline.depth, rest=np.zeros_like(pipeline.depth.rest)))
    by_geometry = wanted.model_copy(update={"sensor": wanted.sensor.model_copy(update={"geometry": "flat"})})
    check(Datapath(pipeline), CycleModel(wanted, hidden=(4,)))
    check(Datapath(flat), CycleModel(wanted, hidden=(4,), flat=True))
    check(Datapath(flat), CycleModel(by_geometry, hidden=(4,)))
    check(Datapath(pipeline), CycleModel(by_geometry, hidden=(4,), flat=False))
    curved, plane = (cycles(s, hidden=(4,))["first_pixel_to_depth"] for s in (wanted, by_geometry))
    assert curved == plane + 2


@pytest.mark.parametrize("lanes", [1, 2])
@pytest.mark.parametrize("bends_mm", [(), (0.001,), (0.001, 0.003)])
def test_dots(tmp_path, lanes, bends_mm):
    """Of the dots where they are; where they are expected to be, the latency may differ."""
    depth = {"outputs": ("depth", "force_xyz"), "solver": "tridiagonal", "kernel": "collapsed"}
    slopes = {"outputs": ("force_xyz",), "solver": "adjoint"}
    wanted = scene(
        **(depth | dict(zip(("band_mm", "deep_mm"), bends_mm, strict=False)) if bends_mm else slopes),
        dots=True,
        bridge_dots=True,
        lanes=lanes,
        size=24,
    )
    pipeline = random_bundle(tmp_path, wanted).pipeline
    path = Datapath(pipeline)
    check(path, CycleModel(wanted, hidden=(4,), follower=pipeline.follower))
    assert CycleModel(wanted, hidden=(4,)).multipliers == path.multipliers


@pytest.mark.parametrize("weights", ["loadable", "baked"])
def test_slip_of_words_for_places_anywhere(tmp_path, weights):
    """Words that hold places anywhere may have more bits, and slip takes a clock for each."""
    wanted = scene(("force_z", "slip"), kernel="collapsed", dots=True, size=24, lanes=2, weights=weights)
    pipeline = random_bundle(tmp_path, wanted).pipeline
    path = Datapath(pipeline)
    check(path, CycleModel(wanted, hidden=(4,), follower=pipeline.follower))
    assert CycleModel(wanted, hidden=(4,)).multipliers == path.multipliers


@pytest.mark.parametrize(
    "wanted",
    [
        {"outputs": ("depth", "force_z", "slip"), "lanes": 1},
        {
            "outputs": ("force_xyz", "slip"),
            "lanes": 2,
            "solver": "tridiagonal",
            "kernel": "collapsed",
            "bridge_dots": True,
        },
    ],
    ids=["rows in order", "last row first"],
)
def test_slip(tmp_path, wanted):
    wanted = scene(**wanted, dots=True, size=24)
    pipeline = random_bundle(tmp_path, wanted).pipeline
    path = Datapath(pipeline)
    model = CycleModel(wanted, hidden=(4,), follower=pipeline.follower)
    check(path, model)
    assert model.stages["slip"] > 0
    assert model.multipliers["slip"] == path.slip_stream.multipliers
    without = wanted.model_copy(update={"outputs": wanted.outputs[:-1]})
    bare = CycleModel(without, hidden=(4,), follower=pipeline.follower)
    assert model.first_pixel_to_force - bare.first_pixel_to_force == model.stages["slip"]


def test_shifts_of_the_division_by_size():
    for size in range(14, 255):
        exponent = reciprocals(size)[1]
        assert reciprocal_distance(size) == exponent.max() - exponent.min(), size


def at(name: str, **hardware):
    known = load(SCENES / f"{name}.toml")
    return known.model_copy(update={"hardware": known.hardware.model_copy(update=hardware)})


@pytest.mark.parametrize(
    ("name", "hardware", "limits"),
    [
        ("paper", {}, {"first_pixel_to_force": 50_000, "initiation_interval": 16_640}),
        ("paper", {"pixels_per_clock": 4, "weights": "baked"}, {"first_pixel_to_force": 13_000}),
        ("fast", {}, {"first_pixel_to_force": 8_500, "initiation_interval": 4_224}),
        ("fast", {"pixels_per_clock": 1}, {"first_pixel_to_force": 33_500}),
        ("force", {}, {"first_pixel_to_force": 4_300, "last_pixel_to_force": 96}),
        ("force", {"pixels_per_clock": 1}, {"first_pixel_to_force": 16_550}),
    ],
)
def test_limits_of_the_scenes(name, hardware, limits):
    found = cycles(at(name, **hardware))
    assert {key: found[key] for key in limits if found[key] > limits[key]} == {}
    assert sum(found["stage"].values()) == sum(found["part"].values()) == found["first_pixel_to_force"]
    frame = 128 * 128 // at(name, **hardware).hardware.pixels_per_clock
    assert found["first_pixel_to_force"] - found["last_pixel_to_force"] == frame - 1


@pytest.mark.parametrize("weights", ["loadable", "baked"])
def test_the_width_of_the_network_is_the_scenes(tmp_path, weights):
    wanted = scene(("depth",), weights=weights)
    wanted = wanted.model_copy(update={"network": Network(width=7)})
    pipeline = random_bundle(tmp_path / "bundle", wanted, hidden=(7, 7, 7)).pipeline
    check(Datapath(pipeline), CycleModel(wanted))
    assert cycles(wanted) == cycles(wanted, hidden=(7, 7, 7)) != cycles(wanted, hidden=(9, 9, 9))


def test_multipliers_of_the_scenes():
    assert sum(multipliers(at("paper")).values()) <= 1968 // 2
    assert sum(multipliers(at("fast")).values()) <= 1968
    assert sum(multipliers(at("force")).values()) <= 1968 // 10


def test_only_what_the_scene_wants():
    assert set(cycles(scene(("normals",)))) == {
        "stage",
        "part",
        "initiation_interval",
        "first_pixel_to_normals",
    }
    depth = cycles(scene(("depth",)))
    assert set(depth) == {"stage", "part", "initiation_interval", "first_pixel_to_depth"}
    assert sum(depth["stage"].values()) == depth["first_pixel_to_depth"]
    assert set(multipliers(scene(("normals",)))) == {"normals"}
