"""The atoms of a dictionary (paper Fig. 1 and 4)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError
from depthprint.visualization._style import drawing, titled

__all__ = ["atom_grid", "draw_atoms"]

FloatArray = npt.NDArray[np.floating]

_ASPECT = 1.5


def atom_grid(atoms: FloatArray, columns: int | None = None) -> npt.NDArray[np.float64]:
    """Lay atoms (k, h, w) or (k, h, w, c) out as one RGB picture, each scaled by its own largest value.

    Zero is mid-grey. Three channels are shown as red, green and blue; any other number side by side, in grey.
    ``columns``: when None, as many as make the picture wider than high, 3 to 2.
    """
    tiles = np.asarray(atoms, dtype=np.float64)
    if tiles.ndim not in (3, 4) or not tiles.size:
        raise DataError(f"atoms: expected shape (k, h, w) or (k, h, w, c), got {tiles.shape}")
    if not np.isfinite(tiles).all():
        raise DataError("atoms: expected finite values")
    if columns is not None and columns < 1:
        raise SettingsError(f"atoms: expected at least one column, got {columns}")
    if tiles.ndim == 3:
        tiles = tiles[..., None]
    largest = np.abs(tiles).max(axis=(1, 2, 3), keepdims=True)
    tiles = 0.5 + 0.5 * np.divide(tiles, largest, out=np.zeros_like(tiles), where=largest > 0)
    k, h, w, c = tiles.shape
    if c != 3:
        tiles = np.repeat(tiles.transpose(0, 1, 3, 2).reshape(k, h, c * w, 1), 3, axis=3)
        w = c * w
    if columns is None:
        columns = round(math.sqrt(_ASPECT * k * h / w))
    columns = min(max(columns, 1), k)
    rows = -(-k // columns)
    gap = max(1, round(min(h, w) / 10))
    picture = np.ones((rows * (h + gap) + gap, columns * (w + gap) + gap, 3))
    for number, tile in enumerate(tiles):
        top = gap + (number // columns) * (h + gap)
        left = gap + (number % columns) * (w + gap)
        picture[top : top + h, left : left + w] = tile
    return picture


def draw_atoms(
    atoms: FloatArray,
    path: Path | str,
    *,
    data: str = "",
    simulated: bool = False,
    columns: int | None = None,
) -> Path:
    """Draw all atoms in their order, row by row, learned from ``data``. Returns the path written."""
    picture = atom_grid(atoms, columns)
    channels = 1 if atoms.ndim == 3 else atoms.shape[3]
    size = f"{atoms.shape[1]} x {atoms.shape[2]} px" + (f", {channels} channels" if channels > 1 else "")
    with drawing(path, 7.5, float(np.clip(7.2 * picture.shape[0] / picture.shape[1], 1, 12)) + 0.8) as figure:
        axes = figure.add_subplot()
        axes.imshow(picture, interpolation="nearest")
        learned = f"learned from {data}" if data else ""
        axes.set_title(titled(f"{len(atoms)} atoms of {size}; grey is zero", learned, simulated))
        axes.set_axis_off()
    return Path(path)
