from click.testing import CliRunner

from fastac.cli.main import main


def test_a_design_that_there_is_not(tmp_path):
    done = CliRunner().invoke(main, ["prove", "simulators", "--builds", str(tmp_path), "--only", "papr"])
    assert done.exit_code == 1
    assert done.output.strip() == "Error: --only papr: no such design; there is force_32, force, fast, paper"


def test_nothing_built(tmp_path):
    arguments = ["prove", "simulators", "--builds", str(tmp_path), "--only", "paper"]
    done = CliRunner().invoke(main, [*arguments, "--evidence", str(tmp_path / "evidence")])
    assert done.exit_code == 1
    assert "nothing is built: run fastac build" in done.output
    assert not (tmp_path / "evidence").exists()
