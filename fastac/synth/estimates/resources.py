# amaranth: UnusedElaboratable=no
"""Look-up tables, block RAM and DSP slices of a pipeline's hardware, estimated without elaborating it.

Each stage's look-up tables are a sum of a few counts that follow from its words, such as the bits of its
adders, with non-negative factors. The factors are fitted to designs that Yosys has counted, and kept with the
counts (`resource_samples.py`, `resource_fit.py`, `resource_samples.json`). Block RAM follows from the words
of the memories (`memories.py`) in the same way; DSP slices are the products of the architecture.
"""

import json
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from fastac.gateware.cycle_model import multipliers
from fastac.gateware.force.bent_product import offset_adders
from fastac.gateware.force.weighted_sum import rom_width
from fastac.gateware.network.feature_smoothing import DISTRIBUTED_BEATS
from fastac.gateware.raster_outputs import scene_outputs
from fastac.gateware.target.device import device_of
from fastac.models.integer import smoothing
from fastac.models.integer.dot_windows import CELL
from fastac.models.integer.features import WIDTH
from fastac.models.integer.force import PatchForce, WeightedSum
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.words import signed_width
from fastac.scenes.schema import Scene
from fastac.synth.estimates import folded
from fastac.synth.estimates.energy import normals_works
from fastac.synth.estimates.memories import block_rams, memories
from fastac.synth.estimates.solvers import SOLVERS
from fastac.synth.estimates.work import Frame, Work

SAMPLES = Path(__file__).with_name("resource_samples.json")
FOLDED_SAMPLES = SAMPLES.with_name("folded_samples.json")
COUNTED = ("lut", "ramb36", "dsp48e2")
FITTED = ("lut", "ramb36")
PACKET_LUTS = {
    "one": 355,
    "axes": 80,
    "images": 607,
    "image_axes": 40,
    "queue_lanes": 58,
    "early_images": 140,
}
"""Look-up tables that `hardware.streams = "packets"` adds to the registers and in place of video's ports, by
what they are counted for: the design; axes of the force; images that wait for their record, and the axes and
lanes of each (one lane needs no queue); images that are sent before. Yosys counts 1,083, 1,317 and 1,560 in
three designs (depth and F_z at 1 and 4 lanes; normals, depth and three axes at 2): the sums are 1,082, 1,314
and 1,578. Not fitted with the stages, as no sample has packets."""
INTERVAL_LUTS = {"one": 138, "magnitude_bits": 3, "axes": 46, "loadable": 58}
"""Look-up tables of the interval around a force and of its registers: of a design, of each bit of the
measures that wait in queues, of each axis, and of weights that can be loaded. Yosys counts 545 and 601 in the
component alone of one and two axes with baked weights, 728 of three axes with loadable ones, and in the last
32 more in the registers of each axis and 11 in the loader: the sums are 577, 665 and 835. Not fitted with the
stages, as no sample has an interval."""
SMOOTHING_LUTS = {"one": 74, "adder_bits": 0.74, "choice_bits": 1.17, "row_luts": 1, "code_bits": 0.024}
"""Look-up tables of the mean of ΔI over a window: of the design; of each bit of its adders, and of the
choices of what lies beyond the image; those that hold rows; of each bit of the coordinates' codes, where the
image has no power of two of them. Yosys counts 316 to 5,551 in the component alone, in 30 designs with
windows of 2 to 8 pixels, 3 and 4 channels, 1 to 4 lanes and 32 to 640 pixels a row, from which the sums
differ by up to 9%. Not fitted with the stages, as no sample has it."""
RAM_BITS = {32: 14, 64: 7}
"""Bits of a word in 8 look-up tables, by the words that they hold (RAM32M16, RAM64M8)."""
RAM_LUTS = 8
DSP48E1_ORIGIN = (
    "estimated: products of the architecture (gateware/cycle_model.py), two where they are packed, each of as"
    " many DSP48E1 as its operands take on 25 × 18 bits; tests compare small designs with Yosys's counts"
)


def _bits(works: list[Work], kind: str, frame: Frame) -> float:
    """Bits of all operations of a kind that a clock needs, of work that runs over a frame's pixels."""
    return sum(w.count * w.bits for w in works if w.kind == kind) * frame.lanes / frame.pixels


def features(pipeline: IntegerPipeline) -> dict[str, dict[str, float]]:
    """By stage, the counts that its look-up tables and block RAM are fitted to."""
    scene, frame, solver = pipeline.scene, Frame(pipeline), pipeline.solver
    lanes = frame.lanes
    normals, words = list(normals_works(frame, pipeline.layers)), 0
    loadable = pipeline.layers[0].loadable
    if loadable:
        words = sum(layer.weight.size * layer.weight_bits for layer in pipeline.layers)
    found = {
        "control": {"one": 1, "lanes": lanes, "loadable_bits": words},
        "background": {
            "one": 1,
            "bits": lanes * frame.channels * 9,
            "level_channels": frame.channels * scene.sensor.level_light,
            "level_bits": lanes * frame.channels * 8 * scene.sensor.level_light,
        },
        "normals": {
            "adder_bits": _bits(normals, "addition", frame) * loadable,
            "baked_bits": _bits(normals, "addition", frame) * (not loadable),
            "product_bits": _bits(normals, "multiplication", frame),
            # Of baked weights, what clips an activation is little beside the additions of its scale.
            "activation_bits": loadable
            * lanes
            * sum(len(a.weight) * a.requantisation.bits for a, _ in pairwise(pipeline.layers)),
        },
    }
    if scene.wants_slopes:
        ratio = pipeline.ratio
        found["gradients"] = {"bits": lanes * 2 * ratio.width * (ratio.normal_width - 1)}
    if solver is not None:
        half, source = (frame.size + 1) // 2, pipeline.source
        found["source"] = {"one": 1, "bits": lanes * source.terms * source.width}
        costs = SOLVERS[scene.poisson.solver]
        transforms = costs.transforms(solver)
        found |= costs.features(frame, solver)
        folds = sum(half * (t.input_width + 1) for t in transforms)
        found["transforms"] = {
            # A single lane adds and subtracts in turn; several have halves of either kind.
            "alternating_bits": folds if lanes == 1 else 0,
            "fold_bits": 0 if lanes == 1 else 2 * folds,
            "tree_bits": sum(lanes * half * (t.input_width + t.coefficient_width) for t in transforms),
        }
        found["depth"] = {"one": 1, "bits": lanes * pipeline.depth.width}
    force = pipeline.force
    if isinstance(force, PatchForce):
        axes, patch = len(force.kernel), force.size**2
        found["force"] = {
            "one": 1,
            "patch_bits": lanes * patch * force.displacement_bits,
            "tree_bits": lanes * axes * patch * force.pixel_width,
        }
    elif force is not None:
        axes, _, _, terms = force.weight.shape
        if pipeline.bends:
            bits = bent_bits(force, pipeline.bends)
        else:
            bits = terms * (force.input_width + force.weight_width)
        found["force"] = {"one": 1, "patch_bits": 0, "tree_bits": lanes * axes * bits}
    if scene.wants_bridge:
        reached = 2 * pipeline.bridge.reach * pipeline.ratio.width
        found["bridge"] = {"one": 1, "choice_bits": lanes * 2 * reached}
    if scene.wants_darkness:
        found["dots"] = {"one": 1, "pixel_bits": lanes * frame.channels * 8, "window_bits": 0, "sum_bits": 0}
    if scene.wants_dots:
        windows, weighted = pipeline.follower.windows, pipeline.dot_force.weighted
        words = windows.mass_width + 2 * windows.moment_width
        found["dots"]["window_bits"] = max(1, lanes // CELL) * 2 * (2 * windows.half + 1) * words
        axes, _, _, terms = weighted.weight.shape
        found["dots"]["sum_bits"] = axes * terms * (weighted.input_width + weighted.weight_width)
    if scene.wants_slip:
        bounds, count = pipeline.spread.bounds, len(pipeline.follower.rest)
        ratio = sum(times * bounds[name].bit_length() for name, times in (("A", 1), ("B", 2), ("C", 2)))
        found["slip"] = {"one": 1, "ratio_bits": ratio, "dots": count}
    if scene.network.smoothing_px:
        found["smoothing"] = smoothing_features(scene)
    if pipeline.interval is not None:
        interval, queued = pipeline.interval, len(pipeline.interval.pixel_measures)
        counts = (1, sum(interval.magnitude_widths[:queued]), len(interval.base), loadable)
        found["interval"] = dict(zip(INTERVAL_LUTS, map(int, counts), strict=True))
    if scene.hardware.streams == "packets":
        found["packets"] = packet_features(scene)
    if frame.fold > 1:
        found |= folded.features(pipeline, costs.transforms(solver) if solver is not None else [])
    needed = block_rams(memories(pipeline))
    for stage, values in found.items():
        values["ramb36"] = needed.get(stage, 0.0)
    return found


def bent_bits(force: WeightedSum, bends: tuple[int, ...]) -> int:
    """Bits of the adders for a pixel and axis of a force that bends: of its product in the tree, and of the
    product's offset."""
    slope_bits = rom_width(force, bends)
    offset = sum(count * bits for count, bits in offset_adders(slope_bits, bends))
    return force.input_width + slope_bits + offset


def packet_features(scene: Scene) -> dict[str, float]:
    """What look-up tables of packets are counted for, in the order of `PACKET_LUTS`."""
    outputs = scene_outputs(scene, rows_reversed=False)
    images, axes = sum(output.complete for output in outputs), len(scene.force_axes)
    lanes = scene.lanes
    queued = lanes if lanes > 1 else 0
    counts = (1, axes, images, images * axes, images * queued, len(outputs) - images)
    return dict(zip(PACKET_LUTS, counts, strict=True))


def smoothing_features(scene: Scene) -> dict[str, float]:
    """What look-up tables of the mean over a window are counted for, in the order of `SMOOTHING_LUTS`."""
    window, lanes, channels = scene.network.smoothing_px, scene.lanes, len(scene.sensor.channel_names)
    width, height, beats = scene.sensor.width_px, scene.sensor.height_px, scene.sensor.width_px // lanes
    half, of_rows = window // 2, 255 * 2 * window
    taps = smoothing.weights(window)
    adder_bits = tree_bits(255 * taps) + tree_bits(of_rows * taps) + WIDTH  # the last to round
    # Rows are chosen in all lanes, columns in those from which the window reaches into another beat.
    reached = sum(not 0 <= lane + k < lanes for lane in range(lanes) for k in range(-half, half + 1))
    choice_bits = lanes * window * WIDTH + reached * signed_width(of_rows)
    row_bits = window * channels * lanes * WIDTH
    row_luts = 0
    if beats <= DISTRIBUTED_BEATS:
        row_luts = RAM_LUTS * -(-row_bits // RAM_BITS[32 if beats <= 32 else 64])
    code_bits = WIDTH * sum(side for side in (width, height) if side & (side - 1))
    counts = (1, channels * lanes * adder_bits, channels * choice_bits, row_luts, code_bits)
    return dict(zip(SMOOTHING_LUTS, counts, strict=True))


def tree_bits(bounds: np.ndarray) -> int:
    """Bits of the adders of an `adder_tree` of terms of at most these magnitudes."""
    bits = 0
    while len(bounds) > 1:
        pairs, bounds = len(bounds) // 2, np.add.reduceat(bounds, np.arange(0, len(bounds), 2))
        bits += sum(signed_width(int(bound)) for bound in bounds[:pairs])
    return bits


def columns(values: dict[str, float], name: str) -> list[float]:
    """What a resource of a stage is a sum of."""
    if name == "ramb36":
        return [values["ramb36"]]
    return [value for key, value in values.items() if key != "ramb36"]


def predict(factors: dict, found: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    """Resources by stage; raises ValueError for a stage that no sample has."""
    for stage in found:
        if stage not in factors:
            raise ValueError(f"stage {stage}: no sample has it")
    return {
        stage: {name: float(np.dot(factors[stage][name], columns(values, name))) for name in FITTED}
        for stage, values in found.items()
    }


@cache
def model(*, is_folded: bool = False) -> tuple[dict, dict[str, str]]:
    """The factors fitted to the committed samples, and each resource's origin with its error.

    is_folded : for designs of less than one pixel a clock, whose folded stages have samples of their own
    """
    content = json.loads(SAMPLES.read_text())
    samples = content["samples"]
    origins = {}
    for name in FITTED:
        errors = np.array(content["left_out_errors_percent"][name])
        origins[name] = (
            f"estimated: sums of adder bits and memories, fitted to Yosys {content['yosys']}'s counts of"
            f" {len(samples)} designs (fastac/synth/estimates/resource_samples.json); leave-one-out error:"
            f" mean {np.abs(errors).mean():.1f}%, largest {np.abs(errors).max():.1f}%"
        )
    products = np.array([100 * (s["dsp48e2"] / max(_counted(s, "dsp48e2"), 1) - 1) for s in samples])
    origins["dsp48e2"] = (
        "estimated: products of the architecture (gateware/cycle_model.py), two where they are packed; of"
        f" Yosys's counts of {len(samples)} designs they differ by {np.abs(products).mean():.1f}% on average,"
        f" {np.abs(products).max():.1f}% at most"
    )
    origins["dsp48e1"] = DSP48E1_ORIGIN
    origins["lut"] += (
        "; what packets add is counted in three designs (PACKET_LUTS), what an interval adds in three"
        " (INTERVAL_LUTS), the mean of ΔI over a window alone in 30 (SMOOTHING_LUTS)"
    )
    packets = {"lut": np.array([*PACKET_LUTS.values()], float), "ramb36": np.ones(1)}
    interval = {"lut": np.array([*INTERVAL_LUTS.values()], float), "ramb36": np.ones(1)}
    means = {"lut": np.array([*SMOOTHING_LUTS.values()], float), "ramb36": np.ones(1)}
    factors = content["factors"] | {"packets": packets, "interval": interval, "smoothing": means}
    if is_folded:
        content = json.loads(FOLDED_SAMPLES.read_text())
        factors |= content["factors"]
        error = np.abs(content["left_out_errors_percent"]["lut"])
        origins["lut"] += (
            f"; folded stages: fitted to Yosys's counts of those of {len(content['samples'])} designs"
            f" (fastac/synth/estimates/folded_samples.json), leave-one-out error: mean {error.mean():.1f}%,"
            f" largest {error.max():.1f}%"
        )
    return factors, origins


def model_of(scene: Scene) -> tuple[dict, dict[str, str]]:
    """`model` for a scene's designs."""
    return model(is_folded=scene.fold > 1)


def _counted(sample: dict, name: str) -> float:
    return sum(stage[name] for stage in sample["counted"].values())


def luts(pipeline: IntegerPipeline) -> dict[str, float]:
    """Estimated look-up tables by stage."""
    factors, _ = model_of(pipeline.scene)
    return {stage: found["lut"] for stage, found in predict(factors, features(pipeline)).items()}


def dsp_slices(pipeline: IntegerPipeline) -> dict[str, int]:
    """DSP slices of the scene's part by module, by formula."""
    return multipliers(pipeline.scene, hidden=pipeline.hidden, solver=pipeline.solver)


def estimate(pipeline: IntegerPipeline) -> dict[str, dict]:
    """lut, ramb36 and the part's DSP slices, dsp48e2 or dsp48e1, as {"value", "origin"}."""
    factors, origins = model_of(pipeline.scene)
    stages = predict(factors, features(pipeline))
    key = device_of(pipeline.scene).dsp_key
    found = {key: sum(dsp_slices(pipeline).values())}
    found["lut"] = round(sum(stage["lut"] for stage in stages.values()))
    found["ramb36"] = round(2 * sum(stage["ramb36"] for stage in stages.values())) / 2
    return {name: {"value": value, "origin": origins[name]} for name, value in found.items()}
