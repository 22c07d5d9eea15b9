"""Ports of a top level with packets, driven and read a clock at a time for models of its DMAs (sim/dma/)."""

from fastac.sim.dma.axi_dma import Beat


class InputPort:
    """Drives `s_axis` with the beats that a source offers."""

    def __init__(self, dut):
        self._dut, self._shown = dut, None
        for name in ("tvalid", "tdata", "tlast"):
            getattr(dut, f"s_axis_{name}").value = 0

    def offer(self, beat: Beat | None) -> None:
        """What is valid in this clock."""
        dut, shown, self._shown = self._dut, self._shown, beat
        if (beat is None) != (shown is None):
            dut.s_axis_tvalid.value = int(beat is not None)
        if beat is not None and beat is not shown:
            dut.s_axis_tdata.value = int.from_bytes(beat.octets, "little")
            dut.s_axis_tkeep.value = beat.keep
            dut.s_axis_tlast.value = int(beat.last)

    def taken(self) -> bool:
        """In the read-only phase of a clock: whether the offered beat is taken."""
        return self._shown is not None and bool(int(self._dut.s_axis_tready.value))


class OutputPort:
    """Reads the beats of `m_axis_NAME`, `octets` bytes each, in the clocks in which it is open."""

    def __init__(self, dut, name: str, octets: int):
        members = ("tvalid", "tready", "tdata", "tkeep", "tlast")
        ports = (getattr(dut, f"m_axis_{name}_{member}") for member in members)
        self.valid, self._ready, self._data, self._keep, self._last = ports
        self._octets, self.is_open = octets, False
        self._ready.value = 0

    def open(self, ready: bool) -> None:
        """Drive `tready`."""
        if ready != self.is_open:
            self._ready.value, self.is_open = int(ready), ready

    def beat(self) -> Beat | None:
        """In the read-only phase of a clock: the beat that is transferred, if any."""
        if not self.is_open or not int(self.valid.value):
            return None
        octets = int(self._data.value).to_bytes(self._octets, "little")
        return Beat(octets, int(self._keep.value), bool(int(self._last.value)))
