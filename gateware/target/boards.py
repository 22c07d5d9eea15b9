"""Boards whose processing system Vivado's board files know how to set."""

from dataclasses import dataclass

NO_BOARD = "none"


class BoardError(ValueError):
    """A board that cannot carry the hardware; the message is one line."""


@dataclass(frozen=True)
class Board:
    """part: what is on the board; pattern: of its board files in Vivado, vendor:board:part0:version."""

    part: str
    pattern: str


BOARDS = {
    "kv260": Board("xck26-sfvc784-2LV-c", "xilinx.com:kv260_som:part0:*"),
    "kr260": Board("xck26-sfvc784-2LV-c", "xilinx.com:kr260_som:part0:*"),
    "k26": Board("xck26-sfvc784-2LV-c", "xilinx.com:k26c:part0:*"),
    "zcu104": Board("xczu7ev-ffvc1156-2-e", "xilinx.com:zcu104:part0:*"),
    "pynq-z2": Board("xc7z020clg400-1", "tul.com.tw:pynq-z2:part0:*"),
    "arty-z7-20": Board("xc7z020clg400-1", "digilentinc.com:arty-z7-20:part0:*"),
}
"""By name. AMD's files come with Vivado or from its store (Tools, Vivado Store, Boards), those of TUL and
Digilent from these makers. None is known for the XCZU19EG."""


def boards_with(part: str) -> dict[str, Board]:
    """The boards that have this part, by name."""
    return {name: board for name, board in BOARDS.items() if board.part == part}


def choose_board(part: str, name: str | None) -> str:
    """`name`, or, if it is None, the first board with this part, or "none" where there is none.

    Raises BoardError for a board that is not known, or that has another part.
    """
    known = boards_with(part)
    if name is None:
        return next(iter(known), NO_BOARD)
    if name != NO_BOARD and name not in BOARDS:
        raise BoardError(f"board {name!r}: expected {NO_BOARD} or one of {', '.join(BOARDS)}")
    if name != NO_BOARD and name not in known:
        raise BoardError(f"board {name}: has {BOARDS[name].part}; hardware.part of the scene is {part}")
    return name
