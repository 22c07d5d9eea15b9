"""When this process began."""

import subprocess
import sys
import time

PROGRAM = """
import time
now = time.time_ns()
time.sleep(0.2)
from fastac.streaming.views import since_start
print(now, since_start.started_ns(), since_start.since_start_s(time.time_ns()))
"""


def test_a_process_began_before_its_first_line():
    before = time.time_ns()
    printed = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True
    ).stdout
    now, started, passed = printed.split()
    tick_ns = 20_000_000  # of the clock of /proc, twice
    assert before - tick_ns <= int(started) <= int(now) + tick_ns
    assert float(passed) >= 0.2 - tick_ns / 1e9
