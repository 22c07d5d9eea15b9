# amaranth: UnusedElaboratable=no
"""The top level with packets: bit-exact images and records, cycles by formula, and faults of the host's
side."""

import json
import random

import numpy as np
import pytest
from top_hardware import MILD, NAME, Hardware

from fastac.gateware.cycle_model import CycleModel
from fastac.models.emulator.pipeline import Emulator
from fastac.models.random_bundle import scene
from fastac.models.result import concatenate
from fastac.scenes.schema import SceneError, parse
from fastac.sim.check_packets import packet_bytes
from fastac.sim.check_top import bench_settings, expected_words
from fastac.sim.faults.frame_rules import FrameRules
from fastac.sim.faults.packet_rules import PacketRules
from fastac.sim.runner import QUICK, build

CASES = {
    "normals, depth, force": {"outputs": ("normals", "depth", "force_z"), "channels": "bgr+nir"},
    "records alone": {"outputs": ("force_xyz",), "solver": "adjoint", "lanes": 2},
    "records with half-widths": {
        "outputs": ("force_x", "force_z"),
        "solver": "adjoint",
        "lanes": 4,
        "coverage": 0.9,
    },
    "depth with half-widths": {"outputs": ("depth", "force_z"), "coverage": 0.9},
    "normals alone": {"outputs": ("normals",), "lanes": 4, "channels": "bgr+nir"},
    "depth alone": {"outputs": ("depth",), "lanes": 4},
    "slip": {
        "outputs": ("depth", "force_x", "force_z", "slip"),
        "channels": "bgr+nir",
        "solver": "tridiagonal",
        "mode": "difference",
        "kernel": "collapsed",
        "lanes": 2,
        "size": 24,
        "dots": True,
    },
    "patches beside depth": {
        "outputs": ("depth", "force_xyz"),
        "mode": "difference",
        "lanes": 2,
    },
    "force before the depth": {
        "outputs": ("normals", "depth", "force_xyz"),
        "mode": "difference",
        "source": "slopes",
        "smoothing_px": 4,
    },
    "at a fold": {"outputs": ("depth", "force_z"), "mode": "difference", "lanes": "1/4", "source": "slopes"},
    "force map": {
        "outputs": ("depth", "force_xyz", "force_map"),
        "channels": "bgr+nir",
        "solver": "tridiagonal",
        "mode": "difference",
        "weights": "baked",
        "lanes": 4,
        "size": 20,
    },
}
"""Together: every kind of stream; three words of four; void lanes; queues before the ports and none."""


@pytest.fixture(scope="module")
def hardware(tmp_path_factory):
    """Hardware by the names of `CASES`, each made once."""
    made = {}

    def make(case: str) -> Hardware:
        if case not in made:
            made[case] = Hardware(tmp_path_factory.mktemp("packets"), streams="packets", **CASES[case])
        return made[case]

    return make


@pytest.mark.parametrize("case", CASES)
@pytest.mark.quick("records alone")
@pytest.mark.long
def test_every_word_of_images_and_records(hardware, case):
    """All images, paddings, records and marks; every frame's latency and the interval are the formulas'."""
    made = hardware(case)
    path, images = made.top.datapath, made.frames(*MILD, 120, 255)
    model = CycleModel(made.bundle.scene, hidden=(4,), follower=made.pipeline.follower)
    assert model.first_pixel_to_packet == path.first_pixel_to_packet
    assert [model.packet_queue(n) for n in model.packets] == [path.packet_queue(n) for n in path.packets]
    for stall in ((0, 0), (0.5, 0.3), (0, 0.8)):
        found = made.run(images, stall)
        assert found.mismatches == 0, f"stall {stall}: {found.first_mismatch}"
        assert found.markers_compared > 100
        if stall != (0, 0):
            continue
        assert found.latency_cycles["initiation_interval"] == path.interval
        for name, stated in path.first_pixel_to_packet.items():
            assert found.latency_cycles[f"first_pixel_to_{name}_packet"] == stated
        if path.wants_force:
            assert found.latency_cycles["first_pixel_to_force"] == path.first_pixel_to_force


@pytest.mark.parametrize("case", CASES)
def test_packets_leave_the_force_s_latency_as_it_is(case):
    video, path = (
        CycleModel(scene(streams=kind, **CASES[case]), hidden=(4,)) for kind in ("video", "packets")
    )
    assert path.first_pixel_to_result == video.first_pixel_to_result
    assert path.stages == video.stages
    trailer = {"normals, depth, force": 4, "force before the depth": 4, "normals alone": 1}.get(case, 0)
    assert path.interval - video.interval == path.frame_pause == trailer


def frames_of(packets: list, bank: list[np.ndarray], lanes: int) -> tuple[list, list[int], set[str]]:
    """(Images, marks "bad", errors) of the frames that come of packets (image of the bank, beats)."""
    height, width, channels = bank[0].shape
    entry, guard = PacketRules(height, width // lanes), FrameRules(height, width // lanes)
    sent, total = [], height * width // lanes  # (image, beat of it) of each beat
    for image, beats in packets:
        for k in range(beats):
            for mark in entry.beat(len(sent), last=k == beats - 1):
                made_up = mark.index is None
                guard.beat(len(sent), last=mark.last, start=mark.start, enabled=not made_up)
            sent.append((image, k % total))
    pixels = [image.reshape(total, lanes, channels) for image in bank]
    images = []
    for frame in guard.frames:
        beats = [(*sent[index], repeated) for index, repeated in frame.sources]
        parts = [pixels[k][beat, [lanes - 1] * lanes if again else slice(None)] for k, beat, again in beats]
        images.append(np.array(parts).reshape(height, width, channels))
    return images, [int(frame.bad) for frame in guard.frames], guard.flags


def padded_images(output, words: np.ndarray) -> np.ndarray:
    """(frames, words of the image in a packet), with zeros in all that is padded."""
    frames = len(words)
    pixels = np.zeros(
        (frames, output.rows, output.beats * output.lanes, output.packet.words_padded), np.int32
    )
    pixels[:, :, : output.columns, : output.words] = words.reshape(
        frames, output.rows, output.columns, output.words
    )
    return pixels.reshape(frames, -1)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.quick("records alone")
@pytest.mark.long
def test_packets_of_the_wrong_length_and_resets(hardware, case):
    made = hardware(case)
    top, pipeline = made.top, made.pipeline
    lanes, line = top.lanes, top.bundle.scene.sensor.width_px // top.lanes
    images = list(made.frames(*MILD))
    total = line * top.bundle.scene.sensor.height_px
    rng = random.Random(1)
    lengths = {
        "inside a line": [5 * line + 1],
        "at the end of a line": [7 * line],
        "inside the last line": [total - 1],
        "one beat": [1],
        "one beat too many": [total + 1],
        "two frames in one": [2 * total],
        "random": [
            rng.choice([total, rng.randint(1, total), rng.randint(total, 2 * total)]) for _ in range(12)
        ],
    }

    def add(packets: list) -> dict:
        """A scenario of these packets; the images of their frames are added to the bank."""
        found, bad, errors = frames_of(packets, images[: len(MILD)], lanes)
        first = len(images)
        images.extend(found)
        frames = list(range(first, first + len(found)))
        return {"packets": packets, "frames": frames, "bad": bad, "errors": sorted(errors)}

    scenarios = {
        name: add([[0, total], *([1 + k % 3, beats] for k, beats in enumerate(beats_of)), [2, total]])
        for name, beats_of in lengths.items()
    }
    # After a hard reset the rest of a packet is a short one: its first beats are those behind the cut.
    rest = images[3].reshape(-1, images[3].shape[-1])[(total // 2 + 1) * lanes :]
    remainder = np.concatenate([rest, np.broadcast_to(rest[-1], (total * lanes - len(rest), rest.shape[1]))])
    stops = {"beats": 3 * line + 2, "frame": add([[0, 3 * line + 2]])["frames"][0]}
    images.append(remainder.reshape(images[3].shape))

    bank = np.array(images)
    result = concatenate([Emulator(pipeline).run(bank)])
    folder = made.folder / "faults"
    folder.mkdir()
    archive = {"frames": bank, "validity": result.validity}
    words = expected_words(top, result)
    archive |= {f"{o.name}_image": padded_images(o, words[o.name]) for o in top.outputs}
    if pipeline.scene.wants_force:
        archive["force"] = result.force_raw
    if pipeline.interval is not None:
        archive["half_widths"] = result.force_half_width_raw
    np.savez(folder / "frames.npz", **archive)
    settings = bench_settings(top) | {
        "timeout_cycles": 40 * total + 40_000,
        "packet_bytes": packet_bytes(top),
        "image_bytes": {o.name: o.packet.image_bytes for o in top.outputs},
        "complete": {o.name: o.complete for o in top.outputs},
        "scenarios": scenarios,
        "saturations": ["gradient_saturated", "displacement_saturated"],
        "remainder": 3,
        "remainder_repaired": len(images) - 1,
        "stops": stops,
    }
    (folder / "settings.json").write_text(json.dumps(settings))
    build_folder = made.folder / "sim" / "build"
    runner = build(made.source, NAME, build_folder, build_args=QUICK)
    runner.test(
        hdl_toplevel=NAME,
        test_module="fastac.sim.benches.top_packets",
        build_dir=build_folder,
        extra_env={"BENCH": str(folder)},
    )


def test_an_unknown_kind_of_streams_is_refused(tiny_toml):
    with pytest.raises(SceneError, match=r"^tiny\.toml: hardware\.streams = 'frames': "):
        parse(f'{tiny_toml}\n[hardware]\nstreams = "frames"\n', origin="tiny.toml")
