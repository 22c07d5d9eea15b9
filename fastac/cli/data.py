"""Commands of the virtual rig."""

from pathlib import Path

import click
import h5py

from fastac.cli.common import (
    INPUT,
    build_folder,
    cad_options,
    load_cad,
    output_option,
    progress_option,
    store_option,
)
from fastac.scenes import schema as scenes


@click.command()
@click.argument("scene", type=INPUT)
@output_option("build/SCENE/data.h5", "The dataset to write.")
@store_option("finite-element compliances, computed once for each gel")
@progress_option
def data(scene, output, store, progress):
    """Press the virtual fingertip of SCENE on the paper's three grids and write the dataset.

    Samples whose tangential load the contact cannot carry are left out and counted.
    """
    from fastac.sensor.fingertip import generate

    scene = scenes.load(scene)
    output = output or build_folder(scene, None) / "data.h5"
    output.parent.mkdir(parents=True, exist_ok=True)
    generate(scene, output, store=store, progress=progress)
    click.echo(f"{output}: {output.stat().st_size / 1e6:.1f} MB, simulated")
    if scene.tangential_shares:
        with h5py.File(output, "r") as file:
            count, left_out = len(file["split"]), file.attrs.get("left_out", 0)
        click.echo(f"{count} samples; friction could not carry {left_out}, left out")


@click.command()
@click.argument("scene", type=INPUT)
@click.option("-o", "--output", type=INPUT, required=True, help="The CSV file to write.")
@cad_options
@click.option(
    "--simulate", type=INPUT, metavar="FOLDER", help="Press the virtual rig so, and record it here."
)
@store_option("finite-element compliances, computed once for each gel")
@progress_option
def protocol(scene, output, cad, cad_pitch_mm, origin_mm, simulate, store, progress):
    """Write the poses and loads of SCENE's protocol for a machine, a CSV file with one row per sample.

    Columns split, index, x_mm, y_mm, z_mm, load_n, tangential_x_n, tangential_y_n: lead the ball's lowest
    point to x, y; it first touches the skin at z. Press until F_z is load_n, then drag until the force on the
    ball is tangential_x_n, tangential_y_n. The grids lie between the scene's protocol.corners_mm. --simulate
    records the virtual rig as `fastac import cnc` reads it.
    """
    import tempfile

    from fastac.sensor import dataset
    from fastac.sensor.fingertip import generate
    from fastac.sensor.importers import cnc, poses

    scene = scenes.load(scene)
    rows = cnc.planned_poses(scene, load_cad(scene, cad, cad_pitch_mm), origin_mm)
    output.parent.mkdir(parents=True, exist_ok=True)
    poses.write(output, rows)
    click.echo(f"{output}: {len(rows)} samples")
    if simulate:
        with tempfile.TemporaryDirectory(dir=output.parent) as folder:
            generate(scene, Path(folder) / "data.h5", store=store, progress=progress)
            samples = dataset.read(Path(folder) / "data.h5", scene)
        cnc.write_recording(scene, samples, simulate, origin_mm, progress)
        click.echo(
            f"{simulate}: {len(samples)} frames, simulated; friction could not carry {samples.left_out}"
        )
