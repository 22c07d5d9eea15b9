"""What forces are worth that were learned from forces alone: each of eight simulated objects left out once.

Beside the scene's training stand ridge regressions on the pixels and a quadratic in their sum, as in
`fastac evaluate --leave-one-group-out`; and the same with levelled light, and with what helps taken
away one after another: the symmetry of presses and the slopes' curl in training.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fastac.flow import frames, leave_one_out
from fastac.report.tables import Table
from fastac.scenes.schema import Scene
from fastac.store.files import write_json
from fastac.store.steps import Step
from fastac.store.store import open_store
from fastac.studies.grasps import recordings
from fastac.sweep import pools

FILE = "grasps.json"
WITHOUT = {"press_symmetry": False, "curl_weight": 0.0}
"""What helps, and its value where it is left out."""
WAYS = {
    "as recorded": ({}, {}),
    "levelled": ({"level_light": True}, {}),
    **{
        f"as recorded, without {' and '.join(list(WITHOUT)[:k])}": ({}, dict(list(WITHOUT.items())[:k]))
        for k in range(1, len(WITHOUT) + 1)
    },
}
"""Ways to train: what differs in the scene's sensor and training."""


def named(names: Sequence[str]) -> list[str]:
    """The ways of these names, all where there are none, in their order; raises ValueError for a name that is
    no way's."""
    for name in names:
        if name not in WAYS:
            raise ValueError(f"--way {name!r}: expected one of {', '.join(map(repr, WAYS))}")
    return [way for way in WAYS if way in names or not names]


def scenes(known: Scene) -> dict[str, Scene]:
    """For each way the scene `known` with that way's sensor and training."""
    return {
        way: known.model_copy(
            update={
                "sensor": known.sensor.model_copy(update=of_sensor),
                "training": known.training.model_copy(update=of_training),
            }
        )
        for way, (of_sensor, of_training) in WAYS.items()
    }


def measure(
    scene: Scene,
    output: Path,
    *,
    seeds: Sequence[int] = (1,),
    objects: Sequence[str] = tuple(recordings.OBJECTS),
    ways: Sequence[str] = tuple(WAYS),
    presses: int = 40,
    jobs: int | None = None,
    store: Path = frames.STORE,
    progress: bool = True,
) -> dict:
    """Leave each object out in each of the ways, with each seed; writes grasps.json, returns its content.

    seeds : of the trainings; ways : names in WAYS; jobs : processes side by side; None: one for each core
    Trainings are kept in the step store `store`. Raises FingertipError for a scene that does not learn from
    forces.
    """
    known, content = recordings.virtual(scene), {}
    arguments = {"scene": known, "objects": list(objects), "presses": presses, "seed": 1}
    step = Step("grasps", recordings.write, arguments, (recordings.RECORDINGS,), {"progress": progress})
    path = open_store(store).perform(step).path(recordings.RECORDINGS)
    of_ways = scenes(known)
    for way in ways:
        own = of_ways[way]
        data = frames.read(path, own, store=store, progress=progress)
        with pools.this_process() if jobs == 1 else pools.local_pool(jobs) as pool:
            found = leave_one_out.evaluate(
                data, own, path, store, seeds=seeds, start=pool.start, progress=progress
            )
        content[way] = found["runs"]
    result = {"source": "simulated", "presses": presses, "seeds": list(seeds), "ways": content}
    output.mkdir(parents=True, exist_ok=True)
    write_json(output / FILE, result)
    return result


def tables(content: dict) -> list[Table]:
    """For each way a row for each object, and their mean: its errors as means over the seeds."""
    found, count = [], len(content["seeds"])
    for way, runs in content["ways"].items():
        integers, ridge = (
            np.mean([run["mean_mae_n"][model] for run in runs]) for model in ("integer", "linear")
        )
        note = (
            f"Simulated; {count} training{'s' if count > 1 else ''} of each. Integers over the linear ridge:"
            f" {integers / ridge:.2f}."
        )
        title, rows = f"Mean absolute errors of F_z, {way}", leave_one_out.rows(runs, digits=3)
        found.append(Table(title, leave_one_out.HEAD, rows, note))
    return found
