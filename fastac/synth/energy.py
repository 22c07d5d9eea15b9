"""An estimate of the energy of a frame, from what the design computes, stores and reads for it.

Operations and memory accesses are counted from the pipeline's tables; no hardware is elaborated. Each has the
energy that Horowitz, "Computing's energy problem", ISSCC 2014, gives for 45 nm, carried to its own word
lengths. The formulas meet his figures: 8 and 32 bits for additions (0.03 and 0.1 pJ) and multiplications
(0.2 and 3.1 pJ), and 64-bit reads of 8 and 32 KB of SRAM (10 and 20 pJ), 1024 and 4096 words deep; a register
is furthest from them. They are figures of standard cells: the wires and switches of an FPGA take more, its
16 nm less. The estimate compares designs and stages; it is no measurement.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fastac.gateware.arithmetic.packed_products import best_packing
from fastac.gateware.arithmetic.shift_add import canonical_signed_digits
from fastac.models.integer.dst2d import EigenvalueDivision
from fastac.models.integer.features import WIDTH
from fastac.models.integer.force import PatchForce, WeightedSum
from fastac.models.integer.network import Layer
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.tridiagonal import Elimination, Recurrence
from fastac.models.integer.words import FLOOR, NEAREST, signed_width

MANTISSA_BITS = MULTIPLIER_BITS = 17
ORIGIN = (
    "estimated: operations of the design × energies at 45 nm after Horowitz, ISSCC 2014: multiplication of"
    " a×b bits 0.2·(ab/64)^0.989 pJ; addition of b bits 0.03 + 0.07·(b − 8)/24 pJ; access to w bits of a"
    " memory d words deep 10·(w/64)·sqrt(d/1024) pJ; each result is written to a register and read from it,"
    " at the energy of a memory one word deep; off-chip, static, clock-tree and control energy excluded"
)


@dataclass(frozen=True)
class Work:
    """`count` operations of a frame, `pj` each.

    kind : "multiplication", "addition", "register" or "memory"; bits : of the result or of the accessed word
    """

    kind: str
    count: int
    bits: int
    pj: float

    @property
    def total_pj(self) -> float:
        return self.count * self.pj


def multiplication(count: int, a: int, b: int) -> Work:
    exponent = math.log(3.1 / 0.2) / math.log(32 * 32 / (8 * 8))
    return Work("multiplication", count, a + b, 0.2 * (a * b / 64) ** exponent)


def addition(count: int, bits: int) -> Work:
    return Work("addition", count, bits, 0.03 + (0.1 - 0.03) * (bits - 8) / (32 - 8))


def memory(accesses: int, bits: int, depth: int) -> Work:
    """Reads or writes of words of `bits` in a memory of `depth` words: 64-bit memories side by side."""
    return Work("memory", accesses, bits, 10 * bits / 64 * math.sqrt(depth / 1024))


def register(count: int, bits: int) -> Work:
    """Words written once and read once."""
    return Work("register", count, bits, 2 * memory(1, bits, 1).pj)


class Frame:
    """The sizes that every count follows from: image, inner region, lanes."""

    def __init__(self, pipeline: IntegerPipeline):
        scene = pipeline.scene
        self.height, self.width, self.channels = pipeline.background.shape
        self.lanes = scene.hardware.pixels_per_clock
        self.pixels = self.height * self.width
        self.size = self.width - 2
        self.inner = self.size**2
        self.row_beats = -(-self.size // self.lanes)
        self.inner_beats = self.size * self.row_beats

    def background(self) -> Iterator[Work]:
        beats = self.pixels // self.lanes
        yield memory(beats, 8 * self.channels * self.lanes, beats)
        yield memory(beats, WIDTH * self.lanes, self.width // self.lanes)  # coordinates of the columns
        yield memory(beats, WIDTH, self.height)
        yield addition(self.pixels * self.channels, WIDTH)

    def layer(self, layer: Layer, input_width: int) -> Iterator[Work]:
        """A layer of the pixel network; `input_width` of an input with its sign. Weights are registers or
        constants, so none are read from a memory."""
        pixels, (neurons, inputs) = self.pixels, layer.weight.shape
        width = layer.accumulator_width
        if not layer.loadable:
            digits = [sum(len(canonical_signed_digits(w)) for w in row) for row in layer.weight.tolist()]
            yield addition(pixels * sum(digits), width)  # those of a neuron, and its bias, less one
        else:
            pack = best_packing(layer.weight_limit, layer.input_limit, input_width)
            pairs = neurons // 2 if pack else 0
            single = neurons - 2 * pairs
            if pairs:
                groups = -(-inputs // (1 << pack.levels))
                yield multiplication(pixels * pairs * inputs, pack.width, input_width)
                yield addition(pixels * pairs * (inputs - groups), pack.width + input_width)
                yield addition(pixels * pairs * 2 * (2 * groups - 1), width)  # to split, and to sum on
            if single:
                yield multiplication(pixels * single * inputs, layer.weight_bits, input_width)
                yield addition(pixels * single * inputs, width)
        scale = layer.requantisation
        if scale is None:
            return
        if layer.loadable:
            yield multiplication(pixels * neurons, width, MULTIPLIER_BITS)
        else:
            digits = [len(canonical_signed_digits(m)) - 1 for m in scale.multiplier.tolist()]
            yield addition(pixels * sum(digits), width + MULTIPLIER_BITS)

    def normals(self, layers: tuple[Layer, ...]) -> Iterator[Work]:
        input_width = WIDTH
        for layer in layers:
            yield from self.layer(layer, input_width)
            if layer.requantisation is not None:
                input_width = layer.requantisation.bits + 1

    def gradients(self, ratio) -> Iterator[Work]:
        """Restoring division: two magnitudes, a subtraction for each bit of a quotient, two roundings."""
        yield addition(2 * self.pixels * (1 + ratio.width), ratio.normal_width)
        yield addition(2 * self.pixels, ratio.width)

    def source(self, source) -> Iterator[Work]:
        words = 3 if source.divergence == "central" else 1  # of a column in the row buffer
        beats = self.pixels // self.lanes
        yield memory(2 * beats, words * self.lanes * source.gradient_width, self.width // self.lanes)
        yield addition(self.inner * source.terms, source.width)
        offset = signed_width(int(np.abs(source.offset).max()))
        yield memory(self.inner_beats, self.lanes * offset, self.inner_beats)

    def transform(self, transform: SineTransform) -> Iterator[Work]:
        """Rows collected and held, folded, and for each value half a row of products summed."""
        half, width = (self.size + 1) // 2, transform.input_width
        shifted = self.row_beats * (self.row_beats - 1) * self.lanes
        yield register(self.size * (shifted + self.size), width)
        # A single lane folds anew for each value, odd and even in turn; several keep both kinds for a row.
        yield addition(self.size * half * (self.size if self.lanes == 1 else 2), width + 1)
        yield memory(self.inner_beats, self.lanes * half * transform.coefficient_width, self.row_beats)
        yield multiplication(self.inner * half, width + 1, transform.coefficient_width)
        addends = half - (transform.rounding == FLOOR)  # the products and, to round, a half unit
        yield addition(self.inner * addends, transform.accumulator_width)

    def transposition(self, width: int) -> Iterator[Work]:
        banks = 2 * self.inner_beats * self.lanes  # written and read
        yield memory(banks, width, 2 * self.row_beats**2 * self.lanes)

    def division(self, division: EigenvalueDivision) -> Iterator[Work]:
        distance = int(division.shift.max() - division.shift.min()).bit_length()
        yield memory(self.inner_beats, self.lanes * (MANTISSA_BITS + distance), self.inner_beats)
        yield multiplication(self.inner, division.input_width, MANTISSA_BITS)
        if division.rounding == NEAREST:
            yield addition(self.inner, division.output_width)

    def recurrence(self, recurrence: Recurrence) -> Iterator[Work]:
        words = int((recurrence.varying + 1).sum())
        yield memory(2 * self.inner_beats, self.lanes * recurrence.output_width, self.row_beats)
        yield memory(self.inner, recurrence.shift, -(-words // self.lanes))
        operand = recurrence.output_width
        if isinstance(recurrence, Elimination):
            operand = max(recurrence.input_width, operand) + 1
            yield addition(self.inner, operand)
        yield multiplication(self.inner, operand, recurrence.shift + 1)
        # Elimination's sum only rounds; substitution's adds what is known of the row, too.
        if recurrence.rounding == NEAREST or not isinstance(recurrence, Elimination):
            yield addition(self.inner, operand + recurrence.shift)

    def reversal(self, width: int) -> Iterator[Work]:
        yield memory(2 * self.inner_beats, self.lanes * width, self.inner_beats)

    def rest(self, depth) -> Iterator[Work]:
        """The sum with, or the difference from, the depth at rest."""
        width = signed_width(int(np.abs(depth.rest).max()))
        yield memory(self.inner_beats, self.lanes * width, self.inner_beats)
        yield addition(self.inner, depth.width)

    def displacement(self, pipeline: IntegerPipeline) -> Iterator[Work]:
        depth = pipeline.depth
        if depth.mode == "absolute":
            yield from self.rest(depth)
        else:
            yield addition(self.inner, depth.width)  # the sign
        yield addition(self.inner, depth.width)  # rounding

    def patch_force(self, force: PatchForce) -> Iterator[Work]:
        axes, words = len(force.kernel), force.size**2
        bits = force.displacement_bits
        if force.size > 1:
            row_words = self.lanes * (force.size - 1)
            yield memory(2 * self.inner_beats, row_words * bits, self.row_beats)
        yield memory(self.inner_beats, self.lanes * axes * words * force.kernel_bits, self.inner_beats)
        yield multiplication(self.inner * axes * words, bits + (not force.signed), force.kernel_bits)
        yield addition(self.inner * axes * (words - 1), force.pixel_width)
        yield addition(self.inner * axes, force.width)

    def weighted_force(self, force: WeightedSum) -> Iterator[Work]:
        axes, rows, columns, terms = force.weight.shape
        beats, values = rows * -(-columns // self.lanes), rows * columns * terms
        yield memory(beats, self.lanes * axes * terms * force.weight_width, beats)
        yield multiplication(values * axes, force.input_width + (not force.input_signed), force.weight_width)
        yield addition(values * axes, force.width)


def with_registers(works: list[Work]) -> list[Work]:
    """And a register for each result."""
    results = [w for w in works if w.kind in ("multiplication", "addition")]
    return works + [register(w.count, w.bits) for w in results]


def works(pipeline: IntegerPipeline) -> dict[str, list[Work]]:
    """What a frame takes, stage by stage; only the stages that the scene wants."""
    frame, scene, solver = Frame(pipeline), pipeline.scene, pipeline.solver
    stages = {"background": frame.background(), "normals": frame.normals(pipeline.layers)}
    if scene.wants_slopes:
        stages["gradients"] = frame.gradients(pipeline.ratio)
    if scene.wants_solver:
        stages["source"] = frame.source(pipeline.source)
        stages["row_forward"] = frame.transform(solver.row_forward)
        if scene.poisson.solver == "tridiagonal":
            stages["elimination"] = frame.recurrence(solver.elimination)
            stages["reversal"] = frame.reversal(solver.elimination.output_width)
            stages["substitution"] = frame.recurrence(solver.substitution)
        else:
            stages["to_columns"] = frame.transposition(solver.row_forward.output_width)
            stages["column_forward"] = frame.transform(solver.column_forward)
            stages["division"] = frame.division(solver.division)
            stages["column_inverse"] = frame.transform(solver.column_inverse)
            stages["to_rows"] = frame.transposition(solver.column_inverse.output_width)
        stages["row_inverse"] = frame.transform(solver.row_inverse)
        if "depth" in scene.outputs and pipeline.depth.mode == "difference":
            stages["depth"] = frame.rest(pipeline.depth)
        if scene.wants_force:
            stages["displacement"] = frame.displacement(pipeline)
    if isinstance(pipeline.force, PatchForce):
        stages["force"] = frame.patch_force(pipeline.force)
    elif pipeline.force is not None:
        stages["force"] = frame.weighted_force(pipeline.force)
    return {name: with_registers(list(stage)) for name, stage in stages.items()}


def estimate(pipeline: IntegerPipeline) -> dict:
    """The report's keys: µJ of a frame in all, by stage, and by kind of operation."""
    found = works(pipeline)
    everything = [w for stage in found.values() for w in stage]

    def uj(chosen: list[Work]) -> float:
        return sum(w.total_pj for w in chosen) * 1e-6

    kinds = sorted({w.kind for w in everything})
    return {
        "energy_estimate_uj_per_frame": {"value": uj(everything), "origin": ORIGIN},
        "energy_estimate_uj_per_frame_by_stage": {
            "value": {name: uj(stage) for name, stage in found.items()},
            "origin": "estimated: as energy_estimate_uj_per_frame",
        },
        "energy_estimate_uj_per_frame_by_kind": {
            "value": {kind: uj([w for w in everything if w.kind == kind]) for kind in kinds},
            "origin": "estimated: as energy_estimate_uj_per_frame",
        },
    }
