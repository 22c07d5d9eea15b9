"""The Python interface: a trained sensor from a folder or a file, and what it measures in frames.

    import fastac

    sensor = fastac.load("build/paper")          # what `fastac build scenes/paper.toml` wrote
    print(sensor.outputs)                         # {'depth_mm': 'mm', 'force_n': 'N'}
    found = sensor.run(frame)                     # a frame (H, W, C) uint8, channels B, G, R, NIR
    found.depth_mm                                # (H, W) float32
    dict(zip(found.force_axes, found.force_n))    # {'z': 1.02}
    found.reasons                                 # () or why the frame is suspect, as ('change',)

`import fastac` hands these names on (`fastac/__init__.py`). Nothing here trains.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from fastac.flow import frames as processed_frames
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import Bundle, BundleError, load_bundle
from fastac.models.integer.force_interval import INTERVAL
from fastac.models.integer.frame_validity import REASONS
from fastac.models.result import Result
from fastac.models.vision.image_processing import as_channels
from fastac.scenes.outputs import measured
from fastac.scenes.schema import AXES, Scene
from fastac.sensor.fingertip import STORE
from fastac.sensor.optics.mosaic import CELL
from fastac.sensor.samples import Dataset

if TYPE_CHECKING:
    from fastac.models.floating.pipeline import FloatPipeline

__all__ = ["BundleError", "Measurement", "TactileSensor", "load"]

Arithmetic = Literal["integer", "float"]
FLAGS = (
    "force_half_width_n",
    "gradient_saturated",
    "displacement_saturated",
    "validity",
    "slip_dots",
    "slipping",
)
"""What the integers say of a frame beside its outputs."""


@dataclass(frozen=True, eq=False)
class Measurement(Result):
    """What a sensor measured in one frame, or in several; what was not asked for is None.

    The fields are those of `Result`. Arrays of several frames begin with an axis of frames, as written there;
    those of one frame have no such axis. Of most use:

    normals : (H, W, 3) outward unit vectors
    depth_mm : (H, W) height z of the skin in mm; pressing lowers it
    force_n : (axes,) force in N along `force_axes`; z is positive in compression
    force_half_width_n : (axes,) with force.coverage: the interval around the force is force_n ± this
    force_map_n : (axes, H - 2, W - 2) each inner pixel's share of the force in N
    slip_px : root mean square spread in px of the dots in contact about the rigid motion that fits them
    slip_dots, slipping : how many these dots are; whether their spread is beyond the scene's limit
    gradient_saturated, displacement_saturated : how many values of the frame left their word's range
    validity : bits of `FrameValidity`, as the hardware's register FRAME_VALIDITY has them; 0: not suspect
    """

    force_axes: tuple[str, ...] = ()
    """What the columns of `force_n` and `force_map_n` are: some of x, y, z."""

    @property
    def reasons(self) -> tuple[str, ...] | list[tuple[str, ...]]:
        """Why a frame is suspect, some of `frame_validity.REASONS`; a list of these for several frames.

        Raises ValueError where validity is unknown: the float models do not judge frames.
        """
        if self.validity is None:
            raise ValueError("reasons: validity is unknown; run with arithmetic='integer'")
        found = [
            tuple(reason for bit, reason in enumerate(REASONS) if int(flags) >> bit & 1)
            for flags in np.atleast_1d(self.validity)
        ]
        return found if np.ndim(self.validity) else found[0]


def load(path: Path | str) -> "TactileSensor":
    """The trained sensor in a build folder, in the folder of its bundle, or in a single file `NAME.fastac`.

    Raises BundleError, one line that names the file at fault, where there is none or it is damaged.

    >>> sensor = fastac.load("build/paper")
    """
    bundle = load_bundle(Path(path))
    return TactileSensor(bundle, bundle.pipeline.background)


@dataclass(frozen=True, eq=False)
class TactileSensor:
    """A sensor's trained models, ready to run. Keep it: its tables are made once, at the first frame."""

    bundle: Bundle
    background: np.ndarray
    """What the untouched sensor sees, (H, W, C) uint8: every frame is seen against it."""

    @property
    def scene(self) -> Scene:
        """What was built, and from which settings."""
        return self.bundle.scene

    @property
    def digest(self) -> str:
        """SHA-256 of the bundle, in hexadecimal; the register BUNDLE_HASH has its first 64 bits."""
        return self.bundle.digest

    @cached_property
    def outputs(self) -> dict[str, str]:
        """The scene's outputs, as fields of `Measurement`, and their units ("1": none)."""
        return measured(self.scene.outputs)

    @cached_property
    def force_axes(self) -> tuple[str, ...]:
        """The axes of force that the scene wants, in the order of `Measurement.force_n`."""
        return tuple(AXES[axis] for axis in self.scene.force_axes)

    def with_background(self, image: np.ndarray) -> "TactileSensor":
        """The same models against another background: that of a recording, or one taken anew after a drift.

        image : (H, W, C) uint8 or, where the scene's frames are RAW10, (4H, 4W) uint16
        Raises ValueError for any other shape or type.
        """
        return replace(self, background=self._channels(image, one=True)[0])

    def run(
        self,
        frames: np.ndarray,
        *,
        arithmetic: Arithmetic = "integer",
        outputs: Iterable[str] | None = None,
        progress: bool = False,
    ) -> Measurement:
        """What the models find in a frame, or in several on all cores.

        frames : (H, W, C) or (frames, H, W, C) uint8, channels B, G, R and, of four, NIR; where the scene's
            frames are RAW10 also (4H, 4W) or (frames, 4H, 4W) uint16, which are processed first
        arithmetic : "integer", bit for bit what the hardware computes; or "float", the models before
            quantisation
        outputs : fields of `Measurement` that are wanted, None for the scene's own and the frames' flags
        progress : whether to show a progress bar on standard error

        Raises ValueError, in one line, for frames of another shape or type and for an output that the scene
        or the arithmetic does not have.

        >>> found = sensor.run(frames, outputs=["force_n"])
        >>> found.force_n.shape
        (200, 1)
        """
        one = np.ndim(frames) == (2 if self._is_raw(frames) else 3)
        pipeline = self._pipeline(arithmetic)
        images = processed_frames.in_scene(self._channels(frames, one=one), self.background, self.scene)
        known = pipeline.outputs
        if outputs is None:
            outputs = self._usual.get(arithmetic)
        if outputs is None:
            outputs = self._usual[arithmetic] = (*self.outputs, *(flag for flag in FLAGS if flag in known))
        for name in (outputs := tuple(outputs)):
            if name not in known:
                raise ValueError(f"outputs: {name!r}: expected some of {', '.join(known)}")
        found = vars(pipeline.run(images, wanted=outputs, progress=progress))
        if one:
            found = {name: None if array is None else array[0] for name, array in found.items()}
        return Measurement(**found, force_axes=self.force_axes)

    def stream(
        self,
        frames: Iterable[np.ndarray],
        *,
        arithmetic: Arithmetic = "integer",
        outputs: Iterable[str] | None = None,
    ) -> Iterator[Measurement]:
        """What the models find in each frame as it comes: a camera's, or any other iterable's.

        Each frame is as `run` takes one, and is answered before the next one is asked for. The first answer
        takes seconds, for loops are compiled then; `run` one frame before to have that behind.

        >>> for found in sensor.stream(camera):
        ...     print(found.force_n, found.reasons)
        """
        outputs = None if outputs is None else tuple(outputs)
        for frame in frames:
            if np.ndim(frame) != (2 if self._is_raw(frame) else 3):
                raise ValueError(f"frame {np.shape(frame)}: expected {self._expected()}")
            yield self.run(frame, arithmetic=arithmetic, outputs=outputs)

    def read(self, path: Path | str, *, store: Path | str = STORE, progress: bool = False) -> Dataset:
        """The dataset in a file of this sensor, RAW10 images processed to channels.

        store : the folder of the step store, which keeps processed RAW10 images; nothing else is kept
        Raises DatasetError where the file is malformed or of another sensor. `docs/recordings.md` says how to
        make one.

        >>> data = sensor.read("build/paper/data.h5")
        >>> found = sensor.with_background(data.background).run(data.frames[data.indices("test")])
        """
        return processed_frames.read(path, self.scene, store=store, progress=progress)

    def errors(self, data: Dataset, index: np.ndarray, *, progress: bool = False) -> dict[str, dict]:
        """Errors of float and integer models on the samples `index` of a dataset with ground truth.

        Frames are seen against the dataset's own background. Returns {"float": {…}, "integer": {…},
        "growth_percent": {…}, "saturated_values": {…}}, whose keys carry units (`depth_mae_mm`), and of
        intervals around the force {"force_interval": {…}}, see `models/interval_accuracy.py`.
        """
        from fastac.models import accuracy, interval_accuracy

        found = accuracy.compare_pipelines(self.bundle, data, index, progress=progress)[0]
        pipeline = self.bundle.pipeline
        if pipeline.interval is not None and data.has_force(self.scene.force_axes):
            found[INTERVAL] = interval_accuracy.evaluate(pipeline, data, index, progress=progress)
        return found

    @cached_property
    def _usual(self) -> dict[str, tuple[str, ...]]:
        """By arithmetic, what `run` finds where nothing is asked for; filled by it."""
        return {}

    @cached_property
    def _takes_raw(self) -> bool:
        return self.scene.sensor.frames == "raw10"

    @cached_property
    def _emulator(self) -> Emulator:
        return Emulator(self.bundle.pipeline.replace(background=self.background))

    @cached_property
    def _floats(self) -> "FloatPipeline":
        from fastac.models.floating.pipeline import FloatPipeline

        return replace(FloatPipeline.from_bundle(self.bundle), background=self.background)

    def _pipeline(self, arithmetic: str) -> "Emulator | FloatPipeline":
        if arithmetic not in ("integer", "float"):
            raise ValueError(f"arithmetic = {arithmetic!r}: expected 'integer' or 'float'")
        return self._emulator if arithmetic == "integer" else self._floats

    def _is_raw(self, images: np.ndarray) -> bool:
        return self._takes_raw and np.asarray(images).dtype == np.uint16

    def _expected(self) -> str:
        height, width, channels = self.bundle.pipeline.background.shape
        raw = f" or ({CELL * height}, {CELL * width}) uint16" if self._takes_raw else ""
        return f"({height}, {width}, {channels}) uint8{raw}"

    def _channels(self, images: np.ndarray, *, one: bool) -> np.ndarray:
        """One image, or several, as (frames, H, W, C) uint8. Raises ValueError where they do not fit."""
        given = np.asarray(images)
        batch = given[None] if one else given
        shape = self.bundle.pipeline.background.shape
        if self._is_raw(given):
            if batch.ndim == 3 and batch.shape[1:] == (CELL * shape[0], CELL * shape[1]):
                return np.stack([as_channels(image, self.scene.sensor) for image in batch])
        elif given.dtype == np.uint8 and batch.ndim == 4 and batch.shape[1:] == shape:
            return batch
        each = "" if one else " each"
        raise ValueError(f"frames {given.shape} {given.dtype}: expected {self._expected()}{each}")
