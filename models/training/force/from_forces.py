"""Training of the pixel network from forces alone: network and slope weights are learned together.

Without labelled normals the network's slopes are latent: two functions of a pixel's colour change and
position that explain the force as Σ (a·Δp + b·Δq). The hardware stays the same. Training starts from a linear
model (force_start.py). Then network and fields a, b (sums of cosines) are trained on the L1 error of the
force, and on the curl of the slopes: a surface's slopes have none, which a few objects and forces do not tell
(integrability.py). The network that is kept has the mean of its parameters before and after, which says less
of what no press has shown. Afterwards smooth_weights.py fits the fields again, to the slopes of each
arithmetic, with the symmetry of presses where it holds (press_symmetry.py). Training sees each frame under a
light of its own (light.py), the network another in each epoch; the last fit sees frames as they are.

Where the scene limits the patience, nobody knows beforehand which epoch will be the last, and rates cannot be
annealed towards it. They stay as they are, and a moving average of the parameters over about an epoch is
validated and kept, which damps the noise of the steps as small rates would (Polyak, Juditsky, "Acceleration
of Stochastic Approximation by Averaging", 1992).
"""

import copy
from functools import partial

import numpy as np
import torch
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from fastac.models.floating.network import PixelNetwork, UnitLength
from fastac.models.floating.threads import single_thread
from fastac.models.integer.features import integer_features, scales
from fastac.models.training.best_epoch import BestEpoch
from fastac.models.training.epochs import descend, train_epochs
from fastac.models.training.force.force_from_pixels import ForceFromPixels, block_averages, block_size
from fastac.models.training.force.force_start import background_differences, initial_model, linear_start
from fastac.models.training.force.integrability import curl_share
from fastac.models.training.force.light import under_other_light
from fastac.models.training.labelled_pixels import VALIDATION_PX
from fastac.models.training.normals import ScaledNetwork
from fastac.models.training.one_cycle import one_cycle
from fastac.scenes.schema import Scene
from fastac.scenes.training_schema import Training
from fastac.sensor.dataset import Dataset
from fastac.sensor.groups import left_out_together, several_recordings

WARM_UP_EPOCHS = 0.5
"""Over which rates rise that then stay."""
TRAINED_SHARE = 0.5
"""Share of what training has changed in the network's parameters that is kept. Between a model that is right
roughly everywhere and one that is right where it was trained lie better ones on what is new (Wortsman et al.,
"Robust fine-tuning of zero-shot models", 2022)."""
DISTILLED_PX = {"train": 1 << 20, "validation": VALIDATION_PX}
"""Number of pixels with the float network's normals on which the integers are fine-tuned, and judged."""


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


@single_thread()
def train(data: Dataset, scene: Scene, *, progress: bool = False) -> tuple[PixelNetwork, list[dict]]:
    """Fit network and weight fields to the train split's forces; returns the network, whose parameters are
    the mean of the linear model's and the trained ones, and the learning curve of the latter.

    Of these, those with the smallest validation error are taken, the initial linear model included; without a
    validation split, the last ones. `scene.training.patience_epochs` may end it early.
    """
    settings = scene.training
    data = under_other_light(data, settings.force_light_noise, settings.seed)
    torch.manual_seed(settings.seed)
    generator = torch.Generator().manual_seed(settings.seed)
    splits = {split: index for split in ("train", "validation") if len(index := data.indices(split))}
    smoothing_px = scene.network.smoothing_px
    change = {split: background_differences(data, index, smoothing_px) for split, index in splits.items()}
    force = {split: data.forces_n(index, scene.force_axes) for split, index in splits.items()}
    together = left_out_together(data)
    recording = {split: together[index] for split, index in splits.items()}
    start = linear_start(
        change, force, scene, recording if several_recordings(data) else None, progress=progress
    )
    model = initial_model(start, data, scene)
    initial = copy.deepcopy(model.network)
    block = block_size(*data.frames.shape[1:3])
    change = {split: torch.from_numpy(block_averages(pixels, block)) for split, pixels in change.items()}
    force = {split: torch.from_numpy(values) for split, values in force.items()}
    of_curl_n = settings.force_curl_weight * force["train"].abs().sum(dim=1).mean() * start.of_surfaces
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
    early = settings.patience_epochs is not None and "validation" in change
    if early:
        schedule = _constant(optimiser, steps)
    else:
        rates = [group["lr"] for group in optimiser.param_groups]
        schedule = one_cycle(optimiser, rates, settings.force_epochs * steps)
    averaged = (
        AveragedModel(model, multi_avg_fn=get_ema_multi_avg_fn(1 - 1 / max(steps, 2))) if early else None
    )
    judged = averaged.module if early else model
    history, best = [], BestEpoch(settings.patience_epochs)
    if "validation" in change:  # what it starts from counts too: training must not lose it
        error = _error(model, change, force)
        best.tell(error, model)
        history.append({"epoch": 0, "train_mae_n": np.nan, "validation_mae_n": error})

    def step(index: torch.Tensor) -> float:
        slopes = model.slope_changes(disturb(change["train"][index]))
        error = (model.force_n(slopes) - force["train"][index]).abs().sum(dim=1).mean()
        descend(error + of_curl_n * curl_share(slopes) if of_curl_n else error, optimiser, schedule)
        if early:
            averaged.update_parameters(model)
        return error.item()

    history += train_epochs(
        model,
        settings.force_epochs,
        steps,
        lambda: torch.randperm(count, generator=generator).split(settings.force_batch),
        step,
        label="slopes from forces",
        best=best,
        error=partial(_error, judged, change, force) if "validation" in change else None,
        judged=judged,
        quantity="mae_n",
        progress=progress,
    )
    with torch.no_grad():
        for kept, trained in zip(initial.parameters(), model.network.parameters(), strict=True):
            kept.lerp_(trained, TRAINED_SHARE)
    return initial, history


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
    network: PixelNetwork, data: Dataset, *, smoothing_px: int = 0, limit: int | None = None, seed: int = 0
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Features (pixels, inputs) and the float network's unit normals (pixels, 3), by split name.

    smoothing_px : as in `integer_features`
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
            features = integer_features(data.frames[frame], data.background, smoothing_px)
            features = features.reshape(height * width, -1)
            chosen.append(features[rng.choice(height * width, each, replace=False)])
        x = np.concatenate(chosen)
        with torch.inference_mode():
            y = [teacher(part).numpy() for part in torch.from_numpy(x.astype(np.float32)).split(1 << 16)]
        found[split] = x, np.concatenate(y)
    return found
