import shutil
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.flow import force_training
from fastac.models import accuracy
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import force as integer_force
from fastac.models.integer.force import WeightedSum
from fastac.scenes.schema import SceneError
from fastac.sensor.dataset import write
from fastac.store.files import load_arrays
from fastac.studies.equivalence import adjoint_fits, identities
from fastac.studies.equivalence.variants import float_variant, integer_variant, slope_words, variant


@pytest.fixture(scope="module")
def frames(tiny_data):
    return tiny_data.frames[tiny_data.indices("test")]


@pytest.fixture(scope="module")
def words(tiny_bundle, frames):
    return slope_words(tiny_bundle.pipeline, frames, progress=False)


@pytest.fixture(scope="module")
def fits(tiny_bundle, tiny_data):
    return adjoint_fits.fit(tiny_bundle, tiny_data, progress=False)


def test_slope_words_are_the_pipeline_s(tiny_bundle, frames, words):
    slopes = Emulator(tiny_bundle.pipeline).run(frames).slopes
    np.testing.assert_array_equal(words * 2.0**-tiny_bundle.pipeline.ratio.fraction, slopes)


def test_variants_model_what_they_must_and_no_more(tiny_scene):
    depth = variant(tiny_scene, solver="tridiagonal", mode="difference")
    assert depth.outputs == ("depth", "force_z")
    assert (depth.poisson.solver, depth.poisson.mode) == ("tridiagonal", "difference")
    assert depth.force.clamp
    adjoint = variant(tiny_scene, solver="adjoint", fit="slopes")
    assert adjoint.outputs == ("force_z",)
    assert adjoint.poisson.mode == tiny_scene.poisson.mode
    assert not adjoint.force.clamp
    bent = {"kernel": "collapsed", "fit": "polynomials", "band_mm": 0.01}
    scene = tiny_scene.model_copy(update={"force": tiny_scene.force.model_copy(update=bent)})
    for solver in ("dst2d", "adjoint"):  # weights of bends have no slopes that follow from them
        force = variant(scene, solver=solver).force
        assert (force.fit, force.bends_mm) == ("displacement", ())
    assert variant(adjoint, solver="adjoint").force.fit == "slopes"
    learned = adjoint.training.model_copy(update={"force_weight": 3.0})
    learned = adjoint.model_copy(update={"training": learned})
    assert variant(learned, solver="tridiagonal") == variant(adjoint, solver="tridiagonal")


def test_impossible_variants_end_in_one_line(make_scene):
    scene = make_scene(outputs=["normals"], sensor={"height_px": 20})
    with pytest.raises(SceneError, match=r"^scene tiny: sensor.height_px: 20 differs from width_px 16.*$"):
        variant(scene, solver="dst2d")


def test_solver_errors_are_those_of_the_pipelines(tiny_bundle, words):
    rows = list(identities.solver_errors(tiny_bundle, words, progress=False))
    assert [(row.mode, row.solver) for row in rows] == [
        (mode, solver) for mode in ("absolute", "difference") for solver in ("dst2d", "tridiagonal")
    ]
    slopes = words * 2.0**-tiny_bundle.pipeline.ratio.fraction
    for row in rows:
        if row.mode == "difference":  # the float pipeline subtracts what its own network finds at rest
            continue
        scene = variant(tiny_bundle.scene, mode=row.mode, solver=row.solver)
        pipeline = integer_variant(tiny_bundle, scene)
        depth = pipeline.depth_mm_per_unit * pipeline.solver(pipeline.source(words))
        exact = float_variant(tiny_bundle, scene)._solve(slopes) * scene.sensor.pitch_mm
        error_um = 1e3 * np.abs(depth - exact)
        assert row.mean_um == pytest.approx(error_um.mean(), rel=1e-6)
        assert row.largest_um == pytest.approx(error_um.max(), rel=1e-6)
        assert row.words == tuple(
            f"{stage.name} {stage.format.width}.{stage.format.fraction}" for stage in pipeline.solver.stages
        )


def test_solver_errors_follow_the_words(tiny_bundle, words):
    """Fewer bits of the sines, and the error grows in every row."""
    scene = tiny_bundle.scene
    numbers = scene.numbers.model_copy(update={"coefficient_fraction_bits": 8})
    coarse = replace(
        tiny_bundle,
        pipeline=tiny_bundle.pipeline.replace(scene=scene.model_copy(update={"numbers": numbers})),
    )
    pairs = zip(
        identities.solver_errors(tiny_bundle, words, progress=False),
        identities.solver_errors(coarse, words, progress=False),
        strict=True,
    )
    for fine, rough in pairs:
        assert 0 < fine.mean_um < fine.largest_um < 1
        assert rough.mean_um > 5 * fine.mean_um


def test_patches_equal_one_weight_a_pixel(tiny_bundle, frames, monkeypatch):
    kernels = tiny_bundle.floats["force.integer_weights"].astype(float)
    found = identities.patch_mismatches(tiny_bundle, kernels, frames, progress=False)
    assert found == identities.Mismatches(frames=8, accumulators=8, mismatches=0)
    exact = integer_force.PatchForce.collapsed

    def off_by_one(self) -> WeightedSum:
        force = exact(self)
        return replace(force, constant=force.constant + 1)

    monkeypatch.setattr(integer_force.PatchForce, "collapsed", off_by_one)
    assert identities.patch_mismatches(tiny_bundle, kernels, frames, progress=False).mismatches == 8


def test_the_adjoint_is_the_depth_path(tiny_bundle, fits, words, monkeypatch):
    errors = identities.identity_errors(tiny_bundle, fits.kernels, words)
    assert set(errors) == {"absolute", "difference"}
    assert max(errors.values()) < 1e-9
    exact = identities.slope_weights
    monkeypatch.setattr(identities, "slope_weights", lambda *arguments: 1.01 * exact(*arguments))
    errors = identities.identity_errors(tiny_bundle, fits.kernels, words)
    assert min(errors.values()) == pytest.approx(0.01, rel=1e-6)


@pytest.mark.parametrize("name", ["displacement", "slopes"])
def test_fits_are_those_of_a_training(tiny_scene, tiny_folder, tiny_data, tmp_path, fits, name):
    scene = variant(tiny_scene, solver="adjoint", fit=name)
    force_training.force(
        tiny_data,
        scene,
        tiny_folder / "normals.npz",
        tiny_folder / "integers.npz",
        tmp_path / "force.npz",
        progress=False,
    )
    arrays = load_arrays(tmp_path / "force.npz")
    for arithmetic in ("float", "integer"):
        expected = arrays[f"force.{arithmetic}_weights"]
        np.testing.assert_allclose(
            fits.weights[name, arithmetic], expected, atol=1e-5 * np.abs(expected).max()
        )


def test_true_slopes_are_those_of_the_normals(tiny_scene, tiny_data):
    index = tiny_data.indices("test")[:2]
    found = adjoint_fits.true_change(tiny_scene, tiny_data, index)
    assert found.shape == (2, 16, 16, 2)
    untouched = np.abs(tiny_data.depth_mm[index] - tiny_data.rest_depth_mm) < 1e-6
    assert np.abs(found[untouched]).max() < 0.05 < np.abs(found).max()
    recorded = tiny_scene.sensor.model_copy(update={"source": "recorded"})
    scene = tiny_scene.model_copy(update={"sensor": recorded})
    assert adjoint_fits.true_change(scene, tiny_data, index) is None


def test_noise_is_the_camera_s(make_scene):
    scene = make_scene(sensor={"noise_dn": 3.0, "electrons_per_dn": 4.0})
    frames = np.full((40, 16, 16, 4), 64, np.uint8)
    found = adjoint_fits.with_more_noise(frames, scene).astype(float)
    assert found.mean() == pytest.approx(64, abs=0.1)
    assert found.std() == pytest.approx(5, rel=0.02)  # 9 of reading and 16 of 256 electrons


def test_accuracies(tiny_bundle, tiny_data, fits, words, frames):
    rows = {
        row.fit: row
        for row in adjoint_fits.accuracies(
            tiny_bundle, tiny_data, tiny_data.indices("test"), fits, words, progress=False
        )
    }
    assert set(rows) == set(adjoint_fits.FITS)
    scene, index = variant(tiny_bundle.scene, solver="adjoint"), tiny_data.indices("test")
    for name, row in rows.items():
        assert set(row.nmae_percent) == {"float", "integer", "true"}
        result = float_variant(tiny_bundle, scene, fits.weights[name, "float"]).run(frames)
        expected = accuracy.force(result, tiny_data, index, scene.force_axes)["force_nmae_percent"]
        assert row.nmae_percent["float"] == pytest.approx([expected])
        error = row.rounding
        assert 0 < error.mean_mn <= error.largest_mn <= error.bound_mn
        assert error.largest_relative < 1e-3
        assert row.noise_mn[0] > 0


class TestCommand:
    @staticmethod
    def run(*arguments):
        return CliRunner().invoke(main, ["study", "identities", *map(str, arguments), "--no-progress"])

    def test_prints_all_three(self, folder):
        result = self.run(folder)
        assert result.exit_code == 0, result.output
        for text in ("8 held-out frames of 16×16 px", "(a)", "(b)", "(c)", "8 accumulators, 0 mismatches"):
            assert text in result.output
        assert "nan" not in result.output

    def test_of_many_frames_some_are_measured_on(self, folder, monkeypatch):
        monkeypatch.setattr(identities, "FRAMES", 4)
        result = self.run(folder)
        assert result.exit_code == 0, result.output
        assert "4 held-out frames of 16×16 px" in result.output

    def test_without_force_only_the_solvers(self, make_scene, tiny_bundle, folder, tmp_path):
        from fastac.models.integer import bundle

        shutil.copy(folder / "data.h5", tmp_path / "data.h5")
        scene = make_scene(outputs=["depth"])
        floats = {k: v for k, v in tiny_bundle.floats.items() if not k.startswith("force")}
        bundle.save(tmp_path / "bundle", integer_variant(tiny_bundle, scene), floats)
        result = self.run(tmp_path)
        assert result.exit_code == 0, result.output
        assert "(a)" in result.output
        assert "(b)" not in result.output

    def test_a_folder_without_frames(self, tiny_folder):
        result = self.run(tiny_folder)
        assert result.exit_code == 1
        assert result.output == f"Error: {tiny_folder}/data.h5: no such file\n"

    def test_a_folder_without_a_bundle(self, tmp_path):
        result = self.run(tmp_path)
        assert result.exit_code == 1
        assert result.output.splitlines() == [
            f"Error: {tmp_path}/bundle.json: no such file; is {tmp_path} a bundle folder?"
        ]

    def test_frames_without_forces(self, folder, tiny_data, tmp_path):
        shutil.copytree(folder / "bundle", tmp_path / "bundle")
        content = {key: value for key, value in vars(tiny_data).items() if key != "force_n"}
        write(tmp_path / "data.h5", **content)
        result = self.run(tmp_path)
        assert result.exit_code == 1
        assert result.output.count("\n") == 1
        assert "force_n: missing" in result.output
