"""Powers of two that bring floating-point numbers to the range of 64-bit integers."""

from __future__ import annotations

import math

from numba import njit

__all__ = ["bit_length", "power_of_two"]


@njit(cache=True, nogil=True)
def bit_length(value: int) -> int:
    """Number of bits of a non-negative integer."""
    bits = 0
    while value > 0:
        value >>= 1
        bits += 1
    return bits


@njit(cache=True, nogil=True)
def power_of_two(largest: float, bits: int) -> tuple[float, float]:
    """Two factors whose product is the power of two that brings ``largest`` just under 2**bits."""
    exponent = bits - math.frexp(largest)[1]
    half = exponent // 2
    return math.ldexp(1.0, half), math.ldexp(1.0, exponent - half)
