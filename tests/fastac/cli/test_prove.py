from command_line import fail


def test_a_design_that_there_is_not(tmp_path):
    known = "force_32, force, fast, paper"
    found = fail("prove", "simulators", "--builds", tmp_path, "--only", "papr")
    assert found == f"--only papr: no such design; there is {known}"


def test_nothing_built(tmp_path):
    options = ("--builds", tmp_path, "--only", "paper", "--evidence", tmp_path / "evidence")
    assert "nothing is built: run fastac build" in fail("prove", "simulators", *options)
    assert not (tmp_path / "evidence").exists()
