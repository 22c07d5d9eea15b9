"""What happens in a fault beside the camera's beats, and when: the events of the generator."""

from fastac.sim.benches.faults.host import ENABLE, INTERRUPT, SOFT_RESET
from fastac.sim.faults.kinds import STATES

STATE_LIMIT = 40
"""Clocks for which an event waits for the guard's state."""
LATEST_CUT = 8
"""Clocks after which a reset cuts an access off, at most."""


class Events:
    """The events of one fault, one after the other; see `script.Fault`.

    found : {place among the fault's kinds: [state of the guard, place in the frame] at its beginning}
    image : the calibration that is being loaded
    """

    def __init__(self, engine, fault: dict):
        self.engine, self.host = engine, engine.host
        self.left = list(fault["events"])
        self.marks = {int(beat): place for beat, place in fault["marks"].items()}
        self.found: dict[int, list[str]] = {}
        self.image = ""
        self.delay = self.waited = self.place = self.reset_place = None
        self.stopping = self.on_write = None
        self.holding = self.cut_in = 0
        self.frozen = False  # no beat comes until what was begun takes effect

    @property
    def busy(self) -> bool:
        """What has begun is not over."""
        return bool(self.stopping or self.holding or self.cut_in)

    def hold(self, beat: int) -> bool:
        """Whether this beat must not be offered yet."""
        if self.stopping or self.holding or (self.frozen and (self.on_write or self.cut_in)):
            return True
        return any(event["hold"] and beat >= event["at"] for event in self.left)

    def accepted(self, beat: int) -> None:
        if beat in self.marks:
            self.record(self.marks[beat])

    def written(self, address: int) -> None:
        """A write to a register takes effect."""
        if self.on_write is not None and address == self.host.address[self.on_write[1]]:
            self.record(self.on_write[0])
            self.on_write = None

    def reset(self, before: list[str]) -> None:
        """A hard reset begins; `before`: state of the guard and place in the frame."""
        if self.reset_place is not None:
            self.found[self.reset_place] = before

    def record(self, place: int) -> None:
        """The fault's kind `place` begins now."""
        self.found[place] = [STATES[self.engine.state], self.engine.position]

    def clock(self) -> None:
        """At the end of each clock without a reset."""
        engine, host = self.engine, self.host
        if host.loaded:
            engine.calibrated(host.loaded)
            host.loaded = ""
        if host.reset_wanted:
            host.reset_wanted, self.cut_in = False, engine.rng.randint(1, LATEST_CUT)
        if self.cut_in:
            self.cut_in -= 1
            if not self.cut_in:
                engine.hard_reset()
            return
        self.holding -= self.holding > 0
        if self.stopping and self.stopping():
            engine.rules.silence()
            self.stopping = None
        if self.left and not self.stopping and self._due(self.left[0]):
            self._begin(self.left.pop(0))

    def _due(self, event: dict) -> bool:
        engine = self.engine
        if engine.accepted < event["at"] or engine.reset_clocks:
            return False
        if event["do"] in ("join", "calibrate", "stop", "idle") and not engine.controlled:
            return False
        if event["do"] == "loading" and not (engine.loading or engine.controlled):
            return False
        if self.delay is None:
            self.waited = (self.waited or 0) + 1
            if event["state"] not in (None, STATES[engine.state]) and self.waited < STATE_LIMIT:
                return False
            self.delay = event["delay"]
        self.delay -= 1
        return self.delay < 0

    def _begin(self, event: dict) -> None:
        self.delay = self.waited = None
        settings = dict(event["settings"])
        self.place = settings.pop("place", None)
        self.frozen = event["hold"]
        getattr(self, f"_do_{event['do']}")(**settings)

    def _at(self, register: str) -> tuple[int, str] | None:
        """The fault begins with the next write to this register."""
        return None if self.place is None else (self.place, register)

    def _now(self) -> None:
        if self.place is not None:
            self.record(self.place)

    def _do_go(self) -> None:
        self._now()

    _do_join = _do_loading = _do_go

    def _do_idle(self) -> None:
        self.engine.run(self.host.wait_until_idle(), "control")

    def _do_stop(self) -> None:
        """No beat comes until the frame under way is given up; without one, for as long as the timeout."""
        self._now()
        engine = self.engine
        if engine.rules.frame is not None:
            engine.run(self.host.wait_for_error("frame_timeout"), "control")
            self.stopping = lambda: engine.commanded
        else:
            end = engine.cycle + engine.settings["timeout"] + 20
            self.stopping = lambda: engine.cycle >= end

    def _do_pause(self, clocks: int) -> None:
        self._now()
        self.holding = clocks

    def _do_stall(self, which: int | None, clocks: int, share: float) -> None:
        self._now()
        self._stall(which, clocks, share)

    def _stall(self, which: int | None, clocks: int, share: float) -> None:
        for k in range(len(self.engine.streams)) if which is None else [which]:
            self.engine.stalls[k] = (self.engine.cycle + clocks, share)

    def _do_disable(self) -> None:
        self.on_write = self._at("CONTROL")
        self.engine.run(self.host.control(INTERRUPT), "control")

    def _do_enable(self) -> None:
        self.engine.run(self.host.control(ENABLE | INTERRUPT), "control")

    def _do_soft_reset(self, block: int | None = -1, clocks: int = 0) -> None:
        self.on_write = self._at("CONTROL")
        if clocks:
            self._stall(block, clocks, 1.0)
        self.engine.run(self.host.control(ENABLE | INTERRUPT | SOFT_RESET), "control")

    def _do_hard_reset(self, inside: str = "", after: int = 0, **how) -> None:
        self.reset_place = self.place
        if not inside:
            self.engine.hard_reset(**how)
            return
        self.engine.run(self.host.endless(inside), "control")
        self.cut_in = after

    def _do_registers_read(self) -> None:
        self._now()
        self.engine.run(self.host.read_all(), "look")

    def _do_registers_absent(self, count: int) -> None:
        self._now()
        self.engine.flags.add("access_refused")
        self.engine.run(self.host.absent(count), "look")

    def _do_registers_refused(self, count: int) -> None:
        self._now()
        self.engine.flags.add("access_refused")
        self.engine.run(self.host.refused(count), "look")

    def _do_calibration_busy(self) -> None:
        self.on_write = self._at("CALIBRATION")
        self.engine.flags.add("calibration_refused")
        self.engine.run(self.host.refused_word(self.engine.settings["words"]["other"][0]), "control")

    def _do_calibration_foreign(self, bit: int) -> None:
        self.on_write = self._at("CALIBRATION")
        self.engine.flags.add("calibration_refused")
        self.engine.run(self.host.refused_word(self.engine.settings["words"]["own"][0] ^ 1 << bit), "control")

    def _do_calibrate(self, image: str, cut: float | None = None, by: str = "") -> None:
        self.on_write, self.image, self.reset_place = self._at("CALIBRATION"), image, None
        self.engine.run(self.host.calibrate(image, cut=cut, by=by), "calibrate")
