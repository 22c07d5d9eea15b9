# amaranth: UnusedElaboratable=no
import pytest

from fastac.gateware.network.folded_output import FoldedOutput
from tests.gateware.network.test_folded_layer import both


@pytest.mark.parametrize(
    ("inputs", "fold", "latency", "multipliers"),
    [(7, 4, 4 + 2 + 1, 3 * 2), (5, 16, 5 + 2, 3), (9, 2, 2 + 2 + 3, 3 * 5)],
)
@pytest.mark.quick("7-4-7-6", "5-16-7-3")
def test_last_layer(inputs, fold, latency, multipliers):
    def make(layer):
        return FoldedOutput(layer, input_width=7, input_signed=False, fold=fold)

    both(make, 3, inputs, 127, 0, latency, multipliers)
