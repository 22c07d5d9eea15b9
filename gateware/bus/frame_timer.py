"""Frame counter and latency measurement, in clock cycles, for the host's registers."""

from amaranth import Module, Mux, Signal, unsigned
from amaranth.lib import data, memory, wiring
from amaranth.lib.wiring import In, Out

STAMP = data.StructLayout({"number": 32, "bad": 1, "time": 64})
"""number: of a frame, from 1 since reset; bad: its input was repaired; time: when its first beat was
accepted."""


class FrameTimer(wiring.Component):
    """Count frames, number their results and measure their latency in clock cycles.

    Members
    -------
    accepted, frame_started, frame_done, frame_bad : the outputs of FrameGuard
    result_valid : pulse when a frame's force is taken. Results come in the order of the frames, at least one
        clock after `frame_done`. Only with `force`.
    depth_done : the same for the last beat of a frame's depth. Only with `depth`.
    normals_done : the same for the last beat of a frame's normals. Only with `normals`.
    flush : discard the frames in flight, whose results will not come; the other inputs are ignored meanwhile
    frame_count : unsigned(32), frames received since reset
    in_flight : unsigned(8), frames that have started and lack a result
    interval : unsigned(32), clocks between the first beats of the last two frames; 0 until there are two
    first_to_force, last_to_force : unsigned(32), clocks from the acceptance of a frame's first and last beat
        to its force. If the end of the frame was padded, the last beat is the last one accepted before the
        padding. Only with `force`.
    force_number : unsigned(32), number of the frame that gave the last force, from 1 since reset
    force_bad : that frame was bad
    first_to_depth, depth_bad : the same for the last depth map
    first_to_normals, normals_bad : the same for the last normal map
    last_to_depth, depth_number or last_to_normals, normals_number : as for a force, for the map that is the
        result: the depth if there is no force, the normals if there is neither. Only with `packets`.
    time : unsigned(64), a count of clocks, by which all times are taken. Only with `packets`.
    result_time : unsigned(64), `time` when the first beat of the last result's frame was accepted. Only with
        `packets`.

    stamp : see `STAMP`: of the last whole frame, whether its result is there or not. Only with `stamps`.

    Outputs change one clock after the pulse. Latencies are modulo 2**32. With more than `frames` frames in
    flight some times are wrong, but counts, numbers and order stay right.
    """

    def __init__(
        self,
        *,
        force: bool,
        depth: bool,
        normals: bool = False,
        packets: bool = False,
        stamps: bool = False,
        frames: int = 8,
    ):
        if not force and not depth and not normals:
            raise ValueError("force False, depth False, normals False: expected at least one")
        if not 2 <= frames <= 128 or frames & (frames - 1):
            raise ValueError(f"frames {frames}: expected a power of two, 2 to 128")
        if stamps and not packets:
            raise ValueError("stamps True, packets False: only packets have their time")
        self.force, self.packets, self.stamps, self.frames = force, packets, stamps, frames
        self.maps = tuple(name for name, wanted in (("depth", depth), ("normals", normals)) if wanted)
        inputs = ["accepted", "frame_started", "frame_done", "frame_bad", "flush"]
        outputs = {"frame_count": 32, "in_flight": 8, "interval": 32}
        if force:
            inputs.append("result_valid")
            outputs |= {"first_to_force": 32, "last_to_force": 32, "force_number": 32, "force_bad": 1}
        for name in self.maps:
            inputs.append(f"{name}_done")
            outputs |= {f"first_to_{name}": 32, f"{name}_bad": 1}
        if packets:
            outputs |= {f"last_to_{self.result}": 32, f"{self.result}_number": 32}
            outputs["result_time"] = 64
        super().__init__(
            {
                **{name: In(1) for name in inputs},
                **({"time": In(64)} if packets else {}),
                **({"stamp": Out(STAMP)} if stamps else {}),
                **{name: Out(unsigned(width)) for name, width in outputs.items()},
            }
        )

    @property
    def values(self) -> dict[str, Signal]:
        """The values of registers, by their names in the register map."""
        found = {"FRAME_COUNT": self.frame_count, "INTERVAL": self.interval}
        if self.force:
            found["LATENCY_LAST_PIXEL_TO_FORCE"] = self.last_to_force
            found["FORCE_SEQUENCE"] = self.force_number
        for name in (*(("force",) if self.force else ()), *self.maps):
            found[f"LATENCY_FIRST_PIXEL_TO_{name.upper()}"] = getattr(self, f"first_to_{name}")
        return found

    @property
    def result(self) -> str:
        """What counts as a frame's result: "force", else "depth", else "normals"."""
        return "force" if self.force else self.maps[0]

    def elaborate(self, platform):
        m = Module()

        # FrameGuard registers one beat: the beat that starts or ends a frame is the last one accepted.
        if self.packets:
            width, now = 64, self.time
        else:
            width, now = 32, Signal(32, name="now")
            m.d.sync += now.eq(now + 1)
        accepted_at = Signal(width, reset_less=True)
        first = Signal(width, reset_less=True)
        with m.If(self.accepted):
            m.d.sync += accepted_at.eq(now)

        # Frame k's time stamps are at address k modulo `frames`; each kind of result has its own counter.
        stamp = data.StructLayout({"first": width, "last": 32, "bad": 1})
        m.submodules.stamps = stamps = memory.Memory(shape=stamp, depth=self.frames, init=[])
        write = stamps.write_port()
        m.d.comb += [
            write.addr.eq(self.frame_count[: len(write.addr)]),
            write.en.eq(self.frame_done & ~self.flush),
            write.data.first.eq(first),
            write.data.last.eq(accepted_at),
            write.data.bad.eq(self.frame_bad),
        ]
        started = Signal()
        measured = Signal()
        with m.If(self.flush):
            m.d.sync += [started.eq(0), measured.eq(0)]
        with m.Else():
            with m.If(self.frame_started):
                m.d.sync += [started.eq(1), measured.eq(1), first.eq(accepted_at)]
                with m.If(measured):
                    m.d.sync += self.interval.eq(accepted_at - first)
            with m.If(self.frame_done):
                m.d.sync += [started.eq(0), self.frame_count.eq(self.frame_count + 1)]
        if self.stamps:
            last = Signal(STAMP, reset_less=True)
            m.d.comb += [self.stamp.eq(last), self.stamp.number.eq(self.frame_count)]
            with m.If(write.en):
                m.d.sync += [last.time.eq(first), last.bad.eq(self.frame_bad)]

        waiting = []
        for name in (*(("force",) if self.force else ()), *self.maps):
            pulse = self.result_valid if name == "force" else getattr(self, f"{name}_done")
            given = Signal(32, name=f"{name}_given")
            behind = Signal(8, name=f"{name}_behind")  # frame_count − given
            entry = stamps.read_port(domain="comb")
            m.d.comb += entry.addr.eq(given[: len(entry.addr)])
            with m.If(self.flush):
                m.d.sync += [given.eq(self.frame_count), behind.eq(0)]
            with m.Else():
                m.d.sync += behind.eq(behind + self.frame_done - pulse)
            with m.If(pulse & ~self.flush):
                m.d.sync += [
                    given.eq(given + 1),
                    getattr(self, f"first_to_{name}").eq(now - entry.data.first),
                    getattr(self, f"{name}_bad").eq(entry.data.bad),
                ]
                if name == "force" or (self.packets and name == self.result):
                    m.d.sync += [
                        getattr(self, f"last_to_{name}").eq(now - entry.data.last),
                        getattr(self, f"{name}_number").eq(given + 1),
                    ]
                if self.packets and name == self.result:
                    m.d.sync += self.result_time.eq(entry.data.first)
            waiting.append(behind)
        most = waiting[0]
        for count in waiting[1:]:
            most = Mux(count > most, count, most)
        m.d.comb += self.in_flight.eq(most + started)
        return m
