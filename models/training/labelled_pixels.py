"""The pixels that the network learns normals from: the labelled ones and a share of the skin at rest."""

import numpy as np

from fastac.models.integer.features import integer_features
from fastac.models.training.around_contacts import at_rest, circle_radii
from fastac.scenes.training_schema import Training
from fastac.sensor.dataset import Dataset

VALIDATION_PX = 1 << 18
"""Pixels of the split validation that errors are found on, at most."""

Pixels = tuple[np.ndarray, np.ndarray]
"""Features (pixels, inputs) and unit normals (pixels, 3)."""


def _joined(parts: list[Pixels]) -> Pixels:
    x, y = zip(*parts, strict=True)
    return np.concatenate(x), np.concatenate(y)


def labelled_pixels(
    data: Dataset,
    split: str,
    *,
    flat_fraction: float = 0.0,
    circle_margin: float = 0.0,
    flat_beyond: float | None = None,
    share: float = 1.0,
    smoothing_px: int = 0,
    seed: int = 0,
) -> Pixels:
    """All pixels of a split whose normal is known.

    flat_fraction : share of the result taken from frames that equal the background, if there are any; chosen
        at random with `seed`. 0 keeps all of their pixels.
    circle_margin : share of a contact circle's radius, inside its rim, that is left out
    flat_beyond : distance from a circle's centre, in radii, beyond which the skin counts as at rest; half of
        `flat_fraction` is then taken there
    share : of the pixels of each frame that are kept, chosen at random with `seed`
    smoothing_px : as in `integer_features`
    Raises ValueError where the split has no labelled pixel in contact, and where `flat_beyond` is given and
    no circle or no frame at rest is known.
    """
    if data.normals is None:
        raise ValueError("normals: missing, so there is nothing to train the pixel network on")
    contact, flat, around, rests = [], [], [], data.at_rest
    resting = None if flat_beyond is None else at_rest(data)
    rng = np.random.default_rng(seed)
    for index in data.indices(split):
        known = np.ones(data.frames.shape[1:3], bool) if data.valid is None else data.valid[index]
        kept = rng.random(known.shape) < share if share < 1 else np.ones_like(known)
        features = integer_features(data.frames[index], data.background, smoothing_px)
        radii = circle_radii(data, index)
        if radii is not None:
            known = known & (radii <= 1 - circle_margin) if circle_margin else known
            if resting is not None:
                beyond = kept & resting[0] & (radii > flat_beyond)
                around.append((features[beyond], resting[1][beyond]))
        known = known & kept
        (flat if rests[index] else contact).append(
            (features[known], data.normals[index][known].astype(np.float32))
        )
    if not contact:
        raise ValueError(f"split: no frame in contact is in {split!r}")
    found = _joined(contact)
    if not len(found[0]):
        of_these = "" if share == 1 else f", or training.normals_share = {share} leaves none of them"
        raise ValueError(f"valid: no pixel of a frame in contact is labelled in {split!r}{of_these}")
    if resting is not None and not around:
        raise ValueError(f"indenter/radius_px: no circle is in {split!r}, and training.flat_beyond needs one")
    pools = [_joined(pool) for pool in (flat, around) if pool]
    if flat_fraction:
        count = int(len(found[0]) * flat_fraction / (1 - flat_fraction))
        rng = np.random.default_rng(seed)
        pools = [_drawn(pool, count // len(pools), rng) for pool in pools]
    return _joined([found, *pools])


def _drawn(pixels: Pixels, count: int, rng: np.random.Generator) -> Pixels:
    """So many of the pixels at random, or all of them where there are fewer."""
    x, y = pixels
    chosen = rng.choice(len(x), min(len(x), count), replace=False)
    return x[chosen], y[chosen]


def training_pixels(data: Dataset, settings: Training, smoothing_px: int = 0) -> Pixels:
    """The pixels of the split train that the scene's settings choose; `smoothing_px` as in
    `integer_features`."""
    return labelled_pixels(
        data,
        "train",
        flat_fraction=settings.flat_fraction,
        circle_margin=settings.circle_margin,
        flat_beyond=settings.flat_beyond,
        share=settings.normals_share,
        smoothing_px=smoothing_px,
        seed=settings.seed,
    )


def labelled_splits(data: Dataset, settings: Training, smoothing_px: int = 0) -> dict[str, Pixels]:
    """Features and normals of the labelled pixels for training, as {"train": (x, y), "validation": (x, y)}.

    smoothing_px : as in `integer_features`
    The validation pixels are a fixed random sample; the key is absent where the dataset has no such split.
    """
    seed, margin = settings.seed, settings.circle_margin
    found = {"train": training_pixels(data, settings, smoothing_px)}
    if len(data.indices("validation")):
        x, y = labelled_pixels(data, "validation", circle_margin=margin, smoothing_px=smoothing_px)
        chosen = np.random.default_rng(seed).permutation(len(x))[:VALIDATION_PX]
        found["validation"] = x[chosen], y[chosen]
    return found
