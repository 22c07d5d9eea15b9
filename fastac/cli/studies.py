"""Commands of the studies: dots and slip, accuracy of the arithmetic, robustness."""

from pathlib import Path

import click

from fastac.cli.common import (
    INPUT,
    OUTPUT_FOLDER,
    Group,
    load_bundle,
    output_option,
    progress_option,
    store_option,
)


@click.group(cls=Group)
def study():
    """Studies of sensor, models and hardware; each prints a table."""


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
@click.argument("folders", metavar="BUILD_FOLDER...", type=INPUT, nargs=-1, required=True)
@progress_option
def attenuation(folders, progress):
    """Measure how much of gentle slopes is found, what the depth loses by it, and what gains would give back.

    Noise hides gentle slopes, and a pixel network's best guess is less than the slope. Printed for each build
    folder, on 192 held-out frames of its dataset or all where there are fewer: what share of the slopes'
    change from rest is found, by its size; the gain of each wavelength that brings the integers' displacement
    nearest to the truth on training frames; and the displacement's error without and with these gains, of any
    kind and of one that a tridiagonal solver could have. The scene must find depth, and the dataset know it
    everywhere.

    \b
    Example: fastac study attenuation build/fast
    """
    from fastac.studies.depth import attenuation as experiment

    for folder in folders:
        for line in experiment.measure(folder, progress=progress):
            click.echo(line)


@study.command()
@click.argument("folders", metavar="BUNDLE...", type=INPUT, nargs=-1, required=True)
@click.option(
    "--ball",
    "balls_mm",
    type=click.FloatRange(0, min_open=True),
    multiple=True,
    default=(12.0, 3.0),
    show_default="12, 3",
    metavar="MM",
    help="Diameter of another ball, beside the scene's; repeatable.",
)
@store_option("presses")
@progress_option
def peaks(folders, balls_mm, store, progress):
    """Compare depth with the truth for several balls and several lights, on the virtual fingertip.

    Printed for each BUNDLE, of its integers: by how many percent the largest displacement is off, and the
    mean error of the depth, for each load of the scene's protocol, at 16 places. The scene's own ball is
    pressed under other light than the background's, too: all channels brighter by 1 and 3%, and each channel
    of each frame by a gain of its own, with a standard deviation of 1%. The scene must find depth.

    \b
    Example: fastac study peaks build/paper build/fast
    """
    from fastac.studies.depth import peaks as experiment

    for line in experiment.measure(folders, balls_mm, store=store, progress=progress):
        click.echo(line)


@study.command()
@click.argument("folders", metavar="BUILD_FOLDER...", type=INPUT, nargs=-1, required=True)
@progress_option
def identities(folders, progress):
    """Measure how far fixed-point arithmetic departs from the three identities of docs/mathematics.md.

    Uses 192 held-out frames of each build folder's dataset, or all where there are fewer.

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
