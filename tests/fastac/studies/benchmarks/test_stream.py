"""The benchmark of streams, with few frames: what its tables say, not how fast anything is."""

from fastac.studies.benchmarks import stream as benchmark


def test_both_kinds_of_records_are_measured(tiny_folder, monkeypatch):
    monkeypatch.setattr(benchmark, "RATE_FRAMES", 8)
    monkeypatch.setattr(benchmark, "REPEATS", 1)
    monkeypatch.setattr(benchmark, "TURNS", 2)
    heading, _, rates, _, latencies = benchmark.measure(tiny_folder, 6)
    assert "16 × 16 × 4" in heading
    rows = rates.splitlines()[1:]
    assert [row.split("  ")[0] for row in rows] == ["force alone", "force, depth_mm, normals"]
    assert all(row.endswith("8 of 8") for row in rows)
    rows = latencies.splitlines()[1:]
    assert len(rows) == 6
    assert all(row.endswith("0 of 6") for row in rows)
    whole, driver, rest = (float(row.split()[-7]) for row in rows[:3])
    assert 0 < driver < whole
    assert 0 < rest < whole
