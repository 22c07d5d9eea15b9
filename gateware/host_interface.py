"""What a host's driver must know of the hardware, for hardware.json: frames, packets, registers, scales."""

from fastac.gateware.bus.identity import Identity
from fastac.gateware.bus.record import FIFO_RECORDS, record_form
from fastac.gateware.bus.register_map import ADDRESS_WIDTH, AXES, ERRORS
from fastac.gateware.packet_format import FrameFormat
from fastac.gateware.raster_outputs import RasterOutput
from fastac.gateware.top_zynq import TopZynq
from fastac.models.integer.frame_validity import REASONS
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.scenes.outputs import OUTPUTS

FORMAT_VERSION = 1
"""Version of the keys below."""


def host_interface(top: TopZynq) -> dict:
    """The facts, as values that JSON can express; docs/hardware.md says what they mean.

    Sizes in bytes are those of packets, and are absent from hardware whose streams are video.
    """
    pipeline, identity, scene = top.bundle.pipeline, top.identity, top.bundle.scene
    found = {
        "format_version": FORMAT_VERSION,
        "version": identity.version,
        "scene": scene.name,
        "clock_mhz": scene.hardware.clock_mhz,
        "streams": scene.hardware.streams,
        "address_bits": ADDRESS_WIDTH,
        "interrupt": "level, high",
        "frame": _frame(identity, scene.sensor.channel_names),
        "outputs": [_output(output, pipeline) | _trailer(identity) for output in top.outputs],
        "force": _force(pipeline, identity),
        "interval": _interval(top) if identity.half_width else None,
        "slip": {"unit": "px^2/4096"} if identity.slip else None,
        "registers": registers(identity),
        "errors": list(ERRORS),
        "validity": list(REASONS),
    }
    if identity.packets:
        form = record_form(identity.half_width)
        found["results"] = {
            "record_bytes": form.bytes,
            "format": form.number,
            "words": list(form.words),
            "port": None if top.outputs else "m_axis_results",
            "fifo_records": FIFO_RECORDS,
        }
    return found


def registers(identity: Identity) -> list[dict]:
    """The registers; `reset`: value after reset, None where it is not constant."""
    resets = identity.resets
    return [
        {
            "name": r.name,
            "offset": r.offset,
            "access": r.access,
            "meaning": r.meaning,
            "reset": resets[r.name],
            "read_changes": r.read_changes,
            "fields": [field._asdict() for field in r.fields],
        }
        for r in identity.registers
    ]


def _frame(identity: Identity, channels: tuple[str, ...]) -> dict:
    found = {
        "height_px": identity.height,
        "width_px": identity.width,
        "channels": list(channels),
        "lanes": identity.lanes,
        "port": "s_axis",
    }
    if identity.packets:
        layout = FrameFormat(identity.height, identity.width, identity.channels, identity.lanes)
        found["bytes_per_pixel"] = layout.bytes_per_pixel
        found["bytes_per_beat"] = layout.bytes_per_beat
        found["bytes"] = layout.bytes
    return found


def _output(output: RasterOutput, pipeline: IntegerPipeline) -> dict:
    found = {
        "name": output.name,
        "port": f"m_axis_{output.name}",
        "rows": output.rows,
        "columns": output.columns,
        "words_per_pixel": output.words,
        "lanes": output.lanes,
        "beats_per_row": output.beats,
        "rows_reversed": output.rows_reversed,
        "unit": OUTPUTS[output.name].unit,
        "per_lsb": _per_lsb(output.name, pipeline),
    }
    if layout := output.packet:
        found |= {
            "words_per_pixel_padded": layout.words_padded,
            "bytes_per_beat": layout.bytes_per_beat,
            "row_bytes": layout.row_bytes,
            "image_bytes": layout.image_bytes,
            "packet_bytes": layout.packet_bytes,
            "trailer_offset_bytes": layout.image_bytes,
            "complete": output.complete,
        }
    return found


def _per_lsb(name: str, pipeline: IntegerPipeline) -> float | dict[str, float] | None:
    """One unit of an output's words, in the output's unit; None for normals, which have any length."""
    unit = OUTPUTS[name].unit
    if unit == "mm":
        return pipeline.depth_mm_per_unit
    return _newtons(pipeline) if unit == "N" else None


def _force(pipeline: IntegerPipeline, identity: Identity) -> dict | None:
    if not identity.axes:
        return None
    return {"axes": list(identity.axes), "newtons_per_lsb": _newtons(pipeline)}


def _interval(top: TopZynq) -> dict:
    """Of the interval around each force, force ± half-width: its coverage, and the half-width's bits and
    clocks."""
    return {
        "coverage": top.bundle.scene.force.coverage,
        "half_width_bits": top.identity.half_width_bits,
        "clocks_after_force": top.datapath.force_to_half_widths,
    }


def _trailer(identity: Identity) -> dict[str, int]:
    """The bytes of a packet's record, where they are not those that they always were."""
    return {"record_bytes": record_form(True).bytes} if identity.half_width else {}


def _newtons(pipeline: IntegerPipeline) -> dict[str, float]:
    """Newtons of one unit of an axis' accumulator, and of its word in the force map."""
    scales = [float(scale) for scale in pipeline.force_n_per_unit]
    axes = [AXES[axis] for axis in pipeline.scene.force_axes]
    return dict(zip(axes, scales, strict=True))
