"""The innermost step of a sweep of squared distances: some points of a query against one column of many items.

LLVM does not keep a tile of sums in registers by itself, so the step is written in its vector types, which
every processor has: the code generator splits them as wide as it can.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["LANES", "TILE_ROWS", "load_column", "meet_column", "spread_lanes", "weigh_least"]

LANES = 16
TILE_ROWS = 7

_FLOAT = ir.FloatType()
_LANES = ir.VectorType(_FLOAT, LANES)
_INT32 = ir.IntType(32)


@intrinsic
def load_column(typingctx: Any, points: Any, group: Any, j: Any, q: Any, q_halves: Any) -> Any:
    """Column j of a group of points (groups, columns, d, LANES) into q and q_halves, as `meet_column` takes them.

    Reads as many coordinates as q has. All float32 and contiguous; nothing is checked.
    """
    del typingctx
    return types.void(points, group, j, q, q_halves), _emit_load


@intrinsic
def meet_column(
    typingctx: Any,
    p: Any,
    p_halves: Any,
    tile: Any,
    q: Any,
    q_halves: Any,
    dims: Any,
    rows: Any,
    column: Any,
    j: Any,
) -> Any:
    """Take -|p - q|^2 / 2 of the points of a tile and column j of LANES items into the largest of each so far.

    p (tiles, dims, TILE_ROWS) and p_halves (tiles, TILE_ROWS): points and their -|p|^2 / 2. q (dims, LANES) and
    q_halves (LANES,) the same of the column. Raises rows (tiles, TILE_ROWS, LANES) and column (columns, LANES)
    where larger. All float32 and contiguous; nothing is checked.
    """
    del typingctx
    return types.void(p, p_halves, tile, q, q_halves, dims, rows, column, j), _emit_meeting


@intrinsic
def weigh_least(
    typingctx: Any,
    halves: Any,
    count: Any,
    weights: Any,
    total: Any,
    squared: Any,
    slack: Any,
    shrink: Any,
    cap: Any,
) -> Any:
    """Turn halves[:count] (n, LANES), the largest -d^2 / 2, into lower bounds of min(d, cap), and weigh them.

    A bound is max(sqrt(max(d^2 - squared, 0)) shrink - slack, 0), all float32; slack and shrink may be numbers or
    (LANES,). Halves may be int32, and their memory holds the float32 bounds afterwards. Writes the weighted sums
    to total (LANES,) float64; weights are (n,), or (n, LANES) in either precision.
    """
    del typingctx
    return types.void(halves, count, weights, total, squared, slack, shrink, cap), _emit_weighing


def _fused(builder: Any) -> Any:
    signature = ir.FunctionType(_LANES, [_LANES] * 3)
    return cgutils.get_or_insert_function(builder.module, signature, f"llvm.fmuladd.v{LANES}f32")


def _vector(builder: Any, pointer: Any) -> Any:
    return builder.bitcast(pointer, _LANES.as_pointer())


def spread_lanes(builder: Any, value: Any) -> Any:
    """A vector of LANES times one number, of its type."""
    vector = ir.VectorType(value.type, LANES)
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, _INT32(0))
    return builder.shuffle_vector(first, first, ir.Constant(ir.VectorType(_INT32, LANES), [0] * LANES))


def _emit_load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    points, q, q_halves = (
        context.make_array(signature.args[k])(context, builder, arguments[k]) for k in (0, 3, 4)
    )
    _, group, j, _, _ = arguments
    size = group.type
    _, columns, coordinates, _ = cgutils.unpack_tuple(builder, points.shape)
    dims, _ = cgutils.unpack_tuple(builder, q.shape)
    first = builder.mul(builder.add(builder.mul(group, columns), j), coordinates)
    before = builder.block
    loop = builder.append_basic_block("load")
    after = builder.append_basic_block("loaded")
    builder.branch(loop)
    builder.position_at_end(loop)
    k, total = builder.phi(size), builder.phi(_LANES)
    source = builder.gep(points.data, [builder.mul(builder.add(first, k), size(LANES))])
    values = builder.load(_vector(builder, source), align=4)
    target = _vector(builder, builder.gep(q.data, [builder.mul(k, size(LANES))]))
    builder.store(values, target, align=4)
    following, squares = builder.add(k, size(1)), builder.call(_fused(builder), [values, values, total])
    builder.cbranch(builder.icmp_signed("<", following, dims), loop, after)
    k.add_incoming(size(0), before)
    k.add_incoming(following, loop)
    total.add_incoming(_LANES([0.0] * LANES), before)
    total.add_incoming(squares, loop)
    builder.position_at_end(after)
    halves = builder.fmul(squares, _LANES([-0.5] * LANES))
    builder.store(halves, _vector(builder, q_halves.data), align=4)
    return context.get_dummy_value()


def _emit_meeting(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    arrays = {0, 1, 3, 4, 6, 7}
    p, p_halves, tile, q, q_halves, dims, rows, column, j = (
        context.make_array(signature.args[k])(context, builder, value).data if k in arrays else value
        for k, value in enumerate(arguments)
    )
    size = dims.type

    def at(pointer: Any, offset: Any) -> Any:
        return builder.gep(pointer, [offset])

    def times(x: Any, constant: int) -> Any:
        return builder.mul(x, ir.Constant(size, constant))

    def vector(pointer: Any) -> Any:
        return _vector(builder, pointer)

    def spread(pointer: Any) -> Any:
        return spread_lanes(builder, builder.load(pointer))

    def larger(x: Any, y: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", x, y), x, y)

    fused = _fused(builder)
    p = at(p, builder.mul(times(tile, TILE_ROWS), dims))
    p_halves = at(p_halves, times(tile, TILE_ROWS))
    rows = at(rows, times(tile, TILE_ROWS * LANES))
    column = vector(at(column, times(j, LANES)))
    half = builder.load(vector(q_halves), align=4)
    start = [builder.fadd(half, spread(at(p_halves, size(i)))) for i in range(TILE_ROWS)]

    before = builder.block
    loop = builder.append_basic_block("coordinates")
    after = builder.append_basic_block("maxima")
    builder.branch(loop)
    builder.position_at_end(loop)
    k = builder.phi(size)
    sums = [builder.phi(_LANES) for _ in range(TILE_ROWS)]
    other = builder.load(vector(at(q, times(k, LANES))), align=4)
    mine = at(p, times(k, TILE_ROWS))
    new = [builder.call(fused, [spread(at(mine, size(i))), other, sums[i]]) for i in range(TILE_ROWS)]
    following = builder.add(k, size(1))
    builder.cbranch(builder.icmp_signed("<", following, dims), loop, after)
    k.add_incoming(size(0), before)
    k.add_incoming(following, loop)
    for i in range(TILE_ROWS):
        sums[i].add_incoming(start[i], before)
        sums[i].add_incoming(new[i], loop)

    builder.position_at_end(after)
    largest = builder.load(column, align=4)
    for i in range(TILE_ROWS):
        row = vector(at(rows, size(i * LANES)))
        builder.store(larger(new[i], builder.load(row, align=4)), row, align=4)
        largest = larger(new[i], largest)
    builder.store(largest, column, align=4)
    return context.get_dummy_value()


def _emit_weighing(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    halves, weights, total = (
        context.make_array(signature.args[k])(context, builder, arguments[k]).data for k in (0, 2, 3)
    )
    count = arguments[1]
    size, doubles = count.type, ir.VectorType(ir.DoubleType(), LANES)
    integers = signature.args[0].dtype == types.int32

    def extreme(sign: str, x: Any, y: Any) -> Any:
        return builder.select(builder.fcmp_ordered(sign, x, y), x, y)

    def lanes(k: int) -> Any:
        if not isinstance(signature.args[k], types.Array):
            return spread_lanes(builder, arguments[k])
        array = context.make_array(signature.args[k])(context, builder, arguments[k])
        return builder.load(_vector(builder, array.data), align=4)

    squared, slack, shrink, cap = (lanes(k) for k in range(4, 8))
    zero = _LANES([0.0] * LANES)
    root = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(_LANES, [_LANES]), f"llvm.sqrt.v{LANES}f32"
    )
    before = builder.block
    loop, work, after = (builder.append_basic_block(name) for name in ("rows", "row", "weighed"))
    builder.branch(loop)
    builder.position_at_end(loop)
    k, so_far = builder.phi(size), builder.phi(doubles)
    builder.cbranch(builder.icmp_signed("<", k, count), work, after)
    builder.position_at_end(work)
    at = builder.mul(k, size(LANES))
    place: Any = builder.gep(halves, [at])
    place = (
        builder.bitcast(place, ir.VectorType(_INT32, LANES).as_pointer())
        if integers
        else _vector(builder, place)
    )
    half = builder.load(place, align=4)
    if integers:
        half = builder.sitofp(half, _LANES)
    square = builder.fsub(builder.fmul(half, _LANES([-2.0] * LANES)), squared)
    least = builder.fmul(builder.call(root, [extreme(">", square, zero)]), shrink)
    least = extreme("<", extreme(">", builder.fsub(least, slack), zero), cap)
    builder.store(least, builder.bitcast(place, _LANES.as_pointer()), align=4)
    if signature.args[2].ndim == 1:
        weight = spread_lanes(builder, builder.load(builder.gep(weights, [k])))
    else:
        stored = doubles if signature.args[2].dtype == types.float64 else _LANES
        pointer = builder.bitcast(builder.gep(weights, [at]), stored.as_pointer())
        weight = builder.load(pointer, align=4)
        weight = weight if stored is doubles else builder.fpext(weight, doubles)
    new = builder.fadd(so_far, builder.fmul(builder.fpext(least, doubles), weight))
    following = builder.add(k, size(1))
    builder.branch(loop)
    for phi, start, value in ((k, size(0), following), (so_far, doubles([0.0] * LANES), new)):
        phi.add_incoming(start, before)
        phi.add_incoming(value, work)
    builder.position_at_end(after)
    builder.store(so_far, builder.bitcast(total, doubles.as_pointer()), align=8)
    return context.get_dummy_value()
