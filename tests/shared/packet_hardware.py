"""What hardware.json says of hardware with frame packets, as far as a block design needs it."""

RECORD_BYTES = 64
BUNDLE_SHA256 = "0123456789abcdef" * 4


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
        "top": "fastac",
        "scene": "tiny",
        "bundle_sha256": BUNDLE_SHA256,
        "rtlil_sha256": BUNDLE_SHA256[::-1],
        "registers": [
            {"name": "ID", "offset": 0, "access": "ro", "meaning": "constant"},
            {
                "name": "ERRORS",
                "offset": 0x20,
                "access": "w1c",
                "meaning": "sticky <flags>",
                "reset": 0,
                "fields": [{"name": "line_short", "low": 0, "width": 1}],
            },
        ],
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


def stream_ports(port: str, bits: int, *, master: bool) -> list[tuple[str, str, int]]:
    """Direction, name and width of the ports of an AXI4-Stream of packets."""
    there, back = ("output", "input") if master else ("input", "output")
    widths = {"tdata": bits, "tkeep": bits // 8, "tlast": 1, "tvalid": 1}
    found = [(there, f"{port}_{name}", width) for name, width in widths.items()]
    return [*found, (back, f"{port}_tready", 1)]


def verilog(hardware: dict, module: str = "fastac") -> str:
    """A module with the hardware's ports, as Yosys would declare them, and a submodule; computes nothing."""
    ports = [("input", "clk", 1), ("input", "rst", 1), ("output", "interrupt", 1)]
    frame, results = hardware["frame"], hardware["results"]
    ports += stream_ports(frame["port"], 8 * frame["bytes_per_beat"], master=False)
    for each in hardware["outputs"]:
        ports += stream_ports(each["port"], 8 * each["bytes_per_beat"], master=True)
    if results["port"]:
        ports += stream_ports(results["port"], 32, master=True)
    lite = {"awaddr": 8, "awprot": 3, "wdata": 32, "wstrb": 4, "araddr": 8, "arprot": 3, "rdata": 32}
    lite |= {"bresp": 2, "rresp": 2}
    answers = ("awready", "wready", "bresp", "bvalid", "arready", "rdata", "rresp", "rvalid")
    for name in (
        *("awaddr", "awprot", "awvalid", "awready", "wdata", "wstrb", "wvalid", "wready", "bresp", "bvalid"),
        *("bready", "araddr", "arprot", "arvalid", "arready", "rdata", "rresp", "rvalid", "rready"),
    ):
        direction = "output" if name in answers else "input"
        ports.append((direction, f"s_axil_{name}", lite.get(name, 1)))
    lines = [f"module {module}({', '.join(name for _, name, _ in ports)});"]
    for direction, name, width in ports:
        span = f"[{width - 1}:0] " if width > 1 else ""
        lines += [f"  {direction} {span}{name};", f"  wire {span}{name};"]
    lines += [f"  \\{module}.part  part (", "    .i(clk)", "  );", "endmodule", ""]
    lines += [f"module \\{module}.part (i);", "  input i;", "  wire i;", "endmodule", ""]
    return "\n".join(lines)
