# amaranth: UnusedElaboratable=no
"""The fit of the resource model (`resources.py`) to designs that Yosys has counted, and its errors."""

import numpy as np
from scipy.optimize import nnls

from fastac.synth.estimates.resources import FITTED, columns, predict


def fit(samples: list[dict]) -> dict[str, dict[str, np.ndarray]]:
    """Factors by stage and resource: non-negative least squares, each sample weighted by its size."""
    factors: dict[str, dict[str, np.ndarray]] = {}
    for stage in {stage for sample in samples for stage in sample["counted"]}:
        with_stage = [s for s in samples if stage in s["counted"]]
        factors[stage] = {}
        for name in FITTED:
            x = np.array([columns(s["features"][stage], name) for s in with_stage], float)
            y = np.array([s["counted"][stage][name] for s in with_stage], float)
            weight = 1 / np.maximum(y, max(y.max() * 0.05, 1e-9))
            factors[stage][name] = nnls(x * weight[:, None], y * weight)[0]
    return factors


def leave_one_out(samples: list[dict]) -> dict[str, np.ndarray]:
    """By resource, the relative error in % of each sample's sum, predicted from the other samples.

    Over the stages that were counted of the sample.
    """
    errors: dict[str, list[float]] = {name: [] for name in FITTED}
    for k, sample in enumerate(samples):
        factors = fit(samples[:k] + samples[k + 1 :])
        found = predict(factors, {stage: sample["features"][stage] for stage in sample["counted"]})
        for name in FITTED:
            counted = sum(stage[name] for stage in sample["counted"].values())
            errors[name].append(100 * (sum(stage[name] for stage in found.values()) / counted - 1))
    return {name: np.array(values) for name, values in errors.items()}


def fitted(samples: list[dict]) -> dict[str, dict]:
    """What `resources.model` reads beside the samples: factors by stage and resource, and by resource the
    relative error in % of each sample predicted from the others."""
    factors = {
        stage: {name: values.tolist() for name, values in found.items()}
        for stage, found in sorted(fit(samples).items())
    }
    errors = {name: values.tolist() for name, values in leave_one_out(samples).items()}
    return {"factors": factors, "left_out_errors_percent": errors}
