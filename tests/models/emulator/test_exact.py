"""The emulator against models/integer, by the stages' own functions and the int64 loop, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
from emulated import check, frames_of

from fastac.models import random_bundle
from fastac.models.emulator import direct
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.network import GradientRatio
from fastac.models.loops.frames import CHUNK
from fastac.models.loops.pixels import slope_words

DEPTH, Z, XYZ = "depth", "force_z", "force_xyz"
MAP = ("force_z", "force_map")
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
    "smoothed": ((DEPTH, Z), {"smoothing_px": 4}),
    "smoothed, four channels": ((XYZ,), {"smoothing_px": 8, "channels": "bgr+nir", "solver": "adjoint"}),
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
