"""How much of gentle slopes a trained bundle finds, what that costs the depth, and what could be restored.

Where noise hides a slope, the best guess of a pixel network is less than the slope: it finds steep flanks
whole and gentle slopes in part. The depth is their integral, so that it lacks the wide skirt of a contact.
What is missing depends on the wavelength, and a gain for each wavelength, fitted to presses whose depth is
known, gives most of it back.
Source of the gains: Wiener's filter, as in Gonzalez, Woods, "Digital Image Processing", 4th ed., section 5.8,
here by least squares on training presses instead of from the spectra of signal and noise.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.fft import dstn

from fastac.flow import training
from fastac.flow.force_fits import slope_changes
from fastac.flow.frames import read
from fastac.flow.pipelines import rest_depth_mm
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import load_bundle
from fastac.models.integer.laplacian import eigenvalues
from fastac.report.tables import text_table
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.sensor.samples import evenly_spaced

FRAMES = 192
"""Frames of each split that are used, evenly spaced."""
SLOPE_EDGES = (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, np.inf)
"""Magnitudes of the slopes' change between which pixels are counted together."""
PER_OCTAVE = 4
"""Classes of wavelengths an octave that have one gain."""
SCREENINGS = 60
"""Strengths of screening that are tried, of either sign."""


@dataclass(frozen=True)
class Attenuation:
    """What is found of slopes whose true change has a magnitude from `low` on, below `high`.

    share : of all pixels; found : Σ found · true / Σ true², NaN where there is no such pixel
    """

    low: float
    high: float
    share: float
    found: float

    @property
    def percent(self) -> str:
        """`found` in percent, – where there is no such pixel."""
        return f"{100 * self.found:.0f}" if np.isfinite(self.found) else "–"


def attenuation(found: np.ndarray, true: np.ndarray) -> list[Attenuation]:
    """By magnitude of the true change, changes of the slopes (frames, H, W, 2) against the true ones."""
    size, product = np.linalg.norm(true, axis=-1), (found * true).sum(axis=-1)
    rows = []
    for low, high in pairwise(SLOPE_EDGES):
        inside = (size >= low) & (size < high)
        power = np.square(size[inside]).sum()
        rows.append(Attenuation(low, high, inside.mean(), product[inside].sum() / power if power else np.nan))
    return rows


def modes(displacement: np.ndarray) -> np.ndarray:
    """The DST-I of displacements (frames, N, N) along both axes; its own inverse."""
    return dstn(displacement, type=1, norm="ortho", axes=(1, 2))


def wavelength_class(size: int) -> np.ndarray:
    """The class of every mode's wavelength, (N, N): PER_OCTAVE an octave, from 0, the longest, on."""
    count = np.arange(1, size + 1)
    radius = np.hypot(count[:, None], count)
    return np.floor(PER_OCTAVE * np.log2(radius / np.sqrt(2)) + 1e-9).astype(int)


def gains_by_wavelength(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """The gain of each mode, (N, N), that brings found modes (frames, N, N) nearest to the true ones: one for
    each class of wavelengths, 1 where nothing is found."""
    classes = wavelength_class(found.shape[-1])
    product, power = (
        np.bincount(classes.ravel(), values.sum(axis=0).ravel())
        for values in (found * true, np.square(found))
    )
    return np.divide(product, power, out=np.ones_like(power), where=power > 0)[classes]


def gains_of_recurrences(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """As `gains_by_wavelength`, but such as a tridiagonal solver can have.

    For each mode along the rows these are a factor g and a screening s of its recurrence's diagonal, together
    g · λ / (λ + s) for the Laplacian's eigenvalues −λ.
    """
    size = found.shape[-1]
    eigen = -eigenvalues(size)
    product, power = (found * true).sum(axis=0), np.square(found).sum(axis=0)
    gains, strengths = np.ones((size, size)), np.geomspace(1e-5, 1, SCREENINGS)
    for mode in range(size):
        own = eigen[:, mode]
        screening = np.concatenate([[0], strengths, -0.95 * own[0] * strengths])  # λ + s stays positive
        shape = own / (own + screening[:, None])
        fit, energy = shape @ product[:, mode], np.square(shape) @ power[:, mode]
        if power[:, mode].any():
            best = int(np.argmax(np.square(fit) / energy))  # what it takes from the sum of squared errors
            gains[:, mode] = shape[best] * (fit[best] / energy[best])
    return gains


def _selected(data: Dataset, split: str) -> np.ndarray:
    return evenly_spaced(data.indices(split), FRAMES)


def require_depth(scene: Scene, folder: Path) -> None:
    """Raise ValueError where a bundle's scene finds no depth."""
    if not scene.wants_solver:
        raise ValueError(
            f"{folder}: outputs: {', '.join(scene.outputs)} find no depth, which this study is of"
        )


def measure(folder: Path, *, progress: bool) -> Iterator[str]:
    """Measure one build folder; yields lines of text.

    Raises ValueError where the scene finds no depth, or the dataset does not know it everywhere.
    """
    bundle, file = load_bundle(folder), folder / "data.h5"
    scene = bundle.scene
    require_depth(scene, folder)
    data = read(file, scene)
    training.require(data, scene, file)
    if data.depth_mm is None or not np.isfinite(data.depth_mm).all():
        raise ValueError(f"{file}: depth_mm: not known everywhere, and this study compares with it")
    emulator, pitch, rest_mm = Emulator(bundle.pipeline), scene.sensor.pitch_mm, rest_depth_mm(data)
    resting = emulator.run(data.background[None], wanted=["depth_mm"]).depth_mm

    def pressed(index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacement found and true, (frames, N, N) in mm, both lower where pressed."""
        found = emulator.run(data.frames[index], wanted=["depth_mm"], progress=progress).depth_mm
        true = data.depth_mm[index] - rest_mm
        return (found - resting)[:, 1:-1, 1:-1].astype(np.float64), true[:, 1:-1, 1:-1].astype(np.float64)

    known, test = pressed(_selected(data, "train")), _selected(data, "test")
    found, true = pressed(test)
    yield (
        f"{folder}: bundle {bundle.digest[:16]}, {len(known[0])} presses that gains are fitted to,"
        f" {len(found)} held out, {data.source}"
    )

    slopes = slope_changes(emulator, data.frames[test], data.background, progress=progress)
    true_mm = data.depth_mm[test] - rest_mm
    change = np.stack(np.gradient(true_mm.astype(np.float64), pitch, axis=(2, 1)), axis=-1)
    yield "\nslopes: change from rest, share of the pixels, and how much of it is found"
    yield text_table(
        ["from", "to", "pixels, %", "found, %"],
        [
            [f"{row.low:g}", f"{row.high:g}", f"{100 * row.share:.1f}", row.percent]
            for row in attenuation(slopes.astype(np.float64), change)
        ],
    )

    spectra, held_out = tuple(map(modes, known)), modes(found)
    gains = gains_by_wavelength(*spectra)
    classes, size = wavelength_class(found.shape[-1]), found.shape[-1]
    yield "\nwavelengths: the gain that brings what is found nearest to the true displacement"
    longest = 2 * (size + 1) * pitch / np.sqrt(2)
    yield text_table(
        ["up to, mm", "gain"],
        [
            [f"{longest / 2 ** (k / PER_OCTAVE):.2f}", f"{gains[classes == k][0]:.2f}"]
            for k in np.unique(classes)
        ],
    )

    ways = {
        "as found": np.ones_like(gains),
        "a gain for each wavelength": gains,
        "a gain and a screening for each mode along the rows": gains_of_recurrences(*spectra),
    }
    errors = {name: 1e3 * np.abs(modes(held_out * gain) - true).mean() for name, gain in ways.items()}
    yield "\ndisplacement of the inner pixels: mean absolute error"
    yield text_table(
        ["modes of the solution", "error, µm"], [[name, f"{error:.2f}"] for name, error in errors.items()]
    )
