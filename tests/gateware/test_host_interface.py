# amaranth: UnusedElaboratable=no
import json

import numpy as np
import pytest

from fastac.gateware.bus.register_map import ERRORS
from fastac.gateware.host_interface import host_interface
from fastac.gateware.top_zynq import TopZynq
from fastac.models.emulator.pipeline import Emulator
from fastac.models.random_bundle import random_bundle, scene


def described(folder, outputs, *, streams="packets", **changes):
    """The top of random integers, and what it says of itself to a host."""
    top = TopZynq(random_bundle(folder / "bundle", scene(outputs, streams=streams, **changes)))
    return top, json.loads(json.dumps(host_interface(top)))


def test_sizes_of_packets(tmp_path):
    _, found = described(tmp_path, ("normals", "depth", "force_map", "force_xyz"), lanes=2, channels="bgr")
    frame = found["frame"]
    assert (frame["height_px"], frame["width_px"], frame["channels"]) == (16, 16, ["B", "G", "R"])
    assert (frame["bytes_per_pixel"], frame["bytes_per_beat"], frame["bytes"]) == (4, 8, 16 * 16 * 4)
    outputs = {output["name"]: output for output in found["outputs"]}
    assert [output["port"] for output in found["outputs"]] == [f"m_axis_{name}" for name in outputs]
    sizes = {
        "normals": (16, 3, 4, 8, 16 * 16 * 4 * 4, 64),
        "depth": (14, 1, 1, 7, 14 * 14 * 4, 64),
        "force_map": (14, 3, 4, 7, 14 * 14 * 4 * 4, 64),
    }
    for name, (rows, words, padded, beats, image, trailer) in sizes.items():
        output = outputs[name]
        keys = ("rows", "words_per_pixel", "words_per_pixel_padded", "beats_per_row", "image_bytes")
        assert [output[key] for key in keys] == [rows, words, padded, beats, image], name
        assert output["row_bytes"] * rows == output["trailer_offset_bytes"] == image
        assert output["packet_bytes"] == image + trailer
    assert [outputs[name]["complete"] for name in sizes] == [False, True, True]
    assert found["results"]["port"] is None
    assert (found["results"]["record_bytes"], len(found["results"]["words"])) == (64, 16)
    assert found["errors"] == list(ERRORS)
    assert {"TIME_LOW", "RESULTS_WORD"} < {register["name"] for register in found["registers"]}
    assert found["streams"] == "packets"


def test_normals_alone_wait_for_nothing(tmp_path):
    _, found = described(tmp_path, ("normals",))
    assert found["outputs"][0]["complete"]
    assert (found["force"], found["slip"]) == (None, None)


def test_records_have_a_port_of_their_own_without_images(tmp_path):
    _, found = described(tmp_path, ("force_z",), solver="adjoint")
    assert (found["outputs"], found["results"]["port"]) == ([], "m_axis_results")


def test_video_has_no_sizes_of_packets(tmp_path):
    _, found = described(tmp_path, ("normals", "depth", "force_z"), streams="video")
    assert "results" not in found
    keys = {key for part in (found["frame"], *found["outputs"]) for key in part}
    assert not [key for key in keys if "bytes" in key or key in ("complete", "words_per_pixel_padded")]
    assert not [register for register in found["registers"] if register["name"].startswith(("TIME", "RES"))]
    assert found["frame"]["port"] == "s_axis"


def test_scales_make_units_of_the_integers(tmp_path):
    """The emulator's words times the scales are its values in mm and N."""
    top, found = described(tmp_path, ("depth", "force_map", "force_xyz"))
    pipeline = top.bundle.pipeline
    frames = np.random.default_rng(1).integers(0, 256, (2, *pipeline.background.shape), np.uint8)
    result = Emulator(pipeline).run(frames)
    outputs = {output["name"]: output for output in found["outputs"]}
    depth = result.depth_words * outputs["depth"]["per_lsb"]
    np.testing.assert_allclose(depth, result.depth_mm[:, 1:-1, 1:-1], rtol=1e-6)
    assert (outputs["depth"]["unit"], outputs["force_map"]["unit"]) == ("mm", "N")
    newtons = [found["force"]["newtons_per_lsb"][axis] for axis in found["force"]["axes"]]
    np.testing.assert_allclose(result.force_raw * newtons, result.force_n)
    per_axis = np.array([outputs["force_map"]["per_lsb"][axis] for axis in "xyz"])
    scaled = result.force_map_raw * per_axis[:, None, None]
    np.testing.assert_allclose(scaled, result.force_map_n, rtol=1e-6)


def test_reset_values(tmp_path):
    top, found = described(tmp_path, ("depth", "force_z"), weights="baked")
    resets = {register["name"]: register["reset"] for register in found["registers"]}
    assert resets["FRAME_TIMEOUT"] == top.identity.frame_timeout
    assert resets["BUNDLE_HASH_LOW"] == top.bundle.hash_word & 0xFFFFFFFF
    assert (resets["CONTROL"], resets["STATUS"], resets["TIME_LOW"]) == (1, 0, None)


@pytest.mark.parametrize("weights", ["loadable", "baked"])
def test_every_register_is_described(tmp_path, weights):
    top, found = described(tmp_path, ("depth", "force_z"), weights=weights)
    names = [register.name for register in top.identity.registers]
    assert [register["name"] for register in found["registers"]] == names
    assert all(register["meaning"] and register["offset"] % 4 == 0 for register in found["registers"])
    fields = {register["name"]: register["fields"] for register in found["registers"]}
    assert {"name": "frames_in_flight", "low": 8, "width": 8} in fields["STATUS"]
