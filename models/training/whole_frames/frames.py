"""Frames that a pixel network is trained on as a whole, and its loss on them: normals, depth and force.

Of a virtual sensor the depth of the whole skin is known; of a recorded ball press its shape under the ball.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from fastac.models.integer.features import COORDINATE_SCALE, integer_features, scales
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.models.training.labelled_pixels import training_pixels
from fastac.models.training.normals import normal_loss
from fastac.models.training.whole_frames.depth_of_slopes import DepthOfSlopes, slopes_of
from fastac.models.training.whole_frames.held_out_force import HeldOutForce
from fastac.models.training.whole_frames.pixel_grid import WHOLE, Grid, every
from fastac.models.vision.dots import slope_bridge
from fastac.scenes.schema import Scene
from fastac.sensor.contact_circle import contact_circle
from fastac.sensor.dataset import Dataset

DRAWN_PX = 8192
"""Labelled pixels of a step, beside the frames that are learned from as a whole."""
PREPARED_FRAMES = 8
"""At a time, where all frames are looked at before an epoch: few take little memory."""
SEEN_PX = 64
"""Rows and columns of a frame that a step sees at least, at equal distances, where no depth is learned. Of
128 × 128 pixels it sees a quarter, in half of the time, and the force is no worse."""


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
    def _force(self) -> HeldOutForce:
        return HeldOutForce.of(self.data, self.scene.force_axes, self.index("train"))

    def prepare(self, model: torch.nn.Module) -> None:
        """Fit what of the loss follows from the model, before each epoch: the weights of the force."""
        if not self.scene.training.force_weight:
            return
        learned, training, grid = self._force.learned, model.training, every(self._stride)
        model.eval()
        with torch.no_grad():
            features = []
            for part in np.split(learned, range(PREPARED_FRAMES, len(learned), PREPARED_FRAMES)):
                _, slopes, at_rest = self._found(model, part, grid)
                features.append(self._force.features(slopes - at_rest, grid))
            self._force.refit(torch.cat(features))
        model.train(training)

    @property
    def _stride(self) -> int:
        """Distance of the rows and columns that a step sees; the depth takes all of them."""
        if self.scene.training.depth_weight:
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
        frames = np.concatenate([self.data.frames[index], self.data.background[None]])
        features = integer_features(frames, self.data.background, self.scene.network.smoothing_px)
        features = features[:, *grid]
        x = torch.from_numpy(features.astype(np.float32)) * _unit(features)
        normals = model(x.reshape(-1, x.shape[-1])).reshape(*x.shape[:3], 3)
        slopes = slopes_of(normals, self.scene.numbers.slope_limit)
        if self._bridge is not None:
            columns = torch.from_numpy(self._bridge.columns(self._bridge.dark(frames)))
            slopes = torch.take_along_dim(slopes, columns[..., None], dim=-2)
        return normals[:-1], slopes[:-1], slopes[-1]

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
        loss = self._normals_loss(model, index, normals, grid)
        if settings.depth_weight:
            loss = loss + settings.depth_weight * self._depth_error(self._depth(slopes, at_rest), index)
        if settings.force_weight:
            features = self._force.features(slopes - at_rest, grid)
            loss = loss + settings.force_weight * self._force.error(features, index)
        return loss


class PartlyLabelled(WholeFrames):
    """Frames of which not every pixel is labelled: the normals that count while the model is trained are of
    labelled pixels of all frames, disturbed as before."""

    @cached_property
    def _labelled(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Features and normals of the pixels that the network has learned from, and the noise added to
        features."""
        settings = self.scene.training
        x, y = training_pixels(self.skin, settings, self.scene.network.smoothing_px)
        noise = x.std(axis=0) * settings.input_noise
        noise[-2:] = settings.position_noise / COORDINATE_SCALE
        return torch.from_numpy(x), torch.from_numpy(y), torch.from_numpy(noise.astype(np.float32))

    def _normals_loss(
        self, model: torch.nn.Module, index: np.ndarray, normals: torch.Tensor, grid: Grid = WHOLE
    ) -> torch.Tensor:
        """Of a model that is judged, of the labelled pixels of the frames."""
        if not model.training:
            return super()._normals_loss(model, index, normals, grid)
        x, y, noise = self._labelled
        drawn = torch.randint(len(x), (DRAWN_PX,))
        seen = x[drawn].float()
        seen = (seen + noise * torch.randn(seen.shape)) * _unit(x)
        return normal_loss(model(seen), y[drawn], self.scene.training.huber_delta)


class BallContacts(PartlyLabelled):
    """Frames of ball presses, of which the depth is known up to a constant, and inside contact circles alone.

    Where the skin lies against a ball of radius R its height is −√(R² − r²) plus what was not measured. Of
    each frame the mean difference over the circle, less `training.circle_margin`, is taken away before errors
    are squared, as `accuracy.contact_depth_mae_mm` does.
    """

    def index(self, split: str) -> np.ndarray:
        """The frames of a split that show a ball's contact."""
        found = self.data.indices(split)
        return found[[bool(self._shape(sample)[1].any()) for sample in found]]

    def _shape(self, sample: int) -> tuple[np.ndarray, np.ndarray]:
        """The ball's surface (H, W) in mm, and where the skin lies against it, (H, W) bool; the border is
        left out."""
        circle, radius_mm = contact_circle(self.data, sample), self.data.indenter["ball_mm"][sample] / 2
        known = np.zeros(self.rest_depth_mm.shape, bool)
        if circle is None or not np.isfinite(radius_mm):
            return np.zeros(known.shape), known
        distance_px, radius_px = circle
        under = radius_mm**2 - (distance_px * self.scene.sensor.pitch_mm) ** 2
        within = (distance_px <= radius_px * (1 - self.scene.training.circle_margin)) & (under > 0)
        known[1:-1, 1:-1] = within[1:-1, 1:-1]
        if self.data.valid is not None:
            known &= self.data.valid[sample]
        return -np.sqrt(np.maximum(under, 0)), known

    def _depth_error(self, depth_px: torch.Tensor, index: np.ndarray) -> torch.Tensor:
        """The mean over frames of the variance of the error in the circle, px²."""
        errors = []
        for found, sample in zip(depth_px, index, strict=True):
            surface_mm, known = self._shape(sample)
            inside = torch.from_numpy(known[1:-1, 1:-1])
            errors.append((found - self._true(surface_mm))[inside].var(correction=0))
        return torch.stack(errors).mean()


def _unit(features) -> torch.Tensor:
    """The scales of features (..., inputs), (inputs,)."""
    return torch.from_numpy(scales(features.shape[-1] - 2).astype(np.float32))


def _whole(data: Dataset) -> bool:
    """Whether the depth of every pixel is known."""
    return data.depth_mm is not None and (data.valid is None or bool(data.valid.all()))


def unknown_depth(data: Dataset) -> str | None:
    """What a dataset lacks to learn depth from, with the key at fault; None: nothing."""
    if _whole(data):
        return None
    known = data.indenter or {}
    balls = np.isfinite(known["ball_mm"]) if "ball_mm" in known else np.zeros(len(data), bool)
    if any(balls[k] and contact_circle(data, k) is not None for k in data.indices("train")):
        return None
    lack = "depth_mm: missing" if data.depth_mm is None else "valid: not every pixel is"
    return (
        f"{lack}, and training.depth_weight needs the depth of every pixel, or contact circles of balls"
        " (indenter/radius_px, indenter/ball_mm); 0 does without"
    )


def whole_frames(data: Dataset, skin: Dataset, scene: Scene, rest_depth_mm: np.ndarray) -> WholeFrames:
    """The frames of a dataset, to learn from what the scene says; nothing is lacking for it
    (`unknown_depth`).

    skin : the dataset with those normals valid that are learned from; rest_depth_mm : (H, W)
    """
    apart = BallContacts if scene.training.depth_weight else PartlyLabelled
    return (WholeFrames if _whole(data) else apart)(data, skin, scene, rest_depth_mm)
