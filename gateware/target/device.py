"""Resources of the target device, the XCZU19EG, and the check that a design fits."""

DEVICE = {
    "part": "xczu19eg-ffvc1760-2-i",
    "lut": 522_720,
    "carry8": 65_340,
    "dsp48e2": 1968,
    "ramb36": 984,
    "uram288": 128,
}
"""Part number in Vivado's notation and number of each resource (Xilinx DS891)."""


class DeviceError(ValueError):
    """The design needs more resources than the device has; the message is one line."""


def check_multipliers(by_stage: dict[str, int]) -> None:
    """Raise DeviceError if all stages' DSP48E2 slices, {stage: number}, exceed the device's."""
    _check(
        "DSP48E2",
        by_stage,
        "fewer hardware.pixels_per_clock, hardware.weights = 'baked' or a smaller sensor.width_px",
    )


def check_block_rams(by_stage: dict[str, float]) -> None:
    """Raise DeviceError if all stages' RAMB36 blocks, {stage: number}, exceed the device's.

    UltraRAM cannot replace them: it has no initial values (Xilinx UG573), which ROMs such as those of the
    force kernels need.
    """
    _check(
        "RAMB36",
        by_stage,
        "force.kernel = 'collapsed', a smaller force.kernel_size, fewer numbers.kernel_bits or a smaller"
        " sensor.width_px",
    )


def _check(block: str, by_stage: dict[str, float], remedy: str) -> None:
    """Raise DeviceError if the stages need more of `block` than the device has; `remedy` ends the message."""
    needed, held = sum(by_stage.values()), DEVICE[block.lower()]
    if needed > held:
        stages = ", ".join(f"{name} {number:,g}" for name, number in by_stage.items())
        raise DeviceError(
            f"{needed:,g} {block} ({stages}): the {DEVICE['part']} has {held:,}; choose {remedy}"
        )
