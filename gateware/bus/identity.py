"""What the registers say about the hardware, and which registers it has."""

from dataclasses import dataclass

from fastac.gateware.bus.register_map import AXES, ERRORS, ID, REGISTERS, Register

BUS_ERRORS = ("flag", "respond")
"""How a refused access is reported: by ERRORS.access_refused alone, or by an AXI error response too."""


@dataclass(frozen=True)
class Identity:
    """The constants that the registers report about the hardware; they also decide which registers exist."""

    bundle_hash: int
    version: int
    height: int
    width: int
    channels: int
    lanes: int
    axes: str  # axes of the force: a subsequence of "xyz", "" without force
    force_width: int = 64  # bits of one raw accumulator
    depth: bool = True  # has a depth output
    background_capture: bool = False
    normals: bool = False
    force_map: bool = False
    rows_reversed: bool = False
    half_width: bool = False  # has half-widths of the intervals around a force
    half_width_bits: int = 64  # bits of a half-width, without a sign
    slip: bool = False  # has the spread of the touching dots, beside a force
    slip_limit: int = 0  # SLIP_LIMIT after reset
    calibration_words: int = 0  # words of a calibration image; 0: no calibration can be loaded
    calibration_layout: int = 0  # first word of an image
    frame_timeout: int = 0  # clocks, FRAME_TIMEOUT after reset
    packets: bool = False  # frames and images are packets; every result is a record too
    bus_errors: str = "flag"  # a refused access: "flag" sets ERRORS.access_refused, "respond" also answers so

    def __post_init__(self):
        for name, low, high in (
            ("bundle_hash", 0, (1 << 64) - 1),
            ("version", 0, (1 << 32) - 1),
            ("height", 1, (1 << 16) - 1),
            ("width", 1, (1 << 16) - 1),
            ("channels", 1, 255),
            ("lanes", 1, 255),
            ("force_width", 1, 64),
            ("half_width_bits", 1, 64),
            ("calibration_words", 0, (1 << 32) - 1),
            ("calibration_layout", 0, (1 << 32) - 1),
            ("frame_timeout", 0, (1 << 32) - 1),
            ("slip_limit", 0, (1 << 32) - 1),
        ):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} {getattr(self, name)}: expected {low} to {high}")
        if self.axes != "".join(axis for axis in AXES if axis in self.axes):
            raise ValueError(f"axes {self.axes!r}: expected some of {AXES!r}, in this order")
        if self.bus_errors not in BUS_ERRORS:
            raise ValueError(f"bus_errors {self.bus_errors!r}: expected one of {BUS_ERRORS}")
        for name in ("slip", "half_width"):
            if getattr(self, name) and not self.axes:
                raise ValueError(f"{name} True: expected axes of force, with which it is sampled")
        if not self.axes and not self.depth and not self.normals:
            raise ValueError("axes '', depth False, normals False: expected at least one output")

    @property
    def result(self) -> str:
        """The output that raises the interrupt: force; without it depth; without both normals."""
        return "force" if self.axes else "depth" if self.depth else "normals"

    @property
    def early_normals(self) -> bool:
        """Whether packets of normals end before the result of their frame is there."""
        return self.packets and self.normals and self.result != "normals"

    @property
    def calibration(self) -> bool:
        """Whether calibrations can be loaded."""
        return self.calibration_words > 0

    @property
    def errors(self) -> tuple[str, ...]:
        """The errors that this hardware can report, in the order of ERRORS."""
        absent = {"calibration_refused"} if not self.calibration else set()
        absent |= {"results_lost"} if not self.packets else set()
        return tuple(name for name in ERRORS if name not in absent)

    @property
    def capabilities(self) -> int:
        """The constant value of the register CAPABILITIES."""
        values = {f"force_{axis}": axis in self.axes for axis in AXES}
        register = next(register for register in REGISTERS if register.name == "CAPABILITIES")
        values |= {f.name: getattr(self, f.name) for f in register.fields if f.name not in values}
        return sum(int(values[field.name]) << field.low for field in register.fields)

    @property
    def resets(self) -> dict[str, int | None]:
        """The registers' values after reset; None where they depend on more, such as on the time."""
        found = {register.name: 0 for register in self.registers}
        constants = {
            "ID": ID,
            "VERSION": self.version,
            "GEOMETRY": self.height | self.width << 16,
            "CAPABILITIES": self.capabilities,
            "CONTROL": 1,  # enable
            "BUNDLE_HASH_LOW": self.bundle_hash & 0xFFFFFFFF,
            "BUNDLE_HASH_HIGH": self.bundle_hash >> 32,
            "FRAME_TIMEOUT": self.frame_timeout,
            "SLIP_LIMIT": self.slip_limit,
            "CALIBRATION_WORDS": self.calibration_words,
            "CALIBRATION_LAYOUT": self.calibration_layout,
            "TIME_LOW": None,
        }
        if self.calibration:  # which no reset touches
            constants |= dict.fromkeys(
                ("BUNDLE_HASH_LOW", "BUNDLE_HASH_HIGH", "CALIBRATION_RECEIVED", "STATUS")
            )
        return found | {name: value for name, value in constants.items() if name in found}

    @property
    def registers(self) -> tuple[Register, ...]:
        """The registers of this hardware; accesses to other addresses are refused."""
        present = {"", *(f"force_{axis}" for axis in self.axes)}
        present |= {"force"} if self.axes else set()
        present |= {"depth"} if self.depth else set()
        present |= {"normals"} if self.normals else set()
        present |= {"slip"} if self.slip else set()
        if self.half_width:
            present |= {"half_width", *(f"half_width_{axis}" for axis in self.axes)}
        present |= {"calibration"} if self.calibration else set()
        present |= {"results"} if self.packets else set()
        return tuple(register for register in REGISTERS if register.needs in present)
