from dataclasses import replace

import numpy as np
import pytest

from fastac.flow.force_scale import force_factors, held_out_mae_n, with_force_scale
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.pipeline import FloatPipeline


def test_factors_of_each_axis():
    found = np.array([[1.0, 2.0, 0], [2.0, -2.0, 0], [3.0, 0, 0]])
    np.testing.assert_allclose(force_factors(found, found * (1.5, 0.5, 7) + (0, 0, 1)), (1.5, 0.5, 1))


def test_errors_of_presses_held_out():
    """The frame without contact counts for no press; each press has the factor of the others."""
    found, press = np.array([[1.0], [1.0], [1.0], [0.5]]), np.array(["a", "b", "b", ""])
    truth = np.array([[2.0], [2.0], [2.0], [1.0]])
    assert held_out_mae_n(found, truth, press) == pytest.approx((1.0, 0.0))
    truth[0] = 3.0
    before, after = held_out_mae_n(found, truth, press)
    assert before == pytest.approx(4 / 3)
    assert after == pytest.approx((1 + 2 * (3.5 / 1.25 - 2)) / 3)


def test_another_gel_s_stiffness_becomes_a_factor(tiny_bundle, tiny_data):
    """Integers and floats have their own; weights and words of the hardware stay."""
    index = np.arange(len(tiny_data))
    stiff = replace(tiny_data, force_n=3 * tiny_data.force_n)
    found, text = with_force_scale(tiny_bundle, stiff, index)
    assert text.startswith("scaled: z ")
    old, new = tiny_bundle.pipeline, found.pipeline
    assert new.force is old.force
    forces = Emulator(old).run(tiny_data.frames, wanted=["force_n"]).force_n
    factor = force_factors(forces, stiff.forces_n(index, (2,)).astype(float))
    np.testing.assert_allclose(new.force_n_per_unit, old.force_n_per_unit * factor)
    floats = [FloatPipeline.from_bundle(bundle).run(tiny_data.frames) for bundle in (tiny_bundle, found)]
    factor = force_factors(floats[0].force_n, stiff.forces_n(index, (2,)).astype(float))
    np.testing.assert_allclose(floats[1].force_n, floats[0].force_n * factor, rtol=1e-4, atol=1e-6)


def test_it_is_kept_where_nothing_better_is_known(tiny_bundle, tiny_data):
    index = np.arange(len(tiny_data))
    for data, chosen, reason in (
        (replace(tiny_data, force_n=None), index, "the presses have no force"),
        (tiny_data, index[:4], "2 of at least 3 presses"),
        (replace(tiny_data, force_n=-tiny_data.force_n), index, "a scale of its own does not help"),
    ):
        found, text = with_force_scale(tiny_bundle, data, chosen)
        assert found is tiny_bundle
        assert text.startswith(f"as it was: {reason}")
