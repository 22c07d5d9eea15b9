"""Half-widths of the force's interval against Python's integers, at the extremes, and what is refused."""

import numpy as np
import pytest

from fastac.models.integer.force_interval import BASE_BITS, LOAD, MEASURE_BITS, WEIGHT_BITS, ForceInterval
from fastac.models.integer.frame_validity import FrameValidity

MEASURES = ("brightness_b", "change", "gradient", LOAD)
LIMITS = (255 * 4096, 255 * 4096 * 4, 2 * 4096, (1 << 40) - 1)
SHIFTS = (0, 3, 0, 17)


def interval(
    weights, base, exponent=(-6, 3), *, measures=MEASURES, limits=LIMITS, shifts=SHIFTS, load_axis=1
):
    tables = (np.array(table, np.int64) for table in (limits, shifts, weights, base, exponent))
    return ForceInterval(tuple(measures), *tables, load_axis)


def by_definition(found: ForceInterval, measures: list[int], raw: list[int]) -> list[int]:
    halves = []
    for a in range(len(raw)):
        total = int(found.base[a])
        for k, value in enumerate([*measures, raw[found.load_axis]]):
            total += int(found.weights[a, k]) * abs(value >> int(found.shifts[k]))
        exponent = int(found.exponent[a])
        halves.append(total << exponent if exponent >= 0 else total >> -exponent)
    return halves


def test_equals_the_definition_and_the_bounds_are_reached():
    rng = np.random.default_rng(1)
    found = interval(rng.integers(0, 1 << WEIGHT_BITS, (2, 4)), [12345, (1 << BASE_BITS) - 1])
    assert found.pixel_measures == MEASURES[:-1]
    limits = np.array(LIMITS)
    values = rng.integers(-limits, limits + 1, (20, 4))
    # Nothing measured, all at their largest of either sign, and one unit below zero.
    values = np.concatenate([values, [0 * limits, limits, -limits, np.full(4, -1)]])
    values[:, 1:3] = np.abs(values[:, 1:3])
    raw = np.stack([rng.integers(-1000, 1000, len(values)), values[:, 3]], axis=1)
    halves = found.half_widths(values[:, :3], raw)
    assert halves.dtype == np.int64
    assert halves.tolist() == [
        by_definition(found, v[:3], r) for v, r in zip(values.tolist(), raw.tolist(), strict=True)
    ]
    assert halves.min() >= 0
    # Measures that are never negative round down, so the bound is that of a negative one.
    worst = found.half_widths(-limits[None, :3], np.array([[0, -LIMITS[3]]]))
    assert worst[0].tolist() == list(found.half_bounds)
    assert found.half_width == max(found.half_bounds).bit_length()
    assert halves[20].tolist() == [int(found.base[0]) >> 6, int(found.base[1]) << 3]


def test_widths_at_the_largest_tables():
    top, most = (1 << WEIGHT_BITS) - 1, (1 << MEASURE_BITS) - 1
    full = interval([[top] * 2] * 2, [0, 0], measures=("change", LOAD), limits=[most] * 2, shifts=[0, 0])
    assert full.magnitude_widths == (MEASURE_BITS,) * 2
    assert full.product_widths == (WEIGHT_BITS + MEASURE_BITS,) * 2
    assert full.sum_bounds == (2 * top * most,) * 2
    assert full.sum_width == 1 + WEIGHT_BITS + MEASURE_BITS
    assert full.half_bounds == (2 * top * most >> 6, 2 * top * most << 3)
    nothing = interval([[0] * 4] * 2, [0, 0])
    assert (nothing.sum_width, nothing.half_width, nothing.product_widths) == (1, 1, (1, 1, 1, 1))
    assert not nothing.half_widths(np.array([LIMITS[:3]]), np.array([[5, LIMITS[3]]])).any()


def test_without_a_measure_every_frame_has_the_base():
    found = interval([[]], [640], [-6], measures=(), limits=[], shifts=[], load_axis=0)
    assert found.half_widths(np.zeros((3, 0), np.int64), np.array([[5], [-7], [0]])).tolist() == [[10]] * 3


def test_words_of_real_numbers_are_never_too_small():
    rng = np.random.default_rng(2)
    limits = np.array(LIMITS)
    for size in 10.0 ** np.arange(-3, 9):
        weights, base = rng.uniform(0, size, (2, 4)), rng.uniform(0, 1000 * size, 2)
        weights[1, 2] = 0
        found = ForceInterval.of_weights(MEASURES, limits, weights, base)
        assert found.shifts.tolist() == [0, 0, 0, 17]
        measures, raw = rng.integers(0, limits + 1, (9, 4)), np.zeros((9, 2), np.int64)
        raw[:, 0] = measures[:, 3]
        halves = found.half_widths(measures[:, :3], raw)
        exact = (measures >> found.shifts) @ weights.T + base
        assert (halves >= exact - 1).all()
        np.testing.assert_allclose(halves, exact, rtol=3e-4, atol=2)
    constant = ForceInterval.of_weights((), [], np.zeros((1, 0)), np.array([41.5]))
    assert constant.half_widths(np.zeros((1, 0), np.int64), np.zeros((1, 1), np.int64)).tolist() == [[42]]


def test_columns_of_a_frame_s_measures():
    validity = FrameValidity.unlimited((8, 8, 3), slopes=True, displacements=True)
    found = interval([[0] * 4] * 2, [0, 0])
    assert [validity.names[column] for column in found.columns(validity.names)] == list(MEASURES[:-1])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"weights": [[1 << WEIGHT_BITS, 0, 0, 0]] * 2}, "weights 0 to 131072: expected 0 to 131071"),
        ({"weights": [[0, -1, 0, 0]] * 2}, "weights -1 to 0"),
        ({"base": [-1, 0]}, "base -1 to 0"),
        ({"base": [1 << BASE_BITS, 0]}, "base 0 to"),
        ({"shifts": [0, 0, 0, 16]}, "magnitude"),
        ({"shifts": [0, 0, 0, -1]}, "shifts"),
        ({"exponent": [0, 30]}, "exponent"),
        ({"exponent": [0]}, r"exponent \(1,\): expected \(2,\)"),
        ({"measures": ("displacement", *MEASURES[1:])}, "'displacement' is unknown"),
        ({"measures": ("change", "change", "gradient", LOAD)}, "there twice"),
        ({"measures": ("change", LOAD, "gradient", "detail")}, "expected 'load' behind all others"),
        ({"load_axis": 2}, "load_axis 2: expected 0 to 1"),
    ],
)
def test_refused(changes, message):
    good = {"weights": [[1, 1, 1, (1 << WEIGHT_BITS) - 1]] * 2, "base": [0, 0], "exponent": [-6, 3]}
    interval(**good)
    with pytest.raises(ValueError, match=message):
        interval(**(good | changes))
