"""Records as a recording of Rerun: in its viewer, the newest ones; in a file .rrd, every one.

Entities: camera/image, camera/nir, normals, depth (a DepthImage whose values are mm), force_map/AXIS,
skin/surface (a mesh in mm, coloured by the press), skin/force (an arrow), plots/force_n,
plots/latency_ms/hardware and host, plots/frames_per_second, status (states) and events (a text for each frame
that is flagged or lost). Timelines: `frame`, the frame's number, and `source_time`, the source's time stamp:
since a recording's beginning, or a camera's date.
"""

import os
import shutil
import socket
import sys
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np

from fastac.streaming.record import StreamRecord
from fastac.streaming.sink import Sink
from fastac.streaming.views.pictures import (
    SURFACE_PX,
    Sight,
    colours_of_normals,
    colours_of_press,
    surface_normals,
    thinned,
    triangles,
)
from fastac.streaming.views.rate import FrameRate
from fastac.streaming.views.worker import Every, Newest

APPLICATION = "fastac"
PER_SECOND = 30.0
"""Most records a second that the viewer is shown."""
AXES = {"x": (57, 135, 229), "y": (217, 89, 38), "z": (25, 158, 112)}
"""Colours of curves: those of the page."""
ARROW = (228, 87, 46)
FRAME, SOURCE_TIME = "frame", "source_time"
PORT, EXAMPLE = 9876, "rerun+http://127.0.0.1:9876/proxy"
"""Where a Rerun viewer listens, unless it is told otherwise."""
ANSWER_S = 2.0
MISSING = "rerun: not installed: pip install 'fastac[view]'"


class ViewError(RuntimeError):
    """A view that cannot be shown; the message is one line."""


def installed() -> bool:
    """Whether Rerun is there."""
    from importlib.util import find_spec

    return find_spec("rerun") is not None


def display() -> bool:
    """Whether a window can be opened here."""
    return sys.platform in ("win32", "darwin") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def logged(sight: Sight, path: Path) -> Sink:
    """A sink that writes every record to a file, which is complete when it is closed.

    Raises ViewError where Rerun is not installed or the file cannot be written.
    """
    view = RerunView(sight)
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
    view = RerunView(sight)
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


class RerunView:
    """Writes records to a recording of Rerun. Raises ViewError where it is not installed."""

    def __init__(self, sight: Sight):
        try:
            import rerun
        except ImportError:
            raise ViewError(MISSING) from None
        self._rr, self._sight, self._rate = rerun, sight, FrameRate()
        self._status: dict[str, str] = {}
        self.recording = rerun.RecordingStream(APPLICATION, recording_id=None)

    def blueprint(self):
        """What is where in the viewer."""
        from fastac.streaming.views.rerun_layout import blueprint

        return blueprint(self._sight)

    def begin(self) -> None:
        """Write what does not change: the description of the stream, names of curves, triangles."""
        rr, about = self._rr, self._sight.about
        lines = [
            f"**{about.scene}**, {about.height_px} × {about.width_px} px, {', '.join(about.channels)}",
            f"computed by {about.via}, clock of {about.clock_mhz:g} MHz"
            + (" (simulated)" if about.simulated_clock else ""),
            f"frames: {about.source}",
            f"bundle {about.bundle_sha256[:16]}",
        ]
        self._static("about", rr.TextDocument("\n\n".join(lines), media_type=rr.MediaType.MARKDOWN))
        self._static("skin", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        if about.force_axes:
            names = [f"F_{axis}, N" for axis in about.force_axes]
            self._static(
                "plots/force_n", rr.SeriesLines(names=names, colors=[AXES[axis] for axis in about.force_axes])
            )
        simulated = ", simulated" if about.simulated_clock else ""
        self._static(
            "plots/latency_ms/hardware", rr.SeriesLines(names=f"hardware{simulated}, ms", colors=AXES["x"])
        )
        self._static("plots/latency_ms/host", rr.SeriesLines(names="host, ms", colors=AXES["y"]))
        self._static("plots/frames_per_second", rr.SeriesLines(names="frames/s", colors=AXES["x"]))
        self._grid = thinned(self._sight.rest_depth_mm, SURFACE_PX)
        rows, columns = self._grid.shape
        fixed = {"triangle_indices": triangles(rows, columns)}
        if "depth_mm" not in about.arrays:
            fixed |= self._surface(self._grid, np.zeros_like(self._grid))
        self._static("skin/surface", rr.Mesh3D.from_fields(**fixed))

    def end(self) -> None:
        """Let everything arrive, and close the recording."""
        self.recording.flush()
        self.recording.disconnect()

    def _static(self, path: str, content) -> None:
        self.recording.log(path, content, static=True)

    def take(self, record: StreamRecord, left_out: int) -> None:
        """Write one record; `left_out` others came before it since the last one."""
        rr, log = self._rr, self.recording.log
        self.recording.set_time(FRAME, sequence=record.frame)
        stamp = record.source_time_ns
        if self._sight.live:
            self.recording.set_time(SOURCE_TIME, timestamp=np.datetime64(stamp, "ns"))
        else:
            self.recording.set_time(SOURCE_TIME, duration=np.timedelta64(stamp, "ns"))
        self._flags(record)
        per_second = self._rate.add(record.timing.made_ns, 1 + left_out)
        if per_second is not None:
            log("plots/frames_per_second", rr.Scalars(per_second))
        if record.image is not None:
            log("camera/image", rr.Image(record.image[..., :3], color_model="BGR"))
            if record.image.shape[-1] > 3:
                log("camera/nir", rr.Image(record.image[..., 3], color_model="L"))
        if record.lost:
            return
        timing = record.timing
        log("plots/latency_ms/hardware", rr.Scalars(1e3 * timing.first_pixel_to_result_s))
        log("plots/latency_ms/host", rr.Scalars(1e3 * timing.host_latency_s))
        if record.force_n:
            log("plots/force_n", rr.Scalars(list(record.force_n.values())))
        if record.normals is not None:
            log("normals", rr.Image(colours_of_normals(record.normals)))
        if record.force_map_n is not None:
            for axis, share in zip(self._sight.about.force_axes, record.force_map_n, strict=True):
                log(f"force_map/{axis}", rr.Image(share, color_model="L"))
        self._skin(record)

    def _skin(self, record: StreamRecord) -> None:
        """Depth, surface and arrow."""
        rr, sight = self._rr, self._sight
        press = sight.press_mm(record)
        sight.see(record, press)
        if press is not None:
            depth = record.depth_mm
            self.recording.log("depth", rr.DepthImage(depth, meter=1e3, colormap="viridis"))
            surface = self._surface(thinned(depth, SURFACE_PX), thinned(press, SURFACE_PX))
            self.recording.log("skin/surface", rr.Mesh3D.from_fields(**surface))
        if (arrow := sight.arrow(record, press)) is not None:
            size = " ".join(f"F_{axis} {value:+.3f} N" for axis, value in record.force_n.items())
            shape = rr.Arrows3D(
                origins=[arrow.tip_mm - arrow.vector_mm],
                vectors=[arrow.vector_mm],
                colors=[ARROW],
                radii=[0.012 * sight.about.width_px * sight.about.pitch_mm],
                labels=[size],
            )
            self.recording.log("skin/force", shape)

    def _surface(self, depth_mm: np.ndarray, press_mm: np.ndarray) -> dict[str, np.ndarray]:
        """The vertices of the mesh."""
        sight = self._sight
        x, y = (thinned(axis[:, None], SURFACE_PX)[:, 0] for axis in (sight.x_mm, sight.y_mm))
        rows, columns = depth_mm.shape
        places = np.empty((rows, columns, 3), np.float32)
        places[..., 0], places[..., 1], places[..., 2] = x, y[:, None], depth_mm
        return {
            "vertex_positions": places.reshape(-1, 3),
            "vertex_normals": surface_normals(depth_mm, float(x[1] - x[0])).reshape(-1, 3),
            "vertex_colors": colours_of_press(press_mm, sight.full_press_mm).reshape(-1, 3),
        }

    def _flags(self, record: StreamRecord) -> None:
        """The state of the frame where it changes, and an event where anything is wrong."""
        words = [name for name in ("lost", "bad", "slipping") if getattr(record, name)]
        if record.suspect:
            words.insert(0, f"suspect: {', '.join(record.reasons)}")
        state = "; ".join(words) or "ok"
        if self._status.get("frame") != state:
            self._status["frame"] = state
            self.recording.log("status", self._rr.StateChange(state=state))
        if words or record.errors:
            level = "ERROR" if record.lost or record.bad else "WARN"
            text = "; ".join([*words, *(f"error {name}" for name in record.errors)])
            self.recording.log("events", self._rr.TextLog(f"frame {record.frame}: {text}", level=level))
