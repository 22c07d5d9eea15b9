"""The whole way from frames to force, in floating point and in integers."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from fastac.models import direct
from fastac.models.bounds import Solver
from fastac.models.emulator import Emulator
from fastac.models.emulator_solver import NotExactError
from fastac.models.features import integer_features
from fastac.models.integer import (
    Depth,
    DisplacementQuantiser,
    GradientRatio,
    Layer,
    PatchForce,
    PoissonSource,
    WeightedSum,
)
from fastac.models.over_frames import CHUNK as CHUNK
from fastac.models.over_frames import choose, over_frames, require_frames
from fastac.models.tridiagonal import TridiagonalSolver
from fastac.models.validity import FrameValidity
from fastac.scenes.schema import Scene


@dataclass(frozen=True, eq=False)
class Result:
    """What a pipeline finds in frames; what the scene, or the caller, does not want is None.

    normals (frames, H, W, 3) unit; slopes (frames, H, W, 2); depth_mm (frames, H, W), the prior on the
    boundary; displacement_mm (frames, N, N) towards the camera, positive in contact; force_n (frames, axes)
    and force_map_n (frames, axes, N, N), of the scene's axes.
    Integer pipelines add raw words: depth_words (frames, N, N), force_raw (frames, axes), force_map_raw
    (frames, axes, N, N), normal_words (frames, H, W, 3), how many values saturated in each frame, and whether
    it can be trusted: validity_measures (frames, measures) and the flags validity (frames,), see
    `validity.FrameValidity`.
    """

    normals: np.ndarray | None = None
    slopes: np.ndarray | None = None
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
    validity_measures: np.ndarray | None = None
    validity: np.ndarray | None = None


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
    validity: FrameValidity
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

    @cached_property
    def _worker(self) -> Callable[[frozenset[str]], Callable]:
        """What computes the given outputs, made once in each thread: the emulator where it is exact."""
        try:
            return Emulator(self).worker
        except NotExactError:
            return lambda _: partial(direct.loop, self)

    def run(
        self, frames: np.ndarray, *, wanted: Iterable[str] | None = None, progress: bool = False
    ) -> Result:
        """Frames (frames, H, W, C) uint8 to all that the scene wants, or to the fields `wanted`.

        Equal to `direct.loop` on every value.
        """
        outputs = choose(direct.outputs(self), wanted)
        require_frames(frames, self.background)
        found = over_frames(
            partial(self._worker, frozenset(outputs)),
            frames,
            outputs,
            progress=progress,
            label="integer pipeline",
        )
        return Result(**found)
