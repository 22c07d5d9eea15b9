import pytest

from fastac.gateware.network.fold_plan import Series


@pytest.mark.parametrize(
    ("count", "fold", "clocks", "streams"),
    [(16, 16, 16, 1), (16, 8, 8, 2), (17, 16, 9, 2), (6, 16, 6, 1), (5, 2, 2, 3), (1, 4, 1, 1)],
)
def test_every_value_once_and_in_order(count, fold, clocks, streams):
    series = Series(count, fold)
    assert (series.clocks, series.streams) == (clocks, streams)
    assert clocks <= fold
    places = [series.at(clock, stream) for clock in range(clocks) for stream in range(streams)]
    assert places == [*range(count), *[None] * (clocks * streams - count)]
    assert clocks * streams - count < streams
