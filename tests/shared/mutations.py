"""Strategies of Hypothesis for damaged files: bytes changed, and trees of keys that make no sense."""

import copy
import math
from collections.abc import Callable, Sequence

from hypothesis import strategies as st

WORDS = (b"\x00", b"\xff" * 4, b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x80", b"\xff" * 8, b"\x00" * 8)
"""What counters and sizes in binary files are overwritten with: none, all ones, the largest signed."""
NASTY = (
    *(0, 1, -1, 2, 3, 5, 7, 255, 65536, 2**31 - 1, 2**31, 2**63 - 1, 2**63, 10**30, 10**400),
    *(0.0, -0.0, 0.5, 1e-300, 1e300, -1.5, math.inf, -math.inf, math.nan),
    *(True, False, "", "x", "\x00", "../../../../etc/hostname", "/etc/hostname", "ÿ€😀", "a\nb", "x" * 3000),
    *([], {}, [[]], {"": {}}, [1, 2], [-1.0, "x"], {"a": 1}),
)
"""Values that are of the wrong type for most keys, or at the edge of what a type holds."""


@st.composite
def changed_bytes(draw, bases: Sequence[bytes], fragments: Sequence[bytes] = ()) -> bytes:
    """One of `bases` with one to four changes: flipped, cut, doubled, overwritten, inserted, spliced."""
    content = bytearray(draw(st.sampled_from(bases)))
    for _ in range(draw(st.sampled_from((1, 1, 1, 2, 3, 4)))):
        size = len(content)
        at = draw(st.integers(0, size))
        length = draw(st.sampled_from((1, 1, 2, 4, 8, 16, 64, 256, size)))
        match draw(st.integers(-3, 6)):
            case -3 | -2 | -1 | 0 if at < size:
                content[at] ^= draw(st.integers(1, 255))
            case 1:
                del content[at : at + length]
            case 2:
                del content[at:]
            case 3:
                content[at:at] = content[at : at + length]
            case 4:
                word = draw(st.sampled_from(WORDS))
                content[at : at + len(word)] = word
            case 5:
                content[at:at] = draw(st.sampled_from((*fragments, *WORDS)))
            case _:
                other = draw(st.sampled_from(bases))
                content[at:] = other[draw(st.integers(0, len(other))) :]
    return bytes(content)


def places(tree: object, path: tuple = ()) -> list[tuple]:
    """The paths to all values in nested dicts and lists."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    found = []
    for key, value in items:
        found += [(*path, key), *places(value, (*path, key))]
    return found


def _at(tree, path: tuple):
    for key in path:
        tree = tree[key]
    return tree


@st.composite
def changed_tree(draw, bases: Sequence[dict], values: Sequence[object] = NASTY) -> dict:
    """One of `bases` with one to three values dropped, replaced, renamed, doubled, nested or exchanged."""
    tree = copy.deepcopy(draw(st.sampled_from(bases)))
    for _ in range(draw(st.integers(1, 3))):
        known = places(tree)
        if not known:
            break
        path = draw(st.sampled_from(known))
        parent, key = _at(tree, path[:-1]), path[-1]
        match draw(st.integers(0, 6)):
            case 0:
                del parent[key]
            case 1 | 2 | 3:
                parent[key] = copy.deepcopy(draw(st.sampled_from(values)))
            case 4 if isinstance(parent, dict):
                new = draw(st.sampled_from((f"{key}x", str(key)[:-1], "", f"{key}.a", "é\x01")))
                parent[new] = parent.pop(key)
            case 5:
                other = draw(st.sampled_from(known))
                try:
                    parent[key] = copy.deepcopy(_at(tree, other))
                except (KeyError, IndexError, TypeError):
                    del parent[key]
            case _:
                parent[key] = {"a": parent[key]} if draw(st.booleans()) else [parent[key]]
    return tree


def texts(
    bases: Sequence[dict],
    dump: Callable[[dict], str],
    samples: Sequence[bytes],
    fragments: Sequence[bytes],
    values: Sequence[object] = NASTY,
) -> st.SearchStrategy[bytes]:
    """Files of a text format: trees that were changed, the files' own bytes changed, and both."""
    trees = changed_tree(bases, values).map(lambda tree: dump(tree).encode("utf-8", "surrogatepass"))
    both = trees.flatmap(lambda text: changed_bytes([text], fragments))
    return st.one_of(trees, trees, changed_bytes(samples, fragments), both)
