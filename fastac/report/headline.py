"""The few figures that a reader wants first, from the content of a report."""

from dataclasses import dataclass

ERRORS = (
    ("depth_mae_mm", "depth error", "mm"),
    ("contact_depth_mae_mm", "depth error in contacts", "mm"),
    ("normal_mae_deg", "normals' error", "°"),
    ("contact_gradient_angle_mae_rad", "gradients' error in contacts", "rad"),
)
"""Errors of the skin's shape: the first that a report has is shown."""
PLACES = {"force": "the force", "depth": "the last depth", "normals": "the last normal"}


@dataclass(frozen=True)
class Headline:
    """One figure: what it is, the number with its unit, and a line on where it comes from."""

    label: str
    value: str
    note: str


def headlines(report: dict) -> list[Headline]:
    """What matters most of a build, in this order: equality, cycles, errors, multipliers.

    What the report lacks is left out. Errors are the integers', which the hardware computes.
    """
    rtl, clock_mhz = report["rtl_vs_integer"], report["scene"]["hardware"]["clock_mhz"]
    found = [
        Headline(
            "hardware against integers",
            f"{rtl['mismatches']:,} mismatch{'es' if rtl['mismatches'] != 1 else ''}",
            f"in {rtl['values_compared']:,} values of {rtl['frames']} frames, Verilog simulated",
        )
    ]
    cycles = report["latency_cycles"]
    place = next((name for name in PLACES if f"first_pixel_to_{name}" in cycles), None)
    if place:
        count = cycles[f"first_pixel_to_{place}"]
        note = f"{_time(count / clock_mhz)} at {clock_mhz:g} MHz, assumed"
        found.append(Headline(f"first pixel to {PLACES[place]}", f"{count:,} cycles", note))
    if "initiation_interval" in cycles:
        count = cycles["initiation_interval"]
        note = f"{clock_mhz * 1e6 / count:,.0f} frames/s at {clock_mhz:g} MHz, assumed"
        margin = report.get("pace", {}).get("margin_percent")
        if margin is not None:
            note += f"; the camera's pixels are {abs(margin):.0f}% "
            note += "slower than the hardware" if margin >= 0 else "too fast for the hardware"
        found.append(Headline("a new frame every", f"{count:,} cycles", note))
    return [*found, *_errors(report), *_multipliers(report)]


def _errors(report: dict) -> list[Headline]:
    floats, integers = report["accuracy"]["float"], report["accuracy"]["integer"]
    found, frames = [], f"{report['data']['test_frames']} {report['frames_are']} frames"
    shape = next(((key, *rest) for key, *rest in ERRORS if key in integers), None)
    if shape:
        key, label, unit = shape
        note = f"{_error(floats[key], unit)} in floats; {frames}"
        found.append(Headline(label, _error(integers[key], unit), note))
    if "force_nmae_percent" in integers:
        axes = " over the axes" if "force_x_mae_n" in integers or "force_y_mae_n" in integers else ""
        note = f"of the largest load, mean{axes}; {floats['force_nmae_percent']:.2f}% in floats"
        found.append(Headline("force error", f"{integers['force_nmae_percent']:.2f}%", note))
    elif "force_mae_n" in integers:
        note = f"{1e3 * floats['force_mae_n']:.3g} mN in floats; {frames}"
        found.append(Headline("force error", f"{1e3 * integers['force_mae_n']:.3g} mN", note))
    return [*found, *_intervals(report)]


def _intervals(report: dict) -> list[Headline]:
    """How wide the intervals around the force are, along the skin's normal if that is wanted."""
    counted = report.get("force_interval", {}).get("as_they_are", {})
    axis = next((axis for axis in "zxy" if axis in counted), None)
    if axis is None:
        return []
    entry, promised = counted[axis], 100 * report["force_interval"]["coverage"]
    note = (
        f"mean; {100 * entry['coverage']:.1f}% are within, {100 * entry['coverage_from']:.1f} to"
        f" {100 * entry['coverage_to']:.1f}% with 95% confidence"
    )
    return [
        Headline(f"{promised:.3g}% interval of F_{axis}", f"± {1e3 * entry['half_width_n']:.3g} mN", note)
    ]


def _multipliers(report: dict) -> list[Headline]:
    for key in ("dsp48e2", "dsp48e1"):
        if key in report["resources"]:
            figure = report["resources"][key]
            share = 100 * figure["value"] / report["device"][key]
            how = "estimated" if figure["origin"].startswith("estimated") else "counted by synthesis"
            part = report["device"]["part"].split("-")[0]
            note = f"{share:.1f}% of {part}, {how}"
            return [Headline("multipliers", f"{figure['value']:,g} {key.upper()}", note)]
    return []


def _time(microseconds: float) -> str:
    """A time with three digits, in ms or µs."""
    return f"{microseconds / 1e3:.3g} ms" if microseconds >= 100 else f"{microseconds:.3g} µs"


def _error(value: float, unit: str) -> str:
    """An error with three digits; small lengths in µm."""
    if unit == "mm" and value < 0.1:
        return f"{1e3 * value:.3g} µm"
    return f"{value:.3g}{'' if unit == '°' else ' '}{unit}"
