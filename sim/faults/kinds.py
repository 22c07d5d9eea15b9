"""The kinds of faults of the campaign, and in which states of the frame guard each can begin."""

from dataclasses import dataclass

STATES = ("WAIT", "LINE", "DROP", "PAD", "FILL")
"""Of FrameGuard: between frames, in a line, dropping surplus beats, padding a line, padding a frame."""


@dataclass(frozen=True)
class Kind:
    """A kind of fault.

    meaning : what happens
    beats : it is made of beats of the input, and begins with the first beat of the faulty line or frame; else
        it begins where the guard is made to wait for it
    needs : "": any hardware; "stream": an output stream; "streams": two of them; "calibration": loadable
    impossible : {state: reason} where it cannot begin
    weight : how often it is drawn
    """

    meaning: str
    beats: bool = False
    needs: str = ""
    impossible: dict[str, str] | None = None
    weight: int = 1

    def states(self) -> tuple[str, ...]:
        return tuple(state for state in STATES if state not in (self.impossible or {}))


_UNSEEN = "before the first frame after a reset the guard is in WAIT"
_BUSY = "a frame is in flight, so the calibration is refused (calibration_refused)"
NEVER_STARTED = dict.fromkeys(("LINE", "DROP", "PAD", "FILL"), _UNSEEN)
IN_FLIGHT = dict.fromkeys(("LINE", "PAD", "FILL"), _BUSY)
KINDS = {
    "line_short": Kind("a line ends early", beats=True),
    "line_long": Kind("a line has too many beats", beats=True),
    "line_unended": Kind("a line has no end, so that the next one is lost", beats=True),
    "frame_short": Kind("lines are missing at a frame's end", beats=True),
    "frame_cut": Kind("a frame breaks off inside a line, and the next one starts", beats=True),
    "frame_long": Kind("a frame has too many lines", beats=True),
    "no_start": Kind(
        "after a reset come lines without a start of frame", beats=True, impossible=NEVER_STARTED
    ),
    "garbage": Kind("beats with random ends of line and starts of frame", beats=True),
    "overload": Kind("a frame whose values saturate", beats=True),
    "camera_stops": Kind("the camera stops until the timeout; late beats may follow"),
    "camera_pauses": Kind("the camera stops for less than the timeout"),
    "input_stalls": Kind("bursts of pauses at the input"),
    "output_stalls": Kind("a burst of stalls at one output, or at all", needs="stream"),
    "output_blocked": Kind("one output is not read for one to three frames", needs="stream"),
    "outputs_blocked": Kind("no output is read for one to three frames", needs="streams"),
    "disabled": Kind("frames are disabled, and enabled again later"),
    "soft_reset": Kind("a soft reset"),
    "soft_reset_blocked": Kind("a soft reset while outputs are not read", needs="stream"),
    "hard_reset": Kind("a hard reset"),
    "hard_reset_in_read": Kind("a hard reset inside a register read"),
    "hard_reset_in_write": Kind("a hard reset inside a register write"),
    "power_up": Kind("flip-flops at random values, then a hard reset"),
    "registers_read": Kind("the host reads all registers"),
    "registers_absent": Kind("the host reads and writes where no register is"),
    "registers_refused": Kind("the host writes read-only registers, and writes without byte strobes"),
    "calibration_busy": Kind("a word of a calibration while frames are in flight", needs="calibration"),
    "calibration_foreign": Kind("the first word of other hardware's calibration", needs="calibration"),
    "calibration_loaded": Kind(
        "a calibration is loaded; a frame that comes waits", needs="calibration", impossible=IN_FLIGHT
    ),
    "calibration_restarted": Kind(
        "a calibration is cut off and begun again", needs="calibration", impossible=IN_FLIGHT
    ),
    "calibration_reset": Kind(
        "a reset inside a calibration, which is then completed", needs="calibration", impossible=IN_FLIGHT
    ),
}
SECOND = (
    "line_short",
    "line_long",
    "line_unended",
    "camera_pauses",
    "camera_stops",
    "input_stalls",
    "output_stalls",
    "output_blocked",
    "outputs_blocked",
    "soft_reset",
    "hard_reset",
    "power_up",
    "registers_read",
    "registers_absent",
    "registers_refused",
    "disabled",
)
"""What may happen as a second fault in the same frame."""


def kinds_of(streams: int, *, loadable: bool) -> dict[str, Kind]:
    """The kinds that hardware with so many output streams can have."""
    lacking = {"": False, "stream": streams < 1, "streams": streams < 2, "calibration": not loadable}
    return {name: kind for name, kind in KINDS.items() if not lacking[kind.needs]}
