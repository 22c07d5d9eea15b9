"""The command that logs a stream for ROS 2."""

import math

import click
from click.core import ParameterSource

from fastac.cli.common import OUTPUT_FILE, OUTPUT_FOLDER
from fastac.cli.stream_options import INTERRUPTED, opened_stream, stream_options
from fastac.streaming.ros.topics import FRAME_ID, NAMESPACE

UNMEASURED = {"nan": math.nan, "zero": 0.0}


@click.command()
@stream_options(paced=False, bundle_required=False)
@click.option(
    "--from",
    "address",
    help="Log the stream that `fastac serve` offers at this address, such as tcp://127.0.0.1:5599, instead of"
    " one of BUNDLE.",
)
@click.option("--mcap", "mcap_file", type=OUTPUT_FILE, help="Write an MCAP file.")
@click.option("--rosbag2", "rosbag2_folder", type=OUTPUT_FOLDER, help="Write a rosbag2 folder.")
@click.option(
    "--compression",
    type=click.Choice(["zstd", "lz4", "none"]),
    default="zstd",
    show_default=True,
    help="Of the MCAP file.",
)
@click.option(
    "--storage",
    type=click.Choice(["mcap", "sqlite3"]),
    default="mcap",
    show_default=True,
    help="Of the rosbag2 folder.",
)
@click.option(
    "--frame-id",
    default=FRAME_ID,
    show_default=True,
    help="Name of the sensor's coordinate frame in all messages.",
)
@click.option("--namespace", default=NAMESPACE, show_default=True, help="What all topics' names begin with.")
@click.option(
    "--unmeasured",
    type=click.Choice(list(UNMEASURED)),
    default="nan",
    show_default=True,
    help="What stands in WrenchStamped for the axes that the sensor does not measure, torque's for one.",
)
@click.option("--force", is_flag=True, help="Replace logs that exist.")
@click.pass_context
def log(
    context,
    bundle,
    frames,
    progress,
    address,
    mcap_file,
    rosbag2_folder,
    compression,
    storage,
    frame_id,
    namespace,
    unmeasured,
    force,
    **stream,
):
    """Log a stream's records as standard ROS 2 messages, for `ros2 bag play` and viewers (docs/ros.md).

    Every record is written, those of lost frames too, with the time stamps of the frames. Ctrl-C ends the log
    with exit status 130: it is complete up to there. Needs the extra `ros`: pip install -e '.[ros]'.

    \b
    Example: fastac log build/paper --frames 100 --mcap touch.mcap
    """
    from fastac.streaming.ros.log_files import checked, refuse_existing, require_packages

    if mcap_file is None and rosbag2_folder is None:
        raise click.ClickException("nothing to write: give --mcap FILE or --rosbag2 FOLDER")
    require_packages()
    checked(namespace)
    for path in (mcap_file, rosbag2_folder):
        if path is not None:
            refuse_existing(path, force=force)
    _require_one_stream(context, address, bundle, stream)

    from fastac.streaming.ros.mcap_sink import McapSink
    from fastac.streaming.ros.messages import Messages
    from fastac.streaming.ros.rosbag2_sink import Rosbag2Sink
    from fastac.streaming.tally import Tally

    made: list = []

    def sinks(about) -> list:
        messages = Messages(about, frame_id=frame_id, unmeasured=UNMEASURED[unmeasured])
        shared = {"namespace": namespace, "force": force}
        made.append(Tally(enabled=progress))
        if mcap_file is not None:
            made.append(McapSink(mcap_file, messages, compression=compression, **shared))
        if rosbag2_folder is not None:
            made.append(Rosbag2Sink(rosbag2_folder, messages, storage=storage, **shared))
        return made

    if address is None:
        interrupted = _log_here(bundle, sinks, frames=frames, progress=progress, **stream)
    else:
        interrupted = _log_from(address, sinks, frames=frames)
    click.echo(made[0].summary())
    for path in (mcap_file, rosbag2_folder):
        if path is not None:
            click.echo(path)
    if interrupted:
        raise SystemExit(INTERRUPTED)


def _require_one_stream(context, address, bundle, stream) -> None:
    """An error unless either a bundle is given or an address and nothing that says what computes."""
    if address is None:
        if bundle is None:
            raise click.ClickException("no stream: give a BUNDLE, or --from the address of `fastac serve`")
        return
    for parameter in context.command.params:
        said = context.get_parameter_source(parameter.name) == ParameterSource.COMMANDLINE
        if said and parameter.name in ("bundle", *stream):
            name = parameter.opts[0] if isinstance(parameter, click.Option) else "BUNDLE"
            raise click.ClickException(f"{name}: not together with --from: {address} has a stream of its own")


def _log_here(bundle, sinks, *, frames, **options) -> bool:
    """Log a stream that runs in this process; whether Ctrl-C ended it."""
    from fastac.streaming.run import pump

    with opened_stream(bundle, **options) as session:
        return pump(session, sinks(session.about), frames=frames)


def _log_from(address, sinks, *, frames) -> bool:
    """Log a stream that runs elsewhere; whether Ctrl-C ended it."""
    from fastac.streaming.client import connect
    from fastac.streaming.relay import relay

    with connect(address) as stream:
        interrupted = relay(stream, sinks(stream.about), frames=frames)
    if stream.missed:
        click.echo(f"{stream.missed} records were missed: the log was slower than the stream", err=True)
    return interrupted
