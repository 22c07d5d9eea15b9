"""The command that compares hardware with its model at several pixels a clock."""

import click

from fastac.cli.common import (
    INPUT,
    OUTPUT_FOLDER,
    Paces,
    build_folder,
    bundle_folder,
    folder_of,
    load_bundle,
    load_scene,
    output_option,
    progress_option,
    run_build,
    split_option,
    store_beside,
)
from fastac.sensor import samples as sensor_samples


@click.command()
@click.argument("source", type=INPUT, metavar="SCENE|BUNDLE")
@click.option(
    "--data",
    type=INPUT,
    help="Dataset whose frames are sent. [default: data.h5 in the build folder, if simulated]",
)
@split_option("all")
@click.option(
    "--lanes",
    type=Paces(),
    default="1,2,4",
    show_default=True,
    help="Pixels a clock at which to verify, some of 1, 2, 4, 1/2, 1/4, 1/8, 1/16.",
)
@click.option(
    "--frames",
    type=click.IntRange(min=1),
    default=10,
    show_default=True,
    help="Number of frames of the dataset, evenly spread over the split; seven special ones are added.",
)
@output_option(
    "Folder for verify.json and, by pixels a clock, bundles, Verilog and simulators.",
    OUTPUT_FOLDER,
    "BUNDLE/verify",
)
@progress_option
def verify(source, data, split, lanes, frames, output, progress):
    """Simulate the hardware of SCENE or BUNDLE at several pixels a clock; compare every value with the model.

    A SCENE is trained first, unless its build folder holds the bundle. For each number of pixels a clock
    (--lanes) the same model is made into hardware; below 1, pixels come one in so many clocks. Frames of the
    dataset go through it back to back, then one all black, one all white, a checkerboard, one with a bright
    pixel, two with missing pixels and rows and one of 0 or 255 at random; two frames once more with random
    stalls at input and output, as fast as they are taken. Weights that can be loaded at run time are baked in
    instead where the device has too few DSP slices for them, if that takes fewer; the table says so.

    Finished rows are kept while Verilog and frames are the same. Times above 60 s to elaborate, 180 s to
    build and 20 s a frame (meant for two cores) are marked with "!". Ends with an error if any value differs.

    \b
    Example: fastac verify scenes/paper.toml --lanes 1,4,1/16
    """
    from fastac.flow import verify as campaign
    from fastac.flow.frames import read

    folder = source
    if source.suffix == ".toml":
        scene = load_scene(source, data)
        folder = build_folder(scene, None)
        run_build(scene, folder, data, progress, until="bundle")
    model = load_bundle(folder)
    data = data or folder_of(folder) / "data.h5"
    samples = read(data, model.scene, progress=progress)
    index = sensor_samples.evenly_spaced(sensor_samples.split_indices(samples, split, data), frames)
    output = output or folder_of(folder) / "verify"
    content = campaign.run(
        bundle_folder(folder), samples, index, lanes, output, store=store_beside(folder), progress=progress
    )
    click.echo(campaign.table(content))
    click.echo(output / campaign.FILE)
    mismatches = sum(row["mismatches"] for row in content["rows"])
    if mismatches:
        first = next(row["first_mismatch"] for row in content["rows"] if row["mismatches"])
        raise click.ClickException(f"{mismatches} mismatches; {first}")
