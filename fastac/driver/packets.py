"""What a frame gave: records and images out of packets, as arrays with units."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fastac.driver.description import Description
from fastac.gateware.bus.record import FORMAT_LOW, PLAIN, RecordFlag, RecordForm

BAD, SUSPECT, SLIP = (int(flag) for flag in (RecordFlag.BAD, RecordFlag.SUSPECT, RecordFlag.SLIP))
SPREAD_UNIT_PX = 1 / 64
"""The spread of the dots is a mean square in px² / 4096: its root is in px / 64."""


class PacketError(ValueError):
    """A packet that is not the hardware's; the message is one line."""


def record_of(octets: np.ndarray, at: int, form: RecordForm = PLAIN) -> np.ndarray:
    """The record at byte `at` of a packet (bytes,) uint8, as an array of `form.layout` of shape ().

    Raises PacketError where it has another format.
    """
    record = octets[at : at + form.bytes].view(form.layout)[0]
    if int(record["flags"]) >> FORMAT_LOW & 0xFF != form.number:
        raise PacketError(f"record: FLAGS = {int(record['flags']):#010x}: expected format {form.number}")
    return record


@dataclass(frozen=True, eq=False)
class Found:
    """What the hardware found in a frame, or, where arrays are said to be (n, …), in n frames.

    records : the record of each frame, of type `description.record.layout`
    packets : of each image output the packet, (bytes,) or (n, bytes) uint8
    lost : the frame went in and no result came out: nothing else is known of it
    sent_s, received_s : when the host sent the frame and had its result, s by the transport's time

    Images are converted when they are asked for. What the hardware does not find is None.
    """

    description: Description
    records: np.ndarray
    packets: dict[str, np.ndarray]
    lost: np.ndarray
    sent_s: np.ndarray
    received_s: np.ndarray
    _words: dict[str, np.ndarray] = field(default_factory=dict, repr=False)

    @property
    def frame(self):
        """Number of the frame, from 1 since the hardware's reset."""
        return self.records["frame"]

    @property
    def time_s(self):
        """When the hardware accepted the frame's first beat, s since its reset, by its clock."""
        return self.records["time"] * (1e-6 / self.description.clock_mhz)

    def _flag(self, flag: int):
        return (self.records["flags"] & flag) != 0

    @property
    def bad(self):
        """The frame's input was faulty and was repaired."""
        return self._flag(BAD)

    @property
    def suspect(self):
        """The frame is not like those of training; see `reasons`."""
        return self._flag(SUSPECT)

    @property
    def slipping(self):
        """The spread of the dots in contact was beyond SLIP_LIMIT."""
        return self._flag(SLIP)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why a frame is suspect; of several frames, all that any of them has."""
        return self._names(self.records["validity"], self.description.validity)

    @property
    def errors(self) -> tuple[str, ...]:
        """What stood in the register ERRORS when the result came; of several frames, any of these."""
        return self._names(self.records["errors"], self.description.errors)

    def _names(self, words, names: Sequence[str]) -> tuple[str, ...]:
        bits = int(np.bitwise_or.reduce(words, axis=None)) if np.ndim(words) else int(words)
        return tuple(name for bit, name in enumerate(names) if bits >> bit & 1)

    @property
    def force_axes(self) -> tuple[str, ...]:
        """The axes of `force_n`."""
        return self.description.force.axes if self.description.force else ()

    @property
    def force_raw(self) -> np.ndarray | None:
        """(axes,) or (n, axes) int64: the accumulators."""
        if self.description.force is None:
            return None
        return np.array([self.records[f"force_{axis}"] for axis in self.force_axes]).T

    @property
    def force_n(self) -> np.ndarray | None:
        """(axes,) or (n, axes), N; z is positive in compression."""
        raw = self.force_raw
        return None if raw is None else raw * self.description.force.scales

    @property
    def force_half_width_raw(self) -> np.ndarray | None:
        """(axes,) or (n, axes) int64: half the width of the interval around each accumulator."""
        if self.description.interval is None:
            return None
        return np.array([self.records[f"half_width_{axis}"] for axis in self.force_axes]).T.astype(np.int64)

    @property
    def force_half_width_n(self) -> np.ndarray | None:
        """(axes,) or (n, axes), N: the interval around each force is force_n ± this."""
        raw = self.force_half_width_raw
        return None if raw is None else raw * self.description.force.scales

    @property
    def slip_px(self):
        """Root mean square spread of the dots in contact about the rigid motion that fits them, px."""
        if self.description.slip is None:
            return None
        return np.sqrt(self.records["slip_spread"] * SPREAD_UNIT_PX**2)

    @property
    def slip_dots(self):
        """Number of dots in contact."""
        return None if self.description.slip is None else self.records["slip_dots"]

    @property
    def first_pixel_to_result_s(self):
        """By the hardware's clock."""
        return self.records["first_to_result"] * (1e-6 / self.description.clock_mhz)

    @property
    def last_pixel_to_result_s(self):
        """By the hardware's clock."""
        return self.records["last_to_result"] * (1e-6 / self.description.clock_mhz)

    @property
    def host_latency_s(self):
        """From the host's sending the frame to its having the result."""
        return self.received_s - self.sent_s

    def words(self, output: str) -> np.ndarray:
        """The integers of an image, (rows, columns, words) or (n, rows, columns, words) int32, first row
        first."""
        if output not in self._words:
            facts = next((o for o in self.description.outputs if o.name == output), None)
            if facts is None:
                names = ", ".join(o.name for o in self.description.outputs) or "none"
                raise ValueError(f"output {output!r}: this hardware has no such image; there are {names}")
            form, packet = facts.format, self.packets[output]
            lead = packet.shape[:-1]
            image = packet[..., : form.image_bytes].reshape(*lead, form.rows, form.row_bytes).view("<i4")
            image = image.reshape(*lead, form.rows, -1, form.words_padded)
            image = image[..., : form.columns, : form.words]
            self._words[output] = image[..., ::-1, :, :] if facts.rows_reversed else image
        return self._words[output]

    def _has(self, output: str) -> bool:
        return output in self.packets

    @property
    def depth_mm(self) -> np.ndarray | None:
        """(N, N) or (n, N, N) float32: height z of the skin, N = H - 2: without the image's rim; mm."""
        if not self._has("depth"):
            return None
        scale = next(o.per_lsb for o in self.description.outputs if o.name == "depth")
        return (self.words("depth")[..., 0] * scale).astype(np.float32)

    @property
    def force_map_n(self) -> np.ndarray | None:
        """(axes, N, N) or (n, axes, N, N) float32: each inner pixel's share of the force, N."""
        if not self._has("force_map"):
            return None
        words, scales = self.words("force_map"), self.description.force.scales
        return np.stack([(words[..., k] * scale).astype(np.float32) for k, scale in enumerate(scales)], -3)

    @property
    def normals(self) -> np.ndarray | None:
        """(H, W, 3) or (n, H, W, 3) float32, outward unit vectors."""
        if not self._has("normals"):
            return None
        words = self.words("normals")
        components = [words[..., k] for k in range(3)]
        squares = [np.square(component, dtype=np.float64) for component in components]
        length = np.maximum(np.sqrt(squares[0] + squares[1] + squares[2]), 1)
        found = np.empty(words.shape, np.float32)
        for k, component in enumerate(components):  # a sixth of the time of one division of all three
            found[..., k] = component / length
        return found

    def __getitem__(self, k: int) -> "Found":
        """One of several frames."""
        return Found(
            self.description,
            self.records[k],
            {name: packet[k] for name, packet in self.packets.items()},
            *(part[k] for part in (self.lost, self.sent_s, self.received_s)),
        )

    def __len__(self) -> int:
        return len(self.records)


def join(found: Sequence[Found]) -> Found:
    """Frames one after another as one `Found` of n frames."""
    first = found[0]
    return Found(
        first.description,
        np.stack([one.records for one in found]),
        {name: np.stack([one.packets[name] for one in found]) for name in first.packets},
        np.array([one.lost for one in found]),
        np.array([one.sent_s for one in found]),
        np.array([one.received_s for one in found]),
    )


def nothing(description: Description, frame: int, sent_s: float) -> Found:
    """What is known of a frame that was lost: its number, and when it was sent."""
    record = np.zeros((), description.record.layout)
    record["frame"], record["flags"] = frame, description.record.number << FORMAT_LOW
    packets = {o.name: np.zeros(o.format.packet_bytes, np.uint8) for o in description.outputs}
    return Found(description, record[()], packets, np.True_, np.float64(sent_s), np.float64(math.nan))
