"""Each rule of the model of AXI VDMA, with a stream that breaks it."""

import pytest
from cocotbext.axi.memory import Memory

from fastac.sim.dma.axi_dma import DmaMisuse
from fastac.sim.dma.axi_vdma import EOL_EARLY, EOL_LATE, HSIZE, SOF_EARLY, SOF_LATE, STATUS, VSIZE, AxiVdma

LINES, BEATS = 3, 4
SIZE = 1 << 16


@pytest.fixture
def vdma() -> AxiVdma:
    vdma = AxiVdma(Memory(SIZE), bits=32, user_bits=1)
    vdma.write(HSIZE, 4 * BEATS)
    vdma.write(VSIZE, LINES)
    return vdma


def send(vdma: AxiVdma, lines: list[int], *, value: int = 1) -> None:
    """A frame with lines of so many beats."""
    for line, beats in enumerate(lines):
        for k in range(beats):
            octets = bytes([value, line, k, 0])
            vdma.beat(octets, last=k == beats - 1, start=line == 0 and k == 0)


def test_frames_lie_one_behind_the_other(vdma):
    vdma.beat(bytes(4), last=True, start=False)  # before the first start of frame
    send(vdma, [BEATS] * LINES)
    send(vdma, [BEATS] * LINES, value=2)
    assert (vdma.read(STATUS), vdma.frames) == (0, 2)
    found = bytes(vdma.memory.read(0, 2 * 4 * BEATS * LINES))
    wanted = [bytes([v, line, k, 0]) for v in (1, 2) for line in range(LINES) for k in range(BEATS)]
    assert found == b"".join(wanted)


@pytest.mark.parametrize(
    ("lines", "error"),
    [
        ([BEATS, BEATS - 1, BEATS], EOL_EARLY),
        ([BEATS, BEATS + 2, BEATS], EOL_LATE),
        ([BEATS, BEATS], SOF_EARLY),
        ([BEATS] * (LINES + 1), SOF_LATE),
    ],
)
def test_frames_of_another_size_are_errors(vdma, lines, error):
    """Rule 2; the frame after it is taken."""
    send(vdma, lines)
    send(vdma, [BEATS] * LINES)
    assert vdma.read(STATUS) == error
    vdma.write(STATUS, error)
    send(vdma, [BEATS] * LINES)
    assert vdma.read(STATUS) == 0


def test_a_long_line_is_cut_and_a_short_one_not_filled(vdma):
    """Rule 4."""
    send(vdma, [BEATS + 2, BEATS - 1, BEATS])
    assert vdma.read(STATUS) == EOL_EARLY | EOL_LATE
    found = bytes(vdma.memory.read(0, 4 * BEATS * LINES))
    assert found[16:32] == bytes([1, 1, 0, 0, 1, 1, 1, 0, 1, 1, 2, 0, 0, 0, 0, 0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"bits": 32, "user_bits": 11}, "tuser of 11 bits"),
        ({"bits": 96, "user_bits": 1}, "tdata of 96 bits"),
    ],
)
def test_streams_that_it_cannot_take_are_refused(arguments, message):
    """Rule 1: depth has eleven bits of tuser; normals are no power of two wide."""
    with pytest.raises(DmaMisuse, match=message):
        AxiVdma(Memory(SIZE), **arguments)
