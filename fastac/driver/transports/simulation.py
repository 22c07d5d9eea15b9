"""The Verilated hardware in another process: a `Transport` to a simulated board (sim/board/).

Registers, DMAs and memory are reached through a socket. The simulation's clock runs only while the driver
asks for something or waits, and time-outs pass in its clocks, so nothing depends on how fast it is.
"""

import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from fastac.driver.description import FILE, Description
from fastac.driver.transports.dma_transport import DmaTransport, frames_in_flight
from fastac.driver.transports.transport import ClosedError, TransportError
from fastac.gateware.target.block_design import family_of
from fastac.sim.board.protocol import (
    CORE_LINE,
    DONE,
    MEMORY_ADDRESS,
    MEMORY_BYTES,
    MEMORY_READ,
    MEMORY_WRITE,
    READ,
    REPLY,
    REQUEST,
    RUN,
    WRITE,
)
from fastac.store.progress import watched

VERILOG = "fastac.v"
LOG = "board.log"
ANSWER_S = 300.0
"""Longest wall-clock time of one answer; a request lets `CHUNK` clocks pass at most."""
CHUNK = 5000
BUILD_S = 3600.0
POLL_S = 0.05
PATIENCE = 4
"""A result may take this many times what the formulas say, and PATIENCE_CLOCKS more."""
PATIENCE_CLOCKS = 20_000


class Board:
    """A connection to a simulated board; safe to use from several threads.

    log : file that says what happened in the simulation, for messages
    """

    def __init__(self, connection: socket.socket, log: Path):
        self._socket, self.log = connection, log
        self._socket.settimeout(ANSWER_S)
        self._lock = threading.Lock()
        self.cycle = 0

    def ask(self, operation: int, argument: int, address: int, payload=b"") -> tuple[int, bytes]:
        """One request; returns the reply's value and bytes. Raises ClosedError if the simulation is gone."""
        with self._lock:
            try:
                self._socket.sendall(REQUEST.pack(operation, argument, address))
                if len(payload):
                    self._socket.sendall(payload)
                status, length, value, self.cycle = REPLY.unpack(self._receive(REPLY.size))
                data = self._receive(length)
            except TimeoutError:
                raise ClosedError(f"the simulation gives no answer; see {self.log}") from None
            except OSError as error:
                raise ClosedError(f"the simulation has ended ({error.strerror}); see {self.log}") from None
        if status != DONE:
            raise TransportError(data.decode(errors="replace"))
        return value, data

    def _receive(self, count: int) -> bytes:
        data = bytearray(count)
        view = memoryview(data)
        while len(view):
            part = self._socket.recv_into(view)
            if not part:
                raise ClosedError(f"the simulation has ended; see {self.log}")
            view = view[part:]
        return bytes(data)

    def close(self) -> None:
        self._socket.close()


class _Window:
    """Registers of one slave on the board."""

    def __init__(self, board: Board, address: int):
        self._board, self._address = board, address

    def read(self, offset: int) -> int:
        return self._board.ask(READ, 0, self._address + offset)[0]

    def write(self, offset: int, value: int) -> None:
        self._board.ask(WRITE, value, self._address + offset)


class _Memory:
    """The board's memory, all of it."""

    address, size = MEMORY_ADDRESS, MEMORY_BYTES

    def __init__(self, board: Board):
        self._board = board

    def write(self, offset: int, octets: np.ndarray) -> None:
        self._board.ask(MEMORY_WRITE, octets.size, self.address + offset, memoryview(octets))

    def read(self, offset: int, count: int) -> np.ndarray:
        return np.frombuffer(self._board.ask(MEMORY_READ, count, self.address + offset)[1], np.uint8)


class SimulationTransport(DmaTransport):
    """A `Transport` to the simulated board behind `board`."""

    def __init__(self, description: Description, board: Board):
        self.board = board
        family = family_of(description.part)
        dmas = [_Window(board, family.dma_at(k)) for k in range(len(description.streams_out))]
        self._clock_hz = description.clock_mhz * 1e6
        frames = frames_in_flight(description) + 2
        clocks = PATIENCE * (description.result_cycles + frames * description.frame_beats) + PATIENCE_CLOCKS
        self._patience_s = clocks / self._clock_hz
        super().__init__(description, _Window(board, family.core_address), dmas, _Memory(board), wide=True)

    def patience_s(self, timeout_s: float) -> float:
        return min(timeout_s, self._patience_s)

    def now_s(self) -> float:
        return self.board.cycle / self._clock_hz

    def wait_interrupt(self, timeout_s: float) -> bool:
        self._serve()  # a line that is high already would end the wait at once
        clocks = min(CHUNK, max(1, round(timeout_s * self._clock_hz)))
        lines, _ = self.board.ask(RUN, clocks, -1 & 0xFFFFFFFF)
        if not lines >> CORE_LINE & 1:
            return False
        self.clear_interrupt()
        return True

    def close(self) -> None:
        self.board.close()


class Simulator:
    """A simulated board's process, with a folder for its socket; a context manager.

    verilog : the folder of `fastac verilog`; folder : where the simulator is built, and the logs
    Raises ClosedError, which names the log, where the simulator cannot be built or run.
    """

    def __init__(self, verilog: Path, folder: Path, *, progress: bool = False):
        folder.mkdir(parents=True, exist_ok=True)
        self.log = folder / LOG
        self._sockets = Path(tempfile.mkdtemp(prefix="fastac-"))  # paths of sockets must be short
        self.socket = self._sockets / "board"
        source = verilog / VERILOG
        if not source.is_file():
            raise TransportError(f"{source}: no such file; write it with fastac verilog BUNDLE")
        command = [sys.executable, "-m", "fastac.sim.board"]
        arguments = [source, verilog / FILE, self.socket, folder]
        with open(self.log, "w") as log:
            self.process = subprocess.Popen(
                [*command, *map(str, arguments)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C is the host's to handle
            )
        try:
            with watched("building the simulator", enabled=progress):
                self._wait_for_socket()
        except BaseException:
            self.close()
            raise

    def _wait_for_socket(self) -> None:
        end = time.monotonic() + BUILD_S
        while not self.socket.exists():
            if self.process.poll() is not None:
                raise ClosedError(f"the simulator did not start; see {self.log}")
            if time.monotonic() > end:
                raise ClosedError(f"the simulator is not built after {BUILD_S:g} s; see {self.log}")
            time.sleep(POLL_S)

    def connect(self) -> Board:
        """The board. It takes one connection, and ends with it."""
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        for _ in range(100):
            try:
                connection.connect(str(self.socket))
                return Board(connection, self.log)
            except ConnectionRefusedError:  # bound, but not listening yet
                time.sleep(POLL_S)
        connection.close()
        raise ClosedError(f"the simulator does not listen; see {self.log}")

    def close(self) -> None:
        """End the process, if it has not ended with its connection."""
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.terminate()
            self.process.wait()
        shutil.rmtree(self._sockets, ignore_errors=True)

    def __enter__(self) -> "Simulator":
        return self

    def __exit__(self, *error) -> None:
        self.close()
