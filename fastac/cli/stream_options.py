"""Options of the commands that run hardware or a stream of its records, and the stream that they describe."""

import click

from fastac.cli.common import INPUT, folder_of, progress_option, split_option

INTERRUPTED = 130
"""Exit status after Ctrl-C, as of shells."""
ALL, NONE = "all", "none"


class Arrays(click.ParamType):
    """Names of a record's arrays separated by commas; `all` (None) and `none` ()."""

    name = "NAME,NAME,..."

    def convert(self, value, parameter, context):
        from fastac.streaming.record import ARRAYS

        if value is None or isinstance(value, tuple):
            return value
        if value in (ALL, NONE):
            return None if value == ALL else ()
        names = tuple(value.split(","))
        for name in names:
            if name not in ARRAYS:
                expected = f"{ALL}, {NONE}, or some of {','.join(ARRAYS)}"
                self.fail(f"{name!r}: expected {expected}", parameter, context)
        return tuple(dict.fromkeys(names))


def _add(command, options):
    """The command with options, which --help lists in this order."""
    for option in reversed(options):
        command = option(command)
    return command


def source_options(command):
    """--source, --split, --fit, --frames: which frames go in."""
    options = [
        click.option(
            "--source",
            help="Where frames come from: a dataset .h5, a video, a folder of frame files, or a camera"
            " (camera:0, /dev/video0; never tried on a camera). [default: BUNDLE/data.h5]",
        ),
        split_option("all"),
        click.option(
            "--fit",
            is_flag=True,
            help="Resample photographs, videos and cameras of any size to the sensor's frames, as"
            " fastac import does. [default: only those of the size of the photographs that BUNDLE was trained"
            " on]",
        ),
        click.option("--frames", type=click.IntRange(1), help="Number of frames. [default: all there are]"),
    ]
    return _add(command, options)


def hardware_options(via: str | None = None):
    """--via, --verilog, --bitstream, --timeout-s: what computes. via : the default; None: it must be said."""
    shown = {"required": True} if via is None else {"default": via, "show_default": True}
    options = [
        click.option(
            "--via",
            type=click.Choice(["sim", "emulator", "uio", "pynq"]),
            help="What computes: the simulated Verilog, the emulator of its integers, or a board, through"
            " Linux' UIO and u-dma-buf or through PYNQ. Neither has been run on a board.",
            **shown,
        ),
        click.option(
            "--verilog",
            "verilog_folder",
            type=INPUT,
            help="Folder with hardware.json. [default: BUNDLE/verilog]",
        ),
        click.option(
            "--bitstream", type=INPUT, help="With --via pynq: the .bit file, its .hwh file beside it."
        ),
        click.option(
            "--timeout-s",
            type=click.FloatRange(min=0, min_open=True),
            default=1.0,
            show_default=True,
            help="How long a result may take before its frame counts as lost.",
        ),
    ]
    return lambda command: _add(command, options)


def stream_options(
    *, arrays: str = ALL, paced: bool = True, loop: bool | None = False, bundle_required: bool = True
):
    """The argument BUNDLE and all options of a stream, for `opened_stream` but for `frames`.

    arrays, paced, loop : the defaults; loop None: the command chooses
    """
    options = [
        click.argument("bundle", type=INPUT, required=bundle_required),
        source_options,
        hardware_options("emulator"),
        click.option(
            "--arrays",
            type=Arrays(),
            default=arrays,
            show_default=True,
            help="Arrays that the records have: some of depth_mm,normals,force_map_n,image, all, or none.",
        ),
        click.option(
            "--fps",
            type=click.FloatRange(min=0, min_open=True),
            help="Frames a second by which a recording is stamped and paced. [default: its own, else 100]",
        ),
        click.option(
            "--pace/--no-pace",
            "paced",
            default=paced,
            show_default=True,
            help="Give a recording's frames at that rate, or as fast as they are computed.",
        ),
        click.option(
            "--loop/--no-loop", default=loop, help="Begin a recording again at its end, or end there too."
        ),
        click.option(
            "--capture-background/--no-capture-background",
            default=True,
            show_default=True,
            help="First let the hardware take the source's own background, where the source has one.",
        ),
        progress_option,
    ]
    return lambda command: _add(command, options)


def opened_stream(
    bundle,
    *,
    source,
    split,
    fit,
    via,
    verilog_folder,
    bitstream,
    timeout_s,
    arrays,
    fps,
    paced,
    loop,
    capture_background,
    progress,
):
    """The session, a context manager, that the options of `stream_options` describe."""
    from fastac.streaming.session import open_session

    return open_session(
        bundle,
        source,
        folder=folder_of(bundle),
        via=via,
        arrays=arrays,
        verilog=verilog_folder,
        bitstream=bitstream,
        split=split,
        fit=fit,
        frames_per_second=fps,
        paced=paced,
        loop=loop,
        capture_background=capture_background,
        timeout_s=timeout_s,
        progress=progress,
    )
