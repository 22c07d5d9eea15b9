"""The command that chooses how a model is trained, by cross-validation on a recording."""

from pathlib import Path

import click

from fastac.cli.common import INPUT, OUTPUT_FOLDER, load_scene, output_option, progress_option, store_option
from fastac.cli.export import refuse_existing


@click.command()
@click.argument("scene_file", type=INPUT, metavar="SCENE")
@click.option("--data", type=INPUT, required=True, help="Dataset of a recorded sensor.")
@output_option("Folder of the winner's scene, tune.json and tune.html.", OUTPUT_FOLDER, "build/SCENE-tuned")
@click.option(
    "--candidates",
    type=click.IntRange(1, 1000),
    default=16,
    show_default=True,
    help="How many ways to train are compared, the scene's own among them.",
)
@click.option(
    "--folds",
    type=click.IntRange(3, 20),
    default=5,
    show_default=True,
    help="Parts that groups or presses are divided into; fewer where there are fewer of them.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 20),
    default=3,
    show_default=True,
    help="Trainings of what is judged at the end, each with a seed of its own.",
)
@click.option(
    "--hold-out",
    type=click.Choice(["group", "press"]),
    help="What is left out in one piece. [default: the dataset's groups where there are three, else presses]",
)
@click.option(
    "--vary",
    multiple=True,
    metavar="KEY=V,V,...",
    help="Search this key of the scene, too, or among other values; repeatable. Keys such as network.width"
    " change the hardware.",
)
@click.option("--keep", multiple=True, metavar="KEY", help="Do not search this key; repeatable.")
@click.option("--metric", multiple=True, help="Compare by this error alone; repeatable.")
@click.option(
    "--with-test",
    is_flag=True,
    help="Fold the presses of the split test with the others; none are looked at at the end then.",
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Of folds and candidates.")
@click.option("--jobs", type=click.IntRange(1), help="Local processes. [default: one for each core]")
@click.option(
    "--scheduler", metavar="ADDRESS", help="Run on the Dask cluster of this scheduler, as fastac sweep does."
)
@store_option("trainings")
@click.option("--force", is_flag=True, help="Replace the output folder's files if it exists.")
@progress_option
def tune(scene_file, data, output, jobs, scheduler, store, force, progress, **options):
    """Choose how SCENE is trained from the data alone: light, smoothing, noise, teachers, epochs, rates.

    Candidates differ from SCENE in keys that cost the hardware no multiplier, and are compared by
    cross-validation over whole groups or presses, never over frames of one. Those that do worse on a few
    pairs of folds drop out early. The nested error says what the choice is worth: for each fold a choice was
    made without it. The split test is looked at once, at the end. Trainings are kept in the step store, so
    that an interrupted run goes on where it stopped.

    \b
    Example: fastac tune scenes/gelsight.toml --data build/presses.h5
    """
    from fastac.store.files import write_json
    from fastac.tune import page
    from fastac.tune import run as tuning

    if scheduler and jobs:
        raise click.UsageError("--jobs is of local processes: give it or --scheduler")
    scene = load_scene(scene_file, data)
    output = output or Path("build") / f"{scene.name}-tuned"
    refuse_existing(output, force)
    content = tuning.tune(
        scene, data, store=store, jobs=jobs, scheduler=scheduler, progress=progress, **options
    )
    winner = tuning.write_scene(content, output / f"{output.name}.toml")
    write_json(output / "tune.json", content)
    page.write(content, output / "tune.html")
    for table in page.tables(content):
        click.echo(f"{table.text}\n{'  ' + table.note if table.note else ''}\n")
    for warning in content["warnings"]:
        click.echo(f"warning: {warning}", err=True)
    click.echo(f"{winner}: {page.axes_text(content['candidates'][content['winner']])}")
    click.echo(output / "tune.html")
