"""The command that proves hardware at several widths."""

import click

from fastac.cli.common import (
    INPUT,
    SPLITS,
    Lanes,
    build_folder,
    load_bundle,
    output_option,
    progress_option,
    run_build,
)
from fastac.scenes import schema as scenes
from fastac.sensor import samples as sensor_samples


@click.command()
@click.argument("source", type=INPUT, metavar="SCENE|BUNDLE")
@click.option(
    "--data",
    type=INPUT,
    help="Dataset to take frames from. [default: data.h5 in the build folder; of a recorded sensor: none]",
)
@click.option("--split", type=SPLITS, default="all", show_default=True)
@click.option("--lanes", type=Lanes(), default="1,2,4", show_default=True, help="Pixels a clock, of 1, 2, 4.")
@click.option(
    "--frames",
    type=click.IntRange(min=1),
    default=10,
    show_default=True,
    help="How many of the dataset, spread over the split; seven special ones are added.",
)
@output_option("BUNDLE/verify", "Folder for verify.json and, by lanes, bundles, Verilog and simulators.")
@progress_option
def verify(source, data, split, lanes, frames, output, progress):
    """Prove the hardware of SCENE or BUNDLE at several pixels a clock, and list what it took.

    Of a SCENE the model is trained first, unless its build folder has it. At each number of lanes the same
    model becomes hardware with a hash of its own. The frames, then one all black, one all white, a
    checkerboard, one with a bright pixel, two with pixels and rows missing and one of 0 or 255 at random go
    through it back to back; two of them once more with random stalls at both ends. Every value is compared
    with the integer model. Where loadable weights need more DSP slices than the device has, the weights are
    baked in, and the table says so.

    Rows are kept while Verilog and frames are the same, so an interrupted campaign goes on where it was.
    Times beyond 60 s to elaborate, 180 s to build and 20 s a frame (meant for two cores) are marked with "!".
    Ends with an error if any value differs.
    """
    from fastac.flow import verify as campaign
    from fastac.flow.frames import read

    folder = source
    if source.suffix == ".toml":
        scene = scenes.load(source)
        folder = build_folder(scene, None)
        run_build(scene, folder, data, progress, until="bundle")
    model = load_bundle(folder)
    data = data or folder / "data.h5"
    samples = read(data, model.scene, progress=progress)
    index = sensor_samples.evenly_spaced(sensor_samples.split_indices(samples, split, data), frames)
    output = output or folder / "verify"
    content = campaign.run(model, samples, index, lanes, output, progress=progress)
    click.echo(campaign.table(content))
    click.echo(output / campaign.FILE)
    mismatches = sum(row["mismatches"] for row in content["rows"])
    if mismatches:
        first = next(row["first_mismatch"] for row in content["rows"] if row["mismatches"])
        raise click.ClickException(f"{mismatches} mismatches; {first}")
