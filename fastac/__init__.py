"""FasTac: tactile fingertips from frames to trained integers to verified hardware.

    sensor = fastac.load("build/paper")
    found = sensor.run(frame)

The names below come from `fastac/api.py`, which is imported when the first of them is used: parts of the
package that need none of it, the hardware above all, load nothing of it.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fastac.api import BundleError, Measurement, TactileSensor, load

__all__ = ["BundleError", "Measurement", "TactileSensor", "load"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'fastac' has no attribute {name!r}")
    from fastac import api

    return getattr(api, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
