"""What the scene must know of each FPGA: the table of the parts that `hardware.part` may name.

What a part holds stands behind the same name in gateware/target/device.py.
"""

from dataclasses import dataclass
from difflib import get_close_matches

from fastac.scenes.strict import listed
from fastac.store.kinds import Kinds

DEFAULT_PART = "xczu19eg-ffvc1760-2-i"


@dataclass(frozen=True)
class PartFacts:
    """What follows from the choice of a part.

    boards : boards and modules that carry it; none for the default, which is the paper's part
    family : "zynquplus" (Zynq UltraScale+ MPSoC) or "zynq7000" (Zynq-7000)
    speed_grade : as data sheets name it
    dsp_mhz, block_ram_mhz : the highest clock of a DSP slice with all registers used, and of a block RAM in
        the modes WRITE_FIRST and NO_CHANGE
    source : data sheet of the two, tables "DSP48 Slice Switching Characteristics" ("DSP48E1 …") and "Block
        RAM Switching Characteristics" ("Block RAM and FIFO …")
    """

    boards: tuple[str, ...]
    family: str
    speed_grade: str
    dsp_mhz: float
    block_ram_mhz: float
    source: str

    @property
    def maximum_clock_mhz(self) -> float:
        """What no design of ours can exceed: each has a DSP slice or could have, and each a block RAM."""
        return min(self.dsp_mhz, self.block_ram_mhz)


XCZU19EG = PartFacts((), "zynquplus", "-2", 775, 738, "DS925, 0.85 V")
XCK26 = PartFacts(("kv260", "kr260"), "zynquplus", "-2LV", 644, 585, "DS925, -2 at 0.72 V")
XCZU7EV = PartFacts(("zcu104",), "zynquplus", "-2", 775, 738, "DS925, 0.85 V")
XC7Z020 = PartFacts(("pynq-z2", "arty-z7-20"), "zynq7000", "-1", 464.25, 388.2, "DS187")
"""The K26's -2LV is taken at the lower of the two voltages that DS925 has for -2: that holds at either."""
PARTS = Kinds(
    "hardware.part",
    {
        "xczu19eg-ffvc1760-2-i": XCZU19EG,
        "xck26-sfvc784-2LV-c": XCK26,
        "xczu7ev-ffvc1156-2-e": XCZU7EV,
        "xc7z020clg400-1": XC7Z020,
    },
)
"""By the part's name in Vivado's notation."""


def meant(name: str) -> str | None:
    """The part that a name which is none may be meant for: its beginning, its board or its misspelling."""
    given = name.lower()
    boards = {board: part for part in PARTS for board in PARTS[part].boards}
    if given in boards:
        return boards[given]
    begun = [part for part in PARTS if given and part.lower().startswith(given)]
    if begun:
        return begun[0]
    spelt = {part.lower(): part for part in PARTS} | boards
    near = get_close_matches(given, spelt, n=1)
    return spelt[near[0]] if near else None


def check_part(name: str, clock_mhz: float) -> None:
    """Raise ValueError, in one line, unless there is such a part and it can reach the clock.

    To be called by the scene alone, as `require_known`.
    """
    try:
        facts = PARTS[name]
    except KeyError:
        part = meant(name)
        hint = f"; did you mean {part}?" if part else ""
        raise ValueError(f"hardware.part = {name!r}: Input should be {listed(PARTS)}{hint}") from None
    if clock_mhz > facts.maximum_clock_mhz:
        raise ValueError(
            f"hardware.clock_mhz = {clock_mhz:g}: the {name} reaches at most {facts.maximum_clock_mhz:g} MHz"
            f" (DSP slices {facts.dsp_mhz:g}, block RAM {facts.block_ram_mhz:g}; AMD {facts.source})"
        )
