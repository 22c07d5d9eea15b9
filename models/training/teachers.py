"""An ensemble of wide pixel networks, the teachers in the distillation of the hardware's small network.

With few recordings, the error of a single small network varies with its random initialisation by more than
the recordings' noise. The mean of several wide networks varies little, and the small network is trained to
reproduce it at any input, not only at the labelled ones.
Source: Hinton, Vinyals, Dean, "Distilling the Knowledge in a Neural Network", 2015.
"""

from itertools import pairwise

import torch
from torch import nn


class Ensemble(nn.Module):
    """`teachers` networks with three hidden layers of `width` neurons, evaluated together.

    Input: scaled features, (pixels, inputs) or (teachers, pixels, inputs). Output: in training mode each
    teacher's unit normals, (teachers, pixels, 3); in evaluation mode their mean direction, (pixels, 3).
    """

    def __init__(self, inputs: int, *, teachers: int, width: int):
        super().__init__()
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for a, b in pairwise((inputs, width, width, width, 3)):
            limit = a**-0.5
            self.weights.append(nn.Parameter(torch.empty(teachers, a, b).uniform_(-limit, limit)))
            self.biases.append(nn.Parameter(torch.empty(teachers, 1, b).uniform_(-limit, limit)))
        with torch.no_grad():
            self.biases[-1].copy_(torch.tensor([0.0, 0.0, 1.0]).expand(teachers, 1, 3))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = x.expand(len(self.weights[0]), *x.shape[-2:])
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = torch.baddbmm(bias, x, weight).relu()
        x = nn.functional.normalize(torch.baddbmm(self.biases[-1], x, self.weights[-1]), dim=-1)
        return x if self.training else nn.functional.normalize(x.mean(dim=0), dim=-1)
