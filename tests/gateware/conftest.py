"""What several tests share: a loadable component as one with two streams, its parameters constant."""

import pytest

from fastac.sim.preloaded import ConstantParameters


@pytest.fixture
def with_parameters():
    return ConstantParameters
