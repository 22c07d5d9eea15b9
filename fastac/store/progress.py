"""Progress of long work on standard error: a bar on a terminal, a plain line now and then in a log file."""

import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

LINE_INTERVAL_S = 60.0
"""Between two lines of the same work where standard error is no terminal."""
POLL_S = 0.5


class _Lines(tqdm):
    """A progress bar for files and pipes: whole lines, without carriage returns, at most one a minute."""

    def __init__(self, *arguments, **settings):
        self.shown_s = time.monotonic()
        super().__init__(*arguments, **(settings | {"ncols": 0, "leave": False}))  # 0 columns: numbers only

    def display(self, msg: str | None = None, pos: int | None = None) -> bool:
        """Print a line if the last one is old enough; tqdm clears nothing where this returns False."""
        if msg is None and time.monotonic() - self.shown_s >= LINE_INTERVAL_S:
            self.shown_s = time.monotonic()
            print(str(self).strip(), file=sys.stderr, flush=True)
        return False


def progress_bar(
    items: Iterable | None = None,
    *,
    desc: str,
    enabled: bool = True,
    total: int | None = None,
    initial: int = 0,
    unit: str = "it",
    leave: bool = False,
    bar_format: str | None = None,
) -> tqdm:
    """The tqdm bar around `items`, or one without items that `update()` moves and `close()` ends.

    enabled : without it nothing is shown anywhere.
    leave : whether the finished bar stays on the terminal.
    """
    kind = tqdm if sys.stderr.isatty() else _Lines
    return kind(
        items,
        desc=desc,
        total=total,
        initial=initial,
        unit=unit,
        leave=leave,
        bar_format=bar_format,
        disable=not enabled,
    )


@contextmanager
def watched(
    label: str,
    *,
    enabled: bool,
    total: int | None = None,
    unit: str = "s",
    position: Callable[[], int] | None = None,
) -> Iterator[None]:
    """Show progress of work that cannot report it itself, from a thread, while the block runs.

    position : how far the work is, of `total`; without it the elapsed time is shown.
    """
    if not enabled:
        yield
        return
    done = threading.Event()
    layout = "{desc}: {elapsed}" if position is None else None
    with progress_bar(desc=label, total=total, unit=unit, bar_format=layout) as bar:

        def poll() -> None:
            while not done.wait(POLL_S):
                if position is not None:
                    bar.update(position() - bar.n)
                bar.refresh()

        thread = threading.Thread(target=poll, daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()
