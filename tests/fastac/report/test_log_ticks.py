import pytest

from fastac.report.log_ticks import log_ticks


@pytest.mark.parametrize(
    ("low", "high", "inside"),
    [
        (1143, 3153, ["1.5k", "2k", "3k"]),
        (0.6, 2.1, ["0.6", "0.8", "1", "1.5", "2"]),
        (0.004, 0.075, ["0.005", "0.01", "0.02", "0.05"]),
        (1143, 163_500, ["2k", "5k", "10k", "20k", "50k", "100k"]),
        (1, 20_000, ["1", "10", "100", "1k", "10k"]),
        (1e-9, 3.0, ["10⁻⁸", "10⁻⁶", "10⁻⁴", "0.01", "1"]),
        (2e6, 5e6, ["2·10⁶", "3·10⁶", "4·10⁶"]),
    ],
)
def test_labels_in_the_range(low, high, inside):
    places, labels = log_ticks(low, high)
    assert [label for at, label in zip(places, labels, strict=True) if low <= at <= high] == inside
    assert places == sorted(places)
