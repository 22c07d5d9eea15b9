"""What only UIO has: devices by name or address, their errors, the buffer's size and cache maintenance."""

import shutil

import pytest
from board_stand_in import UioBoard

from fastac.driver.driver import Driver
from fastac.driver.transports.transport import TransportError
from fastac.driver.transports.uio import UioTransport, find


@pytest.fixture
def board(bundle, description, tmp_path):
    found = UioBoard(bundle, description, tmp_path / "board")
    yield found
    found.close()


def opened(board, description, **changes) -> UioTransport:
    return UioTransport(description, **{"sys": board.sys, "dev": board.dev, "device": board.device} | changes)


def test_devices_by_name_and_by_address(board):
    assert find([("fastac_0", 1), ("axi_dma_0", 0xA001_0000)], board.sys / "uio") == [0, 1]
    with pytest.raises(TransportError, match=r"no device other or at 0x5; there are: fastac_0 at 0xa0000000"):
        find([("other", 5)], board.sys / "uio")


def test_the_buffer_is_synchronised_and_large_enough(board, description, frames):
    transport = opened(board, description)
    list(Driver(transport, description).frames(frames[:2]))
    transport.close()
    files = board.sys / "u-dma-buf" / "udmabuf0"
    packet = description.streams_out["depth"]
    assert (files / "sync_size").read_text() == str(packet)
    assert (files / "sync_direction").read_text() == "2"
    assert (files / "sync_for_cpu").read_text() == (files / "sync_for_device").read_text() == "1"
    (files / "size").write_text("4096\n")
    with pytest.raises(TransportError, match=r"udmabuf0: 4096 bytes: expected \d+ or more; load u-dma"):
        opened(board, description)


def test_files_that_are_missing_or_closed(board, description, tmp_path):
    (board.sys / "u-dma-buf" / "udmabuf0" / "phys_addr").write_text("here")
    with pytest.raises(TransportError, match=r"phys_addr: no number"):
        opened(board, description)
    shutil.rmtree(board.sys / "u-dma-buf")
    with pytest.raises(TransportError, match=r"phys_addr: No such file or directory"):
        opened(board, description)
    with pytest.raises(TransportError, match=r"uio0: No such file or directory; may this user open it\?"):
        opened(board, description, dev=tmp_path)
