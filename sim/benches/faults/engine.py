"""The hardware of the fault campaign, clock by clock: camera, outputs, host, resets, golden model."""

import random

from cocotb.triggers import ReadOnly, RisingEdge

from fastac.sim.benches.faults.events import Events
from fastac.sim.benches.faults.host import ENABLE, SOFT_RESET, Host
from fastac.sim.benches.faults.ports import OutputStream, RegisterBus
from fastac.sim.faults.frame_rules import FrameRules
from fastac.sim.faults.kinds import STATES


class Engine:
    """The hardware with everything around it, and the golden model of what it must do.

    golden : the results of all frames, see `faults.Golden`
    """

    def __init__(self, dut, settings: dict, golden):
        self.dut, self.settings, self.golden = dut, settings, golden
        self.streams = [OutputStream(dut, name, layout) for name, layout in settings["streams"].items()]
        self.rules = FrameRules(settings["height"], settings["line_beats"])
        self.rng = random.Random(1)
        self.bus, self.host = RegisterBus(dut, self.rng), Host(settings, self.rng)
        guard = dut
        for name in settings["guard"]:
            guard = getattr(guard, name)
        self.state_port = guard
        self.input = [getattr(dut, f"s_axis_{name}") for name in ("tdata", "tlast", "tuser")]
        self.valid, self.ready, self.interrupt = dut.s_axis_tvalid, dut.s_axis_tready, dut.interrupt
        self.flip_flops = None
        self.cycle = self.accepted = self.offered = 0
        self.state = self.reset_clocks = 0
        self.reset_begins = False
        self.programs: list[list] = []  # [generator, name, answer]; the first is running
        self.enabled, self.loading, self.calibration = True, False, "own"
        self.waiting: list = []  # frames whose first beat waits until a calibration is complete
        self.count = self.bad_count = (0, 0)  # bounds of FRAME_COUNT before the frames of `rules`
        self.valid.value = 0
        for stream in self.streams:
            stream.drive(False)
        self.begin_fault({"number": -1, "kinds": [], "beats": [], "events": [], "marks": {}}, {})

    def begin_fault(self, fault: dict, frames: dict) -> None:
        """Take over the beats and events of a fault; the earlier ones are over."""
        self.fault, self.frames = fault, frames
        self.rng.seed(f"{self.settings['seed']} {fault['number']}")
        self.beats, self.events = fault["beats"], Events(self, fault)
        self.accepted = self.offered = 0
        self.pause = self.beats[0][5] if self.beats else 0
        self.stalls: dict[int, tuple[int, float]] = {}
        self.flags: set[str] = set()
        self.samples: list[tuple] = []
        self.epochs: list[list] = []  # frames before each soft reset since the last hard one
        self.started = 0
        self.rules.forget_frames()
        self.rules.clear_flags()

    @property
    def position(self) -> str:
        """Where in a frame the camera is."""
        frame = self.rules.frame
        if frame is None:
            return "between frames"
        done = len(frame.sources) // self.settings["line_beats"]
        last = self.settings["height"] - 1
        return "first line" if not done else "last line" if done >= last else "inside"

    # Clocks

    async def clock(self) -> None:
        self.drive()
        await ReadOnly()
        self.sample()
        await RisingEdge(self.dut.clk)
        self.cycle += 1

    def drive(self) -> None:
        if self.reset_clocks:
            self._drive_reset()
        if not self.reset_clocks or self.camera_runs:
            self._drive_camera()
        slow, cycle, rng = self.fault.get("slow_outputs", 0), self.cycle, self.rng
        for k, stream in enumerate(self.streams):
            until, share = self.stalls.get(k, (0, 0.0))
            odds = share if cycle < until else slow
            stream.drive(not self.reset_clocks and (not odds or rng.random() >= odds))
        if not self.reset_clocks:
            if self.bus.access is None:
                self._next_access()
            self.bus.drive()

    def _drive_camera(self) -> None:
        if self.offered > self.accepted:
            return
        place = self.accepted
        offers = place < len(self.beats) and not self.events.hold(place)
        if offers and self.pause:
            self.pause -= 1
            offers = False
        if offers:
            image, row, x, last, start, _ = self.beats[place]
            for port, value in zip(self.input, (self.golden.pixels(image, row, x), last, start), strict=True):
                port.value = value
            self.offered += 1
        self.valid.value = int(offers)

    def _next_access(self) -> None:
        while self.programs:
            entry = self.programs[0]
            try:
                request, entry[2] = entry[0].send(entry[2]), None
            except StopIteration:
                self.programs.remove(entry)
                continue
            self.bus.begin(*request)
            self.issuer = entry
            return

    def sample(self) -> None:
        self.state = int(self.state_port.value)
        if self.reset_clocks:
            self._sample_reset()
            return
        effect, answer = self.bus.sample()
        soft_reset = effect and self._written()
        if answer is not None:
            self.issuer[2] = answer
        if self.offered > self.accepted and int(self.ready.value):
            self._accept()
        for stream in self.streams:
            stream.sample()
        if soft_reset:
            self._soft_reset()
        self.events.clock()
        if not self.programs and self.fault.get("serves") and int(self.interrupt.value):
            self.run(self._serve(), "serve")

    def _accept(self) -> None:
        place = self.accepted
        self.accepted += 1
        _, _, _, last, start, _ = self.beats[place]
        self.events.accepted(place)
        frame = self.rules.beat(place, last=bool(last), start=bool(start), enabled=self.enabled)
        if frame is not None:
            self.started += 1
            if self.loading:
                self.waiting.append(frame)
            else:
                self._launch(frame)
        self.pause = self.beats[place + 1][5] if place + 1 < len(self.beats) else 0

    def _launch(self, frame) -> None:
        """The frame enters the datapath: all of its outputs are expected from now on."""
        row, bad = self.frames[str(frame.start)]
        frame.result = self.golden.result(self.calibration, row)
        for stream in self.streams:
            words = self.golden.words(self.calibration, stream.name, row)
            stream.expect_frame(words, bad=bool(bad), suspect=frame.result.suspect)

    # Resets

    def hard_reset(self, clocks: int = 1, *, camera_runs: bool = False, randomise: bool = False) -> None:
        """From the next clock on; `camera_runs`: its beats meanwhile are lost."""
        self.reset_clocks, self.reset_begins = clocks + 1, True
        self.camera_runs, self.randomise = camera_runs, randomise

    def _drive_reset(self) -> None:
        self.reset_clocks -= 1
        if not self.reset_clocks:
            self.dut.rst.value = 0
            return
        if not self.reset_begins:
            return
        self.dut.rst.value = 1
        if not self.camera_runs:
            self.valid.value = 0
            self.offered = self.accepted
        before = [STATES[self.state], self.position]
        self.bus.abort()
        self._reset_model()
        self.events.reset(before)
        if self.randomise:
            self._randomise()

    def _randomise(self) -> None:
        if self.flip_flops is None:
            modules = [child for child in self.dut if not hasattr(child, "value")]
            self.flip_flops = sorted((f for m in modules for f in _leaves(m)), key=lambda flop: flop._path)
        for flop in self.flip_flops:
            flop.value = self.rng.getrandbits(len(flop))

    def _reset_model(self) -> None:
        self.rules.reset(hard=True)
        self.flags.clear()
        for stream in self.streams:
            stream.hard_reset()
        loads = [entry for entry in self.programs if entry[1] == "calibrate"]
        self.programs.clear()
        self.enabled, self.waiting, self.samples, self.epochs = True, [], [], []
        self.host.loads = ""
        self.count = self.bad_count = (0, 0)
        self.started = 0
        self.run(self.host.initialise(), "control")
        if loads:
            self.run(self.host.calibrate(self.events.image, resumes=True), "calibrate")

    def _sample_reset(self) -> None:
        self.reset_begins = False
        if self.offered > self.accepted and self.camera_runs and int(self.ready.value):
            self.accepted += 1
            self.pause = 0

    def _soft_reset(self) -> None:
        frames, done = self.rules.frames, self.rules.finished
        bad = [frame.bad for frame in frames[:done]]
        sure = max(done - 1, 0)
        self.epochs.append([self.count, frames])
        self.count = (self.count[0] + sure, self.count[1] + done)
        self.bad_count = (self.bad_count[0] + sum(bad[:sure]), self.bad_count[1] + sum(bad))
        self.rules.reset(hard=False)
        self.waiting = []
        for stream in self.streams:
            stream.soft_reset()

    # The host

    def run(self, program, name: str) -> None:
        """What controls the hardware comes before what only looks at it, else in the order of the calls."""
        place = len(self.programs)
        if name != "look":
            place = sum(entry[1] not in ("look", "serve") for entry in self.programs)
        self.programs.insert(place, [program, name, None])

    @property
    def controlled(self) -> bool:
        """Everything that controls the hardware has been done."""
        return not self.reset_clocks and not self.events.busy and self.commanded

    @property
    def commanded(self) -> bool:
        """No program is left that controls the hardware."""
        return all(entry[1] in ("look", "serve") for entry in self.programs)

    def _written(self) -> bool:
        """A write takes effect in this clock; returns whether it is a soft reset."""
        request, registers = self.bus.last, self.settings["registers"]
        self.events.written(request["address"])
        if request["address"] == registers.get("CALIBRATION") and self.host.loads:
            if self.host.loads == "part":
                self.loading = True
            else:
                self.calibrated(self.host.loads)
        if request["address"] != registers["CONTROL"]:
            return False
        self.enabled = bool(request["data"] & ENABLE)
        return bool(request["data"] & SOFT_RESET)

    def calibrated(self, image: str) -> None:
        """From now on frames use this calibration; those that waited start."""
        self.calibration, self.loading = image, False
        for frame in self.waiting:
            self._launch(frame)
        self.waiting = []

    def _serve(self):
        epoch = len(self.epochs)
        found = yield from self.host.result()
        if found is not None and epoch == len(self.epochs):
            self.samples.append((epoch, found))
        yield from self.host.write("INTERRUPT_STATUS", 1)


def _leaves(handle):
    """All signals below a module of the simulated hardware that a bench can write."""
    for child in handle:
        if hasattr(child, "value"):
            yield child
        else:
            yield from _leaves(child)
