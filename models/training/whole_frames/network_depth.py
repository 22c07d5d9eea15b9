"""The depth error of a float pixel network, by which pruning is judged beside the slopes' error."""

import numpy as np

from fastac.models.floating.network import PixelNetwork, predict, slopes_of
from fastac.models.floating.poisson import solve, source_of
from fastac.models.integer.features import integer_features
from fastac.models.integer.laplacian import boundary_term
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset


def found_depth_mm(
    network: PixelNetwork,
    frames: np.ndarray,
    data: Dataset,
    scene: Scene,
    *,
    rest_depth_mm: np.ndarray,
    bridge: SlopeBridge | None = None,
) -> np.ndarray:
    """Depth (frames, N, N) in mm of the inner pixels that the network's slopes give, in the scene's mode.

    frames : (frames, H, W, C) uint8
    rest_depth_mm : (H, W), of the undeformed skin; bridge : of the slopes under its dots
    """
    pitch, divergence = scene.sensor.pitch_mm, scene.poisson.divergence

    def source(images: np.ndarray) -> np.ndarray:
        features = integer_features(images, data.background, scene.network.smoothing_px)
        normals = predict(network, features)
        slopes = slopes_of(normals, scene.numbers.slope_limit)
        if bridge is not None:
            slopes = bridge(slopes, bridge.dark(images))
        return source_of(slopes, divergence)

    if scene.poisson.mode == "absolute":
        return solve(source(frames) - boundary_term(rest_depth_mm / pitch)) * pitch
    return solve(source(frames) - source(data.background[None])) * pitch + rest_depth_mm[1:-1, 1:-1]


def depth_mae_mm(
    network: PixelNetwork,
    data: Dataset,
    scene: Scene,
    index: np.ndarray,
    *,
    rest_depth_mm: np.ndarray,
    bridge: SlopeBridge | None = None,
) -> float:
    """Mean absolute depth error in mm over the inner pixels of frames `index`, as `found_depth_mm`."""
    inner = np.s_[:, 1:-1, 1:-1]
    error, known = 0.0, 0
    for k in index:  # one after another: a frame's sources take little memory
        found = found_depth_mm(
            network, data.frames[k : k + 1], data, scene, rest_depth_mm=rest_depth_mm, bridge=bridge
        )
        valid = np.ones(found.shape, bool) if data.valid is None else data.valid[k : k + 1][inner]
        error += float(np.abs(found - data.depth_mm[k : k + 1][inner])[valid].sum())
        known += int(valid.sum())
    return error / known
