"""The scene's table `sensor`: shape, skin, light and camera of one fingertip."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from fastac.scenes.strict import Positive, Share, Strict

CHANNELS = {"bgr": ("B", "G", "R"), "bgr+nir": ("B", "G", "R", "NIR")}


class Ellipsoid(Strict):
    """The skin at rest: the cap of an ellipsoid over the image, zero at the lowest corner of the image."""

    semi_axes_mm: tuple[Positive, Positive, Positive] = (12.0, 14.0, 9.0)


class Elastomer(Strict):
    """A soft layer bonded to a rigid skeleton and fixed at the rim of the image."""

    modulus_mpa: Positive = 0.4
    poisson_ratio: Annotated[float, Field(gt=0, lt=0.5)] = 0.48
    thickness_mm: Positive = 3.0
    thickness_variation: Annotated[float, Field(ge=0, lt=1)] = 0.3
    rim_mm: Positive = 1.5
    mechanics: Literal["layer", "fem"] = "layer"
    """layer: elastic and without friction, the skin moves along z only. fem: finite elements, all three axes,
    with friction."""
    friction: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Coulomb's coefficient between skin and indenter; with finite elements only."""
    elements: Annotated[int, Field(ge=4, le=96)] = 40
    """Finite elements along the image's longer side; the compliance takes memory as their fourth power."""
    layers: Annotated[int, Field(ge=1, le=16)] = 4
    """Finite elements through the thickness."""

    @model_validator(mode="after")
    def _friction_needs_elements(self):
        if self.friction and self.mechanics == "layer":
            raise ValueError(f"friction: {self.friction:g} needs mechanics 'fem'; a layer has none")
        return self


class Light(Strict):
    """Four sources behind the skeleton, at the corners, R opposite G and B opposite NIR, seen along z."""

    distance_mm: Positive = 14.0
    """From the image's axis to each source."""
    below_mm: Positive = 8.0
    """From the lowest corner of the skin down to the sources."""
    softening_mm: Annotated[float, Field(ge=0)] = 8.0
    """Size of the glow that the scattering skeleton makes of each source."""
    ambient: Annotated[float, Field(ge=0, lt=1)] = 0.15
    """Share of the light that arrives from everywhere."""
    specular: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Share of a source's light that the paint reflects like a rough mirror."""
    shininess: Annotated[float, Field(ge=1, le=200)] = 20.0
    """Exponent of that mirror's lobe."""
    cast_shadows: bool = False
    """Whether the skin's parts hide the sources from each other."""
    brightest_dn: Annotated[float, Field(gt=0, le=255)] = 150.0
    """Brightest pixel of the background, in each channel, in 8-bit digital numbers."""


class Markers(Strict):
    """Black dots on the skin, on a square grid, which move with it."""

    spacing_mm: Positive = 1.6
    radius_mm: Positive = 0.3
    contrast: Annotated[float, Field(gt=0, le=1)] = 0.9
    """Share of the light that a dot swallows."""

    @model_validator(mode="after")
    def _apart(self):
        if self.spacing_mm <= 2 * self.radius_mm:
            raise ValueError(
                f"spacing_mm: {self.spacing_mm:g} leaves no skin between dots of {self.radius_mm:g}"
            )
        return self


class Raw10(Strict):
    """The camera of RAW10 frames, an RGB-IR filter array seen at 4 × 4 raw pixels a pixel, and what makes
    B, G, R, NIR of its frames (models/vision/image_processing.py). In 10-bit digital numbers."""

    exposure: Annotated[float, Field(gt=0, le=1)] = 0.75
    """Share of an 8-bit frame's exposure: a visible pixel also has room for its crosstalk."""
    crosstalk: tuple[Share, Share, Share] = (0.8, 0.8, 0.8)
    """NIR response of B, G and R pixels over that of NIR pixels."""
    black_level_dn: Annotated[int, Field(ge=0, le=1022)] = 64
    electrons_per_dn: Positive = 8.0
    read_noise_dn: Annotated[float, Field(ge=0, le=1023)] = 1.0
    vignetting: Annotated[float, Field(ge=0, lt=0.99)] = 0.2
    dead_share: Annotated[float, Field(ge=0, le=0.1)] = 1e-4
    method: Literal["demosaic", "binning"] = "demosaic"
    """demosaic: the paper's list of steps. binning: the mean of each colour in a cell."""
    alpha: Annotated[float, Field(ge=0, le=4)] = 0.8
    beta: Annotated[float, Field(ge=1, le=1023)] = 1.0
    dead_pixel_dn: Positive = 128.0


class Sensor(Strict):
    geometry: Literal["fingertip", "flat"]
    height_px: Annotated[int, Field(ge=16, le=256)] = 128
    width_px: Annotated[int, Field(ge=16, le=256)] = 128
    pitch_mm: Positive = 0.125
    channels: Literal["bgr", "bgr+nir"] = "bgr+nir"
    frames: Literal["channels", "raw10"] = "channels"
    """What a dataset holds: channels, and nothing processes them, or the camera's RAW10 images."""
    source: Literal["simulated", "recorded"] = "simulated"
    level_light: bool = False
    """Whether each channel of a frame is shifted until half of the pixels lie above their background and half
    below: takes the drift of lamps, exposure and white balance out, as long as most of the skin is free."""
    frames_per_second: Positive | None = None
    """Of the camera; with hardware.pixels_per_clock = "camera" it decides how many clocks a pixel may take.
    Not given: the hardware's pace alone is known."""
    line_blanking_px: Annotated[int, Field(ge=0, le=1 << 16)] = 0
    """Pause of the camera's readout after each line, in pixels' times."""
    frame_blanking_lines: Annotated[int, Field(ge=0, le=1 << 16)] = 0
    """Pause of the camera's readout after each frame, in lines' times."""
    ellipsoid: Ellipsoid = Ellipsoid()
    elastomer: Elastomer = Elastomer()
    light: Light = Light()
    markers: Markers | None = None
    """Without a table of this name the skin has no dots, and nothing tracks any."""
    noise_dn: Annotated[float, Field(ge=0)] = 1.0
    """Standard deviation of the camera's read noise in 8-bit digital numbers."""
    electrons_per_dn: Positive = 8.0
    """Photon noise: a value of n digital numbers stands for n times as many electrons, and varies by their
    root. 8 is a pixel of 8,000 electrons' full well at an analogue gain of 4, as short exposures need."""
    grain: Annotated[float, Field(ge=0, lt=0.3)] = 0.04
    """Standard deviation of the painted skin's albedo from pixel to pixel; the pattern is fixed."""
    raw10: Raw10 = Raw10()

    @model_validator(mode="after")
    def _raw10_is_used(self):
        if self.frames == "channels" and self.raw10 != Raw10():
            raise ValueError("raw10: settings of RAW10 frames need frames = 'raw10'")
        return self

    @model_validator(mode="after")
    def _dots_see_no_levelled_light(self):
        if self.level_light and self.markers is not None:
            raise ValueError(
                "level_light: needs a sensor without markers: dots are found in frames as they come"
            )
        return self

    @model_validator(mode="after")
    def _blanking_has_a_rate(self):
        for key in ("line_blanking_px", "frame_blanking_lines"):
            if getattr(self, key) and self.frames_per_second is None:
                raise ValueError(f"{key}: {getattr(self, key)} needs frames_per_second")
        return self

    @property
    def channel_names(self) -> tuple[str, ...]:
        return CHANNELS[self.channels]
