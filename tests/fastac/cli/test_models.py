import json
import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
from command_line import fail, succeed

from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer import assemble
from fastac.models.integer import bundle as bundles
from fastac.sensor import dataset


def write(data, path, **changes):
    dataset.write(path, **{**vars(data), **changes})
    return path


QUICK = """
normals_epochs = 1
finetune_epochs = 1
force_epochs = 1
"""


class TestTrain:
    def test_writes_the_bundle_and_resumes(self, toml, tiny_file, tiny_bundle, tmp_path):
        toml.write_text(toml.read_text().split("[training]")[0] + "[training]" + QUICK)
        arguments = ("train", toml, "--data", tiny_file, "-o", tmp_path / "b", "--no-progress")
        first = succeed(*arguments)
        digest = bundles.load(tmp_path / "b" / "bundle").digest
        assert first.stdout == f"{tmp_path}/b/bundle: sha256 {digest}\n"
        assert digest != tiny_bundle.digest  # it was trained for less long
        steps = ["normals", "integers", "force", "bundle"]
        assert first.stderr.split() == [word for step in steps for word in (step, "running")]
        second = succeed(*arguments)
        assert second.stdout == first.stdout
        assert [line.split(maxsplit=1) for line in second.stderr.splitlines()] == [
            [step, "up to date"] for step in steps
        ]

    def test_another_seed_has_a_folder_of_its_own(self, toml, tiny_file, tiny_bundle, tmp_path, monkeypatch):
        toml.write_text(toml.read_text().split("[training]")[0] + "[training]" + QUICK)
        monkeypatch.chdir(tmp_path)
        found = succeed("train", toml, "--data", tiny_file, "--seed", 7, "--no-progress")
        name = f"build/{tiny_bundle.scene.name}-seed-7"
        assert found.stdout.startswith(f"{name}/bundle: sha256 ")
        assert bundles.load(tmp_path / name / "bundle").scene.training.seed == 7

    def test_a_recorded_scene_needs_data(self, toml, tmp_path):
        toml.write_text(
            toml.read_text()
            .replace(', "force_z"', "")
            .replace("[protocol]", 'source = "recorded"\n[protocol]')
        )
        message = fail("train", toml, "-o", tmp_path / "b")
        assert message == "scene tiny: sensor.source = 'recorded': give the recording with --data FILE"

    def test_a_recorded_scene_has_the_size_and_the_pitch_of_its_recording(self, toml, tiny_data, tmp_path):
        toml.write_text(toml.read_text().replace("[protocol]", 'source = "recorded"\n[protocol]'))
        path = write(tiny_data, tmp_path / "d.h5", pitch_mm=0.2)
        found = succeed("build", toml, "--data", path, "-o", tmp_path / "b", "--why")
        assert found.stderr == f"scene tiny: as {path} was recorded, sensor.pitch_mm = 0.2 instead of 0.25\n"

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
        assert "integers.npz: damaged or no .npz file" in fail(
            "predict", folder, tiny_file, "-o", tmp_path / "p.h5"
        )

    def test_channels_swapped_are_found(self, tiny_folder, tiny_data, tmp_path):
        path = write(tiny_data, tmp_path / "d.h5")
        with h5py.File(path, "a") as file:
            file.attrs["channels"] = "R,G,B,NIR"
        message = fail("predict", tiny_folder, path, "-o", tmp_path / "p.h5")
        assert message == f"{path}: channels = R,G,B,NIR: expected B,G,R or B,G,R,NIR"
