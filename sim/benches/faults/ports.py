"""Drivers and monitors of the fault campaign: output streams with their AXI rules, AXI4-Lite accesses."""

from collections import deque
from collections.abc import Iterable


class OutputStream:
    """Drives `tready` of an output and compares each beat, in its clock, with the expected ones.

    Asserts that an offer is not withdrawn or changed, that nothing comes unexpected, and that after a soft
    reset a frame that has begun is completed with zeros that are marked as bad.

    expected : beats (tdata, tlast, tuser, tkeep) still to come
    """

    def __init__(self, dut, name: str, layout: dict):
        self.name, self.layout = name, layout
        prefix = f"m_axis_{name}_"
        self.valid, self.ready = getattr(dut, f"{prefix}tvalid"), getattr(dut, f"{prefix}tready")
        names = ("tdata", "tlast", "tuser", *(("tkeep",) if layout["tagged"] else ()))
        self.ports = [getattr(dut, f"{prefix}{name}") for name in names]
        self.beats_per_frame = layout["rows"] * layout["beats"]
        self.expected: deque[tuple[int, ...]] = deque()
        self.open: bool | None = None
        self.taken = 0
        self.hard_reset()

    def hard_reset(self) -> None:
        self.expected.clear()
        self.position = self.closing = 0  # beats of the frame under way that were taken; that are made up
        self.held: tuple[int, ...] | None = None

    def drive(self, is_open: bool) -> None:
        if is_open != self.open:
            self.ready.value = int(is_open)
            self.open = is_open

    def sample(self) -> None:
        """Check this clock's offer, and take it if `tready` is high."""
        if not int(self.valid.value):
            assert self.held is None, f"{self.name}: an offer was withdrawn"
            return
        offer = tuple(int(port.value) for port in self.ports)
        assert self.held in (None, offer), f"{self.name}: an offer was changed from {self.held} to {offer}"
        assert self.expected, f"{self.name}: a surplus beat {offer}"
        data, mask, *marks = self.expected[0]
        assert list(offer[1:]) == marks, f"{self.name}: tlast, tuser, tkeep {offer[1:]}, expected {marks}"
        assert offer[0] & mask == data, f"{self.name}: tdata {offer[0] & mask:#x}, expected {data:#x}"
        if not self.open:
            self.held = offer
            return
        self.held = None
        self.expected.popleft()
        self.taken += 1
        self.closing -= self.closing > 0
        self.position = (self.position + 1) % self.beats_per_frame

    def expect_frame(self, words: Iterable[int], *, bad: bool, suspect: bool) -> None:
        """A frame's beats follow what is expected already."""
        self.expected += [
            (data & self._mask(k), self._mask(k), *self._marks(k, bad, suspect))
            for k, data in enumerate(words)
        ]

    def soft_reset(self) -> None:
        """After the clock of the datapath's reset: only what the port completes itself still comes."""
        if self.closing:
            self.expected = deque(list(self.expected)[: self.closing])
            return
        offered = [self.expected[0]] if self.held is not None else []
        if not offered and not self.position:
            self.expected.clear()
            return
        first = self.position + len(offered)
        zeros = [(0, self._mask(k), *self._marks(k, True, False)) for k in range(first, self.beats_per_frame)]
        self.expected = deque(offered + zeros)
        self.closing = len(self.expected)

    def _mask(self, k: int) -> int:
        """The bits of `tdata` of beat `k` of a frame that hold a value."""
        void = self.layout["void_octets"] * (k % self.layout["beats"] == self.layout["beats"] - 1)
        return (1 << 8 * (self.layout["octets"] - void)) - 1

    def _marks(self, k: int, bad: bool, suspect: bool) -> tuple[int, ...]:
        row, column = divmod(k, self.layout["beats"])
        last = int(column == self.layout["beats"] - 1)
        if not self.layout["tagged"]:
            return last, int(k == 0)
        user = int(k == 0) | bad << 1 | self.layout["row_order"][row] << 2 | suspect << 10
        octets = self.layout["octets"] - last * self.layout["void_octets"]
        return last, user, (1 << octets) - 1


class RegisterBus:
    """AXI4-Lite master that performs one access at a time, each channel after a delay of its own.

    Asserts that a response stays until it is taken, and comes after its access.

    last : the last write, begun or ended
    """

    def __init__(self, dut, rng):
        self.rng = rng
        self.port = {
            name: getattr(dut, f"s_axil_{name}")
            for name in (
                *("awaddr", "awvalid", "awready", "wdata", "wstrb", "wvalid", "wready"),
                *("bvalid", "bready", "bresp", "araddr", "arvalid", "arready"),
                *("rvalid", "rready", "rdata", "rresp"),
            )
        }
        self.driven: dict[str, int] = {}
        dut.s_axil_awprot.value = dut.s_axil_arprot.value = 0
        self.abort()

    def abort(self) -> None:
        """Forget the access under way; the channels fall silent in the next clock."""
        self.access = self.response = None
        self._rest()

    def _put(self, name: str, value: int) -> None:
        if self.driven.get(name) != value:
            self.port[name].value = self.driven[name] = value

    def begin(self, address: int, data: int | None = None, strobe: int = 0xF) -> None:
        """Read `address`, or write `data` to it; it starts with the next `drive`."""
        assert self.access is None
        self.access = {"address": address, "data": data, "strobe": strobe}
        if data is not None:
            self.last = self.access
        self.clock, self.response = 0, None
        delays = [self.rng.choice([0, 0, 0, 0, 1, 2, 5]) for _ in range(3)]
        self.delay = dict(zip(("aw", "w", "b") if data is not None else ("ar", "r", ""), delays, strict=True))
        self.sent = dict.fromkeys([name for name in self.delay if name and name not in "br"], False)

    def drive(self) -> None:
        if self.access is None:
            self._rest()
            return
        for channel, sent in self.sent.items():
            offers = not sent and self.clock >= self.delay[channel]
            if offers and not self.driven[f"{channel}valid"]:
                if channel == "w":
                    self._put("wdata", self.access["data"])
                    self._put("wstrb", self.access["strobe"])
                else:
                    self._put(f"{channel}addr", self.access["address"])
            self._put(f"{channel}valid", int(offers))
        answer = "r" if self.access["data"] is None else "b"
        self._put(f"{answer}ready", int(self.clock >= self.delay[answer]))
        self.clock += 1

    def sample(self) -> tuple[bool, tuple[int, int] | None]:
        """Returns (a write has taken effect in this clock, (data, response) if the access has ended)."""
        if self.access is None:
            return False, None
        port, writes = self.port, self.access["data"] is not None
        for channel, sent in self.sent.items():
            if not sent and self.driven[f"{channel}valid"] and int(port[f"{channel}ready"].value):
                self.sent[channel] = True
        answer = "b" if writes else "r"
        if not int(port[f"{answer}valid"].value):
            assert self.response is None, "registers: a response was withdrawn"
            return False, None
        assert all(self.sent.values()), "registers: a response came before its access"
        response = (0 if writes else int(port["rdata"].value), int(port[f"{answer}resp"].value))
        assert self.response in (None, response), "registers: a response was changed"
        effect, self.response = writes and self.response is None, response
        if not self.driven[f"{answer}ready"]:
            return effect, None
        self.access = self.response = None
        return effect, response

    def _rest(self) -> None:
        for name in ("awvalid", "wvalid", "bready", "arvalid", "rready"):
            self._put(name, 0)
