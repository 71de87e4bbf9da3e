"""Depth images and masks: metres out, NaN for no return, and damaged files refused by name."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from depthprint.errors import DataError, SettingsError
from depthprint.io.depth_image import read_depth_image, write_depth_npy, write_depth_png
from depthprint.io.mask_image import read_mask_image, write_mask_image
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage

STEPS = np.array([[0, 1, 500], [65535, 65534, 1234]], dtype=np.uint16)
METRES = np.array([[np.nan, 0.001, 0.5], [np.nan, 65.534, 1.234]], dtype=np.float32)


def png_bytes(array: np.ndarray) -> bytes:
    done, encoded = cv2.imencode(".png", array)
    assert done
    return encoded.tobytes()


@settings(max_examples=40, deadline=None)
@given(
    hnp.arrays(
        np.uint16, hnp.array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.integers(0, 65534)
    )
)
def test_written_depth_is_read_back_to_the_step(tmp_path_factory, steps: np.ndarray) -> None:
    path = tmp_path_factory.getbasetemp() / "round.png"
    ranges = np.where(steps > 0, steps * 0.0005, np.nan)
    write_depth_png(path, ranges, scale_m=0.0005)
    np.testing.assert_allclose(read_depth_image(path, scale_m=0.0005), ranges, rtol=1e-6)


def test_zero_and_65535_are_no_return_in_every_16_bit_form(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(png_bytes(STEPS))
    (tmp_path / "a.pgm").write_bytes(b"P5\n# a camera\n3 2\n65535\n" + STEPS.astype(">u2").tobytes())
    text = "\n".join(" ".join(map(str, row)) for row in STEPS.tolist())
    (tmp_path / "plain.PGM").write_text(f"P2 # plain\n3 2\n# largest\n65535\n{text}\n")
    np.save(tmp_path / "a.npy", STEPS)
    np.save(tmp_path / "big.npy", STEPS.astype(">u2"))
    np.savez(tmp_path / "a.npz", STEPS)
    np.savez_compressed(tmp_path / "named.npz", stamp=np.array(3.0), depth=STEPS)
    for name in ["a.png", "a.pgm", "plain.PGM", "a.npy", "big.npy", "a.npz", "named.npz"]:
        ranges = read_depth_image(tmp_path / name)
        assert ranges.dtype == np.float32
        np.testing.assert_allclose(ranges, METRES, rtol=1e-6, err_msg=name)


def test_floats_are_metres_whatever_the_scale(tmp_path: Path) -> None:
    given_m = np.array([[1.5, -1.0], [np.inf, 0.0]])
    np.save(tmp_path / "a.npy", given_m)
    expected = np.array([[1.5, np.nan], [np.nan, np.nan]])
    np.testing.assert_array_equal(read_depth_image(tmp_path / "a.npy", scale_m=0.1), expected)
    write_depth_npy(tmp_path / "b.npy", expected)
    np.testing.assert_array_equal(read_depth_image(tmp_path / "b.npy"), expected)


@pytest.mark.parametrize("keep", [0, 7, 20, 40, 300, -5, -1])
def test_a_truncated_png_is_named(tmp_path: Path, keep: int) -> None:
    path = tmp_path / "frame-000012.depth.png"
    noise = np.random.default_rng(0).integers(1, 9000, (40, 50)).astype(np.uint16)
    path.write_bytes(png_bytes(noise)[:keep])
    with pytest.raises(DataError, match=r"frame-000012\.depth\.png: expected"):
        read_depth_image(path)


@pytest.mark.parametrize("place", [17, 30, 200, 1000, -3])
def test_a_png_with_a_flipped_bit_is_named(tmp_path: Path, place: int) -> None:
    noise = np.random.default_rng(0).integers(1, 9000, (40, 50)).astype(np.uint16)
    content = bytearray(png_bytes(noise))
    content[place] ^= 16
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(DataError, match=r"a\.png: expected a 16-bit grey PNG, got"):
        read_depth_image(tmp_path / "a.png")


def test_a_png_with_whole_chunks_but_no_pixels_is_refused(tmp_path: Path) -> None:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 4, 4, 16, 0, 0, 0, 0))
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + header + chunk(b"IEND", b""))
    with pytest.raises(DataError, match="cannot be decoded"):
        read_depth_image(tmp_path / "a.png")


@pytest.mark.parametrize(
    ("array", "what"),
    [
        (np.full((4, 4), 9, np.uint8), "8-bit grey"),
        (np.full((4, 4, 3), 9, np.uint8), "8-bit colour"),
        (np.full((4, 4, 3), 9, np.uint16), "16-bit colour"),
        (np.full((4, 4, 4), 9, np.uint8), "8-bit colour with alpha"),
    ],
)
def test_pngs_of_another_kind_are_refused(tmp_path: Path, array: np.ndarray, what: str) -> None:
    (tmp_path / "a.png").write_bytes(png_bytes(array))
    with pytest.raises(DataError, match=f"a.png: expected a 16-bit grey PNG, got {what}"):
        read_depth_image(tmp_path / "a.png")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.png", b"GIF89a" + b"0" * 40, "PNG signature"),
        ("a.png", b"", "got an empty one"),
        ("a.pgm", b"P5\n2 2\n255\n0000", "16-bit PGM .* got 255"),
        ("a.pgm", b"P5\n2 2\n65535\n0000", "expected 4 values"),
        ("a.pgm", b"P5\n2 2\n65535\n", "expected 4 values"),
        ("a.pgm", b"P2\n2 2\n1000\n1 2 3 4000", "from 0 to 1000, got 4 up to 4000"),
        ("a.pgm", b"P2\n2 2\n1000\n1 2 x 4", "whole numbers"),
        ("a.pgm", b"P6\n2 2\n65535\n", "another header"),
        ("a.npy", b"\x93NUMPY\x01\x00v", "whole NumPy file"),
        ("a.npz", b"PK\x03\x04 cut", "whole NumPy file"),
        ("a.tif", b"II*\x00", "expected a depth image"),
    ],
)
def test_other_content_is_refused_by_name(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DataError, match=f"{name}: .*{message}"):
        read_depth_image(tmp_path / name)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.ones((2, 2, 2)), "2-D array"),
        (np.ones((2, 2), np.uint8), "at least 16 bits"),
        (np.ones((2, 2), bool), "2-D array"),
        (np.array([["a"]]), "2-D array"),
        (np.array([[None]]), "without objects"),
        (np.ones((0, 3)), "2-D array"),
    ],
)
def test_arrays_that_are_no_depth_are_refused(tmp_path: Path, array: np.ndarray, message: str) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(DataError, match=message):
        read_depth_image(tmp_path / "a.npy")


def test_a_cut_npz_and_one_of_many_arrays_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "two.npz", a=METRES, b=METRES)
    with pytest.raises(DataError, match=r"expected one array.*\['a', 'b'\]"):
        read_depth_image(tmp_path / "two.npz")
    whole = (tmp_path / "two.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match=r"cut\.npz"):
        read_depth_image(tmp_path / "cut.npz")


def test_a_missing_file_and_a_scale_of_zero_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"none\.png: cannot be read"):
        read_depth_image(tmp_path / "none.png")
    with pytest.raises(SettingsError, match="positive number"):
        read_depth_image(tmp_path / "none.png", scale_m=0.0)


def test_a_range_that_16_bits_cannot_hold_is_not_written(tmp_path: Path) -> None:
    for lost in (65.535, 80.0, 0.0001):
        with pytest.raises(DataError, match=r"from 0\.001 to 65\.534 m"):
            write_depth_png(tmp_path / "a.png", np.array([[1.0, lost]]))
    with pytest.raises(DataError, match="shape"):
        write_depth_png(tmp_path / "a.png", np.ones(4))
    assert not list(tmp_path.iterdir())


def test_masks_of_one_and_eight_bits_are_read(tmp_path: Path) -> None:
    mask = np.random.default_rng(0).random((9, 11)) < 0.5
    write_mask_image(tmp_path / "a.png", mask)
    np.testing.assert_array_equal(read_mask_image(tmp_path / "a.png"), mask)
    flags = [cv2.IMWRITE_PNG_BILEVEL, 1]
    assert cv2.imwrite(str(tmp_path / "b.png"), mask.astype(np.uint8) * 255, flags)
    assert (tmp_path / "b.png").read_bytes()[24] == 1
    np.testing.assert_array_equal(read_mask_image(tmp_path / "b.png"), mask)
    (tmp_path / "c.png").write_bytes(png_bytes(STEPS))
    with pytest.raises(DataError, match="got 16-bit grey"):
        read_mask_image(tmp_path / "c.png")
    with pytest.raises(DataError, match="expected a bool mask"):
        write_mask_image(tmp_path / "d.png", np.ones((3, 3)))


def test_an_image_without_any_return_reads_as_nan_and_is_refused_when_returns_are_needed(
    tmp_path: Path,
) -> None:
    (tmp_path / "dark.png").write_bytes(png_bytes(np.full((6, 8), 65535, np.uint16)))
    ranges = read_depth_image(tmp_path / "dark.png")
    assert np.isnan(ranges).all()
    image = RangeImage(ranges, Pinhole(9, 9, 4, 3, 8, 6), source="dark.png")
    with pytest.raises(DataError, match=r"dark\.png: expected at least one return"):
        image.require_returns()


def test_a_real_kinect_frame(data_root: Path) -> None:
    path = data_root / "rgbd" / "redkitchen_seq01" / "frame-000000.depth.png"
    ranges = read_depth_image(path)
    assert ranges.shape == (480, 640)
    raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    valid = (raw > 0) & (raw < 65535)
    np.testing.assert_array_equal(np.isfinite(ranges), valid)
    np.testing.assert_allclose(ranges[valid], raw[valid] / 1000, rtol=1e-6)
    assert 0.3 < np.nanmin(ranges) < np.nanmax(ranges) < 12


def test_a_simulated_object_crop_has_depth_and_mask_of_one_size(data_root: Path) -> None:
    depth = next((data_root / "objects" / "cad51").glob("*/*/*_depthcrop.png"))
    mask = read_mask_image(depth.with_name(depth.name.replace("depthcrop", "maskcrop")))
    ranges = read_depth_image(depth)
    assert mask.shape == ranges.shape
    assert np.isfinite(ranges[mask]).any()
