"""Commands that press the virtual rig, or plan the presses of a real one."""

from pathlib import Path

import click

from fastac.cli.common import (
    INPUT,
    OUTPUT_FILE,
    OUTPUT_FOLDER,
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
@output_option("The dataset to write, HDF5.", OUTPUT_FILE, "build/SCENE/data.h5")
@store_option("finite-element compliances, computed once for each gel")
@progress_option
def data(scene, output, store, progress):
    """Simulate presses of SCENE's virtual fingertip on the paper's three grids and write the dataset.

    The grids are those for training, validation and test. Samples whose tangential load exceeds what friction
    can carry are left out and counted.

    \b
    Example: fastac data scenes/paper.toml
    """
    import h5py

    from fastac.sensor.fingertip import generate

    scene = scenes.load(scene)
    output = output or build_folder(scene, None) / "data.h5"
    output.parent.mkdir(parents=True, exist_ok=True)
    generate(scene, output, store=store, progress=progress)
    click.echo(f"{output}: {output.stat().st_size / 1e6:.1f} MB, simulated")
    if scene.tangential_shares:
        with h5py.File(output, "r") as file:
            count, left_out = len(file["split"]), file.attrs.get("left_out", 0)
        click.echo(f"{count} samples; {left_out} left out, whose load the contact could not carry")


@click.command()
@click.argument("scene", type=INPUT)
@output_option("The CSV file to write.", OUTPUT_FILE)
@cad_options
@click.option(
    "--simulate",
    type=OUTPUT_FOLDER,
    metavar="FOLDER",
    help="Also press the virtual rig at these poses and write its recording here.",
)
@store_option("finite-element compliances, computed once for each gel")
@progress_option
def protocol(scene, output, cad, cad_pitch_mm, origin_mm, simulate, store, progress):
    """Write the poses and loads at which a machine shall press SCENE's sensor: CSV, one row per sample.

    Columns: split, index, x_mm, y_mm, z_mm, load_n, tangential_x_n, tangential_y_n. For each row the machine
    moves the ball's lowest point to x, y; contact begins at z. It presses until F_z is load_n and then drags
    until the force on the ball is tangential_x_n, tangential_y_n. The grids lie between the scene's
    protocol.corners_mm. `fastac import cnc` reads what the machine then recorded, and what --simulate writes.

    \b
    Example: fastac protocol scenes/fingertip.toml -o poses.csv --origin-mm 10 20 -5
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
            f"{simulate}: {len(samples)} frames, simulated; {samples.left_out} left out, whose load"
            " the contact could not carry"
        )
