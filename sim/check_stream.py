"""One bench for every component with one input and one output stream: values, order, latency, flags."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from fastac.sim.runner import QUICK, simulate


def pack(vectors, bits: int) -> list[int]:
    """Vectors (beats, lanes) of signed or unsigned words to one payload a beat, lane 0 lowest.

    Leading axes beyond the first are flattened in C order, as nested `ArrayLayout`s are laid out.
    """
    vectors = np.asarray(vectors)
    mask = (1 << bits) - 1
    return [
        sum((int(word) & mask) << (k * bits) for k, word in enumerate(beat))
        for beat in vectors.reshape(len(vectors), -1)
    ]


def unpack(payload: int, bits: int, lanes: int, *, signed: bool = True) -> list[int]:
    """The words of one payload, lane 0 first."""
    words = [(payload >> (k * bits)) & ((1 << bits) - 1) for k in range(lanes)]
    return [w - (1 << bits) if signed and w >> (bits - 1) else w for w in words]


def check(
    component,
    name: str,
    folder: Path,
    *,
    inputs: Sequence[int],
    expected: Sequence[int],
    mask: int | Sequence[int] | None = None,
    latencies: Iterable[tuple[int, int, int]] = (),
    flags: Mapping[str, int] | None = None,
    stalls: Sequence[float] = (0, 0.3, 0.9),
    seed: int = 1,
    timeout_cycles: int = 1_000_000,
    build_args: tuple[str, ...] = QUICK,
    log_file: Path | None = None,
) -> None:
    """Simulate `component` (ports `i`, `o`) and compare everything that leaves it; raises on a difference.

    inputs, expected : payloads, packed with `pack`; every one is compared, in order, and no more may come.
    mask : bits of each output payload to compare (void lanes of a last beat are nobody's business).
    latencies : (input index, output index, cycles) from acceptance to transfer, asserted without stalls.
    flags : for each one-bit output port, in how many cycles in which `o` transfers it must be high.
    build_args, log_file : further arguments of Verilator; where the output goes in place of the terminal
    stalls : probability per cycle that a side pauses; one run each, from one build.
    """
    folder.mkdir(parents=True, exist_ok=True)
    masks = [-1] * len(expected) if mask is None else [mask] * len(expected) if np.isscalar(mask) else mask
    bench = {
        "inputs": [hex(x) for x in inputs],
        "expected": [hex(x) for x in expected],
        "masks": [hex(x) for x in masks],
        "latencies": [list(map(int, entry)) for entry in latencies],
        "flags": dict(flags or {}),
        "stalls": list(stalls),
        "seed": seed,
        "timeout_cycles": timeout_cycles,
    }
    path = folder / f"{name}.json"
    path.write_text(json.dumps(bench))
    simulate(
        component,
        name,
        "fastac.sim.benches.stream",
        folder,
        build_args=build_args,
        log_file=log_file,
        BENCH=str(path),
    )
