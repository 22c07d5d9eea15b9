"""The table of `fastac chips`: which part holds which scene's hardware at which rate of the camera."""

from collections.abc import Sequence
from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from fastac.gateware.target.device import LUT_MARGIN
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.report.scope import label
from fastac.report.tables import markdown_table
from fastac.scenes.pace import Pace
from fastac.scenes.parts import PARTS
from fastac.scenes.schema import Scene
from fastac.synth import fits
from fastac.synth.estimates import resources
from fastac.synth.fits import random_pipeline


@dataclass(frozen=True)
class Fit:
    """A scene's hardware on a part at a camera's rate; `pace` is None where no hardware is fast enough."""

    pace: Pace | None
    area: fits.Area | None

    @property
    def text(self) -> str:
        """Pixels a clock and the shares that they take of the part, behind a "no" where they do not fit."""
        if self.area is None:
            return "no: too fast"
        return f"{'' if self.area.fits else 'no: '}{self.pace.value} px/clock: {self.area.shares}"


def fit(pipeline: IntegerPipeline, part: str, frames_per_second: float, clock_mhz: float) -> Fit:
    """The smallest hardware that never makes a camera of this rate wait, on a part.

    The camera has the pauses of the pipeline's scene.
    """
    scene = pipeline.scene
    hardware = {"pixels_per_clock": "camera", "clock_mhz": clock_mhz, "part": part}
    changes = {
        "sensor": scene.sensor.model_copy(update={"frames_per_second": frames_per_second}),
        "hardware": scene.hardware.model_copy(update=hardware),
    }
    paced = pipeline.replace(scene=scene.model_copy(update=changes))
    try:
        pace = paced.scene.pace
    except ValueError:
        return Fit(None, None)
    return Fit(pace, fits.area(paced))


def table(scenes: Sequence[Scene], rates: Sequence[float], clock_mhz: float) -> str:
    """A Markdown table with a row for each scene and part, and a column for each rate, frames/s."""
    rows = []
    for scene in scenes:
        with threadpool_limits(1):  # more are slower: all products are small
            pipeline = random_pipeline(scene)
            for part in PARTS:
                found = [fit(pipeline, part, rate, clock_mhz).text for rate in rates]
                rows.append([scene.name, label(part), *found])
    head = ["scene", "part, boards", *(f"{rate:g} frames/s" for rate in rates)]
    return "\n\n".join([markdown_table(head, rows), *notes(clock_mhz)])


def notes(clock_mhz: float) -> list[str]:
    """What the figures are."""
    _, origins = resources.model(is_folded=True)
    return [
        f"At {clock_mhz:g} MHz, an assumption; pixels a clock: the fewest with which the camera never waits."
        " Shares are estimates of the area, with random weights. “no”: `fastac build` would refuse the scene,"
        f" for a lack of DSP slices or RAMB36, or of look-up tables by more than {100 * LUT_MARGIN:.0f}%.",
        f"Look-up tables: {origins['lut']}.",
    ]
