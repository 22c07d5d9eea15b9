"""The emulator against models/integer with dots, bridged slopes, bends and slip, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
from emulated import check, emulated, frames_of, int64_loop

from fastac.models import random_bundle
from fastac.models.emulator.exact import ExactTables
from fastac.models.emulator.exactness import EXACT, NotExactError
from fastac.models.emulator.pipeline import Emulator

DEPTH, Z, XYZ, SLIP = "depth", "force_z", "force_xyz", "slip"


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
    "bends": (
        (XYZ,),
        {"kernel": "collapsed", "band_mm": 0.001, "deep_mm": (0.003, 0.005, 0.008), "block_px": 2},
    ),
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
