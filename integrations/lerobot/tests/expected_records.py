"""Run by FasTac's Python, not by LeRobot's: a build's records in a file, for test_served.py."""

import sys
from pathlib import Path

import numpy as np

from fastac.streaming.session import open_session

build, target = map(Path, sys.argv[1:])
with open_session(build) as session:
    found = list(session.records())
    np.savez(
        target,
        force_n=[list(one.force_n.values()) for one in found],
        suspect=[one.suspect or one.bad for one in found],
        source_time_ns=[one.source_time_ns for one in found],
        **{name: [one.arrays[name] for one in found] for name in session.about.arrays},
    )
