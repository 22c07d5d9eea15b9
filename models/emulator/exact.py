"""The integer pipeline at full speed: models/integer in floating point, bit for bit.

Every integer of the pipeline is below a bound that follows from its tables. Where that is below 2**53,
float64 holds it, its sums and its multiples by powers of two exactly. So shifts move into the tables and a
rounding is a floor. `ExactTables` refuses tables for which it would not be exact. The network's hidden layers
are in float32 where that holds all their sums.
"""

from collections.abc import Iterable

import numpy as np

from fastac.models.emulator.direct import slip_of
from fastac.models.emulator.exactness import EXACT_FLOAT32, require_exact
from fastac.models.emulator.solvers import SOLVERS
from fastac.models.integer.dot_follower import FRACTION
from fastac.models.integer.features import limits
from fastac.models.integer.force import PatchForce, WeightedSum, terms
from fastac.models.integer.laplacian import STENCILS
from fastac.models.integer.network import Layer
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.loops.dots import FollowedDots, bridge, dark_pixels
from fastac.models.loops.frames import CHUNK
from fastac.models.loops.network import FrameNetwork
from fastac.models.loops.pixels import (
    depth_and_displacement,
    displacement_words,
    interleave_normals,
    interleave_slopes,
    slope_words,
    source,
    unit_normals,
)

SLIP = ("slip_words", "slip_px", "slip_dots", "slipping")
"""Outputs that tell of slip."""
UNWANTED = {kind: np.empty((0, 0), kind) for kind in (np.int64, np.float32)}


class ExactTables:
    """A pipeline's tables in float64, for any number of threads.

    Raises NotExactError, naming the stage, where an integer could reach 2**53.
    """

    def __init__(self, pipeline: IntegerPipeline):
        self.pipeline = pipeline
        limit = limits(pipeline.background.shape[-1])
        self.requantise, largest = [], 0
        *hidden, last = pipeline.layers
        for layer in hidden:
            step = layer.requantisation
            reach = np.abs(layer.weight) @ limit + np.abs(layer.bias)
            require_exact("layer", int((reach * step.multiplier).max()))
            top = (1 << step.bits) - 1
            self.requantise.append((step.multiplier * 2.0**-step.shift, top))
            limit = np.full(len(layer.weight), top, np.int64)
            largest = max(largest, int(reach.max()), top, int(step.multiplier.max()))
        real = np.float32 if largest < EXACT_FLOAT32 else np.float64
        self.tables = [_layer_table(layer, real) for layer in hidden] + [_layer_table(last, np.float64)]
        normal = int((np.abs(last.weight) @ limit + np.abs(last.bias)).max())
        require_exact("layer", normal)
        require_exact("slopes", (normal << (pipeline.ratio.fraction + 1)) + 3 * normal)
        self.solver = None
        if pipeline.solver is not None:
            require_exact("source", pipeline.source.bound)
            require_exact("depth", 1 << pipeline.depth.width)
            self.solver = SOLVERS[pipeline.scene.poisson.solver](pipeline.solver)
            self.ahead = STENCILS[pipeline.source.divergence].ahead
            self.offset = pipeline.source.offset.astype(np.float64)
            self.rest = pipeline.depth.rest.astype(np.float64)
        if pipeline.bridge is not None:
            self.threshold = pipeline.bridge.windows.threshold.astype(np.int64)
        self.bends = pipeline.bends
        if pipeline.force is not None:
            self._plan_force(pipeline.force)

    def _plan_force(self, force: PatchForce | WeightedSum) -> None:
        resultant = force.collapsed() if isinstance(force, PatchForce) else force
        dots = self.pipeline.dot_force
        require_exact("force", resultant.bound + (dots.bound if dots is not None else 0))
        # The emulator keeps p and q in two planes: terms before pixels.
        planes = np.moveaxis(resultant.weight, -1, 1)
        self.weight = planes.reshape(len(planes), -1).astype(np.float64)
        self.constant = resultant.constant.astype(np.float64)
        if self.pipeline.scene.wants_force_map:
            require_exact("force_map", force.pixel_bound)
            self.kernel = np.ascontiguousarray(np.moveaxis(force.kernel, (3, 4), (0, 1)).astype(np.float64))

    def worker(self, outputs: Iterable[str]) -> "_Worker":
        """What fills the places of `outputs`, for one thread; see `over_frames`."""
        return _Worker(self, frozenset(outputs))


def _layer_table(layer: Layer, real: type) -> np.ndarray:
    """(neurons, inputs + 1), the bias last."""
    return np.column_stack([layer.weight, layer.bias]).astype(real)


class _Worker:
    """One thread's scratch memory; called with a chunk of frames and the places of its outputs."""

    def __init__(self, emulator: ExactTables, outputs: frozenset[str]):
        self.emulator, self.pipeline = emulator, emulator.pipeline
        height, width, _ = self.pipeline.background.shape
        self.network = FrameNetwork(emulator.tables, self.pipeline.background, requantise=emulator.requantise)
        self.slopes = np.empty((2, height, width))
        bridged = self.pipeline.bridge is not None
        self.over = np.empty((2 * bridged, height, width), bool)
        self.dark = np.empty((height, width), bool)

        def wants(*names: str) -> bool:
            return not outputs.isdisjoint(names)

        self.wants_force = wants("force_raw", "force_n")
        self.wants_validity, validity = wants("validity", "validity_measures"), self.pipeline.validity
        self.wants_slip = wants(*SLIP)
        self.dots = None
        if self.pipeline.follower is not None and (
            self.wants_force
            or self.wants_validity
            or self.wants_slip
            or wants("dot_shift_words", "dot_shifts_px", "dots_seen")
        ):
            self.dots = FollowedDots(self.pipeline.follower)
        self.wants_words = (
            (self.wants_force and self.pipeline.quantiser is not None)
            or (self.wants_validity and validity.displacements)
            or self.wants_slip
            or wants("displacement_words", "displacement_saturated", "force_map_raw", "force_map_n")
        )
        self.wants_solver = self.wants_words or wants("depth_words", "depth_mm", "displacement_mm")
        self.wants_slopes = self.wants_solver or self.wants_force or wants("slopes", "gradient_saturated")
        self.wants_slopes |= self.wants_validity and validity.slopes
        if self.wants_solver:
            self.inner = (height - 2, width - 2)
            self.memory = np.empty(CHUNK * (height - 2) * (width - 2))

    def __call__(self, frames: np.ndarray, out: dict[str, np.ndarray]) -> None:
        if self.wants_solver:
            solver, (rows, columns) = self.emulator.solver, self.inner
            shape = [rows, columns]
            shape.insert(solver.frame_axis, len(frames))
            memory = self.memory[: len(frames) * rows * columns].reshape(shape)
            planes = np.moveaxis(memory, solver.frame_axis, 0)
        names = self.pipeline.validity.names
        measures = np.empty((len(frames), len(names)), np.int64)
        axes = 0 if self.pipeline.force is None else len(self.pipeline.force_n_per_unit)
        of_dots = np.zeros((len(frames), axes))
        followed = [None] * len(frames)
        for k, frame in enumerate(frames):
            places = {name: array[k : k + 1] for name, array in out.items()}
            normal = self.network(frame)
            self._normals(normal, places)
            if self.wants_slopes:
                saturated = self._slopes(normal, frame, places)
            if self.wants_validity:
                pixels = self.pipeline.validity.of_pixels(frame, self.pipeline.background)
                measures[k, : len(pixels)] = pixels
                if self.pipeline.validity.slopes:
                    measures[k, len(pixels)] = saturated
            if self.dots is not None:
                shift, seen = self._dots(frame, places)
                if self.pipeline.dot_force is not None:
                    of_dots[k] = self.pipeline.dot_force(shift)
                if self.wants_validity:
                    measures[k, names.index("dots")] = len(seen) - int(seen.sum())
                if self.wants_slip:
                    followed[k] = shift.copy(), seen.copy()
            if self.wants_solver:
                source(self.slopes, self.emulator.ahead, 1.0, self.emulator.offset, planes[k])
            elif self.wants_force:
                self._force(self.slopes, of_dots[k], places)
        if self.wants_solver:
            solver.solve(memory)
            for k, z in enumerate(planes):
                places = {name: array[k : k + 1] for name, array in out.items()}
                saturated = self._solution(z, of_dots[k], followed[k], places)
                if self.pipeline.validity.displacements:
                    measures[k, names.index("displacement")] = saturated
        if "validity_measures" in out:
            out["validity_measures"][...] = measures
        if "validity" in out:
            out["validity"][...] = self.pipeline.validity.flags(measures)

    def _normals(self, normal: np.ndarray, out: dict[str, np.ndarray]) -> None:
        if "normal_words" in out:
            interleave_normals(normal, out["normal_words"].reshape(-1))
        if "normals" in out:
            unit_normals(normal, 1.0, out["normals"].reshape(-1))

    def _slopes(self, normal: np.ndarray, frame: np.ndarray, out: dict[str, np.ndarray]) -> int:
        """Into `self.slopes`; how many values saturated."""
        ratio, slopes = self.pipeline.ratio, self.slopes.reshape(2, -1)
        unit = 2.0**-ratio.fraction
        saturated = slope_words(
            normal, unit, float(ratio.limit), slopes, self.over.reshape(len(self.over), slopes.shape[1])
        )
        if self.pipeline.bridge is not None:
            dark_pixels(frame, self.emulator.threshold, self.dark)
            saturated = bridge(self.dark, self.pipeline.bridge.reach, self.slopes, self.over)
        if "gradient_saturated" in out:
            out["gradient_saturated"][0] = saturated
        if "slopes" in out:
            interleave_slopes(slopes, unit, out["slopes"].reshape(-1))
        return saturated

    def _dots(self, frame: np.ndarray, out: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Shifts and which dots are seen, as of `FollowedDots`."""
        shift, seen = self.dots(frame)
        if "dot_shift_words" in out:
            out["dot_shift_words"][0] = shift
        if "dot_shifts_px" in out:
            out["dot_shifts_px"][0] = shift * 2.0**-FRACTION
        if "dots_seen" in out:
            out["dots_seen"][0] = seen
        return shift, seen

    def _solution(self, z: np.ndarray, of_dots: np.ndarray, followed, out: dict[str, np.ndarray]) -> int:
        """Solutions (N, N) to depth, displacement and what follows from it; how many words saturated.

        of_dots, followed : of the same frame, the dots' share of the force, and where slip is wanted what
            `_dots` found
        """
        pipeline = self.pipeline
        words, displacement_mm = (
            out[name][0] if name in out else UNWANTED[kind]
            for name, kind in (("depth_words", np.int64), ("displacement_mm", np.float32))
        )
        depth_mm = UNWANTED[np.float32]
        if "depth_mm" in out:
            out["depth_mm"][0] = pipeline.rest_depth_mm
            depth_mm = out["depth_mm"][0, 1:-1, 1:-1]
        absolute, unit = pipeline.depth.mode == "absolute", pipeline.depth_mm_per_unit
        depth_and_displacement(z, self.emulator.rest, absolute, unit, words, depth_mm, displacement_mm)
        if not self.wants_words:
            return 0
        quantiser = pipeline.quantiser
        words = out["displacement_words"][0] if "displacement_words" in out else UNWANTED[np.int64]
        saturated = displacement_words(z, quantiser.clamp, 2.0**-quantiser.shift, float(quantiser.top), words)
        if "displacement_saturated" in out:
            out["displacement_saturated"][0] = saturated
        self._force(np.moveaxis(terms(z, self.emulator.bends), -1, 0), of_dots, out)
        self._force_map(z, out)
        if self.wants_slip:
            for name, value in slip_of(pipeline, *pipeline.spread(*followed, z)).items():
                if name in out:
                    out[name][0] = value
        return saturated

    def _force(self, x: np.ndarray, of_dots: np.ndarray, out: dict[str, np.ndarray]) -> None:
        """`integer.WeightedSum` of the displacement's terms (terms, N, N) or slopes (2, H, W), with the dots'
        share (axes,) added."""
        if self.wants_force:
            raw = self.emulator.weight @ x.reshape(-1) + self.emulator.constant + of_dots
            if "force_raw" in out:
                out["force_raw"][0] = raw
            if "force_n" in out:
                out["force_n"][0] = raw * self.pipeline.force_n_per_unit

    def _force_map(self, q: np.ndarray, out: dict[str, np.ndarray]) -> None:
        """`integer.PatchForce.force_map`, one offset of the window after another."""
        if out.keys().isdisjoint(("force_map_raw", "force_map_n")):
            return
        kernel = self.emulator.kernel  # (K, K, axes, N, N)
        n, half = len(q), len(kernel) // 2
        padded, total = np.pad(q, half), np.zeros(kernel.shape[2:])
        for i, row in enumerate(kernel):
            for j, weight in enumerate(row):
                total += weight * padded[i : i + n, j : j + n]
        if "force_map_raw" in out:
            np.copyto(out["force_map_raw"][0], total, casting="unsafe")
        if "force_map_n" in out:
            scale = self.pipeline.force_n_per_unit[:, None, None]
            np.multiply(total, scale, out=out["force_map_n"][0], casting="same_kind")
