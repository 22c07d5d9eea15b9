"""Training of the pixel network in floating point on labelled normals, with an optional ensemble of teachers.

Network and loss are the paper's (Lu et al., "FasTac", section "Position-Aware MLP for Surface Normal
Estimation"), but for small errors where a scene says so. models/training/bit_true.py then fine-tunes the
quantised network.
"""

from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.floating.threads import single_thread
from fastac.models.integer.features import COORDINATE_SCALE, HIDDEN, scales
from fastac.models.training.best_epoch import BestEpoch
from fastac.models.training.epochs import descend, train_epochs
from fastac.models.training.initial_weights import set_active
from fastac.models.training.labelled_pixels import Pixels, labelled_splits
from fastac.models.training.rounding_noise import with_rounding_noise
from fastac.models.training.teachers import Ensemble
from fastac.scenes.training_schema import Training
from fastac.sensor.dataset import Dataset


def normal_loss(predicted: torch.Tensor, truth: torch.Tensor, huber_delta: float = 0.0) -> torch.Tensor:
    """The paper's loss L_n: mean over pixels of the L1 distance between unit normals; both (pixels, 3).

    `predicted` is normalised here; `truth` must be of unit length.
    huber_delta : if not 0, the pseudo-Huber loss takes the place of absolute errors e of the components,
        √(e² + δ²) − δ: e²/2δ where e is small, |e| where it is large. Source: Hartley, Zisserman, "Multiple
        View Geometry in Computer Vision", 2nd ed., appendix 6.8, here divided by 2δ.
    """
    # Equal to nn.functional.normalize, in operations that are fast for column-major inputs too.
    unit = predicted * predicted.square().sum(dim=-1, keepdim=True).clamp_min(1e-24).rsqrt()
    if huber_delta:
        errors = ((unit - truth).square() + huber_delta**2).sqrt() - huber_delta
    else:
        errors = (unit - truth).abs()
    return errors.sum(dim=-1).mean()


TEACHER_WEIGHT_DECAY = 0.05


@dataclass(frozen=True)
class Fit:
    """Settings of a training run: AdamW with a cosine learning-rate schedule on `normal_loss`.

    batch : pixels; rate : initial learning rate; label : name of the progress bar
    huber_delta : as in `normal_loss`
    input_noise : standard deviation of the noise added to ΔI, as a fraction of ΔI's standard deviation
    position_noise : standard deviation of the noise added to x and y, as a fraction of half the image
    patience : epochs in a row without a smaller validation loss that end the training; None: all are trained
    """

    epochs: int
    batch: int
    rate: float
    seed: int
    label: str
    weight_decay: float = 0.0
    input_noise: float = 0.0
    position_noise: float = 0.0
    patience: int | None = None
    huber_delta: float = 0.0

    @classmethod
    def of(cls, settings: Training, label: str, **others) -> Self:
        """That of the float network by the scene's settings, without its patience; `others` are other values
        by field."""
        own = {
            "epochs": settings.normals_epochs,
            "batch": settings.normals_batch_px,
            "rate": settings.normals_learning_rate,
            "seed": settings.seed,
            "input_noise": settings.input_noise,
            "position_noise": settings.position_noise,
            "huber_delta": settings.huber_delta,
        }
        return cls(label=label, **own | others)

    @single_thread()
    def __call__(self, model, x, y, *, validation=None, teacher=None, copies=0, progress=False) -> list[dict]:
        """Fit `model` to features x (pixels, inputs) and normals y (pixels, 3); returns the learning curve.

        teacher : module from noisy features to normals, which then replace y as targets
        copies : if not 0, the model gets this many copies of each batch, each with its own noise
        validation : a pair like (x, y); the model ends with the weights of the smallest validation loss,
            the initial ones included. Without it, with the last weights.
        """
        torch.manual_seed(self.seed)
        generator = torch.Generator().manual_seed(self.seed)
        x, y = torch.from_numpy(x.astype(np.float32)), torch.from_numpy(y)
        optimiser = torch.optim.AdamW(
            model.parameters(), lr=self.rate, weight_decay=self.weight_decay, fused=True
        )
        steps = -(-len(x) // self.batch)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, self.epochs * steps)
        spread = x.std(dim=0) * self.input_noise
        spread[-2:] = self.position_noise / COORDINATE_SCALE
        noisy = bool(spread.any())
        if teacher is not None and not noisy:  # it says the same every time
            with torch.no_grad():
                y, teacher = torch.cat([teacher(part) for part in x.split(self.batch)]), None

        def step(index: torch.Tensor) -> float:
            inputs, truth = x.index_select(0, index), y.index_select(0, index)
            if noisy:
                shape = (copies, *inputs.shape) if copies else inputs.shape
                inputs = inputs + spread * torch.randn(shape, generator=generator)
            if teacher is not None:
                with torch.no_grad():
                    truth = teacher(inputs)
            return descend(normal_loss(model(inputs), truth, self.huber_delta), optimiser, schedule)

        best, error = BestEpoch(self.patience), None
        if validation is not None:  # what it starts from counts too: fine-tuning must not lose it
            error = partial(self._loss, model, *validation)
            best.tell(error(), model)
        return train_epochs(
            model,
            self.epochs,
            steps,
            lambda: torch.randperm(len(x), generator=generator).split(self.batch),
            step,
            label=self.label,
            best=best,
            error=error,
            progress=progress,
        )

    def _loss(self, model, x: torch.Tensor, y: torch.Tensor) -> float:
        model.eval()
        with torch.inference_mode():
            chunks = zip(x.split(1 << 16), y.split(1 << 16), strict=True)
            total = sum(normal_loss(model(a), b, self.huber_delta).item() * len(a) for a, b in chunks)
        model.train()
        return total / len(x)


class ScaledNetwork(torch.nn.Module):
    """A float network preceded by the scaling of integer features, (pixels, inputs) to (pixels, 3)."""

    def __init__(self, network: torch.nn.Module, feature_scales: np.ndarray):
        super().__init__()
        self.network = network
        self.register_buffer("scales", torch.tensor(feature_scales, dtype=torch.float32))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.network(x * self.scales)


def _tensors(pixels: dict[str, Pixels]) -> tuple[torch.Tensor, torch.Tensor] | None:
    """The validation split's features and normals as tensors, or None where there is no such split."""
    if "validation" not in pixels:
        return None
    x, y = pixels["validation"]
    return torch.from_numpy(x.astype(np.float32)), torch.from_numpy(y)


def train(
    data: Dataset,
    settings: Training,
    hidden: tuple[int, ...] = HIDDEN,
    *,
    smoothing_px: int = 0,
    rounding_bits: int | None = None,
    progress: bool = False,
) -> tuple[PixelNetwork, list[dict]]:
    """Fit the float network to a dataset's train split; returns the network and its learning curve.

    hidden : neurons of each hidden layer
    smoothing_px : as in `integer_features`
    rounding_bits : bits of the activations whose rounding is felt as noise; None: there is none
    With `settings.teachers` an ensemble of wide networks is trained first, and the network learns from it.
    Raises ValueError where there is nothing to train on.
    """
    pixels = labelled_splits(data, settings, smoothing_px)
    x, y = pixels["train"]
    unit = scales(x.shape[1] - 2)
    validation = _tensors(pixels)
    torch.manual_seed(settings.seed)
    teacher = None
    if settings.teachers:
        ensemble = Ensemble(x.shape[1], teachers=settings.teachers, width=settings.teacher_width)
        teacher = ScaledNetwork(ensemble, unit)
        fit = Fit.of(
            settings,
            "normals, teachers",
            epochs=settings.teacher_epochs,
            weight_decay=TEACHER_WEIGHT_DECAY,
        )
        fit(teacher, x, y, copies=settings.teachers, progress=progress)
        teacher.eval()
    network = PixelNetwork(x.shape[1], hidden)
    if settings.initial_weights == "active":
        set_active(network, x, settings.seed)
    fit = Fit.of(settings, "normals, float", patience=settings.patience_epochs)
    model = ScaledNetwork(with_rounding_noise(network, rounding_bits), unit)
    return network, fit(model, x, y, validation=validation, teacher=teacher, progress=progress)
