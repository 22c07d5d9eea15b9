import ast
import gc
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from fastac.store import references


def yield_to_threads(*_):
    time.sleep(0)


@pytest.fixture
def collections_that_yield():
    """Garbage collection lets other threads run, as the callbacks of some libraries do, also amid a tree."""
    gc.callbacks.append(yield_to_threads)
    yield
    gc.callbacks.remove(yield_to_threads)


@pytest.mark.usefixtures("collections_that_yield")
def test_threads_parse_at_the_same_time():
    source = Path(references.__file__).read_text() * 5
    with ThreadPoolExecutor(4) as pool:
        trees = list(pool.map(references.parsed, [source] * 40))
    assert {len(tree.body) for tree in trees} == {len(ast.parse(source).body)}
