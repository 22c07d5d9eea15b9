"""The benchmark names every part; its times are never tested."""

from click.testing import CliRunner

from fastac.cli.main import main
from fastac.studies.benchmarks import rig, timing


def test_it_times_every_part(tiny_toml, tmp_path, monkeypatch):
    monkeypatch.setattr(timing, "PAUSE_S", 0)
    monkeypatch.setattr(rig, "REPEATS", 1)
    gel = 'thickness_mm = 2.0, mechanics = "fem", friction = 0.8, elements = 8, layers = 1 }'
    text = tiny_toml.replace("thickness_mm = 2.0 }", gel).replace('"force_z"]', '"force_xyz"]')
    (tmp_path / "s.toml").write_text(text.replace("pitch_mm", 'frames = "raw10"\npitch_mm'))
    arguments = [str(tmp_path / "s.toml"), "--store", str(tmp_path / "cache"), "--no-progress"]
    result = CliRunner().invoke(main, ["bench", "rig", *arguments])
    assert result.exit_code == 0, result.output
    for part in ("vertical contact", "all loads", "skin at the pixels", "RAW10 frame", "image processing"):
        assert part in result.output


def test_it_needs_finite_elements(tiny_toml, tmp_path):
    (tmp_path / "s.toml").write_text(tiny_toml)
    result = CliRunner().invoke(main, ["bench", "rig", str(tmp_path / "s.toml")])
    assert result.exit_code == 1
    assert "mechanics = 'layer': expected 'fem'" in result.output
