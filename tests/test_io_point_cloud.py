"""Point clouds: PCD, PLY and Velodyne files, round trips, LZF, and malformed ones refused by name."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint._kernels.lzf import lzf_compress, lzf_decompress
from depthprint.errors import DataError, SettingsError
from depthprint.io.pcd import read_pcd, write_pcd
from depthprint.io.ply import read_ply, write_ply
from depthprint.io.point_cloud import PointCloud, read_point_cloud
from depthprint.io.velodyne import read_velodyne_bin, write_velodyne_bin
from depthprint.projection import Spherical
from depthprint.range_image import RangeImage


def some_cloud(n: int = 24, height: int = 1, intensity: bool = True, seed: int = 0) -> PointCloud:
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 20, (n * height, 3)).astype(np.float32)
    points[::7] = np.nan
    values = rng.random(n * height).astype(np.float32) if intensity else None
    return PointCloud(points, n, height, viewpoint=[1, 2, 3.25, 1, 0, 0, 0], intensity=values)


def slow_lzf_decompress(data: bytes) -> bytes:
    out = bytearray()
    i = 0
    while i < len(data):
        control = data[i]
        i += 1
        if control < 32:
            out += data[i : i + control + 1]
            i += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += data[i]
            i += 1
        start = len(out) - ((control & 31) << 8) - data[i] - 1
        i += 1
        for k in range(length + 2):
            out.append(out[start + k])
    return bytes(out)


def repetitive_bytes() -> st.SearchStrategy[bytes]:
    pieces = st.tuples(st.binary(min_size=1, max_size=12), st.integers(1, 90))
    return st.lists(pieces, max_size=8).map(lambda parts: b"".join(piece * n for piece, n in parts))


@settings(max_examples=150, deadline=None)
@given(st.one_of(st.binary(max_size=600), repetitive_bytes()))
def test_lzf_gives_back_what_was_compressed(content: bytes) -> None:
    compressed = lzf_compress(np.frombuffer(content, np.uint8))
    back, whole = lzf_decompress(compressed, len(content))
    assert whole
    assert back.tobytes() == content
    assert slow_lzf_decompress(compressed.tobytes()) == content


def test_lzf_reads_streams_put_together_by_hand() -> None:
    literal = bytes([2]) + b"abc"
    short = bytes([1 << 5, 2])  # three bytes from three back
    long = bytes([7 << 5, 10, 0])  # nineteen bytes from one back
    stream = np.frombuffer(literal + short + long, np.uint8)
    back, whole = lzf_decompress(stream, 25)
    assert whole
    assert back.tobytes() == b"abcabc" + b"c" * 19


def test_lzf_finds_repeats_across_the_whole_window() -> None:
    block = np.random.default_rng(0).integers(0, 256, 4000).astype(np.uint8)
    content = np.concatenate([block, block])
    compressed = lzf_compress(content)
    assert len(compressed) < 0.6 * len(content)
    np.testing.assert_array_equal(lzf_decompress(compressed, len(content))[0], content)


@pytest.mark.parametrize(
    "stream",
    [[5, 1, 2], [32], [0, 65, 32, 9], [224], [224, 3], [0, 65, 224, 255, 0]],
    ids=[
        "cut literal",
        "no distance",
        "before the start",
        "no length",
        "length without distance",
        "too long",
    ],
)
def test_lzf_says_when_a_stream_is_damaged(stream: list[int]) -> None:
    _, whole = lzf_decompress(np.array(stream, np.uint8), 20)
    assert not whole


@pytest.mark.parametrize("form", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("height", [1, 5])
@pytest.mark.parametrize("intensity", [True, False])
def test_a_pcd_gives_back_what_was_written(tmp_path: Path, form: str, height: int, intensity: bool) -> None:
    cloud = some_cloud(24, height, intensity)
    write_pcd(tmp_path / "a.pcd", cloud, form)
    back = read_point_cloud(tmp_path / "a.pcd")
    np.testing.assert_array_equal(back.points, cloud.points)
    assert (back.width, back.height, back.organised) == (24, height, height > 1)
    np.testing.assert_array_equal(back.viewpoint, cloud.viewpoint)
    assert (back.intensity is None) == (not intensity)
    if intensity:
        np.testing.assert_array_equal(back.intensity, cloud.intensity)
    assert back.valid.sum() == np.isfinite(cloud.points).all(axis=1).sum()


def pcd_header(n: int, form: str, **changes: str) -> bytes:
    entries = {
        "VERSION": "0.7",
        "FIELDS": "ring x y _ z normal",
        "SIZE": "2 8 4 1 4 4",
        "TYPE": "U F F U F F",
        "COUNT": "1 1 1 3 1 3",
        "WIDTH": str(n),
        "HEIGHT": "1",
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": str(n),
        "DATA": form,
        **changes,
    }
    return "".join(f"{key} {value}\n" for key, value in entries.items() if value).encode()


def padded_record() -> np.ndarray:
    dtype = np.dtype(
        [("ring", "<u2"), ("x", "<f8"), ("y", "<f4"), ("_", "u1", 3), ("z", "<f4"), ("n", "<f4", 3)]
    )
    table = np.zeros(4, dtype)
    table["ring"], table["x"], table["y"], table["z"] = 7, [1, 2, 3, 4], [5, 6, 7, np.nan], [8, 9, 10, 11]
    table["n"] = 99.0
    return table


def test_other_fields_padding_and_mixed_types_are_passed_over(tmp_path: Path) -> None:
    table = padded_record()
    expected = np.stack([table["x"], table["y"], table["z"]], axis=1)
    (tmp_path / "binary.pcd").write_bytes(pcd_header(4, "binary") + table.tobytes())
    columns = b"".join(np.ascontiguousarray(table[name]).tobytes() for name in table.dtype.names)
    packed = lzf_compress(np.frombuffer(columns, np.uint8)).tobytes()
    sizes = struct.pack("<II", len(packed), len(columns))
    (tmp_path / "packed.pcd").write_bytes(pcd_header(4, "binary_compressed") + sizes + packed)
    rows = "".join(f"7 {x} {y} 0 0 0 {z} 99 99 99\n" for x, y, z in expected)
    (tmp_path / "ascii.pcd").write_bytes(pcd_header(4, "ascii") + rows.encode())
    for name in ("binary", "packed", "ascii"):
        cloud = read_pcd(tmp_path / f"{name}.pcd")
        np.testing.assert_array_equal(cloud.points, expected.astype(np.float32), err_msg=name)
        np.testing.assert_array_equal(cloud.viewpoint, [0, 0, 0, 1, 0, 0, 0])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty"),
        (b"VERSION 0.7\nFIELDS x y z\n", "ends in a DATA line"),
        (pcd_header(4, "binary") + padded_record().tobytes()[:-1], "truncated"),
        (pcd_header(4, "binary_compressed") + b"1234", "truncated"),
        (pcd_header(4, "binary_compressed") + struct.pack("<II", 900, 140), "from 900 compressed"),
        (pcd_header(4, "binary_compressed") + struct.pack("<II", 3, 7) + b"abc", "got 7 from 3"),
        (pcd_header(4, "binary_compressed") + struct.pack("<II", 3, 132) + b"abc", "damaged data"),
        (pcd_header(2, "ascii") + b"7 1 2 0 0 0 3 9 9 9\n", "expected 2 points, got 1"),
        (pcd_header(1, "ascii") + b"7 1 2 0 0 0 3 9 9\n", "point 0: expected 10 numbers, got 9"),
        (pcd_header(1, "ascii") + b"7 1 2 0 0 0 x 9 9 9\n", "expected numbers"),
        (pcd_header(4, "zipped"), "got 'zipped'"),
        (pcd_header(4, "binary", FIELDS="ring a b _ c normal"), "fields x, y and z"),
        (pcd_header(4, "binary", SIZE="2 8 4"), "bad or missing entry"),
        (pcd_header(4, "binary", TYPE="U F F U F Q"), "bad or missing entry"),
        (pcd_header(4, "binary", SIZE="2 5 4 1 4 4"), "bad or missing entry"),
        (pcd_header(4, "binary", COUNT="1 1 1"), "as many FIELDS"),
        (pcd_header(4, "binary", COUNT="1 1 1 0 1 3"), "COUNT of at least 1"),
        (pcd_header(4, "binary", HEIGHT="3"), r"POINTS = WIDTH \* HEIGHT"),
        (pcd_header(0, "binary"), "at least one point"),
        (pcd_header(4, "binary", VIEWPOINT="0 0 0 nan 0 0 0"), "VIEWPOINT of 7 numbers"),
    ],
)
def test_malformed_pcds_are_refused_by_name(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "a.pcd").write_bytes(content)
    with pytest.raises(DataError, match=rf"a\.pcd: .*{message}"):
        read_pcd(tmp_path / "a.pcd")


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("intensity", [True, False])
def test_a_ply_gives_back_what_was_written(tmp_path: Path, form: str, intensity: bool) -> None:
    cloud = some_cloud(30, intensity=intensity)
    write_ply(tmp_path / "a.ply", cloud, form)
    back = read_point_cloud(tmp_path / "a.ply")
    np.testing.assert_array_equal(back.points, cloud.points)
    assert (back.intensity is None) == (not intensity)
    if intensity:
        np.testing.assert_array_equal(back.intensity, cloud.intensity)


PLY_BODY = (
    "comment made by hand\nelement camera 1\nproperty double f\nelement vertex 2\nproperty double x\n"
    "property uchar red\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
)


def test_plys_with_colours_other_elements_and_faces_are_read(tmp_path: Path) -> None:
    expected = np.array([[1.5, 2, 3], [4, 5, 6]], np.float32)
    (tmp_path / "ascii.ply").write_text(
        f"ply\nformat ascii 1.0\n{PLY_BODY}550\n1.5 255 2 3\n4 0 5 6\n3 0 1 1\n"
    )
    for name, order in (("binary_little_endian", "<"), ("binary_big_endian", ">")):
        dtype = np.dtype([("x", f"{order}f8"), ("r", "u1"), ("y", f"{order}f4"), ("z", f"{order}f4")])
        vertices = np.array([(1.5, 255, 2, 3), (4, 0, 5, 6)], dtype).tobytes()
        body = struct.pack(f"{order}d", 550) + vertices + b"\x03" + b"\0" * 12
        header = f"ply\nformat {name} 1.0\n{PLY_BODY}".replace("\n", "\r\n").encode()
        (tmp_path / f"{name}.ply").write_bytes(header + body)
    for name in ("ascii", "binary_little_endian", "binary_big_endian"):
        np.testing.assert_array_equal(read_ply(tmp_path / f"{name}.ply").points, expected, err_msg=name)


def test_a_ply_written_by_another_library_is_read(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    points = np.random.default_rng(0).normal(0, 5, (20, 3)).astype(np.float32)
    for encoding in ("ascii", "binary"):
        content = trimesh.PointCloud(points).export(file_type="ply", encoding=encoding)
        (tmp_path / "a.ply").write_bytes(content if isinstance(content, bytes) else content.encode())
        np.testing.assert_allclose(read_ply(tmp_path / "a.ply").points, points, rtol=1e-5)


XYZ = "property float x\nproperty float y\nproperty float z\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("solid cube\n", "begins with 'ply'"),
        ("ply\nformat ascii 1.0\n", "ends in 'end_header'"),
        (f"ply\nformat ascii 2.0\nelement vertex two\n{XYZ}end_header\n", "the line 'element vertex two'"),
        (f"ply\nelement vertex 1\n{XYZ}end_header\n1 2 3\n", "expected a format"),
        ("ply\nformat ascii 1.0\nproperty float x\nend_header\n", "the line 'property float x'"),
        ("ply\nformat ascii 1.0\nwidth 3\nend_header\n", "the line 'width 3'"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\nend_header\n", "'property half x'"),
        ("ply\nformat ascii 1.0\nelement face 0\nend_header\n", "an element 'vertex'"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", "x, y and z"),
        (f"ply\nformat ascii 1.0\nelement vertex 0\n{XYZ}end_header\n", "at least one vertex"),
        (f"ply\nformat ascii 1.0\nelement vertex 1\n{XYZ}property float x\nend_header\n", "different"),
        (
            f"ply\nformat ascii 1.0\nelement vertex 1\n{XYZ}property list uchar int n\nend_header\n1 2 3 0\n",
            "plain, different properties",
        ),
        (f"ply\nformat ascii 1.0\nelement vertex 2\n{XYZ}end_header\n1 2 3\n", "2 vertices, got 1"),
        (f"ply\nformat ascii 1.0\nelement vertex 1\n{XYZ}end_header\n1 2\n", "vertex 0: expected 3 numbers"),
        (f"ply\nformat ascii 1.0\nelement vertex 1\n{XYZ}end_header\n1 2 c\n", "expected numbers"),
        (
            f"ply\nformat binary_big_endian 1.0\nelement vertex 1\n{XYZ}end_header\n12345678901",
            "truncated 11",
        ),
        (
            "ply\nformat binary_little_endian 1.0\nelement face 1\nproperty list uchar int n\n"
            f"element vertex 1\n{XYZ}end_header\n0123456789012",
            "vertices before the elements with lists",
        ),
    ],
)
def test_malformed_plys_are_refused_by_name(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.ply").write_text(text)
    with pytest.raises(DataError, match=rf"a\.ply: .*{message}"):
        read_ply(tmp_path / "a.ply")


def test_a_velodyne_scan_gives_back_what_was_written(tmp_path: Path) -> None:
    scan = np.random.default_rng(0).normal(0, 30, (50, 4)).astype(np.float32)
    write_velodyne_bin(tmp_path / "a.bin", scan)
    np.testing.assert_array_equal(read_velodyne_bin(tmp_path / "a.bin"), scan)
    cloud = read_point_cloud(tmp_path / "a.bin")
    np.testing.assert_array_equal(cloud.points, scan[:, :3])
    np.testing.assert_array_equal(cloud.intensity, scan[:, 3])
    (tmp_path / "cut.bin").write_bytes((tmp_path / "a.bin").read_bytes()[:-4])
    with pytest.raises(DataError, match=r"cut\.bin: expected a whole number of points of 16 bytes, got 796"):
        read_velodyne_bin(tmp_path / "cut.bin")
    with pytest.raises(DataError, match=r"shape \(n, 4\)"):
        write_velodyne_bin(tmp_path / "b.bin", scan[:, :3])


def test_unknown_suffixes_and_forms_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"a\.xyz: expected a point cloud \(\.bin, \.pcd, \.ply\)"):
        read_point_cloud(tmp_path / "a.xyz")
    with pytest.raises(SettingsError, match="write_pcd"):
        write_pcd(tmp_path / "a.pcd", some_cloud(), "zip")
    with pytest.raises(SettingsError, match="write_ply"):
        write_ply(tmp_path / "a.ply", some_cloud(), "binary")


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"points": np.ones((5, 2)), "width": 5}, r"\(5 \* 1, 3\), got \(5, 2\)"),
        ({"points": np.ones((5, 3)), "width": 4}, r"\(4 \* 1, 3\)"),
        ({"points": np.ones((5, 3)), "width": 5, "intensity": np.ones(4)}, "5 intensities"),
        ({"points": np.ones((5, 3)), "width": 5, "viewpoint": np.ones(6)}, "viewpoint of 7"),
    ],
)
def test_clouds_whose_parts_do_not_fit_are_refused(fields: dict, message: str) -> None:
    with pytest.raises(DataError, match=message):
        PointCloud(**fields)


def test_a_real_velodyne_scan_becomes_a_range_image(data_root: Path) -> None:
    path = data_root / "kitti_odometry" / "sequences" / "00" / "velodyne" / "000000.bin"
    cloud = read_point_cloud(path)
    assert len(cloud) == 124668
    assert cloud.valid.all()
    image = RangeImage.from_points(cloud.points, Spherical.hdl64(1024), source=cloud.source)
    assert image.valid.mean() > 0.6
    assert np.nanmax(image.ranges_m) < 130
    # The road lies about 1.7 m below the sensor: the most frequent height of the points near the car.
    points = image.points_flu().reshape(-1, 3)
    near = points[(np.hypot(points[:, 0], points[:, 1]) < 12) & (np.abs(points[:, 1]) < 4)]
    heights, edges = np.histogram(near[:, 2], bins=np.arange(-3, 2, 0.1))
    assert edges[heights.argmax()] == pytest.approx(-1.75, abs=0.15)
