"""The innermost step of a sweep in 8-bit integers: codes of a query's points against one column of many items.

A lane holds four codes, and one instruction of VNNI adds the four products of two lanes to a sum of 32 bits.
Processors without it take multiplications of 16 bits (AVX2) or whatever LLVM has; the sums are the same.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from depthprint._kernels.split_points import LINEAR
from depthprint._kernels.tiles import LANES, spread_lanes

__all__ = ["CODE_ROWS", "LARGEST_HALF", "load_codes", "meet_codes", "start_rows"]

CODE_ROWS = 11
LARGEST_HALF = 1 << 28  # keeps sums in 32 bits

_BYTE, _SHORT, _INT = ir.IntType(8), ir.IntType(16), ir.IntType(32)
_LANES = ir.VectorType(_INT, LANES)
_BYTES = ir.VectorType(_BYTE, 4 * LANES)
_FLOATS = ir.VectorType(ir.FloatType(), LANES)
_HALF = ir.VectorType(_INT, LANES // 2)
_OFFSET = -0x7F7F7F80  # 128 in each of four bytes, as a signed number


@intrinsic
def load_codes(
    typingctx: Any, codes: Any, group: Any, j: Any, mask: Any, ratios: Any, q: Any, start: Any
) -> Any:
    """Column j of a group of codes (groups, columns, quads, LANES) into q (quads, LANES), and its part of sums.

    Codes are bytes less 128, four a lane; those over LINEAR are taken for 0. start (LANES,): less their squared
    norms times ratios (LANES,) float32, rounded towards 0 and no less than -LARGEST_HALF; only bytes count that
    ``mask`` (quads,) has set. All others int32, all contiguous; nothing is checked.
    """
    del typingctx
    return types.void(codes, group, j, mask, ratios, q, start), _emit_load


@intrinsic
def start_rows(typingctx: Any, squares: Any, offsets: Any, count: Any, ratios: Any, starts: Any) -> Any:
    """The same part of a query's points, less offsets (n,) int32, into starts[:count] (n, LANES) int32.

    squares (n,) and ratios (LANES,) are float32.
    """
    del typingctx
    return types.void(squares, offsets, count, ratios, starts), _emit_starts


@intrinsic
def meet_codes(
    typingctx: Any, p: Any, starts: Any, tile: Any, q: Any, q_start: Any, rows: Any, column: Any, j: Any
) -> Any:
    """Take p q + start + q_start of the points of a tile and column j of LANES items into the largest so far.

    p (tiles, quads, CODE_ROWS): four signed codes each. starts (tiles, CODE_ROWS, LANES), q (quads, LANES) as
    `load_codes` leaves it and q_start (LANES,) of the column. Raises rows (tiles, CODE_ROWS, LANES) and column
    (columns, LANES) where larger. All int32 and contiguous; nothing is checked.
    """
    del typingctx
    return types.void(p, starts, tile, q, q_start, rows, column, j), _emit_meeting


def _vector(builder: Any, pointer: Any) -> Any:
    return builder.bitcast(pointer, _LANES.as_pointer())


def _halves(builder: Any, vector: Any) -> list[Any]:
    index = ir.VectorType(_INT, vector.type.count // 2)
    half = index.count
    return [
        builder.shuffle_vector(vector, vector, ir.Constant(index, list(range(k * half, (k + 1) * half))))
        for k in range(2)
    ]


def _joined(builder: Any, low: Any, high: Any) -> Any:
    return builder.shuffle_vector(low, high, ir.Constant(_LANES, list(range(LANES))))


def _add_products(context: Any, builder: Any, total: Any, unsigned: Any, signed: Any) -> Any:
    """Add the sums of four products a lane, of unsigned bytes and signed ones, to ``total``."""
    features = context.codegen().magic_tuple()[2].split(",")  # of the processor that is compiled for
    if "+avx512vnni" in features:
        signature = ir.FunctionType(_LANES, [_LANES] * 3)
        function = cgutils.get_or_insert_function(builder.module, signature, "llvm.x86.avx512.vpdpbusd.512")
        return builder.call(function, [total, unsigned, signed])
    if "+avxvnni" in features:
        signature = ir.FunctionType(_HALF, [_HALF] * 3)
        function = cgutils.get_or_insert_function(builder.module, signature, "llvm.x86.avx512.vpdpbusd.256")
        parts = zip(*(_halves(builder, vector) for vector in (total, unsigned, signed)), strict=True)
        return _joined(builder, *(builder.call(function, list(part)) for part in parts))
    if "+avx2" in features:
        return _add_products_of_shorts(builder, total, unsigned, signed)
    for byte in range(4):
        up, down = _LANES([24 - 8 * byte] * LANES), _LANES([24] * LANES)
        x = builder.lshr(builder.shl(unsigned, up), down)
        y = builder.ashr(builder.shl(signed, up), down)
        total = builder.add(total, builder.mul(x, y))
    return total


def _add_products_of_shorts(builder: Any, total: Any, unsigned: Any, signed: Any) -> Any:
    """The same by AVX2: even bytes and odd ones as numbers of 16 bits, whose products it adds in pairs."""
    shorts, half = ir.VectorType(_SHORT, 2 * LANES), ir.VectorType(_SHORT, LANES)
    eight, low = shorts([8] * (2 * LANES)), shorts([255] * (2 * LANES))
    signature = ir.FunctionType(_HALF, [half, half])
    function = cgutils.get_or_insert_function(builder.module, signature, "llvm.x86.avx2.pmadd.wd")
    x, y = builder.bitcast(unsigned, shorts), builder.bitcast(signed, shorts)
    even = builder.and_(x, low), builder.ashr(builder.shl(y, eight), eight)
    odd = builder.lshr(x, eight), builder.ashr(y, eight)
    for left, right in (even, odd):
        pairs = zip(_halves(builder, left), _halves(builder, right), strict=True)
        total = builder.add(total, _joined(builder, *(builder.call(function, list(pair)) for pair in pairs)))
    return total


def _less_halves(builder: Any, squares: Any, ratios: Any) -> Any:
    """Less float32 squares times ratios, as integers."""
    most = _FLOATS([float(LARGEST_HALF)] * LANES)
    product = builder.fmul(squares, ratios)
    product = builder.select(builder.fcmp_ordered("<", product, most), product, most)
    return builder.sub(_LANES([0] * LANES), builder.fptosi(product, _LANES))


def _emit_starts(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    squares, offsets, ratios, starts = (
        context.make_array(signature.args[k])(context, builder, arguments[k]).data for k in (0, 1, 3, 4)
    )
    factors = builder.load(builder.bitcast(ratios, _FLOATS.as_pointer()), align=4)
    with cgutils.for_range(builder, arguments[2]) as loop:
        square = spread_lanes(builder, builder.load(builder.gep(squares, [loop.index])))
        halves = _less_halves(builder, square, factors)
        offset = spread_lanes(builder, builder.load(builder.gep(offsets, [loop.index])))
        place = builder.gep(starts, [builder.mul(loop.index, loop.index.type(LANES))])
        builder.store(builder.sub(halves, offset), _vector(builder, place), align=4)
    return context.get_dummy_value()


def _emit_load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    codes, mask, ratios, q, start = (
        context.make_array(signature.args[k])(context, builder, arguments[k]) for k in (0, 3, 4, 5, 6)
    )
    _, group, j, *_ = arguments
    size = group.type
    _, columns, quads, _ = cgutils.unpack_tuple(builder, codes.shape)
    first = builder.mul(builder.add(builder.mul(group, columns), j), quads)
    zero = ir.Constant(_BYTES, [0] * _BYTES.count)
    before = builder.block
    loop, after = builder.append_basic_block("load"), builder.append_basic_block("loaded")
    builder.branch(loop)
    builder.position_at_end(loop)
    k, total = builder.phi(size), builder.phi(_LANES)
    source = builder.gep(codes.data, [builder.mul(builder.add(first, k), size(LANES))])
    values = builder.load(_vector(builder, source), align=4)
    offset = _LANES([_OFFSET] * LANES)
    signed = builder.bitcast(builder.xor(values, offset), _BYTES)
    sizes = builder.select(builder.icmp_signed("<", signed, zero), builder.sub(zero, signed), signed)
    linear = builder.icmp_unsigned("<=", sizes, _BYTES([LINEAR] * _BYTES.count))
    signed, sizes = (builder.select(linear, bytes_, zero) for bytes_ in (signed, sizes))
    values = builder.xor(builder.bitcast(signed, _LANES), offset)
    builder.store(values, _vector(builder, builder.gep(q.data, [builder.mul(k, size(LANES))])), align=4)
    counted = spread_lanes(builder, builder.load(builder.gep(mask.data, [k])))
    sizes = builder.and_(builder.bitcast(sizes, _LANES), counted)
    new = _add_products(context, builder, total, sizes, sizes)
    following = builder.add(k, size(1))
    end = builder.block
    builder.cbranch(builder.icmp_signed("<", following, quads), loop, after)
    k.add_incoming(size(0), before)
    k.add_incoming(following, end)
    total.add_incoming(_LANES([0] * LANES), before)
    total.add_incoming(new, end)
    builder.position_at_end(after)
    factors = builder.load(builder.bitcast(ratios.data, _FLOATS.as_pointer()), align=4)
    halves = _less_halves(builder, builder.sitofp(new, _FLOATS), factors)
    builder.store(halves, _vector(builder, start.data), align=4)
    return context.get_dummy_value()


def _emit_meeting(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    p, starts, q, q_start, rows, column = (
        context.make_array(signature.args[k])(context, builder, arguments[k]) for k in (0, 1, 3, 4, 5, 6)
    )
    tile, j = arguments[2], arguments[7]
    size = tile.type
    quads, _ = cgutils.unpack_tuple(builder, q.shape)

    def at(pointer: Any, offset: Any) -> Any:
        return builder.gep(pointer, [offset])

    def times(x: Any, constant: int) -> Any:
        return builder.mul(x, ir.Constant(size, constant))

    def larger(x: Any, y: Any) -> Any:
        return builder.select(builder.icmp_signed(">", x, y), x, y)

    mine = at(p.data, builder.mul(times(tile, CODE_ROWS), quads))
    start = at(starts.data, times(tile, CODE_ROWS * LANES))
    best = at(rows.data, times(tile, CODE_ROWS * LANES))
    largest_at = _vector(builder, at(column.data, times(j, LANES)))
    from_column = builder.load(_vector(builder, q_start.data), align=4)
    begin = [
        builder.add(from_column, builder.load(_vector(builder, at(start, size(i * LANES))), align=4))
        for i in range(CODE_ROWS)
    ]
    before = builder.block
    loop, after = builder.append_basic_block("quads"), builder.append_basic_block("maxima")
    builder.branch(loop)
    builder.position_at_end(loop)
    k = builder.phi(size)
    sums = [builder.phi(_LANES) for _ in range(CODE_ROWS)]
    other = builder.load(_vector(builder, at(q.data, times(k, LANES))), align=4)
    here = at(mine, times(k, CODE_ROWS))
    new = [
        _add_products(
            context, builder, sums[i], other, spread_lanes(builder, builder.load(at(here, size(i))))
        )
        for i in range(CODE_ROWS)
    ]  # fmt: skip
    following = builder.add(k, size(1))
    builder.cbranch(builder.icmp_signed("<", following, quads), loop, after)
    k.add_incoming(size(0), before)
    k.add_incoming(following, loop)
    for i in range(CODE_ROWS):
        sums[i].add_incoming(begin[i], before)
        sums[i].add_incoming(new[i], loop)

    builder.position_at_end(after)
    largest = builder.load(largest_at, align=4)
    for i in range(CODE_ROWS):
        row = _vector(builder, at(best, size(i * LANES)))
        builder.store(larger(new[i], builder.load(row, align=4)), row, align=4)
        largest = larger(new[i], largest)
    builder.store(largest, largest_at, align=4)
    return context.get_dummy_value()
