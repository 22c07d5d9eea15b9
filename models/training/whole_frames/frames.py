"""Frames that a pixel network is trained on as a whole, and its loss on them: normals, depth and force."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from fastac.models.integer.dot_follower import FRACTION
from fastac.models.integer.features import integer_features, scales
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.models.training.normals import normal_loss
from fastac.models.training.whole_frames.depth_of_slopes import DepthOfSlopes, slopes_of
from fastac.models.training.whole_frames.force_features import OfDisplacement, OfSlopes
from fastac.models.training.whole_frames.held_out_force import HeldOutForce
from fastac.models.training.whole_frames.pixel_grid import WHOLE, Grid, every
from fastac.models.vision.dots import follower_of, slope_bridge
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset

PREPARED_FRAMES = 8
"""At a time, where all frames are looked at before an epoch: few take little memory."""
SEEN_PX = 64
"""Rows and columns of a frame that a step sees at least, at equal distances, where no depth is learned. Of
128 × 128 pixels it sees a quarter, in half of the time, and the force is no worse."""


def some_at_a_time(index: np.ndarray, count: int) -> list[np.ndarray]:
    """The frames `index` in their order, so many at a time, the last time what is left."""
    return np.split(index, range(count, len(index), count))


@dataclass(frozen=True, eq=False)
class WholeFrames:
    """Frames with the depth of every pixel, the force, or both, as the scene learns from them.

    data : with all depths, or the forces; skin : the same frames, with those normals valid that are learned
    from; rest_depth_mm : (H, W)
    """

    data: Dataset
    skin: Dataset
    scene: Scene
    rest_depth_mm: np.ndarray

    def index(self, split: str) -> np.ndarray:
        """The frames of a split that have something to learn from."""
        return self.data.indices(split)

    @cached_property
    def _depth(self) -> DepthOfSlopes:
        return DepthOfSlopes(self.scene, self.rest_depth_mm)

    @cached_property
    def _bridge(self) -> SlopeBridge | None:
        """Of the slopes under the background's dots, if the scene wants it."""
        return slope_bridge(self.data.background, self.scene)

    @cached_property
    def _bridged_columns(self) -> np.ndarray:
        """Of all frames and, at last, of the background, as `seen`, (frames + 1, H, W) unsigned."""
        known, kind = (*self.data.frames, self.data.background), np.min_scalar_type(self.data.frames.shape[2])
        return np.stack([self._bridge.columns(self._bridge.dark(frame)).astype(kind) for frame in known])

    @cached_property
    def _force(self) -> HeldOutForce:
        return HeldOutForce.of(self.data, self.scene.force_axes, self.index("train"))

    def prepare(self, model: torch.nn.Module) -> None:
        """Fit what of the loss follows from the model, before each epoch: the weights of the force, to as
        many pixels as a step sees."""
        if not self.scene.training.force_weight:
            return
        learned, training = self._force.learned, model.training
        model.eval()
        grid, parts = every(self._stride), some_at_a_time(learned, PREPARED_FRAMES)
        self._force.refit(torch.cat([self.features(model, part, grid) for part in parts]))
        model.train(training)

    @property
    def _stride(self) -> int:
        """Distance of the rows and columns that a step sees; the solver takes all of them."""
        if self._solves:
            return 1
        return max(1, min(self.data.frames.shape[1:3]) // SEEN_PX)

    def _drawn_grid(self, model: torch.nn.Module) -> Grid:
        """The pixels that the loss of a model is of: all where it is judged, else from a chance one on."""
        if not model.training or self._stride == 1:
            return WHOLE
        return every(self._stride, *torch.randint(self._stride, (2,)).tolist())

    def _found(
        self, model: torch.nn.Module, index: np.ndarray, grid: Grid = WHOLE
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """What the model finds at the pixels of a grid (h, w): normals (frames, h, w, 3); slopes
        (frames, h, w, 2), bridged where the scene wants it; and slopes at rest (h, w, 2)."""
        x, columns = self.seen(index, grid)
        normals = model(x.flatten(0, 2)).reshape(*x.shape[:3], 3)
        slopes = self.slopes(normals, columns)
        return normals[:-1], slopes[:-1], slopes[-1]

    def seen(self, index: np.ndarray, grid: Grid = WHOLE) -> tuple[torch.Tensor, torch.Tensor | None]:
        """What a model is given of the frames `index` and, after them, the background at the pixels of a
        grid: scaled features (frames + 1, h, w, inputs); and, where slopes are bridged, the columns that
        pixels take theirs from (frames + 1, h, w), in a grid of all columns."""
        frames = np.concatenate([self.data.frames[index], self.data.background[None]])
        features = integer_features(frames, self.data.background, self.scene.network.smoothing_px)
        features = features[:, *grid]
        x = torch.from_numpy(features.astype(np.float32)) * unit(features)
        if self._bridge is None:
            return x, None
        columns = self._bridged_columns[[*index, -1]][:, *grid]
        return x, torch.from_numpy(columns.astype(np.int64))

    def slopes(self, normals: torch.Tensor, columns: torch.Tensor | None) -> torch.Tensor:
        """Slopes (..., h, w, 2) of normals (..., h, w, 3) of any length; columns (..., h, w) as in `seen`."""
        found = slopes_of(normals, self.scene.numbers.slope_limit)
        return found if columns is None else torch.take_along_dim(found, columns[..., None], dim=-2)

    def features(self, model: torch.nn.Module, index: np.ndarray, grid: Grid = WHOLE) -> torch.Tensor:
        """What the force of frames is linear in as the model finds it at the pixels of a grid, (frames,
        features)."""
        with torch.no_grad():
            _, slopes, at_rest = self._found(model, index, grid)
            depth_px = None if self.of_slopes else self._depth(slopes, at_rest)
            return self._force_features(slopes, at_rest, depth_px, grid)

    def _true(self, depth_mm: np.ndarray) -> torch.Tensor:
        """Depth (..., H, W) in mm as that of inner pixels (..., N, N) in pixels, in difference mode less that
        at rest."""
        depth_mm = depth_mm.astype(np.float64)
        if self.scene.poisson.mode == "difference":
            depth_mm = depth_mm - self.rest_depth_mm
        found = depth_mm[..., 1:-1, 1:-1] / self.scene.sensor.pitch_mm
        return torch.from_numpy(found.astype(np.float32))

    def _normals_loss(
        self, model: torch.nn.Module, index: np.ndarray, normals: torch.Tensor, grid: Grid = WHOLE
    ) -> torch.Tensor:
        """`normal_loss` of the pixels of the frames that are learned from."""
        known = np.ones(normals.shape[:3], bool)
        if self.skin.valid is not None:
            known = self.skin.valid[index][:, *grid]
        truth = torch.from_numpy(self.skin.normals[index][:, *grid][known].astype(np.float32))
        return normal_loss(normals[torch.from_numpy(known)], truth, self.scene.training.huber_delta)

    def _depth_error(self, depth_px: torch.Tensor, index: np.ndarray) -> torch.Tensor:
        """The mean squared error of depth, px²."""
        return (depth_px - self._true(self.data.depth_mm[index])).square().mean()

    def loss(self, model: torch.nn.Module, index: np.ndarray) -> torch.Tensor:
        """L_n + w_d · L_d + w_f · L_f of the frames `index`: `normal_loss`; weighted by
        `training.depth_weight` the mean squared error of depth in pixels; weighted by `training.force_weight`
        the error of the force in N, as `HeldOutForce.error`.

        model : from scaled features (pixels, inputs) to normals (pixels, 3) of any length
        """
        settings, grid = self.scene.training, self._drawn_grid(model)
        normals, slopes, at_rest = self._found(model, index, grid)
        depth_px = self._depth(slopes, at_rest) if self._solves else None
        loss = self._normals_loss(model, index, normals, grid)
        if settings.depth_weight:
            loss = loss + settings.depth_weight * self._depth_error(depth_px, index)
        if settings.force_weight:
            features = self._force_features(slopes, at_rest, depth_px, grid)
            loss = loss + settings.force_weight * self._force.error(features, index)
        return loss

    def dot_shifts_px(self, index: np.ndarray) -> np.ndarray | None:
        """Shifts of the marker dots (frames, M, 2), where the force follows from them, too."""
        if not self.scene.force.dots:
            return None
        return self._dot_shifts_px[index]

    @cached_property
    def _dot_shifts_px(self) -> np.ndarray:
        """Of all frames; no model changes them."""
        follower = follower_of(self.data.background, self.scene.sensor)
        shifts = [follower(follower.windows(frame))[0] for frame in self.data.frames]
        return np.stack(shifts) * 2.0**-FRACTION

    @property
    def _solves(self) -> bool:
        """Whether the loss needs the depth."""
        settings = self.scene.training
        return bool(settings.depth_weight or (settings.force_weight and not self.of_slopes))

    @cached_property
    def of_slopes(self) -> OfSlopes | None:
        """Features of a force that is a sum of slopes, if it is one."""
        return OfSlopes(self.data.frames.shape[1:3]) if self.scene.fit_facts.of_slopes else None

    @cached_property
    def _of_displacement(self) -> OfDisplacement:
        force = self.scene.force
        return OfDisplacement(self.scene.inner_px, force.kernel_size, clamp=force.clamp)

    def _force_features(
        self, slopes: torch.Tensor, at_rest: torch.Tensor, depth_px: torch.Tensor | None, grid: Grid
    ) -> torch.Tensor:
        """What the force is linear in; depth_px : that of the slopes, where it is no sum of them."""
        if self.of_slopes:
            return self.of_slopes(slopes - at_rest, grid)
        displacement_px = -depth_px
        if self.scene.poisson.mode != "difference":  # else depth at rest is zero
            displacement_px = displacement_px + self._depth(at_rest[None], at_rest)
        return self._of_displacement(displacement_px)


def unit(features: np.ndarray) -> torch.Tensor:
    """The scales of features (..., inputs), (inputs,)."""
    return torch.from_numpy(scales(features.shape[-1] - 2).astype(np.float32))
