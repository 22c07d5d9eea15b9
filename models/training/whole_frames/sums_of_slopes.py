"""Training of the pixel network for what sums its slopes, depth and force, as well as for normals.

Where noise hides a pixel's slope, the best guess of its normal is too flat, and the depth, which sums slopes
over many pixels, lacks what all of them lack. What noise adds to the slopes cancels in that sum. So the
network is trained on, with the depth's error beside that of the normals: slopes become noisier and less
flat. A force that is a weighted sum of the slopes is not linear in the true ones; with its error beside that
of the normals the network bends them. The hardware stays the same.
"""

from functools import partial

import numpy as np
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.floating.threads import single_thread
from fastac.models.training.best_epoch import BestEpoch
from fastac.models.training.epochs import descend, train_epochs
from fastac.models.training.one_cycle import one_cycle
from fastac.models.training.rounding_noise import with_rounding_noise
from fastac.models.training.whole_frames.frames import WholeFrames, some_at_a_time

LABEL = "normals, on whole frames"
BATCH_FRAMES = 4
"""Of a step. A step of so many frames of 128 × 128 pixels sees eight times as many pixels as one of
`training.normals_batch_px`, but neighbours are much alike."""


def _mean_loss(model: torch.nn.Module, frames: WholeFrames, index: np.ndarray) -> float:
    """That of the frames `index`, with what `frames` has fitted to the model as it is."""
    frames.prepare(model)
    model.eval()
    with torch.no_grad():  # what `frames` keeps from here is learned with, too
        parts = [(part, frames.loss(model, part).item()) for part in some_at_a_time(index, BATCH_FRAMES)]
    model.train()
    return sum(len(part) * value for part, value in parts) / len(index)


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
    """Train on, in place, what of `model` may change, with the loss of `frames`; returns the learning curve.

    index, validation : the frames to learn from, and those to judge by, if any: the model then ends with the
        weights of the smallest error on them, the initial ones included; without them with the last
    share : of the frames that an epoch sees, chosen by chance
    Raises ValueError where there is nothing to learn from.
    """
    if not len(index):
        raise ValueError(
            "valid: no frame to train on has a pixel whose depth training.depth_weight could use"
        )
    seed = frames.scene.training.seed
    rng = np.random.default_rng((seed, 2))  # other draws than those of the normals' training
    torch.manual_seed(seed)
    count = max(1, round(share * len(index)))
    steps = -(-count // BATCH_FRAMES)
    parameters = [values for values in model.parameters() if values.requires_grad]
    optimiser = torch.optim.AdamW(parameters, lr=rate, weight_decay=0.0, fused=True)
    schedule = one_cycle(optimiser, rate, epochs * steps)
    judged, best = validation is not None and bool(len(validation)), BestEpoch()

    def batches() -> list[np.ndarray]:
        if not judged:  # else the error has prepared them
            frames.prepare(model)
        return some_at_a_time(rng.permutation(index)[:count], BATCH_FRAMES)

    if judged:  # what it starts from counts too
        best.tell(_mean_loss(model, frames, validation), model)
    return train_epochs(
        model,
        epochs,
        steps,
        batches,
        lambda part: descend(frames.loss(model, part), optimiser, schedule),
        label=LABEL,
        best=best,
        error=partial(_mean_loss, model, frames, validation) if judged else None,
        progress=progress,
    )


def train(network: PixelNetwork, frames: WholeFrames, *, progress: bool = False) -> list[dict]:
    """Train the float network on for the scene's `training.depth_epochs`; it is changed itself. Returns the
    learning curve.

    An epoch sees a share `training.normals_share` of the frames where the depth counts, else all of them.
    """
    settings = frames.scene.training
    return fit(
        with_rounding_noise(network, frames.scene.felt_rounding_bits, frames.scene.felt_weight_bits),
        frames,
        frames.index("train"),
        validation=frames.index("validation"),
        share=settings.normals_share if settings.depth_weight else 1.0,
        epochs=settings.depth_epochs,
        rate=settings.sums_learning_rate,
        progress=progress,
    )
