"""Outputs that leave the hardware as images: the table of their AXI4-Streams, by the names of `outputs`.

The stream of an output is a member of `Datapath` with the output's name; docs/extending.md tells how to add
one.
"""

from collections.abc import Callable
from dataclasses import dataclass

from fastac.models.integer.pipeline import IntegerPipeline
from fastac.scenes.outputs import OUTPUTS
from fastac.store.kinds import Kinds

WORD = 32
"""Bits of one value on the output streams."""


def scalar_lanes(payload, lanes: int) -> list:
    """The words of a beat whose lanes are words."""
    return list(payload)


def vector_lanes(payload, lanes: int) -> list:
    """The words of a beat whose lanes are vectors, vector after vector."""
    return [word for lane in payload for word in lane]


def lanes_by_axis(payload, lanes: int) -> list:
    """The words of a beat that has all lanes of one axis after those of another, pixel after pixel."""
    return [axis[lane] for lane in range(lanes) for axis in payload]


@dataclass(frozen=True)
class Raster:
    """What an output's stream is like.

    order : the stream's place among all, which fixes the order in the Verilog
    words : words per pixel for a number of force axes; width : bits of the longest one
    beat : from the payload of a beat of the datapath's stream and the number of lanes to the beat's words
    inner : whether there are only the pixels of the inner region, which the Poisson solver solves, or all
    tagged : whether `tuser` has, beside the start of frame, the row's number and the frame's flags "bad" and
        "suspect", and whether there is a `tkeep`; only where a frame's tag is known before its first beat
    timed : whether registers tell the clocks from a frame's first beat to its last of this stream
    axis_planes : whether the reference has a frame's words axis by axis, (axes, rows, columns), instead of
        (rows, columns) or (rows, columns, words)
    """

    order: int
    words: Callable[[int], int]
    width: Callable[[IntegerPipeline], int]
    beat: Callable[[object, int], list]
    inner: bool = True
    tagged: bool = True
    timed: bool = False
    axis_planes: bool = False


NORMALS = Raster(
    order=0,
    words=lambda axes: 3,
    width=lambda pipeline: pipeline.layers[-1].accumulator_width,
    beat=vector_lanes,
    inner=False,
    tagged=False,
    timed=True,
)
DEPTH = Raster(
    order=1,
    words=lambda axes: 1,
    width=lambda pipeline: pipeline.depth.width,
    beat=scalar_lanes,
    timed=True,
)
FORCE_MAP = Raster(
    order=2,
    words=lambda axes: axes,
    width=lambda pipeline: pipeline.force.pixel_width,
    beat=lanes_by_axis,
    axis_planes=True,
)
RASTERS = Kinds("outputs", {"normals": NORMALS, "depth": DEPTH, "force_map": FORCE_MAP})
"""By the names of scenes/outputs.py; a force is no image, but in the registers."""


@dataclass(frozen=True)
class RasterOutput:
    """Format of an output stream: `rows` × `columns` pixels of `words` values, `lanes` pixels per beat.

    tagged : see `Raster`; rows_reversed : the last row is sent first
    """

    name: str
    rows: int
    columns: int
    words: int
    lanes: int
    tagged: bool = False
    rows_reversed: bool = False

    @property
    def beats(self) -> int:
        """Beats per row."""
        return -(-self.columns // self.lanes)

    @property
    def octets(self) -> int:
        """Bytes per beat."""
        return WORD // 8 * self.words * self.lanes

    @property
    def void_octets(self) -> int:
        """Unused bytes in a row's last beat."""
        return WORD // 8 * self.words * (self.beats * self.lanes - self.columns)

    @property
    def row_order(self) -> list[int]:
        """The rows' numbers in the order in which they are sent."""
        return list(range(self.rows))[:: -1 if self.rows_reversed else 1]


def raster_outputs(pipeline: IntegerPipeline, *, rows_reversed: bool) -> tuple[RasterOutput, ...]:
    """The streams of images that the pipeline's scene has.

    rows_reversed : whether the Poisson solver's rows come last to first
    Raises ValueError where a value is longer than a word of the stream.
    """
    scene, found = pipeline.scene, []
    images = {name: RASTERS[name] for name in scene.outputs if not OUTPUTS[name].force_axes}
    for name, raster in sorted(images.items(), key=lambda item: item[1].order):
        if raster.width(pipeline) > WORD:
            raise ValueError(
                f"{name} of {raster.width(pipeline)} bits: expected at most {WORD}, a word of the stream"
            )
        margin = 2 if raster.inner else 0
        found.append(
            RasterOutput(
                name,
                scene.sensor.height_px - margin,
                scene.sensor.width_px - margin,
                raster.words(len(scene.force_axes)),
                scene.hardware.pixels_per_clock,
                raster.tagged,
                raster.inner and rows_reversed,
            )
        )
    return tuple(found)
