"""Training of HyperForce, the hypernetwork of the force kernels, on displacements found by a pipeline.

As in the paper (Lu et al., "FasTac"): AdamW on the L1 error of the resultant force. A step computes one
collapsed weight per pixel for the whole batch, see `hyperforce.collapse`.
"""

import copy
from functools import partial

import numpy as np
import torch

from fastac.models.floating.hyperforce import HyperForce, coordinates
from fastac.models.floating.threads import single_thread
from fastac.models.training.best_epoch import BestEpoch
from fastac.models.training.epochs import descend, train_epochs
from fastac.models.training.force import ridge
from fastac.models.training.one_cycle import one_cycle
from fastac.scenes.schema import Scene


def build(scene: Scene, rest_depth_mm: np.ndarray, *, axes: int = 1) -> HyperForce:
    """The untrained model of a scene; rest_depth_mm (H, W) is the undeformed skin's depth."""
    return HyperForce(
        coordinates(rest_depth_mm[1:-1, 1:-1]),
        kernel_size=scene.force.kernel_size,
        hidden=scene.force.hidden,
        axes=axes,
    )


@single_thread()
def train(
    scene: Scene,
    rest_depth_mm: np.ndarray,
    displacement_mm: dict[str, np.ndarray],
    force_n: dict[str, np.ndarray],
    *,
    progress: bool = False,
) -> tuple[HyperForce, list[dict]]:
    """Fit the kernels; returns the model and the learning curve.

    displacement_mm : (frames, N, N) and force_n : (frames, axes), both by split name
    Negative displacements are set to zero if the scene clamps, as in the paper. The parameters with the
    smallest validation error are kept; without a validation split, the last ones.
    """
    settings = scene.training
    pressed = {k: torch.from_numpy(v.astype(np.float32)) for k, v in _pressed(scene, displacement_mm).items()}
    force = {k: torch.from_numpy(v.astype(np.float32)) for k, v in force_n.items()}
    torch.manual_seed(settings.seed)
    model = build(scene, rest_depth_mm, axes=force["train"].shape[1])
    model.set_force_unit(pressed["train"], force["train"])
    epochs, rate = settings.force_epochs, settings.force_learning_rate
    optimiser = torch.optim.AdamW(model.parameters(), lr=rate, weight_decay=settings.force_weight_decay)
    count = len(pressed["train"])
    steps = -(-count // settings.force_batch)
    schedule = one_cycle(optimiser, rate, epochs * steps)
    generator = torch.Generator().manual_seed(settings.seed)

    def step(index: torch.Tensor) -> float:
        error = (model(pressed["train"][index]) - force["train"][index]).abs().sum(dim=1).mean()
        return descend(error, optimiser, schedule)

    history = train_epochs(
        model,
        epochs,
        steps,
        lambda: torch.randperm(count, generator=generator).split(settings.force_batch),
        step,
        label="force",
        best=BestEpoch(),
        error=partial(_error, model, pressed, force, "validation") if "validation" in pressed else None,
        quantity="mae_n",
        progress=progress,
    )
    return model, history


def refit_last_layer(
    scene: Scene,
    model: HyperForce,
    displacement_mm: dict[str, np.ndarray],
    force_n: dict[str, np.ndarray],
    shifts_px: dict[str, np.ndarray] | None = None,
    *,
    with_validation: bool = False,
    together: dict[str, np.ndarray] | None = None,
) -> tuple[HyperForce, np.ndarray | None, list[dict]]:
    """Refit the hypernetwork's last layer by ridge regression, together with weights of the dots' shifts.

    shifts_px : (frames, M, 2) by split name
    with_validation : whether the weights are fitted to the frames of both splits once the regularisation is
        chosen, instead of to those of the train split
    together : which frames belong together; where the regularisation is chosen on frames of the train split,
        too, they are held out together, as by `ridge.held_out_errors`
    Returns a new model, the dots' weights (axes, M, 2) in N per px (None without shifts), and the validation
    errors.

    With the other layers fixed the force is linear in the last layer's weights, so they have a closed-form
    solution. It is computed for the displacements of the arithmetic that will be used: the clamp rectifies
    noise into force, so the kernels have to fit the noise of that arithmetic. Parameters as of `train`.
    """
    last, k = model.layers[-1], model.kernel_size
    with torch.inference_mode():
        hidden = model.layers[:-1](model.coordinate).double().numpy()
    hidden = np.concatenate([hidden, np.ones((len(hidden), 1))], axis=1)  # one more for the bias

    def features(frame: np.ndarray) -> np.ndarray:
        patches = np.lib.stride_tricks.sliding_window_view(np.pad(frame, k // 2), (k, k))
        return (hidden.T @ patches.reshape(len(hidden), k * k)).ravel()

    pressed = _pressed(scene, displacement_mm)
    x = {
        split: ridge.joined(np.array([features(frame) for frame in frames]), shifts_px and shifts_px[split])
        for split, frames in pressed.items()
    }
    ridge.check(force_n)
    # The other layers have learned from the train split, so that its frames are not quite unseen. Yet all
    # frames choose better than the few of the validation split, whose choices vary by chance.
    history = ridge.held_out_errors(x, force_n, together, with_validation=with_validation)
    found = ridge.fit_known(x, force_n, ridge.strongest(history), with_validation=with_validation)
    found, of_dots = ridge.parted(found, hidden.shape[1] * k * k)
    found = found / model.unit.item()
    weights = (
        found.reshape(hidden.shape[1], k * k, model.axes).transpose(2, 1, 0).reshape(-1, hidden.shape[1])
    )
    fitted = copy.deepcopy(model)
    with torch.no_grad():
        fitted.layers[-1].weight.copy_(torch.from_numpy(weights[:, :-1]).to(last.weight.dtype))
        fitted.layers[-1].bias.copy_(torch.from_numpy(weights[:, -1]).to(last.bias.dtype))
    return fitted, of_dots, history


def _pressed(scene: Scene, displacement_mm: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The displacements, with negative ones set to zero if the scene clamps."""
    if not scene.force.clamp:
        return displacement_mm
    return {split: np.maximum(frames, 0) for split, frames in displacement_mm.items()}


def _error(model: HyperForce, pressed: dict, force: dict, split: str) -> float:
    with torch.inference_mode():
        return (model(pressed[split]) - force[split]).abs().sum(dim=1).mean().item()
