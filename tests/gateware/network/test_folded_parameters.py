# amaranth: UnusedElaboratable=no
from amaranth import Module, Signal, signed, unsigned
from amaranth.sim import Simulator

from fastac.gateware.network.folded_parameters import (
    Column,
    columns_reader,
    format_of,
    values_of,
    write_signature,
)

BUILT = [Column(signed(5), (-16, 15, 3)), Column(unsigned(6), (63, 1, 2, 4)), Column(signed(3), (-4,))]
LOADED = [Column(signed(5), (7, -9, 0)), Column(unsigned(6), (0, 62, 5, 33)), Column(signed(3), (3,))]
FOLD = 4


def test_table():
    assert format_of(BUILT, FOLD) == (12, 1, 7)
    assert values_of(BUILT, FOLD).ravel().tolist() == [-16, 15, 3, 3, 63, 1, 2, 4, -4, -4, -4, -4]


def test_what_is_written_is_read():
    m, row = Module(), Signal(range(FOLD))
    write = write_signature(BUILT, FOLD).create()
    read = columns_reader(m, BUILT, write)
    outputs = [Signal(column.shape, name=f"output_{k}") for k, column in enumerate(BUILT)]
    m.d.comb += [output.eq(read(k, row)) for k, output in enumerate(outputs)]

    def stored(ctx, columns):
        for k, column in enumerate(columns):
            for place, value in enumerate(column.values):
                ctx.set(row, place)
                assert ctx.get(outputs[k]) == value

    async def bench(ctx):
        stored(ctx, BUILT)
        for k, value in enumerate(values_of(LOADED, FOLD).ravel()):
            ctx.set(write.en, 1 << (k // FOLD))
            ctx.set(write.row, k % FOLD)
            ctx.set(write.data, int(value) & 0x7F)
            await ctx.tick()
        ctx.set(write.en, 0)
        ctx.set(write.data, 0x55)
        await ctx.tick()
        stored(ctx, LOADED)

    simulator = Simulator(m)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
