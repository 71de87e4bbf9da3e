"""Kolmogorov complexity, approximated: by EMD to the null element (paper eq. 17-18) or by a compressor."""

from __future__ import annotations

import bz2
import lzma
import zlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

from depthprint._pairs import Masses, check_masses
from depthprint._ppm_process import PpmProcess, ppm_length
from depthprint.emd import emd
from depthprint.errors import DataError, MissingExtraError, SettingsError
from depthprint.signature import GroundDistance, Signature

__all__ = ["COMPRESSORS", "CompressorPool", "compressed_length", "conditional_complexity", "emd_complexity"]

# "BZh9", then mark and checksum of the first block and of the stream's end
_BZ2_FRAME = 4 + 10 + 10


def emd_complexity(
    signature: Signature, ground: GroundDistance | None = None, *, masses: Masses = "null"
) -> float:
    """K(X) = EMD(P, {0}) (eq. 18): every unit of mass travels to the null element.

    Total weight times ``ground.null_cost``; for `balanced` and `rubner` masses a distance is per unit of
    mass, and so is K: ``null_cost``, or 0 for an empty signature. Raises SettingsError for unknown
    ``masses``.
    """
    null_cost = (GroundDistance() if ground is None else ground).null_cost
    check_masses(masses)
    if masses == "null":
        return null_cost * signature.mass
    return null_cost if signature.mass > 0 else 0.0


def conditional_complexity(
    x: Signature, y: Signature, ground: GroundDistance | None = None, *, masses: Masses = "null"
) -> float:
    """K(X|Y) = EMD(P, Q) (eq. 17); raises as `depthprint.emd.emd`."""
    return emd(x, y, masses=masses, ground=ground).value


def compressed_length(data: bytes, compressor: str = "gzip") -> int:
    """Bytes that ``compressor`` needs for ``data`` as a raw stream, without header or checksum; 0 for none.

    `gzip` is raw deflate; `ppm` PPMd var. H of order 6; `lzma` raw LZMA1; `zstd` level 19 without magic
    number. bz2 has no raw form: the 24 bytes of its frame are subtracted (each further block of 900 kB still
    counts 10 bytes). pyppmd keeps some 18 kB a call: for many streams use `CompressorPool`. Raises
    SettingsError for an unknown name, DataError for anything but bytes,
    MissingExtraError without zstandard.
    """
    _check_compressor(compressor)
    if not isinstance(data, (bytes, bytearray, memoryview)):
        raise DataError(f"compressed_length: expected bytes, got {type(data).__name__}")
    raw = bytes(data)
    return COMPRESSORS[compressor](raw) if raw else 0


class CompressorPool:
    """Compressed lengths of many streams, over ``workers`` threads (for `ppm`: processes)."""

    def __init__(self, compressor: str, workers: int = 2) -> None:
        _check_compressor(compressor)
        self._compressor = compressor
        self._threads = ThreadPoolExecutor(workers)
        self._workers = workers
        self._processes = [PpmProcess() for _ in range(workers)] if compressor == "ppm" else []

    def lengths(self, streams: Sequence[bytes]) -> list[int]:
        """Length of each stream, in order, as `compressed_length` gives it."""
        parts = [streams[k :: self._workers] for k in range(self._workers)]
        lengths = [0] * len(streams)
        for k, part in enumerate(self._threads.map(self._part, range(self._workers), parts)):
            lengths[k :: self._workers] = part
        return lengths

    def _part(self, worker: int, streams: Sequence[bytes]) -> list[int]:
        if self._processes:
            return self._processes[worker].lengths(streams)
        return [compressed_length(data, self._compressor) for data in streams]


def _check_compressor(compressor: str) -> None:
    if compressor not in COMPRESSORS:
        raise SettingsError(f"compressor: expected one of {', '.join(COMPRESSORS)}, got {compressor!r}")


def _deflate(data: bytes) -> int:
    # A window and tables no larger than the data cost less to set up and give the same stream.
    bits = min(15, max(9, (len(data) - 1).bit_length()))
    stream = zlib.compressobj(9, zlib.DEFLATED, -bits, max(1, bits - 6))
    return len(stream.compress(data)) + len(stream.flush())


def _bz2(data: bytes) -> int:
    # Blocks are level x 100 kB; up to one block the level changes nothing but the memory touched.
    level = min(9, 1 + len(data) // 100_000)
    return len(bz2.compress(data, level)) - _BZ2_FRAME


def _lzma(data: bytes) -> int:
    filters = [{"id": lzma.FILTER_LZMA1, "preset": 9 | lzma.PRESET_EXTREME}]
    return len(lzma.compress(data, format=lzma.FORMAT_RAW, filters=filters))


def _zstd(data: bytes) -> int:
    try:
        import zstandard
    except ImportError as error:
        raise MissingExtraError(
            "compressor zstd: the zstandard package is missing; pip install depthprint[zstd]"
        ) from error
    parameters = zstandard.ZstdCompressionParameters.from_level(
        19,
        source_size=len(data),
        format=zstandard.FORMAT_ZSTD1_MAGICLESS,
        write_checksum=False,
        write_content_size=False,
        write_dict_id=False,
    )
    return len(zstandard.ZstdCompressor(compression_params=parameters).compress(data))


COMPRESSORS: dict[str, Callable[[bytes], int]] = {
    "gzip": _deflate,
    "bz2": _bz2,
    "ppm": ppm_length,
    "lzma": _lzma,
    "zstd": _zstd,
}
