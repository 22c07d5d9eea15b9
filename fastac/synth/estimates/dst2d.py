"""What the Poisson solver of two sine transforms and a division takes: energy, memories, look-up tables."""

from collections.abc import Iterator
from typing import ClassVar

from fastac.models.integer.dst2d import MANTISSA_BITS, EigenvalueDivision, Solver
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.words import NEAREST
from fastac.synth.estimates.work import Frame, Work, addition, memory, multiplication, transform_works


def transposition_works(frame: Frame, width: int) -> Iterator[Work]:
    banks = 2 * frame.inner_beats * frame.lanes  # written and read
    yield memory(banks, width, 2 * frame.row_beats**2 * frame.lanes)


def division_works(frame: Frame, division: EigenvalueDivision) -> Iterator[Work]:
    bits = MANTISSA_BITS + distance_bits(division)
    yield memory(frame.inner_beats, frame.lanes * bits, frame.inner_beats)
    yield multiplication(frame.inner, division.input_width, MANTISSA_BITS)
    if division.rounding == NEAREST:
        yield addition(frame.inner, division.output_width)


def distance_bits(division: EigenvalueDivision) -> int:
    """Bits that tell the shifts apart."""
    return int(division.shift.max() - division.shift.min()).bit_length()


class Dst2dCosts:
    """See fastac/synth/estimates/solvers.py."""

    instances: ClassVar = {
        "column_forward": "transforms",
        "column_inverse": "transforms",
        "to_columns": "transposition",
        "to_rows": "transposition",
        "division": "division",
    }

    @staticmethod
    def transforms(solver: Solver) -> list[SineTransform]:
        return [solver.row_forward, solver.row_inverse, solver.column_forward, solver.column_inverse]

    @staticmethod
    def works(frame: Frame, solver: Solver) -> dict[str, Iterator[Work]]:
        return {
            "to_columns": transposition_works(frame, solver.row_forward.output_width),
            "column_forward": transform_works(frame, solver.column_forward),
            "division": division_works(frame, solver.division),
            "column_inverse": transform_works(frame, solver.column_inverse),
            "to_rows": transposition_works(frame, solver.column_inverse.output_width),
        }

    @staticmethod
    def memories(frame: Frame, solver: Solver) -> Iterator[tuple[str, int, int, int]]:
        lanes, folded = frame.lanes, frame.fold > 1
        for transform in (solver.row_forward, solver.column_inverse):
            # Folded, a frame takes the place of the one before it, word by word.
            words = frame.inner if folded else 2 * frame.row_beats**2 * lanes
            yield "transposition", lanes, transform.output_width, words
        if frame.deep:
            # Folded, of the symmetric table only one half.
            words = frame.size * (frame.size + 1) // 2 if folded else frame.inner_beats
            yield "division", 1, lanes * (MANTISSA_BITS + distance_bits(solver.division)), words

    @staticmethod
    def features(frame: Frame, solver: Solver) -> dict[str, dict[str, float]]:
        lanes = frame.lanes
        width = solver.row_forward.output_width + solver.column_inverse.output_width
        shifted = solver.division.product_width * distance_bits(solver.division)
        return {
            "transposition": {"one": 1, "bits": lanes * lanes * width},
            "division": {"one": 1, "bits": lanes * shifted},
        }
