"""What each part holds, by the names of `hardware.part`, and the checks that a design fits.

Numbers of resources are those of AMD's overviews: Zynq UltraScale+ MPSoC (DS891, tables of the EG and EV
devices' features; the K26's XCK26 has the numbers of the ZU5EV there, as in DS987) and Zynq-7000 (DS190,
table of the devices' features). CARRY8 is one for each CLB of UltraScale+ (UG574), of 8 look-up tables,
CARRY4 one for each slice of the 7 series (UG474), of 4.
"""

from dataclasses import dataclass

from fastac.gateware.arithmetic.dsp_slice import DSP48E1, DSP48E2, DspSlice
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.scenes.pace import FOLDS
from fastac.scenes.schema import Scene
from fastac.store.kinds import Kinds

LUTS_PER_CARRY = {"carry8": 8, "carry4": 4}
LUT_MARGIN = 0.25
"""How far an estimate of look-up tables may exceed the part's before the design is refused: no more than the
estimate itself may be off (fastac/synth/estimates/resources.py states its errors), and Vivado's counts
differ, too."""


PACKED_ACTIVATION_BITS = 9
"""Most bits of an activation with which two products share a DSP48E1."""


class DeviceError(ValueError):
    """The design needs more resources than the device has; the message is one line."""


@dataclass(frozen=True)
class Device:
    """Resources of a part.

    carry : kind of its carry chains, "carry8" or "carry4"
    dsp, dsps : kind of its DSP slices, and how many there are
    ramb36, uram288 : block RAMs of 36 Kbit and UltraRAMs of 288 Kbit
    """

    part: str
    lut: int
    ff: int
    dsps: int
    ramb36: int
    uram288: int = 0
    dsp: DspSlice = DSP48E2
    carry: str = "carry8"

    @property
    def dsp_key(self) -> str:
        """The DSP slices' name in reports: "dsp48e2" or "dsp48e1"."""
        return self.dsp.name.lower()

    @property
    def totals(self) -> dict[str, str | int]:
        """The part and its resources by their names in reports; kinds that it has none of are absent."""
        found = {
            "part": self.part,
            "lut": self.lut,
            "ff": self.ff,
            self.carry: self.lut // LUTS_PER_CARRY[self.carry],
            self.dsp_key: self.dsps,
            "ramb36": self.ramb36,
        }
        return found | ({"uram288": self.uram288} if self.uram288 else {})

    def check_multipliers(self, by_stage: dict[str, int], scene: Scene) -> None:
        """Raise DeviceError if all stages' DSP slices, {stage: number}, exceed the device's.

        scene : whose they are; what it has already is not proposed
        """
        numbers, remedies = scene.numbers, []
        unfolded = scene.fold == 1 and scene.hardware.weights == "loadable"
        if self.dsp is DSP48E1:
            if unfolded and by_stage.get("normals") and numbers.activation_bits > PACKED_ACTIVATION_BITS:
                remedies.append(f"numbers.activation_bits of {PACKED_ACTIVATION_BITS} or fewer")
            if by_stage.get("depth") and numbers.data_bits >= self.dsp.wide_port:
                remedies.append(f"numbers.data_bits of {self.dsp.wide_port - 1} or fewer")
        if scene.fold < max(FOLDS):
            remedies.append("fewer hardware.pixels_per_clock")
        if unfolded:  # baked weights below one pixel a clock take as many
            remedies.append("hardware.weights = 'baked'")
        self._check(self.dsp.name, by_stage, self.dsps, [*remedies, "a smaller sensor.width_px"])

    def check_block_rams(self, by_stage: dict[str, float]) -> None:
        """Raise DeviceError if all stages' RAMB36 blocks, {stage: number}, exceed the device's.

        UltraRAM cannot replace them: it has no initial values (Xilinx UG573), which ROMs such as those of the
        force kernels need.
        """
        self._check(
            "RAMB36",
            by_stage,
            self.ramb36,
            [
                *("force.kernel = 'collapsed'", "a smaller force.kernel_size", "fewer numbers.kernel_bits"),
                *("another poisson.solver", "fewer hardware.pixels_per_clock", "a smaller sensor.width_px"),
            ],
        )

    def check_luts(self, by_stage: dict[str, float]) -> None:
        """Raise DeviceError if all stages' look-up tables, an estimate, are clearly more than the device's:
        by more than LUT_MARGIN."""
        self._check(
            "look-up tables by estimate",
            {stage: round(number) for stage, number in by_stage.items()},
            self.lut,
            ["fewer hardware.pixels_per_clock", "hardware.weights = 'loadable'", "a smaller network.width"],
            margin=LUT_MARGIN,
        )

    def _check(
        self,
        block: str,
        by_stage: dict[str, float],
        held: int,
        remedies: list[str],
        *,
        margin: float = 0.0,
    ) -> None:
        """Raise DeviceError if the stages need more of `block` than `held`, beyond the margin."""
        needed = sum(by_stage.values())
        if needed > held * (1 + margin):
            stages = ", ".join(f"{name} {number:,g}" for name, number in by_stage.items())
            raise DeviceError(
                f"{needed:,g} {block} ({stages}): the {self.part} has {held:,};"
                f" choose {', '.join(remedies)} or another hardware.part"
            )


XCZU19EG = Device("xczu19eg-ffvc1760-2-i", lut=522_720, ff=1_045_440, dsps=1968, ramb36=984, uram288=128)
XCK26 = Device("xck26-sfvc784-2LV-c", lut=117_120, ff=234_240, dsps=1248, ramb36=144, uram288=64)
XCZU7EV = Device("xczu7ev-ffvc1156-2-e", lut=230_400, ff=460_800, dsps=1728, ramb36=312, uram288=96)
XC7Z020 = Device("xc7z020clg400-1", lut=53_200, ff=106_400, dsps=220, ramb36=140, dsp=DSP48E1, carry="carry4")
DEVICES = Kinds(
    "hardware.part",
    {
        "xczu19eg-ffvc1760-2-i": XCZU19EG,
        "xck26-sfvc784-2LV-c": XCK26,
        "xczu7ev-ffvc1156-2-e": XCZU7EV,
        "xc7z020clg400-1": XC7Z020,
    },
)


def device_of(scene: Scene) -> Device:
    """The device that a scene is for."""
    return DEVICES[scene.hardware.part]


def on_part(pipeline: IntegerPipeline, part: str) -> IntegerPipeline:
    """The same integers for another part."""
    hardware = pipeline.scene.hardware.model_copy(update={"part": part})
    return pipeline.replace(scene=pipeline.scene.model_copy(update={"hardware": hardware}))
