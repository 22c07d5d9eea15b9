"""How well dots are followed: by the hardware's integers and by the detector, against their true places."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fastac.flow import frames
from fastac.models.integer.dot_follower import FRACTION, DotFollower
from fastac.models.loops.frames import CHUNK
from fastac.models.vision.dots import follower_of
from fastac.models.vision.markers import DetectedDots, MarkerError
from fastac.report.tables import text_table
from fastac.scenes.schema import AXES, Scene
from fastac.sensor.dataset import DatasetError
from fastac.sensor.optics.marker_grid import marker_pixels
from fastac.sensor.samples import SPLITS
from fastac.store.progress import progress_bar

HEAD = (
    *("split", "F_z, N", "drag", "frames", "travel, px"),
    *("integers: mean, px", "99%", "largest", "lost"),
    *("detector: mean, px", "99%", "largest", "lost"),
)


def by_integers(follower: DotFollower, images: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shifts in px (frames, M, 2) of the follower's dots, and which were seen (frames, M)."""
    shift, seen = follower(follower.windows(images))
    return shift * 2.0**-FRACTION, seen


def by_detector(dots: DetectedDots, images: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same of the detector's dots."""
    shift, seen = zip(*map(dots.shifts_px, images), strict=True)
    return np.array(shift), np.array(seen)


def nearest(places: np.ndarray, known: np.ndarray, limit_px: float) -> np.ndarray:
    """Index in `known` (K, 2) of the nearest place to each of `places` (M, 2), all different.

    Raises MarkerError where one has none within `limit_px`, or two have the same.
    """
    away = np.linalg.norm(places[:, None] - known, axis=-1)
    index = away.argmin(axis=1)
    if away.min(axis=1).max() > limit_px or len(set(index.tolist())) < len(index):
        raise MarkerError(f"dots in the background: {len(places)} found, {len(known)} true ones: they differ")
    return index


def _row(error: np.ndarray, seen: np.ndarray) -> list[str]:
    known = error[seen] if seen.any() else np.full(1, np.nan)
    return [
        f"{known.mean():.3f}",
        f"{np.percentile(known, 99):.3f}",
        f"{known.max():.2f}",
        f"{(~seen).sum()}",
    ]


def _cases(scene: Scene, force_n: np.ndarray) -> list[tuple[float, float]]:
    """Of each frame, with forces (frames, 3) in N, the nearest load and drag of the scene's protocol."""
    loads_n, drags = np.array(scene.protocol.loads_n), np.array((0.0, *scene.tangential_shares))
    load_n, across_n = force_n[:, 2], np.hypot(force_n[:, 0], force_n[:, 1])
    drag = across_n / np.maximum(np.abs(load_n), 1e-9)
    nearest_load = loads_n[np.abs(load_n[:, None] - loads_n).argmin(axis=1)]
    nearest_drag = drags[np.abs(drag[:, None] - drags).argmin(axis=1)]
    return list(zip(nearest_load.tolist(), nearest_drag.tolist(), strict=True))


def measure(scene: Scene, path: Path, *, store: Path, progress: bool) -> Iterator[str]:
    """Lines of a table: errors of the dots' shifts by split, load and drag (|F_xy| / F_z), and over all.

    A dot's true shift is from its true place in the background to that in the frame. Lost dots are counted
    and have no error. Raises DatasetError where the dataset does not know the dots' true places.
    """
    data, sensor = frames.read(path, scene, store=store, progress=progress), scene.sensor
    follower = follower_of(data.background, sensor)
    truth_at_rest = marker_pixels(sensor)
    known = data.markers_px is not None and data.markers_px.shape[1:] == truth_at_rest.shape
    if not known or data.force_n is None or data.force_n.shape[1] != len(AXES):
        raise DatasetError(
            f"{path}: expected force_n of three axes, and markers_px of {len(truth_at_rest)} dots"
        )
    spacing_px = sensor.markers.spacing_mm / sensor.pitch_mm
    detected = DetectedDots.of_background(data.background, sensor)
    errors, ways = {}, {"integers": follower.rest * 2.0**-FRACTION, "detector": detected.rest_px}
    order = {name: nearest(rest, truth_at_rest, spacing_px / 2) for name, rest in ways.items()}
    travel = np.linalg.norm(data.markers_px - truth_at_rest, axis=-1)
    with progress_bar(total=len(data), desc="dots", unit="frame", enabled=progress) as bar:
        for start in range(0, len(data), CHUNK):
            part = slice(start, start + CHUNK)
            images = data.frames[part]
            found = {
                "integers": by_integers(follower, images),
                "detector": by_detector(detected, images),
            }
            for name, (shift, seen) in found.items():
                true = (data.markers_px[part] - truth_at_rest)[:, order[name]]
                away = np.linalg.norm(shift - true, axis=-1)
                errors.setdefault(name, []).append((away, seen))
            bar.update(len(images))
    joined = {
        name: [np.concatenate(parts) for parts in zip(*found, strict=True)] for name, found in errors.items()
    }

    case_of = _cases(scene, data.force_n)
    rows = []
    for split in SPLITS:
        index = data.indices(split)
        for case in [*sorted({case_of[k] for k in index}), None]:
            chosen = [k for k in index if case in (None, case_of[k])]
            if not chosen:
                continue
            label = ("all", "all") if case is None else (f"{case[0]:g}", f"{case[1]:g}")
            parts = [_row(away[chosen], seen[chosen]) for away, seen in joined.values()]
            rows.append(
                [split, *label, f"{len(chosen):,}", f"{travel[chosen].max():.1f}", *parts[0], *parts[1]]
            )
    yield f"{len(follower.rest)} dots, shifts against their true places; {data.source}"
    yield from text_table(HEAD, rows).splitlines()
