"""The pace of pixels: how many enter the hardware in a clock, or in how many clocks one does."""

from dataclasses import dataclass
from typing import Literal

PixelsPerClock = Literal[1, 2, 4, "1/2", "1/4", "1/8", "1/16", "camera"]
"""Values of `hardware.pixels_per_clock`. Below one, each multiplier serves several products of a pixel, one
after another. camera: the slowest that never makes the camera wait."""
FOLDS = (1, 2, 4, 8, 16)
"""Clocks between two pixels that there is hardware for; 1: none is shared over time."""
LANES = (1, 2, 4)
"""Pixels that may enter together."""


@dataclass(frozen=True)
class Camera:
    """A camera's readout: `height_px` lines of `width_px` pixels, `frames_per_second` times a second.

    line_blanking_px : pauses after each line, in pixels' times
    frame_blanking_lines : pauses after each frame, in lines' times

    A camera sends the pixels of a line at one pace, so that the pauses make it faster: in one pixel's time,
    1 / (frames_per_second · (height + frame blanking) · (width + line blanking)) s.
    """

    height_px: int
    width_px: int
    frames_per_second: float
    line_blanking_px: int = 0
    frame_blanking_lines: int = 0

    def clocks_per_pixel(self, clock_mhz: float) -> float:
        """Clocks from a line's pixel to its next."""
        lines, line = self.height_px + self.frame_blanking_lines, self.width_px + self.line_blanking_px
        return clock_mhz * 1e6 / (self.frames_per_second * lines * line)


@dataclass(frozen=True)
class Pace:
    """Pixels enter `lanes` at a time and `fold` clocks apart; one of the two is 1."""

    lanes: int = 1
    fold: int = 1

    @property
    def clocks_per_pixel(self) -> float:
        """Clocks that the hardware needs for a pixel."""
        return self.fold / self.lanes

    def margin(self, camera_clocks: float) -> float:
        """How much faster than a camera the hardware is, as a share: below 0 the camera waits.

        camera_clocks : clocks between the camera's pixels
        """
        return camera_clocks / self.clocks_per_pixel - 1

    @property
    def value(self) -> int | str:
        """The value of `hardware.pixels_per_clock`."""
        return f"1/{self.fold}" if self.fold > 1 else self.lanes


PACES = (*(Pace(1, fold) for fold in reversed(FOLDS)), *(Pace(lanes) for lanes in LANES[1:]))
"""All paces, the slowest first: the slower, the fewer look-up tables."""


def pace_of(pixels_per_clock: int | str) -> Pace:
    """The pace that a value of `hardware.pixels_per_clock` other than "camera" names."""
    return next(pace for pace in PACES if pace.value == pixels_per_clock)


def slowest_pace(camera_clocks: float, width_px: int) -> Pace:
    """The slowest pace at which a camera with `camera_clocks` clocks a pixel never waits.

    Only paces that divide lines of `width_px` pixels. Raises ValueError where no pace is fast enough.
    """
    able = [pace for pace in PACES if pace.margin(camera_clocks) >= 0 and width_px % pace.lanes == 0]
    if not able:
        most = max(lanes for lanes in LANES if width_px % lanes == 0)
        raise ValueError(
            f"hardware.pixels_per_clock: 'camera' sends {1 / camera_clocks:.3g} pixels a clock, and there is"
            f" hardware for {most} at most in lines of {width_px} pixels: raise hardware.clock_mhz or lower"
            " sensor.frames_per_second"
        )
    return able[0]
