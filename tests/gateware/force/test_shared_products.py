import itertools

import pytest

from fastac.gateware.arithmetic.dsp_slice import DSP48E1, DSP48E2
from fastac.gateware.force.shared_products import shared_multipliers, shares_of, slots_of
from fastac.scenes.pace import FOLDS


@pytest.mark.parametrize("fold", FOLDS[1:])
@pytest.mark.parametrize("axes", [1, 2, 3])
def test_every_product_has_one_place(axes, fold):
    """Each product is found once, in `fold` clocks, by as few multipliers as the axes in turn allow."""
    for values in (1, 2, 3, 9, 25, 49):
        found = []
        for share in shares_of(axes, values, fold):
            assert share.slots <= slots_of(axes, values, fold) <= fold
            for slot, multiplier in itertools.product(range(share.slots), range(share.multipliers)):
                round_, axis = divmod(slot, share.axes)
                if share.value(round_, multiplier) < values:
                    found.append((share.first + axis, share.value(round_, multiplier)))
        assert sorted(found) == list(itertools.product(range(axes), range(values)))
        least = -(-axes * values // fold)
        given = sum(share.multipliers for share in shares_of(axes, values, fold))
        assert given == least if values <= 3 or axes == 1 or fold == 16 else given <= least + 1


def test_slices_of_a_product():
    for dsp, slices in ((DSP48E2, 1), (DSP48E1, 2)):
        words = {"input_bits": 26, "weight_bits": 17, "dsp": dsp}
        assert shared_multipliers(3, 9, 16, **words) == 2 * slices
        assert shared_multipliers(3, 2, 16, **words) == slices
