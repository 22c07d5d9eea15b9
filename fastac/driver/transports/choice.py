"""The transports by the names that the command line has for them."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from fastac.driver.description import Description
from fastac.driver.transports.transport import Transport, TransportError
from fastac.models.integer.bundle import Bundle, is_bundle, load_bundle

BOARDS = ("uio", "pynq")


@contextmanager
def open_transport(
    via: str,
    description: Description,
    *,
    bundle: Bundle,
    verilog: Path,
    folder: Path,
    bitstream: Path | None = None,
    calibration: Path | None = None,
    progress: bool = False,
) -> Iterator[Transport]:
    """The transport "sim", "emulator", "uio" or "pynq", closed at the end.

    verilog : the folder of hardware.json and the Verilog; folder : where the simulator is built
    bitstream : for "pynq"; calibration : a bundle that the emulator may be given the calibration of
    Raises TransportError where there is no such hardware here, or no DMA can serve it.
    """
    if via in BOARDS and not description.has_packets:
        raise TransportError(
            f"--via {via}: hardware.streams = {description.streams!r}: a DMA needs hardware.streams ="
            " 'packets' in the scene, or --verilog with the folder of fastac vivado"
        )
    if via == "emulator":
        from fastac.driver.transports.emulator import EmulatorTransport

        others = [load_bundle(calibration)] if calibration and is_bundle(calibration) else []
        transport = EmulatorTransport(bundle, description, calibrations=others)
        yield transport
    elif via == "sim":
        from fastac.driver.transports.simulation import SimulationTransport, Simulator

        with Simulator(verilog, folder, progress=progress) as simulator:
            transport = SimulationTransport(description, simulator.connect())
            try:
                yield transport
            finally:
                transport.close()
    else:
        transport = _of_board(via, description, bitstream)
        try:
            yield transport
        finally:
            transport.close()


def _of_board(via: str, description: Description, bitstream: Path | None) -> Transport:
    if via == "uio":
        from fastac.driver.transports.uio import UioTransport

        return UioTransport(description)
    if bitstream is None:
        raise TransportError("--via pynq: --bitstream: missing; give the .bit file of the board's design")
    from fastac.driver.transports.pynq import PynqTransport

    return PynqTransport(description, bitstream)


def words_of_calibration(path: Path, hardware: Bundle) -> np.ndarray:
    """The words (words,) uint32 in a file of `fastac calibration`, or what it would write of a bundle."""
    if is_bundle(path):
        from fastac.gateware.calibration import calibration_words

        return calibration_words(load_bundle(path), hardware)
    octets = path.read_bytes()
    if not octets or len(octets) % 4:
        raise TransportError(f"{path}: {len(octets)} bytes: expected words of 4 bytes")
    return np.frombuffer(octets, "<u4")
