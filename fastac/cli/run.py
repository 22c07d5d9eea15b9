"""The command that runs hardware: frames in, forces out."""

import click

from fastac.cli.common import INPUT, OUTPUT_FILE, folder_of, load_bundle, progress_option
from fastac.cli.stream_options import INTERRUPTED, hardware_options, source_options


@click.command()
@click.argument("bundle", type=INPUT)
@source_options
@hardware_options()
@click.option(
    "--batch",
    type=click.IntRange(1),
    help="Frames that may be in flight. [default: 1 for a camera, else as many as there is room for]",
)
@click.option("--csv", "csv_file", type=OUTPUT_FILE, help="Write a line a frame to this file.")
@click.option("--hdf5", "hdf5_file", type=OUTPUT_FILE, help="Write results and images to this file.")
@click.option(
    "--images/--no-images", default=True, help="With --hdf5: write the images too, or numbers only."
)
@click.option("--force", is_flag=True, help="Replace output files that exist.")
@click.option(
    "--capture-background",
    is_flag=True,
    help="First let the hardware take a new background: that of the dataset or folder, else the first frame.",
)
@click.option(
    "--calibration",
    type=INPUT,
    help="First load this file of `fastac calibration`; with the emulator the bundle it was written from.",
)
@progress_option
def run(
    bundle,
    source,
    via,
    split,
    fit,
    frames,
    batch,
    csv_file,
    hdf5_file,
    images,
    force,
    capture_background,
    calibration,
    verilog_folder,
    bitstream,
    timeout_s,
    progress,
):
    """Send frames through the hardware of BUNDLE and show forces, flags, frame rate and latency as they come.

    Results are written as they arrive. Ctrl-C ends the run: frames in flight are waited for, what has arrived
    is kept, a summary is printed, and the exit status is 130. A frame whose result does not come is reported
    as lost, and the next ones go on.

    \b
    Example: fastac run build/paper --via sim --frames 3 --csv forces.csv
    """
    from fastac.driver import description as descriptions
    from fastac.driver.driver import Driver
    from fastac.driver.fitting import fitting_of
    from fastac.driver.live import Live
    from fastac.driver.recorder import CsvRecorder, Hdf5Recorder
    from fastac.driver.run import run as run_frames
    from fastac.driver.sources import open_source
    from fastac.driver.transports.choice import open_transport, words_of_calibration

    for path in (csv_file, hdf5_file):
        if path is not None and path.exists() and not force:
            raise click.ClickException(f"{path}: exists already; --force replaces it")
    model = load_bundle(bundle)
    folder = folder_of(bundle)
    verilog_folder = verilog_folder or folder / "verilog"
    description = descriptions.read(verilog_folder)
    description.require_bundle(model.digest, str(verilog_folder / descriptions.FILE))
    origin = source or str(folder / "data.h5")
    fitting = fitting_of(model.pipeline, any_size=fit)
    given = open_source(origin, model.scene, split=split, fitting=fitting, progress=progress)
    with open_transport(
        via,
        description,
        bundle=model,
        verilog=verilog_folder,
        folder=folder / "run",
        bitstream=bitstream,
        calibration=calibration,
        progress=progress,
    ) as transport:
        any_bundle = calibration is not None
        driver = Driver(transport, description, timeout_s=timeout_s, any_bundle=any_bundle)
        if calibration is not None:
            driver.load_calibration(words_of_calibration(calibration, model))
        if capture_background:
            driver.capture_background(next(given.frames) if given.background is None else given.background)
        recorders = []
        if csv_file is not None:
            recorders.append(CsvRecorder(csv_file, description))
        if hdf5_file is not None:
            about = {"scene": description.scene, "bundle_sha256": model.digest, "via": via, "source": origin}
            recorders.append(Hdf5Recorder(hdf5_file, description, images=images, about=about))
        live = Live(enabled=progress)
        interrupted = run_frames(driver, given, recorders, live, frames=frames, batch=batch)
    for text in live.summary():
        click.echo(text)
    counts = driver.counts
    if counts.lost:
        click.echo(
            f"lost: {counts.timeouts} time-outs, {counts.dma_errors} DMA errors, {counts.missing} results"
            f" that did not come; the last: {driver.trouble}"
        )
    for path in (csv_file, hdf5_file):
        if path is not None:
            click.echo(path)
    if interrupted:
        raise SystemExit(INTERRUPTED)
