"""The command that makes a calibration for a second unit of a sensor from a few presses of it."""

import click

from fastac.cli.common import INPUT, OUTPUT_FOLDER, announce, bundle_folder, output_option, progress_option
from fastac.cli.export import refuse_existing


@click.command()
@click.argument("bundle", type=INPUT)
@click.option(
    "--data", type=INPUT, required=True, help="Dataset of the second unit's presses, with its own background."
)
@output_option("Folder to write: bundle, calibration.bin and adapt.json.", OUTPUT_FOLDER)
@click.option(
    "--tune",
    type=click.Choice(["none", "gains", "last", "all"]),
    help="What is tuned: nothing, gain and offset of each channel, the last layer, or everything."
    " [default: from 3 presses on what held-out presses say, else none]",
)
@click.option("--force", is_flag=True, help="Replace the output folder's files if it exists.")
@progress_option
def adapt(bundle, data, output, tune, force, progress):
    """Adapt BUNDLE to a second unit of the same sensor, for hardware that was built from BUNDLE.

    The float pixel network is trained on with the unit's presses, quantised with the same word lengths and
    fine-tuned bit-true; or it stays as it is and the unit's background replaces the first one's, where there
    are fewer than three presses or those held out do not gain. Frames of the split test are left alone.
    Written are a bundle, which every command takes, and calibration.bin, the words that the hardware of
    BUNDLE takes (`fastac run --calibration`); what cannot be loaded there is refused in one line. The force's
    weights stay those of the hardware. Where three presses or more have forces, the newtons of its unit are
    fitted anew, if that helps presses held out. Intervals around the force are widened until they hold the
    forces on these presses. Finished steps are kept in the step store beside the output.

    \b
    Example: fastac adapt build/gelsight --data build/second.h5 -o build/second
    """
    from fastac.flow import adapt as adaptation

    if output.absolute() in (bundle.absolute(), bundle_folder(bundle).absolute()):
        raise click.ClickException(f"{output}: is BUNDLE; give another folder")
    refuse_existing(output, force)
    found = adaptation.adapt(bundle, data, output, tune, announce=announce, progress=progress)
    if found["slope_errors"]:
        click.echo(adaptation.table(found["slope_errors"]))
    click.echo(f"presses: {found['presses']}, tuned: {found['tuned']}")
    click.echo(f"force: {found['force']}")
    if found["intervals"] != "none":
        click.echo(f"intervals: {found['intervals']}")
    click.echo(f"{output / adaptation.BUNDLE}: sha256 {found['bundle_sha256']}")
    click.echo(f"{output / adaptation.WORDS}: {found['words']} words, layout {found['layout']:#010x}")
