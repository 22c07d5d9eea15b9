"""Commands that offer a stream of records to other programs, and that read one."""

import os
import sys

import click

from fastac.cli.stream_options import INTERRUPTED, opened_stream, stream_options
from fastac.streaming.address import DEFAULT_ADDRESS, is_local


@click.command()
@stream_options()
@click.option(
    "--bind",
    default=DEFAULT_ADDRESS,
    show_default=True,
    help="Where to offer the stream; tcp://*:5599 is every interface of this machine.",
)
@click.option(
    "--wait",
    type=click.IntRange(0),
    default=0,
    help="Begin when so many readers are there. [default: at once]",
)
def serve(bundle, frames, bind, wait, progress, **options):
    """Offer a stream of records over ZeroMQ: force with units, flags, time stamps and arrays of each frame.

    The records are the same whatever computes them, but for the clock counts of the hardware. Any number of
    programs may read them, in Python with fastac.streaming.client, in other languages with ZeroMQ and JSON
    (docs/stream.md). A reader that is too slow misses records and never delays the stream. Whoever can reach
    the address can read the stream. Ctrl-C ends it, with exit status 130.

    \b
    Example: fastac serve build/paper --loop --arrays depth_mm,normals
    """
    from fastac.driver.run import Stop
    from fastac.streaming.run import await_readers, pump
    from fastac.streaming.server import Publisher
    from fastac.streaming.tally import Tally

    publisher = Publisher(
        bind
    )  # first of all, so that an address in use is noticed before minutes of building
    try:
        with opened_stream(bundle, progress=progress, **options) as session, Stop() as stop:
            publisher.announce(session.about)
            click.echo(f"{session.about.scene} by {session.about.via} at {publisher.address}")
            if not is_local(publisher.address):
                click.echo("whoever reaches this machine can read the stream", err=True)
            await_readers(publisher, wait, stop, progress=progress)
            tally = Tally(enabled=progress)
            interrupted = pump(session, [publisher, tally], frames=frames, stop=stop)
    finally:
        publisher.close()
    slow = f", {publisher.overruns} times a reader was too slow" if publisher.overruns else ""
    click.echo(f"{tally.summary()}, {publisher.sent} sent{slow}")
    if interrupted:
        raise SystemExit(INTERRUPTED)


@click.command()
@click.argument("address", default=DEFAULT_ADDRESS)
@click.option(
    "--frames", type=click.IntRange(1), help="End after so many records. [default: at the stream's end]"
)
@click.option(
    "--format",
    "form",
    type=click.Choice(["json", "csv"]),
    default="json",
    show_default=True,
    help="Of a line.",
)
@click.option("--latest", is_flag=True, help="Always print the newest record; leave out those in between.")
@click.option(
    "--digests", is_flag=True, help="Add each record's SHA-256, which does not depend on clock counts."
)
@click.option("--about", is_flag=True, help="Print the stream's description and no record.")
@click.option(
    "--timeout-s",
    type=click.FloatRange(min=0, min_open=True),
    default=5.0,
    show_default=True,
    help="How long to wait for a stream.",
)
def listen(address, frames, form, latest, digests, about, timeout_s):
    """Print the records that are offered at ADDRESS, a line each: numbers with units, and shapes of arrays.

    At the end a line on standard error says how many records came and how many were missed.

    \b
    Example: fastac listen tcp://127.0.0.1:5599 --frames 10
    """
    from itertools import islice

    from fastac.streaming.client import connect
    from fastac.streaming.lines import FORMS, of_about

    try:
        with connect(address, latest=latest, timeout_s=timeout_s) as stream:
            if about:
                click.echo(of_about(stream.about))
                return
            heading, row = FORMS[form](stream.about, digests=digests)
            if heading is not None:
                click.echo(heading)
            for record in islice(stream, frames):
                click.echo(row(record))
            click.echo(f"{stream.received} records, {stream.missed} missed", err=True)
    except KeyboardInterrupt:
        raise SystemExit(INTERRUPTED) from None
    except BrokenPipeError:  # of `fastac listen | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
