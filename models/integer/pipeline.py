"""All integer tables of one sensor's model: what a bundle holds and the hardware is elaborated from."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fastac.models.integer.depth import Depth, DisplacementQuantiser
from fastac.models.integer.dot_follower import DotFollower
from fastac.models.integer.dot_force import DotForce
from fastac.models.integer.dot_spread import DotSpread, spread_words
from fastac.models.integer.features import integer_features
from fastac.models.integer.force import PatchForce, WeightedSum
from fastac.models.integer.force_interval import ForceInterval
from fastac.models.integer.frame_validity import FrameValidity
from fastac.models.integer.light_level import followed
from fastac.models.integer.network import GradientRatio, Layer
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.models.integer.solver_base import IntegerSolver
from fastac.models.integer.source import PoissonSource
from fastac.models.integer.words import signed_width
from fastac.scenes.schema import Scene


@dataclass(frozen=True, eq=False)
class IntegerPipeline:
    """Every integer table of one sensor's model; `models/emulator` runs frames through them.

    Absent stages (None) are those that the scene does not want.
    """

    scene: Scene
    layers: tuple[Layer, ...]
    ratio: GradientRatio
    background: np.ndarray  # (H, W, C) uint8
    rest_depth_mm: np.ndarray  # (H, W), the skin at rest; its rim is the boundary prior
    validity: FrameValidity
    source: PoissonSource | None = None
    solver: IntegerSolver | None = None
    depth: Depth | None = None
    quantiser: DisplacementQuantiser | None = None
    force: PatchForce | WeightedSum | None = None  # of the displacement or of the slopes
    force_n_per_unit: np.ndarray | None = None  # s_F, (axes,)
    bridge: SlopeBridge | None = None
    follower: DotFollower | None = None
    dot_force: DotForce | None = None  # added to `force`
    interval: ForceInterval | None = None  # around each force
    provenance: dict = field(default_factory=dict)

    def replace(self, **changes) -> "IntegerPipeline":
        return replace(self, **changes)

    @property
    def hidden(self) -> tuple[int, ...]:
        """Neurons of each of the pixel network's hidden layers; pruning keeps fewer than the scene asks."""
        return tuple(len(layer.weight) for layer in self.layers[:-1])

    @property
    def depth_mm_per_unit(self) -> float:
        """mm of one unit of depth and of unquantised displacement."""
        return self.scene.sensor.pitch_mm * 2.0**-self.solver.depth_format.fraction

    @property
    def displacement_mm_per_unit(self) -> float:
        """mm of one unit of the quantised displacement, 1/s_d."""
        return self.depth_mm_per_unit * 2.0**self.quantiser.shift

    @property
    def bends(self) -> tuple[int, ...]:
        """The scene's `force.bends_mm` in words of the displacement."""
        if self.quantiser is None:
            return ()
        return tuple(round(bend / self.displacement_mm_per_unit) for bend in self.scene.force.bends_mm)

    @cached_property
    def spread(self) -> DotSpread | None:
        """What finds the spread of the touching dots' shifts, where the scene wants it and the displacement's
        words are known."""
        if not self.scene.wants_slip or self.quantiser is None or self.follower is None:
            return None
        contact = round(self.scene.slip.contact_mm / self.displacement_mm_per_unit)
        return DotSpread.of_follower(self.follower, min(contact, self.quantiser.top))

    @property
    def slip_limit(self) -> int:
        """The scene's `slip.limit_px` in words of the spread."""
        return spread_words(self.scene.slip.limit_px)

    @property
    def force_bound(self) -> int:
        """The largest magnitude of a raw force accumulator, with the dots' share."""
        return self.force.bound + (self.dot_force.bound if self.dot_force is not None else 0)

    @property
    def force_width(self) -> int:
        """Bits of a raw force accumulator."""
        return signed_width(self.force_bound)

    def seen(self, frames: np.ndarray) -> np.ndarray:
        """Consecutive frames (frames, H, W, C) uint8 as the hardware's stages see them after a reset: with
        `sensor.level_light` shifted as the frames before them say, else as they come."""
        return followed(frames, self.background)[0] if self.scene.sensor.level_light else frames

    def normals(self, frames: np.ndarray) -> np.ndarray:
        """Frames (..., H, W, C) uint8 to the network's three outputs, (..., H, W, 3) int64."""
        x = integer_features(frames, self.background, self.scene.network.smoothing_px)
        shape = x.shape[:-1]
        x = x.reshape(-1, x.shape[-1])
        for layer in self.layers:
            x = layer(x)
        return x.reshape(*shape, 3)

    def slopes(self, normal_words: np.ndarray, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The network's outputs and the frames that they are of to slopes (..., H, W, 2) in words, and which
        of them saturated."""
        slopes, saturated = self.ratio(normal_words)
        if self.bridge is None:
            return slopes, saturated
        dark = self.bridge.dark(frames)
        return self.bridge(slopes, dark), self.bridge(saturated, dark)

    def slopes_of(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frames (..., H, W, C) uint8 to `slopes`."""
        return self.slopes(self.normals(frames), frames)
