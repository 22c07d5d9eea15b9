"""Where a logarithmic axis has its labels, and what they say: few, plain numbers where short."""

import math

SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MOST_POWERS = 6


def log_ticks(low: float, high: float) -> tuple[list[float], list[str]]:
    """Places and labels that cover the range from `low` to `high`, both above zero.

    The fewer decades there are, the more labels each has; over three and more only powers of ten.
    """
    decades = math.log10(high / low)
    steps = (1, 1.5, 2, 3, 4, 6, 8) if decades < 1 else (1, 2, 5) if decades < 3 else (1,)
    every = math.ceil(decades / MOST_POWERS) if decades >= 3 else 1
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    at = [step * 10.0**power for power in powers if power % every == 0 for step in steps]
    return at, [_label(value) for value in at]


def _label(value: float) -> str:
    if 1e-4 < value < 1e3:
        return f"{value:g}"
    if 1e3 <= value < 1e6:
        return f"{value / 1e3:g}k"
    power = math.floor(math.log10(value) + 1e-9)
    factor = "" if math.isclose(value, 10.0**power) else f"{value / 10.0**power:g}·"
    return f"{factor}10{str(power).translate(SUPERSCRIPT)}"
