# amaranth: UnusedElaboratable=no
"""Comparison of simulated packets with the golden model: images, padding, records, markers."""

import numpy as np

from fastac.gateware.bus.record import FIFO_RECORDS, FORMAT_LOW, PLAIN, RecordFlag, RecordForm
from fastac.gateware.bus.register_map import AXES, ERRORS
from fastac.gateware.frame_cycles import RESULTS, RESULTS_WORD_BYTES
from fastac.gateware.raster_outputs import RasterOutput
from fastac.gateware.top_zynq import TopZynq
from fastac.models.result import Result


def packet_bytes(top: TopZynq) -> dict[str, int]:
    """{name of a stream: bytes of one of its packets}."""
    sizes = {output.name: output.packet.packet_bytes for output in top.outputs}
    return sizes or {RESULTS: top.packets.form.bytes}


def beat_bytes(top: TopZynq) -> dict[str, int]:
    """{name of a stream: bytes per beat}."""
    return {output.name: output.octets for output in top.outputs} or {RESULTS: RESULTS_WORD_BYTES}


def image_of(words: np.ndarray, output: RasterOutput) -> tuple[np.ndarray, np.ndarray]:
    """(The image's values (packets, rows, columns, words), the same packets' words with these set to 0.)

    words : 32-bit words of whole packets, flat
    """
    packets = words.reshape(-1, output.packet.packet_bytes // 4)
    whole = packets[:, : output.packet.image_bytes // 4]
    pixels = whole.reshape(len(packets), output.rows, -1, output.packet.words_padded)
    values = pixels[:, :, : output.columns, : output.words]
    padding = pixels.copy()
    padding[:, :, : output.columns, : output.words] = 0
    return values, padding


def records_of(
    words: np.ndarray, packet_words: int, image_words: int = 0, form: RecordForm = PLAIN
) -> tuple[np.ndarray, np.ndarray]:
    """(The packets' records, of `form.layout`; the words behind them.)"""
    count = len(form.words)
    trailers = np.ascontiguousarray(words.reshape(-1, packet_words)[:, image_words:], "<i4")
    records = np.ascontiguousarray(trailers[:, :count])
    return records.view(form.layout)[:, 0], trailers[:, count:]


def expected_records(
    top: TopZynq, result: Result, seen: dict, found: np.ndarray, *, exact: bool
) -> np.ndarray:
    """The complete records of frames that entered whole, in the order of `result`.

    seen : clocks that the testbench counted: `first_at`, `last_at` (first and last beat accepted),
        `interrupt_at` (rising edges), and `origin`, the clocks since reset at its clock 0
    found : the records found. From them comes what no port shows: ERRORS, and the time of a result whose
        interrupt did not rise because the one before was still pending.
    exact : nothing stalled, so that all results come as the formulas say
    """
    path, frames, form = top.datapath, len(result.validity), top.packets.form
    records = np.zeros(frames, form.layout)
    records["frame"] = np.arange(frames) + 1
    records["flags"] = RecordFlag.COMPLETE | form.number << FORMAT_LOW
    records["flags"] |= np.where(result.validity != 0, RecordFlag.SUSPECT, 0).astype(np.uint32)
    records["validity"] = result.validity
    records["errors"] = found["errors"][:frames] if len(found) >= frames else 0
    records["time"] = seen["first_at"] + seen["origin"]
    if exact:
        records["first_to_result"] = path.first_pixel_to_result
    elif len(seen["interrupt_at"]) == frames:
        # The interrupt rises one clock after its result.
        records["first_to_result"] = seen["interrupt_at"] - 1 - seen["first_at"]
    elif len(found) >= frames:
        records["first_to_result"] = found["first_to_result"][:frames]
    records["last_to_result"] = records["first_to_result"] - (seen["last_at"] - seen["first_at"])
    for k, axis in enumerate(top.bundle.scene.force_axes):
        records[f"force_{AXES[axis]}"] = result.force_raw[:, k]
        if top.identity.half_width:
            records[f"half_width_{AXES[axis]}"] = result.force_half_width_raw[:, k]
    if top.identity.slip:
        records["slip_spread"], records["slip_dots"] = result.slip_words, result.slip_dots
        records["flags"] |= np.where(result.slipping, RecordFlag.SLIP, 0).astype(np.uint32)
    return records


def incomplete(records: np.ndarray) -> np.ndarray:
    """The same frames' records where the result is not waited for."""
    found = np.zeros(len(records), records.dtype)
    for name in ("frame", "time"):
        found[name] = records[name]
    found["flags"] = records["flags"] & 0xFF << FORMAT_LOW
    return found


def least_errors(top: TopZynq, result: Result) -> np.ndarray:
    """Bits of ERRORS that must be set in each record: what the frames up to its own have reported."""
    flags = {"frame_suspect": result.validity}
    if top.datapath.scene.wants_slopes:
        flags["gradient_saturated"] = result.gradient_saturated
    if top.datapath.wants_displacement:
        flags["displacement_saturated"] = result.displacement_saturated
    bits = sum(
        (np.asarray(value) > 0).astype(np.int64) << ERRORS.index(name) for name, value in flags.items()
    )
    return np.bitwise_or.accumulate(bits)


class PacketCheck:
    """Compare everything that the streams of packets sent.

    values, markers : see `sim.check_top.Comparison`: of the images and forces, and of all else
    outputs : the testbench's arrays, with `NAME_words`, `NAME_last`, `NAME_keep`, `NAME_at`
    errors : the register ERRORS at the end
    """

    def __init__(self, top: TopZynq, values, markers, outputs: dict, errors: int):
        self.top, self.values, self.markers, self.outputs, self.errors = top, values, markers, outputs, errors

    def images(self, expected: dict[str, np.ndarray]) -> dict[str, int]:
        """Compare the images with {output: words (frames, rows, columns, …)}; returns how many values each
        has."""
        counts = {}
        for output in self.top.outputs:
            found, padding = image_of(self._whole(output.name), output)
            self.values.add(output.name, found, expected[output.name])
            self.markers.add(f"{output.name}.padding", padding, np.zeros_like(padding))
            counts[output.name] = int(expected[output.name].size)
        return counts

    def records(self, result: Result, in_fifo: np.ndarray, *, exact: bool) -> int:
        """Compare all records, those of the FIFO behind the registers too; returns how many forces."""
        top = self.top
        outputs = {output.name: output for output in top.outputs}
        for name, size in packet_bytes(top).items():
            output = outputs.get(name)
            before = output.packet.image_bytes // 4 if output else 0
            found, behind = records_of(self._whole(name), size // 4, before, top.packets.form)
            wanted = expected_records(top, result, self.outputs, found, exact=exact)
            self.markers.add(f"{name}.behind the record", behind, np.zeros_like(behind))
            if output is None or output.complete:
                self._errors(name, found, least_errors(top, result))
            else:
                wanted = incomplete(wanted)
            self._fields(name, found, wanted)
        wanted = expected_records(top, result, self.outputs, in_fifo, exact=exact)
        wanted = wanted[:FIFO_RECORDS]
        wanted["errors"] = in_fifo["errors"][: len(wanted)] if len(in_fifo) >= len(wanted) else 0
        self._fields("RESULTS_WORD", in_fifo, wanted)
        return int(result.force_raw.size) if top.datapath.wants_force else 0

    def framing(self, frames: int) -> None:
        """`tlast` ends each packet and nothing else, and `tkeep` is all ones."""
        for name, octets in beat_bytes(self.top).items():
            last = np.zeros((frames, packet_bytes(self.top)[name] // octets), np.int8)
            last[:, -1] = 1
            self.markers.add(f"{name}.tlast", self.outputs[f"{name}_last"], last)
            keep = np.full(last.size, (1 << octets) - 1, np.uint64)
            self.markers.add(f"{name}.tkeep", self.outputs[f"{name}_keep"], keep)

    def _whole(self, name: str) -> np.ndarray:
        """The words of whole packets."""
        words, size = self.outputs[f"{name}_words"], packet_bytes(self.top)[name] // 4
        return words[: len(words) // size * size]

    def _fields(self, name: str, found: np.ndarray, wanted: np.ndarray) -> None:
        for field in found.dtype.names:
            comparison = self.values if field.startswith(("force", "half_width")) else self.markers
            comparison.add(f"{name}.{field}", found[field], wanted[field])

    def _errors(self, name: str, found: np.ndarray, least: np.ndarray) -> None:
        """Each record has the errors of its own and earlier frames, and none that never was."""
        errors = found["errors"][: len(least)].astype(np.int64)
        self.markers.add(f"{name}.errors", errors & least[: len(errors)], least)
        self.markers.add(f"{name}.errors", errors & ~self.errors, np.zeros_like(errors))
