"""Commands of the studies: dots and slip, accuracy of the arithmetic, robustness, the ablation of forces."""

from pathlib import Path

import click

from fastac.cli.common import (
    INPUT,
    OUTPUT_FOLDER,
    Counts,
    Group,
    load_bundle,
    output_option,
    progress_option,
    store_option,
)


@click.group(cls=Group)
def study():
    """Studies: dots, slip, shapes, identities, extremes, long runs, ablation, second units, presses, depth."""


@study.command()
@click.argument("scene", type=INPUT)
@click.argument("data", type=INPUT)
@store_option("processed frames")
@progress_option
def dots(scene, data, store, progress):
    """Compare the dots that the hardware's integers find, and those of the detector, with the true ones.

    DATA has the true places of the dots of the presses of SCENE's sensor, as those of a virtual sensor do.
    One line for each load and drag.

    \b
    Example: fastac study dots scenes/fingertip.toml build/fingertip/data.h5
    """
    from fastac.scenes import schema
    from fastac.studies.dots import accuracy

    for line in accuracy.measure(schema.load(scene), data, store=store, progress=progress):
        click.echo(line)


@study.command()
@click.option(
    "--coverage",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.9,
    show_default=True,
    help="Share of forces that shall be within their intervals.",
)
@click.option(
    "--objects",
    type=click.IntRange(1),
    nargs=3,
    default=(100, 1000, 1000),
    show_default=True,
    metavar="TRAIN CALIBRATE TEST",
    help="Objects that forces are learned from, intervals calibrated on, and forces counted on.",
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Seed of the objects.")
@output_option("Folder of the build and of coverage.json.", OUTPUT_FOLDER, "build/coverage")
@progress_option
def coverage(coverage, objects, seed, output, progress):
    """Count how many forces of new objects are within their intervals.

    Random balls, cylinders, edges, punches and lumps are pressed on a small virtual sensor; it learns forces
    from some, its intervals are calibrated on others (the scene key force.coverage) and judged by others
    still, with a confidence interval over the objects: as the frames are, and with drifts of gain and offset
    that the limits of frame validity leave unseen. All of it is simulated.

    \b
    Example: fastac study coverage
    """
    from fastac.studies.robustness import coverage as experiment

    splits = dict(zip(("train", "validation", "test"), objects, strict=True))
    output = output or Path("build/coverage")
    found = experiment.measure(output, coverage=coverage, objects=splits, seed=seed, progress=progress)
    for line in experiment.report(found):
        click.echo(line)
    click.echo(f"written: {output}/coverage.json")


@study.command()
@click.argument("bundle", type=INPUT)
@output_option("Folder for slip.json and .png.", OUTPUT_FOLDER, "build/SCENE/slip")
@store_option("finite-element compliances")
@progress_option
def slip(bundle, output, store, progress):
    """Drag objects over the virtual fingertip and compare BUNDLE's output slip with what sticks and slides.

    Balls and a cylinder are pressed at two places with the loads of the scene's protocol and pulled ever more
    strongly, up to 98% of what friction carries, with the scene's friction and with half of it. In every
    state the contact mechanics know what share of the nodes in contact sticks. Compared with it are slip_px,
    the spread that BUNDLE's integers find in the camera's frame, the same from the dots' true shifts, and
    F_t/F_z of the forces found. Printed by object: the area under the ROC curve for "fewer than half of the
    nodes stick", rank correlations within drags and mean spreads; then hits and false alarms of the scene's
    slip.limit_px and of the limits that separate best. BUNDLE's scene needs the outputs slip and force_xyz,
    finite elements and friction. It takes a minute; all of it is simulated.

    \b
    Example: fastac study slip build/fingertip
    """
    from fastac.studies.slip import study as experiment

    bundle = load_bundle(bundle)
    output = output or Path("build") / bundle.scene.name / "slip"
    for table in experiment.tables(experiment.run(bundle, output, store=store, progress=progress)):
        click.echo(f"{table.text}\n{table.note}".rstrip())
    click.echo(f"written: {output}/slip.json, .png")


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

    All ways have equally many presses: balls of three sizes with all pixels, the same with a tenth of the
    pixels at rest (training.still_share), and balls and other shapes with a tenth. Printed are the friction
    that the grasp's slip test finds on a bottle and, as by `fastac study shapes`, errors by kind of object.
    Minutes of processor time; an interrupted run goes on. All of it is simulated.

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
@click.argument("folders", metavar="BUILD_FOLDER...", type=INPUT, nargs=-1, required=True)
@progress_option
def identities(folders, progress):
    """Measure how far fixed-point arithmetic departs from the three identities of docs/mathematics.md.

    Uses the held-out frames of each build folder's dataset.

    \b
    Example: fastac study identities build/fast
    """
    from fastac.studies.equivalence import identities as equivalence

    for folder in folders:
        for line in equivalence.measure(folder, progress=progress):
            click.echo(line)


@study.command()
@click.argument("folder", metavar="BUILD_FOLDER", type=INPUT)
@click.option(
    "--rtl/--no-rtl",
    default=True,
    help="Also simulate the worst cases in the hardware of each stage, in Verilator.",
)
@store_option("what was compared in the hardware, and presses")
@progress_option
def extremes(folder, rtl, store, progress):
    """Test the bundle of a build folder with extreme inputs and with faults of the sensor.

    Every word at its worst case, frames that no camera sends, the deepest boundary prior, and faults such as
    drift that grow until frames are flagged. Writes extremes.json and extremes.png into BUILD_FOLDER.

    \b
    Example: fastac study extremes build/paper
    """
    from fastac.studies.robustness import extremes as robustness

    for line in robustness.measure(folder, store=store, rtl=rtl, progress=progress):
        click.echo(line)


@study.command()
@click.argument("folder", metavar="BUILD_FOLDER", type=INPUT)
@click.option(
    "--frames",
    type=click.IntRange(1),
    default=10_000,
    show_default=True,
    help="Number of frames through the emulator.",
)
@click.option(
    "--rtl-frames",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="Number of frames through the simulated hardware, whose Verilog must be in BUILD_FOLDER.",
)
@progress_option
def stability(folder, frames, rtl_frames, progress):
    """Run thousands of consecutive frames and check that no state is carried from one to the next.

    One frame recurs and must give the same values each time. Writes stability.json into BUILD_FOLDER.

    \b
    Example: fastac study stability build/paper --rtl-frames 100
    """
    from fastac.studies.robustness import stability as robustness

    for line in robustness.measure(folder, frames=frames, rtl_frames=rtl_frames, progress=progress):
        click.echo(line)


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
    from fastac.scenes import schema
    from fastac.studies.presses import curve, shown

    known = schema.load(scene)
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
