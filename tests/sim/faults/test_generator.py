import json
from collections import Counter

import pytest

from fastac.sim.faults.generator import faults, goal_of, goals
from fastac.sim.faults.golden import frames_of
from fastac.sim.faults.kinds import KINDS, STATES
from fastac.sim.faults.script import Shape

SHAPES = {
    "two streams": Shape(16, 4, 2, loadable=True),
    "no stream": Shape(16, 8, 0, loadable=False),
}


def test_the_same_seed_gives_the_same_faults_alone_or_among_others():
    shape = SHAPES["two streams"]
    many = faults(shape, "a design", 1, range(50))
    assert [fault.as_dict() for fault in faults(shape, "a design", 1, [7, 31])] == [
        many[7].as_dict(),
        many[31].as_dict(),
    ]
    for design, seed in (("another", 1), ("a design", 2)):
        others = faults(shape, design, seed, range(50))
        assert sum(a.beats == b.beats for a, b in zip(many, others, strict=True)) < 5


@pytest.mark.parametrize("name", SHAPES)
def test_each_round_has_every_kind_in_every_state(name):
    shape = SHAPES[name]
    wanted = goals(shape)
    seen = Counter(goal_of(shape, "a design", 1, number) for number in range(2 * len(wanted)))
    assert seen == dict.fromkeys(wanted, 2)
    kinds = {kind for kind, _ in wanted}
    if name == "two streams":
        assert kinds == set(KINDS)
        possible = sum(len(kind.states()) for kind in KINDS.values())
        assert len(wanted) == possible == len(KINDS) * len(STATES) - 13
    else:
        assert {kind for kind in KINDS if KINDS[kind].needs} & kinds == set()


@pytest.mark.parametrize("name", SHAPES)
def test_a_good_frame_comes_after_every_fault(name):
    shape = SHAPES[name]
    chosen = faults(shape, "a design", 3, range(300))
    assert len({kind for fault in chosen for kind in fault.kinds}) == len({k for k, _ in goals(shape)})
    for fault in chosen:
        first = len(fault.beats) - shape.beats
        image = fault.beats[first][0]
        sent = [beat[:5] for beat in fault.beats[first:]]
        assert sent == [
            [image, row, x, int(x == shape.line_beats - 1), int(row == x == 0)]
            for row in range(shape.height)
            for x in range(shape.line_beats)
        ]
        assert fault.events[-1]["do"] == "join"
        assert fault.events[-1]["at"] <= first
        sources, bad = frames_of(fault, shape)[first]
        assert not bad
        assert sources == tuple((k, False) for k in range(first, len(fault.beats)))
        assert json.loads(json.dumps(fault.as_dict()))["number"] == fault.number
        at = [event["at"] for event in fault.events]
        assert at == sorted(at)


def test_faults_break_what_their_kind_says():
    """Nearly all faults of a kind, without a second one, leave frames that the golden rules repair."""
    shape = SHAPES["no stream"]
    repaired, all_of = Counter(), Counter()
    for fault in faults(shape, "a design", 1, range(600)):
        if len(fault.kinds) == 1 and fault.states[0] in ("WAIT", "LINE"):
            kind = fault.kinds[0]
            all_of[kind] += 1
            repaired[kind] += any(bad for _, bad in frames_of(fault, shape).values())
    for kind in ("line_short", "line_long", "line_unended", "frame_short", "frame_cut"):
        assert repaired[kind] == all_of[kind] > 0, kind
