import pytest
from command_line import run, succeed

from fastac.cli.main import main


class TestHelp:
    @pytest.mark.parametrize(
        ("command", "words"),
        [
            (
                (),
                [
                    "data",
                    "import",
                    "train",
                    "evaluate",
                    "predict",
                    "verilog",
                    "sim",
                    "verify",
                    "synth",
                    "build",
                    "report",
                ],
            ),
            (("data",), ["SCENE", "--output", "--store", "--no-progress", "build/SCENE/data.h5"]),
            (
                ("import",),
                [
                    "ball-press",
                    "cnc",
                    "estimate-modulus",
                    "feats",
                    "force",
                    "fots",
                    "gs-sdk",
                    "rosbag2",
                    "tacbench",
                    "taxim",
                ],
            ),
            (("protocol",), ["SCENE", "--output", "--cad", "--origin-mm", "--simulate", "tangential_x_n"]),
            (
                ("import", "cnc"),
                [
                    "FOLDER",
                    "--scene",
                    "--cad",
                    "--cad-pitch-mm",
                    "--origin-mm",
                    "--ball-mm",
                    "--raw-size-px",
                    "--skip-lost",
                    "--output",
                    "force_x_n",
                    "000012.nir.png",
                ],
            ),
            (
                ("import", "force"),
                [
                    "VIDEO|FOLDER",
                    "--forces",
                    "--background-frames",
                    "--background-per-group",
                    "--pitch-mm",
                    "--held-out",
                    "--height-px",
                    "--width-px",
                    "--no-progress",
                ],
            ),
            (
                ("import", "ball-press"),
                [
                    "FOLDER",
                    "--labels",
                    "--background",
                    "--ball-mm",
                    "--px-per-mm",
                    "--height-px",
                    "--width-px",
                    "--output",
                    "center_x_px",
                    "[required]",
                ],
            ),
            (("train",), ["SCENE", "--data", "--output", "--no-progress", "Resumes"]),
            (("objects",), ["BUNDLE...", "--load-n", "--output", "strawberry", "objects.html", "simulated"]),
            (("evaluate",), ["BUNDLE", "--data", "--split", "--json", "[train|validation|test|all]"]),
            (("predict",), ["BUNDLE", "DATA", "--float", "--split", "--output", "HDF5"]),
            (("verilog",), ["BUNDLE", "--output", "hardware.part"]),
            (
                ("sim",),
                ["BUNDLE", "--data", "--split", "--frames", "--verilog", "--output", "[saif|fst]", "reset"],
            ),
            (
                ("verify",),
                [
                    "SCENE|BUNDLE",
                    "--data",
                    "--lanes",
                    "[default: 1,2,4]",
                    "--frames",
                    "verify.json",
                    "stalls",
                ],
            ),
            (("synth",), ["BUNDLE", "--no-place-and-route", "--module", "--output", "without Vivado"]),
            (("build",), ["SCENE", "--data", "--output", "resumes"]),
            (("report",), ["FOLDER", "--data", "--picture", "report.html"]),
        ],
    )
    @pytest.mark.parametrize("option", ["--help", "-h"])
    def test_names_what_there_is(self, command, words, option):
        result = succeed(*command, option)
        assert result.stderr == ""
        for word in words:
            assert word in result.output

    def test_every_option_has_a_line_of_help(self):
        def commands(group):
            for command in group.commands.values():
                yield from commands(command) if hasattr(command, "commands") else [command]

        found = list(commands(main))
        assert len(found) >= 9
        for command in found:
            assert command.help
            for parameter in command.params:
                if parameter.param_type_name == "option" and parameter.name != "split":
                    assert parameter.help, (command.name, parameter.name)

    def test_version(self):
        assert succeed("--version").output.startswith("fastac, version ")

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (("nonsense",), "No such command 'nonsense'"),
            (("train",), "Missing argument 'SCENE'"),
            (("predict", "b", "d"), "Missing option '-o' / '--output'"),
            (("evaluate", "b"), "Missing option '--data'"),
            (("evaluate", "b", "--data", "d", "--split", "half"), "Invalid value for '--split'"),
            (("sim", "b", "--data", "d", "--frames", "0"), "Invalid value for '--frames'"),
            (("verify", "b", "--lanes", "1,two"), "'two': expected some of 1/16, 1/8, 1/4, 1/2, 1, 2, 4"),
            (("verify", "b", "--lanes", "2,2"), "'2,2': a number is there twice"),
            (("sim", "b", "--data", "d", "--trace", "vcd"), "Invalid value for '--trace'"),
        ],
    )
    def test_wrong_usage_is_told_before_anything_runs(self, arguments, message):
        result = run(*arguments)
        assert result.exit_code == 2
        assert message in result.stderr
