"""What a few presses of a second unit are worth: the first unit's network adapted, against training anew.

The second units are virtual ones (units.py). Errors are those of the integers on presses of the second unit
that no training saw, with the unit's own background in every case. Each unit's presses are taken in one
random order, so that more presses include the fewer.
"""

import shutil
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from fastac.flow import adapt, few_presses, frames
from fastac.flow.adapt import BUNDLE
from fastac.flow.build import Build
from fastac.flow.steps import virtual_presses
from fastac.models import accuracy
from fastac.models.integer import bundle as bundles
from fastac.models.integer.bundle import Bundle
from fastac.models.training.transfer import TUNES
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.store.files import write_json
from fastac.store.progress import progress_bar
from fastac.studies.transfer.units import unit_of

AS_IS, CHOSEN, ANEW = "as it is", "adapt chooses", "trained anew"
WAYS = (AS_IS, *TUNES, CHOSEN, ANEW)
MOST_EPOCHS = 20
"""How often more epochs a training anew on few presses has, at most: as many steps as on all of them."""


def few(path: Path, data: Dataset, count: int, seed: int, output: Path) -> None:
    """Write `output`, the dataset with the first `count` places of a random order in the split train, the
    others out of the way: in the split test, as its own test presses are.

    Raises ValueError where there are fewer places.
    """
    press, names = few_presses.presses(data), few_presses.known_presses(data)
    if count > len(names):
        raise ValueError(f"presses = {count}: expected at most {len(names)}, the places of the protocol")
    order = np.random.default_rng(seed).permutation(len(names))
    chosen = [names[k] for k in order[:count]]
    shutil.copyfile(path, output)
    with h5py.File(output, "r+") as file:
        split = np.where(np.isin(press, chosen), "train", "test")
        del file["split"]
        file.create_dataset("split", data=split.astype("S"), dtype=h5py.string_dtype("utf-8"))


def anew(scene: Scene, share: float) -> Scene:
    """The scene with as many steps of training as with all presses, where there is a `share` of them."""
    more = min(1 / share, MOST_EPOCHS)
    training = scene.training
    epochs = {
        name: round(getattr(training, name) * more)
        for name in ("normals_epochs", "depth_epochs", "finetune_epochs", "force_epochs")
    }
    return scene.model_copy(update={"training": training.model_copy(update=epochs)})


def errors_of(bundle: Bundle, data: Dataset, index: np.ndarray) -> dict[str, float]:
    """The integers' errors on the frames `index` of a unit."""
    found, _ = accuracy.compare_pipelines(bundle, data, index, progress=False)
    return {name: value for name, value in found["integer"].items() if name in METRICS}


METRICS = {
    "normal_mae_deg": "normals' error, °",
    "depth_mae_mm": "depth error, mm",
    "force_mae_n": "force error, N",
}


def run(
    scene: Scene,
    folder: Path,
    *,
    units: int = 3,
    counts: Sequence[int] = (1, 3, 10, 30),
    progress: bool = True,
) -> dict:
    """Train the first unit, adapt it to others and train them anew; writes transfer.json into `folder`.

    counts : numbers of presses, places of the protocol, of a second unit
    Everything is kept in the store of the folder. Returns {"scene", "units", "counts", "errors": {unit: {way:
    {count: {metric: error}}}}, "left_out": [what could not be trained]}.
    """
    folder.mkdir(parents=True, exist_ok=True)
    store = folder / "store"
    Build(scene, folder / "first", None, progress).run(lambda name, state: None, until="bundle")
    first = folder / "first" / "bundle"
    known = bundles.load(first)
    errors: dict[str, dict] = {}
    left_out = []
    total = units * (1 + len(counts) * (len(WAYS) - 1))
    bar = progress_bar(total=total, desc="second units", unit="training", enabled=progress, leave=True)
    for number in range(1, units + 1):
        unit = unit_of(scene, number)
        path = virtual_presses(unit, store, progress=False)
        data = frames.read(path, unit, store=store)
        test, places = data.indices("test"), len(few_presses.known_presses(data))
        found = errors.setdefault(str(number), {way: {} for way in WAYS})
        found[AS_IS]["0"] = errors_of(known, data, test)
        bar.update()
        for count in counts:
            taken = folder / f"unit-{number}-{count}.h5"
            few(path, data, count, number, taken)
            for way in WAYS[1:]:
                bar.set_postfix_str(f"unit {number}, {count} presses, {way}")
                name = f"unit-{number}-{count}-{way.replace(' ', '-')}"
                try:
                    if way == ANEW:
                        share = count / places
                        Build(anew(scene, share), folder / name, taken, False).run(
                            lambda name, state: None, until="bundle"
                        )
                    else:
                        adapt.adapt(
                            first, taken, folder / name, way if way in TUNES else None, progress=False
                        )
                    made = bundles.load(folder / name / BUNDLE)
                    found[way][str(count)] = errors_of(made, data, test)
                except ValueError as error:
                    left_out.append(f"unit {number}, {count} presses, {way}: {' '.join(str(error).split())}")
                bar.update()
            taken.unlink()
    bar.close()
    content = {
        "scene": scene.name,
        "units": units,
        "counts": list(counts),
        "errors": errors,
        "left_out": left_out,
    }
    write_json(folder / "transfer.json", content)
    return content
