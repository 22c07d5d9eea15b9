"""Frames of which not every pixel is labelled, and those of ball presses, to train a pixel network on.

Of a recorded ball press the depth is known under the ball, up to a constant.
"""

from functools import cached_property

import numpy as np
import torch

from fastac.models.integer.features import COORDINATE_SCALE
from fastac.models.training.labelled_pixels import training_pixels
from fastac.models.training.normals import normal_loss
from fastac.models.training.whole_frames.frames import WholeFrames, unit
from fastac.models.training.whole_frames.pixel_grid import WHOLE, Grid
from fastac.sensor.contact_circle import contact_circle, is_whole

DRAWN_PX = 8192
"""Labelled pixels of a step, beside the frames that are learned from as a whole."""


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
        seen = (seen + noise * torch.randn(seen.shape)) * unit(x)
        return normal_loss(model(seen), y[drawn], self.scene.training.huber_delta)


class BallContacts(PartlyLabelled):
    """Frames of ball presses, of which the depth is known up to a constant, and inside contact circles alone.

    Where the skin lies against a ball of radius R its height is −√(R² − r²) plus what was not measured. Of
    each frame the mean difference over the circle, less `training.circle_margin`, is taken away before errors
    are squared, as `accuracy.contact_depth_mae_mm` does. A circle that reaches beyond the photograph says
    nothing of the depth.
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
        if not np.isfinite(radius_mm) or not is_whole(self.data, sample):
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
