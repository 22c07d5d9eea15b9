"""What the page's view of a reconstruction in three dimensions is given: heights and colours of the skin.

The view itself is the script `surface.js.j2`, which draws on a plain canvas: no WebGL, no library, a few
kilobytes. Plotly's script would make every page 4.8 MB larger.
"""

import base64
from collections.abc import Sequence

import numpy as np

from fastac.models.result import Result
from fastac.report.panels import shades
from fastac.scenes.schema import Scene

COLOURS, SHADES = "YlOrRd", 64
SHOWN_HEIGHT, MOST_RISE = 0.25, 10
"""The range of heights is first drawn as this share of the image's width, so that a flat gel shows something
too; at most this many times the true height."""
TOP = np.iinfo(np.uint16).max


def view(scene: Scene, samples: Sequence[int], found: Result) -> dict:
    """The skin that was found in each of `samples`, for the script, as JSON can express it.

    Heights are the inner N × N of depth_mm, colours the displacement; both as 16-bit words, low byte first,
    in base64, between the stated ends in mm. `rise` is how many times higher than true they are first drawn.
    """
    frames, most = [], 0.0
    for k, sample in enumerate(samples):
        depth_mm, displacement_mm = found.depth_mm[k][1:-1, 1:-1], found.displacement_mm[k]
        most = max(most, float(np.ptp(depth_mm)))
        frames.append(
            {"name": f"frame {sample}", "height": _words(depth_mm), "colour": _words(displacement_mm)}
        )
    rise = SHOWN_HEIGHT * scene.inner_px * scene.sensor.pitch_mm / most if most else 1
    return {
        "rise": round(min(max(rise, 1), MOST_RISE)),
        "size": scene.inner_px,
        "pitchMm": scene.sensor.pitch_mm,
        "shades": shades(COLOURS, SHADES),
        "frames": frames,
    }


def _words(values: np.ndarray) -> dict:
    low, high = float(values.min()), float(values.max())
    words = np.round((values - low) / (high - low if high > low else 1) * TOP).astype("<u2")
    return {"lowMm": low, "highMm": high, "words": base64.b64encode(words.tobytes()).decode()}
