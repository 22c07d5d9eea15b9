"""Faults played to hardware, whole and broken on purpose."""

import pickle
import random

import pytest
from amaranth import Signal

from fastac.gateware.bus.registers import RegisterBlock
from fastac.gateware.stream import raster_port
from fastac.gateware.stream.frame_guard import FrameGuard
from fastac.gateware.stream.raster_port import RasterPort
from fastac.sim.faults import batch
from fastac.sim.faults.batch import FaultFound, numbers_of, play, spans
from fastac.sim.faults.designs import FLOPS, OTHER, OWN, SOURCE, elaborate
from fastac.sim.faults.generator import faults, goal_of
from fastac.sim.faults.golden import Hardware
from fastac.sim.faults.script import Fault, Script, Shape
from fastac.sim.runner import QUICK

DESIGN = "normals_4"


class Played:
    """A design's hardware as it is now, and faults through it."""

    def __init__(self, folder, design=DESIGN):
        self.folder, self.design = folder, design
        elaborate(folder, design)
        self.hardware = Hardware.load(folder / OWN, folder / OTHER)

    def play(self, chosen: list[Fault]) -> list[dict]:
        flops = self.folder / FLOPS
        return play(
            self.hardware, self.folder / SOURCE, flops, chosen, 1, self.folder / "sim", build_args=QUICK
        )

    def of(self, *goals: tuple[str, str]) -> list[Fault]:
        """The first fault of each of these kinds and states."""
        shape = self.hardware.shape
        numbers = {goal_of(shape, self.design, 1, number): number for number in range(300, -1, -1)}
        return faults(shape, self.design, 1, [numbers[goal] for goal in goals])


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    return Played(tmp_path_factory.mktemp("faults"))


def test_a_short_campaign(played):
    """Each record says what was seen; the same faults again give the same records."""
    chosen = faults(played.hardware.shape, DESIGN, 1, range(25))
    records = played.play(chosen)
    assert [record["number"] for record in records] == list(range(25))
    reached = [
        record["states"][0][0] == fault.states[0] for fault, record in zip(chosen, records, strict=True)
    ]
    assert sum(reached) >= 22
    assert all(record["frames"] >= 1 and record["beats"] >= 64 for record in records)
    flags = {flag for record in records for flag in record["errors"]}
    assert {"line_short", "frame_short", "frame_timeout", "frame_suspect"} <= flags
    assert played.play(chosen[:3]) == records[:3]


def idle(shape: Shape, event: str, **settings) -> Fault:
    """Nothing but an event while all is at rest, and a good frame after it."""
    script = Script(shape, random.Random(1), Fault(0, ["power_up"], [None]))
    script.event(event, hold=True, place=0, **settings)
    script.good_frame()
    return script.fault


BROKEN = {
    "frames are never bad": (
        FrameGuard,
        lambda guard: ("comb", guard.frame_bad.eq(0)),
        ("line_short", "LINE"),
        "last_frame_bad|FRAME_ERRORS",
    ),
    "frames cannot be disabled": (
        RegisterBlock,
        lambda registers: ("sync", registers.enable.eq(1)),
        ("disabled", "DROP"),
        "CONTROL|surplus beat|FRAME_COUNT|expected",
    ),
    "no timeout": (
        FrameGuard,
        lambda guard: ("comb", guard.frame_timeout.eq(0)),
        ("camera_stops", "LINE"),
        "ERRORS.frame_timeout does not come",
    ),
    "an offer is withdrawn by a soft reset": (
        RasterPort,
        lambda port: ("comb", port.port.tvalid.eq(port.i.valid)),
        ("soft_reset_blocked", "LINE"),
        "an offer was withdrawn|an offer was changed|beats missing",
    ),
    "a soft reset does nothing": (
        RegisterBlock,
        lambda registers: ("sync", registers.soft_reset.eq(0)),
        ("soft_reset", "LINE"),
        "normals: .*expected",
    ),
}
"""{what is wrong: (component, function of it: (domain, statement that wins), goal that meets it, message)}"""


@pytest.mark.parametrize("name", BROKEN)
@pytest.mark.full
def test_broken_hardware_is_found(tmp_path, monkeypatch, name):
    component, statement, goal, message = BROKEN[name]
    elaborate_whole = component.elaborate

    def elaborate_broken(self, platform):
        m = elaborate_whole(self, platform)
        domain, wins = statement(self)
        m.d[domain] += wins
        return m

    monkeypatch.setattr(component, "elaborate", elaborate_broken)
    broken = Played(tmp_path)
    with pytest.raises(FaultFound, match=message) as found:
        broken.play(broken.of(goal))
    assert found.value.failure["kinds"][0] == goal[0]


@pytest.mark.full
def test_a_register_without_reset_is_found_by_random_values_only(tmp_path, monkeypatch):
    """At rest its value is right by chance, so a plain reset does not show that it has none."""

    def unreset(*arguments, **settings):
        return Signal(*arguments, **settings | {"reset_less": True, "src_loc_at": 1})

    unreset.like = Signal.like
    monkeypatch.setattr(raster_port, "Signal", unreset)
    broken = Played(tmp_path)
    shape = broken.hardware.shape
    assert broken.play([idle(shape, "hard_reset")])[0]["frames"] == 1
    with pytest.raises(FaultFound, match="normals"):
        broken.play([idle(shape, "hard_reset", randomise=True)])


def test_whole_hardware_stands_random_values(played):
    assert played.play([idle(played.hardware.shape, "hard_reset", randomise=True)])[0]["frames"] == 1


def test_a_failed_batch_says_how_to_repeat_it(played, tmp_path, monkeypatch):
    monkeypatch.setattr(batch, "play", failing)
    files = [played.folder / name for name in (OWN, OTHER, SOURCE, FLOPS)]
    message = (
        "normals_4, seed 1, fault 31 .* repeat with: fastac prove faults --design normals_4 --seed 1"
        " --faults 30-31$"
    )
    with pytest.raises(FaultFound, match=message) as found:
        batch.batch(tmp_path, DESIGN, *files, [30, 31, 32], 1, workplace=tmp_path, progress=False)
    again = pickle.loads(pickle.dumps(found.value))
    assert (str(again), again.failure) == (str(found.value), {"number": 31})


def failing(*arguments, **settings):
    raise FaultFound("fault 31 (line_short): normals: a surplus beat", {"number": 31})


@pytest.mark.parametrize(
    ("numbers", "text"), [([3], "3"), ([3, 4, 5], "3-5"), ([0, 1, 7, 9, 10], "0-1,7,9-10")]
)
def test_numbers_as_text(numbers, text):
    assert spans(numbers) == text
    assert numbers_of(text) == numbers


@pytest.mark.parametrize("text", ["", "a", "3-x", "-3", "3,,4"])
def test_text_without_numbers_is_refused(text):
    with pytest.raises(ValueError, match="expected numbers of faults"):
        numbers_of(text)
