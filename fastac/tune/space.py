"""The scenes that are compared: the scene itself, and others that cost the hardware no multiplier more."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from fastac.scenes.schema import Scene
from fastac.sweep.spec import Point, SpecError, expand, point_of
from fastac.tune.groups import TuneError

GEOMETRY = {
    "sensor.level_light": [False, True],
    "network.smoothing_px": [0, 2, 4],
    "training.input_noise": [0.0, 0.02, 0.04, 0.08],
    "training.position_noise": [0.0, 0.04, 0.08, 0.16],
    "training.teachers": [0, 4, 8],
    "training.flat_fraction": [0.05, 0.2, 0.4],
    "training.huber_delta": [0.0, 0.03, 0.1],
    "training.normals_batch_px, training.normals_learning_rate": [[256, 3e-3], [1024, 6e-3], [2048, 1e-2]],
    "training.normals_epochs": [60, 120, 250],
}
"""Where the network learns from normals. Axes as in the specification of a sweep."""
CIRCLES = {"training.circle_margin": [0.0, 0.05, 0.1, 0.15]}
"""Where these are the normals of balls inside labelled contact circles, besides."""
DEPTH = {
    "training.depth_weight, training.depth_epochs": [
        [0.0, 30],
        [0.005, 30],
        [0.005, 100],
        [0.02, 30],
        [0.02, 100],
    ],
    "poisson.divergence": ["central", "backward"],
}
"""Where the depth of presses is known, or its shape under balls, besides."""
FORCE_OF_SLOPES = {
    "training.force_weight, training.depth_learning_rate": [
        [0.0, 2e-3],
        [3.0, 2e-3],
        [12.0, 2e-3],
        [12.0, 5e-3],
    ]
}
"""Where the force is a sum of slopes that are learned from normals, besides."""
FORCE_ALONE = {"training.force_steps": [12, 24, 36]}
"""Instead, where the scene has steps of least squares on the force: its presses are enough for them."""
FORCE_OF_KERNELS = {"training.force_weight": [0.0, 0.1, 0.3, 1.0]}
"""Where the depth of presses is known and kernels on the displacement find the force, besides."""
FORCE = {
    "sensor.level_light": [False, True],
    "training.input_noise": [0.0, 0.01, 0.02, 0.05],
    "training.normals_learning_rate": [1e-3, 2e-3, 4e-3],
    "training.force_learning_rate": [5e-4, 1e-3, 3e-3],
    "training.force_weight_decay": [0.0, 1e-3, 1e-2],
    "training.force_batch": [8, 16, 32],
    "training.force_epochs": [12, 24, 48],
    "training.light_noise": [0.005, 0.01, 0.02],
    "training.curl_weight": [0.0, 0.3, 1.0, 3.0],
}
"""Where it learns from forces alone."""
NEAR_CHANGES = 2
"""Axes in which a candidate near the scene differs from it, on average."""
DRAWS = 64
"""Points drawn for each candidate that is wanted, at most: equal and impossible ones do not count."""


def axes_of(
    scene: Scene,
    vary: Sequence[str] = (),
    keep: Sequence[str] = (),
    *,
    circles: bool = False,
    depth: bool = False,
) -> dict[str, list]:
    """The axes that are searched: those of the scene's kind of labels without the keys `keep`, and those of
    `vary`, texts such as "network.width=12,16", which replace axes of the same name.

    circles : whether the data have contact circles; depth: whether depth can be learned from them
    Raises TuneError for texts that say no axis.
    """
    if scene.training.labels == "force":
        axes = dict(FORCE)
    else:
        by_depth = depth and scene.wants_solver
        axes = GEOMETRY | (CIRCLES if circles else {}) | (DEPTH if by_depth else {})
        if scene.training.force_steps:
            axes |= FORCE_ALONE
        elif scene.wants_force and not scene.force.dots:
            axes |= FORCE_OF_SLOPES if scene.fit_facts.of_slopes else {}
            axes |= FORCE_OF_KERNELS if scene.fit_facts.of_kernels and by_depth else {}
    for text in vary:
        key, equals, values = text.partition("=")
        try:
            found = tomllib.loads(f"values = [{values}]")["values"]
        except tomllib.TOMLDecodeError:
            found = []
        if not (key.strip() and equals and found):
            raise TuneError(f"--vary {text!r}: expected KEY=VALUE,VALUE,..., such as network.width=12,16")
        axes[key.strip()] = found
    for key in keep:
        if key not in axes:
            raise TuneError(f"--keep {key!r}: is not searched; there are {', '.join(axes) or 'no keys'}")
        del axes[key]
    return axes


def candidates(scene: Scene, axes: Mapping[str, list], count: int, seed: int) -> list[Point]:
    """The scene itself, its `axes` empty, and up to `count` − 1 others: in turn one that changes few of the
    scene's values, for a scene may be good already, and one that is drawn from all values alike.

    Both are spread evenly, by scrambled Sobol sequences (Owen, "Scrambling Sobol' and Niederreiter-Xing
    Points", 1998), the same for the same seed. Raises TuneError for a key or a value that a scene cannot
    have.
    """
    found = [Point({}, scene)]
    for axis, values in axes.items():
        for value in values:
            try:
                point_of(scene, expand(axis, value), Path())
            except (KeyError, TypeError, ValueError, SpecError):
                raise TuneError(f"{axis} = {value!r}: a scene has no such key or number of values") from None
    if not axes:
        return found
    for choice in islice(_choices(axes, seed), DRAWS * count):
        if len(found) == count:
            break
        point = point_of(scene, choice, Path())
        if point.scene is not None and all(point.scene != other.scene for other in found):
            found.append(point)
    return found


def _choices(axes: Mapping[str, list], seed: int) -> Iterator[dict]:
    """Values by key, without end: in turn of some axes, NEAR_CHANGES on average, and of all."""
    count = len(axes)
    near = qmc.Sobol(2 * count, rng=np.random.default_rng((seed, 1)))
    far = qmc.Sobol(count, rng=np.random.default_rng(seed))
    while True:
        place, changes = np.split(near.random(1)[0], 2)
        yield _values(axes, place, changes * count < NEAR_CHANGES)
        yield _values(axes, far.random(1)[0], np.ones(count, bool))


def _values(axes: Mapping[str, list], place: np.ndarray, changed: np.ndarray) -> dict:
    """The values by key of the `changed` axes at a place of the unit cube."""
    found: dict = {}
    for (axis, values), at, other in zip(axes.items(), place, changed, strict=True):
        if other:
            found |= expand(axis, values[min(int(at * len(values)), len(values) - 1)])
    return found
