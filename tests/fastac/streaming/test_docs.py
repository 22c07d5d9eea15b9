"""The reader of docs/stream.md that does without this package."""

import re
import subprocess
import sys
from pathlib import Path

from fastac.driver.run import Stop
from fastac.streaming.run import await_readers

PAGE = Path(__file__).parents[3] / "docs" / "stream.md"


def test_the_reader_in_the_documentation_reads(publisher, make_record):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert "fastac" not in code
    code = code.replace("tcp://127.0.0.1:5599", publisher.address)
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as reader:
        await_readers(publisher, 1, Stop(), progress=False)
        for k in range(2):
            publisher.add(make_record(k))
        publisher.close()
        lines = reader.stdout.read().splitlines()
    assert reader.returncode == 0
    assert lines[0] == "0 {'x': -0.5, 'z': 1.25} 0.003"
    assert lines[1] == "depth_mm mm <f4 [2, 3] 24 bytes"
    assert len(lines) == 4
