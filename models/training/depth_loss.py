"""Training on whole frames, for depth as well as for normals.

Where noise hides a pixel's slope, the best guess of its normal is too flat, and the depth, which sums slopes
over many pixels, lacks what all of them lack. What noise adds to the slopes cancels in that sum. So the
network is trained on, with the depth's error beside that of the normals: slopes become noisier and less
flat. The hardware stays the same.
"""

from dataclasses import dataclass

import numpy as np
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.floating.threads import single_thread
from fastac.models.integer.features import integer_features, scales
from fastac.models.integer.laplacian import STENCILS, boundary_term, divergence_of, eigenvalues, sine_matrix
from fastac.models.training.best_epoch import BestEpoch
from fastac.models.training.normals import normal_loss
from fastac.models.training.one_cycle import one_cycle
from fastac.models.training.rounding_noise import with_rounding_noise
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.store.progress import progress_bar

BATCH_FRAMES = 4
"""Of a step. A step of so many frames of 128 × 128 pixels sees eight times as many pixels as one of
`training.normals_batch_px`, but neighbours are much alike."""
SMALLEST_NORMAL_Z = 1e-6
"""By which components are divided at least, so that no gradient is infinite."""


def slopes_of(normal: torch.Tensor, limit: float) -> torch.Tensor:
    """Normals (..., 3) of any length to slopes (..., 2), as `floating.network.slopes_of`; differentiable."""
    n_z = normal[..., 2:]
    slopes = -normal[..., :2] / n_z.clamp_min(SMALLEST_NORMAL_Z)
    return torch.where(n_z > 0, slopes, -normal[..., :2].sign() * limit).clamp(-limit, limit)


class Surface:
    """The solver's depth of slopes, (frames, H, W, 2) to (frames, N, N) in pixels; differentiable.

    In the scene's mode: from the skin at rest's depth on the boundary or, in difference mode, less what the
    slopes at rest give. The paper's transform (models/floating/poisson.py) as products of matrices.
    """

    def __init__(self, scene: Scene, rest_depth_mm: np.ndarray):
        """rest_depth_mm : (H, W)"""
        size = scene.inner_px

        def constant(values: np.ndarray) -> torch.Tensor:
            return torch.from_numpy(values.astype(np.float32))

        self.divergence = scene.poisson.divergence
        self.sine, self.reciprocal = constant(sine_matrix(size)), constant(1 / eigenvalues(size))
        self.absolute = scene.poisson.mode == "absolute"
        self.boundary = constant(boundary_term(rest_depth_mm / scene.sensor.pitch_mm))

    def __call__(self, slopes: torch.Tensor, at_rest: torch.Tensor) -> torch.Tensor:
        """slopes : (frames, H, W, 2); at_rest : (H, W, 2), those that are found at rest"""
        if not self.absolute:
            slopes = slopes - at_rest
        source = divergence_of(slopes, self.divergence) * STENCILS[self.divergence].scale
        if self.absolute:
            source = source - self.boundary
        return self.sine @ (self.sine @ source @ self.sine * self.reciprocal) @ self.sine


@dataclass(frozen=True, eq=False)
class WholeFrames:
    """Frames, one by one, with what a network should find in them.

    rest_depth_mm : (H, W); data : with depth of every pixel; skin : the same frames, with those normals
        valid that are learned from
    """

    data: Dataset
    skin: Dataset
    scene: Scene
    rest_depth_mm: np.ndarray

    def features(self, frames: np.ndarray) -> torch.Tensor:
        """Scaled features (frames, H, W, channels + 2)."""
        found = integer_features(frames, self.data.background, self.scene.network.smoothing_px)
        unit = scales(found.shape[-1] - 2)
        return torch.from_numpy(found.astype(np.float32) * unit.astype(np.float32))

    def normals(self, index: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
        """Unit normals (pixels, 3) of the pixels that are learned from, and which they are, (pixels,)."""
        known = np.ones(self.skin.frames.shape[:3], bool) if self.skin.valid is None else self.skin.valid
        chosen = known[index].reshape(-1)
        truth = self.skin.normals[index].reshape(-1, 3)[chosen].astype(np.float32)
        return torch.from_numpy(truth), torch.from_numpy(chosen)

    def depth_px(self, index: np.ndarray) -> torch.Tensor:
        """True depth (frames, N, N) in pixels; in difference mode less that at rest."""
        depth_mm = self.data.depth_mm[index].astype(np.float64)
        if self.scene.poisson.mode == "difference":
            depth_mm = depth_mm - self.rest_depth_mm
        inner = depth_mm[:, 1:-1, 1:-1] / self.scene.sensor.pitch_mm
        return torch.from_numpy(inner.astype(np.float32))


def require_depth(data: Dataset) -> None:
    """Raise ValueError, with the key at fault, where the depth of some pixels is not known."""
    if data.depth_mm is None:
        raise ValueError("depth_mm: missing, and training.depth_weight needs the depth of every pixel")
    if data.valid is not None and not data.valid.all():
        raise ValueError("valid: not every pixel is, and training.depth_weight needs the depth of each")


@single_thread()
def train(
    network: PixelNetwork,
    data: Dataset,
    skin: Dataset,
    scene: Scene,
    rest_depth_mm: np.ndarray,
    *,
    progress: bool = False,
) -> list[dict]:
    """Train `network` on with L_n + w · mean((d − d_true)²) for `training.depth_epochs`; returns the learning
    curve.

    L_n is `normal_loss`, w `training.depth_weight`, d the depth in pixels. The network itself is changed, and
    ends with the weights of the smallest error on the validation split or, without one, with the last. An
    epoch sees a share `training.normals_share` of the frames, chosen by chance.
    data, skin, rest_depth_mm : as in `WholeFrames`. Raises ValueError as `require_depth`.
    """
    require_depth(data)
    settings = scene.training
    frames, surface = WholeFrames(data, skin, scene, rest_depth_mm), Surface(scene, rest_depth_mm)
    at_rest = frames.features(data.background[None])
    torch.manual_seed(settings.seed)
    rng = np.random.default_rng((settings.seed, 2))  # other draws than those of the normals' training
    felt = with_rounding_noise(network, scene.felt_rounding_bits)

    def loss(index: np.ndarray) -> torch.Tensor:
        features = torch.cat([frames.features(data.frames[index]), at_rest])
        found = felt(features.reshape(-1, features.shape[-1])).reshape(*features.shape[:3], 3)
        truth, known = frames.normals(index)
        normals = normal_loss(found[:-1].reshape(-1, 3)[known], truth, settings.huber_delta)
        slopes = slopes_of(found, scene.numbers.slope_limit)
        error = surface(slopes[:-1], slopes[-1]) - frames.depth_px(index)
        return normals + settings.depth_weight * error.square().mean()

    def validation() -> float:
        felt.eval()
        index = data.indices("validation")
        parts = np.split(index, range(BATCH_FRAMES, len(index), BATCH_FRAMES))
        with torch.inference_mode():
            total = sum(loss(part).item() * len(part) for part in parts)
        felt.train()
        return total / len(index)

    train_index = data.indices("train")
    count = max(1, round(settings.normals_share * len(train_index)))
    steps = settings.depth_epochs * -(-count // BATCH_FRAMES)
    rate = settings.normals_learning_rate
    optimiser = torch.optim.AdamW(network.parameters(), lr=rate, weight_decay=0.0, fused=True)
    schedule = one_cycle(optimiser, rate, steps)
    judged, best, history = bool(len(data.indices("validation"))), BestEpoch(), []
    if judged:  # what it starts from counts too
        best.tell(validation(), network)
    bar = progress_bar(total=steps, desc="normals, with depth", unit="step", enabled=progress)
    for epoch in range(settings.depth_epochs):
        total, chosen = 0.0, rng.permutation(train_index)[:count]
        for index in np.split(chosen, range(BATCH_FRAMES, count, BATCH_FRAMES)):
            error = loss(index)
            optimiser.zero_grad(set_to_none=True)
            error.backward()
            optimiser.step()
            schedule.step()
            total += error.item() * len(index)
            bar.update()
        entry = {"epoch": epoch + 1, "train_loss": total / count}
        if judged:
            entry["validation_loss"] = validation()
            best.tell(entry["validation_loss"], network)
        history.append(entry)
        bar.set_postfix(loss=f"{entry.get('validation_loss', entry['train_loss']):.4f}")
    bar.close()
    best.restore(network)
    return history
