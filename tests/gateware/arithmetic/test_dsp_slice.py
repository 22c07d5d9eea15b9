import pytest

from fastac.gateware.arithmetic.dsp_slice import DSP48E1, DSP48E2

ONE = {
    DSP48E2: [(1, 1), (17, 13), (27, 18), (18, 27), (18, 18)],
    DSP48E1: [(1, 1), (17, 13), (25, 18), (18, 25), (18, 18)],
}
TWO = {
    DSP48E2: [(28, 18), (18, 28), (19, 19), (27, 19), (19, 27), (27, 35), (53, 18)],
    DSP48E1: [(26, 18), (27, 18), (18, 27), (19, 19), (25, 19), (25, 35), (49, 18)],
}


@pytest.mark.parametrize("dsp", ONE)
def test_slices_of_a_product(dsp):
    """One slice multiplies operands as wide as its ports, with either operand on either port."""
    assert [dsp.slices(*widths) for widths in ONE[dsp]] == [1] * len(ONE[dsp])
    assert [dsp.slices(*widths) for widths in TWO[dsp]] == [2] * len(TWO[dsp])


def test_slices_of_products_wide_on_both_sides():
    assert DSP48E2.slices(28, 28) == DSP48E2.slices(53, 35) == 4
    assert DSP48E1.slices(26, 26) == DSP48E1.slices(49, 35) == 4
