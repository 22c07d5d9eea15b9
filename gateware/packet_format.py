"""Layout of the frames and packets in memory with hardware.streams "packets": bytes, beats, trailers.

Plain Python. Pixels are padded to a power of two, so that a beat has a width that DMAs take.
"""

from dataclasses import dataclass

from fastac.gateware.bus.record import RECORD_BYTES

WORD_BYTES = 4
"""Bytes of one value in an output stream."""
BEAT_BYTES_LIMIT = 128
"""The widest beat of an AXI DMA: 1024 bits (PG021, stream data width)."""


def power_of_two(count: int) -> int:
    """The least power of two that is not less than `count`, which is 1 or more."""
    return 1 << (count - 1).bit_length()


def _check(what: str, lanes: int, bytes_per_beat: int) -> None:
    if lanes < 1 or lanes & (lanes - 1):
        raise ValueError(f"{what}: lanes {lanes}: expected a power of two")
    if bytes_per_beat > BEAT_BYTES_LIMIT:
        raise ValueError(
            f"{what}: lanes {lanes}: {8 * bytes_per_beat} bits a beat, more than {8 * BEAT_BYTES_LIMIT}"
        )


@dataclass(frozen=True)
class FrameFormat:
    """A camera frame in memory and on `s_axis`: `height` × `width` pixels of `channels` bytes, then padding.

    Raises ValueError for lanes that are no power of two or do not divide the width, and for beats of more
    than 1024 bits.
    """

    height: int
    width: int
    channels: int
    lanes: int

    def __post_init__(self):
        _check("s_axis", self.lanes, self.bytes_per_beat)
        if self.width % self.lanes:
            raise ValueError(f"s_axis: lanes {self.lanes}: does not divide the width {self.width}")

    @property
    def bytes_per_pixel(self) -> int:
        """Bytes of a padded pixel; those beyond the channels are ignored."""
        return power_of_two(self.channels)

    @property
    def bytes_per_beat(self) -> int:
        return self.bytes_per_pixel * self.lanes

    @property
    def beats(self) -> int:
        """Beats per frame."""
        return self.height * self.width // self.lanes

    @property
    def bytes(self) -> int:
        """Bytes of one frame."""
        return self.height * self.width * self.bytes_per_pixel


@dataclass(frozen=True)
class PacketFormat:
    """An output packet in memory and on its stream: an image, row by row, and a record as its trailer.

    name : of the output, for messages
    rows, columns, words : the image: pixels of `words` 32-bit values, padded by zeros to a power of two
    lanes : pixels per beat; a row's last beat is filled with zeros
    record_bytes : of the record

    Raises ValueError for lanes that are no power of two and for beats of more than 1024 bits.
    """

    name: str
    rows: int
    columns: int
    words: int
    lanes: int
    record_bytes: int = RECORD_BYTES

    def __post_init__(self):
        _check(f"m_axis_{self.name}", self.lanes, self.bytes_per_beat)

    @property
    def words_padded(self) -> int:
        """32-bit words of a pixel."""
        return power_of_two(self.words)

    @property
    def bytes_per_beat(self) -> int:
        return WORD_BYTES * self.words_padded * self.lanes

    @property
    def beats_per_row(self) -> int:
        return -(-self.columns // self.lanes)

    @property
    def row_bytes(self) -> int:
        return self.beats_per_row * self.bytes_per_beat

    @property
    def image_bytes(self) -> int:
        """Bytes of the image, which are the trailer's offset too."""
        return self.rows * self.row_bytes

    @property
    def trailer_beats(self) -> int:
        """Beats of the trailer; a beat of more bytes than the record has zeros behind it."""
        return -(-self.record_bytes // self.bytes_per_beat)

    @property
    def beats(self) -> int:
        """Beats of the packet."""
        return self.rows * self.beats_per_row + self.trailer_beats

    @property
    def packet_bytes(self) -> int:
        """Bytes of image and trailer."""
        return self.beats * self.bytes_per_beat
