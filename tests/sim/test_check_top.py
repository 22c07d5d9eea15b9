# amaranth: UnusedElaboratable=no
import dataclasses
import json

import numpy as np
import pytest

from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.top_zynq import TopZynq
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.frame_validity import REASONS
from fastac.models.random_bundle import frames, random_bundle, scene
from fastac.sim.check_top import Comparison, SimulationFailure, simulate
from fastac.sim.runner import QUICK

WORDS = np.arange(12).reshape(3, 4)


@pytest.mark.parametrize(
    ("found", "mismatches", "first"),
    [
        (WORDS, 0, ""),
        (WORDS.ravel(), 0, ""),
        (WORDS + (WORDS == 7), 1, "depth: 12 values, expected 12; value 7: 8, expected 7"),
        (WORDS + 1, 12, "depth: 12 values, expected 12; value 0: 1, expected 0"),
        (WORDS[:2], 4, "depth: 8 values, expected 12"),
        (WORDS[:0], 12, "depth: 0 values, expected 12"),
        (np.append(WORDS, [0, 0]), 2, "depth: 14 values, expected 12"),
        (np.append(WORDS, 0)[1:], 12, "depth: 12 values, expected 12; value 0: 1, expected 0"),
    ],
    ids=["equal", "flat", "one", "all", "a row missing", "nothing", "too many", "shifted"],
)
def test_comparison(found, mismatches, first):
    comparison = Comparison()
    comparison.add("depth", found, WORDS)
    assert (comparison.values, comparison.mismatches, comparison.first) == (12, mismatches, first)


def test_comparisons_add_up_and_the_first_mismatch_stays():
    comparison = Comparison()
    comparison.add("normals", WORDS, WORDS)
    comparison.add("depth", WORDS + 1, WORDS)
    comparison.add("force", [3], [4])
    assert (comparison.values, comparison.mismatches) == (25, 13)
    assert comparison.first.startswith("depth:")


@pytest.fixture(scope="module")
def hardware(tmp_path_factory):
    """A bundle, its Verilog, three frames and the golden model's outputs for them.

    The same hardware as in `test_normals_depth_and_force` of tests/gateware/test_top_zynq.py, so that its
    simulator is compiled once.
    """
    folder = tmp_path_factory.mktemp("hardware")
    bundle = random_bundle(folder / "bundle", scene(("normals", "depth", "force_z"), channels="bgr+nir"))
    source = folder / "fastac.v"
    source.write_text(to_verilog(TopZynq(bundle), name="fastac"))
    images = frames(bundle.pipeline.background, (10, 40, 255))
    return bundle, source, images, Emulator(bundle.pipeline).run(images), folder / "sim"


def run(hardware, **changes):
    bundle, source, images, result, folder = hardware
    result = dataclasses.replace(result, **changes)
    return simulate(bundle, source, images, result, folder, name="fastac", build_args=QUICK)


def changed(words: np.ndarray, *where: tuple[int, ...]) -> np.ndarray:
    words = words.copy()
    for index in where:
        words[index] += 1
    return words


@pytest.mark.long
def test_mismatches_with_the_golden_model_are_found(hardware):
    """There are as many mismatches as golden words were changed, in every output, first and last included."""
    *_, result, folder = hardware
    found = run(hardware)
    assert (found.mismatches, found.first_mismatch, found.frames) == (0, "", 3)
    assert found.values_by_output == {"depth": 3 * 14**2, "normals": 3 * 16**2 * 3, "force": 3}
    assert found.values_compared == sum(found.values_by_output.values())
    assert found.markers_compared == 3 * (14 * 14 * 3 + 16 * 16 * 2 + 1)
    assert json.loads(json.dumps(found.as_dict()))["latency_cycles"]["initiation_interval"] == 256
    places = {
        "depth_words": [(0, 0, 0), (1, 7, 3), (2, 13, 13)],
        "normal_words": [(0, 0, 0, 0), (2, 15, 15, 2)],
        "force_raw": [(1, 0)],
    }
    found = run(hardware, **{name: changed(getattr(result, name), *where) for name, where in places.items()})
    assert found.mismatches == sum(map(len, places.values()))
    assert found.values_compared == sum(found.values_by_output.values())
    assert found.first_mismatch.startswith("normals: ")

    # A frame's flags are compared in the registers and in every beat of the depth.
    validity = result.validity.copy()
    validity[0] ^= 1
    found = run(hardware, validity=validity)
    assert (found.mismatches, found.first_mismatch[:10]) == (14 * 14 + 1, "depth.tuse")
    validity[0] = result.validity[0] ^ 1 << REASONS.index("displacement")
    found = run(hardware, validity=validity)
    assert (found.mismatches, found.first_mismatch[:14]) == (1, "FRAME_VALIDITY")

    # The golden model has more frames than came out.
    found = run(hardware, depth_words=np.concatenate([result.depth_words, result.depth_words[:1]]))
    assert found.mismatches == 14**2
    # Files of an earlier run are never read as results.
    bundle, source, images, *_ = hardware
    other = Bundle(bundle.pipeline, bundle.floats, f"{bundle.hash_word ^ 1:016x}" + bundle.digest[16:])
    assert (folder / "registers.json").exists()
    with pytest.raises(SimulationFailure, match=r"simulation.log: the testbench failed"):
        simulate(other, source, images, result, folder, name="fastac", build_args=QUICK)
    assert not (folder / "registers.json").exists()
    assert "not that of the bundle" in (folder / "simulation.log").read_text()
