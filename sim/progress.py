"""Progress for work whose length is known from elsewhere, or not at all."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

POLL_S = 0.5


@contextmanager
def progress_bar(
    label: str,
    *,
    enabled: bool,
    total: int | None = None,
    unit: str = "s",
    position: Callable[[], int] | None = None,
) -> Iterator[None]:
    """Show a bar while the body runs in the foreground.

    position : where the work is, of `total`; without it the bar counts the seconds that have passed.
    """
    if not enabled:
        yield
        return
    done = threading.Event()
    counts_time = position is None
    layout = "{desc}: {elapsed}" if counts_time else None
    with tqdm(total=total, desc=label, unit=unit, leave=False, bar_format=layout) as bar:

        def poll() -> None:
            while not done.wait(POLL_S):
                if not counts_time:
                    bar.update(position() - bar.n)
                bar.refresh()

        thread = threading.Thread(target=poll, daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()
