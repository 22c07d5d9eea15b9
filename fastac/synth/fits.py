"""Whether a scene's hardware fits its part, before anything is trained."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from threadpoolctl import threadpool_limits

from fastac.gateware.cycle_model import multipliers
from fastac.gateware.target.device import Device, DeviceError, device_of
from fastac.models.integer import assemble
from fastac.models.integer.network import Layer
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.models.random_tables import force_weights, layers, network_bits
from fastac.models.vision.expected_dots import bridge_reach, expected_follower
from fastac.scenes.schema import Scene
from fastac.sensor.geometry import rest_depth_mm
from fastac.synth.estimates import memories, resources

SEED = 1


def random_pipeline(scene: Scene) -> IntegerPipeline:
    """The scene's pipeline with random weights, to estimate its area.

    The area follows from word widths and sizes and, where the network is baked in, from the additions of
    its graphs.
    """
    sensor = scene.sensor
    shape = (sensor.height_px, sensor.width_px, len(sensor.channel_names))
    bits = tuple(network_bits(scene.numbers).items())
    background, network, state = _random_network(shape, scene.network.hidden, bits)
    rng = np.random.default_rng()
    rng.bit_generator.state = state
    bridge = follower = None
    if scene.wants_darkness:
        follower = expected_follower(sensor)
        bridge = SlopeBridge(follower.windows, bridge_reach(sensor))
    pipeline = assemble.assemble(
        scene,
        bridge=bridge if scene.wants_bridge else None,
        follower=follower if scene.wants_dots else None,
        layers=network,
        background=background,
        rest_depth_mm=rest_depth_mm(sensor),
    )
    if not scene.wants_force:
        return pipeline
    return assemble.with_force(pipeline, *force_weights(scene, rng, follower))


@lru_cache(maxsize=8)
def _random_network(
    shape: tuple[int, int, int], hidden: tuple[int, ...], bits: tuple[tuple[str, int], ...]
) -> tuple[np.ndarray, tuple[Layer, ...], dict]:
    """A background, a network for it, and the state of the generator that made them; kept for the next scene
    of such a sensor."""
    rng = np.random.default_rng(SEED)
    background = rng.integers(80, 170, shape).astype(np.uint8)
    return background, layers(dict(bits), background, rng, hidden), rng.bit_generator.state


def check_products(scene: Scene) -> None:
    """Raise DeviceError where the scene alone says that its part lacks DSP slices, or block RAMs for the
    force's kernels; takes no time.

    How long the solver's words are, only their worst cases tell: here each fits one slice.
    """
    device = device_of(scene)
    bits = min(scene.numbers.data_bits, device.dsp.wide_port - 1)
    numbers = scene.numbers.model_copy(update={"data_bits": bits})
    device.check_multipliers(multipliers(scene.model_copy(update={"numbers": numbers})), scene)
    device.check_block_rams(memories.block_rams(memories.kernel_memory(scene)))


@dataclass(frozen=True)
class Area:
    """What the hardware of a scene's pipeline takes of its part, by stage.

    multipliers, block_rams : DSP slices and RAMB36 by the architecture's formulas
    luts : look-up tables by an estimate
    """

    scene: Scene
    multipliers: dict[str, int]
    block_rams: dict[str, float]
    luts: dict[str, float]

    @property
    def device(self) -> Device:
        return device_of(self.scene)

    def check(self) -> None:
        """Raise DeviceError where the device lacks DSP slices or block RAMs, or clearly lacks look-up
        tables."""
        self.device.check_multipliers(self.multipliers, self.scene)
        self.device.check_block_rams(self.block_rams)
        self.device.check_luts(self.luts)

    @property
    def fits(self) -> bool:
        """Whether `check` finds nothing."""
        try:
            self.check()
        except DeviceError:
            return False
        return True

    @property
    def percent(self) -> dict[str, float]:
        """Shares of the device's DSP slices, block RAMs and look-up tables."""
        device = self.device
        return {
            device.dsp.name: 100 * sum(self.multipliers.values()) / device.dsps,
            "RAMB36": 100 * sum(self.block_rams.values()) / device.ramb36,
            "LUT": 100 * sum(self.luts.values()) / device.lut,
        }

    @property
    def shares(self) -> str:
        """`percent` in words."""
        return ", ".join(f"{block} {percent:.0f}%" for block, percent in self.percent.items())


def area(pipeline: IntegerPipeline) -> Area:
    """What the pipeline's hardware takes of its scene's part."""
    return Area(
        pipeline.scene,
        resources.dsp_slices(pipeline),
        memories.block_rams(memories.memories(pipeline)),
        resources.luts(pipeline),
    )


def check_scene(scene: Scene) -> None:
    """Raise DeviceError where hardware with random weights does not fit the scene's part.

    Takes a second for 128×128 pixels, and a few more for baked weights. Words that training decides, such as
    those of the force's weights, may be a bit shorter or longer.
    """
    with threadpool_limits(1):  # more are slower: all products are small
        area(random_pipeline(scene)).check()
