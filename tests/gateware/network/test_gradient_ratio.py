# amaranth: UnusedElaboratable=no
import itertools

import numpy as np
import pytest

from fastac.gateware.network.gradient_ratio import GradientDivider
from fastac.models.integer.network import GradientRatio
from fastac.sim.check_stream import check, pack


def normals(ratio, rng, count):
    """Extreme words in all combinations, quotients near the limit and near halves, quotients of ones but for
    one bit, divisors of one bit, and random normals."""
    top = (1 << (ratio.normal_width - 1)) - 1
    corners = [-top - 1, -top, -1, 0, 1, 2, top - 1, top]
    extremes = np.array(list(itertools.product(corners, repeat=3)))

    n_z = rng.integers(1, top + 1, count)
    # Slopes of half an LSB, and n one more or less: where rounding and saturation change.
    q = np.where(np.arange(count) % 2, ratio.limit, rng.integers(0, ratio.limit + 1, count))
    near = ((2 * q + 1) * n_z >> (ratio.fraction + 1))[:, None] + rng.integers(-1, 2, (count, 2))
    near = np.minimum(near, top) * rng.choice([-1, 1], (count, 2))
    around = np.concatenate([near, n_z[:, None]], axis=1)

    n_z, ones = rng.integers(1, top + 1, 1000), (1 << ratio.width) - 1
    quotients = (ones ^ np.append(0, 1 << np.arange(ratio.width)))[:, None]
    n = -(-quotients * n_z >> (ratio.fraction + 1))
    fits = (n <= top) & ((n << (ratio.fraction + 1)) // n_z == quotients)
    found, first = np.flatnonzero(fits.any(axis=1)), fits.argmax(axis=1)
    n, n_z = n[found, first[found]], n_z[first[found]]
    all_but_one = np.concatenate([np.stack([n, -n, n_z], axis=1), np.stack([-n, n, n_z], axis=1)])

    anything = rng.integers(-top - 1, top + 1, (count, 3))
    anything[: count // 2, 2] >>= rng.integers(0, ratio.normal_width, count // 2)
    bits = 1 << np.arange(ratio.normal_width - 1)
    single = np.stack([*rng.integers(-top, top + 1, (2, len(bits))), bits], axis=1)
    return np.concatenate([extremes, around, all_but_one, single, single // [2, 2, 1], anything])


def alone(lanes, top):
    """Normals without a slope in all lanes but one, which is not positive or has one slope that saturates."""
    kinds = np.array([[0, 0, -1], [top, 0, 1], [0, top, 1]])
    n = np.full((len(kinds), lanes, lanes, 3), [0, 0, top])
    n[:, range(lanes), range(lanes)] = kinds[:, None]
    return n.reshape(-1, lanes, 3)


@pytest.mark.parametrize(
    ("normal_width", "width", "fraction", "lanes"),
    [(21, 17, 14, 2), (10, 9, 8, 4), (7, 12, 5, 1), (8, 6, 0, 1)],
)
@pytest.mark.quick("10-9-8-4")
def test_bit_exact_to_golden_model(tmp_path, normal_width, width, fraction, lanes):
    rng = np.random.default_rng(1)
    ratio = GradientRatio(normal_width, width, fraction)
    dut = GradientDivider(ratio, lanes=lanes)
    # Every lane divides all of them, and different lanes different ones at a time.
    n = np.concatenate([np.repeat(normals(ratio, rng, 400), lanes, axis=0), normals(ratio, rng, 400)])
    n = n[: len(n) // lanes * lanes].reshape(-1, lanes, 3)
    n = np.concatenate([n, alone(lanes, (1 << (normal_width - 1)) - 1)])
    slopes, saturated = ratio(n)
    assert saturated.any()
    assert not saturated.all(axis=(1, 2)).all()
    assert (slopes == ratio.limit).any()
    assert (slopes == -ratio.limit).any()
    check(
        dut,
        "gradient_divider",
        tmp_path,
        room=width + 3,
        inputs=pack(n, normal_width),
        expected=pack(slopes, width),
        latencies=[(k, k, width + 2) for k in range(len(n))],
        flags={
            "saturated": int(saturated.any(axis=(1, 2)).sum()),
            "over": int((saturated.reshape(len(n), -1) << np.arange(2 * lanes)).sum()),
        },
    )


@pytest.mark.parametrize(
    ("ratio", "lanes", "message"),
    [
        (GradientRatio(12, 9, 6), 3, r"lanes 3: expected one of \(1, 2, 4\)"),
        (GradientRatio(1, 1, 0), 1, "normal_width 1: expected at least 2"),
        (GradientRatio(12, 9, 9), 1, "fraction 9: expected 0 to 8"),
        (GradientRatio(12, 9, -1), 1, "fraction -1: expected 0 to 8"),
        (GradientRatio(6, 12, 5), 1, "width 12: expected at most 11"),
    ],
)
def test_invalid_arguments(ratio, lanes, message):
    with pytest.raises(ValueError, match=message):
        GradientDivider(ratio, lanes=lanes)
