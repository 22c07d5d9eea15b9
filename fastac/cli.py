"""The command line."""

import json
import os
import sys
from pathlib import Path

import click
import h5py
import numpy as np

from fastac import scene as scenes

INPUT = click.Path(path_type=Path)
SPLITS = click.Choice(["train", "validation", "test", "all"])


class Group(click.Group):
    """Errors that users can mend end in one line, not in a traceback."""

    def invoke(self, context):
        try:
            return super().invoke(context)
        except (click.exceptions.Exit, click.Abort):  # RuntimeErrors too, but not failures: --help, Ctrl-C
            raise
        except (ValueError, OSError, RuntimeError) as error:
            raise click.ClickException(" ".join(str(error).split()) or repr(error)) from error


def progress_option(command):
    return click.option("--progress/--no-progress", default=True, help="Show progress bars on stderr.")(
        command
    )


def output_option(default: str, text: str):
    return click.option("-o", "--output", type=INPUT, default=None, help=f"{text} [default: {default}]")


@click.group(cls=Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="fastac")
def main():
    """Vision-based tactile fingertips as verified FPGA hardware.

    A SCENE is a TOML file that says what one sensor and task require. A BUNDLE is the folder that training
    writes: every integer of the model; a build folder that contains one will do. DATA is an HDF5 dataset,
    generated or imported. `fastac build SCENE` runs everything in order.
    """


def load_bundle(path: Path):
    """The bundle in a folder, or in a build folder's `bundle`."""
    from models import bundle

    inside = path / "bundle"
    return bundle.load(inside if (inside / "bundle.json").exists() else path)


def build_folder(scene, output: Path | None) -> Path:
    return output or Path("build") / scene.name


def announce(name: str, current: bool) -> None:
    click.echo(f"{name:10s} {'up to date' if current else 'running'}", err=True)


def run_build(scene, folder: Path, data: Path | None, progress: bool, until: str | None) -> None:
    from fastac.build import Build

    Build(scene, folder, data, progress).run(announce, until=until)


@main.command()
@click.argument("scene", type=INPUT)
@output_option("build/SCENE/data.h5", "The dataset to write.")
@click.option(
    "--cache",
    type=INPUT,
    default=Path("build/cache"),
    show_default=True,
    help="Folder of finite-element compliances, computed once for each gel.",
)
@progress_option
def data(scene, output, cache, progress):
    """Press the virtual fingertip of SCENE on the paper's three grids and write the dataset.

    Samples whose tangential load the contact cannot carry are left out and counted.
    """
    from sensor.fingertip import generate

    scene = scenes.load(scene)
    output = output or build_folder(scene, None) / "data.h5"
    output.parent.mkdir(parents=True, exist_ok=True)
    generate(scene, output, cache=cache, progress=progress)
    click.echo(f"{output}: {output.stat().st_size / 1e6:.1f} MB, simulated")
    if scene.tangential_shares:
        with h5py.File(output, "r") as file:
            count, left_out = len(file["split"]), file.attrs.get("left_out", 0)
        click.echo(f"{count} samples; friction could not carry {left_out}, left out")


def cad_options(command):
    """The skin at rest, and where the machine has the sensor's origin."""
    options = [
        click.option(
            "--cad", type=INPUT, help="STL in mm, or height map .npy in mm. [default: the scene's skin]"
        ),
        click.option("--cad-pitch-mm", type=float, help="Distance of a height map's samples, mm."),
        click.option(
            "--origin-mm",
            type=float,
            nargs=3,
            default=(0.0, 0.0, 0.0),
            show_default=True,
            help="x, y, z of the sensor's origin in the machine's coordinates: the image's centre, the lowest"
            " corner of the skin.",
        ),
    ]
    for option in reversed(options):
        command = option(command)
    return command


def load_cad(scene, path: Path | None, pitch_mm: float | None):
    from sensor import cad

    return cad.of_file(scene.sensor, path, pitch_mm) if path else cad.of_scene(scene.sensor)


@main.command()
@click.argument("scene", type=INPUT)
@click.option("-o", "--output", type=INPUT, required=True, help="The CSV file to write.")
@cad_options
@click.option(
    "--simulate", type=INPUT, metavar="FOLDER", help="Press the virtual rig so, and record it here."
)
@click.option(
    "--cache",
    type=INPUT,
    default=Path("build/cache"),
    show_default=True,
    help="Folder of finite-element compliances, computed once for each gel.",
)
@progress_option
def protocol(scene, output, cad, cad_pitch_mm, origin_mm, simulate, cache, progress):
    """Write the poses and loads of SCENE's protocol for a machine, a CSV file with one row per sample.

    Columns split, index, x_mm, y_mm, z_mm, load_n, tangential_x_n, tangential_y_n: lead the ball's lowest
    point to x, y; it first touches the skin at z. Press until F_z is load_n, then drag until the force on the
    ball is tangential_x_n, tangential_y_n. The grids lie between the scene's protocol.corners_mm. --simulate
    records the virtual rig as `fastac import cnc` reads it.
    """
    import tempfile

    from fastac import cnc
    from sensor import dataset, poses
    from sensor.fingertip import generate

    scene = scenes.load(scene)
    rows = cnc.planned(scene, load_cad(scene, cad, cad_pitch_mm), origin_mm)
    output.parent.mkdir(parents=True, exist_ok=True)
    poses.write(output, rows)
    click.echo(f"{output}: {len(rows)} samples")
    if simulate:
        with tempfile.TemporaryDirectory(dir=output.parent) as folder:
            generate(scene, Path(folder) / "data.h5", cache=cache, progress=progress)
            samples = dataset.read(Path(folder) / "data.h5", scene)
        cnc.write_recording(scene, samples, simulate, origin_mm, progress)
        click.echo(
            f"{simulate}: {len(samples)} frames, simulated; friction could not carry {samples.left_out}"
        )


@main.group("import", cls=Group)
def import_():
    """Turn recordings into datasets."""


@import_.command("ball-press")
@click.argument("folder", type=INPUT)
@click.option(
    "--labels", type=INPUT, required=True, help="CSV: image, center_x_px, center_y_px, radius_px, split."
)
@click.option("--background", type=INPUT, required=True, help="Photograph with nothing touching.")
@click.option("--ball-mm", type=float, required=True, help="Diameter of the ball, mm.")
@click.option("--px-per-mm", type=float, required=True, help="Scale of the original photographs.")
@click.option(
    "--height-px", type=click.IntRange(16, 256), default=128, show_default=True, help="Rows to resample to."
)
@click.option(
    "--width-px", type=click.IntRange(16, 256), default=128, show_default=True, help="Columns likewise."
)
@click.option("-o", "--output", type=INPUT, required=True, help="The dataset to write.")
def ball_press(folder, labels, background, ball_mm, px_per_mm, height_px, width_px, output):
    """Import photographs of a ball pressed onto a flat gel, from FOLDER.

    Photographs are padded to the aspect of the target with the background, which is not valid, and resampled
    by area. Normals are known inside the labelled contact circle; around it they are unknown.
    """
    from sensor.ball_press import import_folder
    from sensor.dataset import read

    output.parent.mkdir(parents=True, exist_ok=True)
    import_folder(
        folder,
        labels,
        background,
        ball_mm=ball_mm,
        px_per_mm=px_per_mm,
        output=output,
        height_px=height_px,
        width_px=width_px,
    )
    written = read(output)
    counts = ", ".join(f"{len(written.indices(s))} {s}" for s in ("train", "validation", "test"))
    click.echo(f"{output}: {len(written)} frames ({counts}), pitch {written.pitch_mm:.5f} mm")


@import_.command("force")
@click.argument("source", metavar="VIDEO|FOLDER", type=INPUT)
@click.option(
    "--forces", type=INPUT, required=True, help="CSV: frame, force_z_n (or x, y and z), group, maybe split."
)
@click.option(
    "--background-frames", type=click.IntRange(1), required=True, help="The first so many show the rest."
)
@click.option(
    "--background-per-group", is_flag=True, help="Of each group, where light or skin drifts between them."
)
@click.option("--pitch-mm", type=float, required=True, help="Of a resampled pixel on the skin, mm.")
@click.option(
    "--held-out", multiple=True, metavar="GROUP", help="Test on this group; repeatable. [default: the last]"
)
@click.option(
    "--height-px", type=click.IntRange(16, 256), default=128, show_default=True, help="Rows to resample to."
)
@click.option(
    "--width-px", type=click.IntRange(16, 256), default=128, show_default=True, help="Columns likewise."
)
@click.option("-o", "--output", type=INPUT, required=True, help="The dataset to write.")
@progress_option
def force_recording(
    source,
    forces,
    background_frames,
    background_per_group,
    pitch_mm,
    held_out,
    height_px,
    width_px,
    output,
    progress,
):
    """Import frames with a force gauge's readings, from a video or a folder of photographs.

    The CSV file has one row per frame: `frame` is its index from 0 or its file name, z is positive in
    compression, `group` names the recording or object, which can be held out as a whole. Of the groups that
    are not held out, two stretches of frames, a fifth in all, are the validation split; a column `split` says
    otherwise. Only the background frames may lack a row. Photographs are padded to the target's aspect with
    the background and resampled by area.
    """
    from sensor.dataset import read
    from sensor.force_recording import import_recording

    output.parent.mkdir(parents=True, exist_ok=True)
    import_recording(
        source,
        forces,
        background_frames=background_frames,
        per_group=background_per_group,
        pitch_mm=pitch_mm,
        held_out=held_out,
        height_px=height_px,
        width_px=width_px,
        output=output,
        progress=progress,
    )
    written = read(output)
    counts = ", ".join(f"{len(written.indices(s))} {s}" for s in ("train", "validation", "test"))
    tested = ", ".join(dict.fromkeys(written.group[written.indices("test")].tolist()))
    click.echo(f"{output}: {len(written)} frames ({counts}), force {', '.join(written.force_axes)}")
    click.echo(f"test: {tested}")


@import_.command("cnc")
@click.argument("folder", type=INPUT)
@click.option(
    "--scene", type=INPUT, required=True, help="Scene of the sensor: size, pitch, channels, frames."
)
@cad_options
@click.option(
    "--ball-mm", type=float, help="Diameter of the ball, mm. [default: the scene's protocol.ball_mm]"
)
@click.option(
    "--raw-size-px", type=int, nargs=2, help="Rows and columns of .raw images. [default: the scene's window]"
)
@click.option("--skip-lost", is_flag=True, help="Leave out, and count, samples in which a marker is lost.")
@click.option("-o", "--output", type=INPUT, required=True, help="The dataset to write.")
@progress_option
def cnc_recording(
    folder, scene, cad, cad_pitch_mm, origin_mm, ball_mm, raw_size_px, skip_lost, output, progress
):
    """Import what a machine recorded in FOLDER: frames, poses and forces, with geometry from CAD and ball.

    FOLDER has poses.csv, with the columns that `fastac protocol` writes and force_x_n, force_y_n, force_z_n
    as the gauge measured them, and of each sample a frame named by its index: 000012.raw (packed RAW10) or
    .npy; of a scene of channels .npy or .png, NIR as 000012.nir.png. background.* has nothing touching. z_mm
    is where the ball's lowest point stood.

    Normals and depth are known, and valid, where the ball is certain to touch, of vertical samples only. The
    last sample is the background: the skin at rest.
    """
    from fastac import cnc
    from sensor.dataset import read

    scene = scenes.load(scene)
    output.parent.mkdir(parents=True, exist_ok=True)
    cnc.import_recording(
        scene,
        folder,
        load_cad(scene, cad, cad_pitch_mm),
        output,
        ball_mm=scene.protocol.ball_mm if ball_mm is None else ball_mm,
        origin_mm=origin_mm,
        raw_size_px=raw_size_px,
        skip_lost=skip_lost,
        progress=progress,
    )
    written = read(output)
    counts = ", ".join(f"{len(written.indices(s))} {s}" for s in ("train", "validation", "test"))
    left_out = f", {written.left_out} left out" if written.left_out else ""
    click.echo(f"{output}: {len(written)} frames ({counts}){left_out}")


@main.command()
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
    click.echo(f"{'':34s} {'float':>12s} {'integer':>12s} {'growth':>9s}")
    for key, value in errors["float"].items():
        growth = errors["growth_percent"].get(key)
        change = "" if growth is None else f"{growth:+8.2f}%"
        click.echo(f"{key:34s} {value:12.6f} {errors['integer'][key]:12.6f} {change:>9s}")
    for key, count in errors["saturated_values"].items():
        click.echo(f"{key:34s} {'':12s} {count:12d} values")


@main.command()
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
    from fastac import accuracy, leave_one_out
    from fastac.frames import read
    from fastac.workspace import write_json

    model = load_bundle(bundle)
    samples = read(data, model.scene, progress=progress)
    if leave_one_group_out:
        folder = (bundle if (bundle / "bundle").is_dir() else bundle.parent) / "leave_one_out"
        content = leave_one_out.evaluate(samples, model.scene, data, folder, progress=progress)
        if json_file:
            write_json(json_file, content)
        click.echo(leave_one_out.table(content))
        return
    index = accuracy.choose(samples, split, data)
    errors, _ = accuracy.compare(model, samples, index, progress=progress)
    if json_file:
        write_json(json_file, {"data": str(data), "split": split, "frames": len(index), **errors})
    click.echo(f"{data}: {len(index)} frames, {samples.source}")
    print_errors(errors)


@main.command()
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
    from fastac import accuracy
    from fastac.frames import read
    from models.float_pipeline import FloatPipeline

    model = load_bundle(bundle)
    samples = read(data, model.scene, progress=progress)
    index = accuracy.choose(samples, split, data)
    pipeline = FloatPipeline.from_bundle(model) if use_float else model.pipeline
    result = accuracy.of_dataset(pipeline, samples).run(samples.frames[index], progress=progress)
    output.parent.mkdir(parents=True, exist_ok=True)
    temporary = output.with_name(f".{output.name}.part")
    with h5py.File(temporary, "w") as file:
        file.attrs["bundle_sha256"] = model.digest
        file.attrs["arithmetic"] = "float" if use_float else "integer"
        file.attrs["pitch_mm"] = samples.pitch_mm
        file.attrs["force_axes"] = ",".join("xyz"[axis] for axis in model.scene.force_axes)
        file["frame_index"] = index
        scene = model.scene
        wanted = {
            "normals": "normals" in scene.outputs,
            "depth_mm": "depth" in scene.outputs,
            "force_n": scene.wants_force,
            "force_map_n": scene.wants_force_map,
        }
        for name, is_wanted in wanted.items():
            if is_wanted:
                file[name] = np.asarray(getattr(result, name), np.float32)
        written = sorted(set(file) - {"frame_index"})
    temporary.replace(output)
    click.echo(f"{output}: {', '.join(written)} of {len(index)} frames")


@main.command()
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
    from fastac import object_figures
    from fastac import objects as test_objects
    from fastac.workspace import write_json

    shown = test_objects.reconstruct({path: load_bundle(path) for path in bundles}, load_n, progress=progress)
    output.mkdir(parents=True, exist_ok=True)
    for item in shown:
        object_figures.draw(item, output / f"{item.name}.png")
    temporary = output / ".objects.html.part"
    temporary.write_text(object_figures.page(shown), encoding="utf-8")
    temporary.replace(output / "objects.html")
    content = test_objects.summary(shown)
    write_json(output / "objects.json", content)
    click.echo(test_objects.table(content))
    click.echo(output / "objects.html")


@main.command()
@click.argument("bundle", type=INPUT)
@output_option("BUNDLE/verilog", "Folder to write; replaced when the new one is complete.")
@progress_option
def verilog(bundle, output, progress):
    """Verilog of BUNDLE for the XCZU19EG, linted, with Vivado's script and constraints."""
    from fastac import hardware

    output = output or bundle / "verilog"
    hardware.write_verilog(load_bundle(bundle), output, progress=progress)
    file = output / f"{hardware.NAME}.v"
    click.echo(f"{file}: {file.stat().st_size / 1e6:.1f} MB")


@main.command()
@click.argument("bundle", type=INPUT)
@click.option("--for", "hardware", type=INPUT, required=True, help="Bundle that the hardware was made from.")
@click.option(
    "--keep-force", type=INPUT, help="Keep the hardware's force; the bundle with it goes to this folder."
)
@click.option("-o", "--output", type=INPUT, required=True, help="The file to write.")
def calibration(bundle, hardware, keep_force, output):
    """BUNDLE's pixel network, and what follows from it, as words for hardware that already runs.

    The hardware's register CALIBRATION takes them, 32 bits each, little-endian, one after another, while no
    frame is in flight. What a calibration does not bring must be the same in both bundles: formats, solver,
    weights of the force, which differ from training to training unless --keep-force takes the hardware's. The
    background is not part of it: let the hardware capture its own.
    """
    from gateware import calibration as images

    model, known = load_bundle(bundle), load_bundle(hardware)
    if keep_force:
        model = images.keep_force(model, known, keep_force)
    words = images.calibration_words(model, known)
    output.parent.mkdir(parents=True, exist_ok=True)
    temporary = output.with_name(f".{output.name}.part")
    temporary.write_bytes(words.astype("<u4").tobytes())
    temporary.replace(output)
    click.echo(f"{output}: {len(words)} words, layout {words[0]:#010x}, sha256 {model.digest}")


@main.command()
@click.argument("bundle", type=INPUT)
@click.option("--data", type=INPUT, required=True, help="Dataset to take frames from.")
@click.option("--split", type=SPLITS, default="test", show_default=True)
@click.option(
    "--frames",
    type=click.IntRange(min=1),
    help="How many, spread over the split. [default: the scene's; with --trace 1]",
)
@click.option(
    "--verilog", "verilog_folder", type=INPUT, help="Folder of `fastac verilog`. [default: BUNDLE/verilog]"
)
@click.option(
    "--trace",
    type=click.Choice(["saif", "fst"]),
    help="Write the signals' activity for Vivado's report_power, or their waveforms, as fastac.saif or"
    " fastac.fst in the folder.",
)
@output_option("BUNDLE/sim", "Folder for the simulator, its logs and traces.")
@progress_option
def sim(bundle, data, split, frames, verilog_folder, trace, output, progress):
    """Send real frames through the simulated hardware and compare every value with the integer model.

    A trace holds the whole run: the reset, the check of the identity, the frames back to back, and what a
    driver reads after each; it ends when the last result was read. Of one frame that is the activity of a
    single measurement; with --frames 10 the frames overlap as in a steady stream. The clock is the scene's.
    A simulator that traces is slower, and is built in a folder of its own.
    """
    from fastac import accuracy, hardware
    from fastac.frames import read
    from sim.top import trace_file

    model = load_bundle(bundle)
    samples = read(data, model.scene, progress=progress)
    count = frames or (1 if trace else model.scene.simulation.frames)
    index = accuracy.spread(accuracy.choose(samples, split, data), count)
    output = output or bundle / "sim"
    found = hardware.simulate(
        model, samples, index, verilog_folder or bundle / "verilog", output, trace=trace, progress=progress
    )
    click.echo(json.dumps(found, indent=1))
    if trace:
        click.echo(trace_file(output, hardware.NAME, trace))
    if found["mismatches"]:
        raise click.ClickException(f"{found['mismatches']} mismatches; {found['first_mismatch']}")


class Lanes(click.ParamType):
    """Numbers of pixels a clock, separated by commas."""

    name = "N,N,..."

    def convert(self, value, parameter, context):
        if isinstance(value, tuple):
            return value
        try:
            lanes = tuple(int(part) for part in value.split(","))
        except ValueError:
            self.fail(f"{value!r}: expected numbers separated by commas, such as 1,2,4", parameter, context)
        if len(set(lanes)) != len(lanes):
            self.fail(f"{value!r}: a number is there twice", parameter, context)
        return lanes


@main.command()
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
    help="How many of the dataset, spread over the split; four special ones are added.",
)
@output_option("BUNDLE/verify", "Folder for verify.json and, by lanes, bundles, Verilog and simulators.")
@progress_option
def verify(source, data, split, lanes, frames, output, progress):
    """Prove the hardware of SCENE or BUNDLE at several pixels a clock, and list what it took.

    Of a SCENE the model is trained first, unless its build folder has it. At each number of lanes the same
    model becomes hardware with a hash of its own. The frames, then one all black, one all white, a
    checkerboard and one with a bright pixel go through it back to back; two of them once more with random
    stalls at both ends. Every value is compared with the integer model. Where loadable weights need more DSP
    slices than the device has, the weights are baked in, and the table says so.

    Rows are kept while Verilog and frames are the same, so an interrupted campaign goes on where it was.
    Times beyond 60 s to elaborate, 180 s to build and 20 s a frame (meant for two cores) are marked with "!".
    Ends with an error if any value differs.
    """
    from fastac import accuracy
    from fastac import verify as campaign
    from fastac.frames import read

    folder = source
    if source.suffix == ".toml":
        scene = scenes.load(source)
        folder = build_folder(scene, None)
        run_build(scene, folder, data, progress, until="bundle")
    model = load_bundle(folder)
    data = data or folder / "data.h5"
    samples = read(data, model.scene, progress=progress)
    index = accuracy.spread(accuracy.choose(samples, split, data), frames)
    output = output or folder / "verify"
    content = campaign.run(model, samples, index, lanes, output, progress=progress)
    click.echo(campaign.table(content))
    click.echo(output / campaign.FILE)
    mismatches = sum(row["mismatches"] for row in content["rows"])
    if mismatches:
        first = next(row["first_mismatch"] for row in content["rows"] if row["mismatches"])
        raise click.ClickException(f"{mismatches} mismatches; {first}")


@main.command()
@click.argument("source", type=INPUT, metavar="SCENE|BUNDLE")
@click.option("--data", type=INPUT, help="Recorded dataset to train SCENE on, if its bundle is missing.")
@output_option("BUNDLE", "Folder for synth.json and the cache, synth.")
@click.option(
    "--place-and-route/--no-place-and-route",
    default=True,
    help="Place every module on the 40 nm ECP5, or only count blocks.",
)
@click.option("--module", "modules", multiple=True, metavar="NAME", help="Only these, such as 'mlp.*'.")
@click.option(
    "--jobs",
    type=click.IntRange(1),
    default=min(2, os.cpu_count() or 1),
    show_default=True,
    help="Tools that run side by side, each on one core with up to 4 GB.",
)
@progress_option
def synth(source, data, output, place_and_route, modules, jobs, progress):
    """Count what hardware needs and find the clock that each of its modules reaches, without Vivado.

    Of a SCENE the model is trained first, unless its build folder has it.

    Yosys counts DSP48E2, block RAM, URAM, shift registers and look-up tables; nextpnr places and routes each
    module on a 40 nm ECP5, whose clock is a conservative bound for the XCZU19EG. Results are kept; only what
    has changed is done again. `fastac report` then takes the figures into the build's report, in place of
    estimates. Needs the extra `synth`: pip install -e '.[synth]'.
    """
    from fastac import synth as synthesis
    from gateware.platform_xczu19eg import DEVICE

    if source.suffix == ".toml":
        scene = scenes.load(source)
        source = build_folder(scene, None)
        run_build(scene, source, data, progress, until="bundle")
    output = output or source
    content = synthesis.synthesise(
        load_bundle(source),
        output,
        device=DEVICE,
        place_and_route=place_and_route,
        modules=modules,
        jobs=jobs,
        progress=progress,
    )
    click.echo(synthesis.table(content, DEVICE))
    click.echo(f"{output / synthesis.FILE}")


@main.command()
@click.argument("spec", type=INPUT)
@output_option("build/sweep/SPEC.sqlite", "The results: one SQLite file.")
@click.option(
    "--cache",
    type=INPUT,
    default=Path("build/sweep/cache"),
    show_default=True,
    help="Folder of datasets and trained models, shared by all sweeps.",
)
@click.option("--workers", type=click.IntRange(1), help="Local processes. [default: one for each core]")
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Run on the Dask cluster of this scheduler, such as tcp://host:8786. Workers have a thread each"
    " and see the same files.",
)
@progress_option
def sweep(spec, output, cache, workers, scheduler, progress):
    """Measure all designs that SPEC describes: errors, cycles, resources, energy.

    SPEC is a TOML file: `scene`, a base scene; [axes], scene keys with lists of values, such as
    "numbers.data_bits" = [18, 22, 26] (several tables with [[axes]]; keys with commas between them move
    together); `method`, "grid" or "optuna" with `trials`, `seed` and `objectives`; `frames` and `split` to
    evaluate on; `data`, a dataset, for recorded sensors. Paths are relative to SPEC.

    Errors are those of the bit-exact emulator on held-out frames; cycles follow from the design's formulas;
    resources and energy are estimates. Nothing is simulated in RTL: `fastac trade --confirm` does that.
    Models are trained once for all points that share them. A point that cannot be is recorded with its error.
    Results and models are kept: an interrupted sweep goes on where it was.
    """
    from fastac import sweep as sweeps
    from fastac import sweep_spec
    from fastac.sweep_models import Setting
    from fastac.sweep_results import Results

    content, base = sweep_spec.load(spec)
    if scheduler and workers:
        raise click.UsageError("--workers is of local processes: give it or --scheduler")
    data = content.data and str((spec.parent / content.data).resolve())
    if data is None and base.sensor.source == "recorded":
        raise click.UsageError(f"{spec}: data: missing: scene {base.name} is of a recorded sensor")
    setting = Setting(str(cache.resolve()), data, content.split, content.frames)
    results = Results(output or Path("build/sweep") / f"{spec.stem}.sqlite")
    with sweeps.dask_pool(scheduler) if scheduler else sweeps.local_pool(workers) as pool:
        counts = sweeps.run(content, base, spec.parent, results, setting, pool, progress=progress)
    click.echo(f"{results.path}: " + ", ".join(f"{count} {name}" for name, count in counts.items()))


MARKED = ("paper", "fast", "force")
"""Scenes of this repository that `trade` marks where it finds them."""


@main.command()
@click.argument("results", type=INPUT, nargs=-1, required=True)
@output_option("build/trade", "Folder for trade.html, its pictures, and what --confirm builds.")
@click.option(
    "--mark",
    "marked",
    type=INPUT,
    multiple=True,
    metavar="SCENE",
    help="Mark the design of this scene; repeatable. [default: scenes/paper.toml, fast.toml, force.toml]",
)
@click.option(
    "--pick", metavar="LIMITS", help='Write the best scene within limits: "depth_mae_mm<0.03, dsp<220".'
)
@click.option(
    "--by",
    default="latency_cycles,energy_uj",
    show_default=True,
    metavar="METRICS",
    help="What is best: the smallest first metric, then the next.",
)
@click.option(
    "--scene", "scene_file", type=INPUT, help="Where --pick writes. [default: picked.toml in the folder]"
)
@click.option(
    "--confirm",
    type=click.IntRange(1),
    metavar="N",
    help="Build N random designs of the fronts, and compare.",
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Of --confirm.")
@progress_option
def trade(results, output, marked, pick, by, scene_file, confirm, seed, progress):
    """Show what speed costs: the fronts of RESULTS, one or several files of `fastac sweep`.

    Writes a page to explore, with a table of what each doubling of the speed costs, and pictures of the
    fronts. --pick writes the scene of the best design within limits, ready for `fastac build`; limits are
    metrics with < <= > >= and a number, separated by commas; a wrong name lists all there are.

    --confirm takes N random designs of the fronts over an error, cycles, DSP and energy, builds their
    Verilog and sends held-out frames through it: every value must be the integer model's and every latency
    the one stated. What was found is kept in RESULTS; those that are known are not simulated again.
    """
    from fastac import trade as trading
    from fastac import trade_page

    sources = [trading.read(path) for path in results]
    designs = trading.distinct(sources)
    rows = [row for _, row in designs]
    different = 0
    if confirm:
        from fastac import trade_confirm

        best = {row.key for row in trading.best_designs(rows)}
        chosen = [(source, row) for source, row in designs if row.key in best]
        click.echo(f"fronts over an error, cycles, DSP and energy: {len(chosen)} of {len(designs)} designs")

        def tell(row, content):
            verdict = "exact" if content["is_exact"] else f"DIFFERENT: {content['first_mismatch']}"
            counts = f"{content['mismatches']} mismatches of {content['values_compared']:,}"
            click.echo(f"{row.key[:12]} {verdict}: {counts}, cycles {content['cycles_counted']}")

        found = trade_confirm.run(
            chosen, confirm, seed, (output or Path("build/trade")) / "rtl", tell, progress=progress
        )
        different = sum(not content["is_exact"] for content in found)
    output = output or Path("build/trade")
    paths = marked or [path for name in MARKED if (path := Path("scenes") / f"{name}.toml").exists()]
    stars = {s.name: row for s in map(scenes.load, paths) for row in rows if trading.is_scene(row, s)}
    shown = trade_page.Trade(sources, rows, stars)
    for table in trade_page.tables(shown):
        click.echo(table.text)
    if pick:
        by_names = [name.strip() for name in by.split(",")]
        best = trading.pick(rows, pick, by_names)
        path = scene_file or output / "picked.toml"
        trading.write_scene(best, path, f"fastac trade --pick {pick!r} --by {by}")
        click.echo(f"{path}: {trade_page.named(best)}")
        for name in sorted({*by_names, *trading.asked(pick)}):
            click.echo(f"  {name:32s} {best.metrics[name]:.6g}")
    for path in trade_page.write(shown, output):
        click.echo(path)
    if different:
        raise click.ClickException(f"{different} designs differ in RTL")


@main.command()
@click.argument("scene_files", type=INPUT, nargs=-1, required=True, metavar="SCENE...")
@click.option(
    "--builds",
    type=INPUT,
    default=Path("build"),
    show_default=True,
    help="Where the builds are whose wall times are shown.",
)
def scope(scene_files, builds):
    """Show what each SCENE simulates, trains, elaborates and verifies, and what it does without.

    A Markdown table with a column for each scene. Area is estimated from the scene's words, with random
    weights; nothing is trained or elaborated for it. Wall times are those of the builds that are there.
    """
    from fastac import scope as scoping

    found = [scoping.Scope(s, builds / s.name) for s in map(scenes.load, scene_files)]
    click.echo(scoping.table(found))


def print_summary(folder: Path) -> None:
    from fastac.report import summary_rows

    report = json.loads((folder / "report.json").read_text())
    for what, ours, paper, _ in summary_rows(report):
        click.echo(f"{what:48s} {ours}" + (f"   (paper: {paper})" if paper else ""))
    click.echo(f"{folder / 'report.html'}")


@main.command()
@click.argument("scene", type=INPUT)
@click.option("--data", type=INPUT, help="Recorded dataset; without it the virtual fingertip is pressed.")
@output_option("build/SCENE", "The build folder.")
@progress_option
def build(scene, data, output, progress):
    """From SCENE to frames, trained integers, Verilog, its proof on held-out frames, and the report.

    Steps whose inputs have not changed are kept; an interrupted build resumes where it stopped.
    """
    scene = scenes.load(scene)
    folder = build_folder(scene, output)
    run_build(scene, folder, data, progress, until=None)
    print_summary(folder)
    mismatches = json.loads((folder / "report.json").read_text())["rtl_vs_integer"]["mismatches"]
    if mismatches:
        raise click.ClickException(f"{mismatches} mismatches between Verilog and integer model")


@main.command()
@click.argument("folder", type=INPUT)
@click.option("--data", type=INPUT, help="The dataset of the build. [default: FOLDER/data.h5]")
def report(folder, data):
    """Write report.json and report.html of the build in FOLDER again, and print the summary."""
    from fastac import report as reporting
    from fastac.frames import read

    model = load_bundle(folder)
    samples = read(data or folder / "data.h5", model.scene)
    reporting.write(folder, model, samples)
    print_summary(folder)


if __name__ == "__main__":
    sys.exit(main())
