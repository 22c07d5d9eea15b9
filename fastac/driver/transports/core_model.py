"""The core as a host sees it: registers, frames in memory in, packets out, with the emulator's integers.

It has no clock: a frame is computed when it is given, and its latencies are those of the stages' formulas.
TIME counts the scene's clock by the host's.
"""

import time
from collections import deque
from collections.abc import Sequence

import numpy as np

from fastac.driver.description import Description, OutputFacts
from fastac.driver.registers import WORD_MASK
from fastac.driver.transports.transport import TransportError
from fastac.gateware.bus.record import FIFO_RECORDS, FORMAT_LOW, RecordFlag
from fastac.gateware.bus.register_map import ID
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.light_level import followed
from fastac.scenes.outputs import OUTPUTS

CHANGES_FRAMES = 0b10111
"""Bits of CONTROL: enable, capture_background, soft_reset, restart_calibration."""
SATURATED = ("gradient_saturated", "displacement_saturated")


class CoreModel:
    """A core made from `bundle`, whose hardware.json is `description`.

    calibrations : the bundles whose calibration images it takes; it cannot compute from an image alone
    """

    def __init__(self, bundle: Bundle, description: Description, calibrations: Sequence[Bundle] = ()):
        self.hardware, self.calibrations, self.description = bundle, calibrations, description
        self.form = description.record
        self._use(bundle, bundle.pipeline.background)
        # The emulator loads its compiled loops when first run: now, not while the first frame waits.
        self.emulator.run(bundle.pipeline.background[None], wanted=self.wanted)
        self._start_s = time.monotonic()
        self._facts = {register.offset: register for register in description.registers}
        self._offset = {register.name: register.offset for register in description.registers}
        self.values = {r.name: r.reset or 0 for r in description.registers}
        self.values |= {"ID": ID, "VERSION": description.version}
        frame = description.frame
        self.values["GEOMETRY"] = frame.height_px | frame.width_px << 16
        self.enable, self.interrupt_enable, self.capture = True, False, False
        self.errors = self.frames = self.lost = 0
        self.pending = self.result_valid = False
        self.in_flight = 0
        self.fifo: deque[int] = deque()
        self.image: list[int] = []
        self.last = np.zeros((), self.form.layout)[()]
        self.shift: np.ndarray | None = None
        self._latched: dict[str, int] = {}
        self._given = np.empty((0, 0), np.uint8)

    def _use(self, bundle: Bundle, background: np.ndarray) -> None:
        self.bundle = bundle
        self.emulator = Emulator(bundle.pipeline.replace(background=background))
        scene, known = bundle.scene, self.emulator.outputs
        words = dict.fromkeys(OUTPUTS[name].words for name in scene.outputs)
        extra = [n for n in (*SATURATED, "slip_dots", "force_half_width_raw") if n in known]
        self.wanted = tuple(name for name in ("validity", *words, *extra) if name in known)

    def time(self) -> int:
        """Clocks since the model was made, by the host's time."""
        return int((time.monotonic() - self._start_s) * self.description.clock_mhz * 1e6)

    # Frames

    def accept(self, frames: Sequence[np.ndarray]) -> dict[str, list[np.ndarray]]:
        """Compute frames, each uint8 as in memory; the packets of each stream, in order."""
        packets: dict[str, list[np.ndarray]] = {name: [] for name in self.description.streams_out}
        if not self.enable or self._loading:
            return packets
        form, count = self.description.frame, len(frames)
        if count > len(self._given):  # kept, because fresh memory costs more than the copy
            self._given = np.empty((count, form.format.bytes), np.uint8)
        pixels = np.stack(frames, out=self._given[:count])
        pixels = pixels.reshape(count, form.height_px, form.width_px, -1)
        pixels = pixels[..., : len(form.channels)]
        captured = self.capture
        if captured:  # a captured frame has no difference from itself
            self.capture = False
            self._use(self.bundle, pixels[0].copy())
        if self.bundle.scene.sensor.level_light:  # it is not shifted either, and no shift follows from it
            background = self.emulator.pipeline.background
            pixels[captured:], self.shift = followed(pixels[captured:], background, self.shift)
        found = self.emulator.run(np.ascontiguousarray(pixels), wanted=self.wanted)
        records = self._records(found, len(frames))
        for output in self.description.outputs:
            words = getattr(found, OUTPUTS[output.name].words)
            packets[output.name].extend(_packets(output, words, self._trailers(output, records)))
        if "results" in packets:
            packets["results"].extend(records.view(np.uint8).reshape(-1, self.form.bytes))
        return packets

    def _records(self, found, count: int) -> np.ndarray:
        """The records of frames, with everything that they change in the registers."""
        records, description = np.zeros(count, self.form.layout), self.description
        flags = np.full(count, self.form.number << FORMAT_LOW | RecordFlag.COMPLETE)
        validity = found.validity
        records["frame"] = self.frames + 1 + np.arange(count)
        self.frames += count
        records["validity"] = validity
        flags |= np.where(validity != 0, RecordFlag.SUSPECT, 0)
        errors = np.where(validity != 0, self._error("frame_suspect"), 0)
        for name in SATURATED:
            if getattr(found, name) is not None:
                errors |= np.where(getattr(found, name) > 0, self._error(name), 0)
        if description.slip:
            records["slip_spread"] = found.slip_words
            records["slip_dots"] = found.slip_dots
            flags |= np.where(found.slip_words > self.values["SLIP_LIMIT"], RecordFlag.SLIP, 0)
        for k, axis in enumerate(description.force.axes if description.force else ()):
            records[f"force_{axis}"] = found.force_raw[:, k]
            if description.interval:
                records[f"half_width_{axis}"] = found.force_half_width_raw[:, k]
        if self.pending:
            errors[0] |= self._error("result_overrun")
        self.pending = self.result_valid = True
        records["errors"] = np.bitwise_or.accumulate(errors | self.errors)
        records["flags"] = flags
        beats = description.frame_beats
        records["time"] = self.time()
        records["first_to_result"] = description.result_cycles
        records["last_to_result"] = max(description.result_cycles - (beats - 1), 0)
        self.errors = int(records["errors"][-1])
        self.last = records[-1]
        if description.has_packets:
            self._keep(records)
        return records

    def _keep(self, records: np.ndarray) -> None:
        """Into the result FIFO, which drops what it has no place for."""
        for record in records:
            if self._waiting == FIFO_RECORDS:
                self.lost += 1
                self.errors |= self._error("results_lost")
            else:
                self.fifo.extend(np.frombuffer(record.tobytes(), "<u4").tolist())

    def _trailers(self, output: OutputFacts, records: np.ndarray) -> np.ndarray:
        """The records as this output's packets carry them."""
        if self.description.completes(output):
            return records
        part = np.zeros(len(records), self.form.layout)
        for name in ("frame", "time"):
            part[name] = records[name]
        part["flags"] = records["flags"] & (RecordFlag.BAD | 0xFF << FORMAT_LOW)
        return part

    def _error(self, name: str) -> int:
        """The bit of an error, 0 where this hardware does not report it."""
        errors = self.description.errors
        return 1 << errors.index(name) if name in errors else 0

    # Registers

    @property
    def _waiting(self) -> int:
        return -(-len(self.fifo) // len(self.form.words))

    @property
    def _loading(self) -> bool:
        return bool(self.image)

    def take_interrupt(self) -> bool:
        """Whether the interrupt is high; it is cleared."""
        high = self.pending and self.interrupt_enable
        if high:
            self.pending = False
        return high

    def read(self, offset: int) -> int:
        facts = self._facts.get(offset)
        if facts is None:
            self.errors |= self._error("access_refused")
            return 0
        name = facts.name
        if name.endswith("_LOW") and not name.startswith("BUNDLE"):
            value = self._long(name.removesuffix("_LOW"))
            self._latched[name.replace("_LOW", "_HIGH")] = value >> 32 & WORD_MASK
            return value & WORD_MASK
        if name.startswith(("FORCE_", "TIME_", "HALF_WIDTH_")) and name.endswith("_HIGH"):
            return self._latched.get(name, 0)
        if name == "RESULTS_WORD":
            return self.fifo.popleft() if self.fifo else 0
        return self._value(name) & WORD_MASK

    def _long(self, name: str) -> int:
        return self.time() if name == "TIME" else int(self.last[name.lower()])

    def _value(self, name: str) -> int:
        last = self.last
        bundle_hash = 0 if self._loading else self.bundle.hash_word
        flags = int(last["flags"])
        given = {
            "BUNDLE_HASH_LOW": bundle_hash,
            "BUNDLE_HASH_HIGH": bundle_hash >> 32,
            "CONTROL": self.enable | self.capture << 1 | self.interrupt_enable << 3,
            "STATUS": bool(self.in_flight)
            | self.in_flight << 8
            | self.result_valid << 1
            | self._loading << 3
            | bool(last["validity"]) << 4
            | bool(flags & RecordFlag.SLIP) << 5,
            "ERRORS": self.errors,
            "INTERRUPT_STATUS": self.pending,
            "FRAME_COUNT": self.frames,
            "FORCE_SEQUENCE": last["frame"],
            "HALF_WIDTH_SEQUENCE": last["frame"],
            "LATENCY_FIRST_PIXEL_TO_FORCE": last["first_to_result"],
            "LATENCY_LAST_PIXEL_TO_FORCE": last["last_to_result"],
            "FRAME_VALIDITY": last["validity"],
            "CALIBRATION": 0,
            "CALIBRATION_RECEIVED": len(self.image),
            "SLIP_SPREAD": last["slip_spread"],
            "SLIP_DOTS": last["slip_dots"],
            "RESULTS_WAITING": self._waiting,
            "RESULTS_LOST": self.lost,
        }
        return int(given.get(name, self.values[name]))

    def concerns_frames(self, offset: int, value: int) -> bool:
        """Whether a write changes what becomes of frames that were sent before it."""
        name = self._facts[offset].name if offset in self._facts else ""
        if name == "CONTROL":
            return bool((value ^ self._value(name)) & CHANGES_FRAMES)
        return name in ("CALIBRATION", "SLIP_LIMIT")

    def write(self, offset: int, value: int) -> None:
        facts = self._facts.get(offset)
        if facts is None or facts.access == "ro":
            self.errors |= self._error("access_refused")
        elif facts.name == "CONTROL":
            self.enable, self.interrupt_enable = bool(value & 1), bool(value >> 3 & 1)
            self.capture |= bool(value >> 1 & 1)
            if value >> 2 & 1:
                self.result_valid, self.shift = False, None
            if value >> 4 & 1:
                self.image.clear()
            if value >> 5 & 1:
                self.fifo.clear()
        elif facts.name == "ERRORS":
            self.errors &= ~value
        elif facts.name == "INTERRUPT_STATUS":
            self.pending &= not value & 1
        elif facts.name == "CALIBRATION":
            self._load(value)
        else:
            self.values[facts.name] = value

    def _load(self, word: int) -> None:
        """The next word of a calibration image."""
        if not self.image and word != self.values["CALIBRATION_LAYOUT"]:
            self.errors |= self._error("calibration_refused")
            return
        self.image.append(word)
        if len(self.image) < self.values["CALIBRATION_WORDS"]:
            return
        from fastac.gateware.calibration import calibration_words

        image, self.image = np.array(self.image, np.uint32), []
        hash_word = int(image[-1]) << 32 | int(image[-2])
        for bundle in (self.hardware, *self.calibrations):
            if bundle.hash_word == hash_word and np.array_equal(
                calibration_words(bundle, self.hardware), image
            ):
                self._use(bundle, self.emulator.pipeline.background)
                return
        raise TransportError(
            f"calibration of bundle {hash_word:016x}: the emulator was not given that bundle"
        )


def _packets(output: OutputFacts, words: np.ndarray, records: np.ndarray) -> np.ndarray:
    """Packets (n, bytes) of an output's words, (n, rows, columns) or with its words per pixel as the last
    axis or, for the axes of a force map, the second one."""
    form, count = output.format, len(words)
    if words.ndim == 4 and words.shape[1:] == (form.words, form.rows, form.columns):
        words = np.moveaxis(words, 1, -1)
    words = words.reshape(count, form.rows, form.columns, form.words)
    packets = np.zeros((count, form.packet_bytes), np.uint8)
    shape = (count, form.rows, form.beats_per_row * form.lanes, form.words_padded)
    strides = (form.packet_bytes, form.row_bytes, 4 * form.words_padded, 4)
    place = np.ndarray(shape, "<i4", packets.data, 0, strides)[:, :, : form.columns, : form.words]
    place[...] = words[:, ::-1] if output.rows_reversed else words
    record_ends = form.image_bytes + form.record_bytes
    packets[:, form.image_bytes : record_ends] = records.view(np.uint8).reshape(count, -1)
    return packets
