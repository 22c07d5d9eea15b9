"""Commands that turn recordings in the layouts of other projects into datasets."""

import click

from fastac.cli.common import INPUT, OUTPUT_FILE, output_option, progress_option
from fastac.cli.import_options import px_per_mm_option, say_presses, size_options


@click.command("gs-sdk")
@click.argument("folder", type=INPUT)
@px_per_mm_option
@click.option(
    "--skip-unlabelled",
    is_flag=True,
    help="Leave out presses without label.npz, and count them; otherwise they are an error.",
)
@size_options
@output_option("The dataset to write, HDF5.", OUTPUT_FILE)
@progress_option
def gs_sdk(folder, px_per_mm, skip_unlabelled, height_px, width_px, output, progress):
    """Import a calibration FOLDER of gs_sdk, or of a fork of gsrobotics with the same tools.

    FOLDER holds catalog.csv, background.png and, for each press, gelsight.png and label.npz; balls of several
    sizes may be mixed. The split is that of train_test_split.json, or else every fifth press is in the test
    split. Photographs are padded with the background to the target's aspect ratio and resampled by area.
    --px-per-mm is 1 / ppmm of gs_sdk's configuration: 15.77 for a GelSight Mini at 320 x 240 px.

    \b
    Example: fastac import gs-sdk calib --px-per-mm 15.77 -o presses.h5
    """
    from fastac.sensor.importers.gs_sdk import import_folder

    output.parent.mkdir(parents=True, exist_ok=True)
    import_folder(
        folder,
        px_per_mm=px_per_mm,
        skip_unlabelled=skip_unlabelled,
        height_px=height_px,
        width_px=width_px,
        output=output,
        progress=progress,
    )
    say_presses(output)


@click.command("fots")
@click.argument("folder", type=INPUT)
@click.option("--ball-mm", type=float, required=True, help="Diameter of the ball, mm.")
@px_per_mm_option
@click.option(
    "--background",
    default="0000.png",
    show_default=True,
    metavar="NAME",
    help="Photograph of the untouched gel, in FOLDER.",
)
@size_options
@output_option("The dataset to write, HDF5.", OUTPUT_FILE)
@progress_option
def fots(folder, ball_mm, px_per_mm, background, height_px, width_px, output, progress):
    """Import the annotated ball presses of FOTS from FOLDER, its mlp_calib.

    FOLDER holds csv/annotate.csv with the circles, the photographs that it names, and 0000.png, the untouched
    gel. Every fifth press is in the test split. Photographs are padded with the background to the target's
    aspect ratio and resampled by area.

    \b
    Example: fastac import fots FOTS/mlp_calib --ball-mm 4.7 --px-per-mm 19.58 -o presses.h5
    """
    from fastac.sensor.importers.fots import import_folder

    output.parent.mkdir(parents=True, exist_ok=True)
    import_folder(
        folder,
        ball_mm=ball_mm,
        px_per_mm=px_per_mm,
        background=background,
        height_px=height_px,
        width_px=width_px,
        output=output,
        progress=progress,
    )
    say_presses(output)
