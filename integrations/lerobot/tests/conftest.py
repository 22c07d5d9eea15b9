"""Streams without FasTac, and cameras connected to these."""

import numpy as np
import pytest
from lerobot_camera_fastac import FastacCamera, FastacCameraConfig
from stand_in import ABOUT, StandIn


@pytest.fixture
def serve():
    """`serve(force_axes=["z"])`: a stand-in whose description has these changes."""
    opened = []

    def serve(**changes) -> StandIn:
        opened.append(StandIn({**ABOUT, **changes}))
        return opened[-1]

    yield serve
    for one in opened:
        one.close()


@pytest.fixture
def connect(serve):
    """`connect(about={…}, content="depth", …)`: a camera connected to a stand-in, and the stand-in."""
    opened = []

    def connect(about: dict | None = None, **changes) -> tuple[FastacCamera, StandIn]:
        stream = serve(**(about or {}))
        opened.append(FastacCamera(FastacCameraConfig(address=stream.address, **changes)))
        opened[-1].connect()
        return opened[-1], stream

    yield connect
    for camera in opened:
        if camera.is_connected:
            camera.disconnect()


@pytest.fixture
def press():
    """`press(camera, stream, pressed_mm)`: the first image of the skin so pressed."""

    def press(camera: FastacCamera, stream: StandIn, pressed_mm: float) -> np.ndarray:
        stream.pressed_mm = pressed_mm
        while True:
            image = camera.async_read(timeout_ms=5000)
            if camera.record.force_n["z"] == pressed_mm:
                return image

    return press
