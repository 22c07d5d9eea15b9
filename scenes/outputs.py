"""What each output of a scene needs: the table of the names that `outputs` may have.

What every room must find, train or build follows from these entries through the properties of `Scene`;
docs/extending.md tells how to add an output.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from fastac.store.kinds import Kinds


@dataclass(frozen=True)
class OutputFacts:
    """What an output is, and what must be found before it can be given.

    measured, unit : its values in physical units, as a field of models/result.py, and their unit ("1": none)
    words : the integers that the hardware gives for it, as a field of the same
    force_axes : of an output that is a force, its axes: 0, 1, 2 for x, y, z
    needs_geometry : whether the network must be trained on known normals: forces alone cannot train it
    needs_depth : whether it follows from the Poisson solver's solution
    needs_force : whether a force must be among the outputs, too
    needs_patches : whether it needs the force's K×K kernels at every pixel, not their sum
    needs_dots : whether it follows from the shifts of the marker dots, which then are a part of the force
    """

    measured: str
    unit: str
    words: str
    force_axes: tuple[int, ...] = ()
    needs_geometry: bool = False
    needs_depth: bool = False
    needs_force: bool = False
    needs_patches: bool = False
    needs_dots: bool = False

    @property
    def is_image(self) -> bool:
        """Whether it is given for each pixel, in a stream; others are one or a few numbers a frame, in
        registers."""
        return not (self.force_axes or self.needs_dots)


NORMALS = OutputFacts("normals", "1", "normal_words", needs_geometry=True)
DEPTH = OutputFacts("depth_mm", "mm", "depth_words", needs_geometry=True, needs_depth=True)
FORCE_X = OutputFacts("force_n", "N", "force_raw", force_axes=(0,))
FORCE_Y = OutputFacts("force_n", "N", "force_raw", force_axes=(1,))
FORCE_Z = OutputFacts("force_n", "N", "force_raw", force_axes=(2,))
FORCE_XYZ = OutputFacts("force_n", "N", "force_raw", force_axes=(0, 1, 2))
FORCE_MAP = OutputFacts(
    "force_map_n", "N", "force_map_raw", needs_depth=True, needs_force=True, needs_patches=True
)
SLIP = OutputFacts(
    "slip_px", "px", "slip_words", needs_geometry=True, needs_depth=True, needs_force=True, needs_dots=True
)
OUTPUTS = Kinds(
    "outputs",
    {
        "normals": NORMALS,
        "depth": DEPTH,
        "force_x": FORCE_X,
        "force_y": FORCE_Y,
        "force_z": FORCE_Z,
        "force_xyz": FORCE_XYZ,
        "force_map": FORCE_MAP,
        "slip": SLIP,
    },
)


def measured(names: Iterable[str]) -> dict[str, str]:
    """Fields of models/result.py with the values of these outputs, and their units."""
    facts = [OUTPUTS[name] for name in names]
    return {entry.measured: entry.unit for entry in facts}


def hardware_words(names: Iterable[str]) -> tuple[str, ...]:
    """Fields of models/result.py with the integers that the hardware gives for these outputs, each once."""
    return tuple(dict.fromkeys(OUTPUTS[name].words for name in names))
