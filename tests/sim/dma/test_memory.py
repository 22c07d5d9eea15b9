# amaranth: UnusedElaboratable=no
"""The top level with packets between models of AXI DMA and a memory: whole frames with their results lie
there."""

import json

import numpy as np
import pytest
from cocotbext.axi.memory import Memory

from fastac.gateware.bus.record import PLAIN
from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.top_zynq import TopZynq
from fastac.models.emulator.pipeline import Emulator
from fastac.models.random_bundle import frames, random_bundle, scene
from fastac.sim.check_packets import image_of, packet_bytes, records_of
from fastac.sim.check_top import bench_settings, expected_words, simulate
from fastac.sim.dma.axi_dma import ADDRESS, DMACR, LENGTH, RUN, S2MM, AxiDma, Beat, DmaMisuse, Timing
from fastac.sim.dma.axi_vdma import HSIZE, STATUS, VSIZE, AxiVdma
from fastac.sim.runner import QUICK, build

NAME = "fastac"
COUNT, FEW, BANK = 210, 20, (10, 5, 15, 20, 25, 120, 255)
WANTED = {
    "outputs": ("depth", "force_z"),
    "solver": "tridiagonal",
    "kernel": "collapsed",
    "streams": "packets",
}
HOST_CLOCKS = 6
"""From an interrupt of a DMA to its next transfer."""
WRITE_CLOCKS = 20
"""S2MM's, where frames come at the full rate: a transfer must end, and the next begin, in what the interval
of 256 clocks has beyond the 212 beats of a packet. With the 39 clocks of `Timing` these small packets would
come late."""
VISIBLE = 64
"""Clocks beyond the core's own latency in which a host must be able to read a result."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """(Top level, golden results of the bank, folder with what the testbench found)."""
    folder = tmp_path_factory.mktemp("dma")
    bundle = random_bundle(folder / "bundle", scene(**WANTED))
    top = TopZynq(bundle)
    source = folder / f"{NAME}.v"
    source.write_text(to_verilog(top, name=NAME))
    images = frames(bundle.pipeline.background, BANK)
    np.save(folder / "frames.npy", images)
    settings = bench_settings(top) | {
        "timeout_cycles": 600 * COUNT,
        "count": COUNT,
        "few": FEW,
        "write_clocks": WRITE_CLOCKS,
        "host_clocks": HOST_CLOCKS,
        "packet_bytes": packet_bytes(top),
    }
    (folder / "settings.json").write_text(json.dumps(settings))
    runner = build(source, NAME, folder / "build", build_args=QUICK)
    runner.test(
        hdl_toplevel=NAME,
        test_module="fastac.sim.benches.dma",
        build_dir=folder / "build",
        extra_env={"BENCH": str(folder)},
    )
    return top, Emulator(bundle.pipeline).run(images), folder


def found(runs, kind: str) -> dict:
    with np.load(runs[2] / f"{kind}.npz") as archive:
        return dict(archive)


def check_memory(runs, seen: dict) -> np.ndarray:
    """Every packet in memory is its frame's, flags and force included; returns the records."""
    top, result, _ = runs
    output, count = top.outputs[0], len(seen["first_at"])
    index = np.arange(count) % len(BANK)
    values, padding = image_of(seen["depth_words"], output)
    assert np.array_equal(values[..., 0], expected_words(top, result)["depth"][index])
    assert not padding.any()
    size = packet_bytes(top)["depth"] // 4
    records, _ = records_of(seen["depth_words"], size, output.packet.image_bytes // 4)
    assert np.array_equal(records["frame"], np.arange(count) + 1)
    assert np.array_equal(records["force_z"], result.force_raw[index, 0])
    assert np.array_equal(records["validity"], result.validity[index])
    assert np.array_equal(np.diff(records["time"]), np.diff(seen["first_at"]))
    return records


@pytest.mark.full
def test_frames_at_the_full_rate_lie_in_memory(runs):
    top, seen = runs[0], found(runs, "camera_0")
    records = check_memory(runs, seen)
    assert len(records) == COUNT
    assert set(np.diff(seen["first_at"])) == {top.datapath.interval}
    assert set(records["first_to_result"]) == {top.datapath.first_pixel_to_force}


@pytest.mark.full
@pytest.mark.parametrize("kind", ["memory_0", "memory_30"])
def test_frames_from_memory_lie_in_memory(runs, kind):
    """A transfer each: its fetch and the host's work come between frames, where nothing is lost."""
    top, seen = runs[0], found(runs, kind)
    check_memory(runs, seen)
    between = np.diff(seen["first_at"])
    least = top.datapath.beats + HOST_CLOCKS + Timing().fetch
    assert between.min() >= least
    if kind == "memory_0":
        assert between.max() <= least + 4


@pytest.mark.full
def test_a_result_is_in_memory_soon_after_the_core_has_it(runs):
    """With the DMA's and the memory's clocks as `Timing` assumes them, the interrupt included."""
    top, seen = runs[0], found(runs, "camera_0")
    path, timing = top.datapath, Timing(write=WRITE_CLOCKS)
    beyond = seen["depth_done_at"] - seen["last_at"] - path.last_pixel_to_force
    trailer = path.first_pixel_to_packet["depth"] - path.first_pixel_to_force
    assert set(beyond) == {trailer + timing.write + timing.response + 1}
    assert beyond.max() + Timing().write - timing.write <= VISIBLE


@pytest.mark.full
def test_a_result_is_in_the_registers_soon_after_the_core_has_it(runs):
    top, result, _ = runs
    seen = found(runs, "registers")
    assert seen["force"].tolist() == result.force_raw[0].tolist()
    record = np.frombuffer(seen["record"].astype("<u4").tobytes(), PLAIN.layout)
    assert (record["frame"], record["force_z"]) == (2, result.force_raw[0, 0])
    assert set(seen["result_at"] - seen["last_at"]) == {top.datapath.last_pixel_to_force + 1}
    beyond = seen["force_at"] - seen["last_at"][0] - top.datapath.last_pixel_to_force
    assert beyond <= VISIBLE
    # A whole record is 16 reads of four clocks each; its first words are there as soon as the force is.
    whole = seen["record_at"] - seen["last_at"][1] - top.datapath.last_pixel_to_force
    assert whole <= 16 * 4 + beyond


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """(Top level in the form of video, what its streams sent for two frames, golden words).

    The same hardware as in tests/sim/test_check_top.py, so that its simulator is compiled once.
    """
    folder = tmp_path_factory.mktemp("video")
    bundle = random_bundle(folder / "bundle", scene(("normals", "depth", "force_z"), channels="bgr+nir"))
    top = TopZynq(bundle)
    source = folder / f"{NAME}.v"
    source.write_text(to_verilog(top, name=NAME))
    images = frames(bundle.pipeline.background, BANK[:2])
    result = Emulator(bundle.pipeline).run(images)
    simulate(bundle, source, images, result, folder / "sim", name=NAME, build_args=QUICK)
    with np.load(folder / "sim" / "outputs.npz") as archive:
        return top, dict(archive), expected_words(top, result)


@pytest.mark.full
def test_video_ends_a_dma_s_transfer_after_a_row(video):
    top, seen, words = video
    depth = top.outputs[1]
    row, frame = 4 * depth.columns, 4 * depth.rows * depth.columns
    memory = Memory(1 << 20)
    dma = AxiDma(memory, s2mm_bits=8 * depth.octets)
    dma.write(S2MM + DMACR, RUN)
    dma.write(S2MM + ADDRESS, 0)
    dma.write(S2MM + LENGTH, frame)
    beats = zip(seen["depth_words"], seen["depth_keep"], seen["depth_last"], strict=True)
    taken = 0
    for word, keep, last in beats:
        if not dma.s2mm.ready:
            break
        dma.s2mm.clock(Beat(int(word).to_bytes(4, "little", signed=True), int(keep), bool(last)))
        taken += 1
    for _ in range(100):
        dma.s2mm.clock(None)
    assert taken == depth.columns
    assert dma.read(S2MM + LENGTH) == row < frame
    assert bytes(memory.read(0, frame)) == words["depth"][0, 0].astype("<i4").tobytes().ljust(frame, b"\0")


@pytest.mark.full
def test_no_dma_has_the_width_of_video_s_normals(video):
    normals = video[0].outputs[0]
    with pytest.raises(DmaMisuse, match="S2MM: tdata of 96 bits"):
        AxiDma(Memory(1 << 20), s2mm_bits=8 * normals.octets)


@pytest.mark.full
def test_a_vdma_takes_video_without_its_flags(video):
    """It refuses tuser as it is; with its lowest bit alone, depths come whole, and nothing else with them."""
    top, seen, words = video
    depth, memory = top.outputs[1], Memory(1 << 20)
    with pytest.raises(DmaMisuse, match="tuser of 11 bits"):
        AxiVdma(memory, bits=8 * depth.octets, user_bits=len(top.m_axis_depth_tuser))
    vdma = AxiVdma(memory, bits=8 * depth.octets, user_bits=1)
    vdma.write(HSIZE, 4 * depth.columns)
    vdma.write(VSIZE, depth.rows)
    for word, last, user in zip(*(seen[f"depth_{k}"] for k in ("words", "last", "user")), strict=True):
        vdma.beat(int(word).to_bytes(4, "little", signed=True), last=bool(last), start=bool(user & 1))
    assert (vdma.read(STATUS), vdma.frames) == (0, 2)
    whole = words["depth"].astype("<i4").tobytes()
    assert bytes(memory.read(0, len(whole))) == whole
