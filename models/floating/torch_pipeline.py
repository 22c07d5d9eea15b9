"""The float pipeline on a torch device, such as a GPU: the stages of `FloatPipeline`, one frame at a time.

The sine transforms are matrix products, as in the float pipeline.
"""

from collections.abc import Callable

import numpy as np
import torch

from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer.features import integer_features, scales
from fastac.models.integer.laplacian import STENCILS, divergence_of, eigenvalues, sine_matrix
from fastac.models.integer.smoothing import shift, weights


class TorchPipeline:
    """A float pipeline with its weights on `device`; the scene must have a depth solver.

    Force is computed if the pipeline has force weights. Raises ValueError where marker dots have a part in
    slopes or force: what finds them does not run on the device.
    """

    def __init__(self, pipeline: FloatPipeline, device: str):
        scene, background = pipeline.scene, pipeline.background
        if scene.wants_darkness:
            raise ValueError(f"scene {scene.name}: its dots are not found on a torch device")
        self.device = torch.device(device)
        self.pitch_mm, self.divergence = scene.sensor.pitch_mm, scene.poisson.divergence
        self.limit, self.clamp = scene.numbers.slope_limit, not scene.force.signed
        self.shape = background.shape[:2]
        size = self.shape[0] - 2

        def here(array: np.ndarray) -> torch.Tensor:
            return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32)).to(self.device)

        channels = background.shape[-1]
        unit = scales(channels)
        at_rest = integer_features(background, background)
        self.places = here(at_rest[..., channels:] * unit[channels:]).reshape(-1, 2)
        self.background = here(background)
        self.unit, self.window = here(unit[:channels]), None
        if window_px := scene.network.smoothing_px:
            taps = weights(window_px)
            window = np.outer(taps, taps) * 2.0 ** -shift(window_px)
            self.window = here(np.broadcast_to(window, (channels, 1, *window.shape)))
        self.layers = [
            (layer.weight.detach().to(self.device), layer.bias.detach().to(self.device))
            for layer in pipeline.network.linear_layers
        ]
        self.sine = here(sine_matrix(size))
        self.reciprocal = here(-self.pitch_mm / eigenvalues(size))
        self.rest_slopes = here(pipeline.rest_slopes())
        self.weight = None
        if pipeline.force_weights is not None:
            weight = pipeline.pixel_weights
            self.bends_mm = scene.force.bends_mm
            self.weight = here(weight.reshape(len(weight), -1))

    @torch.inference_mode()
    def normals(self, frame: torch.Tensor) -> torch.Tensor:
        """Frame (H, W, C) uint8 on the device to slopes (H, W, 2)."""
        x = self._smoothed(frame.to(torch.float32) - self.background) * self.unit
        x = torch.cat([x.reshape(-1, x.shape[-1]), self.places], dim=1)
        for weight, bias in self.layers[:-1]:
            x = torch.relu(torch.addmm(bias, x, weight.T))
        weight, bias = self.layers[-1]
        normal = torch.addmm(bias, x, weight.T)
        # Where n_z ≤ 0 the slope is the limit: the quotient would have the wrong sign.
        slopes = torch.where(
            normal[:, 2:] > 0, -normal[:, :2] / normal[:, 2:], -torch.sign(normal[:, :2]) * self.limit
        )
        return torch.nan_to_num(slopes).clamp(-self.limit, self.limit).reshape(*self.shape, 2)

    def _smoothed(self, difference: torch.Tensor) -> torch.Tensor:
        """ΔI (H, W, C), integers, as `integer.smoothing.smoothed` where the scene wants it."""
        if self.window is None:
            return difference
        half = self.window.shape[-1] // 2
        planes = torch.nn.functional.pad(difference.permute(2, 0, 1)[None], [half] * 4, mode="replicate")
        means = torch.nn.functional.conv2d(planes, self.window, groups=len(self.window))
        return torch.floor(means[0] + 0.5).permute(1, 2, 0)

    @torch.inference_mode()
    def depth(self, slopes: torch.Tensor) -> torch.Tensor:
        """Slopes (H, W, 2) to the displacement (N, N) in mm."""
        change, scale = slopes - self.rest_slopes, STENCILS[self.divergence].scale
        source = divergence_of(change, self.divergence) * scale
        return self.sine @ (self.sine @ source @ self.sine * self.reciprocal) @ self.sine

    @torch.inference_mode()
    def force(self, displacement_mm: torch.Tensor) -> torch.Tensor:
        """The displacement (N, N) in mm to force_n (axes,)."""
        x = displacement_mm.clamp(min=0) if self.clamp else displacement_mm
        if self.bends_mm:
            band, *deep = self.bends_mm
            beyond = (x - band).clamp(min=0), (x + band).clamp(max=0)
            x = torch.stack([x, *beyond, *((x - bend).clamp(min=0) for bend in deep)], dim=-1)
        return self.weight @ x.reshape(-1)

    def stages(self) -> dict[str, Callable[[torch.Tensor], torch.Tensor]]:
        """As `FloatPipeline.stages`, on tensors on the device."""
        found = {"normals": self.normals, "depth": self.depth}
        return found if self.weight is None else found | {"force": self.force}

    def to_device(self, frame: np.ndarray) -> torch.Tensor:
        """Copy a frame to the device."""
        return torch.from_numpy(frame).to(self.device)

    def synchronise(self) -> None:
        """Wait until the device has finished its queued work."""
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)
