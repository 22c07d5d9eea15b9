# amaranth: UnusedElaboratable=no
"""Flags of random frames whose measures are equal to, inside and outside their limits."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fastac.gateware.stream.frame_validity import FrameValidity
from fastac.models.integer import frame_validity as model
from fastac.models.integer.features import integer_features
from fastac.sim.check_stream import pack
from fastac.sim.runner import simulate

SIZE = 16
FRAMES = 6


def stimulus(rng, channels: int, slopes: bool, displacements: bool):
    """Frames with small to large changes, their background, and which slopes and displacements saturate."""
    background = rng.integers(60, 200, (SIZE, SIZE, channels)).astype(np.uint8)
    spans = np.array([3, 255, 20, 40, 255, 8])[:, None, None, None]
    changed = background + rng.integers(-spans, spans + 1, (FRAMES, *background.shape))
    frames = np.clip(changed, 0, 255).astype(np.uint8)
    over = {
        "slopes": rng.random((FRAMES, SIZE, SIZE, 2)) < rng.random((FRAMES, 1, 1, 1)) if slopes else None,
        "displacements": rng.random((FRAMES, SIZE - 2, SIZE - 2)) < rng.random((FRAMES, 1, 1))
        if displacements
        else None,
    }
    return frames, background, {name: value for name, value in over.items() if value is not None}


def words(frames, background, over, lanes: int) -> dict[str, list[int]]:
    """The input words of every stage, lane 0 in the LSBs; unused lanes at a row's end are 0."""
    channels = background.shape[-1]
    features = integer_features(frames, background).astype(int)
    found = {
        "pixels": pack(frames.reshape(-1, lanes * channels).astype(int), 8),
        "features": pack(features.reshape(-1, lanes * (channels + 2)), 9),
    }
    if "slopes" in over:
        found["slopes"] = pack(over["slopes"].reshape(-1, 2 * lanes).astype(int), 1)
    if "displacements" in over:
        padded = np.pad(over["displacements"], ((0, 0), (0, 0), (0, -(SIZE - 2) % lanes)))
        found["displacements"] = pack(padded.reshape(-1, lanes).astype(int), 1)
    return found


@pytest.mark.parametrize(
    ("lanes", "channels", "slopes", "displacements"),
    [(1, 4, True, True), (2, 3, True, False), (4, 4, False, False), (4, 3, True, True)],
)
@pytest.mark.quick("2-3-True-False")
def test_flags(tmp_path, lanes, channels, slopes, displacements):
    rng = np.random.default_rng(lanes)
    frames, background, over = stimulus(rng, channels, slopes, displacements)
    known = model.FrameValidity.unlimited(background.shape, slopes=slopes, displacements=displacements)
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
    component = FrameValidity(limited, lanes=lanes)
    settings = {
        "streams": words(frames, background, over, lanes),
        "flags": flags.tolist(),
        "latency": component.latency,
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
