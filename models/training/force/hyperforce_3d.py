"""Training of HyperForce on 3-D displacements: AdamW on the resultant, and a last layer in closed form.

The force is linear in the last layer's weights, so that the hidden layers' outputs are the features of a
ridge regression. It is solved for the hidden layers at their random initialisation, which takes seconds, and
again after training with AdamW; the model with the smallest validation error is returned. Batch, epochs,
learning rate, weight decay and seed are the scene's. Training stops early when the validation error no longer
falls. It can be interrupted after any epoch; resumed from its checkpoint, it gives bit for bit the same
model. Source: Lu et al., "FasTac": AdamW on the L1 error of the three resultants.
"""

import copy
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import torch

from fastac.models.floating.hyperforce import coordinates
from fastac.models.floating.hyperforce_3d import INPUTS, HyperForce3D
from fastac.models.floating.threads import single_thread
from fastac.models.training.force import ridge
from fastac.scenes.schema import Scene
from fastac.store.files import write_atomically
from fastac.store.progress import progress_bar

PATIENCE = 15
"""Epochs without a smaller validation error after which training stops."""
WARM_UP = 0.1
"""Share of all steps in which the learning rate rises linearly; it then falls as a cosine."""
MOMENTS = ("exp_avg", "exp_avg_sq", "step")


def input_components(scene: Scene, field_mm: np.ndarray, inputs: str) -> torch.Tensor:
    """A model's inputs, (frames, inputs, N, N) float32, from displacements (frames, 3, N, N) in mm.

    Negative d_z are set to zero if the scene clamps; d_x and d_y keep both signs.
    """
    chosen = field_mm[:, INPUTS[inputs]].astype(np.float32)
    if scene.force.clamp and "z" in inputs:
        np.maximum(chosen[:, -1], 0, out=chosen[:, -1])
    return torch.from_numpy(chosen)


@single_thread()
def train(
    scene: Scene,
    rest_depth_mm: np.ndarray,
    field_mm: dict[str, np.ndarray],
    force_n: dict[str, np.ndarray],
    *,
    inputs: str = "xyz",
    dynamic: bool = True,
    checkpoint: Path | None = None,
    progress: bool = False,
) -> tuple[HyperForce3D, list[dict]]:
    """Fit the model to the splits `train` and `validation`; returns it and its learning curve.

    field_mm : (frames, 3, N, N) displacements and force_n : (frames, axes), both by split name
    inputs, dynamic : the variant, see `HyperForce3D`
    checkpoint : file written after each epoch; if it exists, training resumes from it
    The first and the last entry of the curve are the closed-form solutions before and after AdamW. Raises
    ValueError where a split is missing, or the checkpoint is damaged or of another model.
    """
    for split in ("train", "validation"):
        if not len(field_mm.get(split, ())):
            raise ValueError(f"split: no frame is in {split!r}: training stops early by the validation split")
    x = {split: input_components(scene, field_mm[split], inputs) for split in ("train", "validation")}
    force = {split: torch.from_numpy(force_n[split].astype(np.float32)) for split in x}
    run = _Run(scene, rest_depth_mm, x["train"], force["train"], inputs, dynamic)
    start = refit_last_layer(run.model, x, force_n)
    first = {"epoch": 0} | _errors(start, x, force)
    if checkpoint is not None and checkpoint.exists():
        run.load(checkpoint)
    epochs = scene.training.force_epochs
    label = f"force, {'dynamic' if dynamic else 'fixed'} {inputs}"
    bar = progress_bar(total=epochs, initial=len(run.history), desc=label, unit="epoch", enabled=progress)
    while len(run.history) < epochs and not run.stalled:
        train_mae_n = run.epoch(x["train"], force["train"])
        run.judge(train_mae_n, error_n(run.model, x["validation"], force["validation"]))
        if checkpoint is not None:
            run.save(checkpoint)
        bar.update()
        bar.set_postfix(mae=f"{run.best_n:.4f} N")
    bar.close()
    run.model.load_state_dict(run.best_state)
    end = refit_last_layer(run.model, x, force_n)
    last = {"epoch": len(run.history) + 1} | _errors(end, x, force)
    tried = [
        (first["validation_mae_n"], start),
        (run.best_n, run.model),
        (last["validation_mae_n"], end),
    ]
    return min(tried, key=lambda pair: pair[0])[1], [first, *run.history, last]


def refit_last_layer(
    model: HyperForce3D, x: dict[str, torch.Tensor], force_n: dict[str, np.ndarray]
) -> HyperForce3D:
    """A copy of `model` with its last layer refitted by ridge regression, regularised by the validation
    split."""
    features = {split: model.features(frames) for split, frames in x.items()}
    fitted = copy.deepcopy(model)
    fitted.set_last_layer(ridge.best_weights(features, force_n)[0])
    return fitted


@torch.inference_mode()
def error_n(model: HyperForce3D, x: torch.Tensor, force_n: torch.Tensor) -> float:
    """Absolute error of the force in N, summed over its axes, mean over the frames."""
    return (model(x) - force_n).abs().sum(dim=1).mean().item()


def _errors(model: HyperForce3D, x: dict, force: dict) -> dict[str, float]:
    return {f"{split}_mae_n": error_n(model, x[split], force[split]) for split in x}


class _Run:
    """The state of a training run: model, optimiser, learning curve, and the best parameters so far."""

    def __init__(self, scene: Scene, rest_depth_mm, x, force_n, inputs: str, dynamic: bool):
        self.settings = settings = scene.training
        torch.manual_seed(settings.seed)
        self.model = HyperForce3D(
            coordinates(rest_depth_mm[1:-1, 1:-1]),
            kernel_size=scene.force.kernel_size,
            hidden=scene.force.hidden,
            inputs=inputs,
            dynamic=dynamic,
            axes=force_n.shape[1],
        )
        self.model.set_force_unit(x, force_n)
        self.optimiser = torch.optim.AdamW(
            self.model.parameters(),
            lr=settings.force_learning_rate,
            weight_decay=settings.force_weight_decay,
        )
        self.history: list[dict] = []
        self.best_n, self.best_state = np.inf, copy.deepcopy(self.model.state_dict())

    @property
    def stalled(self) -> bool:
        errors = [entry["validation_mae_n"] for entry in self.history]
        return len(errors) > PATIENCE and min(errors[-PATIENCE:]) > self.best_n

    def _rate(self, step: int, steps: int) -> float:
        warm = max(1, round(WARM_UP * steps))
        if step < warm:
            return self.settings.force_learning_rate * (step + 1) / warm
        return self.settings.force_learning_rate * (1 + np.cos(np.pi * (step - warm) / (steps - warm))) / 2

    def epoch(self, x: torch.Tensor, force_n: torch.Tensor) -> float:
        """One pass over the training frames; returns their mean error during it, in N."""
        number, count, total = len(self.history), len(x), 0.0
        # One generator per epoch, so that a resumed training shuffles as an uninterrupted one.
        order = np.random.default_rng((self.settings.seed, number)).permutation(count)
        batches = torch.from_numpy(order).split(self.settings.force_batch)
        for k, index in enumerate(batches, start=number * len(batches)):
            for group in self.optimiser.param_groups:
                group["lr"] = self._rate(k, self.settings.force_epochs * len(batches))
            loss = (self.model(x[index]) - force_n[index]).abs().sum(dim=1).mean()
            self.optimiser.zero_grad(set_to_none=True)
            loss.backward()
            self.optimiser.step()
            total += loss.item() * len(index)
        return total / count

    def judge(self, train_mae_n: float, validation_mae_n: float) -> None:
        """Append an epoch to the learning curve, and keep its parameters if they are the best so far."""
        self.history.append(
            {
                "epoch": len(self.history) + 1,
                "train_mae_n": train_mae_n,
                "validation_mae_n": validation_mae_n,
            }
        )
        if validation_mae_n < self.best_n:
            self.best_n, self.best_state = validation_mae_n, copy.deepcopy(self.model.state_dict())

    def save(self, path: Path) -> None:
        """Everything that the training goes on from; the file is never half there."""
        arrays = {f"model.{k}": v.numpy() for k, v in self.model.state_dict().items()}
        arrays |= {f"best.{k}": v.numpy() for k, v in self.best_state.items()}
        for k, parameter in enumerate(self.model.parameters()):
            for moment in MOMENTS:
                arrays[f"optimiser.{k}.{moment}"] = self.optimiser.state[parameter][moment].numpy()
        for key in self.history[0]:
            arrays[f"history.{key}"] = np.array([entry[key] for entry in self.history])
        with write_atomically(path) as temporary:
            np.savez(temporary, best_n=self.best_n, **arrays)

    def load(self, path: Path) -> None:
        """Raises ValueError where the file is damaged or of another model."""
        try:
            with np.load(path, allow_pickle=False) as stored:
                arrays = {key: stored[key] for key in stored.files}
            self._restore(arrays)
        except (OSError, EOFError, KeyError, ValueError, RuntimeError, BadZipFile) as error:
            reason = str(error).partition("\n")[0]
            raise ValueError(f"{path}: not a checkpoint of this training ({reason}): delete it") from None

    def _restore(self, arrays: dict[str, np.ndarray]) -> None:
        def state(name: str) -> dict[str, torch.Tensor]:
            return {key: torch.from_numpy(arrays[f"{name}.{key}"]) for key in self.model.state_dict()}

        self.best_state = state("best")
        self.model.load_state_dict(self.best_state)  # of the right shapes, or it is not this model's
        self.model.load_state_dict(state("model"))
        parameters = list(self.model.parameters())
        moments = {
            k: {moment: torch.from_numpy(arrays[f"optimiser.{k}.{moment}"]) for moment in MOMENTS}
            for k in range(len(parameters))
        }
        self.optimiser.load_state_dict(
            {"state": moments, "param_groups": self.optimiser.state_dict()["param_groups"]}
        )
        self.best_n = float(arrays["best_n"])
        keys = [key.removeprefix("history.") for key in arrays if key.startswith("history.")]
        columns = [arrays[f"history.{key}"].tolist() for key in keys]
        self.history = [dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True)]
