import shutil

import numpy as np
import pytest
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.models.integer.laplacian import eigenvalues
from fastac.models.random_bundle import random_bundle, scene
from fastac.sensor.dataset import write
from fastac.studies.depth.attenuation import (
    SLOPE_EDGES,
    attenuation,
    gains_by_wavelength,
    gains_of_recurrences,
    modes,
    wavelength_class,
)

SIZE = 14


@pytest.fixture
def true(rng):
    """Modes of displacements of 40 presses."""
    return modes(rng.normal(size=(40, SIZE, SIZE)))


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def test_modes_are_their_own_inverse(true):
    np.testing.assert_allclose(modes(modes(true)), true, atol=1e-12)


def test_found_shares_of_slopes_by_their_size(rng):
    true = rng.normal(size=(3, 20, 20, 2)) * 0.2
    size = np.linalg.norm(true, axis=-1)
    found = np.where(size[..., None] < 0.1, 0.25 * true, true)
    across = np.stack([-true[..., 1], true[..., 0]], axis=-1)  # what is wrong in direction counts for nothing
    rows = attenuation(found + 0.5 * across, true)
    assert [row.low for row in rows] == list(SLOPE_EDGES[:-1])
    assert sum(row.share for row in rows) == pytest.approx(1)
    for row in rows:
        assert row.share == pytest.approx(((size >= row.low) & (size < row.high)).mean())
        if row.share:
            assert row.found == pytest.approx(0.25 if row.high <= 0.1 else 1)
    assert np.isnan(attenuation(found[:, :1] * 0, np.ones((3, 1, 20, 2)))[0].found)


def test_wavelengths_are_classed_by_their_length():
    classes = wavelength_class(SIZE)
    np.testing.assert_array_equal(classes, classes.T)
    assert classes[0, 0] == 0
    assert classes[1, 1] == 4  # an octave below
    assert classes[-1, -1] == classes.max() == int(4 * np.log2(SIZE))


def test_gains_undo_what_each_wavelength_lacks(true):
    lost = np.exp(-0.1 * wavelength_class(SIZE))
    gains = gains_by_wavelength(true * lost, true)
    np.testing.assert_allclose(gains, 1 / lost)
    assert (gains_by_wavelength(0 * true, true) == 1).all()


def test_gains_are_smaller_than_what_is_lost_where_noise_is_found(true, rng):
    noise = rng.normal(size=true.shape)
    gains = gains_by_wavelength(true + noise, true)
    assert gains.mean() == pytest.approx(0.5, abs=0.05)  # as much noise as signal


def test_gains_of_recurrences_undo_a_screened_equation(true):
    eigen = -eigenvalues(SIZE)
    strength = np.geomspace(1e-5, 1, 60)[[20, 35, 50]]
    screening = np.resize(strength, SIZE)
    lost = (eigen + screening) / eigen / np.linspace(1, 2, SIZE)
    gains = gains_of_recurrences(true * lost, true)
    np.testing.assert_allclose(gains, 1 / lost, rtol=1e-9)
    amplified = eigen - 0.95 * eigen[0] * strength[0]
    np.testing.assert_allclose(gains_of_recurrences(true * amplified / eigen, true), eigen / amplified)
    assert (gains_of_recurrences(0 * true, true) == 1).all()


def test_the_command(folder):
    found = CliRunner().invoke(main, ["study", "attenuation", str(folder)])
    assert found.exit_code == 0, found.output
    lines = found.output.splitlines()
    errors = {line.rsplit(None, 1)[0].strip(): float(line.rsplit(None, 1)[1]) for line in lines[-3:]}
    assert list(errors) == [
        "as found",
        "a gain for each wavelength",
        "a gain and a screening for each mode along the rows",
    ]
    assert errors["a gain for each wavelength"] < errors["as found"]
    first = lines.index(next(line for line in lines if line.startswith("slopes: ")))
    rows = [line.split() for line in lines[first + 2 : first + 10]]
    assert [row[0] for row in rows] == [f"{edge:g}" for edge in SLOPE_EDGES[:-1]]
    steepest = [row for row in rows if row[3] != "–"][-1]
    assert 50 < float(steepest[3]) < 120  # steep flanks are found, with their sign and direction
    assert sum(float(row[2]) for row in rows) == pytest.approx(100, abs=0.5)


@pytest.mark.parametrize(
    ("missing", "message"),
    [("depth_mm", "depth_mm: not known everywhere"), ("test", "split: no frame is in 'test'")],
)
def test_what_it_cannot_be_told_from(folder, tiny_data, tmp_path, missing, message):
    shutil.copytree(folder / "bundle", tmp_path / "bundle")
    content = dict(vars(tiny_data))
    if missing == "test":
        content["split"] = np.where(tiny_data.split == "test", "train", tiny_data.split)
    else:
        del content[missing]
    write(tmp_path / "data.h5", **content)
    found = CliRunner().invoke(main, ["study", "attenuation", str(tmp_path)])
    assert found.exit_code == 1
    assert message in found.output
    assert found.output.count("\n") == 1


def test_a_scene_without_depth_is_refused(tmp_path):
    random_bundle(tmp_path / "bundle", scene(("force_z",), solver="adjoint"))
    found = CliRunner().invoke(main, ["study", "attenuation", str(tmp_path)])
    assert found.exit_code == 1
    assert "outputs: force_z find no depth" in found.output
