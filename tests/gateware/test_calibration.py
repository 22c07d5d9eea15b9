# amaranth: UnusedElaboratable=no
from dataclasses import replace

import numpy as np
import pytest

from fastac.gateware import calibration
from fastac.gateware.calibration import (
    CalibrationError,
    calibration_words,
    first_difference,
    hardware_identifier,
    image_layout,
    with_hardware_force,
)
from fastac.gateware.datapath import Datapath
from fastac.gateware.target.device import on_part
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import bundle
from fastac.models.integer.assemble import assemble, with_force_of
from fastac.models.integer.bounds import Stage
from fastac.models.integer.constant_neurons import with_hidden
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.random_bundle import NUMBERS, random_bundle, recalibrated, scene

WANTED = {
    "absolute": {"outputs": ("depth", "force_z"), "mode": "absolute", "lanes": 4},
    "difference": {"outputs": ("depth", "force_z"), "mode": "difference", "solver": "tridiagonal"},
    "adjoint": {"outputs": ("force_xyz",), "mode": "difference", "solver": "adjoint", "lanes": 2},
    "normals": {"outputs": ("normals",)},
    "dots": {
        "outputs": ("force_x",),
        "solver": "adjoint",
        "dots": True,
        "bridge_dots": True,
        "size": 24,
        "lanes": 4,
    },
    "depth": {"outputs": ("depth",), "mode": "absolute"},
}


@pytest.fixture(scope="module")
def bundles(tmp_path_factory):
    """For each kind of scene a bundle, and one with another network for the same hardware."""
    folder, found = tmp_path_factory.mktemp("bundles"), {}
    for name, wanted in WANTED.items():
        own = random_bundle(folder / name, scene(**wanted))
        found[name] = own, recalibrated(folder / f"{name}_other", own)
    return found


def test_rounding_cannot_be_changed_by_a_calibration(bundles):
    pipeline = bundles["absolute"][0].pipeline
    solver = pipeline.solver
    floor = pipeline.replace(
        solver=replace(solver, row_forward=replace(solver.row_forward, rounding="floor"))
    )
    assert (
        first_difference(floor, pipeline)
        == "solver.row_forward.rounding = 'floor': the hardware's is 'nearest'"
    )
    assert hardware_identifier(floor) != hardware_identifier(pipeline)


def check_records(values, table, follower) -> None:
    """An image's words of what is known of each dot are the follower's."""
    bits, fields = table.format.bits, table.format.fields
    cut = values.reshape(len(follower.rest), fields).tolist()
    records = [
        table.layout.from_bits(sum((word & ((1 << bits) - 1)) << (k * bits) for k, word in enumerate(words)))
        for words in cut
    ]
    known = {"rest_u": follower.rest[:, 0], "rest_v": follower.rest[:, 1]}
    known |= {"guide_0": follower.guides[:, 0], "guide_1": follower.guides[:, 1]}
    known |= {"least": follower.low, "most": follower.high}
    for name, expected in known.items():
        assert [record[name] for record in records] == expected.tolist(), name


@pytest.mark.parametrize("name", WANTED)
def test_content_of_an_image(bundles, name):
    """An image has the tables, the network's parameters, the adjoint's constants, the limits and the hash."""
    own, other = bundles[name]
    words = calibration_words(other, own)
    layout = image_layout(Datapath(own.pipeline))
    assert words.shape == (layout.words,)
    assert words[0] == hardware_identifier(own.pipeline) == hardware_identifier(other.pipeline)
    tables = {"absolute": ["rest"], "difference": ["offset"], "dots": ["threshold", "dot_records"]}
    assert list(layout.tables) == tables.get(name, [])
    chain = int.from_bytes(words[-layout.chain_words :].astype("<u4").tobytes(), "little")
    assert chain >> (32 * layout.chain_words - 64) == other.hash_word
    bits = layout.registers["network"]
    assert chain % (1 << bits) == Datapath(own.pipeline).mlp.parameter_image(other.pipeline.layers)
    assert list(layout.registers) == ["network", *["constant"] * (name in ("adjoint", "dots")), "limits"]
    low = sum(layout.registers.values()) - layout.registers["limits"]
    limits = chain >> low & (1 << layout.registers["limits"]) - 1
    assert limits == Datapath(own.pipeline).validity.limits_image(other.pipeline.validity)
    assert limits != Datapath(own.pipeline).validity.limits_image(own.pipeline.validity)
    if name == "adjoint":
        force = other.pipeline.force
        for axis in range(3):
            word = chain >> (bits + axis * force.width) & ((1 << force.width) - 1)
            assert word - (word >> (force.width - 1) << force.width) == force.constant[axis]
    values = words[1 : -layout.chain_words].astype(np.int32)
    if name == "absolute":
        half = 1 << other.pipeline.quantiser.shift >> 1
        found = values.reshape(14, 16)
        assert np.array_equal(found[:, :14], other.pipeline.depth.rest + half)
        assert not found[:, 14:].any()
    elif name == "difference":
        assert np.array_equal(values.reshape(14, 14), other.pipeline.source.offset)
    elif name == "dots":
        windows = other.pipeline.follower.windows
        assert np.array_equal(values[:36].reshape(6, 6), windows.threshold)
        assert np.array_equal(windows.threshold, other.pipeline.bridge.windows.threshold)
        assert (windows.threshold != own.pipeline.follower.windows.threshold).all()
        check_records(values[36:], Datapath(own.pipeline).dots.table, other.pipeline.follower)
    else:
        assert not len(values)


def test_an_image_is_packed_for_the_part_of_the_hardware(tmp_path):
    """Whatever part the calibration's scene names; hardware that packs otherwise refuses it."""
    own = random_bundle(tmp_path / "own", scene(("normals",), numbers=NUMBERS | {"activation_bits": 10}))
    other = recalibrated(tmp_path / "other", own)
    kria, small = (
        replace(own, pipeline=on_part(own.pipeline, part))
        for part in ("xck26-sfvc784-2LV-c", "xc7z020clg400-1")
    )
    assert np.array_equal(calibration_words(other, kria), calibration_words(other, own))
    words, path = calibration_words(other, small), Datapath(small.pipeline)
    layout = image_layout(path)
    assert words.shape == (layout.words,)
    assert words[0] == hardware_identifier(small.pipeline) != hardware_identifier(own.pipeline)
    chain = int.from_bytes(words[-layout.chain_words :].astype("<u4").tobytes(), "little")
    network = chain % (1 << layout.registers["network"])
    assert network == path.mlp.parameter_image(other.pipeline.layers)
    assert network != Datapath(own.pipeline).mlp.parameter_image(other.pipeline.layers)
    assert chain >> (32 * layout.chain_words - 64) == other.hash_word


def test_hardware_takes_a_network_with_fewer_neurons(tmp_path):
    """As after pruning; what is loaded computes the same."""
    wanted = scene(("depth", "force_z"))
    own = random_bundle(tmp_path / "own", wanted, hidden=(6, 5))
    narrow = recalibrated(tmp_path / "narrow", random_bundle(tmp_path / "small", wanted, hidden=(4, 5)))
    kept = with_hardware_force(narrow, own, tmp_path / "kept")
    assert kept.pipeline.hidden == (6, 5)
    words = calibration_words(kept, own)
    assert words.shape == (image_layout(Datapath(own.pipeline)).words,)
    frames = np.random.default_rng(1).integers(0, 256, (3, *own.pipeline.background.shape)).astype(np.uint8)
    of_narrow, of_kept = (Emulator(bundle.pipeline).run(frames) for bundle in (narrow, kept))
    np.testing.assert_array_equal(of_kept.depth_words, of_narrow.depth_words)
    np.testing.assert_array_equal(calibration_words(narrow_force(narrow, kept), own)[1:-2], words[1:-2])
    with pytest.raises(CalibrationError, match=r"layers\.0\.weight\.shape = \(6, 5\): the hardware's is"):
        with_hardware_force(own, narrow, tmp_path / "no")


def narrow_force(narrow, kept):
    """The narrow network with the force and limits of the other bundle."""
    names = ("force", "force_n_per_unit", "validity")
    pipeline = narrow.pipeline.replace(**{name: getattr(kept.pipeline, name) for name in names})
    return replace(narrow, pipeline=pipeline)


def test_table_formats_fit_any_calibration(bundles):
    """The tables' width is that of any calibration, not just of the values of the first bundle."""
    for name, table in (("absolute", "rest"), ("difference", "offset")):
        own, _ = bundles[name]
        width = own.pipeline.depth.width if table == "rest" else own.pipeline.source.width
        assert image_layout(Datapath(own.pipeline)).tables[table].bits == width


def changed(pipeline: IntegerPipeline, what: str) -> IntegerPipeline:
    """`pipeline` with one value changed that a calibration cannot change."""
    if what == "kernel":
        kernel = pipeline.force.kernel.copy()
        kernel[0, 3, 5, 1, 2] += 1 if kernel[0, 3, 5, 1, 2] < 0 else -1
        return pipeline.replace(force=replace(pipeline.force, kernel=kernel))
    if what == "offset":
        return pipeline.replace(source=replace(pipeline.source, offset=pipeline.source.offset + 1))
    if what == "rest":
        return pipeline.replace(depth=replace(pipeline.depth, rest=pipeline.depth.rest - 1))
    if what == "fewer dots":
        follower = pipeline.follower
        parts = {name: getattr(follower, name)[:-1] for name in ("rest", "low", "high")}
        return pipeline.replace(follower=replace(follower, **parts, guides=0 * follower.guides[:-1] + 8))
    if what == "dot weight":
        weighted = pipeline.dot_force.weighted
        weighted = replace(weighted, weight=-weighted.weight)
        return pipeline.replace(dot_force=replace(pipeline.dot_force, weighted=weighted))
    if what == "reach":
        return pipeline.replace(bridge=replace(pipeline.bridge, reach=5))
    if what == "lanes":
        content = pipeline.scene.model_dump()
        content["hardware"]["pixels_per_clock"] = 2
        return pipeline.replace(scene=type(pipeline.scene).model_validate(content))
    if what == "fraction":
        return pipeline.replace(ratio=replace(pipeline.ratio, fraction=7))
    if what == "shape":
        return pipeline.replace(layers=with_hidden(pipeline.layers, (5,)))
    if what == "depth":
        return pipeline.replace(layers=pipeline.layers[:1])
    if what == "baked":
        layers = tuple(replace(layer, loadable=False) for layer in pipeline.layers)
        return pipeline.replace(layers=layers)
    raise AssertionError(what)


@pytest.mark.parametrize(
    ("name", "what", "message"),
    [
        (
            "absolute",
            "kernel",
            "force.kernel: 1 of 1764 values are not the hardware's, the first in (0, 3, 5",
        ),
        (
            "absolute",
            "offset",
            "source.offset: 196 of 196 values are not the hardware's, the first in (0, 0)",
        ),
        ("difference", "rest", "depth.rest: 196 of 196 values are not the hardware's"),
        ("difference", "lanes", "scene.hardware.pixels_per_clock = 2: the hardware's is 1"),
        ("dots", "fewer dots", "follower.rest.shape = (8, 2): the hardware's is (9, 2)"),
        ("dots", "dot weight", "dot_force.weighted.weight: 18 of 18 values are not the hardware's"),
        ("dots", "reach", "bridge.reach = 5: the hardware's is 2"),
        ("normals", "fraction", "ratio.fraction = 7: the hardware's is 8"),
        ("normals", "shape", "layers.0.weight.shape = (5, 5): the hardware's is (4, 5)"),
        ("normals", "depth", "layers.length = 1: the hardware's is 2"),
        ("normals", "baked", "layers.0.loadable = False: the hardware's is True"),
    ],
)
def test_differences_in_fixed_content_are_refused(bundles, tmp_path, name, what, message):
    own, other = bundles[name]
    pipeline = changed(other.pipeline, what)
    assert first_difference(pipeline, own.pipeline).startswith(message)
    assert hardware_identifier(pipeline) != hardware_identifier(own.pipeline)
    with pytest.raises(CalibrationError) as refusal:
        calibration_words(replace(other, pipeline=pipeline), own)
    assert str(refusal.value).startswith(message)
    assert "\n" not in str(refusal.value)


def test_slip_is_of_the_hardware(tmp_path):
    """Where dots touch is decided by a constant; the limit of their spread is a register's initial value."""
    wanted = scene(("force_x", "slip"), dots=True, size=24)
    own = random_bundle(tmp_path / "own", wanted).pipeline
    slip = wanted.slip

    def other(**changes):
        return own.replace(scene=wanted.model_copy(update={"slip": slip.model_copy(update=changes)}))

    assert first_difference(other(limit_px=2 * slip.limit_px), own) is None
    touching = other(contact_mm=2 * slip.contact_mm)
    assert first_difference(touching, own) == "spread.threshold = 33: the hardware's is 16"
    assert hardware_identifier(touching) != hardware_identifier(own)
    without = scene(("force_x",), dots=True, size=24)
    assert hardware_identifier(own.replace(scene=without)) != hardware_identifier(own)


def test_what_comes_before_the_network_is_of_the_hardware(bundles, monkeypatch):
    """Smoothing and levelled light cannot be loaded. Hardware from before smoothing keeps its identifier."""
    own = bundles["difference"][0].pipeline

    def other(table: str, **changes):
        changed = getattr(own.scene, table).model_copy(update=changes)
        return own.replace(scene=own.scene.model_copy(update={table: changed}))

    smoothed, levelled = other("network", smoothing_px=4), other("sensor", level_light=True)
    assert first_difference(smoothed, own) == "scene.network.smoothing_px = 4: the hardware's is 0"
    assert first_difference(levelled, own) == "scene.sensor.level_light = True: the hardware's is False"
    assert hardware_identifier(smoothed) != hardware_identifier(own)
    before, everything = hardware_identifier(own), calibration.fixed_content
    younger = (calibration.SMOOTHING_PX, calibration.LEVEL_LIGHT)
    monkeypatch.setattr(
        calibration, "fixed_content", lambda of: (item for item in everything(of) if item[0] not in younger)
    )
    assert hardware_identifier(own) == before


def test_identifiers_of_different_hardware_differ(bundles):
    assert len({hardware_identifier(own.pipeline) for own, _ in bundles.values()}) == len(WANTED)


def test_hardware_of_single_pixels_keeps_the_identifier_that_it_had_before_squares(bundles, monkeypatch):
    pipeline = bundles["adjoint"][0].pipeline
    before = hardware_identifier(pipeline)
    everything = calibration.fixed_content
    told = [name for name, _ in everything(pipeline) if name.endswith((".block_px", ".cut_rows"))]
    assert told == ["force.block_px", "force.cut_rows"]
    monkeypatch.setattr(
        calibration, "fixed_content", lambda of: (item for item in everything(of) if item[0] not in told)
    )
    assert hardware_identifier(pipeline) == before


def test_fields_that_only_document_may_differ(bundles):
    own, other = bundles["absolute"]
    solver = own.pipeline.solver
    stages = tuple(Stage(s.name, s.bound_px * 0.99, s.format) for s in solver.stages)
    pipeline = other.pipeline.replace(
        solver=replace(solver, stages=stages), background=own.pipeline.background // 2, provenance={"a": 1}
    )
    assert first_difference(pipeline, own.pipeline) is None
    assert hardware_identifier(pipeline) == hardware_identifier(own.pipeline)


@pytest.mark.parametrize("name", ["difference", "absolute", "adjoint"])
@pytest.mark.quick("absolute", "adjoint")
def test_any_network_fits_the_hardware_of_its_scene(bundles, name):
    """Random networks, also those whose slopes at rest saturate, fit the hardware of their scene."""
    own, _ = bundles[name]
    pipeline = own.pipeline
    for seed in range(20):
        rng = np.random.default_rng(seed)
        layers = [
            replace(
                layer,
                weight=rng.integers(-layer.weight_limit, layer.weight_limit + 1, layer.weight.shape),
                bias=rng.integers(-layer.bias_limit, layer.bias_limit + 1, layer.bias.shape),
            )
            for layer in pipeline.layers
        ]
        made = assemble(
            pipeline.scene,
            layers=tuple(layers),
            background=pipeline.background,
            rest_depth_mm=pipeline.rest_depth_mm,
        )
        assert first_difference(with_force_of(made, pipeline), pipeline) is None


def test_calibration_with_the_force_of_the_hardware(bundles, tmp_path):
    """Network from the new bundle, force from the hardware's; the adjoint's constants are recomputed."""
    own, other = bundles["adjoint"]
    weight = -other.pipeline.force.weight
    trained = replace(
        other, pipeline=other.pipeline.replace(force=replace(own.pipeline.force, weight=weight))
    )
    trained.floats.update({"network.0.bias": np.ones(4), "force.float_weights": np.ones(3)})
    own.floats.update({"network.0.bias": np.zeros(4), "force.float_weights": np.zeros(3)})
    kept = with_hardware_force(trained, own, tmp_path / "kept")
    assert np.array_equal(calibration_words(kept, own)[:-2], calibration_words(other, own)[:-2])
    loaded = bundle.load(tmp_path / "kept")
    assert loaded.digest == kept.digest
    assert {k: v.tolist() for k, v in loaded.floats.items()} == {
        "network.0.bias": [1] * 4,
        "force.float_weights": [0] * 3,
    }
    with pytest.raises(CalibrationError, match=r"scene.outputs = \('normals',\): the hardware has no force"):
        with_hardware_force(other, bundles["normals"][0], tmp_path / "none")
    with pytest.raises(CalibrationError, match=r"scene\.outputs = "):
        with_hardware_force(bundles["absolute"][1], own, tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.fixture(scope="module")
def trained(bundles):
    """Another gel on the hardware of "dots", with its own order of dots and its own weights, and how far its
    dots are from the hardware's."""
    own, _ = bundles["dots"]
    pipeline, order = own.pipeline, np.array([4, 0, 2, 1, 3, 8, 6, 7, 5])
    follower, moved = pipeline.follower, np.array([(130, -100), (-90, 77), (5, 128)])[np.arange(9) % 3]
    parts = {"rest": follower.rest + moved, "low": follower.low + 3, "high": follower.high - 5}
    parts = {name: values[order] for name, values in parts.items()}
    other = replace(follower, **parts, guides=0 * follower.guides + 9)
    weighted = replace(pipeline.dot_force.weighted, weight=-pipeline.dot_force.weighted.weight)
    dot_force = replace(pipeline.dot_force, weighted=weighted)
    floats = {"dots.rest_px": other.rest / 64, "force.float_dot_weights": np.ones(9)}
    return replace(own, pipeline=pipeline.replace(follower=other, dot_force=dot_force), floats=floats), moved


def test_dots_come_in_the_order_of_the_hardware(bundles, trained, tmp_path):
    """Its weights are by dot, so each dot has the weights of the hardware's dot nearest to it."""
    own, _ = bundles["dots"]
    new, moved = trained
    kept = with_hardware_force(new, replace(own, floats={"force.float_dot_weights": np.zeros(9)}), tmp_path)
    follower = kept.pipeline.follower
    np.testing.assert_array_equal(follower.rest, own.pipeline.follower.rest + moved)
    np.testing.assert_array_equal(follower.low, own.pipeline.follower.low + 3)
    np.testing.assert_array_equal(follower.high, own.pipeline.follower.high - 5)
    np.testing.assert_array_equal(follower.guides, own.pipeline.follower.guides)
    np.testing.assert_array_equal(kept.floats["dots.rest_px"], follower.rest / 64)
    assert not kept.floats["force.float_dot_weights"].any()
    own_words, words = (calibration_words(bundle, own) for bundle in (own, kept))
    different = np.flatnonzero(words != own_words)
    assert different.min() == 1 + 36  # from the records of the dots on
    assert len(different) <= 9 * 4 + 2


@pytest.mark.parametrize(
    ("places", "message"),
    [
        ({0: (12, 4.5)}, "dot at 4, 4 px: followed by the hardware, and nearest to none of the new dots"),
        ({8: (23.4, 23.4)}, "dot at 23, 23 px: the hardware follows none within 4 px"),
    ],
)
def test_dots_that_are_none_of_the_hardwares_are_refused(bundles, tmp_path, places, message):
    own, _ = bundles["dots"]
    follower = own.pipeline.follower
    rest = follower.rest.copy()
    for dot, place in places.items():
        rest[dot] = np.array(place) * 64
    new = replace(own, pipeline=own.pipeline.replace(follower=replace(follower, rest=rest)))
    with pytest.raises(CalibrationError) as refusal:
        with_hardware_force(new, own, tmp_path / "kept")
    assert str(refusal.value) == message
    fewer = replace(own, pipeline=changed(own.pipeline, "fewer dots"))
    with pytest.raises(CalibrationError, match=r"follower\.rest: 8 dots: the hardware follows 9$"):
        with_hardware_force(fewer, own, tmp_path / "kept")
    assert not (tmp_path / "kept").exists()


def test_dots_beyond_the_rows_that_are_kept_are_refused(bundles):
    own, _ = bundles["dots"]
    follower = own.pipeline.follower
    rest = follower.rest.copy()
    rest[:3, 1], rest[3:, 1] = 22 << 6, 2 << 6
    new = replace(own, pipeline=own.pipeline.replace(follower=replace(follower, rest=rest)))
    with pytest.raises(CalibrationError, match=r"^dot at \d+, 2 px: found \d+ clocks too late, as .*$"):
        calibration_words(new, own)


def test_baked_hardware_accepts_no_calibration(tmp_path):
    own = random_bundle(tmp_path / "baked", scene(("normals",), weights="baked"))
    with pytest.raises(CalibrationError, match=r"hardware\.weights: baked, the hardware takes no"):
        calibration_words(own, own)


def test_the_bundle_on_disk_gives_the_same_words(bundles, tmp_path):
    own, other = bundles["difference"]
    bundle.save(tmp_path / "bundle", other.pipeline, {})
    loaded = bundle.load(tmp_path / "bundle")
    assert np.array_equal(calibration_words(loaded, own), calibration_words(other, own))
