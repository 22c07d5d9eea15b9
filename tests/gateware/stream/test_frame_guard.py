# amaranth: UnusedElaboratable=no
import json
import random

import pytest

from fastac.gateware.stream.frame_guard import FRAME_FAULTS, FrameGuard
from fastac.sim.runner import simulate

PAUSE = None
"""In a sequence of beats: the camera sends nothing until a frame that it has begun counts as abandoned."""
TIMEOUT = 100
"""Clocks; random pauses between two beats are shorter."""


def reference(beats, height, line_beats, lanes, pixel_bits):
    """Golden model of FrameGuard for beats (tdata, tlast, tuser, enable) and PAUSE, a plain loop.

    Returns the output words, `frame_bad` of each frame, and the number of pulses of each flag.
    """
    total = height * line_beats
    frame, bad, sent, verdicts = None, 0, [], []
    surplus, reported, seen = False, False, False
    flags = dict.fromkeys((*FRAME_FAULTS, "frame_started", "frame_done"), 0)

    def again(word):
        pixel = word >> (pixel_bits * (lanes - 1))
        return sum(pixel << (pixel_bits * lane) for lane in range(lanes))

    def close():
        nonlocal frame
        frame += [again(frame[-1])] * (total - len(frame))
        sent.extend(frame)
        verdicts.append(bad)
        flags["frame_done"] += 1
        frame = None

    for beat in beats:
        if beat is PAUSE:
            if frame is not None:
                flags["frame_timeout"] += 1
                bad, surplus, reported = 1, False, True
                close()
            continue
        word, last, start, enable = beat
        if start:
            if frame is not None:
                flags["frame_short"] += 1
                bad = 1
                close()
            surplus = False
            if not enable:
                reported = True
                continue
            frame, bad, seen, reported = [], 0, True, False
            flags["frame_started"] += 1
        elif surplus:
            surplus = not last
            continue
        elif frame is None:
            flags["frame_long" if seen else "no_start"] += not reported
            reported = True
            continue
        frame.append(word)
        ends = len(frame) % line_beats == 0
        if last and not ends:
            flags["line_short"] += 1
            bad = 1
            frame += [again(word)] * (-len(frame) % line_beats)
        if ends and not last:
            flags["line_long"] += 1
            bad, surplus = 1, True
        if len(frame) == total:
            close()
    # The beats of an unfinished last frame have left too.
    return sent + (frame or []), verdicts, flags


class Camera:
    """Generates beats of random pixels, so that every displaced or repeated pixel is detected."""

    def __init__(self, guard, seed):
        self.guard, self.rng = guard, random.Random(seed)
        self.bits = 8 * guard.channels * guard.lanes

    def line(self, beats=None, *, start=0, last=1, enable=1):
        beats = self.guard.line_beats if beats is None else beats
        return [
            (self.rng.getrandbits(self.bits), int(last and k == beats - 1), int(start and k == 0), enable)
            for k in range(beats)
        ]

    def frame(self, lines=None, *, enable=1):
        lines = self.guard.height if lines is None else lines
        return [beat for k in range(lines) for beat in self.line(start=k == 0, enable=enable)]

    def garbage(self, beats):
        """Random beats with random `tlast` and `tuser`."""
        odds = self.rng.choice([(0.3, 0.05), (0.05, 0.02), (0.5, 0.5)])
        return [
            (
                self.rng.getrandbits(self.bits),
                int(self.rng.random() < odds[0]),
                int(self.rng.random() < odds[1]),
                1,
            )
            for _ in range(beats)
        ]

    def faulty_frame(self):
        """A frame with a few faults in random places."""
        whole, rng = self.guard.line_beats, self.rng
        beats = []
        for k in range(self.guard.height + rng.choice([0, 0, 0, -1, 1])):
            n = max(1, whole + rng.choice([0, 0, 0, -1, 1, 3]))
            beats += self.line(n, start=k == 0, last=rng.random() < 0.9)
        return beats


def sequences(guard, randoms):
    camera = Camera(guard, 1)
    height, whole = guard.height, guard.line_beats
    frame, line = camera.frame, camera.line
    alone = {
        "line_long": frame(1) + line(whole + 2) + [b for _ in range(height - 2) for b in line()],
        "line_long, the last": frame(height - 1) + line(whole + 2),
        "line_long, no end at all": frame(1) + line(whole + 2, last=0),
        "line_long, the last, no end": frame(height - 1) + line(whole, last=0),
        "frame_short": frame(height - 1),
        "frame_short, one beat": line(1, start=1, last=whole == 1),
        "frame_long": frame(height + 2),
        "no_start": line() + line(),
        "frame_timeout": [*frame(1), PAUSE],
        "frame_timeout, first beat": [*line(1, start=1, last=0), PAUSE],
        "frame_timeout, the rest comes late": [*frame(1), PAUSE, *line(), *line()],
        "frame_timeout, in a long line": [*line(whole + 1, start=1, last=0), PAUSE, *line(2)],
    }
    if whole > 1:
        alone |= {
            "line_short": frame(1) + line(1) + [b for _ in range(height - 2) for b in line()],
            "line_short, the last": frame(height - 1) + line(whole - 1),
            "line_short, the first beat": line(1, start=1) + [b for _ in range(height - 1) for b in line()],
            "frame_short inside a line": frame(1) + line(whole - 1, last=0),
        }
    # Each fault follows a good frame (except no_start) and precedes two frames that must be good.
    cases = {
        name: ([] if name == "no_start" else frame()) + beats + frame() + frame()
        for name, beats in alone.items()
    }
    cases["good"] = frame() + frame() + frame()
    unended = frame(height - 1) + line(last=0)  # complete, but its last line has no end
    cases["pauses between frames"] = [PAUSE, *frame(), PAUSE, *unended, PAUSE, *line(), *frame(), PAUSE]
    cases["pauses between frames"] += frame()
    cases["dropped while disabled"] = (
        frame(enable=0) + frame() + frame(enable=0) + frame(1, enable=0) + frame()
    )
    cases["disabled inside a frame"] = frame(1) + line(enable=0) * (height - 1) + frame(enable=0) + frame()
    for k in range(randoms):
        parts = [
            camera.rng.choice([frame, camera.faulty_frame, lambda: camera.garbage(20)])() for _ in range(5)
        ]
        beats = [beat for part in parts for beat in part]
        for _ in range(camera.rng.choice([0, 0, 1, 2])):
            beats.insert(camera.rng.randrange(len(beats)), PAUSE)
        cases[f"random {k}"] = beats + frame() + frame()
    return cases


@pytest.mark.parametrize(
    ("height", "width", "channels", "lanes", "randoms"),
    [(3, 4, 3, 2, 15), (3, 8, 3, 2, 25), (2, 4, 1, 4, 25)],
)
@pytest.mark.quick("3-4-3-2-15")
def test_bit_exact_to_golden_model(tmp_path, height, width, channels, lanes, randoms):
    guard = FrameGuard(height, width, channels, lanes=lanes)
    settings = []
    for name, beats in sequences(guard, randoms).items():
        sent, bad, flags = reference(beats, height, guard.line_beats, lanes, 8 * channels)
        kind = name.split(",")[0].split(" ")[0]
        if kind in FRAME_FAULTS:
            assert flags[kind] == 1, name
        # The last frame is unchanged, whatever came before.
        good = [word for word, *_ in beats[-guard.beats :]]
        assert sent[-guard.beats :] == good, name
        assert bad[-1] == 0, name
        settings.append(
            {
                "name": name,
                "beats": [beat and [hex(beat[0]), *beat[1:]] for beat in beats],
                "expected": [hex(word) for word in sent],
                "bad": bad,
                "flags": flags,
                "steady": name == "good",
            }
        )
    path = tmp_path / "bench.json"
    bench = {
        "sequences": settings,
        "frame_beats": guard.beats,
        "latency": guard.latency,
        "linger": 2 * guard.beats,
        "timeout": TIMEOUT,
        "timeout_cycles": 20_000,
    }
    path.write_text(json.dumps(bench))
    simulate(guard, "frame_guard", "fastac.sim.benches.frame_guard", tmp_path, BENCH=str(path))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1, 8, 3, 2), "height 1: expected at least 2"),
        ((4, 7, 3, 2), "width 7: expected a multiple of lanes, 2"),
        ((4, 0, 3, 2), "width 0: expected a multiple of lanes, 2"),
        ((4, 8, 0, 2), "channels 0: expected at least 1"),
        ((4, 8, 3, 0), "lanes 0: expected at least 1"),
    ],
)
def test_invalid_arguments(arguments, message):
    *shape, lanes = arguments
    with pytest.raises(ValueError, match=message):
        FrameGuard(*shape, lanes=lanes)
