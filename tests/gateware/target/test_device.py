import pytest

from fastac.gateware.arithmetic.dsp_slice import DSP48E1, DSP48E2
from fastac.gateware.target.device import DEVICES, XC7Z020, XCK26, XCZU19EG, DeviceError
from fastac.models.random_bundle import NUMBERS
from fastac.models.random_bundle import scene as random_scene
from fastac.scenes.parts import PARTS

DSP_SLICES = {"zynquplus": DSP48E2, "zynq7000": DSP48E1}


SHORT = NUMBERS | {"data_bits": 24, "activation_bits": 9}


def scene(**has):
    return random_scene(("depth", "force_z"), **has)


def refused(check, by_stage, *others) -> str:
    with pytest.raises(DeviceError) as error:
        check(by_stage, *others)
    text = str(error.value)
    assert "\n" not in text
    return text


def test_every_part_is_a_device():
    assert DEVICES.names == PARTS.names
    for name, device in DEVICES.items():
        assert device.part == name
        assert device.dsp is DSP_SLICES[PARTS[name].family]
        assert device.ff == 2 * device.lut
        totals = device.totals
        assert totals["part"] == name
        assert set(totals) - {"uram288"} == {"part", "lut", "ff", device.carry, device.dsp_key, "ramb36"}


def test_totals_by_the_names_of_reports():
    assert XCZU19EG.totals == {
        "part": "xczu19eg-ffvc1760-2-i",
        "lut": 522_720,
        "ff": 1_045_440,
        "carry8": 65_340,
        "dsp48e2": 1968,
        "ramb36": 984,
        "uram288": 128,
    }
    # The Zynq-7020 has 13,300 slices of four look-up tables, and no UltraRAM.
    assert XC7Z020.totals == {
        "part": "xc7z020clg400-1",
        "lut": 53_200,
        "ff": 106_400,
        "carry4": 13_300,
        "dsp48e1": 220,
        "ramb36": 140,
    }


def test_too_many_multipliers():
    XCZU19EG.check_multipliers({"normals": 352, "depth": 1616}, scene())
    assert refused(XCZU19EG.check_multipliers, {"normals": 352, "depth": 1617}, scene()) == (
        "1,969 DSP48E2 (normals 352, depth 1,617): the xczu19eg-ffvc1760-2-i has 1,968; choose fewer"
        " hardware.pixels_per_clock, hardware.weights = 'baked', a smaller sensor.width_px or another"
        " hardware.part"
    )


def test_too_many_multipliers_of_25_bits():
    """There, shorter words may do with one slice for two."""
    long = scene(numbers=NUMBERS | {"data_bits": 25, "activation_bits": 10})
    XC7Z020.check_multipliers({"depth": 220}, long)
    assert refused(XC7Z020.check_multipliers, {"depth": 221}, long) == (
        "221 DSP48E1 (depth 221): the xc7z020clg400-1 has 220; choose numbers.data_bits of 24 or fewer, fewer"
        " hardware.pixels_per_clock, hardware.weights = 'baked', a smaller sensor.width_px or another"
        " hardware.part"
    )
    found = refused(XC7Z020.check_multipliers, {"normals": 220, "depth": 1}, long)
    assert "; choose numbers.activation_bits of 9 or fewer, numbers.data_bits of 24 or fewer, fewer" in found
    assert "; choose fewer" in refused(XC7Z020.check_multipliers, {"normals": 0, "force": 221}, long)


@pytest.mark.parametrize(
    ("has", "proposed"),
    [
        ({"weights": "baked"}, "fewer hardware.pixels_per_clock, a smaller"),
        ({"lanes": "1/2"}, "fewer hardware.pixels_per_clock, a smaller"),
        ({"lanes": "1/16"}, "a smaller"),
        ({}, "fewer hardware.pixels_per_clock, hardware.weights"),
    ],
)
def test_what_a_scene_has_already_is_not_proposed(has, proposed):
    """Below one pixel a clock no two products share a slice, and baked weights take as many."""
    found = refused(XC7Z020.check_multipliers, {"normals": 221, "depth": 1}, scene(numbers=SHORT, **has))
    assert f"; choose {proposed}" in found


def test_too_many_block_rams():
    XCZU19EG.check_block_rams({"background": 12.5, "force": 971.5})
    assert refused(XCZU19EG.check_block_rams, {"background": 12.5, "force": 1012}) == (
        "1,024.5 RAMB36 (background 12.5, force 1,012): the xczu19eg-ffvc1760-2-i has 984; choose"
        " force.kernel = 'collapsed', a smaller force.kernel_size, fewer numbers.kernel_bits, another"
        " poisson.solver, fewer hardware.pixels_per_clock, a smaller sensor.width_px or another"
        " hardware.part"
    )


def test_clearly_too_many_look_up_tables():
    """An estimate of a quarter more is not clear; it is rounded before it is compared."""
    XCK26.check_luts({"normals": 100_000.4, "depth": 46_400})
    assert refused(XCK26.check_luts, {"normals": 100_000.6, "depth": 46_400}) == (
        "146,401 look-up tables by estimate (normals 100,001, depth 46,400): the xck26-sfvc784-2LV-c has"
        " 117,120; choose fewer hardware.pixels_per_clock, hardware.weights = 'loadable', a smaller"
        " network.width or another hardware.part"
    )
