"""Commands that train models and use them."""

import click
import h5py
import numpy as np

from fastac.cli.common import (
    INPUT,
    SPLITS,
    build_folder,
    load_bundle,
    output_option,
    progress_option,
    run_build,
)
from fastac.report.tables import text_table
from fastac.scenes import schema as scenes
from fastac.sensor import samples as sensor_samples


@click.command()
@click.argument("scene", type=INPUT)
@click.option("--data", type=INPUT, help="Recorded dataset; without it the virtual fingertip is pressed.")
@output_option("build/SCENE", "The build folder.")
@progress_option
def train(scene, data, output, progress):
    """Train and quantise the models of SCENE; writes the bundle. Resumes after an interruption."""
    scene = scenes.load(scene)
    folder = build_folder(scene, output)
    run_build(scene, folder, data, progress, until="bundle")
    click.echo(f"{folder / 'bundle'}: sha256 {load_bundle(folder).digest}")


def print_errors(errors: dict) -> None:
    rows = []
    for key, value in errors["float"].items():
        growth = errors["growth_percent"].get(key)
        change = None if growth is None else f"{growth:+.2f}%"
        rows.append([key, f"{value:.6f}", f"{errors['integer'][key]:.6f}", change])
    rows += [[key, None, f"{count} values", None] for key, count in errors["saturated_values"].items()]
    click.echo(text_table(["error", "float", "integer", "growth"], rows))


@click.command()
@click.argument("bundle", type=INPUT)
@click.option("--data", type=INPUT, required=True, help="Dataset with ground truth.")
@click.option("--split", type=SPLITS, default="test", show_default=True)
@click.option(
    "--leave-one-group-out",
    is_flag=True,
    help="Train again without each group of a recording, and test on it.",
)
@click.option("--json", "json_file", type=INPUT, help="Write the errors here too.")
@progress_option
def evaluate(bundle, data, split, leave_one_group_out, json_file, progress):
    """Errors of the float and the integer model of BUNDLE against ground truth.

    With --leave-one-group-out, of models like BUNDLE's, each trained from the forces of all groups but one;
    beside them a linear ridge on the pixels and a quadratic in the summed difference, which show what the
    network is worth. The trainings are kept beside the bundle, in leave_one_out, and resumed.
    """
    from fastac import api
    from fastac.flow import leave_one_out
    from fastac.store.files import write_json

    sensor = api.load(bundle)
    samples = sensor.read(data, progress=progress)
    if leave_one_group_out:
        folder = (bundle if (bundle / "bundle").is_dir() else bundle.parent) / "leave_one_out"
        content = leave_one_out.evaluate(samples, sensor.scene, data, folder, progress=progress)
        if json_file:
            write_json(json_file, content)
        click.echo(leave_one_out.table(content))
        return
    index = sensor_samples.split_indices(samples, split, data)
    errors = sensor.errors(samples, index, progress=progress)
    if json_file:
        write_json(json_file, {"data": str(data), "split": split, "frames": len(index), **errors})
    click.echo(f"{data}: {len(index)} frames, {samples.source}")
    print_errors(errors)


@click.command()
@click.argument("bundle", type=INPUT)
@click.argument("data", type=INPUT)
@click.option("--float", "use_float", is_flag=True, help="Run the float models instead of the integers.")
@click.option("--split", type=SPLITS, default="all", show_default=True)
@click.option("-o", "--output", type=INPUT, required=True, help="HDF5 file to write.")
@progress_option
def predict(bundle, data, use_float, split, output, progress):
    """Normals, depth_mm, force_n and force_map_n of the frames in DATA, as BUNDLE's scene wants them.

    The integers are those of the hardware, bit for bit.
    """
    from fastac import api

    sensor = api.load(bundle)
    samples = sensor.read(data, progress=progress)
    index = sensor_samples.split_indices(samples, split, data)
    arithmetic = "float" if use_float else "integer"
    output.parent.mkdir(parents=True, exist_ok=True)
    if output.is_dir():
        raise IsADirectoryError(f"{output}: is a folder; give the name of a file")
    temporary = output.with_name(f".{output.name}.part")
    try:
        with h5py.File(temporary, "w") as file:  # before the frames, so that a bad path fails now
            file.attrs["bundle_sha256"] = sensor.digest
            file.attrs["arithmetic"] = arithmetic
            file.attrs["pitch_mm"] = samples.pitch_mm
            file.attrs["force_axes"] = ",".join(sensor.force_axes)
            file["frame_index"] = index
            found = sensor.with_background(samples.background).run(
                samples.frames[index], arithmetic=arithmetic, outputs=sensor.outputs, progress=progress
            )
            for name in sensor.outputs:
                file[name] = np.asarray(getattr(found, name), np.float32)
        temporary.replace(output)
    finally:
        temporary.unlink(missing_ok=True)
    click.echo(f"{output}: {', '.join(sorted(sensor.outputs))} of {len(index)} frames")


@click.command()
@click.argument("bundles", type=INPUT, metavar="BUNDLE...", nargs=-1, required=True)
@click.option(
    "--load-n", type=click.FloatRange(min=0, min_open=True), help="[default: 3 × the protocol's largest]"
)
@click.option("-o", "--output", type=INPUT, required=True, help="Folder for the page, pictures and errors.")
@progress_option
def objects(bundles, load_n, output, progress):
    """Press a strawberry, a fingerprint and LED pads on the virtual sensor; BUNDLEs reconstruct them.

    Give one of three channels and one of four to compare them: they see the same skin. Writes objects.html
    with point clouds to turn and the three-axis force on the curved surface, a picture of each object with
    normals and depth, and objects.json with the errors. The objects are pressed on the elastic layer, which
    is solved at the pixels. All of it is simulated.
    """
    from fastac.store.files import write_json
    from fastac.studies.demos import reconstruction as test_objects
    from fastac.studies.demos import reconstruction_figures

    shown = test_objects.reconstruct({path: load_bundle(path) for path in bundles}, load_n, progress=progress)
    output.mkdir(parents=True, exist_ok=True)
    for item in shown:
        reconstruction_figures.draw(item, output / f"{item.name}.png")
    temporary = output / ".objects.html.part"
    temporary.write_text(reconstruction_figures.page(shown), encoding="utf-8")
    temporary.replace(output / "objects.html")
    content = test_objects.summary(shown)
    write_json(output / "objects.json", content)
    click.echo(test_objects.table(content))
    click.echo(output / "objects.html")
