"""What the XCZU19EG holds, and designs that need more refused in one line."""

DEVICE = {
    "part": "xczu19eg-ffvc1760-2-i",
    "lut": 522_720,
    "carry8": 65_340,
    "dsp48e2": 1968,
    "ramb36": 984,
    "uram288": 128,
}
"""The part as Vivado writes it, and what it holds."""


class DeviceError(ValueError):
    """A design that the device cannot hold; the message is one line."""


def check_multipliers(by_stage: dict[str, int]) -> None:
    """Raise DeviceError if the DSP48E2 of all stages, {stage: number}, are more than the device has."""
    _check(
        "DSP48E2",
        by_stage,
        "fewer hardware.pixels_per_clock, hardware.weights = 'baked' or a smaller sensor.width_px",
    )


def check_block_rams(by_stage: dict[str, float]) -> None:
    """Raise DeviceError if the RAMB36 of all stages, {stage: number}, are more than the device has.

    UltraRAM is not counted on: it takes no initial values (Xilinx UG573), and the tables, such as those of
    the force kernels, are nothing else.
    """
    _check(
        "RAMB36",
        by_stage,
        "force.kernel = 'collapsed', a smaller force.kernel_size, fewer numbers.kernel_bits or a smaller"
        " sensor.width_px",
    )


def _check(block: str, by_stage: dict[str, float], remedy: str) -> None:
    """Raise DeviceError if the stages need more of a kind of block than the device has."""
    needed, held = sum(by_stage.values()), DEVICE[block.lower()]
    if needed > held:
        stages = ", ".join(f"{name} {number:,g}" for name, number in by_stage.items())
        raise DeviceError(
            f"{needed:,g} {block} ({stages}): the {DEVICE['part']} has {held:,}; choose {remedy}"
        )
