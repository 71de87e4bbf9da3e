"""LZF, the byte compression inside binary_compressed PCD files."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["lzf_compress", "lzf_decompress"]

Bytes = npt.NDArray[np.uint8]


@numba.njit(cache=True)
def lzf_decompress(data: Bytes, size: int) -> tuple[Bytes, bool]:
    """The ``size`` bytes that ``data`` stands for, and whether it stands for exactly that many.

    A control byte below 32 precedes that many literal bytes and one more; any other holds a length (three
    bits, 7 meaning that a byte is added) and, with the last byte, the distance back to what is repeated.
    """
    out = np.zeros(size, dtype=np.uint8)
    n = len(data)
    i, o = 0, 0
    while i < n:
        control = int(data[i])
        i += 1
        if control < 32:
            count = control + 1
            if i + count > n or o + count > size:
                return out, False
            out[o : o + count] = data[i : i + count]
            i += count
            o += count
            continue
        length = control >> 5
        if length == 7:
            if i >= n:
                return out, False
            length += int(data[i])
            i += 1
        if i >= n:
            return out, False
        start = o - ((control & 31) << 8) - int(data[i]) - 1
        i += 1
        length += 2
        if start < 0 or o + length > size:
            return out, False
        for k in range(length):
            out[o + k] = out[start + k]
        o += length
    return out, o == size


@numba.njit(cache=True)
def _put_literals(data: Bytes, first: int, last: int, out: Bytes, o: int) -> int:
    while first < last:
        count = min(32, last - first)
        out[o] = count - 1
        out[o + 1 : o + 1 + count] = data[first : first + count]
        o += 1 + count
        first += count
    return o


@numba.njit(cache=True)
def lzf_compress(data: Bytes) -> Bytes:
    """Bytes that ``lzf_decompress`` turns back into ``data``; repeats are found by a table of last places."""
    n = len(data)
    out = np.empty(n + n // 32 + 2, dtype=np.uint8)
    places = np.full(1 << 14, -1, dtype=np.int64)
    i, o, literal = 0, 0, 0
    while i + 2 < n:
        key = (int(data[i]) << 16) | (int(data[i + 1]) << 8) | int(data[i + 2])
        slot = (key * 2654435761 >> 12) & 16383
        place = places[slot]
        places[slot] = i
        distance = i - place - 1
        if (
            place < 0
            or distance >= 8192
            or data[place] != data[i]
            or data[place + 1] != data[i + 1]
            or data[place + 2] != data[i + 2]
        ):
            i += 1
            continue
        length = 3
        while length < 264 and i + length < n and data[place + length] == data[i + length]:
            length += 1
        o = _put_literals(data, literal, i, out, o)
        code = length - 2
        if code < 7:
            out[o] = (code << 5) | (distance >> 8)
            o += 1
        else:
            out[o] = (7 << 5) | (distance >> 8)
            out[o + 1] = code - 7
            o += 2
        out[o] = distance & 255
        o += 1
        i += length
        literal = i
    o = _put_literals(data, literal, n, out, o)
    return out[:o].copy()
