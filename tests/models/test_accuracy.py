"""Accuracy figures against values worked out by hand."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fastac.models import accuracy
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.result import Result
from fastac.sensor.dataset import Dataset

SIZE = 20
FLAT = (0.0, 0.0, 1.0)
TILTED = (-0.6, 0.0, 0.8)  # p = 0.75, q = 0


def dataset(count: int = 2, **parts) -> Dataset:
    frames = np.zeros((count, SIZE, SIZE, 3), np.uint8)
    return Dataset(
        pitch_mm=0.1,
        channels=("B", "G", "R"),
        source="made up",
        background=frames[0],
        frames=frames,
        split=np.full(count, "test"),
        **parts,
    )


def filled(value, count: int = 2) -> np.ndarray:
    return np.broadcast_to(np.float32(value), (count, SIZE, SIZE, np.size(value))).copy()


def result(normal, slopes, count: int = 2, **parts) -> Result:
    return Result(normals=filled(normal, count), slopes=filled(slopes, count), **parts)


class TestNormals:
    def test_by_hand(self):
        data = dataset(normals=filled(TILTED))
        found = accuracy.normals(result(FLAT, (0.5, -0.125)), data, np.arange(2), 0.2)
        assert found == {
            "gradient_x_mae_mm_per_px": pytest.approx(0.25 * 0.2, rel=1e-5),
            "gradient_y_mae_mm_per_px": pytest.approx(0.125 * 0.2, rel=1e-5),
            "gradient_mae_mm_per_px": pytest.approx(0.375 * 0.2, rel=1e-5),
            "normal_mae_deg": pytest.approx(np.degrees(np.arccos(0.8)), rel=1e-5),
        }

    def test_perfect(self):
        data = dataset(normals=filled(TILTED))
        found = accuracy.normals(result(TILTED, (0.75, 0)), data, np.arange(2), 0.2)
        assert max(found.values()) < 0.03  # arccos of a float32 close to 1

    def test_pixels_that_are_not_valid_do_not_count(self):
        normals = filled(TILTED)
        valid = np.zeros((2, SIZE, SIZE), bool)
        valid[0, :5] = True
        normals[~valid] = np.nan
        predicted = result(FLAT, (0.75, 0.0))
        predicted.slopes[0, 0] += 1  # one row of the five
        predicted.slopes[1] += 100
        found = accuracy.normals(predicted, dataset(normals=normals, valid=valid), np.arange(2), 1.0)
        assert found["gradient_mae_mm_per_px"] == pytest.approx(2 / 5, rel=1e-5)

    def test_takes_the_truth_of_the_frames_it_is_given(self):
        normals = np.concatenate([filled(FLAT), filled(TILTED)])
        found = accuracy.normals(result(FLAT, (0, 0)), dataset(4, normals=normals), np.array([3, 0]), 1.0)
        assert found["gradient_x_mae_mm_per_px"] == pytest.approx(0.375, rel=1e-5)


class TestContactAngle:
    @staticmethod
    def labelled(radius: float, scale: float = 2.0, count: int = 2) -> Dataset:
        return dataset(
            count,
            normals=filled(TILTED, count),
            indenter={
                "center_px": np.full((count, 2), [9.0, 6.0]),
                "radius_px": np.full(count, float(radius)),
                "scale": np.full(count, scale),
            },
        )

    def test_by_hand(self):
        """|atan(0.25 − 0.05) − atan(0.75)| and |atan(0.1 + 0.3) − 0|, averaged."""
        rest = result(FLAT, (0.05, -0.3), 1)
        found = accuracy.contact_gradient_angle_rad(
            result(FLAT, (0.25, 0.1)), rest, self.labelled(8), np.arange(2)
        )
        assert found == pytest.approx((np.arctan(0.75) - np.arctan(0.2) + np.arctan(0.4)) / 2, rel=1e-5)

    def test_counts_only_the_circle_less_its_rim(self):
        """Radius 5 px less 4 original pixels at 2 per px leaves 3 px around (u, v) = (9, 6)."""
        rest = result(FLAT, (0, 0), 1)
        predicted = result(TILTED, (0.75, 0))
        v, u = np.indices((SIZE, SIZE))
        inside = np.hypot(u - 9, v - 6) <= 3
        predicted.slopes[:, ~inside] = 50
        assert accuracy.contact_gradient_angle_rad(predicted, rest, self.labelled(5), np.arange(2)) < 1e-6
        predicted.slopes[0, 6, 12] = (0, 0)  # on the edge, in one of two images
        expected = np.arctan(0.75) / 2 / inside.sum() / 2
        found = accuracy.contact_gradient_angle_rad(predicted, rest, self.labelled(5), np.arange(2))
        assert found == pytest.approx(expected, rel=1e-4)

    def test_images_without_a_circle_or_with_nothing_in_it_do_not_count(self):
        data = self.labelled(8, count=3)
        data.indenter["radius_px"][0] = np.nan
        data.indenter["radius_px"][1] = 1.5  # smaller than the rim
        rest = result(FLAT, (0, 0), 1)
        predicted = result(FLAT, (0, 0), 3)
        found = accuracy.contact_gradient_angle_rad(predicted, rest, data, np.arange(3))
        assert found == pytest.approx(np.arctan(0.75) / 2, rel=1e-5)
        assert accuracy.contact_gradient_angle_rad(predicted, rest, data, np.array([0, 1])) is None

    def test_no_circles_no_figure(self):
        rest = result(FLAT, (0, 0), 1)
        assert (
            accuracy.contact_gradient_angle_rad(result(FLAT, (0, 0)), rest, dataset(), np.arange(2)) is None
        )
        poses = dataset(indenter={"x_mm": np.zeros(2)})
        assert accuracy.contact_gradient_angle_rad(result(FLAT, (0, 0)), rest, poses, np.arange(2)) is None


class TestContactDepth:
    @staticmethod
    def pressed(radius: float = 6.0) -> tuple[Dataset, np.ndarray]:
        """Two presses of a ball of 8 mm at a pitch of 0.5 mm, and the exact depth up to a constant."""
        data = TestContactAngle.labelled(radius)
        data.indenter["ball_mm"] = np.full(2, 8.0)
        v, u = np.indices((SIZE, SIZE))
        r = 0.5 * np.hypot(u - 9, v - 6)
        return data, np.stack([7 - np.sqrt(np.maximum(16 - r**2, 0))] * 2)

    def of(self, depth_mm: np.ndarray, data: Dataset) -> float | None:
        return accuracy.contact_depth_mae_mm(Result(None, None, depth_mm=depth_mm), data, np.arange(2), 0.5)

    def test_the_ball_s_own_shape_at_any_height(self):
        data, depth = self.pressed()
        assert self.of(depth, data) < 1e-12
        depth[1] -= 3
        assert self.of(depth, data) < 1e-12

    def test_by_hand(self):
        """A radius of 3.1 px less 2 leaves five pixels; one of them 1 mm too high, in one of two images."""
        data, depth = self.pressed(3.1)
        depth[0, 6, 9] += 1
        assert self.of(depth, data) == pytest.approx((0.8 + 4 * 0.2) / 5 / 2)
        depth[0, 0, 0] = 99  # outside
        assert self.of(depth, data) == pytest.approx(0.16)

    def test_circles_beyond_the_photograph_do_not_count(self):
        data, depth = self.pressed(3.1)
        depth[0, 6, 9] += 1
        data.indenter["center_px"][0] = (2, 6)
        assert self.of(depth, data) < 1e-12
        data.indenter["center_px"][1] = (9, 3)
        assert self.of(depth, data) is not None
        data.indenter["center_px"][1] = (9, 2)
        assert self.of(depth, data) is None

    def test_no_ball_no_figure(self):
        data, depth = self.pressed()
        del data.indenter["ball_mm"]
        assert self.of(depth, data) is None
        assert self.of(depth, dataset()) is None


class TestDepth:
    def test_leaves_out_the_boundary_and_what_is_not_valid(self):
        truth = np.zeros((2, SIZE, SIZE), np.float32)
        found = np.full_like(truth, 7)  # the boundary and the invalid rest
        found[:, 1:-1, 1:-1] = 0.5
        found[1, 1:-1, 1:-1] = -0.25
        depth = Result(None, None, depth_mm=found)
        assert accuracy.depth_mae_mm(depth, dataset(depth_mm=truth), np.arange(2)) == pytest.approx(0.375)
        valid = np.zeros((2, SIZE, SIZE), bool)
        valid[0] = True
        truth[1] = np.nan
        data = dataset(depth_mm=truth, valid=valid)
        assert accuracy.depth_mae_mm(depth, data, np.arange(2)) == pytest.approx(0.5)


class TestForce:
    loads = np.array([(9, 9, 1), (9, 9, 2), (9, 9, 3), (9, 9, 2)], np.float32)

    def test_by_hand(self):
        """Errors 0.1, −0.1, 0.3 and 0.1 N at loads of 1, 2, 3 and 2 N."""
        predicted = Result(None, None, force_n=np.array([[1.1], [1.9], [3.3], [2.1]]))
        found = accuracy.force(predicted, dataset(4, force_n=self.loads), np.arange(4), (2,))
        assert found == {
            "force_mae_n": pytest.approx(0.15),
            "force_rmse_n": pytest.approx(np.sqrt(0.12 / 4)),
            "force_nmae_percent": pytest.approx(5.0),
            "force_r2": pytest.approx(1 - 0.12 / 2),
        }

    def test_equal_loads_have_no_r2(self):
        predicted = Result(None, None, force_n=np.array([[2.2], [2.0]]))
        found = accuracy.force(predicted, dataset(4, force_n=self.loads), np.array([1, 3]), (2,))
        assert found["force_nmae_percent"] == pytest.approx(5.0)
        assert "force_r2" not in found

    def test_no_load_has_nothing_to_be_compared_with(self):
        predicted = Result(None, None, force_n=np.array([[0.2], [-0.1]]))
        found = accuracy.force(predicted, dataset(force_n=np.zeros((2, 3), np.float32)), np.arange(2), (2,))
        assert found == {"force_mae_n": pytest.approx(0.15), "force_rmse_n": pytest.approx(0.025**0.5)}


class TestEvaluate:
    truth = dataset(
        normals=filled(TILTED),
        depth_mm=np.zeros((2, SIZE, SIZE), np.float32),
        force_n=np.array([(0, 0, 1), (0, 0, 2)], np.float32),
        indenter=TestContactAngle.labelled(8).indenter,
    )
    rest = result(FLAT, (0, 0), 1)
    NORMALS = frozenset(
        (
            "gradient_x_mae_mm_per_px",
            "gradient_y_mae_mm_per_px",
            "gradient_mae_mm_per_px",
            "normal_mae_deg",
            "contact_gradient_angle_mae_rad",
        )
    )
    FORCE = frozenset(("force_mae_n", "force_rmse_n", "force_nmae_percent", "force_r2"))

    def keys(self, predicted: Result, data: Dataset, scene) -> set[str]:
        found = accuracy.evaluate(predicted, self.rest, data, np.arange(2), scene)
        assert np.isfinite(list(found.values())).all()
        return set(found)

    def test_everything_that_is_known_and_found(self, tiny_scene):
        depth = np.ones((2, SIZE, SIZE), np.float32)
        everything = result(FLAT, (0, 0), depth_mm=depth, force_n=np.ones((2, 1)))
        assert self.keys(everything, self.truth, tiny_scene) == self.NORMALS | {"depth_mae_mm"} | self.FORCE
        assert self.keys(result(FLAT, (0, 0)), self.truth, tiny_scene) == self.NORMALS
        unknown = replace(self.truth, normals=None, depth_mm=None)
        assert self.keys(everything, unknown, tiny_scene) == self.FORCE

    @pytest.mark.parametrize("key", ["force_steps", "force_weight"])
    def test_what_learns_a_force_of_slopes_finds_no_normals(self, make_scene, key):
        settings = {
            "outputs": ["force_z"],
            "poisson": {"solver": "adjoint"},
            "force": {"fit": "slopes", "clamp": False},
        }
        scenes = (make_scene(**settings, training={key: value}) for value in (0, 3))
        found = result(FLAT, (0, 0), force_n=np.ones((2, 1)))
        keys = [self.keys(found, self.truth, scene) for scene in scenes]
        assert keys == [self.NORMALS | self.FORCE, self.FORCE]

    def test_frames_of_which_nothing_is_known(self, tiny_scene):
        depth = np.ones((2, SIZE, SIZE), np.float32)
        nowhere = replace(self.truth, valid=np.zeros((2, SIZE, SIZE), bool))
        assert self.keys(result(FLAT, (0, 0), depth_mm=depth), nowhere, tiny_scene) == set()

    def test_gradients_are_in_the_scene_s_pitch(self, tiny_scene):
        found = accuracy.evaluate(result(FLAT, (0, 0)), self.rest, self.truth, np.arange(2), tiny_scene)
        assert found["gradient_x_mae_mm_per_px"] == pytest.approx(0.75 * 0.25, rel=1e-5)


def test_each_recording_is_seen_against_its_own_rest(tiny_bundle, tiny_data):
    brighter = replace(tiny_data, background=tiny_data.background + 5)
    pipeline = accuracy.with_background_of(tiny_bundle.pipeline, brighter)
    np.testing.assert_array_equal(pipeline.pipeline.background, tiny_data.background + 5)
    assert pipeline.pipeline.layers is tiny_bundle.pipeline.layers


def test_compare_runs_both_pipelines_on_the_same_frames(tiny_bundle, tiny_data):
    index = tiny_data.indices("test")[[4, 1]]
    errors, results = accuracy.compare_pipelines(tiny_bundle, tiny_data, index, progress=False)
    pipelines = {"float": FloatPipeline.from_bundle(tiny_bundle), "integer": Emulator(tiny_bundle.pipeline)}
    for name, pipeline in pipelines.items():
        alone = pipeline.run(tiny_data.frames[index])
        for key, array in vars(alone).items():
            np.testing.assert_array_equal(getattr(results[name], key), array)
        rest = pipeline.run(tiny_data.background[None])
        assert errors[name] == accuracy.evaluate(alone, rest, tiny_data, index, tiny_bundle.scene)
    for key, growth in errors["growth_percent"].items():
        ratio = errors["integer"][key] / errors["float"][key]
        assert growth == pytest.approx(100 * (ratio - 1))
    assert set(errors["growth_percent"]) == set(errors["float"]) - {"force_r2"}
    json.dumps(errors, allow_nan=False)


def test_saturated_values_are_counted(tiny_bundle, tiny_data):
    frames = tiny_data.frames.copy()
    frames[0], frames[1] = 0, 255
    wild = replace(tiny_data, frames=frames)
    errors, results = accuracy.compare_pipelines(tiny_bundle, wild, np.array([0, 1]), progress=False)
    found = results["integer"]
    assert errors["saturated_values"] == {
        "gradient_saturated": found.gradient_saturated.sum(),
        "displacement_saturated": found.displacement_saturated.sum(),
    }


def test_equal_loads_leave_strict_json(tiny_bundle, tiny_data):
    """One load only: R² does not exist, and nothing is NaN."""
    index = np.flatnonzero((tiny_data.split == "test") & (tiny_data.force_n[:, 2] < 0.04))
    errors, _ = accuracy.compare_pipelines(tiny_bundle, tiny_data, index, progress=False)
    assert "force_r2" not in errors["float"]
    assert "force_nmae_percent" in errors["integer"]
    json.dumps(errors, allow_nan=False)
