"""What each output of a scene needs: the table of the names that `outputs` may have.

What every room must find, train or build follows from these entries through the properties of `Scene`;
docs/extending.md tells how to add an output.
"""

from dataclasses import dataclass

from fastac.store.kinds import Kinds


@dataclass(frozen=True)
class OutputFacts:
    """What must be found before one output can be given.

    force_axes : of an output that is a force, its axes: 0, 1, 2 for x, y, z
    needs_geometry : whether normals must be right for it, so that forces alone cannot train it
    needs_depth : whether it follows from the Poisson solver's solution
    needs_force : whether a force must be among the outputs, too
    needs_patches : whether it needs the force's K×K kernels at every pixel, not their sum
    """

    force_axes: tuple[int, ...] = ()
    needs_geometry: bool = False
    needs_depth: bool = False
    needs_force: bool = False
    needs_patches: bool = False


NORMALS = OutputFacts(needs_geometry=True)
DEPTH = OutputFacts(needs_geometry=True, needs_depth=True)
FORCE_X = OutputFacts(force_axes=(0,))
FORCE_Y = OutputFacts(force_axes=(1,))
FORCE_Z = OutputFacts(force_axes=(2,))
FORCE_XYZ = OutputFacts(force_axes=(0, 1, 2))
FORCE_MAP = OutputFacts(needs_depth=True, needs_force=True, needs_patches=True)
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
    },
)
