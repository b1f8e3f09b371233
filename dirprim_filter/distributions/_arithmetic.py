"""Arithmetic that rounds alike however it is compiled: fused products, and sums in lanes.

Where the compiler may fuse or reorder by itself (`fastmath`) it does so by what stands around a loop: a kernel inlined
into its caller then differs in the last digits from the same kernel called, and so does the run that compiles from
those that load what it compiled. Here products are fused, and sums split, as it is written: the same bits in each.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic

from dirprim_filter.arrays import FloatArray
from tessellation._compiling import uncounted

LANES = 8
"""Partial sums, so that no addition waits for the one before it; twice as many where there are few columns."""


_compiled: Any = intrinsic


def _fma(_typing: Any, a: Any, b: Any, c: Any) -> Any:
    def generate(_context: Any, builder: ir.IRBuilder, _signature: Any, of: Any) -> Any:
        return builder.fma(*of)

    return a(a, b, c), generate


fma: Callable[[float, float, float], float] = _compiled(_fma)
"""a b + c, rounded once: IEEE 754's fusedMultiplyAdd."""


def _polynomial(_typing: Any, x: Any, coefficients: Any) -> Any:
    def generate(_context: Any, builder: ir.IRBuilder, _signature: Any, of: Any) -> Any:
        first, *others = cgutils.unpack_tuple(builder, of[1])
        for coefficient in others:
            first = builder.fma(first, of[0], coefficient)
        return first

    return x(x, coefficients), generate


polynomial: Callable[[float, tuple[float, ...]], float] = _compiled(_polynomial)
"""Horner's scheme, fused: of x and a tuple of coefficients, that of the highest power first."""


def _weighted_sums(_typing: Any, weight: Any, columns: Any) -> Any:
    for column in (weight, *columns):
        if (column.layout, column.ndim, column.dtype) != ("C", 1, types.float64):
            raise TypingError(f"expected contiguous columns of float64, got {column}")
    result = types.UniTuple(types.float64, 1 + len(columns))
    n_lanes = 2 * LANES if len(columns) < 2 else LANES
    lanes = ir.VectorType(ir.DoubleType(), n_lanes)

    def generate(context: Any, builder: ir.IRBuilder, _signature: Any, of: Any) -> Any:
        parts = [of[0], *(cgutils.unpack_tuple(builder, of[1]) if len(columns) else ())]
        arrays = [context.make_array(t)(context, builder, v) for t, v in zip((weight, *columns), parts, strict=True)]
        n = cgutils.unpack_tuple(builder, arrays[0].shape)[0]
        whole = builder.and_(n, n.type(-n_lanes))

        def add_up(kind: Any, zero: Any, first: Any, end: Any, step: int) -> list[Any]:
            """The sums of rows, of which each instruction takes `step`."""
            sums = [cgutils.alloca_once_value(builder, zero) for _ in arrays]
            with cgutils.for_range_slice(builder, first, end, n.type(step)) as (i, _):
                at = [builder.bitcast(builder.gep(array.data, [i]), kind.as_pointer()) for array in arrays]
                w, *others = (builder.load(pointer, align=8) for pointer in at)
                terms = [w, *(builder.fmul(w, other) for other in others)]
                for total, term in zip(sums, terms, strict=True):
                    builder.store(builder.fadd(builder.load(total), term), total)
            return [builder.load(total) for total in sums]

        in_lanes = add_up(lanes, ir.Constant(lanes, [0.0] * n_lanes), n.type(0), whole, n_lanes)
        rest = add_up(ir.DoubleType(), ir.DoubleType()(0.0), whole, n, 1)
        totals = [builder.fadd(_in_pairs(builder, a, n_lanes), b) for a, b in zip(in_lanes, rest, strict=True)]
        return context.make_tuple(builder, result, totals)

    return result(weight, columns), generate


weighted_sums: Callable[[FloatArray, tuple[FloatArray, ...]], tuple[float, ...]] = _compiled(_weighted_sums)
"""The sum of weights (n,), and those of their products with each of a tuple of columns (n,).

Each in lanes, which are added in pairs, and then the rows that are left over.
"""


def _in_pairs(builder: ir.IRBuilder, lanes: Any, n: int) -> Any:
    """The sum of the lanes of a vector."""
    left = [builder.extract_element(lanes, ir.IntType(32)(k)) for k in range(n)]
    while len(left) > 1:
        half = len(left) // 2
        left = [builder.fadd(a, b) for a, b in zip(left[:half], left[half:], strict=True)]
    return left[0]


@uncounted
def total_of(column: FloatArray) -> float:
    """The sum of a column, (n,)."""
    return weighted_sums(column, ())[0]


@uncounted
def dot(a: FloatArray, b: FloatArray) -> float:
    """The sum of the products of two columns, (n,) each."""
    return weighted_sums(a, (b,))[1]
