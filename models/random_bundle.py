"""Bundles of random integers, with small default sizes and words: test hardware that needs no training."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from fastac.models.emulator.pipeline import with_limits
from fastac.models.integer import bundle
from fastac.models.integer.assemble import assemble, with_force, with_force_of
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.dot_follower import FRACTION, DotFollower, at_rest, guides_of
from fastac.models.integer.dot_windows import BLOCK, DotWindows
from fastac.models.integer.force_interval import BASE_BITS, WEIGHT_BITS, ForceInterval
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.models.random_tables import force_interval, force_weights, frames, layers, network_bits
from fastac.models.vision.expected_dots import bridge_reach, expected_follower
from fastac.scenes.parts import DEFAULT_PART
from fastac.scenes.schema import Scene
from fastac.scenes.sensor_schema import Sensor
from fastac.scenes.solvers import SOLVERS

DOTS = {"spacing_mm": 1.0, "radius_mm": 0.1}
"""Painted dots; at the default pitch of 0.125 mm, squares of 3 × 3 px."""
MOVED_PX = 2
"""How far along u and v a recalibrated bundle's dots are from the known one's, at most."""
GOOD_FRAME_SPANS = (5, 10, 20, 30, 40)
"""Largest differences from the background, in digital numbers, of the frames from which a bundle's validity
limits are set; hardware flags frames with larger differences."""
NUMBERS = {
    "weight_bits": 6,
    "last_weight_bits": 8,
    "activation_bits": 6,
    "gradient_fraction_bits": 8,
    "slope_limit": 1,
    "coefficient_fraction_bits": 10,
    "displacement_bits": 8,
    "kernel_bits": 6,
}


def scene(
    outputs: tuple[str, ...],
    *,
    size: int = 16,
    mode: str = "absolute",
    divergence: str = "central",
    lanes: int = 1,
    channels: str = "bgr",
    kernel_size: int = 3,
    kernel: str = "patch",
    source: str | None = None,
    clamp: bool | None = None,
    solver: str = "dst2d",
    weights: str = "loadable",
    numbers: dict | None = None,
    rounding: str = "nearest",
    bus_errors: str = "flag",
    dots: bool = False,
    band_mm: float | None = None,
    deep_mm: float | tuple[float, ...] | None = None,
    block_px: int = 1,
    bridge_dots: bool = False,
    streams: str = "video",
    part: str = DEFAULT_PART,
    coverage: float | None = None,
    level_light: bool = False,
    smoothing_px: int = 0,
) -> Scene:
    """A curved fingertip of `size` × `size` pixels; short words unless `numbers` says otherwise."""
    if clamp is None:
        clamp = SOLVERS[solver].can_clamp and source != "slopes"
    return Scene.model_validate(
        {
            "name": "random_bundle",
            "outputs": outputs,
            "sensor": {
                "geometry": "fingertip",
                "height_px": size,
                "width_px": size,
                "channels": channels,
                "level_light": level_light,
            }
            | ({"markers": DOTS} if dots or bridge_dots else {}),
            "network": {"bridge_dots": bridge_dots, "smoothing_px": smoothing_px},
            "numbers": (NUMBERS if numbers is None else numbers) | {"rounding": rounding},
            "poisson": {"mode": mode, "divergence": divergence, "solver": solver},
            "force": {
                "source": source,
                "kernel": kernel,
                "kernel_size": kernel_size,
                "clamp": clamp,
                "max_displacement_mm": 0.01,
                "dots": dots,
                "coverage": coverage,
                "block_px": block_px,
            }
            | ({"band_mm": band_mm, "deep_mm": deep_mm, "fit": "weights"} if band_mm else {}),
            "slip": {"contact_mm": 0.001, "limit_px": 0.04},
            "hardware": {
                "pixels_per_clock": lanes,
                "weights": weights,
                "bus_errors": bus_errors,
                "streams": streams,
                "part": part,
            },
        }
    )


def painted_dots(background: np.ndarray, sensor: Sensor) -> DotFollower:
    """Darken squares on a grid in a background (H, W, C) uint8, in place; returns what follows them."""
    height, width, channels = background.shape
    spacing = round(sensor.markers.spacing_mm / sensor.pitch_mm)
    side = round(sensor.markers.radius_mm / sensor.pitch_mm)
    rows, columns = (np.arange(length)[spacing // 2 :: spacing] for length in (height, width))
    places = np.array([(u, v) for v in rows for u in columns])
    for u, v in places:
        background[v - side : v + side + 1, u - side : u + side + 1] //= 8
    threshold = np.full((height // BLOCK, width // BLOCK), 60 * channels)
    windows = DotWindows(threshold, channels, expected_follower(sensor).windows.half)
    return at_rest(windows, background, places, spacing_px=spacing, reach=1)


def random_bundle(folder: Path, scene: Scene, *, hidden: tuple[int, ...] = (4,), seed: int = 1) -> Bundle:
    """Save and return a bundle in `folder`, with random tables for every stage that `scene` wants.

    hidden : neurons of each hidden layer of the pixel network
    """
    rng = np.random.default_rng(seed)
    sensor = scene.sensor
    size = sensor.width_px
    background = rng.integers(80, 170, (size, size, len(sensor.channel_names))).astype(np.uint8)
    bridge = follower = None
    if sensor.markers is not None:
        follower = painted_dots(background, sensor)
        bridge = SlopeBridge(follower.windows, bridge_reach(sensor))
    x = np.linspace(-1, 1, size)
    pipeline = assemble(
        scene,
        layers=layers(network_bits(scene.numbers), background, rng, hidden),
        background=background,
        rest_depth_mm=size / 40 * (2 - x**2 - x[:, None] ** 2),
        bridge=bridge if scene.wants_bridge else None,
        follower=follower if scene.wants_dots else None,
    )
    if scene.wants_force:
        pipeline = with_force(pipeline, *force_weights(scene, rng, follower))
    if scene.wants_interval:
        pipeline = pipeline.replace(interval=force_interval(pipeline, rng))
    return bundle.save(folder, with_limits(pipeline, frames(background, GOOD_FRAME_SPANS)), {})


def brighter(stage):
    """A stage of dots with other thresholds of darkness, or None."""
    if stage is None:
        return None
    threshold = (
        stage.windows.threshold
        + 1
        + np.arange(stage.windows.threshold.size).reshape(stage.windows.threshold.shape) % 9
    )
    return replace(stage, windows=replace(stage.windows, threshold=threshold))


def remounted(follower: DotFollower, rng: np.random.Generator, spacing_px: float) -> DotFollower:
    """The follower after its dots moved by up to MOVED_PX each along u and v, in the order of their new rows
    and with other limits of what is a dot."""
    most = MOVED_PX << FRACTION
    rest = follower.rest + rng.integers(-most, most + 1, follower.rest.shape)
    order = np.lexsort((rest[:, 0], rest[:, 1]))
    rest = rest[order]
    guides = guides_of(rest * 2.0**-FRACTION, spacing_px)
    low, high = np.maximum(follower.low[order] * 3 // 4, 1), follower.high[order] * 5 // 4
    return replace(follower, rest=rest, guides=guides, low=low, high=high)


def other_widths(interval: ForceInterval, rng: np.random.Generator) -> ForceInterval:
    """An interval of the same measures in the same words with another base and other weights."""
    base = rng.integers(0, 1 << BASE_BITS, interval.base.shape)
    return replace(interval, base=base, weights=rng.integers(0, 1 << WEIGHT_BITS, interval.weights.shape))


def recalibrated(folder: Path, known: Bundle, *, seed: int = 2) -> Bundle:
    """Save and return a copy of the bundle `known` with another random network and tighter validity limits.

    The tables that follow from the network change with it, dots have moved, and the skin is brighter between
    them; everything else stays the same, as after a calibration of the sensor.
    """
    old, sensor = known.pipeline, known.scene.sensor
    stages = {name: brighter(getattr(old, name)) for name in ("bridge", "follower")}
    if old.follower is not None:
        spacing_px = sensor.markers.spacing_mm / sensor.pitch_mm
        stages["follower"] = remounted(stages["follower"], np.random.default_rng(seed), spacing_px)
    pipeline = assemble(
        old.scene,
        layers=layers(
            network_bits(old.scene.numbers), old.background, np.random.default_rng(seed), old.hidden
        ),
        background=old.background,
        rest_depth_mm=old.rest_depth_mm,
        **stages,
    )
    pipeline = with_limits(with_force_of(pipeline, old), frames(old.background, GOOD_FRAME_SPANS[:2]))
    if old.interval is not None:
        pipeline = pipeline.replace(interval=other_widths(old.interval, np.random.default_rng(seed)))
    return bundle.save(folder, pipeline, {})
