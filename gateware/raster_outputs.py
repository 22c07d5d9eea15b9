"""Table of the outputs that leave the hardware as images on AXI4-Streams, by the names of `outputs`.

The stream of such an output is a member of `Datapath` with the output's name; docs/extending.md shows how to
add one.
"""

from collections.abc import Callable
from dataclasses import dataclass

from fastac.gateware.bus.record import record_form
from fastac.gateware.packet_format import PacketFormat
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.scenes.outputs import OUTPUTS
from fastac.scenes.schema import Scene
from fastac.store.kinds import Kinds

WORD = 32
"""Bits of one value in `tdata` of the output streams."""


def scalar_lanes(payload, lanes: int) -> list:
    """The words of a beat with one word per lane."""
    return list(payload)


def vector_lanes(payload, lanes: int) -> list:
    """The words of a beat with one vector per lane, in lane order."""
    return [word for lane in payload for word in lane]


def lanes_by_axis(payload, lanes: int) -> list:
    """The words of a beat stored as (axes, lanes), reordered so that all axes of a pixel are adjacent."""
    return [axis[lane] for lane in range(lanes) for axis in payload]


@dataclass(frozen=True)
class Raster:
    """Properties of an output's stream.

    order : position among the streams, which fixes their order in the Verilog
    words : function of the number of force axes: words per pixel
    width : function of the pipeline: bits of the widest word
    beat : function of a beat's payload in the datapath and the number of lanes: the words of the beat in
        `tdata`, lowest first
    inner : the stream has only the pixels of the inner region, for which the Poisson solver solves
    tagged : beside the start of frame, `tuser` has the row's number and the frame's flags "bad" and
        "suspect", and there is a `tkeep`; possible only if a frame's tag is known before its first beat
    timed : a register has the clocks from a frame's first input beat to its last beat of this stream
    axis_planes : the golden model's array is (axes, rows, columns) instead of (rows, columns) or (rows,
        columns, words)
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
"""By the names of scenes/outputs.py; forces are not images and are read from registers."""


@dataclass(frozen=True)
class RasterOutput:
    """Format of an output stream: `rows` × `columns` pixels of `words` values, `lanes` pixels per beat.

    tagged : see `Raster`; rows_reversed : the last row is sent first
    packet : layout of the packets, or None in the form of video
    complete : a packet's record has the frame's result
    """

    name: str
    rows: int
    columns: int
    words: int
    lanes: int
    tagged: bool = False
    rows_reversed: bool = False
    packet: PacketFormat | None = None
    complete: bool = True

    @property
    def beats(self) -> int:
        """Beats per row."""
        return -(-self.columns // self.lanes)

    @property
    def padding(self) -> int:
        """Words of zeros behind those of each pixel."""
        return self.packet.words_padded - self.words if self.packet else 0

    @property
    def octets(self) -> int:
        """Bytes per beat."""
        return WORD // 8 * (self.words + self.padding) * self.lanes

    @property
    def void_octets(self) -> int:
        """Unused bytes in a row's last beat."""
        return self.octets // self.lanes * (self.beats * self.lanes - self.columns)

    @property
    def row_order(self) -> list[int]:
        """The rows' numbers in the order in which they are sent."""
        return list(range(self.rows))[:: -1 if self.rows_reversed else 1]


def raster_outputs(pipeline: IntegerPipeline, *, rows_reversed: bool) -> tuple[RasterOutput, ...]:
    """The output streams of the pipeline's scene, in the order of the Verilog's ports.

    rows_reversed : the Poisson solver outputs the last row first
    Raises ValueError if a value has more bits than a word of the stream.
    """
    outputs = scene_outputs(pipeline.scene, rows_reversed=rows_reversed)
    for name, width in ((output.name, RASTERS[output.name].width(pipeline)) for output in outputs):
        if width > WORD:
            raise ValueError(f"{name} of {width} bits: expected at most {WORD}, a word of the stream")
    return outputs


def scene_outputs(scene: Scene, *, rows_reversed: bool) -> tuple[RasterOutput, ...]:
    """The same for a scene alone, whatever the words' widths."""
    found = []
    packets = scene.hardware.streams == "packets"
    images = {name: RASTERS[name] for name in scene.outputs if OUTPUTS[name].is_image}
    for name, raster in sorted(images.items(), key=lambda item: item[1].order):
        margin = 2 if raster.inner else 0
        shape = (
            *(scene.sensor.height_px - margin, scene.sensor.width_px - margin),
            *(raster.words(len(scene.force_axes)), scene.lanes),
        )
        found.append(
            RasterOutput(
                name,
                *shape,
                raster.tagged and not packets,
                raster.inner and rows_reversed,
                PacketFormat(name, *shape, record_form(scene.wants_interval).bytes) if packets else None,
                # Normals are sent long before any result, unless they are the result.
                raster.inner or (not scene.wants_solver and not scene.wants_force),
            )
        )
    return tuple(found)
