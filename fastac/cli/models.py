"""Commands that train models, judge them and run them on frames."""

import os
from contextlib import nullcontext

import click
import numpy as np

from fastac.cli.common import (
    INPUT,
    OUTPUT_FILE,
    OUTPUT_FOLDER,
    Counts,
    build_folder,
    load_bundle,
    load_scene,
    output_option,
    progress_option,
    run_build,
    split_option,
    store_beside,
)
from fastac.report.tables import text_table
from fastac.sensor import samples as sensor_samples


@click.command()
@click.argument("scene", type=INPUT)
@click.option(
    "--data", type=INPUT, help="Dataset of a recorded sensor. [default: simulate the virtual fingertip]"
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    help="Seed in place of the scene's training.seed; the folder is then build/SCENE-seed-N.",
)
@output_option("The build folder.", OUTPUT_FOLDER, "build/SCENE")
@progress_option
def train(scene, data, seed, output, progress):
    """Train and quantise the models of SCENE and write the bundle. Resumes after an interruption.

    \b
    Example: fastac train scenes/force.toml --data recording.h5
    """
    from fastac.scenes.schema import with_seed

    scene = load_scene(scene, data)
    folder = build_folder(scene, output)
    if seed is not None:
        scene = with_seed(scene, seed)
        folder = output or folder.with_name(f"{folder.name}-seed-{seed}")
    run_build(scene, folder, data, progress, until="bundle")
    made = load_bundle(folder)
    click.echo(f"{folder / 'bundle'}: sha256 {made.digest}")
    print_remark(made.pipeline)


def print_remark(pipeline) -> None:
    """Where the intervals around forces hold less than the scene asks, say so."""
    from fastac.models import interval_accuracy

    said = interval_accuracy.remark(pipeline)
    if said:
        click.echo(said)


def print_errors(errors: dict) -> None:
    rows = []
    for key, value in errors["float"].items():
        growth = errors["growth_percent"].get(key)
        change = None if growth is None else f"{growth:+.2f}%"
        rows.append([key, f"{value:.6f}", f"{errors['integer'][key]:.6f}", change])
    rows += [[key, None, f"{count} values", None] for key, count in errors["saturated_values"].items()]
    click.echo(text_table(["error", "float", "integer", "growth"], rows))
    if "force_interval" in errors:
        from fastac.models import interval_accuracy

        for line in interval_accuracy.lines(errors["force_interval"]):
            click.echo(line)


@click.command()
@click.argument("bundle", type=INPUT)
@click.option("--data", type=INPUT, required=True, help="Dataset with the true normals, depths or forces.")
@split_option("test")
@click.option(
    "--leave-one-group-out",
    is_flag=True,
    help="Train once for each group of a recording, without it, and test on it.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1),
    help="Groups that are left out side by side. [default: one for each core]",
)
@click.option(
    "--seeds",
    type=Counts(),
    help="Seeds of the trainings with --leave-one-group-out, such as 1,2,3. [default: the scene's own]",
)
@click.option("--json", "json_file", type=OUTPUT_FILE, help="Also write the errors to this file.")
@progress_option
def evaluate(bundle, data, split, leave_one_group_out, jobs, seeds, json_file, progress):
    """Print the errors of BUNDLE's float and integer models against the ground truth of a dataset.

    With --leave-one-group-out, models like BUNDLE's are trained from the forces of all groups but one and
    tested on that one. Baselines are listed beside them: ridge regression on the pixels, the models' own last
    fit on the pixels, and a quadratic in the summed difference from the background. Each group is trained on
    one core. Finished trainings are kept in the step store.

    \b
    Example: fastac evaluate build/paper --data build/paper/data.h5
    """
    from fastac import api
    from fastac.flow import leave_one_out
    from fastac.store.files import write_json
    from fastac.sweep.pools import local_pool

    for option, value in (("--jobs", jobs), ("--seeds", seeds)):
        if value and not leave_one_group_out:
            raise click.UsageError(f"{option} is for --leave-one-group-out")
    jobs = jobs or os.cpu_count() or 1
    sensor = api.load(bundle)
    samples = sensor.read(data, progress=progress)
    if leave_one_group_out:
        with local_pool(jobs) if jobs > 1 else nullcontext() as pool:
            content = leave_one_out.evaluate(
                samples,
                sensor.scene,
                data,
                store_beside(bundle),
                seeds=seeds,
                start=pool and pool.start,
                progress=progress,
            )
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
    print_remark(sensor.bundle.pipeline)


@click.command()
@click.argument("bundle", type=INPUT)
@click.argument("data", type=INPUT)
@click.option("--float", "use_float", is_flag=True, help="Run the float models instead of the integer ones.")
@split_option("all")
@output_option("HDF5 file to write.", OUTPUT_FILE)
@progress_option
def predict(bundle, data, use_float, split, output, progress):
    """Compute the outputs of BUNDLE's scene for the frames of the dataset DATA and write them as HDF5.

    These are some of normals, depth_mm, force_n, force_map_n and slip_px. The integer model gives what the
    hardware gives, bit for bit; of a scene with force.coverage also force_half_width_n, half the width of the
    interval around each force.

    \b
    Example: fastac predict build/paper build/paper/data.h5 --split test -o outputs.h5
    """
    import h5py

    from fastac import api
    from fastac.store.files import write_atomically

    sensor = api.load(bundle)
    samples = sensor.read(data, progress=progress)
    index = sensor_samples.split_indices(samples, split, data)
    arithmetic = "float" if use_float else "integer"
    with write_atomically(output) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["bundle_sha256"] = sensor.digest
        file.attrs["arithmetic"] = arithmetic
        file.attrs["pitch_mm"] = samples.pitch_mm
        file.attrs["force_axes"] = ",".join(sensor.force_axes)
        file["frame_index"] = index
        names = list(sensor.outputs)
        if sensor.bundle.pipeline.interval is not None and not use_float:
            names.append("force_half_width_n")
            file.attrs["force_coverage"] = sensor.scene.force.coverage
        found = sensor.with_background(samples.background).run(
            samples.frames[index], arithmetic=arithmetic, outputs=names, progress=progress
        )
        for name in names:
            file[name] = np.asarray(getattr(found, name), np.float32)
    click.echo(f"{output}: {', '.join(sorted(names))} of {len(index)} frames")


@click.command()
@click.argument("bundles", type=INPUT, metavar="BUNDLE...", nargs=-1, required=True)
@click.option(
    "--load-n",
    type=click.FloatRange(min=0, min_open=True),
    help="Load of each press, N. [default: 3 × the protocol's largest]",
)
@output_option("Folder for the page, pictures and errors.", OUTPUT_FOLDER)
@progress_option
def objects(bundles, load_n, output, progress):
    """Press a strawberry, a fingerprint and LED pads on the virtual sensor; reconstruct them with BUNDLEs.

    All BUNDLEs see the same deformed skin, so that one of three channels and one of four can be compared.
    Writes objects.html (point clouds and three-axis forces on the curved surface, interactive), a picture of
    each object's normals and depth, and objects.json with the errors. The skin is the elastic-layer model,
    solved at every pixel. All of it is simulated.

    \b
    Example: fastac objects build/fingertip -o build/objects
    """
    from fastac.store.files import write_json, write_text
    from fastac.studies.demos import reconstruction as test_objects
    from fastac.studies.demos import reconstruction_figures

    shown = test_objects.reconstruct({path: load_bundle(path) for path in bundles}, load_n, progress=progress)
    output.mkdir(parents=True, exist_ok=True)
    for item in shown:
        reconstruction_figures.draw(item, output / f"{item.name}.png")
    write_text(output / "objects.html", reconstruction_figures.page(shown))
    content = test_objects.summary(shown)
    write_json(output / "objects.json", content)
    click.echo(test_objects.table(content))
    click.echo(output / "objects.html")
