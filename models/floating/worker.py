"""The float pipeline on one frame after another, each by one thread or by several."""

from functools import partial

import numpy as np

from fastac.models.floating.hyperforce import force_map
from fastac.models.floating.stages import depth_alone, find_all, finish, slopes_alone
from fastac.models.loops.poisson import PIXELS, SOLUTION, rows_each
from fastac.models.loops.tasks import BELL, new_board
from fastac.models.loops.team import together
from fastac.models.vision.rigid_spread import rigid_spread_px

OF_PIXELS, OF_SOLUTION = ("normals", "slopes"), ("depth_mm", "displacement_mm")
"""What the compiled stages find, in the order in which they take its places."""
UNWANTED = dict.fromkeys(OF_PIXELS + OF_SOLUTION, np.empty((0, 0), np.float32))
BEFORE_SOLVER = frozenset({"normals", "slopes", "dot_shifts_px", "dots_seen"})
OF_DOTS = ("dot_shifts_px", "dots_seen", "force_n", "slip_px")
"""Outputs for which the dots are found."""


class Worker:
    """Scratch memory for one frame; called with frames and the places of their outputs, see `over_frames`.

    pipeline : the FloatPipeline
    """

    can_share = True

    def __init__(self, pipeline, outputs: frozenset[str]):
        self.pipeline, scene = pipeline, pipeline.scene
        height, width, _ = pipeline.background.shape
        each = rows_each(width)
        self.dots = pipeline.dots if not outputs.isdisjoint(OF_DOTS) else None
        self.wants_map, self.wants_slip = "force_map_n" in outputs, "slip_px" in outputs
        self.steps, self.last = [-(-height // each)], PIXELS
        self.slopes = np.zeros((2, height * width), np.float32)
        after = None if outputs <= BEFORE_SOLVER else pipeline.after
        weight = no_weight = np.empty((0, 0, 0))
        if after is not None and "force_n" in outputs:
            weight = after.weight
        self.behind = None
        behind = outputs - BEFORE_SOLVER - ({"force_n"} if scene.force_from_slopes else set())
        if after is not None and after.solves and behind:
            of_displacement = weight if scene.force_from_displacement else no_weight
            self.behind = self._behind(of_displacement, "depth_mm" in outputs)
            self.steps += [after.sine.bands, after.sine.blocks, after.sine.bands]
            self.last = SOLUTION
        self.shares = np.zeros((max(self.steps), len(weight)))
        threshold, reach = np.zeros((1, 1), np.int64), 0
        if pipeline.bridge is not None:
            threshold, reach = pipeline.bridge.windows.threshold.astype(np.int64), pipeline.bridge.reach
        wants_slopes, limit = "slopes" in outputs or after is not None, np.float32(scene.numbers.slope_limit)
        of_slopes = np.empty((0, 0), np.float32), no_weight
        if scene.force_from_slopes and len(weight):
            of_slopes = after.rest_slopes, weight
        self.before = (
            pipeline.frame_network.tables,
            (limit, each, wants_slopes, self.behind is None),
            (threshold, reach),
            self.slopes,
            of_slopes,
        )

    def _behind(self, weight: np.ndarray, wants_depth: bool) -> tuple:
        """What `solve` takes between the frame's number and the places."""
        after, scene = self.pipeline.after, self.pipeline.scene
        size, sine = after.sine.size, after.sine
        keeps = self.wants_map or self.wants_slip
        self.counted_mm = np.zeros((size, size) if keeps else (0, 0), np.float32)
        return (
            (self.slopes, size, after.stencil.ahead, np.float32(after.stencil.scale), after.rest_source),
            (sine.rows, sine.columns, sine.columns_back, sine.rows_back, after.factors),
            sine.memory(),
            (size, not scene.force.signed),
            # of the scene's mode nothing but the depth depends
            after.rest_mm.reshape(-1) if wants_depth else np.empty(0, np.float32),
            np.array(scene.force.bends_mm, np.float32),
            weight,
        )

    def __call__(self, frames: np.ndarray, out: dict[str, np.ndarray], threads: int = 1) -> None:
        """Fill the places `out` (frames, …) of frames (frames, H, W, C) uint8, each by so many threads."""
        if not (frames.flags.c_contiguous and frames.flags.writeable):
            frames = frames.copy()  # so that nothing is compiled for other kinds of arrays
        pixels = self.pipeline.frame_network.seen(frames)
        places = UNWANTED | {
            name: out[name].reshape(len(frames), -1) for name in UNWANTED.keys() & out.keys()
        }
        before = (frames, pixels, *self.before, (self.shares, *(places[name] for name in OF_PIXELS)))
        behind = None
        if self.behind is not None:
            found = (self.shares, *(places[name] for name in OF_SOLUTION), self.counted_mm.reshape(-1))
            behind = (*self.behind, found)
        blank = new_board(threads, *self.steps)
        for k, frame in enumerate(frames):
            board, seen = blank.copy(), []
            together(partial(self._tasks, board, k, before, behind, frame, seen), threads)
            finish(board, self.last)
            self._add(k, out, *(seen or (None, None)))

    def displacement_mm(self, slopes: np.ndarray) -> np.ndarray:
        """Slopes (H, W, 2) of one frame to the displacement (N, N) in mm, by this thread alone."""
        self.slopes[...] = np.moveaxis(slopes, -1, 0).reshape(2, -1)
        size = self.pipeline.after.sine.size
        found, nothing = np.empty((1, size * size), np.float32), UNWANTED["depth_mm"]
        board = new_board(1, 0, *self.steps[1:])
        depth_alone(
            board, 0, BELL, 0, (*self.behind, (self.shares, nothing, found, self.counted_mm.reshape(-1)))
        )
        return found.reshape(size, size)

    def _tasks(
        self,
        board: np.ndarray,
        k: int,
        before: tuple,
        behind: tuple | None,
        frame: np.ndarray,
        seen: list,
        member: int,
    ) -> None:
        """One thread's part of frame k; the first also finds its dots, and puts shifts and which are seen
        into `seen`."""
        if member == 0 and self.dots is not None:
            seen.extend(self.dots.shifts_px(frame))
        if behind is None:
            slopes_alone(board, member, BELL, k, before)
        else:
            find_all(board, member, BELL, k, before, behind)

    def _add(
        self, k: int, out: dict[str, np.ndarray], shift_px: np.ndarray | None, seen: np.ndarray | None
    ) -> None:
        """What is found of frame k without compiled loops: the force's sum, its map, dots and slip."""
        pipeline = self.pipeline
        if "force_n" in out:
            force_n = self.shares.sum(axis=0)
            if pipeline.dot_weights is not None:
                force_n += np.einsum("amk,mk->a", pipeline.dot_weights, shift_px)
            out["force_n"][k] = force_n
        for name, value in (("dot_shifts_px", shift_px), ("dots_seen", seen)):
            if name in out:
                out[name][k] = value
        if self.wants_map:
            out["force_map_n"][k] = force_map(self.counted_mm, pipeline.force_weights)
        if self.wants_slip:
            out["slip_px"][k] = self._slip_px(shift_px, seen)

    def _slip_px(self, shift_px: np.ndarray, seen: np.ndarray) -> float:
        """The spread of one frame's touching dots."""
        rest_px = self.pipeline.dots.rest_px
        column, row = np.clip(np.rint(rest_px).astype(int) - 1, 0, len(self.counted_mm) - 1).T
        contact = seen & (self.counted_mm[row, column] > self.pipeline.scene.slip.contact_mm)
        return rigid_spread_px(rest_px[contact], shift_px[contact])
