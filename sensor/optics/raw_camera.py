"""A camera with an RGB-IR filter array: from the light of four channels to a 10-bit RAW image.

In order: vignetting, filter array with crosstalk of NIR into the visible pixels, photon noise, read noise,
black level, dead and hot pixels, 10 bits. The layout is that of the paper's OV2736 (sensor/optics/mosaic.py);
its data sheet is not public, so that every number here is an assumption, named in `RawCamera`.
"""

from dataclasses import dataclass

import numpy as np

from fastac.sensor.optics.mosaic import MosaicError, mosaic

MAXIMUM = 2**10 - 1


@dataclass(frozen=True)
class RawCamera:
    """Parameters of one camera, in 10-bit digital numbers (DN); its dead pixels are the same in every
    frame."""

    crosstalk: tuple[float, float, float] = (0.8, 0.8, 0.8)
    """NIR response of B, G and R pixels relative to that of NIR pixels: colour filters pass 850 nm."""
    black_level_dn: int = 64
    electrons_per_dn: float = 8.0
    """Conversion gain; at the default, full scale above the black level is 7,700 electrons."""
    read_noise_dn: float = 1.0
    """Standard deviation of the read noise."""
    vignetting: float = 0.2
    """Relative loss of light in the corners; it grows with the square of the distance from the centre."""
    dead_share: float = 1e-4
    """Share of defective pixels, half of them always 0 (dead) and half always 1023 (hot)."""
    seed: int = 0
    """Seed of the defective pixels' positions."""

    def __post_init__(self):
        limits = {
            "black_level_dn": (0, MAXIMUM - 1),
            "electrons_per_dn": (1e-3, 1e6),
            "read_noise_dn": (0, MAXIMUM),
            "vignetting": (0, 0.99),
            "dead_share": (0, 0.1),
        }
        for key, (low, high) in limits.items():
            if not low <= getattr(self, key) <= high:
                raise MosaicError(f"{key} = {getattr(self, key):g}: expected {low:g} to {high:g}")
        if len(self.crosstalk) != 3 or not all(0 <= share <= 2 for share in self.crosstalk):
            raise MosaicError(f"crosstalk = {self.crosstalk}: expected three numbers of 0 to 2, for B, G, R")

    def shading(self, height_px: int, width_px: int) -> np.ndarray:
        """Vignetting factor of each pixel, (H, W): 1 in the centre, 1 − vignetting in the corners."""
        v, u = np.linspace(-1, 1, height_px), np.linspace(-1, 1, width_px)
        return 1 - self.vignetting * (v[:, None] ** 2 + u**2) / 2

    def expected_dn(self, light: np.ndarray) -> np.ndarray:
        """The noise-free mosaic above the black level, (H, W) float64 in DN, not clipped.

        `light` (H, W, 4) is scene-linear B, G, R, NIR. A value of 1 gives 1023 − black level in an NIR pixel
        at the centre, and in a visible one without NIR light. Raises MosaicError on values that are not
        finite or are negative.
        """
        image = mosaic(light, self.crosstalk)
        if not (np.isfinite(light).all() and light.min() >= 0):
            raise MosaicError("light: expected finite numbers of at least 0")
        return image * self.shading(*image.shape) * (MAXIMUM - self.black_level_dn)

    def dead_pixels(self, height_px: int, width_px: int) -> tuple[np.ndarray, np.ndarray]:
        """Masks of the dead and of the hot pixels, (H, W) bool each."""
        draw = np.random.default_rng(self.seed).random((height_px, width_px))
        return draw < self.dead_share / 2, draw > 1 - self.dead_share / 2

    def expose(self, light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """One RAW image (H, W) uint16 of scene-linear `light` (H, W, 4); see `expected_dn`.

        Saturates at 0 and 1023, as the sensor's analogue-to-digital converter does.
        """
        expected = self.expected_dn(light)
        electrons = rng.poisson(expected * self.electrons_per_dn)
        signal = electrons / self.electrons_per_dn + self.read_noise_dn * rng.standard_normal(expected.shape)
        raw = np.clip(np.rint(signal + self.black_level_dn), 0, MAXIMUM).astype(np.uint16)
        dead, hot = self.dead_pixels(*raw.shape)
        raw[dead], raw[hot] = 0, MAXIMUM
        return raw
