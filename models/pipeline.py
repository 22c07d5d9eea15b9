"""The whole way from frames to force, in floating point and in integers."""

from dataclasses import dataclass, field, replace

import numpy as np
from tqdm import tqdm

from fastac.scene import Scene

from .bounds import Solver
from .features import integer_features
from .integer import (
    Depth,
    DisplacementQuantiser,
    GradientRatio,
    Layer,
    PatchForce,
    PoissonSource,
    WeightedSum,
)
from .tridiagonal import TridiagonalSolver

CHUNK = 16
"""Frames that are under way at once; bounds the memory."""


@dataclass(frozen=True, eq=False)
class Result:
    """What a pipeline finds in frames; what the scene does not want is None.

    normals (frames, H, W, 3) unit; slopes (frames, H, W, 2); depth_mm (frames, H, W), the prior on the
    boundary; displacement_mm (frames, N, N) towards the camera, positive in contact; force_n (frames, axes)
    and force_map_n (frames, axes, N, N), of the scene's axes.
    Integer pipelines add raw words: depth_words (frames, N, N), force_raw (frames, axes), force_map_raw
    (frames, axes, N, N), normal_words (frames, H, W, 3), and how many values saturated in each frame.
    """

    normals: np.ndarray
    slopes: np.ndarray
    depth_mm: np.ndarray | None = None
    displacement_mm: np.ndarray | None = None
    force_n: np.ndarray | None = None
    force_map_n: np.ndarray | None = None
    normal_words: np.ndarray | None = None
    depth_words: np.ndarray | None = None
    displacement_words: np.ndarray | None = None
    force_raw: np.ndarray | None = None
    force_map_raw: np.ndarray | None = None
    gradient_saturated: np.ndarray | None = None
    displacement_saturated: np.ndarray | None = None


def join(results: list[Result]) -> Result:
    """Results of consecutive frames as one."""
    return Result(
        **{
            name: None
            if getattr(results[0], name) is None
            else np.concatenate([getattr(r, name) for r in results])
            for name in Result.__dataclass_fields__
        }
    )


def in_chunks(run, frames: np.ndarray, *, progress: bool, label: str) -> Result:
    """`run` over frames in chunks, with a progress bar."""
    if not len(frames):
        raise ValueError("frames: none to process")
    bar = tqdm(total=len(frames), desc=label, unit="frame", disable=not progress, leave=False)
    results = []
    for start in range(0, len(frames), CHUNK):
        results.append(run(frames[start : start + CHUNK]))
        bar.update(len(frames[start : start + CHUNK]))
    bar.close()
    return join(results)


def with_boundary(inner: np.ndarray, rest_depth_mm: np.ndarray) -> np.ndarray:
    """Inner depths (frames, N, N) in mm framed by the prior, (frames, H, W)."""
    depth = np.broadcast_to(rest_depth_mm, (len(inner), *rest_depth_mm.shape)).copy()
    depth[:, 1:-1, 1:-1] = inner
    return depth


@dataclass(frozen=True, eq=False)
class IntegerPipeline:
    """Every integer table of one sensor's model; calling `run` is what the hardware does.

    Absent stages (None) are those that the scene does not want.
    """

    scene: Scene
    layers: tuple[Layer, ...]
    ratio: GradientRatio
    background: np.ndarray  # (H, W, C) uint8
    rest_depth_mm: np.ndarray  # (H, W), the skin at rest; its rim is the boundary prior
    source: PoissonSource | None = None
    solver: Solver | TridiagonalSolver | None = None
    depth: Depth | None = None
    quantiser: DisplacementQuantiser | None = None
    force: PatchForce | WeightedSum | None = None  # on the displacement or, for the adjoint, on the slopes
    force_n_per_unit: np.ndarray | None = None  # s_F, (axes,)
    provenance: dict = field(default_factory=dict)

    def replace(self, **changes) -> "IntegerPipeline":
        return replace(self, **changes)

    @property
    def depth_mm_per_unit(self) -> float:
        """mm of one unit of depth and of unquantised displacement."""
        return self.scene.sensor.pitch_mm * 2.0**-self.solver.depth_format.fraction

    @property
    def displacement_mm_per_unit(self) -> float:
        """mm of one unit of the quantised displacement, 1/s_d."""
        return self.depth_mm_per_unit * 2.0**self.quantiser.shift

    def normals(self, frames: np.ndarray) -> np.ndarray:
        """Frames (..., H, W, C) uint8 to the network's three outputs, (..., H, W, 3) int64."""
        x = integer_features(frames, self.background)
        shape = x.shape[:-1]
        x = x.reshape(-1, x.shape[-1])
        for layer in self.layers:
            x = layer(x)
        return x.reshape(*shape, 3)

    def slopes(self, normal_words: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The network's outputs to slopes (..., H, W, 2) in words, and which of them saturated."""
        return self.ratio(normal_words)

    def run(self, frames: np.ndarray, *, progress: bool = False) -> Result:
        """Frames (frames, H, W, C) uint8 to everything that the scene wants."""
        return in_chunks(self._run, frames, progress=progress, label="integer pipeline")

    def _run(self, frames: np.ndarray) -> Result:
        words = self.normals(frames)
        slopes, saturated = self.slopes(words)
        length = np.linalg.norm(words.astype(np.float64), axis=-1, keepdims=True)
        found = {
            "normals": (words / np.maximum(length, 1)).astype(np.float32),
            "slopes": (slopes * 2.0**-self.ratio.fraction).astype(np.float32),
            "normal_words": words.astype(np.int32),
            "gradient_saturated": saturated.sum(axis=(1, 2, 3)),
        }
        if self.solver is not None:
            depth, displacement = self.depth(self.solver(self.source(slopes)))
            found |= {
                "depth_words": depth,
                "depth_mm": with_boundary(depth * self.depth_mm_per_unit, self.rest_depth_mm).astype(
                    np.float32
                ),
                "displacement_mm": (displacement * self.depth_mm_per_unit).astype(np.float32),
            }
        if self.quantiser is not None:
            quantised, over = self.quantiser(displacement)
            found |= {"displacement_words": quantised, "displacement_saturated": over.sum(axis=(1, 2))}
        if self.force is not None:
            raw = self._force(found.get("displacement_words"), slopes)
            found |= {"force_raw": raw, "force_n": raw * self.force_n_per_unit}
        if self.scene.wants_force_map and self.force is not None:
            raw = self.force.force_map(found["displacement_words"])
            in_n = raw * self.force_n_per_unit[:, None, None]
            found |= {"force_map_raw": raw, "force_map_n": in_n.astype(np.float32)}
        return Result(**found)

    def _force(self, displacement: np.ndarray | None, slopes: np.ndarray) -> np.ndarray:
        if isinstance(self.force, PatchForce):
            return self.force(displacement)
        return self.force(slopes if displacement is None else displacement[..., None])
