"""Training HyperForce on the displacements that the pipeline finds.

Source: Lu et al., "FasTac": L1 on the resultant, AdamW; every step needs each pixel's collapsed weight only
once, whatever the batch.
"""

import numpy as np
import torch
from tqdm import tqdm

from fastac.scene import Scene

from .hyperforce import HyperForce, coordinates
from .threads import single_thread


def build(scene: Scene, rest_depth_mm: np.ndarray, *, axes: int = 1) -> HyperForce:
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
    start: HyperForce | None = None,
    progress: bool = False,
) -> tuple[HyperForce, list[dict]]:
    """Fit the kernels; `displacement_mm` (frames, N, N) and `force_n` (frames, axes) by split name.

    Displacements are clamped at zero if the scene says so, as in the paper. What is best on the validation
    split is kept.
    start : go on from these kernels for `force_finetune_epochs`, maybe with another pipeline's displacements:
        the clamp turns noise into force, so kernels must know the noise of the arithmetic they run on.
    """
    settings = scene.training
    if scene.force.clamp:
        displacement_mm = {k: np.maximum(v, 0) for k, v in displacement_mm.items()}
    pressed = {k: torch.from_numpy(v.astype(np.float32)) for k, v in displacement_mm.items()}
    force = {k: torch.from_numpy(v.astype(np.float32)) for k, v in force_n.items()}
    torch.manual_seed(settings.seed)
    model = build(scene, rest_depth_mm, axes=force["train"].shape[1])
    if start is None:
        epochs, rate, label = settings.force_epochs, settings.force_learning_rate, "force, float"
        # Weights of order one give forces of the right order.
        volume = pressed["train"].abs().flatten(1).sum(dim=1).mean()
        model.unit.fill_(
            float(force["train"].abs().mean() / volume.clamp(min=1e-9)) / scene.force.kernel_size
        )
    else:
        epochs, rate = settings.force_finetune_epochs, settings.force_learning_rate
        label = "force, fine-tuning"
        model.load_state_dict(start.state_dict())
    if not epochs:
        return model, []
    optimiser = torch.optim.AdamW(model.parameters(), lr=rate, weight_decay=settings.force_weight_decay)
    count = len(pressed["train"])
    steps = epochs * -(-count // settings.force_batch)
    # OneCycleLR divides by the length of the warm-up less one step: in short trainings leave it out.
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, rate, total_steps=steps, pct_start=0.1 if steps > 10 else 0.05
    )
    generator = torch.Generator().manual_seed(settings.seed)
    best, best_state, history = np.inf, None, []
    if "validation" in pressed:  # what it starts from counts too: fine-tuning must not lose it
        best, best_state = _error(model, pressed, force, "validation"), _copy(model.state_dict())
    bar = tqdm(total=steps, desc=label, unit="step", disable=not progress, leave=False)
    for epoch in range(epochs):
        total = 0.0
        for index in torch.randperm(count, generator=generator).split(settings.force_batch):
            loss = (model(pressed["train"][index]) - force["train"][index]).abs().sum(dim=1).mean()
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            optimiser.step()
            schedule.step()
            total += loss.item() * len(index)
            bar.update()
        entry = {"epoch": epoch + 1, "train_mae_n": total / count}
        if "validation" in pressed:
            entry["validation_mae_n"] = _error(model, pressed, force, "validation")
            if entry["validation_mae_n"] < best:
                best, best_state = entry["validation_mae_n"], _copy(model.state_dict())
        history.append(entry)
        bar.set_postfix(mae=f"{entry.get('validation_mae_n', entry['train_mae_n']):.4f} N")
    bar.close()
    if best_state is not None:
        model.load_state_dict(best_state)
    return model, history


def _error(model: HyperForce, pressed: dict, force: dict, split: str) -> float:
    with torch.inference_mode():
        return (model(pressed[split]) - force[split]).abs().sum(dim=1).mean().item()


def _copy(state: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    return {k: v.clone() for k, v in state.items()}
