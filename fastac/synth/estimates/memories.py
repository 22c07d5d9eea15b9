# amaranth: UnusedElaboratable=no
"""The memories of a pipeline's hardware that are deep enough for block RAM, and the blocks that hold them."""

from collections.abc import Iterable, Iterator

import numpy as np

from fastac.gateware.dots.dot_stream import DotStream
from fastac.gateware.dots.follower import dot_layout
from fastac.gateware.force.block_address import BlockAddress
from fastac.gateware.force.weighted_sum import rom_table, rom_width
from fastac.gateware.network.feature_smoothing import DISTRIBUTED_BEATS
from fastac.gateware.slip.rigid_sums import KEPT_FRAMES
from fastac.models.integer.features import WIDTH
from fastac.models.integer.force import PatchForce, WeightedSum
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.words import signed_width
from fastac.scenes.schema import Scene
from fastac.synth.estimates import folded
from fastac.synth.estimates.solvers import SOLVERS
from fastac.synth.estimates.work import Frame

BLOCK_SHAPES = ((72, 512, 1), (36, 1024, 1), (18, 2048, 1), (9, 4096, 1), (4, 8192, 1), (2, 16384, 1))
HALF_SHAPES = ((36, 512, 0.5), (18, 1024, 0.5), (9, 2048, 0.5), (4, 4096, 0.5), (2, 8192, 0.5))
"""Bits and words of a RAMB36E2, and of a RAMB18E2, which is half of one (Xilinx UG573); those of the 7 series
have the same (UG473)."""


def blocks(width: int, depth: int) -> float:
    """RAMB36 that hold `depth` words of `width` bits, in the narrowest shape that needs the fewest."""
    return min(
        -(-width // bits) * -(-depth // words) * size for bits, words, size in BLOCK_SHAPES + HALF_SHAPES
    )


def kernel_memory(scene: Scene) -> Iterator[tuple[str, int, int, int]]:
    """As `memories`, of a force's kernels at every pixel, if the scene has them."""
    if scene.force_from_displacement and scene.force.kernel == "patch":
        lanes, size = scene.lanes, scene.inner_px
        words = len(scene.force_axes) * scene.force.kernel_size**2
        yield "force", 1, lanes * words * scene.numbers.kernel_bits, size * -(-size // lanes)


def block_rams(found: Iterable[tuple[str, int, int, int]]) -> dict[str, float]:
    """RAMB36 by stage that hold such `memories`."""
    needed: dict[str, float] = {}
    for stage, number, width, depth in found:
        needed[stage] = needed.get(stage, 0.0) + number * blocks(width, depth)
    return needed


def memories(pipeline: IntegerPipeline) -> Iterator[tuple[str, int, int, int]]:
    """(stage, number, bits of a word, words) of the memories that are deep enough for block RAM."""
    scene, frame, solver = pipeline.scene, Frame(pipeline), pipeline.solver
    lanes, beats = frame.lanes, frame.pixels // frame.lanes
    loadable = pipeline.layers[0].loadable
    yield "background", 1, 8 * frame.channels * lanes, beats
    if scene.network.smoothing_px and frame.width // lanes > DISTRIBUTED_BEATS:
        window = scene.network.smoothing_px
        yield "smoothing", 1, window * WIDTH * frame.channels * lanes, frame.width // lanes
    if solver is not None:
        source, difference = pipeline.source, scene.poisson.mode == "difference"
        own = signed_width(int(np.abs(source.offset).max()))
        if frame.deep:
            yield "source", 1, lanes * (source.width if loadable and difference else own), frame.inner_beats
        yield from SOLVERS[scene.poisson.solver].memories(frame, solver)
        half, transforms = (frame.size + 1) // 2, SOLVERS[scene.poisson.solver].transforms(solver)
        if frame.fold > 1:
            yield from folded.transform_memories(transforms, frame.fold)
        else:
            for transform in transforms:
                yield "transforms", 1, lanes * half * transform.coefficient_width, frame.row_beats
        rest = signed_width(int(np.abs(pipeline.depth.rest).max()))
        if "depth" in scene.outputs and difference and rest > 1:
            yield "depth", 1, lanes * rest, frame.inner_beats
        if scene.force_from_displacement and not difference:
            yield "depth", 1, lanes * (pipeline.depth.width if loadable else rest), frame.inner_beats
    if scene.wants_dots:
        yield from dot_memories(pipeline)
    force = pipeline.force
    yield from kernel_memory(scene)
    if force is not None and not isinstance(force, PatchForce):
        yield weight_memory(force, lanes, () if frame.fold > 1 else pipeline.bends, folded=frame.fold > 1)


def weight_memory(
    force: WeightedSum, lanes: int, bends: tuple[int, ...], *, folded: bool
) -> tuple[str, int, int, int]:
    """As `memories`, of the weights of a sum; in a folded one, or of squares of pixels, each has the bits
    that its own values need."""
    table, squares = rom_table(force, bends), max(lanes // force.block_px, 1)
    if folded or force.block_px > 1:
        bits = sum(signed_width(int(bound)) for bound in np.abs(table).max(axis=(1, 2)).ravel())
    else:
        bits = table.shape[0] * table.shape[3] * rom_width(force, bends)
    return "force", 1, squares * bits, BlockAddress.of(force, lanes).words


def dot_memories(pipeline: IntegerPipeline) -> Iterator[tuple[str, int, int, int]]:
    """As `memories`, of what follows the dots: rows of windows, weights and, for slip, the shifts kept."""
    stream = DotStream(pipeline.follower, lanes=pipeline.scene.lanes, fold=pipeline.scene.fold).dots
    window = stream.i.payload.shape().size
    yield "dots", 1, window, stream.kept_rows << (stream.row_beats - 1).bit_length()
    axes, count, _, terms = pipeline.dot_force.weighted.weight.shape
    yield "dots", 1, axes * terms * pipeline.dot_force.weighted.weight_width, count
    if pipeline.spread is not None:
        yield "slip", 1, dot_layout(pipeline.follower).size, KEPT_FRAMES << (count - 1).bit_length()
