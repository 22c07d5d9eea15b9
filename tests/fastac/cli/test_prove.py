import pytest
from command_line import fail, succeed

from fastac.sim.faults.campaign import Campaign


class TestFaults:
    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (["--design", "paper"], "design 'paper': expected one of dst2d_1, dst2d_2, "),
            (["--faults", "3-5"], "--faults: expected one --design, whose faults they are"),
            (
                ["--design", "normals_4", "--faults", "3,x"],
                "'3,x': expected numbers of faults, such as 600-677 or 3,8",
            ),
        ],
    )
    def test_what_makes_no_sense_is_refused_in_one_line(self, tmp_path, monkeypatch, arguments, message):
        monkeypatch.chdir(tmp_path)
        assert fail("prove", "faults", *arguments).startswith(message)
        assert not list(tmp_path.iterdir())

    def test_faults_of_one_design_are_repeated(self, monkeypatch):
        asked = []
        monkeypatch.setattr(Campaign, "repeat", lambda self, *given: asked.append((self.seed, *given)) or 6)
        result = succeed("prove", "faults", "--design", "normals_4", "--seed", 9, "--faults", "600-605")
        assert asked == [(9, "normals_4", "600-605")]
        assert result.output == "normals_4, seed 9: 6 faults, nothing wrong\n"


def test_a_design_that_there_is_not(tmp_path):
    known = "force_32, force, fast, paper"
    found = fail("prove", "simulators", "--builds", tmp_path, "--only", "papr")
    assert found == f"--only papr: no such design; there is {known}"


def test_nothing_built(tmp_path):
    options = ("--builds", tmp_path, "--only", "paper", "--evidence", tmp_path / "evidence")
    assert "nothing is built: run fastac build" in fail("prove", "simulators", *options)
    assert not (tmp_path / "evidence").exists()
