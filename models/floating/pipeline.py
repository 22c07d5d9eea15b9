"""The float pipeline, from frames to normals, depth and force: the reference for the loss by quantisation."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import torch

from fastac.models.floating import network as pixel_normals
from fastac.models.floating.hyperforce import collapse, force_map
from fastac.models.floating.poisson import solve, source_of
from fastac.models.floating.threads import single_thread
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.features import scales
from fastac.models.integer.force import terms
from fastac.models.integer.laplacian import STENCILS, boundary_term, eigenvalues, sine_matrix
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.models.loops.dots import bridge, dark_pixels
from fastac.models.loops.frames import Outputs, choose_outputs, over_frames, require_frames
from fastac.models.loops.network import FrameNetwork
from fastac.models.loops.pixels import interleave_slopes, limited_slopes, source, unit_normals
from fastac.models.loops.sines import FoldedSine, fold_columns, fold_rows, unfold_columns, unfold_rows
from fastac.models.result import Result
from fastac.models.vision.markers import DetectedDots
from fastac.models.vision.rigid_spread import rigid_spread_px
from fastac.scenes.schema import Scene

NONE_OVER = np.empty((0, 0, 0), bool)
KERNELS_NDIM = 5
"""Dimensions of kernels (axes, N, N, K, K); other weights are one a pixel and term."""


@dataclass(frozen=True, eq=False)
class FloatPipeline:
    """A scene's models in floating point.

    network : the pixel network; background : (H, W, C) uint8, the no-contact reference frame
    rest_depth_mm : (H, W) depth of the undeformed skin, the boundary prior of the solver
    force_weights : kernels (axes, N, N, K, K) or weights (axes, N, N, terms) in N per mm or, for the adjoint
        solver, weights of the slopes (axes, H, W, 2) in N; None without force
    bridge : of the slopes under the marker dots, where the scene wants it
    dots : the marker dots, where the scene wants their shifts
    dot_weights : (axes, M, 2) in N per px, what the shifts add to the force; None without
    """

    scene: Scene
    network: pixel_normals.PixelNetwork
    background: np.ndarray
    rest_depth_mm: np.ndarray
    force_weights: np.ndarray | None = None
    bridge: SlopeBridge | None = None
    dots: DetectedDots | None = None
    dot_weights: np.ndarray | None = None

    @classmethod
    def from_arrays(
        cls,
        arrays: dict[str, np.ndarray],
        scene: Scene,
        background: np.ndarray,
        rest_depth_mm: np.ndarray,
        bridge: SlopeBridge | None = None,
    ) -> "FloatPipeline":
        """From a bundle's float arrays: `network.k.weight`, `network.k.bias`, and optionally
        `force.float_weights`, `force.float_dot_weights` and `dots.rest_px`."""
        count = sum(k.startswith("network.") and k.endswith(".weight") for k in arrays)
        weights = [torch.from_numpy(arrays[f"network.{k}.weight"]) for k in range(count)]
        network = pixel_normals.PixelNetwork(
            weights[0].shape[1], tuple(len(weight) for weight in weights[:-1])
        )
        with torch.no_grad():
            for k, (layer, weight) in enumerate(zip(network.linear_layers, weights, strict=True)):
                layer.weight.copy_(weight)
                layer.bias.copy_(torch.from_numpy(arrays[f"network.{k}.bias"]))
        dots = None
        if scene.wants_dots:
            dots = DetectedDots.at(arrays["dots.rest_px"], scene.sensor)
        weights = (arrays.get(f"force.float_{name}") for name in ("weights", "dot_weights"))
        force, of_dots = weights
        return cls(scene, network, background, rest_depth_mm, force, bridge, dots, of_dots)

    @classmethod
    def from_bundle(cls, bundle: Bundle) -> "FloatPipeline":
        pipeline = bundle.pipeline
        return cls.from_arrays(
            bundle.floats, bundle.scene, pipeline.background, pipeline.rest_depth_mm, pipeline.bridge
        )

    @cached_property
    def _tables(self) -> list[np.ndarray]:
        """Weights of each layer, (neurons, inputs + 1) float32: the features' scales are multiplied into the
        first layer, and the last column is the bias."""
        scale, tables = scales(self.background.shape[-1]), []
        for layer in self.network.linear_layers:
            weight = layer.weight.detach().numpy() * scale
            bias = layer.bias.detach().numpy()
            tables.append(np.column_stack([weight, bias]).astype(np.float32))
            scale = 1
        return tables

    @property
    def pixel_weights(self) -> np.ndarray:
        """The skin's force weights, one a pixel and term: kernels collapsed, all others as they are."""
        of_kernels = self.force_weights.ndim == KERNELS_NDIM
        return collapse(self.force_weights) if of_kernels else self.force_weights

    @cached_property
    def _after(self) -> "_AfterSlopes":
        return _AfterSlopes(self)

    def rest_slopes(self) -> np.ndarray:
        """The slopes that the network gives for the background frame, (H, W, 2)."""
        slopes = np.empty((1, *self.background.shape[:2], 2), np.float32)
        _Worker(self)(self.background[None], {"slopes": slopes})
        return slopes[0]

    def _solve(self, slopes: np.ndarray) -> np.ndarray:
        """Slopes (frames, H, W, 2) to depth in px, in the scene's mode."""
        divergence, pitch = self.scene.poisson.divergence, self.scene.sensor.pitch_mm
        source = source_of(slopes, divergence)
        if self.scene.poisson.mode == "absolute":
            return solve(source - boundary_term(self.rest_depth_mm / pitch))
        rest = source_of(self.rest_slopes(), divergence)
        return solve(source - rest) + self.rest_depth_mm[1:-1, 1:-1] / pitch

    def rest_px(self) -> np.ndarray:
        """The depth of the background frame, (N, N) in px: where the displacement is zero."""
        return self._solve(self.rest_slopes()[None].astype(np.float64))[0]

    @property
    def outputs(self) -> Outputs:
        """Shapes for one frame and element types of everything that the scene wants; see `Result`."""
        height, width, _ = self.background.shape
        found: Outputs = {
            "normals": ((height, width, 3), np.float32),
            "slopes": ((height, width, 2), np.float32),
        }
        if self.scene.wants_solver:
            found["depth_mm"] = ((height, width), np.float32)
            found["displacement_mm"] = ((height - 2, width - 2), np.float32)
        if self.scene.wants_force and self.force_weights is not None:
            axes = len(self.force_weights)
            found["force_n"] = ((axes,), np.float64)
            if self.scene.wants_force_map:
                found["force_map_n"] = ((axes, height - 2, width - 2), np.float32)
        if self.scene.wants_slip and self.dots is not None:
            found["slip_px"] = ((), np.float64)
        if self.dots is not None:
            count = len(self.dots.rest_px)
            found |= {"dot_shifts_px": ((count, 2), np.float32), "dots_seen": ((count,), np.bool_)}
        return found

    def stages(self) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
        """The stages of `run` for one frame, as separate functions, to measure their times.

        normals : frame (H, W, C) uint8 to slopes (H, W, 2)
        depth : slopes to the displacement (N, N) in mm
        force : displacement, which is overwritten, to force_n (axes,), without the dots' share; only with
            force weights
        The scene must have a depth solver.
        """
        worker, after = _Worker(self), self._after
        slopes = np.empty((1, *self.background.shape[:2], 2), np.float32)

        def normals(frame: np.ndarray) -> np.ndarray:
            worker(frame[None], {"slopes": slopes})
            return slopes[0]

        found = {"normals": normals, "depth": after.solved}
        if after.weights is not None:
            found["force"] = lambda displacement_mm: after.force_n(after.clamped(displacement_mm))
        return found

    def run(
        self, frames: np.ndarray, *, wanted: Iterable[str] | None = None, progress: bool = False
    ) -> Result:
        """Process frames (frames, H, W, C) uint8; returns all outputs of the scene, or the fields `wanted`.

        Raises ValueError on frames of another shape or type, or an unknown field.
        """
        outputs = choose_outputs(self.outputs, wanted)
        require_frames(frames, self.background)
        before = {"normals", "slopes", "dot_shifts_px", "dots_seen"}
        after = None if outputs.keys() <= before else self._after
        wants_dots = not outputs.keys().isdisjoint({"dot_shifts_px", "dots_seen", "force_n", "slip_px"})
        worker = partial(_Worker, self, after, wants_dots=wants_dots)
        with single_thread():
            found = over_frames(worker, frames, outputs, progress=progress, label="float pipeline")
        return Result(**found)


class _AfterSlopes:
    """Displacement and force from slopes, computed from the slopes less those of the background frame.

    Solver and force weights are linear, so that the background gives exactly zero.
    """

    def __init__(self, pipeline: FloatPipeline):
        scene, self.weights = pipeline.scene, pipeline.force_weights
        self.pipeline = pipeline
        self.stencil, self.force = STENCILS[scene.poisson.divergence], scene.force
        self.rest_slopes = _by_planes(pipeline.rest_slopes())
        self.has_solver = scene.wants_solver
        if self.has_solver:
            pitch_mm = scene.sensor.pitch_mm
            size = len(pipeline.rest_depth_mm) - 2
            self.rest_source = np.zeros((size, size), np.float32)
            self.rest_source = self._source(self.rest_slopes)
            self.sine = FoldedSine(sine_matrix(size).astype(np.float32))
            order = self.sine.order
            self.reciprocal = (-pitch_mm / eigenvalues(size)[order][:, order]).astype(np.float32)
        if self.weights is not None:
            weight = pipeline.pixel_weights
            self.weight = weight.reshape(len(weight), -1).astype(np.float64)

    @cached_property
    def rest_mm(self) -> np.ndarray:
        """The depth of the background frame, (H, W) in mm."""
        found = self.pipeline.rest_depth_mm.astype(np.float32)
        found[1:-1, 1:-1] = self.pipeline.rest_px() * self.pipeline.scene.sensor.pitch_mm
        return found

    def _source(self, slopes: np.ndarray) -> np.ndarray:
        """`poisson.source_of` of slopes (H, W, 2) less that of the background's slopes, (N, N)."""
        found, scale = np.empty_like(self.rest_source), np.float32(self.stencil.scale)
        planes = np.ascontiguousarray(np.moveaxis(slopes, -1, 0))
        source(planes, self.stencil.ahead, scale, self.rest_source, found)
        return found

    def solved(self, slopes: np.ndarray) -> np.ndarray:
        """Slopes (H, W, 2) of one frame to the displacement (N, N) in mm."""
        x, sine = self._source(slopes), self.sine
        a, b = np.empty((2, *x.shape), np.float32)
        fold_rows(x, a)
        fold_columns(a, None, b)
        sine.rows(b, a)
        sine.columns(a, b)
        np.multiply(b, self.reciprocal, out=b)
        sine.columns_back(b, a)
        sine.rows_back(a, b)
        unfold_columns(b, None, a)
        unfold_rows(a, None, x)
        return x

    def force_n(self, x: np.ndarray) -> np.ndarray:
        """The skin's force (axes,) in N, from the displacement (N, N) or, for the adjoint, the slopes' change
        (H, W, 2)."""
        if self.has_solver:
            x = terms(x, self.force.band_mm)
        return self.weight @ x.reshape(-1).astype(np.float64)

    def clamped(self, displacement_mm: np.ndarray) -> np.ndarray:
        """The displacement with negative values set to zero, in place, unless they count."""
        return displacement_mm if self.force.signed else np.maximum(displacement_mm, 0, out=displacement_mm)

    def __call__(
        self,
        slopes: np.ndarray,
        shift_px: np.ndarray | None,
        seen: np.ndarray | None,
        out: dict[str, np.ndarray],
    ) -> None:
        """Compute the outputs of one frame from its slopes (H, W, 2) and its dots' shifts (M, 2), if any, and
        which of them are seen, (M,), and write them into the arrays of `out`."""
        if self.has_solver:
            x = self.solved(slopes)
            if "displacement_mm" in out:
                out["displacement_mm"][...] = x
            if "depth_mm" in out:
                out["depth_mm"][...] = self.rest_mm
                out["depth_mm"][1:-1, 1:-1] -= x
            x = self.clamped(x)
            if "slip_px" in out:
                out["slip_px"][...] = self._slip_px(x, shift_px, seen)
        else:
            x = slopes - self.rest_slopes
        if "force_n" in out:
            out["force_n"][...] = self.force_n(x)
            if self.pipeline.dot_weights is not None:
                out["force_n"] += np.einsum("amk,mk->a", self.pipeline.dot_weights, shift_px)
        if "force_map_n" in out:
            out["force_map_n"][...] = force_map(x, self.weights)

    def _slip_px(self, displacement_mm: np.ndarray, shift_px: np.ndarray, seen: np.ndarray) -> float:
        """The spread of one frame's touching dots, from the displacement (N, N)."""
        rest_px = self.pipeline.dots.rest_px
        column, row = np.clip(np.rint(rest_px).astype(int) - 1, 0, len(displacement_mm) - 1).T
        contact = seen & (displacement_mm[row, column] > self.pipeline.scene.slip.contact_mm)
        return rigid_spread_px(rest_px[contact], shift_px[contact])


def _by_planes(slopes: np.ndarray) -> np.ndarray:
    """A copy of slopes (H, W, 2) in which p and q are contiguous planes in memory."""
    return np.moveaxis(np.ascontiguousarray(np.moveaxis(slopes, -1, 0)), 0, -1)


class _Worker:
    """The pipeline in one thread, with its scratch memory; see `over_frames`."""

    def __init__(
        self, pipeline: FloatPipeline, after: _AfterSlopes | None = None, *, wants_dots: bool = False
    ):
        self.network = FrameNetwork(pipeline._tables, pipeline.background)
        self.limit, self.after = pipeline.scene.numbers.slope_limit, after
        self.dots = pipeline.dots if wants_dots else None
        self.planes = np.empty((2, *pipeline.background.shape[:2]), np.float32)
        self.bridge, self.dark = pipeline.bridge, np.empty(pipeline.background.shape[:2], bool)
        self.slopes = np.moveaxis(self.planes, 0, -1)

    def __call__(self, frames: np.ndarray, out: dict[str, np.ndarray]) -> None:
        for k, frame in enumerate(frames):
            normal = self.network(frame)
            if "normals" in out:
                unit_normals(normal, np.float32(1e-12), out["normals"][k].reshape(-1))
            if "slopes" in out or self.after is not None:
                limited_slopes(normal, np.float32(self.limit), self.planes.reshape(2, -1))
                if self.bridge is not None:
                    dark_pixels(frame, self.bridge.windows.threshold, self.dark)
                    bridge(self.dark, self.bridge.reach, self.planes, NONE_OVER)
            if "slopes" in out:
                interleave_slopes(self.planes.reshape(2, -1), np.float32(1), out["slopes"][k].reshape(-1))
            shift_px = seen = None
            if self.dots is not None:
                shift_px, seen = self.dots.shifts_px(frame)
                for name, value in (("dot_shifts_px", shift_px), ("dots_seen", seen)):
                    if name in out:
                        out[name][k] = value
            if self.after is not None:
                self.after(self.slopes, shift_px, seen, {name: array[k, ...] for name, array in out.items()})
