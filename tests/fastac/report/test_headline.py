"""The figures at the top of a page."""

import pytest

from fastac.report.headline import headlines

REPORT = {
    "scene": {"hardware": {"clock_mhz": 150.0}},
    "rtl_vs_integer": {"mismatches": 0, "values_compared": 47_631, "frames": 3},
    "latency_cycles": {
        "first_pixel_to_force": 48_919,
        "first_pixel_to_depth": 48_780,
        "initiation_interval": 16_384,
    },
    "accuracy": {
        "float": {"depth_mae_mm": 0.00947, "force_nmae_percent": 2.1, "force_mae_n": 0.03},
        "integer": {"depth_mae_mm": 0.00946, "force_nmae_percent": 1.92, "force_mae_n": 0.028},
    },
    "data": {"test_frames": 121},
    "frames_are": "simulated",
    "resources": {"dsp48e2": {"value": 662, "origin": "estimated: by formula"}},
    "device": {"part": "xczu19eg-ffvc1760-2-i", "dsp48e2": 1968},
}


COVERED = {"coverage": 0.89, "coverage_from": 0.85, "coverage_to": 0.92, "half_width_n": 0.07438}
INTERVALS = {
    "asked": 0.9,
    "coverage": 8 / 9,
    "as_they_are": {"groups": 8, "frames": 80, "x": {}, "z": COVERED},
}


def of_both(errors: dict) -> dict:
    return {"float": errors, "integer": errors}


def shown(**changes) -> dict[str, tuple[str, str]]:
    return {each.label: (each.value, each.note) for each in headlines(REPORT | changes)}


def test_equality_comes_first_then_cycles_errors_and_multipliers():
    assert list(shown().items()) == [
        ("hardware against integers", ("0 mismatches", "in 47,631 values of 3 frames, Verilog simulated")),
        ("first pixel to the force", ("48,919 cycles", "0.326 ms at 150 MHz, assumed")),
        ("a new frame every", ("16,384 cycles", "9,155 frames/s at 150 MHz, assumed")),
        ("depth error", ("9.46 µm", "9.47 µm in floats; 121 simulated frames")),
        ("force error", ("1.92%", "of the largest load, mean; 2.10% in floats")),
        ("multipliers", ("662 DSP48E2", "33.6% of xczu19eg, estimated")),
    ]


@pytest.mark.parametrize(
    ("margin_percent", "said"),
    [(58.9, "59% slower than the hardware"), (-2.2, "2% too fast for the hardware")],
)
def test_a_known_camera_is_compared_with_the_hardware(margin_percent, said):
    note = shown(pace={"margin_percent": margin_percent})["a new frame every"][1]
    assert note == f"9,155 frames/s at 150 MHz, assumed; the camera's pixels are {said}"


def test_a_mismatch_is_not_hidden():
    assert (
        shown(rtl_vs_integer=REPORT["rtl_vs_integer"] | {"mismatches": 1})["hardware against integers"][0]
        == "1 mismatch"
    )


@pytest.mark.parametrize(
    ("changes", "label", "value"),
    [
        (
            {"latency_cycles": {"first_pixel_to_normals": 1082}},
            "first pixel to the last normal",
            "1,082 cycles",
        ),
        (
            {"accuracy": of_both({"normal_mae_deg": 0.6331})},
            "normals' error",
            "0.633°",
        ),
        ({"accuracy": of_both({"depth_mae_mm": 0.21})}, "depth error", "0.21 mm"),
        ({"accuracy": of_both({"force_mae_n": 0.028})}, "force error", "28 mN"),
        (
            {"resources": {"dsp48e2": {"value": 1, "origin": "counted by synthesis: x"}}},
            "multipliers",
            "1 DSP48E2",
        ),
        ({"force_interval": INTERVALS}, "88.9% interval of F_z", "± 74.4 mN"),
    ],
)
def test_what_a_build_has_is_shown(changes, label, value):
    assert shown(**changes)[label][0] == value


def test_what_a_build_lacks_is_left_out():
    found = shown(latency_cycles={}, accuracy={"float": {}, "integer": {}}, resources={})
    assert list(found) == ["hardware against integers"]
