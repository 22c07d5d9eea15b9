"""The emulator against models/integer, by the stages' own functions and the int64 loop, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest

from fastac.models import random_bundle
from fastac.models.emulator import direct
from fastac.models.emulator.exact import ExactTables
from fastac.models.emulator.exactness import EXACT, NotExactError, require_exact
from fastac.models.emulator.pipeline import Emulator
from fastac.models.emulator.worker import Worker
from fastac.models.integer.dot_follower import FRACTION
from fastac.models.integer.force import PatchForce, terms
from fastac.models.integer.network import GradientRatio, Layer, Requantisation
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.loops.frames import CHUNK, over_frames
from fastac.models.loops.pixels import slope_words

DEPTH, Z, XYZ, SLIP = "depth", "force_z", "force_xyz", "slip"
MAP = ("force_z", "force_map")


def frames_of(background: np.ndarray) -> np.ndarray:
    """The background, random changes of every strength, and extremes; more than one chunk."""
    black, white, bright = np.zeros_like(background), np.full_like(background, 255), background.copy()
    bright[tuple(n // 2 for n in bright.shape[:2])] = 255
    v, u = np.indices(background.shape[:2])
    checkerboard = np.where(((u + v) % 2)[..., None], white, black)
    extremes = [background, black, white, checkerboard, bright]
    return np.concatenate([extremes, random_bundle.frames(background, (3, 12, 40, 255) * 4)])


def defined(pipeline, frames: np.ndarray) -> dict[str, np.ndarray]:
    """The words of frames by the stages' own functions."""
    normals = pipeline.normals(frames)
    slopes, saturated = pipeline.ratio(normals)
    if pipeline.bridge is not None:
        dark = pipeline.bridge.dark(frames)
        slopes, saturated = pipeline.bridge(slopes, dark), pipeline.bridge(saturated, dark)
    found = {
        "normal_words": normals,
        "slopes": (slopes * 2.0**-pipeline.ratio.fraction).astype(np.float32),
        "gradient_saturated": saturated.sum(axis=(1, 2, 3)),
    }
    if pipeline.solver is not None:
        found["depth_words"], displacement = pipeline.depth(pipeline.solver(pipeline.source(slopes)))
    if pipeline.quantiser is not None:
        words, over = pipeline.quantiser(displacement)
        found |= {"displacement_words": words, "displacement_saturated": over.sum(axis=(1, 2))}
    if isinstance(pipeline.force, PatchForce):
        found["force_raw"] = pipeline.force(words)
        if pipeline.scene.wants_force_map:
            found["force_map_raw"] = pipeline.force.force_map(words)
    elif pipeline.force is not None:
        found["force_raw"] = pipeline.force(
            slopes if pipeline.quantiser is None else terms(words, pipeline.bends)
        )
    if pipeline.follower is not None:
        shift, seen = pipeline.follower(pipeline.follower.windows(frames))
        found |= {"dot_shift_words": shift, "dots_seen": seen}
        found["force_raw"] = found["force_raw"] + pipeline.dot_force(shift)
    if pipeline.spread is not None:
        found["slip_words"], found["slip_dots"] = pipeline.spread(shift, seen, words)
        found["slip_px"] = np.sqrt(found["slip_words"]) * 2.0**-FRACTION
        found["slipping"] = found["slip_px"] > np.sqrt(pipeline.slip_limit) * 2.0**-FRACTION
    columns = [np.array([pipeline.validity.of_pixels(frame, pipeline.background) for frame in frames])]
    for name in ("gradient", "displacement"):
        if name in pipeline.validity.names:
            columns.append(found[f"{name}_saturated"][:, None])
    if pipeline.follower is not None:
        columns.append((~seen).sum(axis=1, keepdims=True))
    measures = np.hstack(columns)
    return found | {"validity_measures": measures, "validity": pipeline.validity.flags(measures)}


def int64_loop(pipeline, frames: np.ndarray) -> dict[str, np.ndarray]:
    places = {
        name: np.empty((len(frames), *shape), kind)
        for name, (shape, kind) in direct.outputs(pipeline).items()
    }
    direct.loop(pipeline, frames, places)
    return places


def emulated(pipeline, frames: np.ndarray) -> dict[str, np.ndarray]:
    """By the emulator itself, which must not give way to the loop."""
    tables, outputs = ExactTables(pipeline), direct.outputs(pipeline)
    return over_frames(
        lambda: Worker(tables, frozenset(outputs)), frames, outputs, progress=False, label="test"
    )


def check(pipeline, frames: np.ndarray) -> dict[str, np.ndarray]:
    found, loop = emulated(pipeline, frames), int64_loop(pipeline, frames)
    assert found.keys() == loop.keys()
    for name, array in loop.items():
        np.testing.assert_array_equal(found[name], array, err_msg=name)
        assert found[name].tobytes() == array.tobytes(), name
    for name, array in defined(pipeline, frames).items():
        np.testing.assert_array_equal(found[name], array, err_msg=name)
    return found


CASES = {
    "normals": (("normals",), {}),
    "depth": ((DEPTH,), {"mode": "difference"}),
    "depth, four channels": ((DEPTH,), {"channels": "bgr+nir"}),
    "depth, odd size": ((DEPTH,), {"size": 17}),
    "depth by recurrences": ((DEPTH,), {"solver": "tridiagonal", "size": 17}),
    "force": ((Z,), {}),
    "force, K = 5, 20 px": ((DEPTH, Z), {"kernel_size": 5, "mode": "difference", "size": 20}),
    "force, no clamp": ((Z,), {"clamp": False, "divergence": "backward"}),
    "forces, collapsed": ((DEPTH, XYZ), {"kernel": "collapsed", "mode": "difference", "clamp": False}),
    "forces by recurrences": ((XYZ,), {"solver": "tridiagonal", "kernel": "collapsed"}),
    "force by recurrences, backward": ((Z,), {"solver": "tridiagonal", "divergence": "backward"}),
    "forces by recurrences, no clamp": (
        (XYZ,),
        {"solver": "tridiagonal", "mode": "difference", "clamp": False},
    ),
    "force map": (MAP, {"solver": "tridiagonal"}),
    "force maps, K = 7, no clamp": ((XYZ, "force_map"), {"clamp": False, "kernel_size": 7}),
    "depth and force, cut off": ((DEPTH, Z), {"rounding": "floor"}),
    "depth, difference, cut off": ((DEPTH,), {"mode": "difference", "rounding": "floor"}),
    "depth and forces by recurrences, cut off": (
        (DEPTH, XYZ),
        {"solver": "tridiagonal", "rounding": "floor", "clamp": False},
    ),
    "adjoint": ((Z,), {"solver": "adjoint"}),
    "slopes beside depth": ((DEPTH, XYZ), {"solver": "tridiagonal", "source": "slopes"}),
    "slopes beside depth, difference": ((DEPTH, Z), {"mode": "difference", "source": "slopes"}),
    "adjoint, three axes, backward": ((XYZ,), {"solver": "adjoint", "divergence": "backward"}),
}


@pytest.mark.parametrize("numbers", [random_bundle.NUMBERS, {}], ids=["short words", "words by default"])
@pytest.mark.parametrize("name", CASES)
def test_equals_the_integers_on_every_value(tmp_path, name, numbers):
    outputs, settings = CASES[name]
    scene = random_bundle.scene(outputs, numbers=numbers, **settings)
    pipeline = random_bundle.random_bundle(tmp_path / "b", scene, hidden=(7, 5)).pipeline
    frames = frames_of(pipeline.background)
    assert len(frames) > CHUNK
    found = check(pipeline, frames)
    assert found["gradient_saturated"].any() or not numbers
    for name in ("displacement_words", "force_raw", "force_map_raw"):
        assert name not in found or found[name].any()
    if numbers and pipeline.quantiser is not None:
        assert found["displacement_saturated"].any()


def frames_with_dots(pipeline) -> np.ndarray:
    """Dots that are moved, covered, smeared and doubled, all dark or all bright, and any frames."""
    background = pipeline.background
    u, v = pipeline.follower.rest_px[0] if pipeline.follower is not None else (4, 4)
    dot = (slice(v - 1, v + 2), slice(u - 1, u + 2))
    covered, smeared, doubled = (background.copy() for _ in range(3))
    covered[dot] = background[v - 1 : v + 2, u + 2 : u + 5]
    smeared[v - 1 : v + 2, u - 1 : u + 6] = background[dot].min()
    doubled[v - 1 : v + 2, u + 2 : u + 5] = background[dot]
    moved = [np.roll(background, (1, 2), axis=(0, 1)), np.roll(background, (-2, 1), axis=(0, 1))]
    lit = np.zeros_like(background)
    lit[v, u] = 255
    return np.concatenate([[covered, smeared, doubled, *moved, lit], frames_of(background)])


DOTTED = {
    "dots by slopes beside depth": ((DEPTH, XYZ), {"source": "slopes", "dots": True, "bridge_dots": True}),
    "dots by slopes": ((XYZ,), {"solver": "adjoint", "dots": True}),
    "bridge by slopes": ((Z,), {"solver": "adjoint", "bridge_dots": True}),
    "bridge alone": ((DEPTH,), {"bridge_dots": True, "divergence": "backward"}),
    "band": ((XYZ,), {"kernel": "collapsed", "band_mm": 0.002}),
    "bends": ((XYZ,), {"kernel": "collapsed", "band_mm": 0.001, "deep_mm": 0.003}),
    "dots, patches, clamp": ((DEPTH, Z), {"dots": True, "mode": "difference", "channels": "bgr+nir"}),
    "slip": ((Z, SLIP), {"solver": "tridiagonal", "clamp": False, "dots": True, "size": 36}),
    "all": (
        (DEPTH, XYZ),
        {"solver": "tridiagonal", "kernel": "collapsed", "band_mm": 0.002, "dots": True, "bridge_dots": True},
    ),
}


@pytest.mark.parametrize("weights", ["loadable", "baked"])
@pytest.mark.parametrize("name", DOTTED)
@pytest.mark.quick(*(f"{name}-loadable" for name in DOTTED))
def test_equals_the_integers_with_dots_and_band(tmp_path, name, weights):
    outputs, settings = DOTTED[name]
    scene = random_bundle.scene(outputs, **{"size": 24, "weights": weights} | settings)
    pipeline = random_bundle.random_bundle(tmp_path / "b", scene, hidden=(7, 5)).pipeline
    frames = frames_with_dots(pipeline)
    found = check(pipeline, frames)
    if pipeline.follower is not None:
        assert found["dots_seen"].any(axis=0).all()
        assert not found["dots_seen"][:3, 0].any(), "covered, smeared and doubled dots are lost"
        assert found["dots_seen"][:3, -1].all(), "the others are not"
        still = pipeline.replace(
            dot_force=replace(pipeline.dot_force, exponent=pipeline.dot_force.exponent + 1)
        )
        assert (emulated(still, frames)["force_raw"] != found["force_raw"]).any()
    if pipeline.bridge is not None:
        bare = emulated(pipeline.replace(bridge=None), frames)
        assert (bare["slopes"] != found["slopes"]).any()
        assert (bare["gradient_saturated"] != found["gradient_saturated"]).any()
    if pipeline.bends:
        words = found["displacement_words"]
        assert pipeline.bends[0] > 0
        assert pipeline.bends[-1] < words.max()
        assert words.min() < -pipeline.bends[0]
    if pipeline.spread is not None:
        assert len(np.unique(found["slip_dots"])) > 3, "few dots touch and many"
        assert 0 < found["slipping"].mean() < 1
        assert (found["slip_words"] > 0).sum() > found["slipping"].sum(), "some spread less than the limit"


@pytest.mark.parametrize("name", ["slip_px", "slip_words", "slip_dots", "slipping"])
def test_slip_alone(tmp_path, name):
    """Nothing else is asked for that finds dots or displacements."""
    scene = random_bundle.scene((Z, SLIP), size=36, dots=True)
    pipeline = random_bundle.random_bundle(tmp_path / "b", scene).pipeline
    frames = frames_with_dots(pipeline)[-6:]
    found = Emulator(pipeline).run(frames, wanted=[name])
    assert [key for key, value in vars(found).items() if value is not None] == [name]
    expected = int64_loop(pipeline, frames)[name]
    assert expected.any()
    np.testing.assert_array_equal(getattr(found, name), expected)


@pytest.mark.parametrize("name", ["adjoint, dots", "patches", "band and dots"])
def test_displacements_and_shifts_before_there_is_a_force(tmp_path, name):
    """As while the force is trained on them."""
    outputs, settings = {
        "adjoint, dots": ((Z,), {"solver": "adjoint", "dots": True}),
        "patches": ((Z,), {}),
        "band and dots": ((Z,), {"kernel": "collapsed", "band_mm": 0.002, "dots": True}),
    }[name]
    scene = random_bundle.scene(outputs, size=24, **settings)
    whole = random_bundle.random_bundle(tmp_path / "b", scene).pipeline
    without = whole.replace(force=None, force_n_per_unit=None, dot_force=None)
    frames = frames_with_dots(whole)[:8]
    found, loop, expected = emulated(without, frames), int64_loop(without, frames), emulated(whole, frames)
    assert found.keys() == loop.keys() == expected.keys() - {"force_raw", "force_n"}
    for kept, array in loop.items():
        np.testing.assert_array_equal(found[kept], array, err_msg=kept)
        np.testing.assert_array_equal(expected[kept], array, err_msg=kept)


def test_the_dots_share_counts_in_whether_float64_is_exact(tmp_path):
    scene = random_bundle.scene((Z,), solver="adjoint", dots=True)
    pipeline = random_bundle.random_bundle(tmp_path / "b", scene).pipeline
    dots = pipeline.dot_force
    wide = pipeline.replace(dot_force=replace(dots, exponent=dots.exponent + 53 - dots.bound.bit_length()))
    assert wide.force.bound < wide.dot_force.bound < EXACT
    ExactTables(wide)
    wide = pipeline.replace(dot_force=replace(wide.dot_force, exponent=wide.dot_force.exponent + 1))
    with pytest.raises(NotExactError, match=r"^force bound "):
        ExactTables(wide)
    frames = frames_with_dots(pipeline)[:6]
    np.testing.assert_array_equal(Emulator(wide).run(frames).force_raw, int64_loop(wide, frames)["force_raw"])


@pytest.mark.parametrize(
    ("size", "solver", "kernel"), [(128, "dst2d", "patch"), (48, "tridiagonal", "collapsed")]
)
@pytest.mark.quick("48-tridiagonal-collapsed")
def test_equals_the_integers_on_larger_images(tmp_path, size, solver, kernel):
    """Several tiles of pixels, the last one not full at 48×48; the network of the scenes that are built."""
    scene = random_bundle.scene(
        (DEPTH, XYZ), size=size, channels="bgr+nir", solver=solver, kernel=kernel, numbers={}, kernel_size=5
    )
    pipeline = random_bundle.random_bundle(tmp_path / "b", scene, hidden=(16, 16, 16)).pipeline
    check(pipeline, frames_of(pipeline.background)[[0, 1, 3, 4, 6, 8]])


def hidden_type(pipeline) -> np.dtype:
    """In which the hidden layers are computed."""
    _, hidden, *_ = ExactTables(pipeline).network.tables
    return hidden.dtype


def test_sums_beyond_float32(tmp_path):
    """A hidden layer whose sums take more than 24 bits."""
    pipeline = random_bundle.random_bundle(tmp_path / "b", random_bundle.scene((DEPTH, Z))).pipeline
    assert hidden_type(pipeline) == np.float32
    first, *others = pipeline.layers
    scale, by = first.requantisation, 12
    fine = replace(
        first,
        weight=(first.weight << by) + 1,
        bias=first.bias << by,
        weight_bits=first.weight_bits + by,
        requantisation=replace(scale, shift=scale.shift + by),
    )
    wide = pipeline.replace(layers=(fine, *others))
    assert hidden_type(wide) == np.float64
    check(wide, frames_of(pipeline.background))


def no_sines(pipeline):
    """Symmetric tables that the folded transforms cannot use."""
    transform = pipeline.solver.row_forward
    matrix = transform.matrix.copy()
    matrix[0, 0] += 1
    return pipeline.replace(solver=replace(pipeline.solver, row_forward=replace(transform, matrix=matrix)))


@pytest.mark.parametrize("solver", ["dst2d", "tridiagonal"])
def test_other_matrices_give_way_to_the_loop(tmp_path, solver):
    pipeline = random_bundle.random_bundle(
        tmp_path / "b", random_bundle.scene((DEPTH,), solver=solver)
    ).pipeline
    changed = no_sines(pipeline)
    with pytest.raises(NotExactError, match=r"^row_forward matrix: expected rows even and odd"):
        ExactTables(changed)
    frames = frames_of(pipeline.background)[3:5]
    np.testing.assert_array_equal(
        Emulator(changed).run(frames).depth_words, int64_loop(changed, frames)["depth_words"]
    )


@pytest.mark.parametrize("n_z", [-300, -1, 0, 1, 40])
def test_a_surface_that_turns_away(tmp_path, n_z):
    """n_z around and below zero, and components that are exactly zero."""
    scene = random_bundle.scene((DEPTH, Z))
    pipeline = random_bundle.random_bundle(tmp_path / "b", scene).pipeline
    last = pipeline.layers[-1]
    weight, bias = last.weight.copy(), np.array([0, 0, n_z])
    weight[:, 1:], weight[2] = 0, 1
    pipeline = pipeline.replace(layers=(*pipeline.layers[:-1], replace(last, weight=weight, bias=bias)))
    found = check(pipeline, frames_of(pipeline.background))
    words = found["normal_words"]
    assert (words[..., :2] == 0).any()
    assert (words[..., :2] != 0).any()
    assert (words[..., 2] <= 0).any() == (n_z <= 0)


def test_quotients_just_below_an_integer():
    """Where float64 is nearest to rounding the quotient up: numerators of 52 bits, one below a multiple."""
    ratio = GradientRatio(normal_width=28, width=27, fraction=24)
    rng = np.random.default_rng(1)
    n_z = rng.integers(1 << 25, 1 << 27, 64 * 64) | 1
    # (n << 25) + n_z = 2 n_z k − remainder: of 200 quotients k the one with the smallest remainder.
    k = rng.integers(1, 1 << 24, (200, n_z.size))
    top = 2 * n_z * k - n_z
    remainder = top & ((1 << 25) - 1)
    remainder[(remainder == 0) | (top >> 25 >= 1 << 27)] = 1 << 25
    best = remainder.argmin(axis=0)
    n_x = np.take_along_axis(top, best[None], axis=0)[0] >> 25
    assert n_x.max() < 1 << 27
    assert (remainder.min(axis=0) < 1 << 18).mean() > 0.5
    normal = np.stack([n_x, -n_x, n_z])
    expected, over = ratio(normal.T)
    given, found = normal.astype(np.float64), np.empty((2, 64 * 64))
    saturated = [
        slope_words(given[k], given[2], 2.0**-24, float(ratio.limit), found[k], np.empty(0, bool))
        for k in range(2)
    ]
    np.testing.assert_array_equal(found.T, expected)
    assert sum(saturated) == over.sum()


def test_only_what_is_wanted(tmp_path, monkeypatch):
    scene = random_bundle.scene((DEPTH, Z))
    pipeline = random_bundle.random_bundle(tmp_path / "b", scene).pipeline
    frames = frames_of(pipeline.background)
    whole = Emulator(pipeline).run(frames)
    for wanted in direct.outputs(pipeline):
        found = Emulator(pipeline).run(frames, wanted=[wanted])
        assert [name for name, value in vars(found).items() if value is not None] == [wanted]
        np.testing.assert_array_equal(getattr(found, wanted), getattr(whole, wanted))
    with pytest.raises(ValueError, match="wanted 'force_map_n': expected some of normals, "):
        Emulator(pipeline).run(frames, wanted=["force_map_n"])

    def refuse(*_):
        raise AssertionError("nobody wants depth")

    monkeypatch.setattr("fastac.models.emulator.dst2d.TransformTables.emulate", refuse)
    Emulator(pipeline).run(frames, wanted=["normals", "slopes", "normal_words", "gradient_saturated"])
    with pytest.raises(AssertionError, match="nobody wants depth"):
        Emulator(pipeline).run(frames, wanted=["force_n"])


def test_exactness_ends_at_2_to_the_53():
    require_exact("sum", EXACT - 1)
    with pytest.raises(NotExactError, match=f"sum bound {1 << 53}: integers of 2\\*\\*53 and more"):
        require_exact("sum", 1 << 53)
    assert float(EXACT - 1) != float(EXACT)
    assert float(EXACT) == float(EXACT + 1)


def wide_layer(pipeline):
    """Sums of 39 bits, which float64 holds, and multipliers of 17 bits, with which it does not."""
    first = pipeline.layers[0]
    weight = np.where(first.weight < 0, -(1 << 29), 1 << 29) + first.weight
    scale = Requantisation(np.full(len(weight), (1 << 17) - 1), 47, 10)
    wide = Layer(weight, first.bias, first.input_limit, 32, scale)
    return pipeline.replace(layers=(wide, *pipeline.layers[1:]))


def wide_ratio(pipeline):
    return pipeline.replace(ratio=replace(pipeline.ratio, fraction=40, width=50))


def wide_transform(name):
    def change(pipeline):
        transform = getattr(pipeline.solver, name)
        by = 53 - transform.accumulator_bound.bit_length() + 1
        wide = SineTransform(
            transform.matrix << by, transform.shift + by, transform.input_width, transform.output_width
        )
        return pipeline.replace(solver=replace(pipeline.solver, **{name: wide}))

    return change


def wide_stage(name):
    def change(pipeline):
        wide = replace(getattr(pipeline.solver, name), input_width=50)
        return pipeline.replace(solver=replace(pipeline.solver, **{name: wide}))

    return change


def wide_force(pipeline):
    force = pipeline.force
    return pipeline.replace(
        force=replace(force, kernel=force.kernel << 35, kernel_bits=force.kernel_bits + 35)
    )


@pytest.mark.parametrize(
    ("solver", "stage", "change"),
    [
        ("dst2d", "layer", wide_layer),
        ("dst2d", "slopes", wide_ratio),
        ("dst2d", "row_forward", wide_transform("row_forward")),
        ("dst2d", "column_forward", wide_transform("column_forward")),
        ("dst2d", "division", wide_stage("division")),
        ("dst2d", "column_inverse", wide_transform("column_inverse")),
        ("tridiagonal", "row_inverse", wide_transform("row_inverse")),
        ("tridiagonal", "elimination", wide_stage("elimination")),
        ("tridiagonal", "substitution", wide_stage("substitution")),
        ("dst2d", "force", wide_force),
    ],
)
def test_tables_too_wide_for_float64_give_way_to_the_loop(tmp_path, solver, stage, change):
    scene = random_bundle.scene((DEPTH, Z), solver=solver)
    pipeline = random_bundle.random_bundle(tmp_path / "b", scene).pipeline
    ExactTables(pipeline)
    wide = change(pipeline)
    with pytest.raises(NotExactError, match=f"^{stage} bound "):
        ExactTables(wide)
    frames = frames_of(pipeline.background)[3:7]
    found, loop = Emulator(wide).run(frames), int64_loop(wide, frames)
    for name, array in loop.items():
        np.testing.assert_array_equal(getattr(found, name), array)
    if stage == "force":
        np.testing.assert_array_equal(found.force_raw, wide.force(found.displacement_words))
