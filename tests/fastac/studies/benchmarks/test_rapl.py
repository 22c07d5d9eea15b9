import pytest

from fastac.studies.benchmarks.rapl import NoCounters, PackageCounters


def package(root, number, energy_uj, range_uj=1000):
    for name in (f"intel-rapl:{number}", f"intel-rapl:{number}:0"):  # a core's share is in its package's
        (root / name).mkdir()
        (root / name / "energy_uj").write_text(f"{energy_uj}\n")
        (root / name / "max_energy_range_uj").write_text(f"{range_uj}\n")


def test_packages_are_summed_and_wrap_around(tmp_path):
    package(tmp_path, 0, 900)
    package(tmp_path, 1, 10, 5000)
    counters = PackageCounters(tmp_path)
    before = counters.read_uj()
    assert before == [900, 10]
    (tmp_path / "intel-rapl:0" / "energy_uj").write_text("50")
    (tmp_path / "intel-rapl:1" / "energy_uj").write_text("30")
    assert counters.spent_mj(before, counters.read_uj()) == pytest.approx(0.150 + 0.020)


def test_without_counters_one_line_says_so(tmp_path):
    with pytest.raises(NoCounters, match="no intel-rapl: the platform has no energy counters"):
        PackageCounters(tmp_path)
    package(tmp_path, 0, "")
    with pytest.raises(NoCounters, match="intel-rapl cannot be read"):
        PackageCounters(tmp_path)
