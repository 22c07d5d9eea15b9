"""Rerun as a view: the newest records in its viewer, and every record in a file .rrd."""

import os
import shutil
import socket
import sys
from pathlib import Path
from urllib.parse import urlsplit

from fastac.streaming.sink import Sink
from fastac.streaming.views.pictures import Sight
from fastac.streaming.views.rerun_recording import MISSING, RerunRecording, ViewError
from fastac.streaming.views.worker import Every, Newest

PER_SECOND = 30.0
"""Most records a second that the viewer is shown."""
PORT, EXAMPLE = 9876, "rerun+http://127.0.0.1:9876/proxy"
"""Where a Rerun viewer listens, unless it is told otherwise."""
ANSWER_S = 2.0


def installed() -> bool:
    """Whether Rerun is there."""
    from importlib.util import find_spec

    return find_spec("rerun") is not None


def require_installed() -> None:
    """Raise ViewError, which says how to install it, where Rerun is not there."""
    if not installed():
        raise ViewError(MISSING)


def display() -> bool:
    """Whether a window can be opened here."""
    return sys.platform in ("win32", "darwin") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def logged(sight: Sight, path: Path) -> Sink:
    """A sink that writes every record to a file, which is complete when it is closed.

    Raises ViewError where Rerun is not installed or the file cannot be written.
    """
    view = RerunRecording(sight)
    try:
        view.recording.save(path, default_blueprint=view.blueprint())
    except (RuntimeError, OSError) as error:
        raise ViewError(f"{path}: {error}") from None
    view.begin()
    return Every(view.take, done=view.end)


def shown(sight: Sight, url: str | None = None) -> Newest:
    """A sink that shows the newest records in Rerun's viewer: that at `url`, else one that it opens.

    Raises ViewError where Rerun is not installed, or the viewer does not start.
    """
    if url is not None:
        _require_answer(url)
    elif not display():
        raise ViewError("rerun: no display here for its viewer: take --view page or --rerun-url")
    view = RerunRecording(sight)
    try:
        if url is None:
            import rerun

            beside = shutil.which("rerun", path=str(Path(sys.executable).parent))
            rerun.spawn(
                connect=False,
                executable_path=beside,
                hide_welcome_screen=True,
                recording=view.recording,
            )
            _require_answer(EXAMPLE)
        view.recording.connect_grpc(url, default_blueprint=view.blueprint())
    except (RuntimeError, ValueError, OSError) as error:
        raise ViewError(f"{url or 'rerun'}: {error}") from None
    view.begin()
    return Newest(view.take, per_second=PER_SECOND, done=view.end)


def _require_answer(url: str) -> None:
    """Raise ViewError unless somebody listens at a viewer's address: Rerun itself would wait for long."""
    try:
        address = urlsplit(url)
        place = address.hostname, address.port or PORT
        if not address.scheme.startswith("rerun") or not address.hostname:
            raise ValueError
    except ValueError:
        raise ViewError(f"{url}: expected an address such as {EXAMPLE}") from None
    try:
        socket.create_connection(place, timeout=ANSWER_S).close()
    except OSError as error:
        raise ViewError(f"{url}: no Rerun viewer answers: {error.strerror or error}") from None
