# amaranth: UnusedElaboratable=no
"""Every word of small designs at its worst case, in the integers and in the stage's hardware."""

from dataclasses import replace

import numpy as np
import pytest

from fastac.models.random_bundle import NUMBERS, random_bundle, scene
from fastac.studies.robustness.words import worst_cases
from fastac.studies.robustness.worst_case_hardware import compare

WIDE = NUMBERS | {"gradient_fraction_bits": 12, "coefficient_fraction_bits": 14}
"""Words in which roundings are small."""
SCENES = {
    "the paper's": {"outputs": ("depth", "force_z")},
    "tridiagonal, baked": {
        "outputs": ("depth", "force_xyz"),
        "solver": "tridiagonal",
        "mode": "difference",
        "weights": "baked",
        "divergence": "backward",
        "lanes": 2,
    },
    "adjoint": {"outputs": ("force_xyz",), "solver": "adjoint"},
    "dots": {"outputs": ("force_xyz", "slip"), "size": 32, "dots": True, "weights": "baked", "lanes": 2},
    "dots, loadable": {"outputs": ("force_xyz", "slip"), "size": 32, "dots": True},
}
SCENES |= {f"{name}, cut off": SCENES[name] | {"rounding": "floor"} for name in (*SCENES,)[:2]}
WORDS = {
    "the paper's": {
        *("layer 0", "layer 1", "gradient ratio", "source", "row_forward", "column_forward", "division"),
        *("column_inverse", "row_inverse", "depth", "displacement", "pixel response", "force"),
    },
    "tridiagonal, baked": {
        *("layer 0", "layer 1", "gradient ratio", "source", "row_forward", "elimination", "substitution"),
        *("row_inverse", "depth", "displacement", "pixel response", "force"),
    },
    "adjoint": {"layer 0", "layer 1", "gradient ratio", "force"},
}
DOTS = {"windows of dots", "shifts of dots", "spread of dots"}
WORDS |= {name: WORDS["the paper's"] | {"force of dots"} | DOTS for name in ("dots", "dots, loadable")}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("mode", ["absolute", "difference"])
def test_every_bound_is_reached_and_none_is_exceeded(tmp_path, name, mode):
    wanted = SCENES[name] | {"mode": mode, "numbers": WIDE}
    pipeline = random_bundle(tmp_path / "bundle", scene(**wanted)).pipeline
    cases = worst_cases(pipeline)
    assert {case.name for case in cases} == WORDS[name.removesuffix(", cut off")]
    for case in cases:
        assert case.reached <= case.range_bound <= case.bound, case
        # With a given offset, the solution's bound adds the slopes' and the offset's farthest pixels.
        apart = case.name == "row_inverse" and pipeline.source.offset_limit is None
        assert case.percent >= (95 if apart else 99), case
        assert case.head_room_bits >= 0, case
        # The stimulus is one of the stage: its words hold it.
        limit = getattr(case.stage, "input_width", None)
        assert limit is None or np.abs(case.inputs).max() < 1 << limit, case


@pytest.mark.parametrize(
    ("name", "stages"),
    [
        ("the paper's", {"layer 1", "column_inverse", "pixel response"}),
        ("tridiagonal, baked", {"source", "substitution"}),
        ("adjoint", {"force"}),
        ("dots", DOTS),
        ("dots, loadable", DOTS - {"windows of dots"}),
    ],
)
@pytest.mark.quick("tridiagonal, baked-stages1")
def test_the_hardware_holds_them(tmp_path, name, stages):
    pipeline = random_bundle(tmp_path / "bundle", scene(**SCENES[name])).pipeline
    lanes = pipeline.scene.hardware.pixels_per_clock
    cases = worst_cases(pipeline)
    for case in (case for case in cases if case.name in stages):
        assert compare(case, tmp_path, lanes=lanes) >= len(case.outputs)


def test_a_word_that_is_one_off_is_found(tmp_path):
    pipeline = random_bundle(tmp_path / "bundle", scene(**SCENES["adjoint"])).pipeline
    case = worst_cases(pipeline)[1]
    outputs = case.outputs.copy()
    outputs[-1, -1] += 1
    with pytest.raises((SystemExit, RuntimeError)):
        compare(replace(case, outputs=outputs), tmp_path, lanes=1)
