"""Pipelines of arrays; that they are those of the bundle is tested in test_training.py."""

import numpy as np

from fastac.flow.pipelines import float_pipeline, integer_pipeline, rest_depth_mm, with_fitted_force
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.pipeline import FloatPipeline
from fastac.store.files import load_arrays


def test_rest_is_the_dataset_s_or_flat(tiny_data):
    np.testing.assert_allclose(rest_depth_mm(tiny_data), tiny_data.rest_depth_mm)
    assert rest_depth_mm(tiny_data).dtype == np.float64
    flat = type(tiny_data)(**{**vars(tiny_data), "rest_depth_mm": None})
    np.testing.assert_array_equal(rest_depth_mm(flat), np.zeros((16, 16)))


def test_pipelines_of_what_training_wrote_find_what_those_of_the_bundle_do(
    tiny_folder, tiny_bundle, tiny_data
):
    scene, force = tiny_bundle.scene, load_arrays(tiny_folder / "force.npz")
    floats = float_pipeline(load_arrays(tiny_folder / "normals.npz") | force, tiny_data, scene)
    integers = integer_pipeline(load_arrays(tiny_folder / "integers.npz"), tiny_data, scene)
    pairs = [
        (floats, FloatPipeline.from_bundle(tiny_bundle)),
        (Emulator(with_fitted_force(integers, force)), Emulator(tiny_bundle.pipeline)),
    ]
    for found, expected in pairs:
        result, truth = (pipeline.run(tiny_data.frames[:2]) for pipeline in (found, expected))
        np.testing.assert_array_equal(result.depth_mm, truth.depth_mm)
        np.testing.assert_array_equal(result.force_n, truth.force_n)
