"""A tile of a fully connected layer in vector registers, as an intrinsic for compiled (numba) loops.

A tile has NEURONS × PIXELS sums. A loop over arrays would write each partial sum to memory and read it back;
here they are LLVM vector variables, which stay in registers until the activations are computed. LLVM splits
them into the processor's vector width. The arithmetic is IEEE 754 with fused multiply-adds, in the written
order.
"""

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

NEURONS, LANES, VECTORS = 4, 16, 2
PIXELS = LANES * VECTORS


def broadcast(builder, value, lanes: int = LANES):
    """A vector with `value` in each lane."""
    kind = ir.VectorType(value.type, lanes)
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), lanes), [0] * lanes)
    return builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), mask)


def call(builder, name: str, *values):
    """LLVM's intrinsic `name` of vectors, lane by lane."""
    kind = values[0].type
    size = {ir.FloatType(): "f32", ir.DoubleType(): "f64"}[kind.element]
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(kind, [kind] * len(values)), f"llvm.{name}.v{kind.count}{size}"
    )
    return builder.call(function, values)


def _linear(builder, total, scale, top):
    return total


def _rectified(builder, total, scale, top):
    zero = broadcast(builder, ir.Constant(total.type.element, 0.0))
    return builder.select(builder.fcmp_ordered(">", total, zero), total, zero)


def _requantised(builder, total, scale, top):
    """`integer.network.Requantisation` of integers that the type holds exactly; `scale` is multiplier ·
    2**−shift.

    The rounded product can reach the next integer, but not pass it. So its floor is right or one too large:
    too large where the remainder a · scale − q, computed by a fused multiply-add with the exact sign, is
    negative.
    """
    one = broadcast(builder, ir.Constant(total.type.element, 1.0))
    zero = broadcast(builder, ir.Constant(total.type.element, 0.0))
    a = _rectified(builder, total, scale, top)
    q = call(builder, "floor", builder.fmul(a, scale))
    q = builder.select(builder.fcmp_ordered("<", q, top), q, top)
    remainder = call(builder, "fma", a, scale, builder.fneg(q))
    return builder.fsub(q, builder.select(builder.fcmp_ordered("<", remainder, zero), one, zero))


def _tile(activation):
    @intrinsic
    def tile(typing_context, real, source, table, inputs, x, stride, y, top):
        """Compute and write NEURONS rows of PIXELS activations.

        real, source : numbers whose types are those of the arithmetic and of the inputs; values are not used
        table : address of a `packed` tile, rows of NEURONS numbers: biases, scales, weights of each input
        x, y : addresses of inputs and activations, rows `stride` numbers apart with PIXELS numbers each
        top : the largest activation, of the type of `real`
        """

        def generate(context, builder, signature, values):
            _, _, table, inputs, x, stride, y, top = values
            kinds = {types.float32: (ir.FloatType(), 4), types.float64: (ir.DoubleType(), 8)}
            (kind, size), (given, given_size) = kinds[real], kinds[source]
            index = table.type

            def number(value):
                return ir.Constant(index, value)

            def load(address, kind, count, align):
                kind = kind if count == 1 else ir.VectorType(kind, count)
                return builder.load(builder.inttoptr(address, kind.as_pointer()), align=align)

            def entry(row, j):
                place = builder.add(builder.mul(row, number(NEURONS)), number(j))
                return broadcast(builder, load(_at(table, place, size), kind, 1, size))

            def _at(base, place, size):
                return builder.add(base, builder.mul(place, number(size)))

            sums = []
            for j in range(NEURONS):
                bias = entry(number(0), j)
                sums.append([cgutils.alloca_once_value(builder, bias) for _ in range(VECTORS)])
            with cgutils.for_range(builder, inputs) as loop:
                place = builder.mul(loop.index, stride)
                vectors = []
                for k in range(VECTORS):
                    start = builder.add(place, number(k * LANES))
                    vector = load(_at(x, start, given_size), given, LANES, given_size)
                    if given != kind:
                        vector = builder.fpext(vector, ir.VectorType(kind, LANES))
                    vectors.append(vector)
                row = builder.add(loop.index, number(2))
                for j in range(NEURONS):
                    weight = entry(row, j)
                    for k in range(VECTORS):
                        total = builder.load(sums[j][k])
                        builder.store(call(builder, "fma", weight, vectors[k], total), sums[j][k])
            for j in range(NEURONS):
                scale = entry(number(1), j)
                for k in range(VECTORS):
                    found = activation(builder, builder.load(sums[j][k]), scale, broadcast(builder, top))
                    start = builder.add(builder.mul(number(j), stride), number(k * LANES))
                    place = builder.inttoptr(_at(y, start, size), found.type.as_pointer())
                    builder.store(found, place, align=size)
            return context.get_dummy_value()

        return types.void(real, source, *(types.intp,) * 5, real), generate

    return tile


tile_linear = _tile(_linear)
tile_rectified = _tile(_rectified)
tile_requantised = _tile(_requantised)
