"""The Python interface: what it finds is the pipelines' own, in both arithmetics, and errors are one line."""

import subprocess
import sys
from dataclasses import fields, replace

import numpy as np
import pytest

import fastac
from fastac.models import accuracy
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer.frame_validity import REASONS
from fastac.models.random_bundle import random_bundle
from fastac.models.result import Result
from fastac.models.vision.image_processing import as_channels


@pytest.fixture(scope="module")
def sensor(tiny_folder):
    return fastac.load(tiny_folder)


@pytest.fixture(scope="module")
def raw_sensor(sensor):
    """The same models on the RAW10 frames of another camera."""
    scene = sensor.scene
    raw = scene.model_copy(update={"sensor": scene.sensor.model_copy(update={"frames": "raw10"})})
    return replace(sensor, bundle=replace(sensor.bundle, pipeline=sensor.bundle.pipeline.replace(scene=raw)))


@pytest.fixture(scope="module")
def raw_frames() -> np.ndarray:
    return np.random.default_rng(1).integers(64, 1023, (3, 64, 64), np.uint16, endpoint=True)


def names(result: Result) -> list[str]:
    return [field.name for field in fields(Result) if getattr(result, field.name) is not None]


class TestLoad:
    def test_a_build_folder_or_its_bundle(self, tiny_folder, tiny_bundle):
        for path in (tiny_folder, str(tiny_folder), tiny_folder / "bundle"):
            sensor = fastac.load(path)
            assert sensor.digest == tiny_bundle.digest
            assert sensor.scene == tiny_bundle.scene
            np.testing.assert_array_equal(sensor.background, tiny_bundle.pipeline.background)

    def test_no_folder(self, tmp_path):
        with pytest.raises(fastac.BundleError, match=r"^\S+: no such file; is \S+ a bundle folder\?$"):
            fastac.load(tmp_path / "none")

    def test_outputs_have_units_and_forces_have_axes(self, sensor):
        assert sensor.outputs == {"normals": "1", "depth_mm": "mm", "force_n": "N"}
        assert sensor.force_axes == ("z",)


class TestRun:
    @pytest.mark.parametrize("arithmetic", ["integer", "float"])
    def test_every_field_is_the_pipeline_s(self, sensor, tiny_bundle, tiny_data, arithmetic):
        pipeline = (
            Emulator(tiny_bundle.pipeline)
            if arithmetic == "integer"
            else FloatPipeline.from_bundle(tiny_bundle)
        )
        expected = pipeline.run(tiny_data.frames)
        found = sensor.run(tiny_data.frames, arithmetic=arithmetic, outputs=pipeline.outputs)
        assert names(found) == names(expected) == [name for name in names(found) if name in pipeline.outputs]
        for name in names(expected):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        assert found.force_axes == ("z",)

    def test_by_default_what_the_scene_lists_and_the_flags(self, sensor, tiny_data):
        flags = {"gradient_saturated", "displacement_saturated", "validity"}
        assert set(names(sensor.run(tiny_data.frames[:2]))) == {*sensor.outputs} | flags
        assert set(names(sensor.run(tiny_data.frames[:2], arithmetic="float"))) == {*sensor.outputs}

    def test_only_what_is_asked_for(self, sensor, tiny_data):
        assert names(sensor.run(tiny_data.frames, outputs=["force_n"])) == ["force_n"]

    def test_one_frame_has_no_axis_of_frames(self, sensor, tiny_data):
        one, several = sensor.run(tiny_data.frames[5]), sensor.run(tiny_data.frames[5:6])
        assert one.depth_mm.shape == (16, 16)
        assert one.force_n.shape == (1,)
        for name in names(several):
            np.testing.assert_array_equal(getattr(one, name), getattr(several, name)[0])

    def test_a_force_map_and_three_axes(self, make_scene, tmp_path):
        scene = make_scene(outputs=["force_xyz", "force_map"])
        random_bundle(tmp_path, scene)
        sensor = fastac.load(tmp_path)
        assert sensor.outputs == {"force_n": "N", "force_map_n": "N"}
        found = sensor.run(sensor.background)
        assert found.force_axes == ("x", "y", "z")
        assert found.force_n.shape == (3,)
        assert found.force_map_n.shape == (3, 14, 14)


class TestReasons:
    def test_of_one_frame_and_of_several(self, sensor, tiny_data):
        good = tiny_data.frames[tiny_data.indices("train")[0]]  # the limits are around the train frames
        dark = np.zeros_like(good)
        assert sensor.run(good).reasons == ()
        assert {"clipped", "brightness_b", "detail"} <= set(sensor.run(dark).reasons)
        both = sensor.run(np.stack([good, dark])).reasons
        assert both == [(), sensor.run(dark).reasons]

    @pytest.mark.parametrize("bit", range(len(REASONS)))
    def test_each_bit_has_its_name(self, bit):
        assert fastac.Measurement(validity=np.int64(1 << bit)).reasons == (REASONS[bit],)

    def test_floats_do_not_judge(self, sensor, tiny_data):
        found = sensor.run(tiny_data.background, arithmetic="float")
        with pytest.raises(ValueError, match=r"^reasons: validity is unknown; run with arithmetic='int"):
            _ = found.reasons


class TestStream:
    @pytest.mark.parametrize("arithmetic", ["integer", "float"])
    def test_equals_the_batch(self, sensor, tiny_data, arithmetic):
        frames = tiny_data.frames[:5]
        batch = sensor.run(frames, arithmetic=arithmetic)
        streamed = list(sensor.stream(iter(frames), arithmetic=arithmetic))
        assert len(streamed) == 5
        for k, found in enumerate(streamed):
            assert names(found) == names(batch)
            for name in names(batch):
                np.testing.assert_array_equal(getattr(found, name), getattr(batch, name)[k])

    def test_answers_before_it_asks_for_the_next_frame(self, sensor, tiny_data):
        given = []

        def camera():
            for frame in tiny_data.frames[:3]:
                given.append(frame)
                yield frame

        found = sensor.stream(camera(), outputs=iter(["force_n"]))
        for count in (1, 2, 3):
            assert names(next(found)) == ["force_n"]
            assert len(given) == count

    def test_no_frame(self, sensor):
        assert list(sensor.stream([])) == []

    def test_wants_single_frames(self, sensor, tiny_data):
        with pytest.raises(ValueError, match=r"^frame \(1, 16, 16, 4\): expected \(16, 16, 4\) uint8$"):
            next(sensor.stream([tiny_data.frames[:1]]))


class TestBackground:
    def test_a_recording_is_seen_against_its_own(self, sensor, tiny_data):
        shifted = np.minimum(tiny_data.frames, 245) + 10
        plain = np.minimum(tiny_data.frames, 245)
        moved = sensor.with_background(tiny_data.background + 10)
        assert moved.digest == sensor.digest
        for arithmetic in ("integer", "float"):
            found = moved.run(shifted, arithmetic=arithmetic, outputs=["force_n"])
            expected = sensor.run(plain, arithmetic=arithmetic, outputs=["force_n"])
            np.testing.assert_array_equal(found.force_n, expected.force_n)

    def test_of_another_size(self, sensor, tiny_data):
        expected = r"^frames \(15, 16, 4\) uint8: expected \(16, 16, 4\) uint8$"
        with pytest.raises(ValueError, match=expected):
            sensor.with_background(tiny_data.background[1:])


class TestRaw10:
    def test_images_are_processed_first(self, raw_sensor, raw_frames):
        frames = np.stack([as_channels(raw, raw_sensor.scene.sensor) for raw in raw_frames])
        expected = raw_sensor.run(frames)
        for name in names(expected):
            np.testing.assert_array_equal(getattr(raw_sensor.run(raw_frames), name), getattr(expected, name))
            np.testing.assert_array_equal(
                getattr(raw_sensor.run(raw_frames[1]), name), getattr(expected, name)[1]
            )
        (streamed,) = raw_sensor.stream(raw_frames[:1])
        np.testing.assert_array_equal(streamed.depth_mm, expected.depth_mm[0])

    def test_so_is_a_background(self, raw_sensor, raw_frames):
        found = raw_sensor.with_background(raw_frames[0]).background
        np.testing.assert_array_equal(found, as_channels(raw_frames[0], raw_sensor.scene.sensor))

    def test_of_another_size(self, raw_sensor, raw_frames):
        expected = r"^frames \(3, 32, 64\) uint16: expected \(16, 16, 4\) uint8 or \(64, 64\) uint16 each$"
        with pytest.raises(ValueError, match=expected):
            raw_sensor.run(raw_frames[:, ::2])

    def test_not_where_frames_are_channels(self, sensor, raw_frames):
        with pytest.raises(ValueError, match=r"^frames \(3, 64, 64\) uint16: expected \(16, 16, 4\) uint8$"):
            sensor.run(raw_frames)


class TestErrors:
    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda f: f[:, :15], r"frames (34, 15, 16, 4) uint8: expected (16, 16, 4) uint8 each"),
            (lambda f: f[..., :3], r"frames (34, 16, 16, 3) uint8: expected (16, 16, 4) uint8 each"),
            (lambda f: f / 255, r"frames (34, 16, 16, 4) float64: expected (16, 16, 4) uint8 each"),
            (lambda f: f[0, 0], r"frames (16, 4) uint8: expected (16, 16, 4) uint8 each"),
            (lambda f: f[:0], r"frames: none to process"),
        ],
    )
    def test_frames_that_do_not_fit(self, sensor, tiny_data, change, message):
        for arithmetic in ("integer", "float"):
            with pytest.raises(ValueError) as error:  # noqa: PT011
                sensor.run(change(tiny_data.frames), arithmetic=arithmetic)
            assert str(error.value) == message

    def test_an_output_that_there_is_not(self, sensor, tiny_data):
        with pytest.raises(
            ValueError, match=r"^outputs: 'force_map_n': expected some of normals, slopes, .*"
        ):
            sensor.run(tiny_data.frames, outputs=["force_map_n"])
        with pytest.raises(ValueError, match=r"^outputs: 'validity': expected some of normals, .*force_n$"):
            sensor.run(tiny_data.frames, arithmetic="float", outputs=["validity"])

    def test_an_arithmetic_that_there_is_not(self, sensor, tiny_data):
        with pytest.raises(ValueError, match=r"^arithmetic = 'int8': expected 'integer' or 'float'$"):
            sensor.run(tiny_data.frames, arithmetic="int8")


class TestDatasets:
    def test_read_and_errors_are_those_of_the_models(self, sensor, tiny_bundle, tiny_file, tiny_data):
        data = sensor.read(tiny_file)
        np.testing.assert_array_equal(data.frames, tiny_data.frames)
        index = data.indices("test")
        assert (
            sensor.errors(data, index)
            == accuracy.compare_pipelines(tiny_bundle, data, index, progress=False)[0]
        )


class TestLazyImport:
    def run(self, code: str) -> str:
        command = [sys.executable, "-c", code]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    def test_the_package_alone_loads_nothing(self):
        heavy = "{'numpy', 'torch', 'numba', 'h5py', 'pydantic', 'click'} & set(sys.modules)"
        assert self.run(f"import sys, fastac; dir(fastac); print({heavy})") == "set()"

    def test_the_interface_comes_with_its_first_name_without_torch(self):
        code = "import sys, fastac; fastac.load; print('fastac.api' in sys.modules, 'torch' in sys.modules)"
        assert self.run(code) == "True False"

    def test_the_hardware_loads_no_trainer_and_no_plots(self):
        heavy = "{'torch', 'numba', 'matplotlib', 'h5py', 'fastac.api'} & set(sys.modules)"
        assert self.run(f"import sys, fastac.gateware.top_zynq; print({heavy})") == "set()"

    def test_names_are_listed_and_others_refused(self):
        assert set(fastac.__all__) <= set(dir(fastac))
        for name in fastac.__all__:
            assert getattr(fastac, name) is not None
        with pytest.raises(AttributeError, match="module 'fastac' has no attribute 'unheard_of'"):
            _ = fastac.unheard_of
