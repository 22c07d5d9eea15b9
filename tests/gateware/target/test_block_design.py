import pytest
from packet_hardware import output, packet_hardware

from fastac.gateware.target.block_design import BlockDesignError, block_design, family_of


def test_one_dma_for_frames_and_the_first_stream_and_one_for_each_further():
    normals, depth = output("normals", 128, 128, 4, 4), output("depth", 126, 126, 1, 4)
    found = block_design(packet_hardware(normals, depth, lanes=4))
    first, second = found.dmas
    assert (first.mm2s.port, first.mm2s.stream_bits, first.mm2s.packet_bytes) == ("s_axis", 128, 65536)
    assert (first.s2mm.port, first.s2mm.stream_bits) == ("m_axis_normals", 512)
    assert second.mm2s is None
    assert second.s2mm.port == "m_axis_depth"
    assert found.addresses == {"fastac_0": 0xA000_0000, "axi_dma_0": 0xA001_0000, "axi_dma_1": 0xA002_0000}
    assert [(i.line, i.instance, i.pin, i.spi) for i in found.interrupts] == [
        (0, "fastac_0", "interrupt", 89),
        (1, "axi_dma_0", "mm2s_introut", 90),
        (2, "axi_dma_0", "s2mm_introut", 91),
        (3, "axi_dma_1", "s2mm_introut", 92),
    ]


def test_records_alone():
    found = block_design(packet_hardware(part="xc7z020clg400-1", side=16))
    (dma,) = found.dmas
    assert (dma.s2mm.port, dma.s2mm.output, dma.s2mm.packet_bytes) == ("m_axis_results", "results", 64)
    assert dma.s2mm.memory_bits == 32
    assert found.addresses == {"fastac_0": 0x43C0_0000, "axi_dma_0": 0x4040_0000}
    assert [i.spi for i in found.interrupts] == [29, 30, 31]


@pytest.mark.parametrize(("side", "bits"), [(16, 14), (63, 14), (64, 15), (128, 17), (256, 19)])
def test_length_register_holds_a_packet(side, bits):
    (dma,) = block_design(packet_hardware(side=side)).dmas
    assert dma.length_bits == bits
    assert side * side * 4 < 1 << bits


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"streams": "video"}, "hardware.streams 'video': AXI DMAs need 'packets'"),
        ({"part": "xc7a35t"}, "part 'xc7a35t': expected one of xczu19eg"),
        ({"frame": {"port": "s_axis", "bytes_per_beat": 256, "bytes": 4}}, "s_axis: 2048 bits: an AXI DMA"),
        (
            {"frame": {"port": "s_axis", "bytes_per_beat": 4, "bytes": 1 << 26}},
            "s_axis: packets of 67108864 bytes: an AXI DMA takes 67108863 at most",
        ),
    ],
)
def test_refused(change, message):
    with pytest.raises(BlockDesignError, match=message):
        block_design(packet_hardware() | change)


def test_families():
    assert family_of("xck26-sfvc784-2LV-c").name == "zynquplus"
    assert family_of("xczu7ev-ffvc1156-2-e").name == "zynquplus"
    assert family_of("xc7z020clg400-1").name == "zynq7000"
