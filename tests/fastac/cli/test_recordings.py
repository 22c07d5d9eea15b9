import numpy as np
import pytest
from command_line import fail, run, succeed
from PIL import Image

from fastac.sensor import dataset


class TestMachine:
    def test_a_simulated_recording_comes_back_as_a_dataset(self, toml, tmp_path, one_process):
        text = toml.read_text().replace("train_grid = 3", "train_grid = 1")
        gel = 'thickness_mm = 2.0, mechanics = "fem", elements = 8, layers = 1 }'
        toml.write_text(text.replace("thickness_mm = 2.0 }", gel))
        options = ("--origin-mm", 10, 20, -5, "--store", tmp_path / "cache", "--no-progress")
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

    def test_several_recordings_become_one(self, arguments, tmp_path):
        command, kind, source, *options = arguments
        (tmp_path / "g.csv").write_text((tmp_path / "f.csv").read_text())
        both = (command, kind, source, source, *options, "--forces", tmp_path / "g.csv")
        assert "8 frames" in succeed(*both).stdout
        result = run(command, kind, source, source, *options)
        assert result.exit_code == 2
        assert "--forces: given 1 times: expected once for each of 2 recordings" in result.stderr

    def test_errors(self, arguments, tmp_path):
        assert fail(*arguments, "--held-out", "pen").endswith(
            "f.csv: group 'pen': expected one of cup, ball, nut"
        )
        (tmp_path / "f.csv").write_text("frame,force_z_n,group\n0,0,cup\n1,none,cup\n")
        assert fail(*arguments).endswith("f.csv, line 3: force_z_n = 'none': expected a number")
        assert run(*arguments, "--background-frames", 0).exit_code == 2
