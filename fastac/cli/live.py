"""The command that shows a stream while it runs."""

import click

from fastac.cli.common import OUTPUT_FILE
from fastac.cli.stream_options import INTERRUPTED, opened_stream, stream_options

VIEWS = ("rerun", "page", "none")


@click.command()
@stream_options(loop=None)
@click.option(
    "--view",
    "views",
    type=click.Choice(VIEWS),
    multiple=True,
    help="What shows it: Rerun's viewer, a page for any browser on this machine, or nothing; repeatable."
    " [default: rerun where it is installed and there is a display, else page]",
)
@click.option(
    "--save",
    type=OUTPUT_FILE,
    help="Write every frame to this file .rrd, which Rerun's viewer opens. A recording is then played once.",
)
@click.option("--force", is_flag=True, help="With --save: replace a file that exists.")
@click.option("--rerun-url", help="Show it in the Rerun viewer at this address instead of opening one.")
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address of this machine where the page is served. Others than the default let other machines in"
    " that know the token, which goes over the network as plain text.",
)
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, help="Port of the page. [default: any that is free]"
)
@click.option("--open", "opens", is_flag=True, help="Open the page in a browser.")
def live(bundle, frames, loop, views, save, force, rerun_url, host, port, opens, progress, **options):
    """Show what the sensor feels, live: camera, normals, the skin as a surface, forces, flags, rate, latency.

    Frames come from a dataset, a video, a folder or a camera, and go through the emulator, the simulated
    Verilog or a board. A recording is played at its own pace, over and over, until Ctrl-C ends the view. The
    views may leave out frames, and say how many; a file of --save has every frame. The page is at an address
    with a secret token, which is printed. Cameras have never been tried.

    \b
    Example: fastac live build/gelsight --source press.mp4 --view page --open
    """
    from fastac.streaming.views import rerun_view

    if save is not None and save.exists() and not force:
        raise click.ClickException(f"{save}: exists already; --force replaces it")
    if save is not None and save.suffix != ".rrd":
        raise click.ClickException(f"{save}: expected a name that ends in .rrd")
    if save is not None or rerun_url or "rerun" in views:
        rerun_view.require_installed()
    views = _chosen(views, rerun_url)
    if loop is None:
        loop = save is None and bool(views)
    page = None
    if "page" in views:  # first of all, so that a browser can open it while the rest is made ready
        from fastac.streaming.views.page import LOCAL, PageView

        page = PageView(host=host, port=port)
        click.echo(f"page: {page.url}")
        if host != LOCAL:
            click.echo("other machines can see the page with this address", err=True)
        if opens:
            click.launch(page.url)
    elif opens:
        raise click.ClickException("--open: there is no page; add --view page")
    try:
        interrupted = _run(bundle, frames, page, views, save, rerun_url, progress, {**options, "loop": loop})
    finally:
        if page is not None:
            page.close()
    if interrupted:
        raise SystemExit(INTERRUPTED)


def _chosen(views: tuple[str, ...], rerun_url: str | None) -> tuple[str, ...]:
    """The views that are asked for, or the one that can be shown here, with a line that says why."""
    from fastac.streaming.views import rerun_view

    if rerun_url and "rerun" not in views:
        views = (*views, "rerun")
    if views:
        return tuple(name for name in dict.fromkeys(views) if name != "none")
    if not rerun_view.installed():
        reason = "Rerun is not installed (pip install -e '.[view]')"
    elif not rerun_view.display():
        reason = "there is no display for Rerun's viewer"
    else:
        click.echo("view: rerun", err=True)
        return ("rerun",)
    click.echo(f"view: page: {reason}", err=True)
    return ("page",)


def _run(bundle, frames, page, views, save, rerun_url, progress, options) -> bool:
    """Open the stream and pump it into the views; whether Ctrl-C ended it. Prints what was shown."""
    from fastac.driver.run import Stop
    from fastac.streaming.run import pump
    from fastac.streaming.tally import Tally
    from fastac.streaming.views import rerun_view
    from fastac.streaming.views.pictures import Sight, rest_depth_mm
    from fastac.streaming.views.since_start import since_start_s

    with opened_stream(bundle, progress=progress, **options) as session, Stop() as stop:
        rest = rest_depth_mm(session.bundle)
        sinks = []
        if save is not None:
            save.parent.mkdir(parents=True, exist_ok=True)
            sinks.append(rerun_view.logged(Sight(session.about, rest), save))
        if "rerun" in views:
            viewer = rerun_view.shown(Sight(session.about, rest), rerun_url)
            sinks.append(viewer)
        if page is not None:
            page.describe(Sight(session.about, rest))
            sinks.append(page)
            is_endless = session.loop or session.about.frames_per_second is None
            if not is_endless and frames is None:
                page.await_viewer(stop, progress=progress)
        tally = Tally(enabled=progress)
        interrupted = pump(session, [*sinks, tally], frames=frames, stop=stop)
    click.echo(tally.summary())
    if "rerun" in views:
        click.echo(f"rerun: {viewer.taken} shown, {viewer.left_out} left out")
    if page is not None:
        click.echo(f"page: {page.sent} shown, {page.left_out} left out, over all browsers")
        if page.first_picture_ns is not None:
            click.echo(f"first picture: {since_start_s(page.first_picture_ns):.1f} s after the command began")
    if save is not None:
        click.echo(save)
    return interrupted
