"""The float pipeline, from frames to normals, depth and force: the reference for the loss by quantisation."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from fastac.models.floating import network as pixel_normals
from fastac.models.floating.after_slopes import AfterSlopes
from fastac.models.floating.hyperforce import collapse
from fastac.models.floating.poisson import solve, source_of
from fastac.models.floating.worker import Worker
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.features import scales
from fastac.models.integer.laplacian import boundary_term
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.models.loops.frames import IdleWorkers, Outputs, choose_outputs, over_frames, require_frames
from fastac.models.loops.network import FrameNetwork
from fastac.models.result import Result
from fastac.models.vision.markers import DetectedDots
from fastac.scenes.schema import Scene

KERNELS_NDIM = 5
"""Dimensions of kernels (axes, N, N, K, K); other weights are one a pixel and term."""


@dataclass(frozen=True, eq=False)
class FloatPipeline:
    """A scene's models in floating point.

    network : the pixel network; background : (H, W, C) uint8, the no-contact reference frame
    rest_depth_mm : (H, W) depth of the undeformed skin, the boundary prior of the solver
    force_weights : kernels (axes, N, N, K, K) or weights (axes, N, N, terms) in N per mm or, for a
        force of slopes, their weights (axes, H, W, 2) in N; None without force
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
        network = pixel_normals.PixelNetwork.from_arrays(arrays)
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
    def frame_network(self) -> FrameNetwork:
        """The network on frames: the features' scales are multiplied into the first layer."""
        scale, tables = scales(self.background.shape[-1]), []
        for layer in self.network.linear_layers:
            weight = layer.weight.detach().numpy() * scale
            bias = layer.bias.detach().numpy()
            tables.append(np.column_stack([weight, bias]).astype(np.float32))
            scale = 1
        return FrameNetwork(tables, self.background, smoothing_px=self.scene.network.smoothing_px)

    @property
    def pixel_weights(self) -> np.ndarray:
        """The skin's force weights, one a pixel and term: kernels collapsed, all others as they are."""
        of_kernels = self.force_weights.ndim == KERNELS_NDIM
        return collapse(self.force_weights) if of_kernels else self.force_weights

    @cached_property
    def after(self) -> AfterSlopes:
        """The tables behind the slopes."""
        return AfterSlopes(self)

    @cached_property
    def _idle(self) -> IdleWorkers:
        return IdleWorkers()

    def rest_slopes(self) -> np.ndarray:
        """The slopes that the network gives for the background frame, (H, W, 2)."""
        slopes = np.empty((1, *self.background.shape[:2], 2), np.float32)
        Worker(self, frozenset(["slopes"]))(self.background[None], {"slopes": slopes})
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

    @cached_property
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
        The scene must have a depth solver, and a force, if any, of the displacement.
        """
        one, after = (1, *self.background.shape[:2]), self.after
        slopes, worker = np.empty((*one, 2), np.float32), Worker(self, frozenset(["slopes"]))
        solver = Worker(self, frozenset(["displacement_mm"]))

        def normals(frame: np.ndarray) -> np.ndarray:
            worker(frame[None], {"slopes": slopes})
            return slopes[0]

        def force(displacement_mm: np.ndarray) -> np.ndarray:
            if not self.scene.force.signed:
                np.maximum(displacement_mm, 0, out=displacement_mm)
            return after.force_n(displacement_mm)

        found = {"normals": normals, "depth": solver.displacement_mm}
        return found if self.force_weights is None else found | {"force": force}

    def run(
        self, frames: np.ndarray, *, wanted: Iterable[str] | None = None, progress: bool = False
    ) -> Result:
        """Process frames (frames, H, W, C) uint8; returns all outputs of the scene, or the fields `wanted`.

        Raises ValueError on frames of another shape or type, or an unknown field.
        """
        outputs = choose_outputs(self.outputs, wanted)
        require_frames(frames, self.background)
        with self._idle.lent(partial(Worker, self), frozenset(outputs)) as worker:
            return Result(**over_frames(worker, frames, outputs, progress=progress, label="float pipeline"))
