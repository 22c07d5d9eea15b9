"""Commands that turn recordings into datasets."""

from functools import partial

import click

from fastac.cli import layouts
from fastac.cli.common import INPUT, OUTPUT_FILE, Group, cad_options, load_cad, output_option, progress_option
from fastac.cli.import_options import (
    ball_option,
    circle_options,
    held_out_option,
    keep_pulls_option,
    negate_option,
    pitch_option,
    say_forces,
    say_presses,
    size_options,
    split_counts,
)
from fastac.scenes import schema as scenes
from fastac.store.kinds import Kinds


@click.command("ball-press")
@click.argument("folder", type=INPUT)
@click.option(
    "--labels",
    type=INPUT,
    required=True,
    help="CSV with columns image, center_x_px, center_y_px, radius_px, split.",
)
@click.option("--background", type=INPUT, required=True, help="Photograph of the untouched gel.")
@ball_option
@circle_options
@output_option("The dataset to write, HDF5.", OUTPUT_FILE)
@progress_option
def ball_press(folder, labels, background, output, **given):
    """Import photographs of a ball pressed onto a flat gel, from FOLDER.

    Photographs are padded with the background to the target's aspect ratio, where they are marked invalid,
    and resampled by area. Normals are known inside the labelled contact circle only.

    \b
    Example: fastac import ball-press photos --labels labels.csv --background background.png
                 --ball-mm 4.7 --px-per-mm 19.58 -o presses.h5
    """
    from fastac.sensor.importers.ball_press import import_folder

    output.parent.mkdir(parents=True, exist_ok=True)
    import_folder(folder, labels, background, output=output, **given)
    say_presses(output)


@click.command("force")
@click.argument("sources", metavar="VIDEO|FOLDER...", type=INPUT, nargs=-1, required=True)
@click.option(
    "--forces",
    type=INPUT,
    required=True,
    multiple=True,
    help="CSV with columns frame, force_z_n (or all of x, y, z), group and, optionally, split; once for each"
    " recording, in the same order.",
)
@click.option(
    "--background-frames",
    type=click.IntRange(1),
    required=True,
    help="Number of leading no-contact frames averaged into the background.",
)
@click.option(
    "--background-per-group",
    is_flag=True,
    help="Average a background for each group, where light or skin drifts between them.",
)
@pitch_option
@held_out_option
@negate_option
@keep_pulls_option
@size_options
@output_option("The dataset to write, HDF5.", OUTPUT_FILE)
@progress_option
def force_recording(
    sources,
    forces,
    background_frames,
    background_per_group,
    pitch_mm,
    held_out,
    negate,
    keep_pulls,
    height_px,
    width_px,
    output,
    progress,
):
    """Import frames with the readings of a force gauge, from videos or folders of photographs.

    A CSV file has one row per frame: `frame` is its index from 0 or its file name, z is positive in
    compression, `group` names the recording or object, which can be held out as a whole. Two stretches of the
    frames of the other groups, a fifth of them in all, are the validation split, unless a column `split` says
    otherwise. Only background frames may lack a row. Photographs are padded with the background to the
    target's aspect ratio and resampled by area.

    \b
    Example: fastac import force pear.mp4 plum.mp4 --forces pear.csv --forces plum.csv
                 --background-frames 20 --pitch-mm 0.12 -o recording.h5
    """
    from fastac.sensor.importers.force_recording import import_recordings

    if len(sources) != len(forces):
        raise click.UsageError(
            f"--forces: given {len(forces)} times: expected once for each of {len(sources)} recordings"
        )
    output.parent.mkdir(parents=True, exist_ok=True)
    written = import_recordings(
        list(zip(sources, forces, strict=True)),
        background_frames=background_frames,
        per_group=background_per_group,
        pitch_mm=pitch_mm,
        held_out=held_out,
        negate=negate,
        keep_pulls=keep_pulls,
        height_px=height_px,
        width_px=width_px,
        output=output,
        progress=progress,
    )
    say_forces(output, written)


@click.command("cnc")
@click.argument("folder", type=INPUT)
@click.option(
    "--scene",
    type=INPUT,
    required=True,
    help="Scene of the sensor, which gives size, pitch, channels and kind of frames.",
)
@cad_options
@click.option(
    "--ball-mm", type=float, help="Diameter of the ball, mm. [default: the scene's protocol.ball_mm]"
)
@click.option(
    "--raw-size-px", type=int, nargs=2, help="Rows and columns of .raw images. [default: the scene's window]"
)
@click.option(
    "--skip-lost",
    is_flag=True,
    help="Leave out samples in which a marker is not found, and count them; otherwise they are an error.",
)
@output_option("The dataset to write, HDF5.", OUTPUT_FILE)
@progress_option
def cnc_recording(
    folder, scene, cad, cad_pitch_mm, origin_mm, ball_mm, raw_size_px, skip_lost, output, progress
):
    """Import frames, poses and forces that a machine recorded in FOLDER; geometry follows from CAD and ball.

    FOLDER holds poses.csv, with the columns that `fastac protocol` writes and the measured force_x_n,
    force_y_n, force_z_n; z_mm is the height at which the ball's lowest point stood. Each sample has a frame
    named by its index: 000012.raw (packed RAW10) or .npy, or, where the scene's frames are channels, .npy or
    .png with NIR as 000012.nir.png. background.* shows the untouched sensor.

    Normals and depth are computed for vertical samples and are valid where the ball certainly touches. The
    last sample of the dataset is the background, the skin at rest.

    \b
    Example: fastac import cnc recording --scene scenes/fingertip.toml -o recording.h5
    """
    from fastac.models.vision.markers import Markers
    from fastac.sensor.dataset import read
    from fastac.sensor.importers import cnc

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
        marker_finder_of=partial(Markers.of_background, sensor=scene.sensor)
        if scene.sensor.markers
        else None,
        skip_lost=skip_lost,
        progress=progress,
    )
    written = read(output)
    left_out = f", {written.left_out} left out" if written.left_out else ""
    click.echo(f"{output}: {len(written)} frames ({split_counts(written)}){left_out}")


IMPORTERS = Kinds(
    "importer",
    {
        "ball-press": ball_press,
        "force": force_recording,
        "cnc": cnc_recording,
        "gs-sdk": layouts.gs_sdk,
        "fots": layouts.fots,
        "taxim": layouts.taxim,
        "feats": layouts.feats,
        "tacbench": layouts.tacbench,
        "estimate-modulus": layouts.estimate_modulus,
        "rosbag2": layouts.rosbag2,
    },
)
"""Importers by the names of their commands, `fastac import NAME`."""


class ImporterGroup(Group):
    """The commands of IMPORTERS."""

    def list_commands(self, context):
        return sorted(IMPORTERS)

    def get_command(self, context, name):
        return IMPORTERS.get(name)


@click.group("import", cls=ImporterGroup)
def import_():
    """Turn recordings into datasets."""
