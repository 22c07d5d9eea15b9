# amaranth: UnusedElaboratable=no
"""hardware.json of a bundle without elaborating anything, and frames for it."""

import json

import numpy as np

from fastac.driver.description import Description, parse
from fastac.gateware.bus.register_map import AXES, ERRORS, REGISTERS
from fastac.gateware.packet_format import FrameFormat, PacketFormat
from fastac.gateware.top_zynq import VERSION, TopZynq
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.frame_validity import REASONS


def content(bundle: Bundle, streams: str = "packets") -> dict:
    """What hardware.json says of the bundle's hardware, as the contract of the file has it."""
    top = TopZynq(bundle)
    scene, path, identity = bundle.scene, top.datapath, top.identity
    sensor, pipeline, packets = scene.sensor, bundle.pipeline, streams == "packets"
    form = FrameFormat(sensor.height_px, sensor.width_px, len(sensor.channel_names), top.lanes)
    frame = {
        "height_px": sensor.height_px,
        "width_px": sensor.width_px,
        "channels": list(sensor.channel_names),
        "lanes": top.lanes,
        "port": "s_axis",
    }
    if packets:
        frame |= {k: getattr(form, k) for k in ("bytes_per_pixel", "bytes_per_beat", "bytes")}
    per_lsb = {"depth": ("mm", lambda: pipeline.depth_mm_per_unit), "normals": ("1", lambda: None)}
    newtons = {}
    if scene.wants_force:
        scales = np.atleast_1d(pipeline.force_n_per_unit).tolist()
        newtons = {AXES[axis]: scale for axis, scale in zip(scene.force_axes, scales, strict=True)}
    outputs = []
    for o in top.outputs:
        unit, scale = per_lsb.get(o.name, ("N", lambda: newtons))
        entry = {
            "name": o.name,
            "port": f"m_axis_{o.name}",
            "rows": o.rows,
            "columns": o.columns,
            "words_per_pixel": o.words,
            "lanes": o.lanes,
            "rows_reversed": o.rows_reversed,
            "unit": unit,
            "per_lsb": scale(),
        }
        if packets:
            p = PacketFormat(o.name, o.rows, o.columns, o.words, o.lanes)
            entry |= {
                "words_per_pixel_padded": p.words_padded,
                "beats_per_row": p.beats_per_row,
                "bytes_per_beat": p.bytes_per_beat,
                "row_bytes": p.row_bytes,
                "image_bytes": p.image_bytes,
                "packet_bytes": p.packet_bytes,
                "trailer_offset_bytes": p.image_bytes,
                "complete": o.name != "normals" or identity.result == "normals",
            }
        outputs.append(entry)
    constant = {
        "CAPABILITIES": identity.capabilities,
        "CALIBRATION_WORDS": identity.calibration_words,
        "CALIBRATION_LAYOUT": identity.calibration_layout,
        "SLIP_LIMIT": identity.slip_limit,
        "FRAME_TIMEOUT": identity.frame_timeout,
        "CONTROL": 1,
    }
    registers = [
        {
            "name": r.name,
            "offset": r.offset,
            "access": r.access,
            "meaning": r.meaning,
            "reset": constant.get(r.name),
            "fields": [f._asdict() for f in r.fields],
        }
        for r in identity.registers
    ]
    known = {r.name for r in REGISTERS}
    more = (("TIME_LOW", 0x8C), ("TIME_HIGH", 0x90), ("RESULTS_WAITING", 0x94), ("RESULTS_WORD", 0x98))
    for name, offset in (*more, ("RESULTS_LOST", 0x9C)) if packets and "TIME_LOW" not in known else ():
        registers.append({"name": name, "offset": offset, "access": "ro", "meaning": "", "fields": []})
    control = next(r for r in registers if r["name"] == "CONTROL")
    if packets and "clear_results" not in [f["name"] for f in control["fields"]]:
        control["fields"].append({"name": "clear_results", "low": 5, "width": 1})
    latency = {"stage": path.stages, "initiation_interval": path.interval}
    for kind, wanted in (
        ("force", path.wants_force),
        ("depth", path.wants_depth),
        ("normals", path.wants_normals),
    ):
        if wanted:
            latency[f"first_pixel_to_{kind}"] = getattr(path, f"first_pixel_to_{kind}")
    results = {"record_bytes": 64, "format": 1, "words": [], "fifo_records": 16}
    results["port"] = None if outputs else "m_axis_results"
    errors = list(ERRORS) if "results_lost" in ERRORS else [*ERRORS, "results_lost"]
    return {
        "format_version": 1,
        "top": "fastac",
        "version": VERSION,
        "scene": scene.name,
        "part": "xczu19eg-ffvc1760-2-i",
        "clock_mhz": scene.hardware.clock_mhz,
        "streams": streams,
        "address_bits": 8,
        "interrupt": "level, high",
        "bundle_sha256": bundle.digest,
        "frame": frame,
        "outputs": outputs,
        "force": {"axes": list(newtons), "newtons_per_lsb": newtons} if newtons else None,
        "slip": {"unit": "px^2/4096"} if scene.wants_slip else None,
        "registers": registers,
        "errors": errors,
        "validity": list(REASONS),
        "latency_cycles_by_formula": latency,
        **({"results": results} if packets else {}),
    }


def described(bundle: Bundle, streams: str = "packets") -> Description:
    return parse(json.dumps(content(bundle, streams)))


def frames_of(bundle: Bundle, count: int, seed: int = 1) -> np.ndarray:
    """Frames (count, H, W, C) uint8: the background with noise; the last one far from it."""
    rng, background = np.random.default_rng(seed), bundle.pipeline.background
    spans = np.linspace(2, 30, count).astype(int)
    noise = [background + rng.integers(-s, s + 1, background.shape) for s in spans]
    noise[-1] = rng.integers(0, 256, background.shape)
    return np.clip(noise, 0, 255).astype(np.uint8)
