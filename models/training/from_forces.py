"""Training of the pixel network from forces alone: network and slope weights are learned together.

Without labelled normals the network's slopes are latent: the two functions of a pixel's colour change and
position that best explain the force as Σ (a·Δp + b·Δq). The hardware stays the same. Training starts from the
best linear model, a ridge regression on the pixels' differences from the background. Its weight fields, one
for each channel, are reduced to the two linear combinations of channels that explain most of it, and the
network is initialised to compute these. Then network and fields a, b (sums of cosines) are trained on the L1
error of the force, on frames averaged over blocks, which is faster and loses little since contacts are
smooth. Afterwards models/training/smooth_weights.py fits the fields again, to the slopes of each arithmetic.
All of it sees each frame under a light of its own (models/training/light.py), the network another in each
epoch.

Where the scene limits the patience, nobody knows beforehand which epoch will be the last, and rates cannot be
annealed towards it. They stay as they are, and a moving average of the parameters over about an epoch is
validated and kept, which damps the noise of the steps as small rates would (Polyak, Juditsky, "Acceleration
of Stochastic Approximation by Averaging", 1992).
"""

import numpy as np
import torch
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from fastac.models.floating.network import PixelNetwork, UnitLength
from fastac.models.floating.threads import single_thread
from fastac.models.integer.features import (
    DIFFERENCE_SCALE,
    HIDDEN,
    coordinate_codes,
    integer_features,
    scales,
)
from fastac.models.training import smooth_weights
from fastac.models.training.best_epoch import BestEpoch
from fastac.models.training.labelled_pixels import VALIDATION_PX
from fastac.models.training.light import under_other_light
from fastac.models.training.normals import ScaledNetwork
from fastac.scenes.model_schema import Training
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.store.progress import progress_bar

MIN_BLOCKS = 20
"""Smallest side of block-averaged frames, in blocks: time goes with their number. With 10 × 11 for 40 × 44 px
the error grew by a seventh."""
WARM_UP_EPOCHS = 0.5
"""Over which rates rise that then stay."""
INITIAL_SLOPE = 1.0
"""Scale of the linear model's slopes: their 99.99th percentile, a quarter of the default slope limit."""
MIN_N_Z = 1e-2
DISTILLED_PX = {"train": 1 << 20, "validation": VALIDATION_PX}
"""Number of pixels with the float network's normals on which the integers are fine-tuned, and judged."""


def background_differences(data: Dataset, index: np.ndarray) -> np.ndarray:
    """Frames `index` less the background, (frames, H, W, C) float32."""
    return data.frames[index].astype(np.float32) - data.background


def linear_fields(
    pixels: dict[str, np.ndarray],
    force_n: dict[str, np.ndarray],
    *,
    patience: int | None = None,
    progress: bool = False,
) -> tuple[np.ndarray, int]:
    """Fit the linear model F = Σ fields · pixels; returns its fields (axes, H, W, C) and their number of
    cosines.

    pixels : (frames, H, W, C), differences from the background; force_n : (frames, axes); both by split name
    patience : as in `smooth_weights.fit`
    """
    fields, _, history = smooth_weights.fit(pixels, force_n, patience=patience, progress=progress)
    return fields, min(history, key=lambda entry: entry["validation_mae_n"])["cosines"]


def channel_mixtures(fields: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The two linear combinations of channels (2, C) that explain most of Σ fields · change.

    fields : (axes, H, W, C); change : (frames, H, W, C)
    By reduced-rank regression (Izenman, "Modern Multivariate Statistical Techniques", section 6.3). Each is
    scaled so that the 99.99th percentile of its magnitude is INITIAL_SLOPE.
    """
    channels = fields.shape[-1]
    flat = change.reshape(-1, channels).astype(np.float64)
    covariance = flat.T @ flat / len(flat)
    covariance[np.diag_indices(channels)] += 1e-6 * np.trace(covariance) + 1e-12
    root = np.linalg.cholesky(covariance)
    right = np.linalg.svd(fields.reshape(-1, channels) @ root, full_matrices=False).Vh[:2]
    mixtures = right @ np.linalg.inv(root)
    return mixtures * INITIAL_SLOPE / np.quantile(np.abs(flat @ mixtures.T), 1 - 1e-4, axis=0)[:, None]


def linear_network(mixtures: np.ndarray, hidden: tuple[int, ...] = HIDDEN) -> PixelNetwork:
    """A network whose slopes are the combinations `mixtures` (2, C) of the scaled differences: a linear
    model.

    The first four neurons of each layer carry the positive and the negative part of both combinations. The
    other neurons are initialised at random, with output weights of zero.
    """
    network = PixelNetwork(mixtures.shape[1] + 2, hidden)
    halves = torch.tensor(np.stack([mixtures[0], -mixtures[0], mixtures[1], -mixtures[1]]))
    first, *middle, last = network.linear_layers
    with torch.no_grad():
        for layer in (first, *middle):
            layer.weight[:4] = 0
            layer.bias[:4] = 0
        first.weight[:4, :-2] = halves
        for layer in middle:
            layer.weight[:4, :4] = torch.eye(4)
        last.weight[:] = 0
        last.weight[0, :2] = last.weight[1, 2:4] = torch.tensor([-1.0, 1.0])
    return network


def block_size(height: int, width: int) -> int:
    """Side in px of the blocks over which frames are averaged: the largest power of two that divides the
    image and leaves MIN_BLOCKS blocks along each side."""
    block = 1
    while not (height % (2 * block) or width % (2 * block) or min(height, width) // (2 * block) < MIN_BLOCKS):
        block *= 2
    return block


def block_averages(images: np.ndarray, block: int) -> np.ndarray:
    """Images (..., H, W, terms) averaged over blocks, (..., H / block, W / block, terms)."""
    *outer, height, width, terms = images.shape
    split = images.reshape(*outer, height // block, block, width // block, block, terms)
    return split.mean(axis=(-4, -2))


class ForceFromPixels(torch.nn.Module):
    """The force from differences to the background: pixel network, slopes, and their weighted sum."""

    def __init__(self, network: PixelNetwork, fields: np.ndarray, shape: tuple[int, int, int], limit: float):
        """fields : (axes, m, m, 2), DCT coefficients of the slopes' weights in N
        shape : (H, W, C) of the frames; limit : the largest |slope|
        """
        super().__init__()
        height, width, channels = shape
        block = block_size(height, width)
        self.network, self.limit = network, limit
        self.unit = float(np.abs(fields).mean()) * block**2
        self.fields = torch.nn.Parameter(torch.tensor(fields * block**2 / self.unit, dtype=torch.float32))
        codes = np.stack(np.meshgrid(coordinate_codes(width), coordinate_codes(height)), axis=-1)
        buffers = {"codes": block_averages(codes, block), "scales": scales(channels)}
        for name, size in (("rows", height), ("columns", width)):
            buffers[name] = (
                smooth_weights.cosine_basis(size, fields.shape[1]).reshape(-1, block, fields.shape[1]).mean(1)
            )
        for name, values in buffers.items():
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32))

    def slopes(self, features: torch.Tensor) -> torch.Tensor:
        normal = self.network(features * self.scales)
        slopes = -normal[..., :2] / normal[..., 2:].clamp(min=MIN_N_Z)
        return slopes.clamp(-self.limit, self.limit)

    def forward(self, change: torch.Tensor) -> torch.Tensor:
        """Averaged differences (frames, H / block, W / block, C), float32, to forces (frames, axes) in N."""
        change = torch.cat([change, torch.zeros_like(change[:1])])  # last: the background, with no difference
        codes = self.codes.expand(*change.shape[:3], 2)
        slopes = self.slopes(torch.cat([change, codes], dim=-1))
        weights = torch.einsum("ik,jl,aklt->aijt", self.rows, self.columns, self.fields * self.unit)
        return torch.einsum("nijt,aijt->na", slopes[:-1] - slopes[-1:], weights)


class Disturbance:
    """What training adds to each batch of averaged differences: noise of pixels, and another light.

    Each channel of a frame is as if its light were brighter or darker. Lamps warm up and exposures differ
    from recording to recording, which some thousand pixels in sum take for a force. The few recordings that
    there are do not teach a network that it is none.
    """

    def __init__(
        self, settings: Training, change: torch.Tensor, background: torch.Tensor, generator: torch.Generator
    ):
        """change : all averaged differences (frames, H / block, W / block, C), whose spread is the unit of
        `input_noise`; background : (H / block, W / block, C), averaged alike
        """
        self.spread = change.std(dim=(0, 1, 2)) * settings.input_noise
        self.light_noise = settings.force_light_noise
        self.background, self.generator = background, generator

    def __call__(self, change: torch.Tensor) -> torch.Tensor:
        """A batch's differences, disturbed."""
        if self.light_noise:
            gains = torch.randn((len(change), 1, 1, change.shape[-1]), generator=self.generator)
            change = change + (change + self.background) * (self.light_noise * gains)
        if self.spread.any():
            change = change + self.spread * torch.randn(change.shape, generator=self.generator)
        return change


def initial_model(data: Dataset, scene: Scene, *, progress: bool = False) -> ForceFromPixels:
    """The linear model on the two best combinations of channels, as a network and weight fields."""
    splits = {split: index for split in ("train", "validation") if len(index := data.indices(split))}
    change = {split: background_differences(data, index) for split, index in splits.items()}
    force = {split: data.forces_n(index, scene.force_axes) for split, index in splits.items()}
    keys = {"patience": scene.training.patience_sizes, "progress": progress}
    fields, _ = linear_fields(change, force, **keys)
    mixtures = channel_mixtures(fields, change["train"])
    mixed = {split: (pixels @ mixtures.T).astype(np.float32) for split, pixels in change.items()}
    fields, cosines = linear_fields(mixed, force, **keys)
    lowest = smooth_weights.lowest_cosines(fields, cosines)
    network = linear_network((mixtures / DIFFERENCE_SCALE).astype(np.float32), scene.network.hidden)
    return ForceFromPixels(network, lowest, data.background.shape, scene.numbers.slope_limit)


@single_thread()
def train(data: Dataset, scene: Scene, *, progress: bool = False) -> tuple[PixelNetwork, list[dict]]:
    """Fit network and weight fields to the train split's forces; returns the network and the learning curve.

    The parameters with the smallest validation error are kept, the initial linear model included; without a
    validation split, the last ones. `scene.training.patience_epochs` may end it early.
    """
    settings = scene.training
    data = under_other_light(data, settings.force_light_noise, settings.seed)
    torch.manual_seed(settings.seed)
    generator = torch.Generator().manual_seed(settings.seed)
    model = initial_model(data, scene, progress=progress)
    block = block_size(*data.frames.shape[1:3])
    splits = {split: data.indices(split) for split in ("train", "validation")}
    change = {
        split: torch.from_numpy(block_averages(background_differences(data, index), block))
        for split, index in splits.items()
    }
    force = {
        split: torch.from_numpy(data.forces_n(index, scene.force_axes)) for split, index in splits.items()
    }
    disturb = Disturbance(
        settings,
        change["train"],
        torch.from_numpy(block_averages(data.background.astype(np.float32), block)),
        generator,
    )
    optimiser = torch.optim.AdamW(
        [
            {
                "params": model.network.parameters(),
                "lr": settings.normals_learning_rate,
                "weight_decay": 0.0,
            },
            {
                "params": [model.fields],
                "lr": settings.force_learning_rate,
                "weight_decay": settings.force_weight_decay,
            },
        ],
        fused=True,
    )
    count = len(change["train"])
    steps = -(-count // settings.force_batch)
    early = settings.patience_epochs is not None and len(change["validation"])
    schedule = _constant(optimiser, steps) if early else _one_cycle(optimiser, settings, steps)
    averaged = (
        AveragedModel(model, multi_avg_fn=get_ema_multi_avg_fn(1 - 1 / max(steps, 2))) if early else None
    )
    judged = averaged.module if early else model
    history, best = [], BestEpoch(settings.patience_epochs)
    if len(change["validation"]):  # what it starts from counts too: training must not lose it
        error = _error(model, change, force)
        best.tell(error, model)
        history.append({"epoch": 0, "train_mae_n": np.nan, "validation_mae_n": error})
    bar = progress_bar(
        total=settings.force_epochs * steps, desc="slopes from forces", unit="step", enabled=progress
    )
    for epoch in range(settings.force_epochs):
        total = 0.0
        for index in torch.randperm(count, generator=generator).split(settings.force_batch):
            loss = (model(disturb(change["train"][index])) - force["train"][index]).abs().sum(dim=1).mean()
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            optimiser.step()
            schedule.step()
            if early:
                averaged.update_parameters(model)
            total += loss.item() * len(index)
            bar.update()
        entry = {"epoch": epoch + 1, "train_mae_n": total / count}
        if len(change["validation"]):
            entry["validation_mae_n"] = _error(judged, change, force)
            best.tell(entry["validation_mae_n"], judged)
        history.append(entry)
        bar.set_postfix(mae=f"{entry.get('validation_mae_n', entry['train_mae_n']):.4f} N")
        if best.done:
            break
    bar.close()
    best.restore(model)
    return model.network, history


def _one_cycle(optimiser: torch.optim.Optimizer, settings: Training, steps: int):
    """Rates that rise and are annealed over all epochs of so many steps each."""
    total = settings.force_epochs * steps
    rates = [group["lr"] for group in optimiser.param_groups]
    return torch.optim.lr_scheduler.OneCycleLR(
        optimiser, rates, total_steps=total, pct_start=0.1 if total > 10 else 0.05
    )


def _constant(optimiser: torch.optim.Optimizer, steps: int):
    """Rates that rise in the first half of an epoch of so many steps, and stay."""
    return torch.optim.lr_scheduler.LambdaLR(
        optimiser, lambda step: min(1.0, (step + 1) / (WARM_UP_EPOCHS * steps))
    )


def _error(model: ForceFromPixels, change: dict, force: dict) -> float:
    with torch.inference_mode():
        found = torch.cat([model(part) for part in change["validation"].split(64)])
        return (found - force["validation"]).abs().sum(dim=1).mean().item()


def distillation_pixels(
    network: PixelNetwork, data: Dataset, *, limit: int | None = None, seed: int = 0
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Features (pixels, inputs) and the float network's unit normals (pixels, 3), by split name.

    At most `limit` random pixels of a split, equally many from each frame; None: DISTILLED_PX. They are the
    targets of the integers' fine-tuning where there are no labelled normals.
    """
    teacher = torch.nn.Sequential(ScaledNetwork(network, scales(data.frames.shape[-1])), UnitLength())
    height, width = data.frames.shape[1:3]
    rng = np.random.default_rng(seed)
    found = {}
    for split in ("train", "validation"):
        index = data.indices(split)
        if not len(index):
            continue
        each = max(min((limit or DISTILLED_PX[split]) // len(index), height * width), 1)
        chosen = []
        for frame in index:
            features = integer_features(data.frames[frame], data.background).reshape(height * width, -1)
            chosen.append(features[rng.choice(height * width, each, replace=False)])
        x = np.concatenate(chosen)
        with torch.inference_mode():
            y = [teacher(part).numpy() for part in torch.from_numpy(x.astype(np.float32)).split(1 << 16)]
        found[split] = x, np.concatenate(y)
    return found
