"""The integer pipeline on frames, exact and fast: `Emulator(tables).run(frames)`."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from fastac.models.emulator import direct
from fastac.models.emulator.exact import ExactTables
from fastac.models.emulator.exactness import NotExactError
from fastac.models.emulator.worker import Worker
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.loops.frames import IdleWorkers, Outputs, choose_outputs, over_frames, require_frames
from fastac.models.result import Result
from fastac.scenes.schema import Scene


@dataclass(frozen=True, eq=False)
class Emulator:
    """What the hardware of these tables finds in frames, bit for bit. Keep it: its own tables take time."""

    pipeline: IntegerPipeline
    _worker: Callable[[frozenset[str]], Callable] = field(init=False, repr=False)
    """Makes what computes the given outputs: float64 tables where they are exact."""
    _idle: IdleWorkers = field(init=False, repr=False, default_factory=IdleWorkers)

    @property
    def scene(self) -> Scene:
        return self.pipeline.scene

    @cached_property
    def outputs(self) -> Outputs:
        """Shapes for one frame and element types of everything that the scene wants; see `Result`."""
        return direct.outputs(self.pipeline)

    def __post_init__(self):
        # Now, not when first run: a step depends on the entry of the solvers' table that it looks up itself.
        try:
            worker = partial(Worker, ExactTables(self.pipeline))
        except NotExactError:
            worker = partial(_direct_worker, self.pipeline)
        object.__setattr__(self, "_worker", worker)

    def run(
        self, frames: np.ndarray, *, wanted: Iterable[str] | None = None, progress: bool = False
    ) -> Result:
        """Frames (frames, H, W, C) uint8 to all that the scene wants, or to the fields `wanted`.

        Equal to `direct.loop` on every value.
        """
        outputs = choose_outputs(self.outputs, wanted)
        require_frames(frames, self.pipeline.background)
        with self._idle.lent(self._worker, frozenset(outputs)) as worker:
            return Result(**over_frames(worker, frames, outputs, progress=progress, label="integer pipeline"))


def _direct_worker(pipeline: IntegerPipeline, outputs: frozenset[str]) -> Callable:
    """As `Worker`, without tables: all outputs, in int64."""
    return partial(direct.loop, pipeline)


def with_limits(pipeline: IntegerPipeline, frames: np.ndarray, *, progress: bool = False) -> IntegerPipeline:
    """The tables with limits around what good frames (frames, H, W, C) measure; see `FrameValidity`."""
    found = Emulator(pipeline).run(frames, wanted=["validity_measures"], progress=progress)
    return pipeline.replace(validity=pipeline.validity.limited(found.validity_measures))
