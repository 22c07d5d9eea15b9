import pytest

from fastac.gateware.packet_format import FrameFormat, PacketFormat


def test_frame_in_memory():
    """(H, W, 4) bytes for three channels."""
    frame = FrameFormat(height=6, width=8, channels=3, lanes=4)
    assert (frame.bytes_per_pixel, frame.bytes_per_beat, frame.beats, frame.bytes) == (4, 16, 12, 192)


@pytest.mark.parametrize(
    ("words", "lanes", "padded", "beat", "row", "trailer"),
    [
        (1, 1, 1, 4, 14 * 4, 16),  # depth, a word a beat: the record takes 16 beats
        (1, 4, 1, 16, 4 * 16, 4),  # 14 columns are 4 beats, of which the last is half empty
        (3, 2, 4, 32, 7 * 32, 2),
        (3, 4, 4, 64, 4 * 64, 1),
        (3, 8, 4, 128, 2 * 128, 1),  # the record fills half of a beat
    ],
)
def test_packets(words, lanes, padded, beat, row, trailer):
    packet = PacketFormat("depth", rows=10, columns=14, words=words, lanes=lanes)
    found = (packet.words_padded, packet.bytes_per_beat, packet.row_bytes, packet.trailer_beats)
    assert found == (padded, beat, row, trailer)
    assert packet.image_bytes == 10 * row
    assert packet.packet_bytes == packet.beats * beat == 10 * row + trailer * beat


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FrameFormat(6, 9, 3, 3), "s_axis: lanes 3: expected a power of two"),
        (lambda: FrameFormat(6, 6, 3, 4), "s_axis: lanes 4: does not divide the width 6"),
        (lambda: FrameFormat(64, 64, 4, 64), "s_axis: lanes 64: 2048 bits a beat, more than 1024"),
        (
            lambda: PacketFormat("normals", 8, 8, 3, 16),
            "m_axis_normals: lanes 16: 2048 bits a beat, more than 1024",
        ),
    ],
)
def test_what_no_dma_takes(make, message):
    with pytest.raises(ValueError, match=f"^{message}$"):
        make()
