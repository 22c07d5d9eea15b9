"""The float models from frames to force: what quantisation is measured against."""

from dataclasses import dataclass

import numpy as np
import torch

from fastac.scene import Scene

from . import normals as pixel_normals
from .bundle import Bundle
from .features import integer_features
from .hyperforce import collapse, force_map
from .pipeline import Result, in_chunks, with_boundary
from .poisson import boundary_term, solve, source_of


@dataclass(frozen=True, eq=False)
class FloatPipeline:
    """network; the force's kernels (axes, N, N, K, K) in N per mm or, for the adjoint, weights of the slopes
    (axes, H, W, 2) in N, or None; see IntegerPipeline for the rest."""

    scene: Scene
    network: pixel_normals.PixelNetwork
    background: np.ndarray
    rest_depth_mm: np.ndarray
    force_weights: np.ndarray | None = None

    @classmethod
    def from_arrays(
        cls, arrays: dict[str, np.ndarray], scene: Scene, background: np.ndarray, rest_depth_mm: np.ndarray
    ) -> "FloatPipeline":
        """From a bundle's floats: `network.k.weight`, `network.k.bias`, maybe `force.float_weights`."""
        count = sum(k.startswith("network.") and k.endswith(".weight") for k in arrays)
        weights = [torch.from_numpy(arrays[f"network.{k}.weight"]) for k in range(count)]
        network = pixel_normals.PixelNetwork(
            weights[0].shape[1], tuple(len(weight) for weight in weights[:-1])
        )
        with torch.no_grad():
            for k, (layer, weight) in enumerate(zip(network.linears, weights, strict=True)):
                layer.weight.copy_(weight)
                layer.bias.copy_(torch.from_numpy(arrays[f"network.{k}.bias"]))
        return cls(scene, network, background, rest_depth_mm, arrays.get("force.float_weights"))

    @classmethod
    def from_bundle(cls, bundle: Bundle) -> "FloatPipeline":
        pipeline = bundle.pipeline
        return cls.from_arrays(bundle.floats, bundle.scene, pipeline.background, pipeline.rest_depth_mm)

    def slopes(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frames (..., H, W, C) uint8 to normals of any length and slopes."""
        normal = pixel_normals.predict(self.network, integer_features(frames, self.background))
        return normal, pixel_normals.slopes_of(normal, self.scene.numbers.slope_limit)

    def rest_slopes(self) -> np.ndarray:
        """The slopes that are found at rest, (H, W, 2)."""
        return self.slopes(self.background[None])[1][0]

    def _solve(self, slopes: np.ndarray) -> np.ndarray:
        """Slopes (frames, H, W, 2) to depth in px, in the scene's mode."""
        divergence, pitch = self.scene.poisson.divergence, self.scene.sensor.pitch_mm
        source = source_of(slopes, divergence)
        if self.scene.poisson.mode == "absolute":
            return solve(source - boundary_term(self.rest_depth_mm / pitch))
        rest = source_of(self.rest_slopes(), divergence)
        return solve(source - rest) + self.rest_depth_mm[1:-1, 1:-1] / pitch

    def rest_px(self) -> np.ndarray:
        """What the pipeline finds at rest, (N, N) in px: the zero of the displacement."""
        if self.scene.poisson.mode == "difference":
            return self.rest_depth_mm[1:-1, 1:-1] / self.scene.sensor.pitch_mm
        return self._solve(self.rest_slopes()[None])[0]

    def displacement_mm(self, slopes: np.ndarray) -> np.ndarray:
        """Slopes (frames, H, W, 2) to the displacement (frames, N, N)."""
        return (self.rest_px() - self._solve(slopes)) * self.scene.sensor.pitch_mm

    def run(self, frames: np.ndarray, *, progress: bool = False) -> Result:
        """Frames (frames, H, W, C) uint8 to everything that the scene wants."""
        scene, weights = self.scene, self.force_weights
        pitch = scene.sensor.pitch_mm
        rest = self.rest_px() if scene.wants_solver else None
        rest_slopes = self.rest_slopes() if scene.wants_adjoint else None
        collapsed = collapse(weights) if weights is not None and scene.wants_solver else None

        def run(chunk: np.ndarray) -> Result:
            normal, slopes = self.slopes(chunk)
            length = np.linalg.norm(normal, axis=-1, keepdims=True)
            found = {
                "normals": (normal / np.maximum(length, 1e-12)).astype(np.float32),
                "slopes": slopes.astype(np.float32),
            }
            if scene.wants_solver:
                depth = self._solve(slopes)
                displacement = (rest - depth) * pitch
                found |= {
                    "depth_mm": with_boundary(depth * pitch, self.rest_depth_mm).astype(np.float32),
                    "displacement_mm": displacement.astype(np.float32),
                }
                if collapsed is not None:
                    pressed = np.maximum(displacement, 0) if scene.force.clamp else displacement
                    found["force_n"] = np.einsum("...ij,aij->...a", pressed, collapsed)
                    if scene.wants_force_map:
                        found["force_map_n"] = force_map(pressed, weights).astype(np.float32)
            if scene.wants_adjoint and weights is not None:
                found["force_n"] = np.einsum("...ijt,aijt->...a", slopes - rest_slopes, weights)
            return Result(**found)

        return in_chunks(run, frames, progress=progress, label="float pipeline")
