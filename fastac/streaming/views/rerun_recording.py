"""Records of a stream as entities of a recording of Rerun.

Entities: camera/image, camera/nir, normals, depth (a DepthImage whose values are mm), force_map/AXIS,
skin/surface (a mesh in mm, coloured by the press), skin/force (an arrow), plots/force_n,
plots/latency_ms/hardware and host, plots/frames_per_second, status (states) and events (a text for each frame
that is flagged or lost). Timelines: `frame`, the frame's number, and `source_time`, the source's time stamp:
since a recording's beginning, or a camera's date.
"""

import numpy as np

from fastac.streaming.record import StreamRecord
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

APPLICATION = "fastac"
AXES = {"x": (57, 135, 229), "y": (217, 89, 38), "z": (25, 158, 112)}
"""Colours of curves: those of the page."""
ARROW = (228, 87, 46)
FRAME, SOURCE_TIME = "frame", "source_time"
MISSING = "rerun: not installed: pip install -e '.[view]'"


class ViewError(RuntimeError):
    """A view that cannot be shown; the message is one line."""


class RerunRecording:
    """Writes records to a recording of Rerun, `recording`. Raises ViewError where Rerun is not installed."""

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
        self._formats()
        rest = thinned(self._sight.rest_depth_mm, SURFACE_PX)
        rows, columns = rest.shape
        self._places = np.zeros((rows, columns, 3), np.float32)
        x, y = self._sight.grid_mm()
        self._places[..., 0], self._places[..., 1] = x, y[:, None]
        fixed = {"triangle_indices": triangles(rows, columns)}
        if "depth_mm" not in about.arrays:
            fixed |= self._surface(rest, np.zeros_like(rest))
        self._static("skin/surface", rr.Mesh3D.from_fields(**fixed))

    def _formats(self) -> None:
        """Sizes and types of pictures, and the arrow's look: said once, which saves a third of the time."""
        rr, about = self._rr, self._sight.about
        height, width = about.height_px, about.width_px

        def form(rows: int, columns: int, kind: str, model: str | None = None):
            return rr.components.ImageFormat(columns, rows, color_model=model, channel_datatype=kind)

        inner, arrays = (height - 2, width - 2), about.arrays
        if "image" in arrays:
            self._static("camera/image", rr.Image.from_fields(format=form(height, width, "U8", "BGR")))
            if len(about.channels) > 3:
                self._static("camera/nir", rr.Image.from_fields(format=form(height, width, "U8", "L")))
        if "normals" in arrays:
            self._static("normals", rr.Image.from_fields(format=form(height, width, "U8", "RGB")))
        if "depth_mm" in arrays:
            shown = {"meter": 1e3, "colormap": "viridis"}
            self._static("depth", rr.DepthImage.from_fields(format=form(*inner, "F32"), **shown))
        for axis in about.force_axes if "force_map_n" in arrays else ():
            self._static(f"force_map/{axis}", rr.Image.from_fields(format=form(*inner, "F32", "L")))
        radius = 0.012 * width * about.pitch_mm
        self._static("skin/force", rr.Arrows3D.from_fields(colors=[ARROW], radii=[radius]))

    def _pixels(self, path: str, pixels: np.ndarray, kind: str = "Image") -> None:
        """The values of a picture whose format is known."""
        self.recording.log(path, getattr(self._rr, kind).from_fields(buffer=pixels.tobytes()))

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
            self._pixels("camera/image", record.image[..., :3])
            if record.image.shape[-1] > 3:
                self._pixels("camera/nir", record.image[..., 3])
        if record.lost:
            return
        timing = record.timing
        log("plots/latency_ms/hardware", rr.Scalars(1e3 * timing.first_pixel_to_result_s))
        log("plots/latency_ms/host", rr.Scalars(1e3 * timing.host_latency_s))
        if record.force_n:
            log("plots/force_n", rr.Scalars(list(record.force_n.values())))
        if record.normals is not None:
            self._pixels("normals", colours_of_normals(record.normals))
        if record.force_map_n is not None:
            for axis, share in zip(self._sight.about.force_axes, record.force_map_n, strict=True):
                self._pixels(f"force_map/{axis}", share.astype(np.float32))
        self._skin(record)

    def _skin(self, record: StreamRecord) -> None:
        """Depth, surface and arrow."""
        rr, sight = self._rr, self._sight
        press = sight.press_mm(record)
        sight.see(record, press)
        if press is not None:
            depth = record.depth_mm
            self._pixels("depth", depth.astype(np.float32), "DepthImage")
            surface = self._surface(thinned(depth, SURFACE_PX), thinned(press, SURFACE_PX))
            self.recording.log("skin/surface", rr.Mesh3D.from_fields(**surface))
        if (arrow := sight.arrow(record, press)) is not None:
            size = " ".join(f"F_{axis} {value:+.3f} N" for axis, value in record.force_n.items())
            shape = rr.Arrows3D.from_fields(
                origins=[arrow.tip_mm - arrow.vector_mm], vectors=[arrow.vector_mm], labels=[size]
            )
            self.recording.log("skin/force", shape)

    def _surface(self, depth_mm: np.ndarray, press_mm: np.ndarray) -> dict[str, np.ndarray]:
        """The vertices of the mesh."""
        places = self._places.copy()
        places[..., 2] = depth_mm
        step_mm = float(places[0, 1, 0] - places[0, 0, 0])
        return {
            "vertex_positions": places.reshape(-1, 3),
            "vertex_normals": surface_normals(depth_mm, step_mm).reshape(-1, 3),
            "vertex_colors": colours_of_press(press_mm, self._sight.full_press_mm).reshape(-1, 3),
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
