"""A stream without FasTac: a stand-in that publishes known records until it is closed."""

import json
import time
from threading import Event, Thread

import numpy as np
import zmq

SIZE = 64
REST_MM = 2.0
ABOUT = {
    "format_version": 1,
    "scene": "stand-in",
    "bundle_sha256": "ab" * 32,
    "height_px": SIZE,
    "width_px": SIZE,
    "channels": ["B", "G", "R", "NIR"],
    "pitch_mm": 0.25,
    "depth_origin_px": [1, 1],
    "force_axes": ["x", "y", "z"],
    "arrays": ["depth_mm", "force_map_n", "image"],
    "validity": ["change"],
    "via": "emulator",
    "simulated_clock": True,
    "clock_mhz": 150.0,
    "source": "stand-in",
    "frames_per_second": 100.0,
}


def arrays(pressed_mm: float) -> dict[str, np.ndarray]:
    """Of a skin that is pressed in evenly: each inner pixel carries 0.001 N for each mm."""
    inner = (SIZE - 2, SIZE - 2)
    return {
        "depth_mm": np.full(inner, REST_MM - pressed_mm, "<f4"),
        "force_map_n": np.full((3, *inner), 0.001 * pressed_mm, "<f4"),
        "image": np.broadcast_to(np.uint8([10, 20, 30, 40]), (SIZE, SIZE, 4)),
    }


def record(frame: int, pressed_mm: float) -> list[bytes]:
    """The message of a record."""
    sent = arrays(pressed_mm)
    facts = {
        "format_version": 1,
        "frame": frame,
        "source_time_ns": 10_000_000 * frame,
        "lost": False,
        "bad": False,
        "suspect": pressed_mm > 1,
        "slipping": False,
        "reasons": ["change"] if pressed_mm > 1 else [],
        "force_n": {"x": 0.25 * pressed_mm, "y": -0.5 * pressed_mm, "z": pressed_mm},
        "force_raw": {"x": 1, "y": 2, "z": 3},
        "slip_px": None,
        "slip_dots": None,
        "arrays": [
            {"name": name, "unit": "", "dtype": array.dtype.str, "shape": array.shape}
            for name, array in sent.items()
        ],
    }
    timing = {
        "first_pixel_to_result_s": 1e-4,
        "last_pixel_to_result_s": 1e-5,
        "hardware_time_s": 0.01 * frame,
        "host_latency_s": 1e-3,
        "made_ns": time.time_ns(),
        "errors": [],
    }
    return [
        b"record",
        *(json.dumps(one).encode() for one in (facts, timing)),
        *(a.tobytes() for a in sent.values()),
    ]


class StandIn:
    """Publishes some hundred records a second.

    pressed_mm : how deep the skin is pressed in; may be changed at any time
    later_mm : the same from the hundredth record on that a subscriber got, where it is not None
    """

    def __init__(self, about: dict):
        self.pressed_mm = 0.0
        self.later_mm: float | None = None
        self._about, self._closing = about, Event()
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.XPUB)
        self._socket.set(zmq.LINGER, 0)
        self._socket.bind("tcp://127.0.0.1:0")
        self.address = self._socket.get_string(zmq.LAST_ENDPOINT)
        self._thread = Thread(target=self._publish)
        self._thread.start()

    def _publish(self) -> None:
        frame, turning = 0, None
        while not self._closing.is_set():
            if self._socket.poll(3):
                self._socket.recv()
                self._socket.send_multipart([b"about", json.dumps(self._about).encode()])
                turning = frame + 100
            if self.later_mm is not None and frame == turning:
                self.pressed_mm = self.later_mm
            self._socket.send_multipart(record(frame, self.pressed_mm))
            frame += 1
        self._socket.send_multipart([b"end", b"{}"])

    def close(self) -> None:
        """End the stream; may be called twice."""
        self._closing.set()
        self._thread.join()
        self._context.destroy(linger=100)
