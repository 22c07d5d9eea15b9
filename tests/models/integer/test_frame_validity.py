"""What makes a frame suspect, against loops over its pixels, and the limits that training sets."""

import numpy as np
import pytest

from fastac.models.emulator.pipeline import Emulator, with_limits
from fastac.models.integer.frame_validity import DISPLACEMENT, DOTS, REASONS, FrameValidity, suspects
from fastac.models.random_bundle import frames, random_bundle, scene

SHAPE = (6, 8, 3)
MEASURES = ("clipped", "brightness_b", "brightness_g", "brightness_r", "change", "detail")


def counted(frame: np.ndarray, background: np.ndarray) -> list[int]:
    """The pixels' measures by Python's integers alone."""
    frame, background = frame.tolist(), background.tolist()
    brightness, clipped, change, detail = [0] * len(frame[0][0]), 0, 0, 0
    for row, known in zip(frame, background, strict=True):
        for u, pixel in enumerate(row):
            clipped += any(value in (0, 255) for value in pixel)
            for c, value in enumerate(pixel):
                brightness[c] += value - known[u][c]
                change += abs(value - known[u][c])
                detail += abs(value - row[u - 1][c]) if u else 0
    return [clipped, *brightness, change, detail]


def test_measures_of_pixels():
    rng = np.random.default_rng(1)
    validity = FrameValidity.unlimited(SHAPE, slopes=False, displacements=False)
    assert validity.names == MEASURES
    background = rng.integers(0, 256, SHAPE, dtype=np.uint8)
    black, white = np.zeros_like(background), np.full_like(background, 255)
    stripes = np.where(np.arange(SHAPE[1])[:, None] % 2, white, black)
    for frame in (*rng.integers(0, 256, (5, *SHAPE), dtype=np.uint8), black, white, stripes, background):
        for known in (background, black, white):
            assert validity.of_pixels(frame, known).tolist() == counted(frame, known)
    # The bounds are reached, and no more.
    low, high = validity.bounds
    assert np.array_equal(validity.of_pixels(white, black)[:5], high[:5])
    assert np.array_equal(validity.of_pixels(black, white)[1:4], low[1:4])
    assert validity.of_pixels(stripes, background)[5] == high[5]
    assert validity.widths == (7, 15, 15, 15, 17, 16)


def test_each_limit_sets_the_bit_of_its_reason():
    shape = (6, 8, 4)
    validity = FrameValidity.unlimited(shape, slopes=True, displacements=True, dots=9)
    assert validity.names == REASONS
    low, high = validity.bounds
    middle = (low + high) // 2
    validity = FrameValidity(shape, True, True, middle - 1, middle + 1, 9)
    assert validity.flags(middle) == 0
    for k in range(len(REASONS)):
        for step, flag in ((-2, 1 << k), (-1, 0), (1, 0), (2, 1 << k)):
            measures = middle.copy()
            measures[k] += step
            assert validity.flags(measures) == flag, (REASONS[k], step)
    both = np.stack([middle - 2, middle, middle + 2])
    assert validity.flags(both).tolist() == [(1 << len(REASONS)) - 1, 0, (1 << len(REASONS)) - 1]
    # Bits keep their place where a channel or a stage is missing.
    fewer = FrameValidity(SHAPE, False, False, *(np.zeros(6, int),) * 2)
    assert fewer.flags(np.array([0, 0, 0, 0, 0, 1])) == 1 << REASONS.index("detail")


def test_limits_are_the_range_and_its_margin():
    validity = FrameValidity.unlimited((40, 50, 4), slopes=True, displacements=True)
    measures = np.array(
        [
            [0, -9000, 100, 0, 0, 20_000, 100_000, 0, 0],
            [6, -1000, 900, 0, 0, 60_000, 104_000, 400, 3],
        ]
    )
    found = validity.limited(measures)
    limits = dict(zip(validity.names, zip(found.low.tolist(), found.high.tolist(), strict=True), strict=True))
    assert limits == {
        "clipped": (0, 6 + 3),  # half the range; a thousandth of 2,000 pixels is less
        "brightness_b": (-9000 - 4500, 4500),  # 0 is in the range
        "brightness_g": (-2000, 900 + 2000),  # one digital number a pixel
        "brightness_r": (-2000, 2000),
        "brightness_nir": (-2000, 2000),
        "change": (0, 60_000 + 20_000),
        "detail": (100_000 - 5200, 104_000 + 5200),  # a twentieth
        "gradient": (0, 400 + 200),
        "displacement": (0, 3 + 1),
    }
    assert not found.flags(measures).any()
    # One frame is enough, and no limit is beyond what can be counted.
    low, high = validity.bounds
    for extreme in (low, high):
        found = validity.limited(extreme[None])
        assert (found.low >= low).all()
        assert (found.high <= high).all()


def test_lost_dots_are_counted_where_there_are_dots():
    assert "dots" not in FrameValidity.unlimited(SHAPE, slopes=True, displacements=True).names
    validity = FrameValidity.unlimited(SHAPE, slopes=False, displacements=False, dots=49)
    assert validity.names == (*MEASURES, "dots")
    assert [bound[-1] for bound in validity.bounds] == [0, 49]
    assert validity.widths[-1] == 7
    measures = np.zeros((3, 7), int)
    measures[:, -1] = 0, 2, 6
    limited = validity.limited(measures)
    assert (limited.dots, limited.low[-1], limited.high[-1]) == (49, 0, 6 + 3)  # half the range
    none = validity.limited(measures[:1])
    assert none.high[-1] == 0
    assert none.flags(measures).tolist() == [0, DOTS, DOTS]
    with pytest.raises(ValueError, match="high of dots 50: expected 0 to 49"):
        FrameValidity(SHAPE, False, False, validity.low, np.append(validity.high[:-1], 50), 49)


def test_lost_dots_and_saturated_displacements_concern_the_force_alone():
    flags = np.array([0, DOTS, DISPLACEMENT, DOTS | DISPLACEMENT, DOTS | 1])
    assert suspects(flags).tolist() == [False, False, False, False, True]
    assert [REASONS[int(bit).bit_length() - 1] for bit in (DOTS, DISPLACEMENT)] == ["dots", "displacement"]


def test_limits_hold_for_the_frames_that_made_them(tmp_path):
    for outputs, names in ((("normals",), 6), (("depth",), 7), (("force_z",), 8)):
        pipeline = random_bundle(tmp_path / outputs[0], scene(outputs)).pipeline
        assert len(pipeline.validity.names) == names
        good = frames(pipeline.background, (5, 10), seed=3)
        limited = with_limits(pipeline, good)
        assert not Emulator(limited).run(good, wanted=["validity"]).validity.any()
        black = Emulator(limited).run(np.zeros_like(good[:1])).validity[0]
        names = {name for k, name in enumerate(REASONS) if black >> k & 1}
        assert names >= {"clipped", "brightness_b", "brightness_g", "brightness_r", "change", "detail"}


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        (np.zeros(5, int), np.zeros(6, int), r"low \(5,\): expected \(6,\)"),
        (np.array([-1, 0, 0, 0, 0, 0]), np.zeros(6, int), "low of clipped -1: expected 0 to 48"),
        (
            np.zeros(6, int),
            np.array([0, 0, 12241, 0, 0, 0]),
            "high of brightness_g 12241: expected -12240 to",
        ),
    ],
)
def test_refuses(low, high, message):
    with pytest.raises(ValueError, match=message):
        FrameValidity(SHAPE, False, False, low, high)


@pytest.mark.parametrize("shape", [(), (4, 4), (4, 4, 3, 1)])
def test_refuses_a_shape_that_is_no_image(shape):
    with pytest.raises(ValueError, match=r"shape \(.*\): expected \(H, W, C\)"):
        FrameValidity(shape, False, False, np.zeros(6, int), np.zeros(6, int))
