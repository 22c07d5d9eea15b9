import json
import os
import re
import shutil
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from fastac.cli.main import main
from fastac.flow import hardware, verify
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer import assemble
from fastac.models.integer import bundle as bundles
from fastac.scenes import schema as scenes
from fastac.sensor import dataset
from fastac.sim.check_top import Report as Simulated
from fastac.sweep import pools
from fastac.sweep import run as sweeps

QUICK = """
normals_epochs = 1
finetune_epochs = 1
force_epochs = 1
"""


def run(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments], prog_name="fastac")


def succeed(*arguments):
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    return result


def fail(*arguments) -> str:
    """The one line of an error that a user can mend."""
    result = run(*arguments)
    assert result.exit_code == 1, result.output
    assert isinstance(result.exception, SystemExit), result.exception
    errors = [line for line in result.stderr.splitlines() if not line.endswith(("running", "up to date"))]
    assert len(errors) == 1, result.stderr
    assert errors[0].startswith("Error: ")
    return errors[0].removeprefix("Error: ")


@pytest.fixture
def toml(tiny_toml, tmp_path):
    path = tmp_path / "tiny.toml"
    path.write_text(tiny_toml)
    return path


@pytest.fixture
def one_process(monkeypatch):
    """Frames without worker processes: a few presses are not worth their start."""
    monkeypatch.setattr(os, "cpu_count", lambda: 1)


def write(data, path, **changes):
    dataset.write(path, **{**vars(data), **changes})
    return path


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
            (("data",), ["SCENE", "--output", "--cache", "--no-progress", "build/SCENE/data.h5"]),
            (("import",), ["ball-press", "cnc", "force"]),
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
            (("verilog",), ["BUNDLE", "--output", "XCZU19EG"]),
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
            (("report",), ["FOLDER", "--data", "report.html"]),
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
            (("verify", "b", "--lanes", "1,two"), "'1,two': expected numbers separated by commas"),
            (("verify", "b", "--lanes", "2,2"), "'2,2': a number is there twice"),
            (("sim", "b", "--data", "d", "--trace", "vcd"), "Invalid value for '--trace'"),
        ],
    )
    def test_wrong_usage_is_told_before_anything_runs(self, arguments, message):
        result = run(*arguments)
        assert result.exit_code == 2
        assert message in result.stderr


class TestMachine:
    def test_a_simulated_recording_comes_back_as_a_dataset(self, toml, tmp_path, one_process):
        text = toml.read_text().replace("train_grid = 3", "train_grid = 1")
        gel = 'thickness_mm = 2.0, mechanics = "fem", elements = 8, layers = 1 }'
        toml.write_text(text.replace("thickness_mm = 2.0 }", gel))
        options = ("--origin-mm", 10, 20, -5, "--cache", tmp_path / "cache", "--no-progress")
        recording = tmp_path / "recording"
        said = succeed("protocol", toml, "-o", tmp_path / "p.csv", "--simulate", recording, *options).stdout
        assert "p.csv: 18 samples" in said
        assert "18 frames, simulated" in said
        command = ("import", "cnc", recording, "--scene", toml, "-o", tmp_path / "d.h5", "--no-progress")
        assert "19 frames (3 train, 8 validation, 8 test)" in succeed(*command, *options[:4]).stdout
        assert len(dataset.read(tmp_path / "d.h5")) == 19
        message = fail(*command)
        assert "poses.csv, line 2: " in message
        assert "outside the skin" in message
        assert "not empty" in fail(
            "protocol", toml, "-o", tmp_path / "p.csv", "--simulate", recording, *options
        )
        assert "expected an STL file" in fail(*command, "--cad", tmp_path / "p.csv")


class TestData:
    def test_writes_the_dataset_and_says_that_it_is_simulated(self, toml, tmp_path, one_process, tiny_data):
        toml.write_text(toml.read_text().replace("train_grid = 3", "train_grid = 1"))
        result = succeed("data", toml, "-o", tmp_path / "new" / "d.h5", "--no-progress")
        assert "simulated" in result.stdout
        data = dataset.read(tmp_path / "new" / "d.h5")
        assert data.channels == ("B", "G", "R", "NIR")
        assert len(data) == 2 * (1 + 4 + 4)
        assert data.pitch_mm == 0.25

    def test_says_how_many_samples_friction_could_not_carry(self, toml, tmp_path, one_process):
        text = (
            toml.read_text().replace('"force_z"]', '"force_xyz"]').replace("train_grid = 3", "train_grid = 1")
        )
        gel = 'thickness_mm = 2.0, mechanics = "fem", friction = 0.6, elements = 8, layers = 1 }'
        toml.write_text(text.replace("thickness_mm = 2.0 }", gel))
        cache = tmp_path / "cache"
        result = succeed("data", toml, "-o", tmp_path / "d.h5", "--cache", cache, "--no-progress")
        data = dataset.read(tmp_path / "d.h5")
        assert f"{len(data)} samples; friction could not carry {data.left_out}, left out" in result.stdout
        assert len(data) + data.left_out == 2 * (1 + 4 + 4) * 9
        assert [path.suffix for path in cache.iterdir()] == [".npz"]

    def test_goes_to_the_build_folder_of_the_scene(self, toml, tmp_path, monkeypatch, one_process):
        monkeypatch.chdir(tmp_path)
        succeed("data", toml, "--no-progress")
        assert (tmp_path / "build" / "tiny" / "data.h5").exists()

    def test_errors(self, toml, tmp_path, one_process):
        text = toml.read_text()
        assert fail("data", tmp_path / "no.toml") == f"{tmp_path}/no.toml: No such file or directory"
        toml.write_text(text.replace("pitch_mm", "pitch"))
        assert fail("data", toml) == f"{toml}: sensor.pitch: unknown key"
        toml.write_text(text.replace("width_px = 16", "width_px = sixteen"))
        assert fail("data", toml).startswith(f"{toml}: Invalid value (at line")
        toml.write_text(text.replace("height_px = 16", "height_px = 24"))
        assert fail("data", toml).startswith(f"{toml}: sensor.height_px: 24 differs from width_px 16")
        toml.write_text(text.replace("ball_mm = 1.5", "ball_mm = 15.0"))
        assert fail("data", toml).startswith("protocol.ball_mm = 15: no room for it")
        toml.write_text(text.replace("[protocol]", 'source = "recorded"\n[protocol]'))
        assert "sensor.source = 'recorded': expected 'simulated'" in fail("data", toml)


class TestImport:
    OPTIONS = ("--ball-mm", 4, "--px-per-mm", 10, "--height-px", 32, "--width-px", 32)

    @pytest.fixture
    def recording(self, tmp_path):
        folder = tmp_path / "press"
        folder.mkdir()
        for name in ("a.png", "b.png"):
            Image.new("RGB", (48, 64), (200, 100, 50)).save(folder / name)
        Image.new("RGB", (48, 64), (90, 80, 70)).save(tmp_path / "background.png")
        self.label(tmp_path, "a.png,20,30,15,train\nb.png,24,31.5,12,test\n")
        return tmp_path

    @staticmethod
    def label(place, rows: str):
        (place / "press.csv").write_text("image,center_x_px,center_y_px,radius_px,split\n" + rows)

    def arguments(self, place, *more):
        return (
            "import",
            "ball-press",
            place / "press",
            "--labels",
            place / "press.csv",
            "--background",
            place / "background.png",
            *self.OPTIONS,
            "-o",
            place / "out" / "d.h5",
            *more,
        )

    def test_writes_a_dataset(self, recording):
        result = succeed(*self.arguments(recording))
        assert "3 frames (2 train, 0 validation, 1 test), pitch 0.20000 mm" in result.stdout
        data = dataset.read(recording / "out" / "d.h5")
        assert data.channels == ("B", "G", "R")
        assert data.frames.shape == (3, 32, 32, 3)

    def test_labels_that_point_nowhere(self, recording):
        self.label(recording, "a.png,20,30,15,train\nlost.png,20,30,15,test\n")
        message = fail(*self.arguments(recording))
        assert message.endswith(f"press.csv, line 3: image = 'lost.png': not in {recording / 'press'}")
        assert not (recording / "out" / "d.h5").exists()

    def test_other_errors(self, recording):
        self.label(recording, "a.png,20,30,15,dev\n")
        assert "line 2: split = 'dev': expected one of train" in fail(*self.arguments(recording))
        assert "ball_mm = -1: expected more than 0" in fail(*self.arguments(recording, "--ball-mm", -1))
        result = run(*self.arguments(recording, "--height-px", 8))
        assert result.exit_code == 2
        assert "--height-px" in result.stderr


class TestImportForce:
    @pytest.fixture
    def arguments(self, tmp_path):
        (tmp_path / "grasps").mkdir()
        for k in range(4):
            Image.new("RGB", (48, 64), (90 + k, 80, 70)).save(tmp_path / "grasps" / f"{k}.png")
        (tmp_path / "f.csv").write_text("frame,force_z_n,group\n0,0,cup\n1,1,cup\n2,2,ball\n3,3,nut\n")
        return (
            *("import", "force", tmp_path / "grasps", "--forces", tmp_path / "f.csv"),
            *("--background-frames", 1, "--pitch-mm", 0.2, "--height-px", 32, "--width-px", 32),
            *("-o", tmp_path / "out" / "d.h5", "--no-progress"),
        )

    def test_writes_a_dataset(self, arguments, tmp_path):
        result = succeed(*arguments, "--held-out", "ball", "--held-out", "nut")
        path = tmp_path / "out" / "d.h5"
        assert result.stdout.splitlines() == [
            f"{path}: 4 frames (2 train, 0 validation, 2 test), force z",
            "test: ball, nut",
        ]
        data = dataset.read(path)
        np.testing.assert_array_equal(data.force_n, [[0], [1], [2], [3]])
        assert succeed(*arguments).stdout.endswith("test: nut\n")

    def test_errors(self, arguments, tmp_path):
        assert fail(*arguments, "--held-out", "pen").endswith(
            "f.csv: group 'pen': expected one of cup, ball, nut"
        )
        (tmp_path / "f.csv").write_text("frame,force_z_n,group\n0,0,cup\n1,none,cup\n")
        assert fail(*arguments).endswith("f.csv, line 3: force_z_n = 'none': expected a number")
        assert run(*arguments, "--background-frames", 0).exit_code == 2


class TestTrain:
    def test_writes_the_bundle_and_resumes(self, toml, tiny_file, tiny_bundle, tmp_path):
        toml.write_text(toml.read_text().split("[training]")[0] + "[training]" + QUICK)
        arguments = ("train", toml, "--data", tiny_file, "-o", tmp_path / "b", "--no-progress")
        first = succeed(*arguments)
        digest = bundles.load(tmp_path / "b" / "bundle").digest
        assert first.stdout == f"{tmp_path}/b/bundle: sha256 {digest}\n"
        assert digest != tiny_bundle.digest  # it was trained for less long
        steps = ["data", "normals", "integers", "force", "bundle"]
        assert first.stderr.split() == [word for step in steps for word in (step, "running")]
        second = succeed(*arguments)
        assert second.stdout == first.stdout
        assert [line.split(maxsplit=1) for line in second.stderr.splitlines()] == [
            [step, "up to date"] for step in steps
        ]

    def test_a_recorded_scene_needs_data(self, toml, tmp_path):
        toml.write_text(
            toml.read_text()
            .replace(', "force_z"', "")
            .replace("[protocol]", 'source = "recorded"\n[protocol]')
        )
        message = fail("train", toml, "-o", tmp_path / "b")
        assert message == "scene tiny: sensor.source = 'recorded': give the recording with --data FILE"

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"channels": ("B", "G", "R")}, "channels = B,G,R: expected B,G,R,NIR (tiny)"),
            ({"pitch_mm": 0.2}, "pitch_mm = 0.2: expected 0.25 (tiny)"),
            ({"rows": 15}, "frames = 15 x 16 px: expected 16 x 16 px (tiny)"),
            ({"normals": None}, "normals: missing, and scene tiny trains the pixel network on them"),
            ({"force_n": None}, "force_n: missing, and scene tiny wants ('normals', 'depth', 'force_z')"),
        ],
    )
    def test_datasets_of_another_sensor(self, toml, tiny_data, tmp_path, changes, message):
        data = tiny_data
        if "channels" in changes:
            data = replace(data, frames=data.frames[..., :3], background=data.background[..., :3])
        if rows := changes.pop("rows", None):
            data = replace(
                data,
                frames=data.frames[:, :rows],
                background=data.background[:rows],
                normals=data.normals[:, :rows],
                depth_mm=data.depth_mm[:, :rows],
                rest_depth_mm=data.rest_depth_mm[:rows],
            )
        path = write(data, tmp_path / "d.h5", **changes)
        assert fail("train", toml, "--data", path, "-o", tmp_path / "b") == f"{path}: {message}"
        assert not (tmp_path / "b" / "bundle").exists()

    def test_files_that_are_no_datasets(self, toml, tmp_path):
        path = tmp_path / "d.h5"
        message = fail("train", toml, "--data", path, "-o", tmp_path / "b")
        assert str(path) in message
        assert "No such file" in message
        path.write_text("not HDF5")
        assert fail("train", toml, "--data", path, "-o", tmp_path / "b") == f"{path}: not an HDF5 file"


class TestEvaluate:
    def test_prints_and_writes_the_errors(self, tiny_folder, tiny_file, tmp_path):
        result = succeed(
            "evaluate", tiny_folder, "--data", tiny_file, "--json", tmp_path / "e.json", "--no-progress"
        )
        lines = result.stdout.splitlines()
        assert lines[0].startswith(f"{tiny_file}: 8 frames, simulated")
        stored = json.loads((tmp_path / "e.json").read_text())
        assert (stored["split"], stored["frames"]) == ("test", 8)
        printed = {line.split()[0]: line.split()[1:] for line in lines[2:]}
        for key, value in stored["float"].items():
            assert float(printed[key][0]) == pytest.approx(value, abs=1e-6)
            assert float(printed[key][1]) == pytest.approx(stored["integer"][key], abs=1e-6)
        assert printed["depth_mae_mm"][2].endswith("%")
        assert printed["gradient_saturated"] == ["0", "values"]

    @pytest.mark.parametrize(("split", "frames"), [("train", 18), ("validation", 8), ("all", 34)])
    def test_takes_the_split_it_is_given(self, tiny_folder, tiny_file, split, frames):
        result = succeed(
            "evaluate", tiny_folder / "bundle", "--data", tiny_file, "--split", split, "--no-progress"
        )
        assert f": {frames} frames, " in result.stdout

    def test_a_split_without_frames(self, tiny_folder, tiny_data, tmp_path):
        path = write(tiny_data, tmp_path / "d.h5", split=np.full(34, "train"))
        message = fail("evaluate", tiny_folder, "--data", path)
        assert message == f"{path}: split: no frame is in 'test'"


class TestPredict:
    @pytest.mark.parametrize("arithmetic", ["integer", "float"])
    def test_writes_what_the_scene_wants(
        self, tiny_folder, tiny_bundle, tiny_file, tiny_data, tmp_path, arithmetic
    ):
        more = ["--float"] if arithmetic == "float" else []
        output = tmp_path / "new" / "p.h5"
        result = succeed(
            "predict", tiny_folder, tiny_file, "--split", "test", "-o", output, "--no-progress", *more
        )
        assert result.stdout == f"{output}: depth_mm, force_n, normals of 8 frames\n"
        pipeline = (
            Emulator(tiny_bundle.pipeline)
            if arithmetic == "integer"
            else FloatPipeline.from_bundle(tiny_bundle)
        )
        index = tiny_data.indices("test")
        expected = pipeline.run(tiny_data.frames[index])
        with h5py.File(output) as file:
            assert dict(file.attrs) == {
                "bundle_sha256": tiny_bundle.digest,
                "arithmetic": arithmetic,
                "force_axes": "z",
                "pitch_mm": 0.25,
            }
            assert set(file) == {"frame_index", "normals", "depth_mm", "force_n"}
            np.testing.assert_array_equal(file["frame_index"][()], index)
            for name in ("normals", "depth_mm", "force_n"):
                assert file[name].dtype == np.float32
                np.testing.assert_array_equal(file[name][()], getattr(expected, name).astype(np.float32))
        assert [path.name for path in output.parent.iterdir()] == ["p.h5"]

    def test_float_and_integer_differ_and_agree(self, tiny_folder, tiny_file, tmp_path):
        found = {}
        for more in ([], ["--float"]):
            succeed("predict", tiny_folder, tiny_file, "-o", tmp_path / "p.h5", "--no-progress", *more)
            with h5py.File(tmp_path / "p.h5") as file:
                found[bool(more)] = file["depth_mm"][()]
        difference = np.abs(found[True] - found[False])
        assert difference.max() > 0
        assert difference.mean() < 0.003
        assert len(found[True]) == 34  # all splits, unless told otherwise

    @pytest.mark.parametrize(
        ("outputs", "written"),
        [
            (["normals"], {"normals"}),
            (["depth"], {"depth_mm"}),
            (["normals", "depth"], {"normals", "depth_mm"}),
        ],
    )
    def test_only_what_is_wanted(self, tiny_bundle, make_scene, tiny_file, tmp_path, outputs, written):

        trained = tiny_bundle.pipeline
        pipeline = assemble.assemble(
            make_scene(outputs=outputs),
            layers=trained.layers,
            background=trained.background,
            rest_depth_mm=trained.rest_depth_mm,
        )
        bundles.save(tmp_path / "b", pipeline, tiny_bundle.floats)
        succeed("predict", tmp_path / "b", tiny_file, "-o", tmp_path / "p.h5", "--no-progress")
        with h5py.File(tmp_path / "p.h5") as file:
            assert set(file) == {"frame_index"} | written

    def test_uses_the_recording_s_own_background(self, tiny_folder, tiny_data, tmp_path):
        """The same sensor on another day: everything 10 brighter changes nothing."""
        room = tiny_data.frames < 245
        data = replace(tiny_data, frames=np.where(room, tiny_data.frames, 244).astype(np.uint8))
        brighter = write(data, tmp_path / "b.h5", frames=data.frames + 10, background=data.background + 10)
        plain = write(data, tmp_path / "a.h5")
        forces = []
        for path in (plain, brighter):
            succeed("predict", tiny_folder, path, "-o", tmp_path / "p.h5", "--no-progress")
            with h5py.File(tmp_path / "p.h5") as file:
                forces.append(file["force_n"][()])
        np.testing.assert_array_equal(*forces)

    def test_unlabelled_frames_will_do(self, tiny_folder, tiny_data, tmp_path):
        path = write(
            tiny_data,
            tmp_path / "d.h5",
            normals=None,
            depth_mm=None,
            force_n=None,
            rest_depth_mm=None,
            indenter=None,
        )
        succeed("predict", tiny_folder, path, "-o", tmp_path / "p.h5", "--no-progress")

    def test_a_path_that_cannot_be_written_is_found_before_the_frames(
        self, tiny_folder, tiny_file, tmp_path, monkeypatch
    ):
        monkeypatch.setattr(Emulator, "run", lambda *_, **__: pytest.fail("frames were run"))
        (tmp_path / "file").write_text("")
        message = fail("predict", tiny_folder, tiny_file, "-o", tmp_path / "file" / "p.h5")
        assert str(tmp_path / "file") in message
        assert fail("predict", tiny_folder, tiny_file, "-o", tmp_path) == (
            f"{tmp_path}: is a folder; give the name of a file"
        )
        assert [path.name for path in tmp_path.iterdir()] == ["file"]

    def test_an_interruption_leaves_nothing(self, tiny_folder, tiny_file, tmp_path, monkeypatch):
        def interrupted(*_, **__):
            raise RuntimeError("interrupted")

        monkeypatch.setattr(Emulator, "run", interrupted)
        assert fail("predict", tiny_folder, tiny_file, "-o", tmp_path / "p.h5") == "interrupted"
        assert not [*tmp_path.iterdir()]

    def test_a_bundle_that_was_changed(self, tiny_folder, tiny_file, tmp_path):
        folder = shutil.copytree(tiny_folder / "bundle", tmp_path / "bundle")
        text = (folder / "bundle.json").read_text()
        (folder / "bundle.json").write_text(text.replace('"clock_mhz": 150.0', '"clock_mhz": 151.0'))
        message = fail("predict", folder, tiny_file, "-o", tmp_path / "p.h5")
        assert message.startswith(f"{folder}: sha256 = ")
        assert not (tmp_path / "p.h5").exists()

    def test_a_bundle_that_is_not_there_or_damaged(self, tiny_folder, tiny_file, tmp_path):
        message = fail("predict", tmp_path, tiny_file, "-o", tmp_path / "p.h5")
        assert message == f"{tmp_path}/bundle.json: no such file; is {tmp_path} a bundle folder?"
        folder = shutil.copytree(tiny_folder, tmp_path / "tiny")
        (folder / "bundle" / "integers.npz").write_bytes(b"PK")
        assert "integers.npz: not a readable archive" in fail(
            "predict", folder, tiny_file, "-o", tmp_path / "p.h5"
        )

    def test_channels_swapped_are_found(self, tiny_folder, tiny_data, tmp_path):
        path = write(tiny_data, tmp_path / "d.h5")
        with h5py.File(path, "a") as file:
            file.attrs["channels"] = "R,G,B,NIR"
        message = fail("predict", tiny_folder, path, "-o", tmp_path / "p.h5")
        assert message == f"{path}: channels = R,G,B,NIR: expected B,G,R or B,G,R,NIR"


VERIFIED = {
    "lanes": 2,
    "weights": "baked",
    "note": "",
    "stalls": False,
    "frames": 7,
    "values_compared": 50,
    "mismatches": 0,
    "first_mismatch": "",
    "cycles": 99,
}


class TestHardware:
    """As far as it goes without elaborating: the rest is tested with the gateware and the simulation."""

    def test_no_bundle_no_verilog(self, tmp_path):
        message = fail("verilog", tmp_path)
        assert "is a bundle folder?" in message.replace(f"{tmp_path} a", "a")
        assert not (tmp_path / "verilog").exists()

    def test_calibration_of_a_network_that_was_trained_anew(self, tiny_folder, tiny_bundle, tmp_path):
        pipeline = tiny_bundle.pipeline
        first = replace(pipeline.layers[0], bias=pipeline.layers[0].bias + 1)
        changed = pipeline.replace(layers=(first, *pipeline.layers[1:]))
        bundles.save(tmp_path / "new", changed, tiny_bundle.floats)
        output = tmp_path / "folder" / "new.bin"
        printed = succeed("calibration", tmp_path / "new", "--for", tiny_folder, "-o", output).output
        words = np.fromfile(output, "<u4")
        digest = bundles.load(tmp_path / "new").digest
        stated = f"{output}: {len(words)} words, layout {words[0]:#010x}, sha256 {digest}"
        assert printed.strip() == stated
        assert f"{words[-1]:08x}{words[-2]:08x}" == digest[:16]
        assert list(output.parent.iterdir()) == [output]

    def test_calibration_that_does_not_fit(self, tiny_folder, tiny_bundle, tmp_path):
        pipeline = tiny_bundle.pipeline
        force = replace(pipeline.force, kernel=-pipeline.force.kernel)
        bundles.save(tmp_path / "new", pipeline.replace(force=force, force_n_per_unit=None), {})
        message = fail("calibration", tmp_path / "new", "--for", tiny_folder, "-o", tmp_path / "new.bin")
        assert message.startswith("force.kernel: ")
        assert not (tmp_path / "new.bin").exists()
        # Unless the hardware's kernels are kept; what results is a bundle like any other.
        arguments = ("--for", tiny_folder, "-o", tmp_path / "new.bin", "--keep-force", tmp_path / "kept")
        succeed("calibration", tmp_path / "new", *arguments)
        kept, words = bundles.load(tmp_path / "kept"), np.fromfile(tmp_path / "new.bin", "<u4")
        assert f"{words[-1]:08x}{words[-2]:08x}" == kept.digest[:16]
        np.testing.assert_array_equal(kept.pipeline.force.kernel, pipeline.force.kernel)
        np.testing.assert_array_equal(kept.pipeline.force_n_per_unit, pipeline.force_n_per_unit)

    def test_no_verilog_no_simulation(self, tiny_folder, tiny_file, tmp_path):
        message = fail("sim", tiny_folder, "--data", tiny_file, "--verilog", tmp_path)
        assert message.startswith(f"{tmp_path}/hardware.json: ")
        assert message.endswith("no Verilog was written here")

    def test_verilog_of_another_bundle(self, tiny_folder, tiny_file, tmp_path):
        (tmp_path / "hardware.json").write_text(json.dumps({"bundle_sha256": "0" * 64}))
        message = fail("sim", tiny_folder, "--data", tiny_file, "--verilog", tmp_path)
        assert message.startswith(f"{tmp_path}: bundle_sha256 = {'0' * 16}…: the bundle's is ")

    @pytest.mark.parametrize(
        ("options", "frames", "trace"),
        [
            ((), 3, None),
            (("--trace", "saif"), 1, "saif"),
            (("--trace", "fst", "--frames", "2"), 2, "fst"),
        ],
    )
    def test_traces_are_of_one_frame_unless_told(
        self, tiny_folder, tiny_file, tiny_bundle, tmp_path, monkeypatch, options, frames, trace
    ):
        """What reaches the simulator; its traces are tested with it."""
        given = {}

        def simulate(bundle, source, images, result, folder, **settings):
            given.update(settings, frames=len(images), results=len(result.normals))
            return Simulated(len(images), 1, 0, "", {}, 0, 1)

        monkeypatch.setattr(hardware.simulation, "simulate", simulate)
        (tmp_path / "hardware.json").write_text(json.dumps({"bundle_sha256": tiny_bundle.digest}))
        arguments = ("--data", tiny_file, "--verilog", tmp_path, "-o", tmp_path / "sim", *options)
        result = succeed("sim", tiny_folder, *arguments)
        assert (given["frames"], given["results"], given["trace"]) == (frames, frames, trace)
        last = result.stdout.splitlines()[-1]
        assert last == (f"{tmp_path}/sim/fastac.{trace}" if trace else "}")

    @pytest.fixture
    def campaign(self, monkeypatch):
        """What `fastac verify` asks for; the campaign itself has tests of its own."""
        given = {}

        def run(bundle, data, index, lanes, folder, *, progress):
            given.update(digest=bundle.digest, index=index.tolist(), lanes=lanes, folder=folder)
            return {"rows": [VERIFIED | given.get("row", {})]}

        monkeypatch.setattr(verify, "run", run)
        return given

    def test_campaign(self, tiny_folder, tiny_file, tiny_bundle, campaign):
        options = ("--data", tiny_file, "--lanes", "2,1", "--frames", 3, "--split", "test", "--no-progress")
        result = succeed("verify", tiny_folder, *options)
        assert campaign["digest"] == tiny_bundle.digest
        assert campaign["lanes"] == (2, 1)
        assert len(campaign["index"]) == 3
        assert set(campaign["index"]) <= set(dataset.read(tiny_file).indices("test"))
        assert campaign["folder"] == tiny_folder / "verify"
        lines = result.stdout.splitlines()
        assert lines[0].split()[:2] == ["lanes", "weights"]
        assert lines[1].split() == ["2", "baked", "7", "50", "0", "99"]
        assert lines[2] == str(tiny_folder / "verify" / "verify.json")

    def test_campaign_that_finds_something(self, tiny_folder, tiny_file, campaign, tmp_path):
        campaign["row"] = {"mismatches": 3, "first_mismatch": "depth: value 7"}
        message = fail("verify", tiny_folder, "--data", tiny_file, "-o", tmp_path)
        assert message == "3 mismatches; depth: value 7"
        assert campaign["lanes"] == (1, 2, 4)

    def test_campaign_of_a_scene_builds_its_bundle(self, campaign, monkeypatch, tmp_path, tiny_folder, toml):
        """In the build folder, whose dataset then serves."""
        monkeypatch.chdir(tmp_path)
        built = []

        def build(scene, folder, data, progress, until):
            built.append((scene.name, until))
            shutil.copytree(tiny_folder, folder)

        monkeypatch.setattr("fastac.cli_verify.run_build", build)
        message = fail("verify", toml)
        assert built == [("tiny", "bundle")]
        assert message.startswith("build/tiny/data.h5: ")
        assert campaign == {}

    def test_no_results_no_report(self, tiny_folder, tiny_file, tmp_path):
        folder = shutil.copytree(tiny_folder, tmp_path / "tiny")
        assert "accuracy.json" in fail("report", folder, "--data", tiny_file)
        assert fail("report", folder) == f"{folder}/data.h5: no such file"


def test_report_prints_the_summary(tiny_folder, tiny_file, tmp_path):
    folder = shutil.copytree(tiny_folder, tmp_path / "tiny")
    (folder / "verilog").mkdir()
    (folder / "verilog" / "hardware.json").write_text(
        json.dumps({"latency_cycles_by_formula": {"stage": {"normals": 10}}, "multipliers": {"normals": 10}})
    )
    (folder / "accuracy.json").write_text(
        json.dumps({"frames": 8, "float": {}, "integer": {}, "growth_percent": {}, "saturated_values": {}})
    )
    simulated = {"frames": 2, "values_compared": 50_000, "mismatches": 0, "frame_indices": [30, 33]}
    simulated |= {"values_by_output": {}, "markers_compared": 0, "errors": 0}
    simulated["latency_cycles"] = {"first_pixel_to_force": 1234}
    (folder / "sim.json").write_text(json.dumps(simulated))
    lines = succeed("report", folder, "--data", tiny_file).stdout.splitlines()
    cells = [re.split(r"\s{2,}", line) for line in lines]
    assert cells[0] == ["", "here", "paper"]
    assert cells[1][0] == "RTL against integer model"
    assert "0 mismatches in 50,000 values, 2 frames" in cells[1][1]
    assert any(line[1:] == ["1,234", "about 163,500"] for line in cells)
    assert lines[-1] == str(folder / "report.html")
    assert (folder / "report.json").exists()


@pytest.fixture
def spec(toml, tmp_path):
    path = tmp_path / "spec.toml"
    quick = toml.read_text().replace("normals_epochs = 15", "normals_epochs = 1")
    toml.write_text(quick.replace("force_epochs = 5", "force_epochs = 1"))
    path.write_text('scene = "tiny.toml"\nframes = 2\n[axes]\n"numbers.data_bits" = [16, 26]\n')
    return path


def test_sweep_and_trade(spec, toml, tiny_file, tmp_path, monkeypatch):
    for name in pools.THREAD_VARIABLES:
        monkeypatch.setenv(name, "1")
    one_thread = pools.Pool(
        lambda: ThreadPoolExecutor(1), 1
    )  # processes take longer to start than this takes
    monkeypatch.setattr(sweeps, "local_pool", lambda workers: nullcontext(one_thread))
    spec.write_text(f'data = "{tiny_file}"\n{spec.read_text()}')
    results, page = tmp_path / "r.sqlite", tmp_path / "page"
    sweep = ("sweep", spec, "-o", results, "--cache", tmp_path / "cache", "--workers", 1, "--no-progress")
    assert succeed(*sweep).output == f"{results}: 2 done, 0 infeasible, 0 failed, 0 known\n"
    assert "2 known" in succeed(*sweep).output
    trade = ("trade", results, "-o", page, "--mark", toml, "--no-progress")
    found = succeed(*trade, "--pick", "depth_mae_mm<1, dsp<1000", "--by", "depth_mae_mm").output
    assert "To go 2× faster costs this much: depth error, mm" in found
    assert str(page / "trade.html") in found
    assert scenes.load(page / "picked.toml").numbers.data_bits in (16, 26)
    assert "scene tiny" in (page / "trade.html").read_text()
    assert "no such metric; there are" in fail(*trade, "--pick", "size<3")


def test_sweeps_that_cannot_start(spec, toml, tmp_path):
    assert "spec.toml: frame: unknown key" in fail("sweep", edited(spec, "frames", "frame"))
    assert (
        run("sweep", edited(spec, "frame =", "frames ="), "--workers", 1, "--scheduler", "x").exit_code == 2
    )
    toml.write_text(toml.read_text().replace('channels = "bgr+nir"', 'channels = "bgr"\nsource = "recorded"'))
    result = run("sweep", spec)
    assert result.exit_code == 2
    assert "data: missing" in result.output
    assert "no such file" in fail("trade", tmp_path / "none.sqlite")


def edited(path, old, new):
    path.write_text(path.read_text().replace(old, new))
    return path


def test_scope(toml, tmp_path):
    found = succeed("scope", toml, "--builds", tmp_path).output
    assert found.startswith("| | tiny |\n")
    assert "| force model | kernels 5×5 |" in found
