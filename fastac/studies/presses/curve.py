"""How many presses, objects or recordings a scene needs: its errors over the number that it learned from."""

from collections.abc import Sequence
from concurrent.futures import as_completed
from pathlib import Path

import numpy as np

from fastac.scenes.schema import Scene, with_seed
from fastac.store.files import write_json
from fastac.store.progress import progress_bar
from fastac.store.store import open_store
from fastac.sweep import pools
from fastac.tune.groups import TuneError, names_of
from fastac.tune.trial import Source, perform, step_of

FILE = "presses.json"


def measure(
    scene: Scene,
    data: Path,
    output: Path,
    *,
    counts: Sequence[int],
    draws: int = 3,
    hold_out: str | None = None,
    seed: int = 1,
    store: Path = Path("build/store"),
    jobs: int | None = None,
    progress: bool = False,
) -> dict:
    """Train a scene on `counts` units of the dataset in the file `data`, chosen by chance `draws` times, and
    judge it on all others; returns the content of presses.json, which is written into `output`.

    hold_out : what a unit is, as `by` of `fastac.tune.groups.units_of`. Units of the split test count as any
        other; frames of the split validation stay what they are.
    jobs : local processes; None: one for each core
    The errors are those of the float models, each a mean over the units that were not learned from. Trainings
    are kept in the step store `store`. Raises TuneError, DatasetError or TrainingError, in one line.
    """
    source = Source(data.resolve(), store.resolve(), hold_out, True)
    _, units = source.read(scene)
    names = names_of(units)
    for count in counts:
        if not 1 <= count < len(names):
            raise TuneError(
                f"--presses {count}: {data} has {len(names)} presses or groups, some of which must judge"
            )
    tasks = {}
    for draw in range(draws):
        order = np.random.default_rng((seed, draw)).permutation(len(names))
        own = with_seed(scene, scene.training.seed + draw)
        for count in counts:
            aside = [names[k] for k in sorted(order[count:])]
            tasks[count, draw] = own, aside
    errors = _trained(tasks, source, jobs, progress)
    content = {
        "scene": scene.name,
        "data": str(data),
        "units": len(names),
        "counts": list(counts),
        "draws": draws,
        "errors": {str(count): [errors[count, draw] for draw in range(draws)] for count in counts},
    }
    output.mkdir(parents=True, exist_ok=True)
    write_json(output / FILE, content)
    return content


def _trained(tasks: dict, source: Source, jobs: int | None, progress: bool) -> dict:
    """By task, its errors, {metric: mean over the units left out}; those of kept trainings are read."""
    kept, found = open_store(source.store), {}
    for key, (scene, aside) in tasks.items():
        step = step_of(scene, source, aside)
        if kept.is_current(step):
            found[key] = kept.value(step)
    bar = progress_bar(total=len(tasks), desc="presses", unit="training", enabled=progress, leave=True)
    bar.update(len(found))
    with pools.this_process() if jobs == 1 else pools.local_pool(jobs) as pool:
        executor = pool.start()
        try:
            futures = {
                executor.submit(perform, scene.model_dump(mode="json"), source, aside): key
                for key, (scene, aside) in tasks.items()
                if key not in found
            }
            for future in as_completed(futures):
                found[futures[future]] = future.result()
                bar.update()
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
            bar.close()
    return {key: _mean(of_units) for key, of_units in found.items()}


def _mean(of_units: dict[str, dict[str, float]]) -> dict[str, float]:
    metrics = next(iter(of_units.values()))
    return {name: float(np.mean([errors[name] for errors in of_units.values()])) for name in metrics}
