import io
import sys
import time

import pytest

from fastac.store import progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_a_bar(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert list(progress.progress_bar(range(3), desc="frames")) == [0, 1, 2]
    assert "\rframes:" in terminal.getvalue()


def test_a_file_gets_nothing_of_short_work(capsys):
    with progress.progress_bar(total=3, desc="frames", leave=True) as bar:
        bar.update(2)
        bar.set_postfix(loss="0.1")
    assert list(progress.progress_bar(range(3), desc="frames")) == [0, 1, 2]
    assert capsys.readouterr().err == ""


def test_a_file_gets_plain_lines_of_long_work_at_most_one_a_minute(capsys, monkeypatch):
    now = 1000.0  # sums of half minutes are exact
    monkeypatch.setattr(progress.time, "monotonic", lambda: now)
    with progress.progress_bar(total=10, desc="frames", unit="frame", leave=True) as bar:
        for _ in range(10):
            now += progress.LINE_INTERVAL_S / 2
            bar.update()
            bar.refresh()
    written = capsys.readouterr().err
    lines = written.split("\n")
    assert "\r" not in written
    assert len(lines) == 5 + 1
    assert lines[-1] == ""
    assert [line.split("|")[0].split("[")[0].strip() for line in lines[:2]] == [
        "frames:  20% 2/10",
        "frames:  40% 4/10",
    ]


@pytest.mark.parametrize("position", [None, lambda: 7])
def test_disabled_bars_are_silent_everywhere(monkeypatch, position):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert list(progress.progress_bar(range(2), desc="frames", enabled=False)) == [0, 1]
    with progress.watched("elaborating", enabled=False, position=position):
        pass
    assert terminal.getvalue() == ""


def test_watched_work_reports_its_position(capsys, monkeypatch):
    monkeypatch.setattr(progress, "LINE_INTERVAL_S", 0.0)
    monkeypatch.setattr(progress, "POLL_S", 0.01)
    written = ""
    with progress.watched("simulating", enabled=True, total=100, unit="cycle", position=lambda: 25):
        deadline = time.monotonic() + 10
        while "25/100" not in written and time.monotonic() < deadline:
            time.sleep(0.01)
            written += capsys.readouterr().err
    assert "simulating:  25% 25/100" in written


def test_watched_work_ends_with_its_own_error(capsys):
    with pytest.raises(ValueError, match="of the work"), progress.watched("linting", enabled=True):
        raise ValueError("of the work")
