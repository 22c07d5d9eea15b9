# amaranth: UnusedElaboratable=no
import json

import numpy as np

from fastac.synth.estimates import resources
from fastac.synth.estimates.resource_fit import fit, fitted, leave_one_out
from fastac.synth.estimates.stages import stage_names


def made_up(count: int, rng) -> list[dict]:
    """Samples of two stages whose look-up tables are exact sums of what is known of them."""
    found = []
    for _ in range(count):
        a, b = {"one": 1, "bits": float(rng.integers(1, 99))}, {"one": 1, "bits": float(rng.integers(1, 99))}
        counted = {
            "a": {"lut": 7 + 2 * a["bits"], "ramb36": 3.0},
            "b": {"lut": 1 + 5 * b["bits"], "ramb36": 1.0},
        }
        features = {"a": a | {"ramb36": 3.0}, "b": b | {"ramb36": 2.0}}
        found.append({"features": features, "counted": counted})
    return found


def test_the_fit_finds_what_there_is():
    samples = made_up(6, np.random.default_rng(1))
    factors = fit(samples)
    np.testing.assert_allclose(factors["a"]["lut"], [7, 2])
    np.testing.assert_allclose(factors["b"]["lut"], [1, 5])
    np.testing.assert_allclose(factors["b"]["ramb36"], [0.5])
    for errors in leave_one_out(samples).values():
        np.testing.assert_allclose(errors, 0, atol=1e-9)


def test_the_error_is_that_of_samples_left_out():
    samples = made_up(6, np.random.default_rng(1))
    samples[3]["counted"]["a"]["lut"] *= 2
    errors = leave_one_out(samples)["lut"]
    whole = sum(stage["lut"] for stage in samples[3]["counted"].values())
    a = samples[3]["counted"]["a"]["lut"] / 2
    np.testing.assert_allclose(errors[3], -100 * a / whole)


def test_the_committed_factors_are_those_of_the_committed_samples():
    content = json.loads(resources.SAMPLES.read_text())
    found = fitted(content["samples"])
    assert content["factors"].keys() == found["factors"].keys() == set(stage_names())
    for stage, factors in found["factors"].items():
        for name, values in factors.items():
            np.testing.assert_allclose(content["factors"][stage][name], values, rtol=1e-6, atol=1e-9)
    for name, errors in found["left_out_errors_percent"].items():
        assert np.isfinite(errors).all()
        np.testing.assert_allclose(content["left_out_errors_percent"][name], errors, rtol=1e-6, atol=1e-9)
