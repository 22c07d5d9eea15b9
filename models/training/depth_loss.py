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

    data : with the depth of every pixel (`unknown_depth`); skin : the same frames, with those normals valid
        that are learned from; rest_depth_mm : (H, W)
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


def unknown_depth(data: Dataset) -> str | None:
    """What a dataset lacks for the depth of every pixel, with the key at fault; None: nothing."""
    if data.depth_mm is None:
        return "depth_mm: missing, and training.depth_weight needs the depth of every pixel"
    if data.valid is not None and not data.valid.all():
        return "valid: not every pixel is, and training.depth_weight needs the depth of each"
    return None


def loss(model: torch.nn.Module, frames: WholeFrames, surface: Surface, index: np.ndarray) -> torch.Tensor:
    """L_n + w · mean((d − d_true)²) of the frames `index`.

    L_n is `normal_loss`, w `training.depth_weight`, d the depth in pixels.
    model : from scaled features (pixels, inputs) to normals (pixels, 3)
    """
    settings, limit = frames.scene.training, frames.scene.numbers.slope_limit
    features = frames.features(np.concatenate([frames.data.frames[index], frames.data.background[None]]))
    found = model(features.reshape(-1, features.shape[-1])).reshape(*features.shape[:3], 3)
    truth, known = frames.normals(index)
    of_normals = normal_loss(found[:-1].reshape(-1, 3)[known], truth, settings.huber_delta)
    slopes = slopes_of(found, limit)
    error = surface(slopes[:-1], slopes[-1]) - frames.depth_px(index)
    return of_normals + settings.depth_weight * error.square().mean()


def _batches(index: np.ndarray) -> list[np.ndarray]:
    return np.split(index, range(BATCH_FRAMES, len(index), BATCH_FRAMES))


@single_thread()
def fit(
    model: torch.nn.Module,
    frames: WholeFrames,
    index: np.ndarray,
    *,
    validation: np.ndarray | None = None,
    share: float = 1.0,
    epochs: int,
    rate: float,
    progress: bool = False,
) -> list[dict]:
    """Train on, in place, what of `model` may change, with `loss`; returns the learning curve.

    index, validation : the frames to learn from, and those to judge by, if any: the model then ends with the
        weights of the smallest error on them, the initial ones included; without them with the last
    share : of the frames that an epoch sees, chosen by chance
    """
    settings, surface = frames.scene.training, Surface(frames.scene, frames.rest_depth_mm)
    torch.manual_seed(settings.seed)
    rng = np.random.default_rng((settings.seed, 2))  # other draws than those of the normals' training
    count = max(1, round(share * len(index)))
    steps = epochs * -(-count // BATCH_FRAMES)
    parameters = [values for values in model.parameters() if values.requires_grad]
    optimiser = torch.optim.AdamW(parameters, lr=rate, weight_decay=0.0, fused=True)
    schedule = one_cycle(optimiser, rate, steps)
    judged, best, history = validation is not None and bool(len(validation)), BestEpoch(), []

    def error() -> float:
        model.eval()
        with torch.inference_mode():
            parts = [(part, loss(model, frames, surface, part).item()) for part in _batches(validation)]
        model.train()
        return sum(len(part) * value for part, value in parts) / len(validation)

    if judged:
        best.tell(error(), model)
    bar = progress_bar(total=steps, desc="normals, with depth", unit="step", enabled=progress)
    for epoch in range(epochs):
        total = 0.0
        for part in _batches(rng.permutation(index)[:count]):
            found = loss(model, frames, surface, part)
            optimiser.zero_grad(set_to_none=True)
            found.backward()
            optimiser.step()
            schedule.step()
            total += found.item() * len(part)
            bar.update()
        entry = {"epoch": epoch + 1, "train_loss": total / count}
        if judged:
            entry["validation_loss"] = error()
            best.tell(entry["validation_loss"], model)
        history.append(entry)
        bar.set_postfix(loss=f"{entry.get('validation_loss', entry['train_loss']):.4f}")
    bar.close()
    best.restore(model)
    return history


def train(network: PixelNetwork, frames: WholeFrames, *, progress: bool = False) -> list[dict]:
    """Train the float network on with `loss`, for the scene's `training.depth_epochs`; it is changed itself.

    Returns the learning curve. An epoch sees a share `training.normals_share` of the frames.
    """
    settings = frames.scene.training
    return fit(
        with_rounding_noise(network, frames.scene.felt_rounding_bits),
        frames,
        frames.data.indices("train"),
        validation=frames.data.indices("validation"),
        share=settings.normals_share,
        epochs=settings.depth_epochs,
        rate=settings.normals_learning_rate,
        progress=progress,
    )
