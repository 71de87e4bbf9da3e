from __future__ import annotations

import bz2
import gc
import lzma
import sys
import zlib

import numpy as np
import pytest

from depthprint import _ppm_process
from depthprint.complexity import (
    COMPRESSORS,
    CompressorPool,
    compressed_length,
    conditional_complexity,
    emd_complexity,
)
from depthprint.emd import emd
from depthprint.errors import DataError, DepthprintError, MissingExtraError, SettingsError
from depthprint.signature import GroundDistance, Signature

EMPTY = Signature(np.zeros(0), np.zeros((0, 3)))


def signature(seed: int, k: int = 6) -> Signature:
    rng = np.random.default_rng(seed)
    return Signature(rng.random(k), rng.normal(size=(k, 3)))


def test_complexity_is_the_emd_to_the_empty_signature() -> None:
    x, ground = signature(0), GroundDistance(null_cost=1.5)
    assert emd_complexity(x, ground) == pytest.approx(emd(x, EMPTY, ground=ground).value)
    assert emd_complexity(EMPTY, ground) == 0


@pytest.mark.parametrize("masses", ["rubner", "balanced"])
def test_complexity_of_a_unit_of_mass_is_the_null_cost(masses: str) -> None:
    assert emd_complexity(signature(0), GroundDistance(null_cost=1.5), masses=masses) == 1.5
    assert emd_complexity(EMPTY, masses=masses) == 0


def test_conditional_complexity_is_the_emd() -> None:
    x, y = signature(0), signature(1)
    assert conditional_complexity(x, y) == emd(x, y).value
    assert conditional_complexity(x, x) == 0


def test_what_is_known_of_a_signature_lowers_its_complexity() -> None:
    x = signature(0)
    part = Signature(x.weights[:4], x.points[:4])
    assert conditional_complexity(x, part) == pytest.approx(emd_complexity(x) - emd_complexity(part))


@pytest.fixture(params=list(COMPRESSORS))
def compressor(request: pytest.FixtureRequest) -> str:
    if request.param == "zstd":
        pytest.importorskip("zstandard")
    return str(request.param)


def test_random_bytes_do_not_compress_and_repeated_ones_do(compressor: str) -> None:
    rng = np.random.default_rng(2)
    noise = rng.bytes(4000)
    assert 0.95 * 4000 < compressed_length(noise, compressor) < 1.15 * 4000
    assert compressed_length(bytes(4000), compressor) < 60
    assert compressed_length(noise[:1000] * 4, compressor) < 0.5 * compressed_length(noise, compressor)


def test_headers_do_not_dominate_short_data(compressor: str) -> None:
    assert compressed_length(b"", compressor) == 0
    assert 0 < compressed_length(b"a", compressor) <= 13


def test_raw_lengths_are_the_file_lengths_less_their_headers() -> None:
    data = b"range image " * 40
    assert compressed_length(data, "gzip") == len(zlib.compress(data, 9)) - 6
    assert compressed_length(data, "bz2") == len(bz2.compress(data)) - 24
    assert compressed_length(data, "lzma") < len(lzma.compress(data))


def test_ppm_and_lzma_streams_hold_the_data() -> None:
    import pyppmd

    data = np.random.default_rng(3).bytes(500) + b"depth" * 50
    encoder = pyppmd.Ppmd7Encoder(6, 16 << 20)
    raw = encoder.encode(data) + encoder.flush(endmark=False)
    assert compressed_length(data, "ppm") == len(raw)
    assert pyppmd.Ppmd7Decoder(6, 16 << 20).decode(raw, len(data)) == data


def test_unknown_compressor_and_text_are_refused() -> None:
    with pytest.raises(SettingsError, match="gzip, bz2, ppm"):
        compressed_length(b"a", "rar")
    with pytest.raises(DataError, match="expected bytes, got str"):
        compressed_length("text")  # type: ignore[arg-type]


def test_missing_zstandard_names_the_pip_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zstandard", None)
    with pytest.raises(MissingExtraError, match=r"pip install depthprint\[zstd\]"):
        compressed_length(b"a", "zstd")


@pytest.mark.parametrize("compressor", COMPRESSORS)
def test_a_pool_gives_the_length_of_each_stream_in_order(compressor: str) -> None:
    if compressor == "zstd":
        pytest.importorskip("zstandard")
    rng = np.random.default_rng(5)
    streams = [
        rng.integers(0, 9, size).astype(np.uint8).tobytes() for size in (0, 1, 300, 70_000, 5, 2048, 17)
    ]
    pool = CompressorPool(compressor, workers=2)
    expected = [compressed_length(data, compressor) for data in streams]
    assert pool.lengths(streams) == expected
    assert pool.lengths([]) == []


def test_a_ppm_process_is_replaced_after_its_share_of_streams(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_ppm_process, "_STREAMS_A_PROCESS", 3)
    process = _ppm_process.PpmProcess()
    streams = [bytes([k]) * 50 for k in range(8)]
    first = process.lengths(streams[:1])
    used = process._child
    assert first + process.lengths(streams[1:]) == [_ppm_process.ppm_length(data) for data in streams]
    assert used is not None
    assert used.poll() == 0
    assert process._child is not used


def test_a_ppm_process_that_dies_is_an_error() -> None:
    process = _ppm_process.PpmProcess()
    process.lengths([b"a"])
    assert process._child is not None
    process._child.kill()
    process._child.wait()
    with pytest.raises(DepthprintError, match="ended early"):
        process.lengths([b"a"])
    del process
    gc.collect()
