"""The driver of a small design behind every transport."""

import pytest
from driven_design import (  # noqa: F401
    TRANSPORTS,
    bundle,
    description,
    expected,
    frames,
    opened,
    recalibrated,
    simulation,
    simulator_folder,
    verilog,
)

from fastac.driver.driver import Driver


@pytest.fixture(params=TRANSPORTS)
def transport(request, opened):  # noqa: F811
    with opened(request.param) as found:
        yield found


@pytest.fixture
def driver(transport, description) -> Driver:  # noqa: F811
    return Driver(transport, description)
