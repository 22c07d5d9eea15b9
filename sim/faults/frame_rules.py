"""Golden model of the documented rules for bad streams: which frames leave, and which flags stand."""

from dataclasses import dataclass, field


@dataclass(eq=False)
class Frame:
    """A frame that the input has begun.

    start : index of its first beat among all beats
    sources : for each of its beats the index of the beat it was made of, and whether it repeats that beat's
        last pixel
    """

    start: int
    sources: list[tuple[int, bool]] = field(default_factory=list)
    bad: bool = False


class FrameRules:
    """What becomes of a stream of beats, each with `last` and `start`, of pauses and of resets.

    The rules are those that `FrameGuard` documents. They do not depend on timing: only after a soft reset it
    is open whether the last beat before it had been looked at.

    flags : errors that must stand; possible : errors that may stand as well
    frames : the frames that have started since the last reset, in order, the unfinished one included
    """

    def __init__(self, height: int, line_beats: int):
        self.height, self.line_beats = height, line_beats
        self.flags: set[str] = set()
        self.possible: set[str] = set()
        self._confirmed: set[str] = set()
        self.seen = False
        self._forget()

    def _forget(self) -> None:
        self.frame: Frame | None = None
        self.frames: list[Frame] = []
        self.surplus = self.reported = self.seen = False

    @property
    def finished(self) -> int:
        """Number of frames that are complete since the last reset."""
        return len(self.frames) - (self.frame is not None)

    def forget_frames(self) -> None:
        """Leave the complete frames out of `frames` from here on."""
        self.frames = [self.frame] if self.frame else []

    def clear_flags(self) -> None:
        self.flags, self.possible, self._confirmed = set(), set(), set()

    def reset(self, *, hard: bool) -> None:
        """Forget the frames; a hard reset clears the flags too."""
        if hard:
            self.clear_flags()
        else:
            self.possible |= self.flags - self._confirmed
            self.flags = set(self._confirmed)
        self._forget()

    def silence(self) -> bool:
        """The camera sends nothing for longer than the timeout. Returns whether a frame was abandoned."""
        if self.frame is None:
            return False
        self.flags.add("frame_timeout")
        self._confirmed = set(self.flags)
        self.surplus, self.reported = False, True
        self._close(bad=True)
        return True

    def beat(self, index: int, *, last: bool, start: bool, enabled: bool) -> Frame | None:
        """The next beat is accepted; returns the frame that it starts, if any."""
        self._confirmed = set(self.flags)
        if start:
            if self.frame is not None:
                self.flags.add("frame_short")
                self._close(bad=True)
            self.surplus = False
            if not enabled:
                self.reported = True
                return None
            self.frame, self.seen, self.reported = Frame(index), True, False
            self.frames.append(self.frame)
        elif self.surplus:
            self.surplus = not last
            return None
        elif self.frame is None:
            if not self.reported:
                self.flags.add("frame_long" if self.seen else "no_start")
            self.reported = True
            return None
        frame = self.frame
        frame.sources.append((index, False))
        ends = len(frame.sources) % self.line_beats == 0
        if last and not ends:
            self.flags.add("line_short")
            frame.bad = True
            frame.sources += [(index, True)] * (-len(frame.sources) % self.line_beats)
        if ends and not last:
            self.flags.add("line_long")
            frame.bad = self.surplus = True
        if len(frame.sources) == self.height * self.line_beats:
            self._close(bad=frame.bad)
        return frame if start else None

    def _close(self, *, bad: bool) -> None:
        frame, missing = self.frame, self.height * self.line_beats - len(self.frame.sources)
        frame.sources += [(frame.sources[-1][0], True)] * missing
        frame.bad = bad
        self.frame = None
