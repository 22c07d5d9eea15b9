from dataclasses import replace

import numpy as np
import pytest

from fastac.flow.force_fits import FITS, ForceSamples, fits_robustly, fits_validation
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.hyperforce import coordinates
from fastac.models.integer.force import block_means
from fastac.models.random_bundle import random_bundle, scene
from fastac.models.training.force import polynomial_weights
from tests.models.training.force.test_press_symmetry import recordings


def test_presses_that_others_need_unseen_are_not_fitted(make_scene):
    forces = {
        "outputs": ["force_z"],
        "poisson": {"solver": "adjoint"},
        "force": {"fit": "slopes", "clamp": False},
    }
    assert fits_validation(make_scene(**forces))
    assert not fits_validation(make_scene(**forces, training={"labels": "force"}))
    assert not fits_robustly(make_scene(**forces))
    assert fits_robustly(make_scene(**forces, training={"labels": "force"}))
    with_interval = forces | {"force": forces["force"] | {"coverage": 0.9}}
    assert not fits_validation(make_scene(**with_interval))


def test_weights_of_slopes_are_symmetric_where_recordings_left_out_gain_by_it(make_scene):
    slopes, force_n, group = recordings()
    samples = ForceSamples(slopes, force_n, np.zeros(slopes["train"].shape[1:3]), recording=group)
    keys = {"outputs": ["force_z"], "poisson": {"solver": "adjoint"}}
    keys["force"] = {"clamp": False, "fit": "slopes"}

    def asymmetry(weights):
        return np.abs(weights[0, :, ::-1] - weights[0] * [-1, 1]).max() / np.abs(weights).max()

    def fitted(training, known=samples):
        scene = make_scene(**keys, training=training)
        return FITS["slopes"].fit(scene, None, known, progress=False)

    dots = replace(samples, shifts_px={s: np.ones((len(v), 2, 2)) for s, v in samples.found.items()})
    _, of_dots, history = fitted({"labels": "force"}, dots)
    assert of_dots.shape == (1, 2, 2)
    assert "symmetric" not in history[0]

    weights, of_dots, history = fitted({"labels": "force"})
    assert of_dots is None
    assert history[0]["symmetric"]
    assert asymmetry(weights) < 1e-9
    for training in ({"labels": "force", "press_symmetry": False}, {"labels": "geometry"}):
        plain, _, history = fitted(training)
        assert "symmetric" not in history[0]
        assert asymmetry(plain) > 0.5


def test_wrong_forces_of_a_gauge_do_not_lead_weights_of_slopes_astray(make_scene):
    slopes, force_n, _ = recordings()
    group = {split: np.arange(len(values)) % 5 for split, values in force_n.items()}
    keys = {"outputs": ["force_z"], "poisson": {"solver": "adjoint"}}
    keys["force"] = {"clamp": False, "fit": "slopes"}
    wrong = {split: values.copy() for split, values in force_n.items()}
    wrong["train"][::9] -= 20 * np.abs(force_n["train"]).max()
    rest_mm = np.zeros(slopes["train"].shape[1:3])
    dots = {split: np.zeros((len(values), 1, 2)) for split, values in slopes.items()}

    def error(training, **known):
        found, *_ = FITS["slopes"].fit(
            make_scene(**keys, training=training),
            None,
            ForceSamples(slopes, wrong, rest_mm, recording=group, **known),
            progress=False,
        )
        estimate = np.einsum("nijt,aijt->na", slopes["validation"], found)
        return np.abs(estimate - force_n["validation"]).mean()

    plain = error({"labels": "geometry"})
    assert error({"labels": "force"}) < 0.3 * plain  # symmetric
    assert error({"labels": "force", "press_symmetry": False}) < 0.3 * plain
    assert error({"labels": "force"}, shifts_px=dots) < 0.3 * plain


def test_polynomials_are_those_of_the_skin_at_rest(make_scene):
    """Of the inner pixels; all presses are fitted, and held out whole to choose the regularisation."""
    scene = make_scene(
        outputs=["force_z"], force={"kernel": "collapsed", "fit": "polynomials", "band_mm": 0.01}
    )
    rng, side = np.random.default_rng(1), 8
    rest_mm = rng.normal(size=(side + 2, side + 2))
    found = {
        "train": rng.normal(size=(60, side, side, 3)),
        "validation": rng.normal(size=(30, side, side, 3)),
    }
    force_n = {split: rng.normal(size=(len(images), 1)) for split, images in found.items()}
    together = {split: np.arange(len(images)) // 3 for split, images in found.items()}
    samples = ForceSamples(found, force_n, rest_mm, together=together)
    way = FITS["polynomials"]
    assert way.start(scene, samples, progress=False) == (None, [])
    weights, of_dots, history = way.fit(scene, None, samples, progress=False)
    expected, _, errors = polynomial_weights.fit(
        coordinates(rest_mm[1:-1, 1:-1]), found, force_n, with_validation=True, together=together
    )
    np.testing.assert_array_equal(weights, expected)
    assert (of_dots, history) == (None, errors)


@pytest.mark.parametrize("fit", ["polynomials", "weights", "slopes"])
def test_weights_of_squares_are_fitted_to_means_in_squares(tmp_path, fit):
    """So that the errors that choose a fit are those of the weights that the hardware will have."""
    made = scene(("force_z",), size=24, **({"solver": "adjoint"} if fit == "slopes" else {"clamp": False}))
    pipeline = random_bundle(tmp_path / "b", made).pipeline
    frames = np.random.default_rng(1).integers(60, 200, (2, *pipeline.background.shape)).astype(np.uint8)

    def found(block_px):
        force = made.force.model_copy(update={"block_px": block_px})
        emulator = Emulator(pipeline.replace(scene=made.model_copy(update={"force": force})))
        return FITS[fit].force_input(emulator, frames, pipeline.background, progress=False)

    np.testing.assert_allclose(found(4), block_means(found(1), 4))
    assert np.abs(found(4) - found(1)).max() > 0
