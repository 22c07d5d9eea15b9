import numpy as np
import pytest

from gateware.requantise import Requantise
from models.integer import Requantisation
from sim.stream import check, pack


@pytest.mark.parametrize(
    ("multipliers", "shift"), [([1, 2, 3, 4], 0), ([77_771, 1, 9, 131_071], 24), ([131_071] * 4, 12)]
)
def test_rtl_equals_reference(tmp_path, multipliers, shift):
    scale = Requantisation(np.array(multipliers), shift)
    dut = Requantise(scale, width=20)
    limit = 1 << 19
    a = np.random.default_rng(1).integers(-limit, limit, (300, 4))
    a[0], a[1], a[2] = limit - 1, -limit, 0
    check(
        dut,
        "requantise",
        tmp_path,
        inputs=pack(a, 20),
        expected=pack(scale(a), 7),
        latencies=[(k, k, dut.latency) for k in range(len(a))],
    )
