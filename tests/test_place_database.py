"""The place database: what was committed comes back bit for bit, after a crash too; what is damaged is refused."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint import Encoder, LoopClosureDetector, PlaceDatabase
from depthprint.complexity_recognizer import ComplexityRecognizer
from depthprint.encoder import load_shipped_encoder
from depthprint.encoding_arrays import pack_encoding, unpack_encoding
from depthprint.errors import DataError, DepthprintError, FingerprintError, SettingsError
from depthprint.place import Place
from depthprint.place_merge import merge_maps
from depthprint.voxels import voxel_points
from synthetic import boxes, crop

ROUTE = [0, 1, 2, 3, 4, 5, 0, 1, 2]


@pytest.fixture(scope="module")
def encoder() -> Encoder:
    return load_shipped_encoder("handheld")


@pytest.fixture(scope="module")
def encodings(encoder):
    return [encoder.describe(boxes(seed)) for seed in range(6)]


@pytest.fixture
def database(tmp_path, encoder):
    with PlaceDatabase.create(tmp_path / "a map.db", encoder) as made:
        yield made


def pose(x_m: float) -> np.ndarray:
    T_world_sensor = np.eye(4)
    T_world_sensor[:3, 3] = x_m, 0.1, -np.pi
    return T_world_sensor


@pytest.fixture(scope="module")
def whole_map(tmp_path_factory, encoder) -> tuple[Path, np.ndarray]:
    """A map of four places without the model, which has its own checksum and would be most of the file."""
    path = tmp_path_factory.mktemp("maps") / "map.db"
    truth = np.arange(64, dtype=np.float64).reshape(8, 8)
    with PlaceDatabase.create(path, encoder) as database:
        database._connection.execute("UPDATE map SET model = x'', model_checksum = 0")
        database._connection.execute("VACUUM")
        for number in range(4):
            database.add(Place(number, float(number), pose(number)), {"truth": truth})
    # a path, since hypothesis prints its arguments
    return path, truth


def fill(database: PlaceDatabase, encodings, first: int = 0) -> None:
    for number, encoding in enumerate(encodings, start=len(database)):
        place = Place(number, 1.3e9 + number / 7, pose(first + number), f"frame {number}")
        database.add(place, pack_encoding(encoding))


def same_encoding(first, second) -> bool:
    pairs = [(a.weights, b.weights) for a, b in zip(first.signatures, second.signatures, strict=True)]
    pairs += [(a.points, b.points) for a, b in zip(first.signatures, second.signatures, strict=True)]
    pairs += list(zip(first.vectors, second.vectors, strict=True))
    alike = all(a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes() for a, b in pairs)
    alike &= all(
        a.fingerprint == b.fingerprint for a, b in zip(first.signatures, second.signatures, strict=True)
    )
    if first.mirrored is None or second.mirrored is None:
        return alike and first.mirrored is second.mirrored
    return alike and same_encoding(first.mirrored, second.mirrored)


def test_places_come_back_bit_for_bit_from_the_reopened_file(database, encoder, encodings):
    database.begin_run("kitchen", simulated=True)
    fill(database, encodings)
    database.close()
    with PlaceDatabase.open(database.path, fingerprint=encoder.fingerprint, read_only=True) as again:
        assert len(again) == len(encodings)
        assert [(r.number, r.name, r.simulated) for r in again.runs] == [(0, "kitchen", True)]
        for number, (stored, encoding) in enumerate(zip(again, encodings, strict=True)):
            assert same_encoding(unpack_encoding(stored.arrays, again.fingerprint), encoding)
            assert (stored.place.number, stored.run, stored.number_in_run) == (number, 0, number)
            assert stored.place.stamp_s == 1.3e9 + number / 7
            assert stored.place.T_world_sensor.tobytes() == pose(number).tobytes()
            assert stored.place.source == f"frame {number}"
            assert not stored.place.T_world_sensor.flags.writeable
            assert not any(array.flags.writeable for array in stored.arrays.values())


def test_an_object_encoding_keeps_its_mirror_image(encoder):
    encoding = load_shipped_encoder("object").describe(crop(1))
    assert encoding.mirrored is not None
    fingerprint = encoding.signatures[0].fingerprint
    assert same_encoding(unpack_encoding(pack_encoding(encoding), fingerprint), encoding)


@settings(max_examples=40, deadline=None)
@given(
    shape=st.lists(st.integers(0, 4), max_size=3),
    dtype=st.sampled_from(["f4", "f8", ">f8", "i8", "u1", "?", ">i4"]),
    seed=st.integers(0, 99),
    stamp=st.none() | st.floats(allow_nan=False, allow_infinity=False),
)
def test_any_array_of_numbers_and_any_stamp_come_back(tmp_path_factory, whole_map, shape, dtype, seed, stamp):
    array = np.random.default_rng(seed).normal(0, 50, shape).astype(dtype)
    path = tmp_path_factory.getbasetemp() / "arrays.db"
    path.write_bytes(whole_map[0].read_bytes())
    with PlaceDatabase.open(path) as database:
        database.add(Place(4, stamp), {"a": array, "transposed": array.T})
        stored = database[4]
    assert stored.place.stamp_s == stamp
    assert stored.arrays["a"].shape == array.shape
    np.testing.assert_array_equal(stored.arrays["a"], array)
    np.testing.assert_array_equal(stored.arrays["transposed"], array.T)
    assert stored.arrays["a"].dtype == np.dtype(dtype).newbyteorder("<")


def test_the_map_brings_its_model_along(database, encoder):
    loaded = database.load_encoder()
    assert loaded.fingerprint == encoder.fingerprint == database.fingerprint
    assert same_encoding(loaded.describe(boxes(3)), encoder.describe(boxes(3)))


WRITER = """
    import sys
    from depthprint import PlaceDatabase
    from depthprint.encoding_arrays import pack_encoding
    from depthprint.place import Place
    from synthetic import boxes

    with PlaceDatabase.open(sys.argv[1]) as database:
        arrays = pack_encoding(database.load_encoder().describe(boxes(0)))
        while True:
            with database.transaction():
                database.add(Place(len(database)), arrays)
                if len(database) == 30:
                    database._connection.execute("PRAGMA cache_spill = 1")
                    for number in range(2000):  # more than the page cache holds: the file itself is being changed
                        database.add(Place(len(database)), arrays)
                    print("in the middle", flush=True)
                    sys.stdin.read()
            print(len(database), flush=True)
"""


def test_every_committed_place_survives_a_kill(database, encoder):
    database.close()
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    writer = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(WRITER), str(database.path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )
    try:
        lines = [writer.stdout.readline().strip() for _ in range(30)]
        size = database.path.stat().st_size
    finally:
        writer.send_signal(signal.SIGKILL)
        writer.communicate()
    assert lines == [*map(str, range(1, 30)), "in the middle"]
    assert [path.name for path in database.path.parent.iterdir() if path.name.endswith("-journal")]
    expected = encoder.describe(boxes(0))
    for read_only in (True, False):
        with PlaceDatabase.open(database.path, read_only=read_only) as again:
            assert len(again) == 29
            assert all(
                same_encoding(unpack_encoding(stored.arrays, again.fingerprint), expected) for stored in again
            )
    with PlaceDatabase.open(database.path) as again:
        again.add(Place(29), pack_encoding(expected))
    assert database.path.stat().st_size < size
    assert [path.name for path in database.path.parent.iterdir()] == [database.path.name]


def test_a_transaction_that_fails_leaves_the_map_as_it_was(database, encodings):
    fill(database, encodings[:2])

    def fill_and_fail() -> None:
        with database.transaction():
            database.begin_run("never")
            fill(database, encodings[2:])
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fill_and_fail()
    assert len(database) == 2
    assert [run.name for run in database.runs] == [""]
    fill(database, encodings[2:4])
    assert [stored.number_in_run for stored in database] == [0, 1, 2, 3]
    with pytest.raises(IndexError):
        database[4]


@settings(max_examples=120, deadline=None)
@given(position=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_is_refused_or_does_no_harm(tmp_path_factory, whole_map, position, bit):
    whole, truth = whole_map[0].read_bytes(), whole_map[1]
    content = bytearray(whole)
    content[int(position * len(content))] ^= 1 << bit
    path = tmp_path_factory.getbasetemp() / "flipped.db"
    path.write_bytes(content)
    try:
        with PlaceDatabase.open(path) as database:
            runs, stored = database.runs, list(database)
            fingerprint = database.fingerprint
    except DataError as error:
        message = str(error)
    else:
        message = ""
    if message:
        assert str(path) in message
        return
    assert fingerprint.encode() in whole
    assert [run.name for run in runs] == [""]
    assert [place.place.number for place in stored] == [0, 1, 2, 3]
    for number, place in enumerate(stored):
        np.testing.assert_array_equal(place.arrays["truth"], truth)
        np.testing.assert_array_equal(place.place.T_world_sensor, pose(number))


@pytest.mark.parametrize("word", [b"CREATE TABLE map", b"TEXT NOT NULL", b"INTEGER NOT NULL"])
def test_a_schema_that_is_no_text_any_more_is_refused_by_name(word, tmp_path, whole_map):
    content = whole_map[0].read_bytes()
    path = tmp_path / "flipped.db"
    for position in range(content.index(word) + len(word) - 4, content.index(word) + len(word)):
        path.write_bytes(content[:position] + bytes([content[position] ^ 0x80]) + content[position + 1 :])
        with pytest.raises(DataError, match=r"flipped\.db"):
            PlaceDatabase.open(path)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def overwritten(path: Path) -> None:
    path.write_bytes(b"no map " * 1000)


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def another_database(path: Path) -> None:
    path.unlink()
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE cookies (name TEXT)")
    connection.close()


def newer(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA user_version = 7")
    connection.close()


def without_table(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.execute("DROP TABLE arrays")
    connection.close()


def with_other_facts(path: Path) -> None:
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("UPDATE map SET facts = replace(facts, 'handheld', 'street')")
    connection.close()


def with_a_moved_place(path: Path) -> None:
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("UPDATE places SET T_world_sensor = zeroblob(128) WHERE number = 2")
    connection.close()


def with_a_lost_array(path: Path) -> None:
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("DELETE FROM arrays WHERE place = 2 AND position = 1")
    connection.close()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (cut, "whole place database"),
        (overwritten, "whole place database"),
        (emptied, "place database of depthprint"),
        (another_database, "place database of depthprint"),
        (newer, "version 1, got version 7"),
        (without_table, "whole place database"),
        (with_other_facts, "altered facts"),
        (with_a_moved_place, "place 2: expected a whole place"),
        (with_a_lost_array, "place 2: expected a whole place"),
        (Path.unlink, "no such place database"),
    ],
)
def test_a_damaged_or_other_file_is_refused_by_name(database, encodings, damage, message):
    fill(database, encodings)
    database.close()
    damage(database.path)
    with pytest.raises(DataError, match=message) as caught, PlaceDatabase.open(database.path) as opened:
        list(opened)
    assert database.path.name in str(caught.value)


def test_a_map_of_another_model_is_refused(database):
    other = load_shipped_encoder("street")
    database.close()
    with pytest.raises(FingerprintError, match=other.fingerprint):
        PlaceDatabase.open(database.path, fingerprint=other.fingerprint)
    with PlaceDatabase.open(database.path) as again, pytest.raises(FingerprintError, match=r"a map\.db"):
        LoopClosureDetector(ComplexityRecognizer(other), threshold=0.5, database=again)


def test_what_cannot_be_stored_is_refused_and_stores_nothing(database):
    with pytest.raises(DataError, match="expected place 0 to be added next, got 1"):
        database.add(Place(1), {})
    with pytest.raises(DataError, match="frame 0: expected a finite pose"):
        database.add(Place(0, T_world_sensor=np.eye(3)), {})
    with pytest.raises(DataError, match="frame 0: expected a finite stamp"):
        database.add(Place(0, stamp_s=np.inf), {})
    with pytest.raises(DataError, match="'a': expected numbers"):
        database.add(Place(0), {"a": np.array(["b"])})
    assert (len(database), database.runs) == (0, ())


def test_a_map_is_not_overwritten_nor_changed_by_a_reader(database, encoder, encodings):
    with pytest.raises(SettingsError, match="this file exists"):
        PlaceDatabase.create(database.path, encoder)
    with (
        PlaceDatabase.open(database.path, read_only=True) as reader,
        pytest.raises(DataError, match="readonly"),
    ):
        fill(reader, encodings)
    with pytest.raises(SettingsError, match="voxel_m"):
        PlaceDatabase.create(database.path.with_name("b.db"), encoder, voxel_m=0.0)
    database.close()
    with pytest.raises(SettingsError, match="expected an open place database"):
        fill(database, encodings)


def test_two_writers_do_not_mix(database, encodings, monkeypatch):
    monkeypatch.setattr("depthprint.place_schema._BUSY_S", 0.05)
    with PlaceDatabase.open(database.path) as second, database.transaction():
        with pytest.raises(DataError, match="in use by another process"):
            fill(second, encodings)
        fill(database, encodings)
    assert len(database) == len(encodings)


def detector(encoder, **options) -> LoopClosureDetector:
    return LoopClosureDetector(
        ComplexityRecognizer(encoder), exclusion_gap=3, **({"threshold": 0.2} | options)
    )


@pytest.mark.parametrize("threshold", [0.2, None])
def test_a_reopened_detector_goes_on_as_if_it_had_not_stopped(tmp_path, encoder, threshold):
    options = {"threshold": threshold, "false_positive_rate": 0.2, "calibration_pairs": 2}
    straight = detector(encoder, **options)
    expected = [straight.process(boxes(seed), pose=pose(seed)) for seed in ROUTE]
    path = tmp_path / "map.db"
    found = []
    with PlaceDatabase.create(path, encoder) as database:
        before = detector(encoder, database=database, **options)
        found += [before.process(boxes(seed), pose=pose(seed)) for seed in ROUTE[:5]]
    with PlaceDatabase.open(path) as database:
        after = detector(encoder, database=database, **options)
        found += [after.process(boxes(seed), pose=pose(seed)) for seed in ROUTE[5:]]
        assert [stored.run for stored in database] == [0] * 5 + [1] * 4
    assert found == expected
    assert any(result.accepted and result.distance == 0 for result in found)
    assert [place.source for place in after.places] == [place.source for place in straight.places]
    np.testing.assert_array_equal(after.places[4].T_world_sensor, pose(4))


def test_a_frame_is_localised_in_a_saved_map(tmp_path, encoder):
    path = tmp_path / "map.db"
    with PlaceDatabase.create(path, encoder) as database:
        mapping = detector(encoder, database=database)
        for seed in range(6):
            mapping.add(boxes(seed), pose=pose(10.0 * seed), stamp=100.0 + seed)
    with PlaceDatabase.open(path, read_only=True) as database:
        localiser = LoopClosureDetector(
            ComplexityRecognizer(database.load_encoder()), exclusion_gap=0, threshold=0.6, database=database
        )
        assert not localiser.query(boxes(17)).accepted
        result = localiser.query(boxes(4, shift=1), k=2)
        assert (result.match, result.accepted) == (4, True)
        assert localiser.places[result.match].stamp_s == 104.0
        np.testing.assert_array_equal(localiser.places[result.match].T_world_sensor, pose(40.0))
        assert len(localiser) == len(database) == 6


def test_a_frame_that_the_recogniser_refuses_is_not_stored(database, encoder):
    mapping = detector(encoder, database=database)
    mapping.add(boxes(0))
    mapping.recognizer.add = lambda description: 17
    with pytest.raises(DepthprintError, match="stored it as place 17"):
        mapping.add(boxes(1))
    assert (len(mapping), len(database)) == (1, 1)


def test_a_recogniser_whose_places_cannot_be_stored_is_named(database):
    from depthprint.baselines.pixel_l2 import PixelL2Recognizer

    with pytest.raises(SettingsError, match="PixelL2Recognizer cannot be kept"):
        LoopClosureDetector(PixelL2Recognizer(), threshold=1.0, database=database)


def test_points_are_kept_where_the_map_asks_for_them(tmp_path, encoder):
    with PlaceDatabase.create(tmp_path / "map.db", encoder, voxel_m=0.5) as database:
        detector(encoder, database=database).add(boxes(2))
        points = database[0].arrays["points_xyz"]
    np.testing.assert_array_equal(points, voxel_points(boxes(2), 0.5))
    assert points.dtype == np.float32


def test_voxel_points_are_the_means_of_their_cells():
    image, voxel_m = boxes(1), 0.4
    points = image.points().reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    cells: dict[tuple[int, ...], list[np.ndarray]] = {}
    for point in points:
        cells.setdefault(tuple(np.floor(point / voxel_m).astype(int)), []).append(point)
    expected = np.array([np.mean(cells[key], axis=0) for key in sorted(cells)])
    thinned = voxel_points(image, voxel_m)
    np.testing.assert_allclose(thinned, expected, atol=1e-5)
    assert len(thinned) < len(points)
    with pytest.raises(SettingsError, match="voxel_m"):
        voxel_points(image, np.nan)


def test_merged_maps_hold_both_runs_with_their_provenance(tmp_path, encoder, encodings):
    for name, chosen in (("a", encodings[:4]), ("b", encodings[2:])):
        with PlaceDatabase.create(tmp_path / f"{name}.db", encoder) as database:
            database.begin_run(f"drive {name}", simulated=name == "b", world_up=(0.0, -1.0, 0.0))
            fill(database, chosen)
    T_a_b = pose(1000.0)
    calls = []
    count = merge_maps(
        tmp_path / "a.db",
        tmp_path / "b.db",
        tmp_path / "c.db",
        T_first_second=T_a_b,
        progress=lambda *step: calls.append(step),
    )
    assert count == 8
    assert calls[-1] == (8, 8)
    with PlaceDatabase.open(tmp_path / "c.db") as merged:
        assert [run.name for run in merged.runs] == ["drive a", "drive b"]
        assert [run.simulated for run in merged.runs] == [False, True]
        assert merged.runs[1].world_up == (0.0, -1.0, 0.0)
        stored = list(merged)
        assert [place.place.number for place in stored] == list(range(8))
        assert [(place.run, place.number_in_run) for place in stored] == [
            (run, n) for run in (0, 1) for n in range(4)
        ]
        for place, encoding in zip(stored, encodings[:4] + encodings[2:], strict=True):
            assert same_encoding(unpack_encoding(place.arrays, merged.fingerprint), encoding)
        np.testing.assert_array_equal(stored[2].place.T_world_sensor, pose(2))
        np.testing.assert_array_equal(stored[6].place.T_world_sensor, T_a_b @ pose(2))
        localiser = LoopClosureDetector(
            ComplexityRecognizer(encoder), exclusion_gap=0, threshold=0.2, database=merged
        )
        assert [m.place for m in localiser.query(boxes(3), k=2).matches] == [3, 5]


def test_maps_that_do_not_fit_are_not_merged(tmp_path, encoder, encodings):
    with PlaceDatabase.create(tmp_path / "a.db", encoder) as database:
        fill(database, encodings)
    with PlaceDatabase.create(tmp_path / "b.db", load_shipped_encoder("street")):
        pass
    with pytest.raises(FingerprintError, match=r"b\.db.*a\.db"):
        merge_maps(tmp_path / "a.db", tmp_path / "b.db", tmp_path / "c.db")
    with pytest.raises(SettingsError, match=r"b\.db.*exists"):
        merge_maps(tmp_path / "a.db", tmp_path / "a.db", tmp_path / "b.db")
    with pytest.raises(DataError, match="T_first_second"):
        merge_maps(tmp_path / "a.db", tmp_path / "a.db", tmp_path / "c.db", T_first_second=np.zeros((4, 4)))
    with_a_moved_place(tmp_path / "a.db")
    with pytest.raises(DataError, match="place 2"):
        merge_maps(tmp_path / "a.db", tmp_path / "a.db", tmp_path / "c.db")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.db", "b.db"]


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({}, "'weights_0', got none"),
        ({"weights_0": np.ones(2), "points_0": np.ones((2, 3))}, "'vectors_0'"),
        ({"weights_0": np.ones(2), "points_0": np.ones((3, 3)), "vectors_0": np.ones((1, 1))}, "weights"),
    ],
)
def test_arrays_that_are_no_encoding_are_refused(arrays, message):
    with pytest.raises(DataError, match=message):
        unpack_encoding(arrays, "f")
