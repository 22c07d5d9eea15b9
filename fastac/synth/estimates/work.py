"""What a frame takes: operations and memory accesses with their energies, and the sizes they follow from.

The energies are those of Horowitz, see fastac/synth/estimates/energy.py.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from fastac.gateware.target.device import device_of
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.words import FLOOR

SHALLOW_WORDS = 256
"""Memories of so few words become distributed RAM, unless they are asked to be blocks."""


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
    """The sizes that every count follows from: image, inner region, lanes, fold, the part's DSP slice."""

    def __init__(self, pipeline: IntegerPipeline):
        scene = pipeline.scene
        self.height, self.width, self.channels = pipeline.background.shape
        self.lanes, self.fold = scene.lanes, scene.fold
        self.dsp = device_of(scene).dsp
        self.pixels = self.height * self.width
        self.size = self.width - 2
        self.inner = self.size**2
        self.row_beats = -(-self.size // self.lanes)
        self.inner_beats = self.size * self.row_beats

    @property
    def deep(self) -> bool:
        """Whether a memory of a word for each beat of the inner region becomes block RAM."""
        return self.inner_beats > SHALLOW_WORDS


def transform_works(frame: Frame, transform: SineTransform) -> Iterator[Work]:
    """Rows collected and held, folded, and for each value half a row of products summed."""
    half, width = (frame.size + 1) // 2, transform.input_width
    shifted = frame.row_beats * (frame.row_beats - 1) * frame.lanes
    yield register(frame.size * (shifted + frame.size), width)
    # A single lane folds anew for each value, odd and even in turn; several keep both kinds for a row.
    yield addition(frame.size * half * (frame.size if frame.lanes == 1 else 2), width + 1)
    yield memory(frame.inner_beats, frame.lanes * half * transform.coefficient_width, frame.row_beats)
    yield multiplication(frame.inner * half, width + 1, transform.coefficient_width)
    addends = half - (transform.rounding == FLOOR)  # the products and, to round, a half unit
    yield addition(frame.inner * addends, transform.accumulator_width)
