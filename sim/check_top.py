# amaranth: UnusedElaboratable=no
"""Simulation of the top level on real frames, compared bit by bit with the golden model."""

import json
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from fastac.gateware.bus.register_map import ID
from fastac.gateware.raster_outputs import RASTERS, RasterOutput
from fastac.gateware.top_zynq import TopZynq
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.frame_validity import suspects
from fastac.models.result import Result
from fastac.scenes.outputs import OUTPUTS
from fastac.sim.check_packets import PacketCheck, beat_bytes, packet_bytes
from fastac.sim.runner import build
from fastac.store.progress import watched

SUSPECT = 1 << 10
"""Bit of `tuser` in the streams of depth and force maps: the frame is suspect."""
SLIP = ("SLIP_SPREAD", "SLIP_DOTS")
"""Registers that belong to each frame's force where slip is found."""
HALF_WIDTH = "HALF_WIDTH_"
"""Beginning of the names of the registers of the intervals around each frame's force."""
SLIP_BIT = 5
"""Of STATUS: a frame slips."""
LINGER = 100
"""Clocks that the simulation goes on after the last expected beat."""


class SimulationFailure(RuntimeError):
    """The simulation failed before all outputs could be compared, or a latency differs from its formula."""


@dataclass
class Comparison:
    """Scoreboard: numbers of values compared and of mismatches, and a description of the first mismatch."""

    values: int = 0
    mismatches: int = 0
    first: str = ""

    def add(self, name: str, found: np.ndarray, expected: np.ndarray) -> None:
        """Compare two arrays, flattened; each missing or surplus value is a mismatch."""
        found, expected = np.ravel(found), np.ravel(expected)
        common = min(len(found), len(expected))
        wrong = np.flatnonzero(found[:common] != expected[:common])
        count = len(wrong) + abs(len(found) - len(expected))
        self.values += len(expected)
        self.mismatches += count
        if count and not self.first:
            where = (
                f"value {wrong[0]}: {found[wrong[0]]}, expected {expected[wrong[0]]}" if len(wrong) else ""
            )
            self.first = f"{name}: {len(found)} values, expected {len(expected)}; {where}".rstrip("; ")


@dataclass
class Report:
    """Results of a simulation of the top level; latencies in clock cycles."""

    frames: int
    values_compared: int
    mismatches: int
    first_mismatch: str
    latency_cycles: dict
    errors: int
    cycles: int
    values_by_output: dict = field(default_factory=dict)
    markers_compared: int = 0
    wall_s: dict = field(default_factory=dict)

    def as_dict(self) -> dict:
        return asdict(self)


def expected_words(top: TopZynq, result: Result) -> dict[str, np.ndarray]:
    """{output: expected words} from the golden model's result, with the rows in the order of the stream."""
    expected = {}
    for output in top.outputs:
        words = getattr(result, OUTPUTS[output.name].words)
        if RASTERS[output.name].axis_planes:
            words = np.moveaxis(words, 1, -1)
        expected[output.name] = words[:, output.row_order]
    return expected


def bench_settings(top: TopZynq) -> dict:
    """The settings of the top level's testbenches that follow from its bundle."""
    sensor = top.bundle.scene.sensor
    shown = ("LATENCY", "INTERVAL", HALF_WIDTH)
    measured = [r.name for r in top.identity.registers if r.name.startswith(shown)]
    beats = {output.name: output.octets for output in top.outputs}
    packets = {}
    if top.packets:
        words = len(top.packets.form.words)
        packets = {"pixel_octets": top.packets.input.frame.bytes_per_pixel, "record_words": words}
    return packets | {
        "period_ps": 2 * round(0.5e6 / top.bundle.scene.hardware.clock_mhz),  # an even number of ps
        "linger_cycles": LINGER,
        "lanes": top.lanes,
        "pace_cycles": top.bundle.scene.fold,
        "outputs": beat_bytes(top) if top.packets else beats,
        "axes": list(top.identity.axes),
        "registers": [*measured, "FRAME_VALIDITY", "STATUS", *(SLIP if top.identity.slip else ())],
        "identity": {
            "ID": ID,
            "BUNDLE_HASH_LOW": top.bundle.hash_word & 0xFFFFFFFF,
            "BUNDLE_HASH_HIGH": top.bundle.hash_word >> 32,
            "GEOMETRY": sensor.height_px | sensor.width_px << 16,
        },
    }


def _without_void(words: np.ndarray, output: RasterOutput) -> np.ndarray:
    """The words of whole rows, without those of unused lanes."""
    row = output.beats * output.lanes * output.words
    whole = len(words) // row * row
    return words[:whole].reshape(-1, row)[:, : output.columns * output.words]


def trace_file(folder: Path, name: str, trace: str) -> Path:
    """File to which `simulate` writes a trace of the kind `trace`."""
    return folder / f"{name}.{trace}"


def simulate(
    bundle: Bundle,
    source: Path,
    frames: np.ndarray,
    result: Result,
    folder: Path,
    *,
    name: str,
    stall: tuple[float, float] = (0, 0),
    build_args: tuple[str, ...] = (),
    trace: str | None = None,
    progress: bool = False,
) -> Report:
    """Send `frames` (frames, H, W, C) back to back through the Verilog `source` and compare all outputs.

    result : golden model, `bundle.pipeline.run(frames)`; name : the Verilog's top module
    stall : probabilities per clock that the driver of frames pauses, and that an output is not ready
    build_args : further arguments of Verilator
    trace : "saif" or "fst", written to `trace_file(folder, name, trace)`: the whole run, from reset on
    Raises SimulationFailure if the testbench fails: a hang, a violated AXI rule, a wrong identity.
    """
    top = TopZynq(bundle)
    path = top.datapath
    folder.mkdir(parents=True, exist_ok=True)
    np.save(folder / "frames.npy", frames)
    octets = {o.name: len(frames) * o.rows * o.beats * o.octets for o in top.outputs}
    if top.packets:
        octets = {name: len(frames) * size for name, size in packet_bytes(top).items()}
    latency = max(
        *path.first_pixel_to_packet.values(),
        path.first_pixel_to_force if path.wants_force else 0,
        path.first_pixel_to_depth if path.wants_depth else 0,
        path.beats * path.fold,
    )
    settings = bench_settings(top) | {
        "octets": octets,
        "stall": stall,
        "timeout_cycles": int(2 * (latency + len(frames) * path.interval) / (1 - max(stall)) ** 2) + 3000,
    }
    if trace is not None:
        settings["linger_cycles"] = 0  # a trace ends with its last frame
    (folder / "settings.json").write_text(json.dumps(settings))
    for stale in ("outputs.npz", "registers.json", "cycle"):
        (folder / stale).unlink(missing_ok=True)
    build_folder, test_args = folder / "build", []
    if trace is not None:
        build_folder = folder / f"build-{trace}"
        traced = trace_file(folder, name, trace).resolve()
        traced.unlink(missing_ok=True)
        test_args = ["--trace-file", str(traced)]
    start = time.monotonic()
    with watched("building the simulator", enabled=progress):
        runner = build(source, name, build_folder, build_args=build_args, trace=trace)
    built = time.monotonic()
    position = folder / "cycle"

    def cycle() -> int:
        return int(position.read_text() or 0) if position.exists() else 0

    total = latency + (len(frames) - 1) * path.interval
    try:
        with watched("simulating", enabled=progress, total=total, unit="cycle", position=cycle):
            runner.test(
                hdl_toplevel=name,
                test_module="fastac.sim.benches.top",
                build_dir=build_folder,
                waves=trace is not None,
                test_args=test_args,
                extra_env={"BENCH": str(folder.resolve())},
                log_file=folder / "simulation.log",
            )
    except (SystemExit, RuntimeError) as error:
        raise SimulationFailure(f"{folder / 'simulation.log'}: the testbench failed: {error}") from None
    wall = {"build": built - start, "simulate": time.monotonic() - built}
    if not (folder / "registers.json").exists():
        raise SimulationFailure(f"{folder / 'simulation.log'}: the testbench failed")
    with np.load(folder / "outputs.npz", allow_pickle=False) as archive:
        outputs = {k: archive[k] for k in archive.files}
    seen = json.loads((folder / "registers.json").read_text())

    comparison, markers = Comparison(), Comparison()
    per_output = {}
    expected = expected_words(top, result)
    if top.packets:
        check = PacketCheck(top, comparison, markers, outputs, seen["errors"])
        per_output = check.images(expected)
        in_fifo = outputs["in_fifo"].view(top.packets.form.layout)
        check.records(result, in_fifo, exact=not any(stall))
        check.framing(len(frames))
    for output in () if top.packets else top.outputs:
        words = expected[output.name]
        comparison.add(output.name, _without_void(outputs[f"{output.name}_words"], output), words)
        per_output[output.name] = int(words.size)
    if path.wants_force:
        comparison.add("force", outputs["force_raw"], result.force_raw)
        per_output["force"] = int(result.force_raw.size)
    if top.identity.half_width:
        halves = [
            [frame[f"{HALF_WIDTH}{axis}_HIGH"] << 32 | frame[f"{HALF_WIDTH}{axis}_LOW"] for axis in axes]
            for axes in [top.identity.axes.upper()]
            for frame in seen["frames"]
        ]
        comparison.add("half-widths", np.array(halves), result.force_half_width_raw)
        per_output["half_widths"] = int(result.force_half_width_raw.size)
        numbers = [frame[f"{HALF_WIDTH}SEQUENCE"] for frame in seen["frames"]]
        markers.add("HALF_WIDTH_SEQUENCE", np.array(numbers), np.arange(1, len(frames) + 1))
    if top.identity.slip:
        found = {name: np.array([frame[name] for frame in seen["frames"]]) for name in (*SLIP, "STATUS")}
        for name, values in zip(SLIP, (result.slip_words, result.slip_dots), strict=True):
            comparison.add(name, found[name], values)
        per_output["slip"] = len(SLIP) * len(frames)
        markers.add("STATUS.slip", found["STATUS"] >> SLIP_BIT & 1, result.slipping)
    if not top.packets:
        _check_markers(markers, outputs, top, result.validity)
    flags = [frame["FRAME_VALIDITY"] for frame in seen["frames"]]
    markers.add("FRAME_VALIDITY", np.array(flags), result.validity)
    return Report(
        frames=len(frames),
        values_compared=comparison.values,
        mismatches=comparison.mismatches + markers.mismatches,
        first_mismatch=comparison.first or markers.first,
        latency_cycles=_latencies(top, outputs, seen, stalled=any(stall)),
        errors=seen["errors"],
        cycles=seen["cycles"],
        values_by_output=per_output,
        markers_compared=markers.values,
        wall_s=wall,
    )


def _check_markers(comparison: Comparison, outputs: dict, top: TopZynq, validity: np.ndarray) -> None:
    """Compare `tuser` (start of frame, row, flags), `tlast` (end of row) and `tkeep` of every beat."""
    frames, suspect = len(validity), suspects(validity).astype(int)
    for output in top.outputs:
        last = np.zeros((frames, output.rows, output.beats), np.int8)
        last[..., -1] = 1
        user = np.zeros(last.shape, np.int32)
        user[:, 0, 0] = 1
        if output.tagged:
            user += 4 * np.array(output.row_order)[:, None] + SUSPECT * suspect[:, None, None]
            octets = np.full(output.beats, output.octets)
            octets[-1] -= output.void_octets
            keep = np.broadcast_to((1 << octets) - 1, last.shape)
            comparison.add(f"{output.name}.tkeep", outputs[f"{output.name}_keep"], keep)
        comparison.add(f"{output.name}.tlast", outputs[f"{output.name}_last"], last)
        comparison.add(f"{output.name}.tuser", outputs[f"{output.name}_user"], user)


def _latencies(top: TopZynq, outputs: dict, seen: dict, *, stalled: bool) -> dict:
    """Measured latencies of the first frame, checked with formulas unless `stalled`, and the interval."""
    path = top.datapath
    first = int(outputs["first_at"][0])
    registers = seen["frames"][0]
    latency = {"stage": path.modules}
    if path.wants_force:
        latency["first_pixel_to_force"] = registers["LATENCY_FIRST_PIXEL_TO_FORCE"]
        latency["last_pixel_to_force"] = registers["LATENCY_LAST_PIXEL_TO_FORCE"]
    images = {output.name: output.rows * output.beats for output in top.outputs}
    if path.wants_depth:
        depth_at = outputs["depth_at"]
        latency["first_pixel_to_first_depth"] = int(depth_at[0]) - first
        latency["first_pixel_to_depth"] = int(depth_at[images["depth"] - 1]) - first
    if path.wants_normals:
        normals_at = outputs["normals_at"]
        latency["first_pixel_to_first_normal"] = int(normals_at[0]) - first
        latency["first_pixel_to_normals"] = int(normals_at[images["normals"] - 1]) - first
    for name, stated in path.first_pixel_to_packet.items():
        ends = outputs[f"{name}_at"][outputs[f"{name}_last"] == 1] - outputs["first_at"]
        latency[f"first_pixel_to_{name}_packet"] = int(ends[0])
        counted = sorted(set(ends.tolist()))
        if not stalled and counted != [stated]:
            raise SimulationFailure(
                f"first_pixel_to_{name}_packet: {counted} cycles counted, {stated} by formula"
            )
    if not stalled:
        ends = {"first_pixel_to_force": path.wants_force, "first_pixel_to_depth": path.wants_depth}
        ends["first_pixel_to_normals"] = path.wants_normals
        for name in (name for name, wanted in ends.items() if wanted):
            if latency[name] != getattr(path, name):
                raise SimulationFailure(
                    f"{name}: {latency[name]} cycles counted, {getattr(path, name)} by the stages' formulas"
                )
    if len(outputs["first_at"]) > 1:
        latency["initiation_interval"] = counted = int(np.diff(outputs["first_at"]).max())
        if top.packets and not stalled and counted != path.interval:
            raise SimulationFailure(
                f"initiation_interval: {counted} cycles counted, {path.interval} by formula"
            )
    return latency
