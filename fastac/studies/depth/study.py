"""How far depth is off where no ball was pressed, and why: a virtual gel, recorded and trained as a real one.

What training learns from is what a recording knows: the ball's normals inside contact circles, and the
untouched gel. The presses that are measured are of the same ball and other bodies, from light to heavy, in
the middle of the image and near its border.
"""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from fastac.flow.training import learn_sums
from fastac.models.floating.network import PixelNetwork
from fastac.models.integer.light_level import levelled
from fastac.models.training import normals as train_normals
from fastac.scenes.schema import Scene
from fastac.sensor import dataset
from fastac.sensor.dataset import Dataset
from fastac.sensor.geometry import pixel_centres_mm
from fastac.store.files import load_arrays, save_arrays, write_json
from fastac.store.progress import progress_bar
from fastac.store.steps import Step
from fastac.store.store import Store, open_store
from fastac.studies.depth.causes import CAUSES, Cause
from fastac.studies.depth.measure import errors_of, found_slopes
from fastac.studies.depth.presses import (
    COUNTS,
    RECORDING,
    SKINS,
    Conditions,
    read_skins,
    virtual,
    write_recording,
    write_skins,
)

NETWORK = "network.npz"
PLAIN = {"circle_margin": 0.0, "flat_beyond": None, "flat_fraction": 0.2, "depth_weight": 0.0}
"""Keys of a training on whole circles and, a fifth, the untouched gel, for normals alone; a cause may set
them."""
SHORT = {"teachers": 0, "normals_epochs": 60, "normals_batch_px": 1024, "normals_learning_rate": 6e-3}
"""Keys of a training that takes seconds, in place of the scene's."""


def _read(recording: Path, level_light: bool) -> Dataset:
    """The dataset of a recording, its light levelled or as it came."""
    data = dataset.read(recording)
    return replace(data, frames=levelled(data.frames, data.background)) if level_light else data


def train(
    folder: Path, scene: Scene, skins: Path, recording: Path, level_light: bool, everywhere: bool
) -> None:
    """A step: the float network of a recording; everywhere: as if its presses' whole skin were known."""
    data = _read(recording, level_light)
    if everywhere:
        normals = data.normals.copy()
        labelled = data.indices("train")[:-1]  # the last is the untouched gel
        normals[labelled] = load_arrays(skins)["normals"][labelled]
        data = replace(data, normals=normals, valid=np.ones_like(data.valid))
    network, _ = train_normals.train(
        data,
        scene.training,
        scene.network.trained,
        smoothing_px=scene.network.smoothing_px,
        rounding_bits=scene.felt_rounding_bits,
    )
    learn_sums(network, data, data, scene)
    save_arrays(folder / NETWORK, network.arrays)


def measure(
    folder: Path,
    scene: Scene,
    skins: Path,
    recording: Path,
    level_light: bool,
    network: Path,
    presses: str,
    limit: int,
) -> list[dict]:
    """A step: `errors_of` each press to test with, its kind, and how near the border it is."""
    known, data = read_skins(skins, presses), _read(recording, level_light)
    model = PixelNetwork.from_arrays(load_arrays(network))
    x, y = pixel_centres_mm(scene.sensor)
    found = []
    for k in data.indices("test"):
        at_mm, radius_mm = known.at_mm[k], known.radius_mm[k]
        errors = errors_of(
            found_slopes(model, data, k, limit, scene.network.smoothing_px),
            data,
            k,
            in_contact=known.in_contact[k],
            distance_radii=np.hypot(x - at_mm[0], y - at_mm[1]) / radius_mm,
            limit=limit,
            divergence=scene.poisson.divergence,
        )
        to_border = float(min(x.max() - abs(at_mm[0]), y.max() - abs(at_mm[1])) / radius_mm)
        found.append({"kind": str(known.kind[k]), "border_radii": to_border, **errors})
    return found


def errors(scene: Scene, cause: Cause, seed: int, counts: dict[str, int], store: Store) -> list[dict]:
    """Errors of all presses to test with after one training; kept in the store."""
    training = scene.training.model_copy(update={"seed": seed, **cause.training})
    sees = scene.network.model_copy(update={"smoothing_px": cause.smoothing_px})
    own = scene.model_copy(update={"training": training, "network": sees})
    conditions = Conditions(**cause.conditions)
    pressed = Step("depth-skins", write_skins, {"scene": own, "counts": counts, "seed": 1}, (SKINS,))
    skins = {"scene": own, "skins": pressed.output(SKINS)}
    lit = {**skins, "conditions": asdict(conditions), "seed": seed}
    recording = Step("depth-recording", write_recording, lit, (RECORDING,)).output(RECORDING)
    shared = {**skins, "recording": recording, "level_light": cause.level_light}
    network = Step("depth-network", train, {**shared, "everywhere": cause.everywhere}, (NETWORK,))
    last = {
        **shared,
        "network": network.output(NETWORK),
        "presses": conditions.presses,
        "limit": cause.slope_limit or scene.numbers.slope_limit,
    }
    return store.perform(Step("depth-errors", measure, last)).value


def run(
    scene: Scene,
    folder: Path,
    *,
    seeds: Sequence[int] = (1, 2, 3),
    causes: Sequence[Cause] = CAUSES,
    counts: dict[str, int] | None = None,
    short: bool = True,
    progress: bool = True,
) -> dict:
    """Train and measure each cause with each seed; writes depth.json into `folder`.

    counts : presses by kind; not given: COUNTS
    scene : a flat, recorded one; its size, pitch, channels and keys of training are taken, these changed
        to PLAIN and, with `short`, to SHORT
    Returns {"scene", "seeds", "errors": {cause: [of each seed: [errors of each press]]}}.
    """
    folder.mkdir(parents=True, exist_ok=True)
    own, store = virtual(scene), open_store(folder / "store")
    keys = PLAIN | (SHORT if short else {})
    own = own.model_copy(update={"training": own.training.model_copy(update=keys)})
    found: dict[str, list] = {cause.name: [] for cause in causes}
    bar = progress_bar(
        total=len(causes) * len(seeds), desc="depth", unit="training", enabled=progress, leave=True
    )
    for cause in causes:
        for seed in seeds:
            bar.set_postfix_str(f"{cause.name}, seed {seed}")
            found[cause.name].append(errors(own, cause, seed, counts or COUNTS, store))
            bar.update()
    bar.close()
    content = {"scene": scene.name, "seeds": list(seeds), "errors": found}
    write_json(folder / "depth.json", content)
    return content
