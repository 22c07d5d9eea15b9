"""The golden rules against cases written by hand; 2 lines of 3 beats unless stated."""

import pytest

from fastac.sim.faults.frame_rules import FrameRules


def play(text: str, *, enabled: bool = True) -> tuple[FrameRules, list]:
    """The rules after beats: S start of frame, L end of line, T both, . neither, and _ for a silence."""
    rules, frames = FrameRules(2, 3), []
    for k, sign in enumerate(text.replace(" ", "")):
        if sign == "_":
            rules.silence()
            continue
        frame = rules.beat(k, last=sign in "LT", start=sign in "ST", enabled=enabled)
        frames += [frame] if frame else []
    return rules, frames


GOOD = "S.L ..L"
CASES = {
    "good": (GOOD + GOOD, set(), [0, 0]),
    "line_short": ("SL ..L" + GOOD, {"line_short"}, [1, 0]),
    "first beat ends the line": ("T ..L" + GOOD, {"line_short"}, [1, 0]),
    "line_long": ("S.. ..L ..L" + GOOD, {"line_long"}, [1, 0]),
    "last line long": ("S.L ... .L" + GOOD, {"line_long"}, [1, 0]),
    "no end of line at all": ("S.. ..." + GOOD, {"line_long", "frame_short"}, [1, 0]),
    "frame_short": ("S.L" + GOOD, {"frame_short"}, [1, 0]),
    "frame_short inside a line": ("S." + GOOD, {"frame_short"}, [1, 0]),
    "frame_long": (GOOD + "..L ..L" + GOOD, {"frame_long"}, [0, 0]),
    "no_start": ("..L ..L" + GOOD, {"no_start"}, [0]),
    "timeout": ("S.L ._" + GOOD, {"frame_timeout"}, [1, 0]),
    "late beats after a timeout": ("S.L _ ..L" + GOOD, {"frame_timeout"}, [1, 0]),
    "silence between frames": (GOOD + "_" + GOOD + "_", set(), [0, 0]),
    "short and long in one frame": ("SL ... .L" + GOOD, {"line_short", "line_long"}, [1, 0]),
}


@pytest.mark.parametrize("name", CASES)
def test_flags_and_bad_frames(name):
    text, flags, bad = CASES[name]
    rules, frames = play(text)
    assert rules.flags == flags
    assert [int(frame.bad) for frame in frames] == bad
    assert rules.possible == set()
    # The frame after the fault is what was sent.
    last = len(text.replace(" ", "").rstrip("_")) - 6
    assert frames[-1].sources == [(k, False) for k in range(last, last + 6)]


def test_what_a_repaired_frame_is_made_of():
    _, (short, cut, *_) = play("SL ..L S" + GOOD)
    assert short.sources == [(0, False), (1, False), (1, True), (2, False), (3, False), (4, False)]
    assert cut.sources == [(5, False)] + [(5, True)] * 5
    _, (long, *_) = play("S.. ..L ..L" + GOOD)
    assert [beat for beat, _ in long.sources] == [0, 1, 2, 6, 7, 8]


def test_frames_are_dropped_while_disabled():
    rules, frames = play(GOOD + "..L" + GOOD, enabled=False)
    assert not frames
    assert rules.flags == set()


@pytest.mark.parametrize(
    ("hard", "flags", "possible"), [(True, set(), set()), (False, {"line_short"}, set())]
)
def test_a_reset_forgets_frames_and_a_hard_one_flags(hard, flags, possible):
    rules, _ = play("SL .")
    rules.reset(hard=hard)
    assert (rules.flags, rules.possible) == (flags, possible)
    assert (rules.frames, rules.finished, rules.seen) == ([], 0, False)
    rules.beat(9, last=False, start=False, enabled=True)
    assert "no_start" in rules.flags


def test_after_a_soft_reset_the_last_beats_flag_is_open():
    rules, _ = play("SL")
    rules.reset(hard=False)
    assert (rules.flags, rules.possible) == (set(), {"line_short"})
