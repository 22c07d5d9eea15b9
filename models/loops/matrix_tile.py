"""A tile of a matrix product in vector registers, as an intrinsic for compiled (numba) loops.

The tile has ROWS rows of COLUMN_BYTES, two of the processor's vectors, so that the sums stay in its
registers. Each sum is one of fused multiply-adds in the order of the depth: products of integers are exact
while their sums are.
"""

import llvmlite.binding as llvm
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from fastac.models.loops.vector_tile import broadcast, call

ROWS = 4
VECTOR_BYTES = 64 if llvm.get_host_cpu_features().get("avx512f") else 32
COLUMN_BYTES = 2 * VECTOR_BYTES


def tile_columns(itemsize: int) -> int:
    """Columns of a tile of numbers of `itemsize` bytes."""
    return COLUMN_BYTES // itemsize


@intrinsic
def product_tile(typing_context, real, a, a_row, a_step, b, b_step, depth, c, c_row):
    """Compute and write ROWS rows of a product: c[r, j] = Σ over k of a[r, k] · b[k, j].

    real : a number whose type is that of all others; its value is not used
    a, b, c : addresses
    a_row, c_row : numbers from one row to the next; a_step, b_step : from one k to the next
    depth : how many k there are
    """

    def generate(context, builder, signature, values):
        _, a, a_row, a_step, b, b_step, depth, c, c_row = values
        kind, size = {types.float32: (ir.FloatType(), 4), types.float64: (ir.DoubleType(), 8)}[real]
        lanes, vectors = VECTOR_BYTES // size, COLUMN_BYTES // VECTOR_BYTES
        vector = ir.VectorType(kind, lanes)

        def bytes_of(count):
            return builder.mul(count, ir.Constant(count.type, size))

        def after(address, count):
            return builder.add(address, ir.Constant(address.type, count) if isinstance(count, int) else count)

        def pointer(address, of):
            return builder.inttoptr(address, of.as_pointer())

        zero = ir.Constant(vector, None)
        sums = [[cgutils.alloca_once_value(builder, zero) for _ in range(vectors)] for _ in range(ROWS)]
        rows = [bytes_of(builder.mul(a_row, ir.Constant(a_row.type, r))) for r in range(ROWS)]
        with cgutils.for_range(builder, depth) as loop:
            left = after(a, bytes_of(builder.mul(loop.index, a_step)))
            right = after(b, bytes_of(builder.mul(loop.index, b_step)))
            given = [
                builder.load(pointer(after(right, k * VECTOR_BYTES), vector), align=size)
                for k in range(vectors)
            ]
            for r in range(ROWS):
                one = broadcast(builder, builder.load(pointer(after(left, rows[r]), kind), align=size), lanes)
                for k in range(vectors):
                    total = call(builder, "fma", one, given[k], builder.load(sums[r][k]))
                    builder.store(total, sums[r][k])
        for r in range(ROWS):
            place = after(c, bytes_of(builder.mul(c_row, ir.Constant(c_row.type, r))))
            for k in range(vectors):
                total = builder.load(sums[r][k])
                builder.store(total, pointer(after(place, k * VECTOR_BYTES), vector), align=size)
        return context.get_dummy_value()

    return types.void(real, *(types.intp,) * 8), generate
