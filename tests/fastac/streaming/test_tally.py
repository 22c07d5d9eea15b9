"""What a stream shows of itself."""

import io
import re

from fastac.streaming.record import StreamRecord, Timing
from fastac.streaming.tally import Tally, line


def test_the_summary_counts_flags_and_latencies(make_record):
    tally = Tally(enabled=False)
    assert tally.summary() == "0 frames"
    for k in range(10):
        tally.add(make_record(k, suspect=k < 3, timing=Timing(host_latency_s=1e-3 * (k + 1), made_ns=0)))
    tally.add(StreamRecord(10, 0, lost=True))
    tally.close()
    expected = r"11 frames in \d+\.\d s, 1 lost, 0 bad, 3 suspect, \d+\.\d frames/s, latency median 5.500 ms,"
    assert re.fullmatch(expected + " 99% 9.910 ms", tally.summary())


def test_slipping_is_counted_where_it_is_found(make_record):
    tally = Tally(enabled=False)
    tally.add(make_record(0, slip_px=0.5, slip_dots=4, slipping=True))
    assert ", 1 slipping, " in tally.summary()


def test_lines(make_record):
    assert line(StreamRecord(3, 0, lost=True), 99.96) == "frame 3  LOST  100.0 frames/s"
    shown = line(make_record(1, bad=True, slip_px=0.25), 10)
    assert shown == (
        "frame 1  F_x -0.500 N  F_z +1.250 N  depth 1.000 to 6.000 mm  slip 0.25 px"
        "  bad, suspect (change)  10.0 frames/s"
    )
    assert line(StreamRecord(4, 0), 0) == "frame 4  ok  0.0 frames/s"


def test_lines_elsewhere_than_on_a_terminal_come_once_a_second(make_record):
    shown = io.StringIO()
    tally = Tally(shown)
    for k in range(3):
        tally.add(make_record(k))
    assert [text[:7] for text in shown.getvalue().splitlines()] == ["frame 0"]
