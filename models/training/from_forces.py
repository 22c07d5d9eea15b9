"""Training the pixel network from forces alone: its slopes and the weights of the slopes learned together.

Without normals nobody says what the slopes are. They become whatever two numbers per pixel, functions of its
colour change and its place, explain the force best as Σ (a·Δp + b·Δq); the hardware is the same. The start is
the best linear model, a ridge on the pixels' differences from the background: its fields of weights, one for
each channel, are reduced to the two mixtures of channels that carry most of it, and the network begins as
these mixtures. From there network and fields, sums of cosines, descend the L1 distance of the force, on
frames averaged over small blocks: contacts are smooth, and it is many times faster.
The fields are fitted once more afterwards, by models/training/slope_force.py, to what each arithmetic finds.
"""

import copy

import numpy as np
import torch

from fastac.models.floating.network import PixelNetwork, UnitLength
from fastac.models.floating.threads import single_thread
from fastac.models.integer.features import (
    DIFFERENCE_SCALE,
    HIDDEN,
    coordinate_codes,
    integer_features,
    scales,
)
from fastac.models.training import slope_force
from fastac.models.training.normals import ScaledNetwork
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.store.progress import progress_bar

LEAST_PX = 32
"""Averaged frames keep at least so many pixels along each side."""
INITIAL_SLOPE = 1.0
"""The linear model's slopes reach this in one pixel of ten thousand: a quarter of the default limit."""
LEAST_N_Z = 1e-2
DISTILLED_PX = 1 << 20
"""Pixels of the training frames from which the integers learn the float network."""


def background_differences(data: Dataset, index: np.ndarray) -> np.ndarray:
    """Frames `index` less the background, (frames, H, W, C) float32."""
    return data.frames[index].astype(np.float32) - data.background


def linear_fields(
    pixels: dict[str, np.ndarray], force_n: dict[str, np.ndarray], *, progress: bool = False
) -> tuple[np.ndarray, int]:
    """The linear model of pixels (frames, H, W, C): its fields of weights (axes, H, W, C).

    Also how many cosines along each axis they are made of. Both arguments by split name.
    """
    fields, history = slope_force.fit(pixels, force_n, progress=progress)
    return fields, min(history, key=lambda entry: entry["validation_mae_n"])["cosines"]


def channel_mixtures(fields: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The two mixtures of channels (2, C) that carry most of Σ fields · change, by reduced-rank regression.

    fields (axes, H, W, C); change (frames, H, W, C). A mixture reaches INITIAL_SLOPE in one pixel of ten thousand.
    Source: Izenman, "Modern Multivariate Statistical Techniques", section 6.3.
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
    """A network whose slopes are `mixtures` (2, C) of the scaled differences: a linear model.

    The first four neurons of each layer carry both mixtures, each as two rectified halves; the others are
    random, and their way out starts at zero.
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
    """Pixels along each side of the blocks that are averaged."""
    block = 1
    while not (height % (2 * block) or width % (2 * block) or min(height, width) // (2 * block) < LEAST_PX):
        block *= 2
    return block


def block_averages(images: np.ndarray, block: int) -> np.ndarray:
    """Images (..., H, W, terms) averaged over blocks, (..., H / block, W / block, terms)."""
    *outer, height, width, terms = images.shape
    split = images.reshape(*outer, height // block, block, width // block, block, terms)
    return split.mean(axis=(-4, -2))


class ForceFromPixels(torch.nn.Module):
    """Differences from the background to forces, through a pixel network's slopes and fields of weights."""

    def __init__(self, network: PixelNetwork, fields: np.ndarray, shape: tuple[int, int, int], limit: float):
        """fields (axes, m, m, 2): the lowest cosines of the slopes' weights, in N; shape (H, W, C)."""
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
                slope_force.cosine_basis(size, fields.shape[1]).reshape(-1, block, fields.shape[1]).mean(1)
            )
        for name, values in buffers.items():
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32))

    def slopes(self, features: torch.Tensor) -> torch.Tensor:
        normal = self.network(features * self.scales)
        slopes = -normal[..., :2] / normal[..., 2:].clamp(min=LEAST_N_Z)
        return slopes.clamp(-self.limit, self.limit)

    def forward(self, change: torch.Tensor) -> torch.Tensor:
        """Averaged differences (frames, H / block, W / block, C), float32, to forces (frames, axes) in N."""
        change = torch.cat([change, torch.zeros_like(change[:1])])  # the last is the rest
        codes = self.codes.expand(*change.shape[:3], 2)
        slopes = self.slopes(torch.cat([change, codes], dim=-1))
        weights = torch.einsum("ik,jl,aklt->aijt", self.rows, self.columns, self.fields * self.unit)
        return torch.einsum("nijt,aijt->na", slopes[:-1] - slopes[-1:], weights)


def initial_model(data: Dataset, scene: Scene, *, progress: bool = False) -> ForceFromPixels:
    """The linear model, of the two best mixtures of channels, as a network and fields."""
    splits = {split: index for split in ("train", "validation") if len(index := data.indices(split))}
    change = {split: background_differences(data, index) for split, index in splits.items()}
    force = {split: data.forces_n(index, scene.force_axes) for split, index in splits.items()}
    fields, _ = linear_fields(change, force, progress=progress)
    mixtures = channel_mixtures(fields, change["train"])
    mixed = {split: (pixels @ mixtures.T).astype(np.float32) for split, pixels in change.items()}
    fields, cosines = linear_fields(mixed, force, progress=progress)
    lowest = slope_force.lowest_cosines(fields, cosines)
    network = linear_network((mixtures / DIFFERENCE_SCALE).astype(np.float32), scene.network.hidden)
    return ForceFromPixels(network, lowest, data.background.shape, scene.numbers.slope_limit)


@single_thread()
def train(data: Dataset, scene: Scene, *, progress: bool = False) -> tuple[PixelNetwork, list[dict]]:
    """Fit network and fields to the train split's forces; returns the network and the learning curve.

    What is best on the validation split is kept, the linear start included; without one, the last.
    """
    settings = scene.training
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
    spread = change["train"].std(dim=(0, 1, 2)) * settings.input_noise
    rates = [settings.normals_learning_rate, settings.force_learning_rate]
    optimiser = torch.optim.AdamW(
        [
            {"params": model.network.parameters(), "weight_decay": 0.0},
            {"params": [model.fields], "weight_decay": settings.force_weight_decay},
        ]
    )
    count = len(change["train"])
    steps = settings.force_epochs * -(-count // settings.force_batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, rates, total_steps=steps, pct_start=0.1 if steps > 10 else 0.05
    )
    history = []
    best, best_state = np.inf, None
    if len(change["validation"]):  # what it starts from counts too: training must not lose it
        best, best_state = _error(model, change, force), copy.deepcopy(model.state_dict())
        history.append({"epoch": 0, "train_mae_n": np.nan, "validation_mae_n": best})
    bar = progress_bar(total=steps, desc="slopes from forces", unit="step", enabled=progress)
    for epoch in range(settings.force_epochs):
        total = 0.0
        for index in torch.randperm(count, generator=generator).split(settings.force_batch):
            batch = change["train"][index]
            if settings.input_noise:
                batch = batch + spread * torch.randn(batch.shape, generator=generator)
            loss = (model(batch) - force["train"][index]).abs().sum(dim=1).mean()
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            optimiser.step()
            schedule.step()
            total += loss.item() * len(index)
            bar.update()
        entry = {"epoch": epoch + 1, "train_mae_n": total / count}
        if len(change["validation"]):
            entry["validation_mae_n"] = _error(model, change, force)
            if entry["validation_mae_n"] < best:
                best, best_state = entry["validation_mae_n"], copy.deepcopy(model.state_dict())
        history.append(entry)
        bar.set_postfix(mae=f"{entry.get('validation_mae_n', entry['train_mae_n']):.4f} N")
    bar.close()
    if best_state is not None:
        model.load_state_dict(best_state)
    return model.network, history


def _error(model: ForceFromPixels, change: dict, force: dict) -> float:
    with torch.inference_mode():
        found = torch.cat([model(part) for part in change["validation"].split(64)])
        return (found - force["validation"]).abs().sum(dim=1).mean().item()


def distillation_pixels(
    network: PixelNetwork, data: Dataset, *, limit: int = DISTILLED_PX, seed: int = 0
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Features (pixels, inputs) and the normals that the network finds there, by split name.

    Up to `limit` pixels of a split, as many from each frame: the integers learn from the float network.
    """
    teacher = torch.nn.Sequential(ScaledNetwork(network, scales(data.frames.shape[-1])), UnitLength())
    height, width = data.frames.shape[1:3]
    rng = np.random.default_rng(seed)
    found = {}
    for split in ("train", "validation"):
        index = data.indices(split)
        if not len(index):
            continue
        each = max(min(limit // len(index), height * width), 1)
        chosen = []
        for frame in index:
            features = integer_features(data.frames[frame], data.background).reshape(height * width, -1)
            chosen.append(features[rng.choice(height * width, each, replace=False)])
        x = np.concatenate(chosen)
        with torch.inference_mode():
            y = [teacher(part).numpy() for part in torch.from_numpy(x.astype(np.float32)).split(1 << 16)]
        found[split] = x, np.concatenate(y)
    return found
