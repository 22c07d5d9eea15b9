# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from fastac.gateware.network.folded_ratio import FoldedDivider
from fastac.models.integer.network import GradientRatio
from fastac.sim.check_stream import check, pack
from tests.gateware.network.test_gradient_ratio import alone, normals


@pytest.mark.parametrize(
    ("normal_width", "width", "fraction", "fold", "latency"),
    [(21, 17, 14, 16, 28), (10, 9, 8, 4, 14), (7, 12, 5, 8, 19), (8, 6, 0, 2, 10)],
)
@pytest.mark.quick("21-17-14-16-28", mutate=["8-6-0-2-10"])
def test_bit_exact_to_golden_model(tmp_path, normal_width, width, fraction, fold, latency):
    ratio = GradientRatio(normal_width, width, fraction)
    dut = FoldedDivider(ratio, fold=fold)
    assert (dut.latency, dut.interval) == (latency, fold)
    found = normals(ratio, np.random.default_rng(1), 200)
    n = np.concatenate([found[:, None], alone(1, (1 << (normal_width - 1)) - 1)])
    slopes, saturated = ratio(n)
    assert (slopes == ratio.limit).any()
    assert (slopes == -ratio.limit).any()
    assert not saturated.any(axis=(1, 2)).all()
    check(
        dut,
        "folded_divider",
        tmp_path,
        inputs=pack(n, normal_width),
        expected=pack(slopes, width),
        latencies=[
            *((k, k, latency) for k in range(len(n))),
            *((0, k, latency + k * fold) for k in range(len(n))),
        ],
        places=(1, latency // fold),
        stalls=(0, 0.6),
        flags={
            "saturated": int(saturated.any(axis=(1, 2)).sum()),
            "over": int((saturated.reshape(len(n), -1) << np.arange(2)).sum()),
        },
    )


@pytest.mark.parametrize(
    ("ratio", "fold", "message"),
    [
        (GradientRatio(12, 9, 6), 1, r"fold 1: expected one of \(2, 4, 8, 16\)"),
        (GradientRatio(12, 9, 9), 2, "fraction 9: expected 0 to 8"),
    ],
)
def test_invalid_arguments(ratio, fold, message):
    with pytest.raises(ValueError, match=message):
        FoldedDivider(ratio, fold=fold)
