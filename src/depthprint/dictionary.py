"""Dictionaries of unit atoms, with a fingerprint, on disk and off."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, ModelError

__all__ = ["Dictionary"]

FloatArray = npt.NDArray[np.float64]

_FORMAT = "depthprint dictionary"
_VERSION = 1
_UNIT_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Dictionary:
    """K unit atoms of dimension d, and how they came about.

    atoms: (K, d) float64, each row of norm 1 (within 1e-6), read-only.
    kind: ``learned-l1``, ``learned-omp``, ``random-patches``, ``parametric``, or what a caller names it.
    settings: what made the atoms, as JSON values; read-only.
    seed: of the random generator, or None where none was used.

    Two dictionaries are equal when their fingerprints are. Raises DataError for atoms that are not as said.
    """

    atoms: FloatArray
    kind: str = "given"
    settings: Mapping[str, Any] = field(default_factory=dict)
    seed: int | None = None

    def __post_init__(self) -> None:
        atoms = np.array(self.atoms, dtype=np.float64, order="C")
        if atoms.ndim != 2 or 0 in atoms.shape:
            raise DataError(f"Dictionary.atoms: expected shape (K, d) with K, d >= 1, got {atoms.shape}")
        norms = np.sqrt(np.einsum("ij,ij->i", atoms, atoms))
        off = ~(np.abs(norms - 1) <= _UNIT_TOLERANCE)
        if off.any():
            k = int(np.argmax(off))
            raise DataError(f"Dictionary.atoms: expected rows of norm 1, row {k} has norm {norms[k]:g}")
        try:
            settings = json.loads(json.dumps(dict(self.settings), allow_nan=False))
        except (TypeError, ValueError) as error:
            raise DataError(f"Dictionary.settings: expected JSON values, got {error}") from error
        atoms.setflags(write=False)
        object.__setattr__(self, "atoms", atoms)
        object.__setattr__(self, "settings", MappingProxyType(settings))

    @classmethod
    def of(cls, atoms: Dictionary | npt.ArrayLike) -> Dictionary:
        """A Dictionary as it is, or an array of unit rows as a Dictionary."""
        return atoms if isinstance(atoms, Dictionary) else cls(np.asarray(atoms, dtype=np.float64))

    @property
    def n_atoms(self) -> int:
        """Number of atoms, K."""
        return self.atoms.shape[0]

    @property
    def dimension(self) -> int:
        """Length of an atom, d."""
        return self.atoms.shape[1]

    @cached_property
    def fingerprint(self) -> str:
        """Sixteen hexadecimal digits that change with any bit of the atoms or setting."""
        digest = hashlib.sha256(json.dumps(self._header(), sort_keys=True).encode())
        digest.update(np.ascontiguousarray(self.atoms, dtype="<f8").tobytes())
        return digest.hexdigest()[:16]

    def atoms_as(self, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        """Atoms in single or double precision; rounded once and kept."""
        return self.atoms if np.dtype(dtype) == np.float64 else self._single[0]

    def gram_as(self, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        """(K, K) inner products of the atoms, computed in double precision, once."""
        return self._gram if np.dtype(dtype) == np.float64 else self._single[1]

    @cached_property
    def _gram(self) -> FloatArray:
        from depthprint._kernels.blocks import one_blas_thread

        with one_blas_thread():
            gram = self.atoms @ self.atoms.T
        gram.setflags(write=False)
        return gram

    @cached_property
    def _single(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        pair = self.atoms.astype(np.float32), self._gram.astype(np.float32)
        for array in pair:
            array.setflags(write=False)
        return pair

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Dictionary) and self.fingerprint == other.fingerprint

    def __hash__(self) -> int:
        return hash(self.fingerprint)

    def __reduce__(self) -> tuple[Any, ...]:
        return Dictionary, (self.atoms, self.kind, dict(self.settings), self.seed)

    def save(self, path: Path | str) -> None:
        """Write the dictionary to one .npz file, whole or not at all."""
        from depthprint.io.archive import write_archive

        write_archive(path, self._header(), {"fingerprint": np.array(self.fingerprint), "atoms": self.atoms})

    @classmethod
    def load(cls, path: Path | str) -> Dictionary:
        """Read a dictionary that ``save`` wrote.

        Raises ModelError, naming the file, when it is missing, damaged, of another kind or of another
        version.
        """
        from depthprint.io.archive import DAMAGED, read_archive

        header, arrays = read_archive(path, "dictionary", _FORMAT, _VERSION)
        try:
            fingerprint = str(arrays["fingerprint"])
            loaded = cls(arrays["atoms"], header["kind"], header["settings"], header["seed"])
        except DAMAGED as error:
            raise ModelError(f"{path}: expected a whole dictionary file, got {error}") from error
        if loaded.fingerprint != fingerprint:
            raise ModelError(
                f"{path}: expected atoms of fingerprint {fingerprint}, got {loaded.fingerprint}; "
                "the file was altered"
            )
        return loaded

    def _header(self) -> dict[str, Any]:
        return {
            "format": _FORMAT,
            "version": _VERSION,
            "kind": self.kind,
            "settings": dict(self.settings),
            "seed": self.seed,
            "shape": list(self.atoms.shape),
        }
