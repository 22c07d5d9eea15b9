"""What is where in Rerun's viewer."""

from fastac.streaming.views.pictures import Sight

HISTORY_S = 10.0
"""Seconds of curves that are shown."""


def blueprint(sight: Sight):
    """Pictures above, the skin in the middle, curves and events below; no panel for what is not there."""
    import rerun.blueprint as rrb

    about = sight.about
    pictures = []
    if "image" in about.arrays:
        pictures.append(rrb.Spatial2DView(origin="camera/image", name="Camera"))
        if len(about.channels) > 3:
            pictures.append(rrb.Spatial2DView(origin="camera/nir", name="Camera, near infrared"))
    if "normals" in about.arrays:
        pictures.append(rrb.Spatial2DView(origin="normals", name="Normals"))
    if "depth_mm" in about.arrays:
        pictures.append(rrb.Spatial2DView(origin="depth", name="Height z, mm"))
    if "force_map_n" in about.arrays:
        pictures += [
            rrb.Spatial2DView(origin=f"force_map/{axis}", name=f"Force map, {axis}")
            for axis in about.force_axes
        ]
    across_mm = about.width_px * about.pitch_mm
    top = float(sight.rest_depth_mm.max())
    skin = rrb.Spatial3DView(
        origin="skin",
        name="Skin, mm",
        eye_controls=rrb.EyeControls3D(
            position=(0.0, -0.85 * across_mm, top + 0.65 * across_mm),
            look_target=(0.0, 0.0, top - 0.15 * across_mm),
            eye_up=(0.0, 0.0, 1.0),
        ),
    )
    recent = rrb.VisibleTimeRange(
        "source_time",
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-HISTORY_S),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )

    def curve(path: str, name: str):
        return rrb.TimeSeriesView(origin=path, name=name, time_ranges=[recent])

    curves = [curve("plots/force_n", "Force, N")] if about.force_axes else []
    curves += [
        curve("plots/latency_ms", "Latency, ms"),
        curve("plots/frames_per_second", "Frames/s"),
    ]
    words = rrb.Vertical(
        rrb.StateTimelineView(origin="status", name="Frame"),
        rrb.Tabs(
            rrb.TextLogView(origin="events", name="Flagged frames"),
            rrb.TextDocumentView(origin="about", name="Stream"),
        ),
        row_shares=[1, 2],
    )
    above = rrb.Horizontal(skin, rrb.Grid(*pictures, grid_columns=2)) if pictures else skin
    return rrb.Blueprint(
        rrb.Vertical(above, rrb.Horizontal(*curves, words), row_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline="source_time"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )
