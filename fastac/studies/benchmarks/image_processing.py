"""The two ways from RAW10 to four channels, measured: error against noise-free channels, and time.

    python -m fastac.studies.benchmarks.image_processing [--presses N] [--grain SHARE]

Presses of the virtual fingertip are rendered at the window's 512 × 512 pixels, photographed by the virtual
RAW camera, and brought to 128 × 128 by the paper's path and by direct binning. All frames are simulated.
"""

import time

import click
import numpy as np
from tqdm import tqdm

from fastac.models.vision.image_processing import ImageProcessing, downsample
from fastac.scenes.schema import Sensor
from fastac.sensor.mechanics.layer import Layer
from fastac.sensor.mechanics.layer_rig import surface
from fastac.sensor.optics.camera import exposure
from fastac.sensor.optics.mosaic import CELL, CHANNELS
from fastac.sensor.optics.raw10 import MAXIMUM, pack, unpack
from fastac.sensor.optics.raw_camera import RawCamera

EXPOSURE = 0.75
"""Share of an 8-bit frame's exposure: a visible pixel also has room for its crosstalk."""
BALL_MM, REACH_MM, LOADS_N = 5.0, 4.0, (0.5, 1.5)
PATHS = {"paper": ImageProcessing.demosaic, "binning": ImageProcessing.bin_cells}
CAMERAS = {
    "no noise, no crosstalk": RawCamera((0, 0, 0), electrons_per_dn=1e6, read_noise_dn=0, dead_share=0),
    "no noise": RawCamera(electrons_per_dn=1e6, read_noise_dn=0, dead_share=0),
    "photon and read noise": RawCamera(dead_share=0),
    "and dead pixels": RawCamera(),
    "and unequal crosstalk": RawCamera((0.75, 0.8, 0.9)),
}
"""α is the green pixels' crosstalk in each: one number cannot serve three."""
REPEATS = 20


def window_light(presses: int, grain: float, progress: bool) -> list[np.ndarray]:
    """Scene-linear B, G, R, NIR (512, 512, 4) of presses at random places."""
    frame = Sensor(geometry="fingertip", grain=grain)
    # A copy is not validated: the schema bounds what is processed, and a window is four times as fine.
    sensor = frame.model_copy(
        update={
            "height_px": CELL * frame.height_px,
            "width_px": CELL * frame.width_px,
            "pitch_mm": frame.pitch_mm / CELL,
        }
    )
    layer, rng, light = Layer(sensor), np.random.default_rng(1), []
    for i in tqdm(range(presses), desc="presses", disable=not progress, leave=False):
        x, y = rng.uniform(-REACH_MM, REACH_MM, 2)
        contact = layer.press(x, y, ball_mm=BALL_MM, load_n=LOADS_N[i % len(LOADS_N)])
        shape = surface(contact, layer, x, y, BALL_MM)
        light.append(np.maximum(exposure(*shape, sensor), 0) / 255 * EXPOSURE)
    return light


def noise_free(light: np.ndarray, camera: RawCamera) -> np.ndarray:
    """What a frame would hold without filter array, noise and rounding: (H / 4, W / 4, 4) of 8-bit values."""
    seen = light * camera.shading(*light.shape[:2])[..., None] * (MAXIMUM - camera.black_level_dn)
    return downsample(seen.astype(np.float32), CELL) * (255 / MAXIMUM)


def errors(light: list[np.ndarray], camera: RawCamera, path) -> np.ndarray:
    """Mean absolute and root mean square error of each channel, (2, 4), in 8-bit digital numbers."""
    processing = ImageProcessing(black_level_dn=camera.black_level_dn, alpha=camera.crosstalk[1])
    difference = np.stack(
        [
            path(processing, camera.expose(image, np.random.default_rng(i))) - noise_free(image, camera)
            for i, image in enumerate(light)
        ]
    )
    return np.stack([np.abs(difference).mean((0, 1, 2)), np.sqrt((difference**2).mean((0, 1, 2)))])


def fastest_ms(run) -> float:
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


@click.command()
@click.option(
    "--presses", default=6, type=click.IntRange(1), show_default=True, help="how many are simulated"
)
@click.option(
    "--grain",
    default=Sensor(geometry="fingertip").grain,
    type=click.FloatRange(0, 0.3, max_open=True),
    show_default=True,
    help="standard deviation of the paint's albedo between RAW pixels, which no mosaic samples fully",
)
@click.option("--progress/--no-progress", default=True, help="progress bar on stderr")
def main(presses: int, grain: float, progress: bool) -> None:
    """Measure the paper's image processing and direct binning on simulated RAW10 windows of 512 x 512 px."""
    light = window_light(presses, grain, progress)
    print(
        f"error in 8-bit digital numbers, mean absolute (root mean square), {presses} simulated presses,"
        f" grain {grain:g}:"
    )
    print(f"  {'camera':24s} {'path':8s}" + "".join(f"{name:>16s}" for name in CHANNELS))
    for name, camera in CAMERAS.items():
        for key, path in PATHS.items():
            mean, rms = errors(light, camera, path)
            cells = "".join(f"{a:8.3f} ({b:.3f})" for a, b in zip(mean, rms, strict=True))
            print(f"  {name:24s} {key:8s}{cells}")
    raw = RawCamera().expose(light[0], np.random.default_rng(0))
    data, processing = pack(raw).tobytes(), ImageProcessing()
    print(f"time, the fastest of {REPEATS} runs, frames of {raw.shape[1]} x {raw.shape[0]} px:")
    print(f"  {'unpacking':24s} {fastest_ms(lambda: unpack(data, *raw.shape)):8.2f} ms per frame")
    for key, path in PATHS.items():
        print(f"  {key:24s} {fastest_ms(lambda path=path: path(processing, raw)):8.2f} ms per frame")


if __name__ == "__main__":
    main()
