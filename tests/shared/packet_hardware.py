"""What hardware.json says of hardware with frame packets, as far as a block design needs it."""

RECORD_BYTES = 64


def output(name: str, rows: int, columns: int, words: int, lanes: int) -> dict:
    """An image output: `words` (a power of two) 32-bit words a pixel, `lanes` pixels a beat, the trailer."""
    beat = 4 * words * lanes
    image = rows * -(-columns // lanes) * beat
    return {
        "name": name,
        "port": f"m_axis_{name}",
        "bytes_per_beat": beat,
        "image_bytes": image,
        "packet_bytes": image + -(-RECORD_BYTES // beat) * beat,
    }


def packet_hardware(
    *outputs: dict, part="xczu19eg-ffvc1760-2-i", side=128, lanes=1, clock_mhz=150.0, pixel_bytes=4
) -> dict:
    """Square frames of `side` pixels; without image outputs the records have a stream of their own."""
    return {
        "streams": "packets",
        "part": part,
        "clock_mhz": clock_mhz,
        "frame": {
            "port": "s_axis",
            "height_px": side,
            "width_px": side,
            "lanes": lanes,
            "bytes_per_beat": pixel_bytes * lanes,
            "bytes": side * side * pixel_bytes,
        },
        "outputs": list(outputs),
        "results": {"record_bytes": RECORD_BYTES, "port": None if outputs else "m_axis_results"},
    }
