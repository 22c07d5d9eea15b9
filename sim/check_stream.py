"""Test of components with one input and one output stream: values, order, latency, flags, back-pressure."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from fastac.sim.runner import QUICK, simulate


def pack(vectors, bits: int) -> list[int]:
    """Pack words (beats, lanes, …), signed or unsigned, into one payload per beat, lane 0 in the LSBs.

    The axes after the first are flattened in C order, like nested `ArrayLayout`s.
    """
    vectors = np.asarray(vectors)
    mask = (1 << bits) - 1
    return [
        sum((int(word) & mask) << (k * bits) for k, word in enumerate(beat))
        for beat in vectors.reshape(len(vectors), -1)
    ]


def unpack(payload: int, bits: int, lanes: int, *, signed: bool = True) -> list[int]:
    """Unpack the `lanes` words of one payload, lane 0 first."""
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
    elastic: bool = False,
    room: int | None = None,
    places: tuple[int, int] | None = None,
    stalls: Sequence[float | tuple[float, float]] = (0, 0.3, 0.9),
    seed: int = 1,
    timeout_cycles: int = 1_000_000,
    build_args: tuple[str, ...] = QUICK,
    log_file: Path | None = None,
) -> None:
    """Simulate `component` (streams `i` and `o`) and compare every output beat; raises on a difference.

    A beat that `o` offers must stay offered, unchanged, until it is taken; that is checked in every clock.

    inputs, expected : payloads, packed with `pack`; as many beats as expected must come, in this order
    mask : bits of the output payloads to compare, one mask for all or one per beat (for unused lanes)
    latencies : (index of input beat, index of output beat, clocks between their transfers), checked in the
        run without pauses
    flags : {output port: sum of its words over all transfers at `o`; of one bit: how often it is high}
    elastic : `i` must be ready in every clock in which `o` is empty or taken, and in no other
    room : `i` must be ready in every clock in which fewer beats are inside, and in no other
    places : (beats at `i` that the first beat at `o` needs, how many more `i` takes before that one leaves),
        checked in runs whose reader pauses in more than half of the clocks: the further beats come once the
        first one is offered at `o`, and this waits until `i` has refused a beat for 64 clocks
    stalls : shares of clocks in which the driver and `o.ready` pause, each on its own, for single clocks and
        in bursts, or a pair of both's shares; one run for each, from one build. Above a half, `o.ready` waits
        for a beat.
    build_args, log_file : further arguments of Verilator; file for the output instead of the terminal
    """
    folder.mkdir(parents=True, exist_ok=True)
    masks = [-1] * len(expected) if mask is None else [mask] * len(expected) if np.isscalar(mask) else mask
    bench = {
        "inputs": [hex(x) for x in inputs],
        "expected": [hex(x) for x in expected],
        "masks": [hex(x) for x in masks],
        "latencies": [list(map(int, entry)) for entry in latencies],
        "flags": dict(flags or {}),
        "elastic": elastic,
        "room": room,
        "places": places,
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
