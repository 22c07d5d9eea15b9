# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth.sim import Simulator
from rounding import at_the_edges

from fastac.gateware.network.requantise import Requantise, RequantiseCore
from fastac.gateware.target.elaboration import to_rtlil
from fastac.models.integer.network import Requantisation
from fastac.sim.check_stream import check, pack

WIDTH = 20
TABLES = [
    ([1, 2, 3, 4], 0),
    ([77_771, 1, 9, 131_071], 24),
    ([131_071, 87_381, 65_536, 98_304], 13),
    ([131_071] * 4, 47),
]


def at_the_steps(scale: Requantisation, count: int) -> np.ndarray:
    """Accumulators (count, neurons) next to which an activation changes by one."""
    a, top = np.arange(1 << (WIDTH - 1)), (1 << scale.bits) - 1
    columns = []
    for multiplier in map(int, scale.multiplier):
        inside = a[(a * multiplier >> scale.shift) <= top]
        columns.append(
            np.resize(at_the_edges(inside, multiplier, scale.shift, 0, min(count, len(inside))), count)
        )
    return np.stack(columns, axis=1)


def at_the_bits(scale: Requantisation) -> np.ndarray:
    """Accumulators with one bit, or whose product just reaches one: it alone may be why they are clipped."""
    largest, bits = (1 << (WIDTH - 1)) - 1, 1 << np.arange(WIDTH + 16)
    products = [-(-bits // multiplier) for multiplier in map(int, scale.multiplier)]
    return np.minimum(np.vstack([np.stack(products, axis=1), np.tile(bits[:, None], len(products))]), largest)


def accumulators(scale: Requantisation):
    limit = 1 << (WIDTH - 1)
    a = np.random.default_rng(1).integers(-limit, limit, (100, 4))
    # Of all magnitudes, so that every shift leaves non-zero results.
    a >>= np.arange(100)[:, None] % WIDTH
    a[0], a[1], a[2], a[3], a[4] = limit - 1, -limit, 0, -1, 1
    return np.vstack([a, at_the_steps(scale, 60), at_the_bits(scale)])


def compare(dut, scale, folder):
    a = accumulators(scale)
    check(
        dut,
        "requantise",
        folder,
        room=7,
        inputs=pack(a, WIDTH),
        expected=pack(scale(a), scale.bits),
        latencies=[(k, k, 6) for k in range(len(a))],
    )


@pytest.mark.parametrize(("multipliers", "shift"), TABLES)
@pytest.mark.quick("multipliers1-24")
def test_baked_multipliers(tmp_path, multipliers, shift):
    scale = Requantisation(np.array(multipliers), shift)
    dut = Requantise(scale, width=WIDTH)
    assert (dut.latency, dut.core.multipliers, dut.core.parameter_bits) == (6, 0, 0)
    assert "cell $mul " not in to_rtlil(dut.core)
    compare(dut, scale, tmp_path)


def test_loadable_multipliers(tmp_path, with_parameters):
    built = Requantisation(np.array([1, 1, 1, 1]), 5, 10)
    dut = Requantise(built, width=WIDTH, loadable=True)
    assert (dut.latency, dut.core.multipliers, dut.core.parameter_bits) == (6, 4, 4 * 17 + 6)
    assert to_rtlil(dut.core).count("cell $mul ") == 4
    multipliers, shift = TABLES[2]
    scale = Requantisation(np.array(multipliers), shift, 10)
    compare(with_parameters(dut, dut.core.parameter_image(scale)), scale, tmp_path)


def test_every_shift():
    """All shift amounts, loaded one after another into the same hardware."""
    built = Requantisation(np.array([1, 1, 1, 1]), 0, 10)
    core = RequantiseCore(built, width=WIDTH, loadable=True)
    a = [(1 << (WIDTH - 1)) - 1, 1000, 1 << (WIDTH - 2), -5]
    wrong = []

    async def bench(ctx):
        for k, value in enumerate(a):
            ctx.set(core.i[k], value)
        for shift in range(48):
            scale = Requantisation(np.array([131_071, 70_003, 65_536, 131_071]), shift, 10)
            ctx.set(core.parameters, core.parameter_image(scale))
            await ctx.tick().repeat(core.latency)
            found = [ctx.get(core.o[k]) for k in range(4)]
            if found != scale(np.array(a)).tolist():
                wrong.append((shift, found))

    simulator = Simulator(core)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    assert wrong == []


def test_largest_accumulators_of_baked_hardware():
    """Neurons that are never active, that stay below what is clipped, and one that reaches far beyond it."""
    scale, largest = Requantisation(np.array([5, 77_771, 3, 131_071]), 9), (0, 40, 13_000, 500_000)
    core = RequantiseCore(scale, width=WIDTH, largest=largest)
    wrong = []

    async def bench(ctx):
        for part in (0.0, 1.0, 0.5, 0.01, -1.0):
            a = [int(part * most) if part >= 0 else -(1 << (WIDTH - 1)) for most in largest]
            for k, value in enumerate(a):
                ctx.set(core.i[k], value)
            await ctx.tick().repeat(core.latency)
            found = [ctx.get(core.o[k]) for k in range(4)]
            if found != scale(np.array(a)).tolist():
                wrong.append((a, found))

    simulator = Simulator(core)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    assert wrong == []


def test_invalid_arguments():
    scale = Requantisation(np.array([1, 2]), 3)
    core = Requantise(scale, width=WIDTH, loadable=True).core

    def refused(message, other, core=core):
        with pytest.raises(ValueError, match=message):
            core.parameter_image(other)

    refused("loadable False: expected True", scale, Requantise(scale, width=WIDTH).core)
    refused("multiplier of 3 neurons: expected 2", Requantisation(np.array([1, 2, 3]), 3))
    refused("bits 8: expected 7", Requantisation(np.array([1, 2]), 3, 8))
