# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from fastac.gateware.poisson.transposer import Transposer
from fastac.sim.check_stream import check, pack


def by_beats(rows, lanes: int, void: int) -> np.ndarray:
    """Rows (rows, N) to beats (beats, lanes); `void` fills the unused lanes of each row's last beat."""
    short = -rows.shape[1] % lanes
    return np.hstack([rows, np.full((len(rows), short), void)]).reshape(-1, lanes)


@pytest.mark.parametrize(("size", "lanes"), [(14, 1), (7, 2), (14, 4)])
@pytest.mark.quick("7-2")
def test_columns_leave_in_order(tmp_path, size, lanes):
    width, frames = 9, 12  # as many that the writer is seen to wait for a page
    dut = Transposer(size, width, lanes=lanes)
    values = np.random.default_rng(1).integers(-256, 256, (frames, size, size))
    values[0] = np.arange(size)[:, None] - np.arange(size)
    values[0, 0, :2] = -256, 255
    rows, columns = values.reshape(-1, size), values.transpose(0, 2, 1).reshape(-1, size)
    beats = dut.beats * size
    check(
        dut,
        "transposer",
        tmp_path,
        inputs=pack(by_beats(rows, lanes, 255), width),
        expected=pack(by_beats(columns, lanes, 0), width),
        mask=pack(by_beats(np.full_like(columns, -1), lanes, 0), width),
        latencies=[
            *((f * beats + beats - 1, f * beats, dut.latency) for f in range(frames)),
            # One beat per clock on both sides: writing a frame overlaps reading the previous one.
            (0, frames * beats - 1, (frames + 1) * beats - 2 + dut.latency),
        ],
    )


def test_invalid_arguments():
    with pytest.raises(ValueError, match="lanes 3: expected 1, 2 or 4"):
        Transposer(14, 9, lanes=3)
    with pytest.raises(ValueError, match="size 2: expected more than lanes = 2"):
        Transposer(2, 9, lanes=2)
