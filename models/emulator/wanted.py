"""Which stages the emulator runs for the outputs that are wanted of a frame."""

from dataclasses import dataclass

from fastac.models.integer.pipeline import IntegerPipeline

SLIP = ("slip_words", "slip_px", "slip_dots", "slipping")
"""Outputs that tell of slip."""
DOTS = ("dot_shift_words", "dot_shifts_px", "dots_seen")
MAPS = ("force_map_raw", "force_map_n")
INTERVAL = ("force_half_width_raw", "force_half_width_n")


@dataclass(frozen=True)
class Wanted:
    """words : displacements as the force takes them; the others as they are called."""

    slopes: bool
    solver: bool
    words: bool
    force: bool
    force_map: bool
    dots: bool
    slip: bool
    validity: bool
    interval: bool

    @classmethod
    def of(cls, pipeline: IntegerPipeline, outputs: frozenset[str]) -> "Wanted":
        """What `outputs`, names of fields of `Result`, need."""

        def any_of(*names: str) -> bool:
            return not outputs.isdisjoint(names)

        measured = pipeline.validity
        force, slip, validity = (
            any_of("force_raw", "force_n", *INTERVAL),
            any_of(*SLIP),
            any_of("validity", "validity_measures", *INTERVAL),
        )
        words = (
            (force and pipeline.quantiser is not None)
            or (validity and measured.displacements)
            or slip
            or any_of("displacement_words", "displacement_saturated", *MAPS)
        )
        solver = words or any_of("depth_words", "depth_mm", "displacement_mm")
        slopes = solver or force or any_of("slopes", "gradient_saturated") or (validity and measured.slopes)
        dots = pipeline.follower is not None and (force or validity or slip or any_of(*DOTS))
        return cls(slopes, solver, words, force, any_of(*MAPS), dots, slip, validity, any_of(*INTERVAL))
