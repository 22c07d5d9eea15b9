"""Fixtures of the gateware tests."""

import pytest

from fastac.sim.preloaded import ConstantParameters


@pytest.fixture
def with_parameters():
    """Wrapper that gives a loadable component constant parameters."""
    return ConstantParameters
