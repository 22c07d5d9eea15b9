"""Commands of the studies of training: what shapes, presses, units and labels do to the errors."""

from pathlib import Path

import click

from fastac.cli.common import (
    INPUT,
    OUTPUT_FOLDER,
    Counts,
    load_bundle,
    load_scene,
    output_option,
    progress_option,
    store_option,
)
from fastac.cli.studies import study


@study.command()
@click.argument("bundles", type=INPUT, metavar="BUNDLE...", nargs=-1, required=True)
@click.option(
    "--objects",
    "count",
    type=click.IntRange(1),
    default=40,
    show_default=True,
    help="Objects of each kind.",
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Seed of the objects.")
@output_option("Folder of shapes.json.", OUTPUT_FOLDER, "build/shapes")
@store_option("finite-element compliances")
@progress_option
def shapes(bundles, count, seed, output, store, progress):
    """Print what BUNDLEs find of the forces of new objects, kind by kind.

    Random balls, cylinders, edges, punches, lumps and bottles, none of which a protocol presses, are pressed
    and dragged on the virtual fingertip; all BUNDLEs, which are of one sensor, see the same frames. By kind
    and bundle: whether the scene's protocol has the kind, mean absolute errors, and how much too large or
    small shear, F_z and F_s/F_n come out. Scenes need the output force_xyz, finite elements and friction.
    All of it is simulated.

    \b
    Example: fastac study shapes build/fingertip build/shear
    """
    from fastac.studies.shapes import study as experiment

    output = output or Path("build/shapes")
    named = {str(path): load_bundle(path) for path in bundles}
    found = experiment.run(named, output, count=count, seed=seed, store=store, progress=progress)
    for table in experiment.tables(found):
        click.echo(f"{table.text}\n{table.note}")
    click.echo(f"written: {output}/shapes.json")


@study.command()
@click.option("--seeds", type=click.IntRange(1), default=2, show_default=True, help="Trainings of each way.")
@output_option("Folder of the builds and of mixtures.json.", OUTPUT_FOLDER, "build/mixtures")
@progress_option
def mixtures(seeds, output, progress):
    """Train a small fingertip on balls and on several shapes, and print its forces on objects it never met.

    All ways have equally many presses: balls of three sizes with all pixels, the same with squares of small
    errors (training.huber_delta), with depth to learn from (training.depth_weight) or with a tenth of the
    pixels at rest instead (training.still_share), and balls and other shapes with a tenth. Printed are the
    friction that the grasp's slip test finds on a bottle and, as by `fastac study shapes`, errors by kind of
    object. Minutes of processor time; an interrupted run goes on. All of it is simulated.

    \b
    Example: fastac study mixtures
    """
    from fastac.studies.shapes import mixtures as experiment

    output = output or Path("build/mixtures")
    for table in experiment.tables(experiment.measure(output, seeds=seeds, progress=progress)):
        click.echo(f"{table.text}\n{table.note}")
    click.echo(f"written: {output}/mixtures.json")


@study.command("force-ablation")
@click.argument("origin", metavar="SCENE|BUILD", type=INPUT)
@click.option("--data", type=INPUT, required=True, help="Dataset with forces along x, y and z.")
@click.option(
    "--displacements",
    type=click.Choice(["both", "true", "found"]),
    default="both",
    show_default=True,
    help="Displacements that forces are computed from: the true ones, those found in the frames, or both.",
)
@output_option("Folder for JSON and plot.", OUTPUT_FOLDER, "build/SCENE/force_ablation")
@store_option("displacements and finished trainings")
@progress_option
def force_ablation(origin, data, displacements, output, store, progress):
    """Train the six forms of HyperForce and print their errors beside the paper's table.

    With a SCENE (TOML file) the pixel network that finds the displacements is trained first; with a BUILD
    (build folder or bundle) its network is used. Finished trainings are kept, so an interrupted run resumes.

    \b
    Example: fastac study force-ablation scenes/fingertip.toml --data build/fingertip/data.h5
    """
    from fastac.models.integer import bundle as bundles
    from fastac.scenes import schema
    from fastac.studies.reproduce import force_ablation as ablation

    kinds = ("true", "found") if displacements == "both" else (displacements,)
    name = load_bundle(origin).scene.name if bundles.is_bundle(origin) else schema.load(origin).name
    output = output or Path("build") / name / "force_ablation"
    click.echo(ablation.table(ablation.run(origin, data, output, kinds, store, progress=progress)))
    click.echo(f"written: {output}/force_ablation.json, .png")


@study.command()
@click.argument("scene", type=INPUT)
@click.option(
    "--units", type=click.IntRange(1, 20), default=3, show_default=True, help="Number of second units."
)
@click.option(
    "--presses",
    type=Counts(),
    default="1,3,10,30",
    show_default=True,
    help="Numbers of presses of a second unit: places of the protocol, each with all of its loads.",
)
@output_option(
    "Folder for everything trained, transfer.json and .png.", OUTPUT_FOLDER, "build/SCENE-transfer"
)
@progress_option
def transfer(scene, units, presses, output, progress):
    """Adapt SCENE's first unit to others by a few presses, and compare that with training anew.

    Virtual units differ in light, coat, gel and camera. For each number of presses: the first unit's network
    as it is, its gains tuned, its last layer, all of it, what `fastac adapt` chooses of these, and a network
    trained on these presses alone, with as many steps as on all. Errors are the integers', on presses of the
    second unit that no training saw. All is kept in the output folder, so an interrupted study goes on.

    \b
    Example: fastac study transfer scenes/paper.toml --units 1 --presses 1,3
    """
    from fastac.scenes import schema
    from fastac.studies.transfer import shown
    from fastac.studies.transfer import study as experiment

    known = schema.load(scene)
    output = output or Path("build") / f"{known.name}-transfer"
    content = experiment.run(known, output, units=units, counts=presses, progress=progress)
    for table in shown.tables(content):
        click.echo(f"{table.text}\n{table.note}\n")
    for line in content["left_out"]:
        click.echo(f"left out: {line}", err=True)
    shown.write(content, output / "transfer.png")
    click.echo(f"written: {output}/transfer.json, .png")


@study.command()
@click.argument("scene", type=INPUT)
@click.option("--data", type=INPUT, required=True, help="Dataset of a recorded sensor.")
@click.option(
    "--presses",
    type=Counts(),
    default="3,10,30",
    show_default=True,
    help="Numbers of presses, or of groups, that are learned from.",
)
@click.option(
    "--draws", type=click.IntRange(1, 50), default=3, show_default=True, help="Choices of each number."
)
@click.option(
    "--hold-out",
    type=click.Choice(["group", "press"]),
    help="What counts as one. [default: the dataset's groups where there are three, else presses]",
)
@click.option("--jobs", type=click.IntRange(1), help="Local processes. [default: one for each core]")
@output_option("Folder for presses.json and .png.", OUTPUT_FOLDER, "build/SCENE-presses")
@store_option("trainings")
@progress_option
def presses(scene, data, presses, draws, hold_out, jobs, output, store, progress):
    """Say how many presses SCENE needs: its errors over the number that it was trained on.

    So many presses are chosen by chance, several times, SCENE is trained on them, and judged on all others.
    Trainings are kept in the step store, so an interrupted study goes on.

    \b
    Example: fastac study presses scenes/gelsight.toml --data build/presses.h5 --presses 5,10,20
    """
    from fastac.studies.presses import curve, shown

    known = load_scene(scene, data)
    output = output or Path("build") / f"{known.name}-presses"
    settings = {"counts": presses, "draws": draws, "hold_out": hold_out, "jobs": jobs, "store": store}
    content = curve.measure(known, data, output, **settings, progress=progress)
    table = shown.table(content)
    click.echo(f"{table.text}\n{table.note}")
    shown.write(content, output / "presses.png")
    click.echo(f"written: {output}/presses.json, .png")


@study.command()
@click.argument("scene", type=INPUT)
@click.option("--seeds", type=Counts(), default="1,2,3", show_default=True, help="Seeds of the trainings.")
@click.option(
    "--cause",
    "names",
    multiple=True,
    metavar="NAME",
    help="Only this cause, as it stands in the table, beside the training as recorded. Repeatable.",
)
@click.option(
    "--short/--as-the-scene",
    default=True,
    show_default=True,
    help="Trainings of seconds, without teachers, or with the scene's own epochs, batches and teachers.",
)
@output_option("Folder for everything trained, depth.json and .png.", OUTPUT_FOLDER, "build/SCENE-depth")
@progress_option
def depth(scene, seeds, names, short, output, progress):
    """Measure how far depth is off where no ball was pressed, and what makes it so.

    SCENE is a flat, recorded one. A virtual gel of its size is recorded as a laboratory would record it: 33
    heavy presses of one ball, each with a contact circle, and the untouched gel. The scene's training learns
    from these. Then presses of the same ball and of other bodies, light to heavy, are measured, whose skin is
    known everywhere: the signed errors of largest depth and volume, with one suspected cause changed at a
    time, and which part of the skin makes the error. All is simulated and kept in the output folder, so an
    interrupted study goes on.

    \b
    Example: fastac study depth scenes/gelsight.toml
    """
    from fastac.scenes import schema
    from fastac.studies.depth import causes, shown
    from fastac.studies.depth import study as experiment

    known = schema.load(scene)
    output = output or Path("build") / f"{known.name}-depth"
    chosen = causes.named(names) if names else causes.CAUSES
    content = experiment.run(known, output, seeds=seeds, causes=chosen, short=short, progress=progress)
    for table in shown.tables(content):
        click.echo(f"{table.text}\n{table.note}\n")
    shown.write(content, output / "depth.png")
    click.echo(f"written: {output}/depth.json, .png")


@study.command()
@click.argument("scene", type=INPUT)
@click.option("--seeds", type=Counts(), default="1", show_default=True, help="Seeds of the trainings.")
@click.option(
    "--presses", type=click.IntRange(1), default=40, show_default=True, help="Presses of each object."
)
@click.option(
    "--way",
    "names",
    multiple=True,
    metavar="NAME",
    help="Only this way to train, as its table is titled, such as 'as recorded' for SCENE's own. Repeatable.",
)
@click.option("--jobs", type=click.IntRange(1), help="Local processes. [default: one for each core]")
@output_option("Folder for grasps.json.", OUTPUT_FOLDER, "build/SCENE-grasps")
@store_option("recordings and trainings")
@progress_option
def grasps(scene, seeds, presses, names, jobs, output, store, progress):
    """Measure forces that were learned from forces alone, on objects that nothing was learned from.

    SCENE trains from forces, as scenes/grasp.toml does. Eight objects are pressed on a small virtual gel, and
    the light differs from recording to recording. Each object is left out once, beside ridge regressions on
    the pixels and a quadratic in their sum; and all of it with levelled light (sensor.level_light), without
    training.press_symmetry, and without training.curl_weight either.
    Trainings are kept in the step store, so an interrupted study goes on.

    \b
    Example: fastac study grasps scenes/grasp.toml --seeds 1,2 --way "as recorded"
    """
    from fastac.scenes import schema
    from fastac.studies.grasps import study as experiment

    ways = experiment.named(names)
    known = schema.load(scene)
    output = output or Path("build") / f"{known.name}-grasps"
    settings = {"seeds": seeds, "ways": ways, "presses": presses, "jobs": jobs, "store": store}
    content = experiment.measure(known, output, **settings, progress=progress)
    for table in experiment.tables(content):
        click.echo(f"{table.text}\n{table.note}\n")
    click.echo(f"written: {output}/{experiment.FILE}")
