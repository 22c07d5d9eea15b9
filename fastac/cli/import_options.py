"""What the commands `fastac import` share: options, and the line that says what was written."""

from statistics import median

import click


def size_options(command):
    """Options for the rows and columns that photographs are resampled to."""
    for name, text in (("--width-px", "Columns to resample to."), ("--height-px", "Rows to resample to.")):
        command = click.option(name, type=click.IntRange(16, 256), default=128, show_default=True, help=text)(
            command
        )
    return command


def circle_options(command):
    """Options for photographs with contact circles: their scale, their circles, and what they become."""
    reduction = click.option(
        "--radius-reduction-px",
        type=click.FloatRange(0),
        default=0.0,
        show_default=True,
        help="Taken off each circle's radius, pixels of the photographs: for circles drawn too large.",
    )
    skip = click.option(
        "--skip-bad-circles",
        is_flag=True,
        help="Leave out presses whose circle is larger than the ball or leaves the photograph, and count"
        " them; otherwise they are an error.",
    )
    cut = click.option(
        "--cut-circles",
        is_flag=True,
        help="Take of a circle that leaves the photograph what is in it, if its centre is; its depth does not"
        " count.",
    )
    scale = click.option(
        "--px-per-mm", type=float, required=True, help="Pixels of the original photographs per mm."
    )
    return scale(reduction(skip(cut(size_options(command)))))


ball_option = click.option("--ball-mm", type=float, required=True, help="Diameter of the ball, mm.")


def held_out_presses_option(example: str):
    """An option for the presses of the test split, by names such as `example`."""
    return click.option(
        "--held-out",
        multiple=True,
        metavar="PRESS",
        help=f"Press of the test split, such as {example}; repeatable. [default: every fifth]",
    )


pitch_option = click.option(
    "--pitch-mm", type=float, required=True, help="Size of a resampled pixel on the skin, mm."
)


held_out_option = click.option(
    "--held-out",
    multiple=True,
    metavar="GROUP",
    help="Group whose frames are the test split; repeatable. [default: the last]",
)


def every_option(what: str):
    """An option that thins out a long recording."""
    return click.option(
        "--every",
        type=click.IntRange(1),
        default=1,
        show_default=True,
        help=f"Take each so-many-th {what} only.",
    )


negate_option = click.option(
    "--negate", is_flag=True, help="Negate all forces: for gauges whose z is negative in compression."
)


keep_pulls_option = click.option(
    "--keep-pulls",
    is_flag=True,
    help="Keep frames in which F_z is negative by more than a twentieth of its largest value; otherwise they"
    " are left out and counted, for objects do not pull a skin.",
)


def split_counts(data) -> str:
    return ", ".join(f"{len(data.indices(split))} {split}" for split in ("train", "validation", "test"))


def say_presses(output) -> None:
    """Print what a dataset of presses with known circles holds, and whether its labels fit its frames."""
    from fastac.models.training import shown_slopes
    from fastac.sensor.dataset import read

    written = read(output)
    left_out = f", {written.left_out} left out" if written.left_out else ""
    size = f"pitch {written.pitch_mm:.5f} mm"
    click.echo(f"{output}: {len(written)} frames ({split_counts(written)}){left_out}, {size}")
    found = shown_slopes.agreement(written)
    if found is None:
        return
    click.echo(
        "labelled slopes and those that the frames show without labels: correlation"
        f" {found[0, 0]:.2f} along x, {found[1, 1]:.2f} along y"
    )
    if (doubt := shown_slopes.doubt(found)) is not None:
        click.echo(f"warning: {output}: {doubt}", err=True)


def _apart(delays) -> str:
    """Which recordings' frames and forces are apart in time, and by how much."""
    first = max(delays, key=lambda found: found.correlation - found.without)
    which = f"{len(delays)} recordings" if len(delays) > 1 else "a recording"
    when = f"{abs(first.frames)} frames {'later' if first.frames > 0 else 'earlier'}"
    middle = median(found.frames for found in delays)
    return (
        f"frames and forces of {which} are apart in time: those of {first.recording} agree best where frames"
        f" are {when} (correlation {first.correlation:.2f} instead of {first.without:.2f}); median"
        f" {middle:+g} frames"
    )


def say_forces(output, written) -> None:
    """Print what a dataset of frames with forces holds, which groups are held out, which frames are missing
    because they would have to pull the skin, and whether frames and forces are apart in time; `written` is
    what the importer returned."""
    from fastac.sensor.dataset import read

    data = read(output)
    tested = ", ".join(dict.fromkeys(data.group[data.indices("test")].tolist()))
    left_out = f", {data.left_out} left out" if data.left_out else ""
    click.echo(
        f"{output}: {len(data)} frames ({split_counts(data)}){left_out}, force {', '.join(data.force_axes)}"
    )
    click.echo(f"test: {tested}")
    if written.pulled:
        click.echo(
            f"{written.pulled} frames with F_z below {-written.limit_n:.3g} N are left out, for nothing pulls"
            " a skin; --keep-pulls keeps them"
        )
    if written.delays:
        click.echo(f"warning: {output}: {_apart(written.delays)}", err=True)
