"""Commands that turn recordings in the layouts of other projects into datasets."""

import click

from fastac.cli.common import INPUT, OUTPUT_FILE, output_option, progress_option
from fastac.cli.import_options import (
    ball_option,
    circle_options,
    every_option,
    held_out_option,
    held_out_presses_option,
    keep_pulls_option,
    negate_option,
    pitch_option,
    say_forces,
    say_presses,
    size_options,
)


@click.command("gs-sdk")
@click.argument("folder", type=INPUT)
@circle_options
@click.option(
    "--skip-unlabelled",
    is_flag=True,
    help="Leave out presses without label.npz, and count them; otherwise they are an error.",
)
@output_option("The dataset to write, HDF5.", OUTPUT_FILE)
@progress_option
def gs_sdk(folder, output, **given):
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
    import_folder(folder, output=output, **given)
    say_presses(output)


@click.command("fots")
@click.argument("folder", type=INPUT)
@ball_option
@circle_options
@click.option(
    "--background",
    default="0000.png",
    show_default=True,
    metavar="NAME",
    help="Photograph of the untouched gel, in FOLDER.",
)
@held_out_presses_option("gelsight/0004.png")
@output_option("The dataset to write, HDF5.", OUTPUT_FILE)
@progress_option
def fots(folder, output, **given):
    """Import the annotated ball presses of FOTS from FOLDER, its mlp_calib, or those of digit-depth.

    FOLDER holds csv/annotate.csv with the circles, the photographs that it names, and 0000.png, the untouched
    gel; folders of digit-depth have it where --background says. Photographs are padded with the background to
    the target's aspect ratio and resampled by area.

    \b
    Example: fastac import fots FOTS/mlp_calib --ball-mm 4.7 --px-per-mm 19.58 -o presses.h5
    """
    from fastac.sensor.importers.fots import import_folder

    output.parent.mkdir(parents=True, exist_ok=True)
    import_folder(folder, output=output, **given)
    say_presses(output)


@click.command("taxim")
@click.argument("pack", type=INPUT)
@ball_option
@circle_options
@held_out_presses_option("frame_4.jpg")
@output_option("The dataset to write, HDF5.", OUTPUT_FILE)
@progress_option
def taxim(pack, output, **given):
    """Import the ball presses of a data PACK of Taxim, dataPack.npz.

    PACK holds the photographs, that of the untouched gel, and the contact circles. Photographs are padded
    with the background to the target's aspect ratio and resampled by area.

    \b
    Example: fastac import taxim dataPack.npz --ball-mm 4 --px-per-mm 33.9 -o presses.h5
    """
    from fastac.sensor.importers.taxim import import_pack

    output.parent.mkdir(parents=True, exist_ok=True)
    import_pack(pack, output=output, **given)
    say_presses(output)


@click.command("feats")
@click.argument("folder", type=INPUT)
@click.option(
    "--background",
    type=INPUT,
    required=True,
    help="The untouched gel: .npy with gs_img, or a photograph.",
)
@pitch_option
@click.option(
    "--group-pattern",
    default=r"[A-Za-z]\w*",
    show_default=True,
    metavar="REGEX",
    help="What names a group in the name of a file that names no indenter.",
)
@held_out_option
@every_option("file")
@keep_pulls_option
@size_options
@output_option("The dataset to write, HDF5.", OUTPUT_FILE)
@progress_option
def feats(folder, background, output, **given):
    """Import frames with forces in the layout of FEATS from FOLDER: labels, or raw recordings.

    FOLDER holds one .npy a frame, itself or in train, val and test, which are then the splits unless groups
    are held out. Nothing is unpickled: arrays and plain values are read, all else is refused. z is negated,
    so that it is positive in compression. Frames are padded with the background to the target's
    aspect ratio and resampled by area.

    \b
    Example: fastac import feats labels --background nocontact_train_sensor.npy --pitch-mm 0.15
                 -o feats.h5
    """
    from fastac.sensor.importers.feats import import_folder

    output.parent.mkdir(parents=True, exist_ok=True)
    say_forces(output, import_folder(folder, background, output=output, **given))


@click.command("estimate-modulus")
@click.argument("folder", type=INPUT)
@click.option(
    "--background-frames",
    type=click.IntRange(1),
    required=True,
    help="Number of leading no-contact frames of each grasp averaged into its background.",
)
@click.option(
    "--crop-px",
    type=click.IntRange(0),
    nargs=4,
    metavar="LEFT TOP WIDTH HEIGHT",
    help="Part of each frame that shows the gel. [default: all of it]",
)
@pitch_option
@held_out_option
@click.option(
    "--delay-frames",
    type=int,
    default=0,
    show_default=True,
    help="How many frames the videos are later than the forces; a warning says where they are.",
)
@negate_option
@keep_pulls_option
@size_options
@output_option("The dataset to write, HDF5.", OUTPUT_FILE)
@progress_option
def estimate_modulus(folder, output, **given):
    """Import grasps of objects with their forces in the layout of EstimateModulus from FOLDER.

    FOLDER holds a video of each grasp, such as golf_ball__t=0.avi, and golf_ball__t=0_forces.pkl with the
    force in each of its frames. The object is the group that can be held out. Frames are padded with the
    background to the target's aspect ratio and resampled by area.

    \b
    Example: fastac import estimate-modulus example_data/2023-12-16 --background-frames 10
                 --crop-px 55 70 401 365 --pitch-mm 0.4 --height-px 40 --width-px 44 -o grasps.h5
    """
    from fastac.sensor.importers.estimate_modulus import import_folder

    output.parent.mkdir(parents=True, exist_ok=True)
    say_forces(output, import_folder(folder, output=output, **given))


@click.command("tacbench")
@click.argument("folder", type=INPUT)
@pitch_option
@click.option(
    "--group-by",
    type=click.Choice(["batch", "probe", "stroke"]),
    default="batch",
    show_default=True,
    help="What a group is: a folder of recordings, a probe's folders, or one stroke.",
)
@held_out_option
@click.option(
    "--background-frames",
    type=click.IntRange(1),
    default=20,
    show_default=True,
    help="Most images without contact that are averaged into a batch's background.",
)
@every_option("labelled image")
@negate_option
@keep_pulls_option
@size_options
@output_option("The dataset to write, HDF5.", OUTPUT_FILE)
@progress_option
def tacbench(folder, output, **given):
    """Import frames with forces of DIGIT or GelSight Mini in the layout of TacBench (Sparsh) from FOLDER.

    Each folder at or below FOLDER with dataset_slip_forces.pkl is a batch: its strokes' images become frames
    with forces, its images without contact its background. Nothing is unpickled: arrays and plain values are
    read, all else is refused. Frames are padded with the background to the target's aspect ratio and
    resampled by area.

    \b
    Example: fastac import tacbench T1_force/digit --pitch-mm 0.15 --held-out flat/batch_1 -o digit.h5
    """
    from fastac.sensor.importers.tacbench import import_folder

    output.parent.mkdir(parents=True, exist_ok=True)
    say_forces(output, import_folder(folder, output=output, **given))


@click.command("rosbag2")
@click.argument("recordings", metavar="BAG...", type=INPUT, nargs=-1, required=True)
@click.option("--image-topic", help="Topic of the camera's images. [default: the only one]")
@click.option("--wrench-topic", help="Topic of the force gauge's wrenches. [default: the only one]")
@click.option(
    "--background-frames",
    type=click.IntRange(1),
    required=True,
    help="Number of a recording's first images, without contact, averaged into its background.",
)
@pitch_option
@click.option(
    "--tolerance-ms",
    type=float,
    default=20.0,
    show_default=True,
    help="How far in time a frame's wrench may be from it, ms.",
)
@click.option(
    "--clock",
    type=click.Choice(["stamp", "log"]),
    default="stamp",
    show_default=True,
    help="Time of a message: its header's stamp, or when it was recorded.",
)
@click.option(
    "--group-by",
    type=click.Choice(["recording", "press"]),
    default="recording",
    show_default=True,
    help="What a group is: a recording, or one press in it.",
)
@held_out_option
@every_option("frame with a force")
@negate_option
@click.option("--tare", is_flag=True, help="Take the mean force of the background images off the forces.")
@keep_pulls_option
@size_options
@output_option("The dataset to write, HDF5.", OUTPUT_FILE)
@progress_option
def rosbag2(recordings, output, **given):
    """Import ROS 2 recordings of a camera and a force gauge: rosbag2 folders, or files .mcap or .db3.

    Images are sensor_msgs/Image or CompressedImage in colour, forces geometry_msgs/WrenchStamped with z
    positive in compression. A frame has the wrench nearest in time; frames without one within the tolerance
    are left out and counted. Frames are padded with the background to the target's aspect ratio and resampled
    by area. Needs the extra `ros`.

    \b
    Example: fastac import rosbag2 pear plum.mcap --background-frames 20 --pitch-mm 0.12 -o grasps.h5
    """
    from fastac.sensor.importers.rosbag2 import import_recordings

    output.parent.mkdir(parents=True, exist_ok=True)
    say_forces(output, import_recordings(recordings, output=output, **given))
