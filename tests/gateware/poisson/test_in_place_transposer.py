# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from fastac.gateware.poisson.in_place_transposer import InPlaceTransposer
from fastac.sim.check_stream import check, pack


@pytest.mark.parametrize(("size", "fold"), [(2, 4), (7, 2), (6, 16)])
@pytest.mark.quick("7-2")
def test_columns_leave_in_order(tmp_path, size, fold):
    width, frames = 9, 7  # by rows and by columns in turn
    dut = InPlaceTransposer(size, width, fold=fold)
    values = np.random.default_rng(1).integers(-256, 256, (frames, size, size))
    values[0, 0, :2] = -256, 255
    total = size * size
    check(
        dut,
        "in_place_transposer",
        tmp_path,
        inputs=pack(values.reshape(-1, 1), width),
        expected=pack(values.transpose(0, 2, 1).reshape(-1, 1), width),
        latencies=[
            (total - 1, 0, dut.latency),
            # A value every `fold` clocks, also from frame to frame, whose writer always waits here.
            (total - 1, frames * total - 1, dut.latency + frames * dut.interval - fold),
        ],
    )


def test_invalid_arguments():
    with pytest.raises(ValueError, match=r"fold 1: expected one of \(2, 4, 8, 16\)"):
        InPlaceTransposer(14, 9, fold=1)
    with pytest.raises(ValueError, match="size 1: expected at least 2"):
        InPlaceTransposer(1, 9, fold=2)
