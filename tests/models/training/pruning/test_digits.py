import numpy as np
import pytest

from fastac.gateware.arithmetic.shift_add import canonical_signed_digits
from fastac.models.integer.features import scales
from fastac.models.integer.network import Layer, Requantisation
from fastac.models.integer.quantise import quantise_layers
from fastac.models.training.labelled_pixels import labelled_splits
from fastac.models.training.normals import train
from fastac.models.training.pruning import digits
from fastac.models.training.pruning.digits import digit_counts


def test_digits_are_those_of_the_hardware_s_additions():
    words = np.arange(-1100, 1100).reshape(-1, 2)
    for word, count in zip(words.ravel().tolist(), digit_counts(words).ravel().tolist(), strict=True):
        assert count == len(canonical_signed_digits(word))


@pytest.mark.parametrize("most", digits.MULTIPLIER_DIGITS)
def test_smaller_weights_make_up_for_short_multipliers(most):
    layers, x = small_layers()
    hidden, last = digits.with_short_multipliers(layers, most)
    multiplier = hidden.requantisation.multiplier
    assert digit_counts(multiplier).max() <= most
    assert (multiplier >= layers[0].requantisation.multiplier).all()
    assert np.abs(hidden(x) - layers[0](x)).max() <= 4
    assert last is layers[1]


def test_words_lose_their_lowest_digits():
    words = np.arange(-1100, 1101)
    less, counts = digits.one_digit_less(words), digit_counts(words)
    np.testing.assert_array_equal(digit_counts(less), np.maximum(counts - 1, 0))
    for word, found in zip(words.tolist(), less.tolist(), strict=True):
        kept = canonical_signed_digits(word)[1:]
        assert found == sum(sign << exponent for exponent, sign in kept)


def small_layers() -> tuple[list[Layer], np.ndarray]:
    rng = np.random.default_rng(1)
    x = rng.integers(-200, 201, (2000, 4))
    x[:, 3] = 100  # an input that never changes
    weight = np.array([[5, 85, -85, 127], [-85, 64, 5, 85]])
    hidden = Layer(
        weight,
        np.array([900, -300]),
        np.full(4, 255),
        8,
        Requantisation(np.array([90000, 70000]), 24, 7),
    )
    last = Layer(np.array([[50, -20], [10, 60], [-3, -4]]), np.array([0, 0, 9000]), np.full(2, 127), 8)
    return [hidden, last], x


def test_what_an_unchanging_input_loses_goes_into_the_bias():
    layers, x = small_layers()
    hidden, last = digits.fewer_weight_digits(layers, x, 1 / digit_counts(layers[0].weight).sum())
    assert last is layers[1]
    # 85 has digits to lose; 127 less its lowest digit would be 128, which the word lacks.
    np.testing.assert_array_equal(hidden.weight[:, 3], [127, 84])
    np.testing.assert_array_equal(hidden.weight[:, :3], layers[0].weight[:, :3])
    np.testing.assert_array_equal(hidden(x), layers[0](x))


def test_effects_are_how_slopes_change():
    """Compared with slopes of a network whose weight is changed."""
    layers, x = small_layers()
    [(found, means)] = digits.effects(layers, x)
    np.testing.assert_allclose(means, x.mean(axis=0))

    def slopes(weight: np.ndarray) -> np.ndarray:
        unit = layers[0].requantisation.multiplier * 2.0**-24
        hidden = np.clip((x @ weight.T + layers[0].bias) * unit, 0, 127)
        normal = hidden @ layers[1].weight.T + layers[1].bias
        return -normal[:, :2] / normal[:, 2:]

    assert found[0, 3] == found[1, 3] == 0
    for neuron, place in ((0, 0), (1, 2)):
        weight = layers[0].weight.astype(float)
        weight[neuron, place] += 1e-3
        shift = np.zeros((2, 4))
        shift[neuron, 3] = -1e-3 * means[place] / 100  # the bias, by the input that is always 100
        changed = (slopes(weight + shift) - slopes(layers[0].weight.astype(float))) / 1e-3
        expected = (changed**2).sum(axis=1).mean()
        assert found[neuron, place] == pytest.approx(expected, rel=0.1)


def test_baked_words_have_fewer_digits_at_the_same_error(tiny_data, make_scene):
    settings = make_scene(training={"normals_epochs": 10, "normals_batch_px": 1024}).training
    network, _ = train(tiny_data, settings)
    pixels = labelled_splits(tiny_data, settings)
    arrays = [
        [getattr(layer, name).detach().numpy() for layer in network.linear_layers]
        for name in ("weight", "bias")
    ]
    words = {"weight_bits": 8, "activation_bits": 7, "last_weight_bits": 12}
    before = quantise_layers(*arrays, scales(4), pixels["train"][0], **words)
    after, again = (
        digits.fewer_digits(pixels, before, network, settings, growth=0.1, slope_limit=4) for _ in range(2)
    )
    error_before, error_after = (digits.slope_error(k, *pixels["validation"], 4) for k in (before, after))
    assert error_after <= 1.1 * error_before
    for old, new, same in zip(before[:-1], after[:-1], again[:-1], strict=True):
        assert digit_counts(new.weight).sum() < 0.9 * digit_counts(old.weight).sum()
        assert digit_counts(new.requantisation.multiplier).max() <= 4
        np.testing.assert_array_equal(new.weight, same.weight)
        np.testing.assert_array_equal(new.requantisation.multiplier, same.requantisation.multiplier)
    kept = digits.fewer_digits(
        pixels, before, network, settings, growth=0, slope_limit=4, further_errors=[first_is_best()]
    )
    assert kept is before


def first_is_best():
    """An error that is 1 when it is first asked for, and 2 from then on."""
    found = iter([1.0])
    return lambda layers: next(found, 2.0)
