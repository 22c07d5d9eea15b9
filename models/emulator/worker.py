"""The emulator on one frame after another, each by one thread or by several."""

from functools import partial

import numpy as np

from fastac.models.emulator.direct import interval_of, slip_of
from fastac.models.emulator.exact import ExactTables
from fastac.models.emulator.stages import (
    DISPLACEMENTS,
    LOST,
    MEASURES,
    SLOPES,
    conclude,
    slopes_alone,
)
from fastac.models.emulator.wanted import Wanted
from fastac.models.integer.dot_follower import FRACTION
from fastac.models.integer.frame_validity import REASONS
from fastac.models.loops.dots import NO_DOTS, FollowedDots
from fastac.models.loops.measures import BRIGHTNESS, CHANGE, CLIPPED, DETAIL
from fastac.models.loops.poisson import PIXELS, SOLUTION, rows_each
from fastac.models.loops.tasks import BELL, new_board
from fastac.models.loops.team import together

OF_PIXELS = {"normals": np.float32, "normal_words": np.int32, "slopes": np.float32}
OF_SOLUTION = {
    "depth_words": np.int64,
    "depth_mm": np.float32,
    "displacement_mm": np.float32,
    "displacement_words": np.int64,
}
OF_FRAME = {
    "force_raw": np.int64,
    "force_n": np.float64,
    "validity_measures": np.int64,
    "validity": np.int64,
    "gradient_saturated": np.int64,
    "displacement_saturated": np.int64,
}
"""What the compiled stages find, in the order in which they take its places, with element types."""
UNWANTED = {name: np.empty((0, 0), kind) for name, kind in (OF_PIXELS | OF_SOLUTION | OF_FRAME).items()}
NO_WEIGHT = np.empty((0, 0, 0))


class Worker:
    """Scratch memory for one frame; called with frames and the places of their outputs, see `over_frames`."""

    can_share = True

    def __init__(self, tables: ExactTables, outputs: frozenset[str]):
        self.tables, self.pipeline = tables, (pipeline := tables.pipeline)
        self.wanted = wanted = Wanted.of(pipeline, outputs)
        height, width, channels = pipeline.background.shape
        each = rows_each(width)
        self.dots = FollowedDots(pipeline.follower) if wanted.dots else None
        steps = [-(-height // each) + wanted.dots]
        self.slopes, self.z, self.between, self.behind = np.zeros((2, height * width)), None, None, None
        if wanted.solver:
            size, solver = height - 2, tables.solver
            self.z = np.zeros((size, size))
            source = self.slopes, size, tables.ahead, 1.0, tables.offset.reshape(-1)
            self.between, self.behind = (source, solver.tables, solver.sine.memory()), self._behind()
            steps += [solver.sine.bands, solver.sine.blocks, solver.sine.bands]
        self.steps, self.last = steps, SOLUTION if wanted.solver else PIXELS
        self.counts = np.zeros((max(steps), MEASURES + BRIGHTNESS + channels), np.int64)
        self.shares = np.zeros((max(steps), len(tables.weight) if wanted.force else 0))
        self.before, self.ending = self._before(each), self._ending()
        self.adds = wanted.dots or wanted.slip or wanted.force_map

    def _before(self, each: int) -> tuple:
        """What `find_slopes` takes between the frames and the places."""
        pipeline, tables, wanted = self.pipeline, self.tables, self.wanted
        threshold, reach = np.zeros((1, 1), np.int64), 0
        if pipeline.bridge is not None:
            threshold, reach = pipeline.bridge.windows.threshold.astype(np.int64), pipeline.bridge.reach
        ratio = pipeline.ratio
        return (
            np.array(pipeline.background).reshape(-1),
            tables.network.tables,
            NO_DOTS if self.dots is None else self.dots.tables,
            (
                2.0**-ratio.fraction,
                float(ratio.limit),
                each,
                wanted.slopes,
                wanted.validity,
                wanted.dots,
                not wanted.solver,
            ),
            (threshold, reach),
            self.slopes,
            tables.weight if wanted.force and pipeline.scene.force_from_slopes else NO_WEIGHT,
        )

    def _behind(self) -> tuple:
        """What `find_depth` takes between the solver's tables and the places."""
        pipeline, tables, quantiser = self.pipeline, self.tables, self.pipeline.quantiser
        to_words = (True, 1.0, 1.0)
        if quantiser is not None:
            to_words = (quantiser.clamp, 2.0**-quantiser.shift, float(quantiser.top))
        return (
            (tables.rest.reshape(-1), pipeline.rest_depth_mm.astype(np.float32).reshape(-1)),
            (pipeline.depth.mode == "absolute", pipeline.depth_mm_per_unit, self.wanted.words, *to_words),
            np.array(pipeline.bends, np.float64),
            tables.weight if self.wanted.force and pipeline.scene.force_from_displacement else NO_WEIGHT,
            self.z.reshape(-1),
        )

    def _ending(self) -> tuple:
        """What `conclude` takes between the frame's number and the places."""
        pipeline, validity = self.pipeline, self.pipeline.validity
        names = validity.names if self.wanted.validity else ()
        columns = {"clipped": MEASURES + CLIPPED, "change": MEASURES + CHANGE, "detail": MEASURES + DETAIL}
        brightness = REASONS[1 : 1 + pipeline.background.shape[-1]]
        columns |= {name: MEASURES + BRIGHTNESS + c for c, name in enumerate(brightness)}
        columns |= {"gradient": SLOPES, "displacement": DISPLACEMENTS, "dots": LOST}
        limits = (
            np.array([columns[name] for name in names], np.int64),
            np.array(validity.low[: len(names)], np.int64),
            np.array(validity.high[: len(names)], np.int64),
            np.array([1 << REASONS.index(name) for name in names], np.int64),
        )
        seen, shift = np.zeros(0, np.bool_), np.zeros((0, 2), np.int64)
        weight, exponent = np.zeros((0, 0, 2), np.int64), np.zeros(0, np.int64)
        force = np.zeros(0), np.zeros(0)
        if self.dots is not None:
            seen, shift = self.dots.seen, self.dots.shift
        if self.wanted.force:
            force = self.tables.constant, np.array(pipeline.force_n_per_unit, np.float64)
            weight, exponent = np.zeros((len(force[0]), 0, 2), np.int64), np.zeros(len(force[0]), np.int64)
            if pipeline.dot_force is not None:
                weight = np.array(pipeline.dot_force.weighted.weight[:, :, 0], np.int64)
                exponent = np.array(pipeline.dot_force.exponent, np.int64)
        return self.counts, self.shares, (seen, shift, weight, exponent), limits, force

    def __call__(self, frames: np.ndarray, out: dict[str, np.ndarray], threads: int = 1) -> None:
        """Fill the places `out` (frames, …) of frames (frames, H, W, C) uint8, each by so many threads."""
        if not (frames.flags.c_contiguous and frames.flags.writeable):
            frames = frames.copy()  # so that nothing is compiled for other kinds of arrays
        count, flat = len(frames), frames.reshape(len(frames), -1)
        if self.wanted.interval:
            out = self._measured(count) | out
        rows = {name: array.reshape(count, -1) for name, array in out.items()}
        own, places = (self.counts, self.shares), UNWANTED | rows
        seen = self.tables.network.seen(frames)
        before = (frames, flat, seen, *self.before, own + tuple(places[name] for name in OF_PIXELS))
        behind = None
        if self.behind is not None:
            behind = (*self.behind, own + tuple(places[name] for name in OF_SOLUTION))
        found = tuple(places[name] for name in OF_FRAME)
        blank = new_board(threads, *self.steps)
        for k in range(count):
            board = blank.copy()
            together(partial(self._tasks, board, k, before, behind), threads)
            conclude(board, self.last, k, *self.ending, found)
            if self.adds:
                self._add(k, out)
        if self.wanted.interval:
            found = interval_of(self.pipeline, out["validity_measures"], out["force_raw"])
            for name in found.keys() & out.keys():
                out[name][:] = found[name]

    def _measured(self, count: int) -> dict[str, np.ndarray]:
        """Places of what the intervals of so many frames follow from."""
        measures, axes = len(self.pipeline.validity.names), len(self.pipeline.force_n_per_unit)
        return {
            "validity_measures": np.empty((count, measures), np.int64),
            "force_raw": np.empty((count, axes), np.int64),
        }

    def _tasks(self, board: np.ndarray, k: int, before: tuple, behind: tuple | None, member: int) -> None:
        """One thread's part of frame k."""
        if behind is None:
            slopes_alone(board, member, BELL, k, before)
        else:
            self.tables.solver.emulate(board, member, BELL, k, before, *self.between, behind)

    def _add(self, k: int, out: dict[str, np.ndarray]) -> None:
        """What is found of frame k without compiled loops: its dots, slip and force map."""
        pipeline, dots = self.pipeline, self.dots
        if dots is not None:
            if "dot_shift_words" in out:
                out["dot_shift_words"][k] = dots.shift
            if "dot_shifts_px" in out:
                out["dot_shifts_px"][k] = dots.shift * 2.0**-FRACTION
            if "dots_seen" in out:
                out["dots_seen"][k] = dots.seen
        if self.wanted.slip:
            found = slip_of(pipeline, *pipeline.spread(dots.shift, dots.seen, self.z))
            for name in found.keys() & out.keys():
                out[name][k] = found[name]
        if self.wanted.force_map:
            self._force_map(k, out)

    def _force_map(self, k: int, out: dict[str, np.ndarray]) -> None:
        """`integer.PatchForce.force_map`, one offset of the window after another."""
        kernel = self.tables.kernel  # (K, K, axes, N, N)
        n, half = len(self.z), len(kernel) // 2
        padded, total = np.pad(self.z, half), np.zeros(kernel.shape[2:])
        for i, row in enumerate(kernel):
            for j, weight in enumerate(row):
                total += weight * padded[i : i + n, j : j + n]
        if "force_map_raw" in out:
            np.copyto(out["force_map_raw"][k], total, casting="unsafe")
        if "force_map_n" in out:
            scale = self.pipeline.force_n_per_unit[:, None, None]
            np.multiply(total, scale, out=out["force_map_n"][k], casting="same_kind")
