"""`fastac tune`: how a scene is trained, chosen on a recording."""

from pathlib import Path

from fastac.models.training.whole_frames.usable_frames import unknown_depth
from fastac.scenes.schema import Scene
from fastac.sensor.contact_circle import contact_circle
from fastac.sweep import pools, scene_file
from fastac.sweep.spec import point_of
from fastac.tune import space
from fastac.tune.groups import FEWEST, TuneError, folds_of, names_of
from fastac.tune.page import LABELS, axes_text, nested_table
from fastac.tune.trial import Source
from fastac.tune.tuning import Tuning


def tune(
    scene: Scene,
    data: Path,
    *,
    store: Path = Path("build/store"),
    candidates: int = 16,
    folds: int = 5,
    seeds: int = 3,
    hold_out: str | None = None,
    vary: tuple[str, ...] = (),
    keep: tuple[str, ...] = (),
    metric: tuple[str, ...] = (),
    with_test: bool = False,
    seed: int = 1,
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: bool = True,
) -> dict:
    """Compare ways to train a scene on the dataset in the file `data`; returns the content of tune.json.

    candidates : how many, the scene among them; folds : at most; seeds : trainings of what is judged
    hold_out, with_test : as `by` and `with_test` of `trial.Source`; vary, keep : as in `space.axes_of`
    metric : errors to compare by; empty: one each of direction, depth and force, as far as they are known
    jobs : local processes; None: one on each core; 1: none but this one
    scheduler : address of a Dask cluster, whose workers are used instead

    Raises TuneError, DatasetError or TrainingError for what cannot be tuned, in one line.
    """
    for name in metric:
        if name not in LABELS:
            raise TuneError(f"--metric {name}: expected one of {', '.join(LABELS)}")
    source = Source(data.resolve(), store.resolve(), hold_out, with_test)
    known, units = source.read(scene)
    if len(names_of(units)) < FEWEST:
        raise TuneError(
            f"{data}: {len(names_of(units))} groups or presses outside of the split test: expected {FEWEST}"
            " or more, for models to be compared on what they have not seen"
        )
    circles = any(contact_circle(known, index) is not None for index in range(len(known)))
    axes = space.axes_of(scene, vary, keep, circles=circles, depth=unknown_depth(known) is None)
    points = space.candidates(scene, axes, candidates, seed)
    parts = folds_of(units, min(folds, len(names_of(units))), seed)
    if scheduler:
        where = pools.dask_pool(scheduler)
    else:
        where = pools.this_process() if jobs == 1 else pools.local_pool(jobs)
    with where as pool:
        executor = pool.start()
        try:
            return Tuning(points, parts, source, seeds, executor, progress, tuple(metric)).run()
        finally:
            executor.shutdown(wait=False)


def write_scene(content: dict, path: Path) -> Path:
    """Write the winner's scene as TOML, with what was found of it as comments; returns the file."""
    axes = content["candidates"][content["winner"]]
    scene = point_of(Scene.model_validate(content["scene"]), axes, Path()).scene
    table = nested_table(content)
    lines = [
        f"fastac tune, from scene {content['scene']['name']}: {axes_text(axes)}",
        *(f"nested {row[0]}: {row[2]} (the scene: {row[1]})" for row in table.rows),
    ]
    scene_file.write(scene.model_dump(mode="json"), path, lines)
    return path
