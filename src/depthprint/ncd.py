"""Normalised information distances as pure formulas (paper eq. 8), from complexities to a number."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import numpy.typing as npt

from depthprint.complexity import compressed_length
from depthprint.errors import DataError, SettingsError

__all__ = ["FORMS", "compression_distance", "information", "joint", "ncd", "steinhaus"]

FloatArray = npt.NDArray[np.float64]
_ROUNDING = 1e-9


def ncd(c_x: npt.ArrayLike, c_y: npt.ArrayLike, c_xy: npt.ArrayLike) -> FloatArray:
    """Eq. 8: (C(XY) - min(C(X), C(Y))) / max(C(X), C(Y)), elementwise; 0 for two empty ones.

    Not clipped: a compressor that codes XX in more than X gives more than 0 on itself, and may exceed 1.
    Raises DataError for values that are negative or not finite.
    """
    x, y, xy = _complexities(c_x=c_x, c_y=c_y, c_xy=c_xy)
    return _ratio(xy - np.minimum(x, y), np.maximum(x, y))


def joint(emd: npt.ArrayLike, k_x: npt.ArrayLike, k_y: npt.ArrayLike) -> FloatArray:
    """Eq. 8 with K(XY) = (K(X) + K(Y) + K(X|Y)) / 2: (E + |Kx - Ky|) / (2 max(Kx, Ky)), in [0, 1].

    ``emd`` and complexities broadcast. Raises DataError where E exceeds Kx + Ky, which no EMD with a null
    element does.
    """
    e, x, y = _emd_and_complexities(emd, k_x, k_y)
    return np.minimum(_ratio(e + np.abs(x - y), 2.0 * np.maximum(x, y)), 1.0)


def information(emd: npt.ArrayLike, k_x: npt.ArrayLike, k_y: npt.ArrayLike) -> FloatArray:
    """Normalised information distance E / max(Kx, Ky), broadcast; raises as `joint`.

    In [0, 1] where no ground cost exceeds the null cost (``cap <= null_cost``); otherwise unlike signatures
    of equal mass may reach 2, since K(X|Y) = E may then exceed K(X).
    """
    e, x, y = _emd_and_complexities(emd, k_x, k_y)
    return np.minimum(_ratio(e, np.maximum(x, y)), 2.0)


def steinhaus(emd: npt.ArrayLike, k_x: npt.ArrayLike, k_y: npt.ArrayLike) -> FloatArray:
    """Steinhaus transform about {0}: 2E / (Kx + Ky + E), a metric in [0, 1]; raises as `joint`."""
    e, x, y = _emd_and_complexities(emd, k_x, k_y)
    return np.minimum(_ratio(2.0 * e, x + y + e), 1.0)


FORMS: dict[str, Callable[[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike], FloatArray]] = {
    "joint": joint,
    "information": information,
    "steinhaus": steinhaus,
}


def compression_distance(
    x: bytes, y: bytes, compressor: str = "gzip", *, order: Literal["min", "mean"] = "min"
) -> float:
    """Eq. 8 of two byte strings under a compressor of `depthprint.complexity.COMPRESSORS`.

    C(XY) depends on the order; ``order`` takes the `min` or the `mean` of C(XY) and C(YX), so that the
    distance is symmetric. Real compressors only approximate [0, 1]. Raises SettingsError, MissingExtraError.
    """
    if order not in ("min", "mean"):
        raise SettingsError(f"order: expected min or mean, got {order!r}")
    both = compressed_length(x + y, compressor), compressed_length(y + x, compressor)
    c_xy = min(both) if order == "min" else sum(both) / 2
    return float(ncd(compressed_length(x, compressor), compressed_length(y, compressor), c_xy))


def _complexities(**values: npt.ArrayLike) -> list[FloatArray]:
    arrays = []
    for name, value in values.items():
        array = np.asarray(value, dtype=np.float64)
        if not (np.isfinite(array).all() and (array >= 0).all()):
            raise DataError(f"ncd: {name} must be finite and >= 0")
        arrays.append(array)
    return arrays


def _emd_and_complexities(emd: npt.ArrayLike, k_x: npt.ArrayLike, k_y: npt.ArrayLike) -> list[FloatArray]:
    e, x, y = _complexities(emd=emd, k_x=k_x, k_y=k_y)
    if (e > (x + y) * (1 + _ROUNDING)).any():
        raise DataError(
            "ncd: an EMD exceeds K(X) + K(Y); the complexities must come from the null element "
            "of the same ground distance"
        )
    return [e, x, y]


def _ratio(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    top, bottom = np.broadcast_arrays(numerator, denominator)
    ratio: FloatArray = np.divide(top, bottom, out=np.zeros(bottom.shape), where=bottom > 0)
    return ratio
