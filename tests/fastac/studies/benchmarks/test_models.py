"""The benchmark names every model and finds the emulator exact; its times are never tested."""

import re

from click.testing import CliRunner

from fastac.cli.main import main
from fastac.studies.benchmarks import models, timing


def test_it_times_every_model_and_compares_it(tiny_folder, monkeypatch):
    monkeypatch.setattr(timing, "PAUSE_S", 0)
    for name in ("REPEATS", "LOOP_REPEATS"):
        monkeypatch.setattr(models, name, 1)
    result = CliRunner().invoke(main, ["bench", "models", str(tiny_folder)])
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[0].startswith("For each frame, the fastest of 1 runs")
    assert lines[1] == f"{tiny_folder}, 16 × 16 × 4"
    names = [re.split(r"\s{2,}", line)[0] for line in lines[3:-1]]
    assert [name.partition(",")[0] for name in names] == ["float pipeline"] * 2 + ["emulator"] * 2 + [
        "int64 loop"
    ]
    assert "normals, depth_mm, force_n" in names[1]
    assert re.split(r"\s{2,}", lines[2]) == list(models.HEAD)
    for line in lines[3:7]:
        *_, at_once, _, _, one_by_one, _, ratio = re.split(r"\s{2,}", line)
        one_by_one, at_once, half = float(one_by_one), float(at_once), 0.005  # of the last digit
        least, most = (one_by_one - half) / (at_once + half), (one_by_one + half) / max(at_once - half, 1e-9)
        assert least - 0.01 <= float(ratio) <= most + 0.01
    count = re.fullmatch(
        r"emulator = int64 loop: ([\d,]+) of ([\d,]+) values, all outputs of 8 frames", lines[-1]
    )
    assert count[1] == count[2]


def test_it_needs_a_build_folder():
    result = CliRunner().invoke(main, ["bench", "models"])
    assert result.exit_code == 2
    assert "build folder: none" in result.output
