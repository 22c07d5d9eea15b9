"""HyperForce on the 3-D displacement field, with the variants that the paper compares.

F_α = Σ_p w_α(c(p)) · v(p), where v(p) are the K×K patches of those components d_x, d_y, d_z that are inputs.
The kernels w are dynamic (from the hypernetwork, one per pixel) or fixed (one for all pixels).
Source: Lu et al., "FasTac", section "FEM-inspired Dynamic Convolution Network" and its table of force modes.
"""

import numpy as np
import torch
from torch import nn

from fastac.models.floating.hyperforce import HyperForce, force_map

INPUTS = {"xy": (0, 1), "z": (2,), "xyz": (0, 1, 2)}
"""Components of the displacement that are a model's inputs, by the name of the variant."""


class _Everywhere(nn.Module):
    """A constant feature at every pixel, with which the hypernetwork's last layer gives one fixed kernel."""

    def forward(self, coordinate: torch.Tensor) -> torch.Tensor:
        return torch.ones_like(coordinate[:, :1])


class HyperForce3D(HyperForce):
    """The model: displacements (frames, inputs, N, N) in mm to forces (frames, axes) in N.

    inputs : a key of INPUTS; dynamic : kernels from the hypernetwork, otherwise one for all pixels
    Raises ValueError on other `inputs`.
    """

    def __init__(
        self,
        coordinate: np.ndarray,
        *,
        kernel_size: int,
        hidden: int,
        inputs: str = "xyz",
        dynamic: bool = True,
        axes: int = 3,
    ):
        if inputs not in INPUTS:
            raise ValueError(f"inputs = {inputs!r}: expected one of {', '.join(INPUTS)}")
        outputs = axes * len(INPUTS[inputs])
        super().__init__(coordinate, kernel_size=kernel_size, hidden=hidden, axes=outputs)
        self.shape = (axes, len(INPUTS[inputs]))
        if not dynamic:
            self.layers = nn.Sequential(_Everywhere(), nn.Linear(1, outputs * kernel_size**2, bias=False))

    def kernels(self) -> torch.Tensor:
        """The kernels, (axes, inputs, N, N, K, K) in N per mm."""
        return super().kernels().unflatten(0, self.shape)

    def basis(self) -> torch.Tensor:
        """The features in which the kernels are linear, (pixels, features): the last hidden layer's outputs,
        and 1 for a bias."""
        hidden = self.layers[:-1](self.coordinate)
        if self.layers[-1].bias is None:
            return hidden
        return torch.cat([hidden, torch.ones_like(hidden[:, :1])], dim=1)

    def collapsed(self) -> torch.Tensor:
        """One weight per pixel and input, (axes, inputs, N, N).

        Equal to `hyperforce.collapse` of the kernels, but without all kernels in memory: the kernels are
        linear in the basis, so the sum over a patch's offsets is a convolution of the basis images.
        """
        last, k, n = self.layers[-1], self.kernel_size, self.size
        weight = last.weight if last.bias is None else torch.cat([last.weight, last.bias[:, None]], dim=1)
        window = weight.reshape(self.axes, k, k, -1).permute(0, 3, 1, 2).flip(2, 3)
        images = self.basis().T.reshape(1, -1, n, n)
        folded = nn.functional.conv2d(images, window, padding=k // 2)[0] * self.unit
        return folded.unflatten(0, self.shape)

    @torch.inference_mode()
    def features(self, displacement: torch.Tensor) -> np.ndarray:
        """Features in which the force is linear, (frames, inputs · K² · basis features), from displacements
        (frames, inputs, N, N) in mm.

        The last layer's weights are the coefficients.
        """
        k, n, basis = self.kernel_size, self.size, self.basis()
        half = k // 2
        padded = nn.functional.pad(displacement, (half, half, half, half))
        parts = [
            padded[:, c, i : i + n, j : j + n].reshape(len(displacement), -1) @ basis
            for c in range(self.shape[1])
            for i in range(k)
            for j in range(k)
        ]
        return torch.cat(parts, dim=1).numpy()

    @torch.no_grad()
    def set_last_layer(self, weights: np.ndarray) -> None:
        """Set the last layer to the weights (features, axes), in N per unit of `features`."""
        last = self.layers[-1]
        found = torch.from_numpy(weights.T / self.unit.item()).to(last.weight.dtype)
        found = found.reshape(len(last.weight), -1)
        last.weight.copy_(found[:, : last.in_features])
        if last.bias is not None:
            last.bias.copy_(found[:, -1])

    @torch.inference_mode()
    def force_map_n(self, displacement: np.ndarray) -> np.ndarray:
        """Force of each pixel, (..., axes, N, N) in N, from displacements (..., inputs, N, N) in mm."""
        kernels = self.kernels().numpy()
        return sum(force_map(displacement[..., c, :, :], kernels[:, c]) for c in range(self.shape[1]))
