"""What the Poisson solver of sine transforms and recurrences takes: energy, memories, look-up tables."""

from collections.abc import Iterator
from typing import ClassVar

from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.tridiagonal import Recurrence, TridiagonalSolver
from fastac.models.integer.words import NEAREST
from fastac.synth.estimates.work import Frame, Work, addition, memory, multiplication


def recurrence_works(frame: Frame, recurrence: Recurrence) -> Iterator[Work]:
    words = int((recurrence.varying + 1).sum())
    yield memory(2 * frame.inner_beats, frame.lanes * recurrence.output_width, frame.row_beats)
    yield memory(frame.inner, recurrence.shift, -(-words // frame.lanes))
    operand = recurrence.output_width
    if recurrence.downwards:
        operand = max(recurrence.input_width, operand) + 1
        yield addition(frame.inner, operand)
    yield multiplication(frame.inner, operand, recurrence.shift + 1)
    # Elimination's sum only rounds; substitution's adds what is known of the row, too.
    if recurrence.rounding == NEAREST or not recurrence.downwards:
        yield addition(frame.inner, operand + recurrence.shift)


def reversal_works(frame: Frame, width: int) -> Iterator[Work]:
    yield memory(2 * frame.inner_beats, frame.lanes * width, frame.inner_beats)


class TridiagonalCosts:
    """See fastac/synth/estimates/solvers.py."""

    instances: ClassVar = {
        "elimination": "recurrences",
        "substitution": "recurrences",
        "reversal": "reversal",
    }

    @staticmethod
    def transforms(solver: TridiagonalSolver) -> list[SineTransform]:
        return [solver.row_forward, solver.row_inverse]

    @staticmethod
    def works(frame: Frame, solver: TridiagonalSolver) -> dict[str, Iterator[Work]]:
        return {
            "elimination": recurrence_works(frame, solver.elimination),
            "reversal": reversal_works(frame, solver.elimination.output_width),
            "substitution": recurrence_works(frame, solver.substitution),
        }

    @staticmethod
    def memories(frame: Frame, solver: TridiagonalSolver) -> Iterator[tuple[str, int, int, int]]:
        lanes = frame.lanes
        yield "reversal", 1, lanes * solver.elimination.output_width, frame.inner_beats
        for recurrence in (solver.elimination, solver.substitution):
            words = int((recurrence.varying + 1).sum())
            yield "recurrences", lanes, recurrence.shift, -(-words // lanes)

    @staticmethod
    def features(frame: Frame, solver: TridiagonalSolver) -> dict[str, dict[str, float]]:
        both = (solver.elimination, solver.substitution)
        bits = sum(recurrence.output_width + recurrence.shift for recurrence in both)
        return {
            "recurrences": {"one": 1, "bits": frame.lanes * bits},
            "reversal": {"one": 1, "bits": frame.lanes * solver.elimination.output_width},
        }
