# amaranth: UnusedElaboratable=no
"""Flags of random frames whose measures are equal to, inside and outside their limits."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fastac.gateware.stream.frame_validity import DOTS_LATENCY, FrameValidity
from fastac.models.integer import frame_validity as model
from fastac.models.integer.features import integer_features
from fastac.sim.check_stream import pack
from fastac.sim.runner import simulate

SIZE = 16
FRAMES = 6
DOTS = 9
BEFORE, AFTER = -21, 380
"""Clocks from a frame's last beat of pixels to its last dot: before and after all else is known."""


def stimulus(rng, channels: int, slopes: bool, displacements: bool, dots: int = 0):
    """Frames with small to large changes, their background, and which slopes and displacements saturate and
    which dots are lost."""
    background = rng.integers(60, 200, (SIZE, SIZE, channels)).astype(np.uint8)
    spans = np.array([3, 255, 20, 40, 255, 8])[:, None, None, None]
    changed = background + rng.integers(-spans, spans + 1, (FRAMES, *background.shape))
    frames = np.clip(changed, 0, 255).astype(np.uint8)
    over = {
        "slopes": rng.random((FRAMES, SIZE, SIZE, 2)) < rng.random((FRAMES, 1, 1, 1)) if slopes else None,
        "displacements": rng.random((FRAMES, SIZE - 2, SIZE - 2)) < rng.random((FRAMES, 1, 1))
        if displacements
        else None,
        "dots": rng.random((FRAMES, dots)) < np.linspace(0, 1, FRAMES)[:, None] if dots else None,
    }
    return frames, background, {name: value for name, value in over.items() if value is not None}


def words(frames, backgrounds, over, lanes: int) -> dict[str, list[int]]:
    """The input words of every stage, lane 0 in the LSBs; unused lanes at a row's end are 0."""
    channels = frames.shape[-1]
    pairs = zip(frames, backgrounds, strict=True)
    features = np.array([integer_features(frame, background) for frame, background in pairs]).astype(int)
    found = {
        "pixels": pack(frames.reshape(-1, lanes * channels).astype(int), 8),
        "features": pack(features.reshape(-1, lanes * (channels + 2)), 9),
    }
    if "slopes" in over:
        found["slopes"] = pack(over["slopes"].reshape(-1, 2 * lanes).astype(int), 1)
    if "displacements" in over:
        padded = np.pad(over["displacements"], ((0, 0), (0, 0), (0, -(SIZE - 2) % lanes)))
        found["displacements"] = pack(padded.reshape(-1, lanes).astype(int), 1)
    if "dots" in over:
        found["dots"] = over["dots"].ravel().astype(int).tolist()
    return found


def pack_fields(values, widths) -> int:
    """Signed values as fields of one word, the first in the least significant bits."""
    word = place = 0
    for value, width in zip(values, widths, strict=True):
        word |= (int(value) & ((1 << width) - 1)) << place
        place += width
    return word


@pytest.mark.parametrize(
    ("lanes", "channels", "slopes", "displacements", "dots", "dots_lag"),
    [
        (1, 4, True, True, 0, 0),
        (2, 3, True, False, 0, 0),
        (4, 4, False, False, 0, 0),
        (4, 3, True, True, 0, 0),
        (4, 3, True, True, DOTS, BEFORE),
        (4, 3, True, True, DOTS, AFTER),
        (1, 4, True, True, DOTS, 303),
        (2, 4, False, False, 1, 4),
    ],
)
@pytest.mark.quick(
    f"4-3-True-True-{DOTS}-{AFTER}",
    f"4-3-True-True-{DOTS}-{BEFORE}",
    mutate=["2-3-True-False-0-0"],
)
def test_flags(tmp_path, lanes, channels, slopes, displacements, dots, dots_lag):
    """Dots are known before or after all else, or as the last displacement or change is about to be."""
    rng = np.random.default_rng(lanes)
    frames, background, over = stimulus(rng, channels, slopes, displacements, dots)
    known = model.FrameValidity.unlimited(
        background.shape, slopes=slopes, displacements=displacements, dots=dots
    )
    measures = np.array([known.of_pixels(frame, background) for frame in frames])
    for saturated in over.values():
        measures = np.column_stack([measures, saturated.reshape(FRAMES, -1).sum(axis=1)])
    # Each limit is the measure of some frame, or one beside it: a measure equal to its limit is inside.
    ordered = np.sort(measures, axis=0)
    columns = np.arange(measures.shape[1])
    low, high = ordered[rng.integers(0, 3, len(columns)), columns], ordered[3 + columns % 2, columns]
    low = np.where([name in model.TWO_SIDED for name in known.names], low + columns % 2, 0)
    limited = replace(known, low=low, high=np.maximum(high - columns % 2, low))
    flags = limited.flags(measures)
    seen = np.bitwise_or.reduce(flags)
    assert seen == sum(1 << model.REASONS.index(name) for name in known.names)
    assert len(set(flags.tolist())) > 2
    measured = [name for name in known.names if name not in ("displacement", "dots", "brightness_g")]
    component = FrameValidity(limited, lanes=lanes, measured=measured)
    settings = {
        "measures": {
            stage: {
                "words": [pack_fields(row[columns], [known.widths[k] for k in columns]) for row in measures],
                "latency": FrameValidity.measured_latency(stage, channels, lanes),
            }
            for stage, columns in (
                (stage, [known.names.index(name) for name in names])
                for stage, names in component.measured.items()
            )
        },
        "streams": words(frames, [background] * FRAMES, over, lanes),
        "flags": flags.tolist(),
        "latency": component.latency,
        "dots_lags": [dots_lag],
        "dots_latency": DOTS_LATENCY,
        "beats": SIZE * SIZE // lanes,
    }
    (tmp_path / "settings.json").write_text(json.dumps(settings))
    simulate(
        component, "validity", "fastac.sim.benches.validity", tmp_path, BENCH=str(tmp_path / "settings.json")
    )


def test_every_measure_to_the_last_bit(tmp_path):
    """Limits equal to a frame's measures let it pass; any other bit of one limit sets that measure's flag."""
    lanes, channels = 2, 4
    rng = np.random.default_rng(1)
    frames, background, over = stimulus(rng, channels, slopes=True, displacements=True, dots=DOTS)
    backgrounds = np.array([background] * FRAMES)
    # The largest measures of either sign, and the largest and smallest steps between neighbours.
    frames[0], backgrounds[0] = 255, 0
    frames[1], backgrounds[1] = 0, 255
    frames[2, :, ::2], frames[2, :, 1::2] = 255, 0
    one_bit = 1 << np.arange(8)
    frames[3] = rng.choice([*one_bit, *(255 - one_bit)], frames[3].shape)  # one bit from being clipped
    frames[5].reshape(-1, channels)[:88] = 255  # a count whose bits are neither all 0 nor all 1
    for saturated in over.values():
        saturated[0], saturated[1] = True, False
    known = model.FrameValidity.unlimited(background.shape, slopes=True, displacements=True, dots=DOTS)
    component = FrameValidity(known, lanes=lanes, loadable=True)
    two_sided = np.array([name in model.TWO_SIDED for name in known.names])
    least, most = known.bounds
    cases = []

    def add_case(frame: int, measures, limit):
        limit = np.clip(limit, least, most)
        limited = replace(known, low=np.where(two_sided, limit, least), high=limit)
        cases.append([frame, hex(component.limits_image(limited)), int(limited.flags(measures))])

    for k, (frame, own) in enumerate(zip(frames, backgrounds, strict=True)):
        counts = [saturated[k].sum() for saturated in over.values()]
        measures = np.array([*known.of_pixels(frame, own), *counts])
        assert not known.flags(measures)
        for step in (0, -1, 1):
            add_case(k, measures, measures + step)
        for column, width in enumerate(known.widths):
            for bit in range(width - 1 if k >= FRAMES - 2 else 0):
                other = measures.copy()
                other[column] ^= 1 << bit
                add_case(k, measures, other)
    settings = {
        "streams": words(frames, backgrounds, over, lanes),
        "cases": cases,
        "dots_lags": [BEFORE, 60],  # these frames pass the stages faster
        "dots_latency": DOTS_LATENCY,
        "frames": FRAMES,
        "flags": [],
        "beats": SIZE * SIZE // lanes,
    }
    (tmp_path / "settings.json").write_text(json.dumps(settings))
    simulate(
        component, "validity", "fastac.sim.benches.validity", tmp_path, BENCH=str(tmp_path / "settings.json")
    )


def test_limits_image_layout():
    """Of each measure the image holds `low`, if it has one, then `high`, as signed words."""
    known = model.FrameValidity.unlimited((SIZE, SIZE, 3), slopes=True, displacements=False)
    component = FrameValidity(known, lanes=1, loadable=True)
    assert len(component.limits) == component.limits_bits
    image, place = component.limits_image(known), 0
    for k, (name, width) in enumerate(zip(known.names, known.widths, strict=True)):
        for limit in (known.low[k], known.high[k]) if name in model.TWO_SIDED else (known.high[k],):
            field = image >> place & (1 << width) - 1
            assert field - (field >> (width - 1) << width) == limit, name
            place += width
    assert place == component.limits_bits
    assert "limits" not in FrameValidity(known, lanes=1).signature.members
