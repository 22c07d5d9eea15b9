"""Commands that measure the speed of models, ONNX, driver, stream, virtual rig and a sweep's workers."""

import click

from fastac.cli.common import INPUT, OUTPUT_FILE, Counts, Group, progress_option, store_option


@click.group(cls=Group)
def bench():
    """Measure speed on this machine; of several runs the fastest counts."""


@bench.command()
@click.argument("folders", metavar="BUILD_FOLDER...", type=INPUT, nargs=-1)
def models(folders):
    """Time the float pipeline, the emulator, and the int64 loop that the emulator must equal on every value.

    \b
    Example: fastac bench models build/paper build/fast
    """
    from fastac.studies.benchmarks import models as benchmark

    if not folders:
        raise click.UsageError("build folder: none; make one with fastac build SCENE")
    click.echo(benchmark.heading())
    for folder in folders:
        for line in benchmark.measure(folder):
            click.echo(line)


@bench.command()
@click.argument("bundles", metavar="BUNDLE...", type=INPUT, nargs=-1, required=True)
def onnx(bundles):
    """Time BUNDLE's integers as ONNX under onnxruntime beside the emulator, one frame a call and many.

    Needs the extra `onnx`: pip install -e '.[onnx]'.

    \b
    Example: fastac bench onnx build/paper
    """
    from fastac.export.extra import require_onnx

    require_onnx()
    from fastac.studies.benchmarks import onnx_runtime as benchmark

    for bundle in bundles:
        for line in benchmark.measure(bundle):
            click.echo(line)


@bench.command()
@click.argument("folders", metavar="BUILD_FOLDER...", type=INPUT, nargs=-1, required=True)
def driver(folders):
    """Time the driver on the emulator: beside the emulator, and alone, in µs a frame.

    \b
    Example: fastac bench driver build/paper
    """
    from fastac.studies.benchmarks import driver as benchmark

    for folder in folders:
        for line in benchmark.measure(folder):
            click.echo(line)


@bench.command()
@click.argument("folders", metavar="BUILD_FOLDER...", type=INPUT, nargs=-1, required=True)
@click.option(
    "--frames", type=click.IntRange(1), default=2000, show_default=True, help="Frames for the latency."
)
def stream(folders, frames):
    """Time the stream of records: how many a second, and from a frame to its record in another process.

    \b
    Example: fastac bench stream build/paper
    """
    from fastac.studies.benchmarks import stream as benchmark

    for folder in folders:
        for line in benchmark.measure(folder, frames):
            click.echo(line)


@bench.command()
@click.argument("folders", metavar="BUILD_FOLDER...", type=INPUT, nargs=-1, required=True)
@click.option("--source", help="Where frames come from, as of fastac live. [default: BUILD_FOLDER/data.h5]")
@click.option("--frames", type=click.IntRange(1), default=2000, show_default=True, help="Frames of each run.")
@click.option(
    "--screenshot",
    type=OUTPUT_FILE,
    help="Measure nothing: play so many frames at 25 a second, and write a picture of the page, PNG.",
)
def live(folders, source, frames, screenshot):
    """Time the live view: frames a second with a page or a recording attached, and the first picture.

    Needs Chromium, its driver and Selenium: the page is shown in a browser without a window.

    \b
    Example: fastac bench live build/paper
    """
    from fastac.studies.benchmarks import live as benchmark

    for folder in folders:
        if screenshot is not None:
            benchmark.screenshot(folder, screenshot, frames, source)
            click.echo(screenshot)
            continue
        for line in benchmark.measure(folder, frames, source):
            click.echo(line)


@bench.command()
@click.argument("scene", type=INPUT)
@store_option("compliances")
@progress_option
def rig(scene, store, progress):
    """Time contacts and frames of SCENE's virtual rig, which must use finite elements.

    \b
    Example: fastac bench rig scenes/fingertip.toml
    """
    from fastac.scenes import schema
    from fastac.studies.benchmarks import rig as benchmark

    found = schema.load(scene)
    table = benchmark.measure(found, store, progress)
    size = f"{found.sensor.width_px} x {found.sensor.height_px}"
    repeats, stations = benchmark.REPEATS, benchmark.STATIONS
    click.echo(f"{scene}, {size} px, the fastest of {repeats} runs at each of {stations} stations:")
    click.echo(table)


@bench.command()
@click.argument("spec", type=INPUT)
@click.option("--points", type=click.IntRange(1), default=40, show_default=True, help="Number of points.")
@click.option("--workers", type=Counts(), default="1,2", show_default=True, help="Numbers of workers.")
@store_option("trained models")
def sweep(spec, points, workers, store):
    """Time the points of the sweep SPEC with several numbers of worker processes.

    \b
    Example: fastac bench sweep sweeps/quantisation.toml --workers 1,2
    """
    from fastac.studies.benchmarks import sweep as benchmark

    for line in benchmark.measure(spec, points, workers, store):
        click.echo(line)
