"""hardware.json is checked before anything is driven by it: one line for whatever cannot be."""

import json

import pytest
from described_hardware import content

from fastac.driver.description import DescriptionError, parse, read


@pytest.fixture
def facts(bundle) -> dict:
    return content(bundle)


def error_of(facts: dict) -> str:
    with pytest.raises(DescriptionError) as found:
        parse(json.dumps(facts), "hardware.json")
    assert len(str(found.value).splitlines()) == 1
    return str(found.value).removeprefix("hardware.json: ")


def test_what_follows_from_it(description, bundle):
    assert description.hash_word == bundle.hash_word
    assert description.frame.shape == (16, 16, 3)
    assert description.streams_out == {"depth": description.outputs[0].packet_bytes}
    assert description.record_at == ("depth", description.outputs[0].image_bytes)
    assert description.force.scales.tolist() == bundle.pipeline.force_n_per_unit.tolist()
    description.require_bundle(bundle.digest, "it")
    with pytest.raises(DescriptionError, match=r"it: bundle_sha256 = .*: the bundle's is 0000"):
        description.require_bundle("0" * 64, "it")


def test_what_the_driver_does_not_use_is_left_alone(facts):
    assert parse(json.dumps(facts | {"more": [1, 2]})).version == facts["version"]


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("version",), "7", "version = '7': Input should be a valid integer"),
        (("format_version",), 2, "format_version = 2: expected 1"),
        (("streams",), "photons", "streams = 'photons': Input should be 'video' or 'packets'"),
        (("clock_mhz",), 0, "clock_mhz = 0"),
        (("bundle_sha256",), "xyz", "bundle_sha256 = 'xyz'"),
        (("frame", "bytes"), 7, "frame.bytes = 7: expected 1024"),
        (("frame", "lanes"), 3, "s_axis: lanes 3: expected a power of two"),
        (("outputs", 0, "packet_bytes"), 7, "outputs.depth.packet_bytes = 7: expected 848"),
        (("outputs", 0, "complete"), None, "outputs.depth.complete: missing"),
        (("outputs", 0, "per_lsb"), -1.0, "outputs.0.per_lsb"),
        (("results",), None, "results: missing"),
        (("results", "format"), 2, "results.format = 2: expected 1"),
        (("force", "axes"), ["x"], "force.newtons_per_lsb: expected the axes x, each once"),
        (("registers", 1, "offset"), 0, "registers: offsets: 0 is there twice"),
        (("registers", 0, "access"), "maybe", "registers.0.access = 'maybe'"),
        (("latency_cycles_by_formula", "first_pixel_to_force"), -3, "latency_cycles_by_formula: expected"),
    ],
)
def test_wrong_values(facts, path, value, message):
    *way, last = path
    place = facts
    for key in way:
        place = place[key]
    place[last] = value
    assert error_of(facts).startswith(message)


def test_missing_keys(facts):
    del facts["frame"]
    message = "frame: missing; if an older version wrote it, write it again with fastac verilog BUNDLE"
    assert error_of(facts) == message


@pytest.mark.parametrize("text", ["", "{", "[]", "\x00", '{"version": ' + "9" * 5000 + "}", "[" * 3000])
def test_damaged_files(tmp_path, text):
    path = tmp_path / "hardware.json"
    path.write_text(text)
    with pytest.raises(DescriptionError, match=f"^{path}: ") as error:
        read(tmp_path)
    assert len(str(error.value).splitlines()) == 1


def test_no_file(tmp_path):
    with pytest.raises(DescriptionError, match=r"No such file or directory; write it with fastac verilog"):
        read(tmp_path / "none")
