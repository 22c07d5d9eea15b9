"""Which packet and which record belong to which frame, and what is out of order."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from fastac.driver.description import Description
from fastac.driver.packets import record_of
from fastac.driver.registers import WORD_MASK, Registers
from fastac.driver.transports.transport import PacketSizeError, Transport, TransportTimeout, until
from fastac.gateware.bus.record import RecordFlag

ABORTED = int(RecordFlag.ABORTED)
FIFO = ""
"""In place of a stream's name: the records that are read from the registers."""
CLEAR_AFTER = 8
"""Records after which those in the registers' FIFO of 16 are discarded, where packets carry them too."""


@dataclass
class Counts:
    """What has happened since the driver was made.

    sent, received : frames in and results out; lost : frames without a result
    timeouts : a packet did not come in time; dma_errors : a DMA reported an error or a packet of another
        size; each of these ends all that is in flight
    missing : results that were left out: the one of a later frame came instead
    stale : packets that belonged to no frame that is waited for, such as those that a reset cut
    overruns : records that the hardware dropped because the registers' FIFO was full
    errors : by name, results with which an error stood in ERRORS
    """

    sent: int = 0
    received: int = 0
    lost: int = 0
    timeouts: int = 0
    dma_errors: int = 0
    missing: int = 0
    stale: int = 0
    overruns: int = 0
    errors: Counter = field(default_factory=Counter)


class Receiver:
    """Takes from a transport what belongs to a frame.

    counts : is kept up to date
    own_fifo : no packet carries the whole record, so it is read from the registers
    settling : since a restart no result has come, so that the rest of an earlier packet may still come
    """

    def __init__(
        self, transport: Transport, registers: Registers, description: Description, *, timeout_s: float
    ):
        self._transport, self._registers, self._description = transport, registers, description
        self.timeout_s, self.counts, self.missing = timeout_s, Counts(), ""
        self.own_fifo = description.record_at is None
        self.has_fifo = "RESULTS_WORD" in registers
        self._lost_before = registers.read("RESULTS_LOST") if self.has_fifo else 0
        self._trailer = {o.name: o.format.image_bytes for o in description.outputs} or {"results": 0}
        self._held: dict[str, np.ndarray] = {}
        self.settling = False

    def restart(self) -> None:
        """Everything in flight is gone; a rest of it may still come."""
        self._held.clear()
        self.settling = True

    def collect(self, number: int) -> tuple[np.void, dict[str, np.ndarray]] | None:
        """The record and the images' packets of frame `number`; None where a later frame came instead.

        Raises TransportTimeout, DmaError and PacketError.
        """
        found = {stream: self._packet(stream, number) for stream in self._trailer}
        record = self._from_registers(number) if self.own_fifo else None
        if None in found.values() or (self.own_fifo and record is None):
            self.counts.missing += 1
            self.missing = f"frame {number}: no result, but one of a later frame"
            return None
        if record is None:
            record = found[self._description.record_at[0]][1]
        self.settling = False
        self._look_after(record)
        self.counts.received += 1
        return record, {name: octets for name, (octets, _) in found.items() if name != "results"}

    def _packet(self, stream: str, number: int) -> tuple[np.ndarray, np.void] | None:
        """The packet of a stream and its trailer for frame `number`; None where a later one comes first."""
        while True:
            octets = self._held.pop(stream, None)
            if octets is None:
                try:
                    octets = self._transport.receive(stream, self.timeout_s)
                except PacketSizeError:
                    if not self.settling:
                        raise
                    self.counts.stale += 1
                    continue
            record = record_of(octets, self._trailer[stream], self._description.record)
            ahead = int(record["frame"]) - number & WORD_MASK
            if int(record["flags"]) & ABORTED or ahead >> 31:
                self.counts.stale += 1
            elif ahead:
                self._held[stream] = octets
                return None
            else:
                return octets, record

    def _from_registers(self, number: int) -> np.void | None:
        """The record of frame `number` out of the registers' FIFO; None where a later one comes first."""
        while True:
            record = self._held.pop(FIFO, None)
            if record is None:
                there = until(
                    lambda: self._registers.read("RESULTS_WAITING"),
                    self._transport,
                    self.timeout_s,
                    self._transport.wait_interrupt,
                )
                if not there:
                    raise TransportTimeout(f"RESULTS_WAITING: no record within {self.timeout_s:g} s")
                form = self._description.record
                words = [self._registers.read("RESULTS_WORD") for _ in form.words]
                record = np.array(words, "<u4").view(form.layout)
            ahead = int(record["frame"][0]) - number & WORD_MASK
            if not ahead:
                return record[0]
            if not ahead >> 31:
                self._held[FIFO] = record
                return None
            self.counts.stale += 1

    def _look_after(self, record: np.void) -> None:
        """What the host owes the registers after a result."""
        errors = int(record["errors"])
        if errors:
            names = self._description.errors
            self.counts.errors.update(name for bit, name in enumerate(names) if errors >> bit & 1)
            self._registers.write("ERRORS", errors)
        if not self.has_fifo:
            return
        if self.own_fifo:
            if errors:
                lost = self._registers.read("RESULTS_LOST")
                self.counts.overruns += lost - self._lost_before & WORD_MASK
                self._lost_before = lost
        elif self.counts.received % CLEAR_AFTER == 0:
            self._registers.write("CONTROL", enable=1, interrupt_enable=1, clear_results=1)
