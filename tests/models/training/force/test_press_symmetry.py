import numpy as np
import pytest
from scipy.fft import idctn

from fastac.models.training.force import press_symmetry, ridge, smooth_weights
from fastac.models.training.force.press_symmetry import places

H, W = 12, 14
SIGNS = {"x": (-1, 1), "y": (1, -1), "z": (1, 1)}
"""Of each axis' force where a press is mirrored left and right, and up and down."""


def fields(axis: str, shape: tuple[int, int], size: int, seed: int = 1) -> np.ndarray:
    """Random weights (H, W, 2) of an axis that `places` allows."""
    at = places(axis, size, square=shape[0] == shape[1])
    flat = np.zeros(size * size * 2)
    flat[at] = np.random.default_rng(seed).standard_normal(at.shape[1])
    padded = np.zeros((*shape, 2))
    padded[:size, :size] = flat.reshape(size, size, 2)
    return idctn(padded, axes=(0, 1), norm="ortho")


def left_right(slopes: np.ndarray) -> np.ndarray:
    return slopes[..., ::-1, :] * [-1, 1]


def up_down(slopes: np.ndarray) -> np.ndarray:
    return slopes[..., ::-1, :, :] * [1, -1]


def exchanged(slopes: np.ndarray) -> np.ndarray:
    """Mirrored at the diagonal."""
    return np.swapaxes(slopes, -3, -2)[..., ::-1]


def force(slopes: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return np.einsum("...ijt,ijt->...", slopes, weights)


@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize("shape", [(H, W), (W, W)])
def test_mirrored_presses_have_the_mirrored_force(axis, shape):
    weights = fields(axis, shape, 8)
    slopes = np.random.default_rng(2).standard_normal((5, *shape, 2))
    for mirror, sign in zip((left_right, up_down), SIGNS[axis], strict=True):
        np.testing.assert_allclose(force(mirror(slopes), weights), sign * force(slopes, weights))


def test_turned_presses_have_the_same_normal_force():
    slopes = np.random.default_rng(2).standard_normal((5, W, W, 2))
    weights = fields("z", (W, W), 8)
    np.testing.assert_allclose(force(exchanged(slopes), weights), force(slopes, weights))


@pytest.mark.parametrize("size", [2, 5, 8])
def test_weights_of_x_turned_by_a_quarter_are_weights_of_y(size):
    def used(axis: str) -> np.ndarray:
        found = np.zeros((size, size, 2), bool)
        found.ravel()[places(axis, size, square=True)] = True
        return found

    np.testing.assert_array_equal(exchanged(used("x")), used("y"))


@pytest.mark.parametrize("size", [2, 5, 8])
def test_all_that_mirroring_allows_is_there(size):
    """Each cosine of p and q belongs to at most one axis; what is left turns with no force."""
    index = [places(axis, size, square=False).ravel() for axis in "xyz"]
    every = np.concatenate(index)
    assert len(set(every.tolist())) == len(every)
    left = np.setdiff1d(np.arange(size * size * 2), every).reshape(-1)
    row, column, term = np.unravel_index(left, (size, size, 2))
    odd = np.stack([row % 2, column % 2], axis=-1)
    # Of these, p is odd from top to bottom alone and q from left to right alone, as in a twist about z.
    np.testing.assert_array_equal(odd, np.where(term[:, None] == 0, [1, 0], [0, 1]))
    np.testing.assert_array_equal(
        np.sort(places("z", size, square=True).ravel()), np.sort(places("z", size, square=False).ravel())
    )


def presses(count: int, at, seed: int, *, noise: float = 0.2, side: int = 24):
    """Slopes of dents in the shape of an ellipse, and their volumes as forces, (count, 1); `at` gives a
    dent's place (x, y) by its number."""
    rng, slopes, volumes = np.random.default_rng(seed), [], []
    rows, columns = np.mgrid[:side, :side] - (side - 1) / 2
    for k in range(count):
        x, y = at(k, rng)
        wide, high = rng.uniform(4, 12, 2)
        dent = rng.uniform(1, 4) * np.exp(-((columns - x) ** 2) / wide - (rows - y) ** 2 / high)
        of_dent = np.stack([-2 * (columns - x) / wide * dent, -2 * (rows - y) / high * dent], axis=-1)
        slopes.append(of_dent + noise * rng.standard_normal(of_dent.shape))
        volumes.append([dent.sum()])
    return np.array(slopes), np.array(volumes)


def recordings(groups: int = 4):
    """Dents of `groups` recordings, each at a place of its own on one side of the image; by split name."""
    spots = [(-4, -4), (-1, -5), (-5, 0), (-3, -2)]
    slopes, force_n, group = {}, {}, {}
    for seed, split in enumerate(("train", "validation"), 1):
        found, truth = presses(60, lambda k, rng: spots[k % groups], seed)
        slopes[split], force_n[split] = found, truth
        group[split] = np.array([f"recording {k % groups}" for k in range(60)])
    return slopes, force_n, group


def elsewhere(k, rng):
    return rng.uniform(-5, 5, 2)


def test_presses_on_one_side_tell_those_on_the_others():
    slopes, force_n, group = recordings()
    others, truth = presses(80, elsewhere, 9)
    found, history = press_symmetry.fit(slopes, force_n, ("z",), group)
    assert {entry["symmetric"] for entry in history} == {True}
    plain, *_ = smooth_weights.fit(slopes, force_n)
    error = {k: np.abs(force(others, w[0]) - truth[:, 0]).mean() for k, w in enumerate((found, plain))}
    assert error[0] < 0.5 * error[1]


def one_sided(slopes):
    """Slopes that the left half of the image shows four times as large as the right half."""
    return slopes * np.where(np.arange(slopes.shape[2]) < slopes.shape[2] // 2, 4.0, 1.0)[:, None]


def test_where_the_image_is_not_alike_on_all_sides_recordings_left_out_say_so():
    spots = [(-5, -5), (5, 5), (-5, 5), (5, -5)]
    slopes, force_n, group = {}, {}, {}
    for seed, split in enumerate(("train", "validation"), 1):
        found, force_n[split] = presses(80, lambda k, rng: spots[k % 4] + rng.uniform(-4, 4, 2), seed)
        slopes[split] = one_sided(found)
        group[split] = np.array([f"recording {k // 20}" for k in range(80)])
    found, history = press_symmetry.fit(slopes, force_n, ("z",), group)
    assert {entry["symmetric"] for entry in history} == {False}
    plain, _, same = smooth_weights.fit(slopes, force_n, recording=group)
    np.testing.assert_array_equal(found, plain)
    assert [{**entry, "symmetric": False} for entry in same] == history


def test_it_is_a_fit_to_all_mirrored_and_turned_copies():
    slopes, force_n, group = recordings()
    _, history = press_symmetry.fit(slopes, force_n, ("z",), group)
    copies = slopes["train"]
    for change in (left_right, up_down, exchanged):
        copies = np.concatenate([copies, change(copies)])
    chosen = ridge.best(history)
    size = chosen["cosines"]
    x = smooth_weights.lowest_cosines(copies, size).reshape(len(copies), -1)
    expected = x @ ridge.solve(x, np.tile(force_n["train"], (8, 1)), np.array([1e-12]))[0]
    weak = {**chosen, "regularisation": 1e-12}
    model = smooth_weights.SmoothWeights(slopes, force_n).restricted(lambda k, m: places("z", m, square=True))
    fitted, _ = model.weights(weak, with_validation=False)
    np.testing.assert_allclose(force(copies, fitted[0]), expected[:, 0], rtol=1e-4, atol=1e-3)


def test_axes_have_their_own_weights(monkeypatch):
    """Of noisy forces, so that fewer weights are better ones, and whatever the curl."""
    monkeypatch.setattr(press_symmetry, "LARGEST_CURL", 2.0)
    rng = np.random.default_rng(3)
    slopes = {s: rng.standard_normal((n, H, W, 2)) for s, n in (("train", 60), ("validation", 40))}
    truth = np.stack([fields(axis, (H, W), 4, seed) for seed, axis in enumerate("xyz")])
    force_n = {
        s: np.einsum("nijt,aijt->na", values, truth) + 0.5 * rng.standard_normal((len(values), 3))
        for s, values in slopes.items()
    }
    group = {split: np.arange(len(values)) % 5 for split, values in force_n.items()}
    found, history = press_symmetry.fit(slopes, force_n, ("x", "y", "z"), group)
    plain, *_ = smooth_weights.fit(slopes, force_n, recording=group)
    assert history[0]["symmetric"]
    assert np.abs(found - truth).mean() < 0.7 * np.abs(plain - truth).mean()


def test_an_axis_without_any_force_has_no_weights():
    """As where a gauge of three axes measured presses without friction."""
    slopes, force_n, group = recordings()
    three = {split: values * [0, 0, 1] for split, values in force_n.items()}
    found, history = press_symmetry.fit(slopes, three, ("x", "y", "z"), group)
    assert history[0]["symmetric"]
    assert not found[:2].any()
    np.testing.assert_allclose(found[2:], press_symmetry.fit(slopes, force_n, ("z",), group)[0])
    with pytest.raises(ValueError, match="force_n: zero in every training frame"):
        press_symmetry.fit(slopes, {s: 0 * values for s, values in three.items()}, ("x", "y", "z"), group)


def test_what_is_no_slope_has_no_symmetry():
    """The same presses shown by two mixtures of their slopes that no surface has."""
    slopes, force_n, group = recordings()
    mixed = {split: values @ np.array([[0.2, 1.0], [-1.0, 0.2]]) for split, values in slopes.items()}
    assert press_symmetry.are_slopes(slopes["train"])
    assert not press_symmetry.are_slopes(mixed["train"])
    found, history = press_symmetry.fit(mixed, force_n, ("z",), group)
    assert not history[0]["symmetric"]
    plain = smooth_weights.SmoothWeights(mixed, force_n)
    assert list(press_symmetry.left_out(plain, mixed["train"], ("z",), group)) == [False]
    np.testing.assert_array_equal(found, smooth_weights.fit(mixed, force_n, recording=group)[0])


def test_the_curl_of_noise_is_that_of_no_slope():
    noise = np.random.default_rng(1).standard_normal((1200, 13, 14, 2))
    assert not press_symmetry.are_slopes(noise)
    assert press_symmetry.are_slopes(np.zeros((3, 13, 14, 2)))
