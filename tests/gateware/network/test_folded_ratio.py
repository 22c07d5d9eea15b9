# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from tests.gateware.network.test_gradient_ratio import alone, normals

from fastac.gateware.network.folded_ratio import FoldedDivider
from fastac.models.integer.network import GradientRatio
from fastac.sim.check_stream import check, pack


@pytest.mark.parametrize(
    ("normal_width", "width", "fraction", "fold"),
    [(21, 17, 14, 16), (10, 9, 8, 4), (7, 12, 5, 8), (8, 6, 0, 2)],
)
def test_bit_exact_to_golden_model(tmp_path, normal_width, width, fraction, fold):
    rng = np.random.default_rng(1)
    ratio = GradientRatio(normal_width, width, fraction)
    dut = FoldedDivider(ratio, fold=fold)
    n = np.concatenate([normals(ratio, rng, 200)[:, None], alone(1, (1 << (normal_width - 1)) - 1)])
    slopes, saturated = ratio(n)
    check(
        dut,
        "folded_divider",
        tmp_path,
        inputs=pack(n, normal_width),
        expected=pack(slopes, width),
        latencies=[(k, k, dut.latency) for k in range(len(n))]
        + [(0, k, dut.latency + k * fold) for k in range(len(n))],
        flags={
            "saturated": int(saturated.any(axis=(1, 2)).sum()),
            "over": int((saturated.reshape(len(n), -1) << np.arange(2)).sum()),
        },
    )
