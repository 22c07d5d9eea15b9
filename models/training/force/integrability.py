"""Slopes of a surface have no curl: what frames alone say about the slopes that they show.

Of a surface z over the image, slopes p = ∂z/∂x and q = ∂z/∂y obey ∂q/∂x = ∂p/∂y. Where a pixel's difference
from the background is nearly linear in its slopes, few combinations of its channels obey this too: up to one
common factor only the slopes themselves do. They are found without any label, and a network that is trained
on something else, such as the force, can be held to them.
Sources: Frankot, Chellappa, "A Method for Enforcing Integrability in Shape from Shading Algorithms", 1988;
Yuille, Snow, "Shape and Albedo from Multiple Images using Integrability", 1997.
"""

import numpy as np
import scipy.linalg
import torch

NOISE = 1e-6
"""Power of noise that the channels are taken to have besides, relative to that of all their derivatives.
Combinations of channels that cancel, such as of two that are equal, would have no curl, and are no slopes."""
CURL_OF_NOISE = 0.5
"""Its `curl_share`."""
FRAMES_AT_ONCE = 64
"""Whose derivatives are in memory at a time."""


def derivatives(images: np.ndarray | torch.Tensor) -> tuple:
    """∂/∂x, along the columns, and ∂/∂y, along the rows, of images (N, H, W, terms), a pixel's side as unit.

    Each (N, H − 1, W − 1, terms), between four pixels, so that both belong to the same place.
    """
    along_x = images[:, :, 1:] - images[:, :, :-1]
    along_y = images[:, 1:] - images[:, :-1]
    return (along_x[:, 1:] + along_x[:, :-1]) / 2, (along_y[:, :, 1:] + along_y[:, :, :-1]) / 2


def curl_share(slopes: torch.Tensor) -> torch.Tensor:
    """Mean square of the curl ∂q/∂x − ∂p/∂y over that of all derivatives of slopes (N, H, W, 2), p and q.

    0 for slopes of surfaces, 0.5 for noise, 2 at most; it does not change with the slopes' scale.
    """
    along_x, along_y = derivatives(slopes)
    curl = along_x[..., 1] - along_y[..., 0]
    every = along_x.square().sum(dim=-1) + along_y.square().sum(dim=-1)
    return curl.square().mean() / (every.mean() + torch.finfo(slopes.dtype).tiny)


def integrable_mixtures(change: np.ndarray) -> np.ndarray:
    """The two combinations of channels (2, C) that come closest to the slopes p and q of surfaces.

    change : (frames, H, W, C), differences from the background; C ≥ 2
    They have the smallest curl for a given power of their derivatives: the first vector of a generalised
    eigenproblem. Their common scale, sign included, is arbitrary.
    """
    channels = change.shape[-1]
    curl, power = np.zeros((2 * channels, 2 * channels)), np.zeros((channels, channels))
    for start in range(0, len(change), FRAMES_AT_ONCE):
        part = change[start : start + FRAMES_AT_ONCE].astype(np.float64)
        along_x, along_y = (images.reshape(-1, channels) for images in derivatives(part))
        of_mixture = np.concatenate([-along_y, along_x], axis=1)
        curl += of_mixture.T @ of_mixture
        power += along_x.T @ along_x + along_y.T @ along_y
    noise = (NOISE * np.trace(power) + np.finfo(float).tiny) * np.eye(2 * channels)
    of_curl, of_all = curl + CURL_OF_NOISE * noise, np.kron(np.eye(2), power) + noise
    vectors = scipy.linalg.eigh(of_curl, of_all, subset_by_index=[0, 0])[1]
    return vectors[:, 0].reshape(2, channels)
