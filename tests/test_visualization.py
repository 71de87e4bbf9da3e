from __future__ import annotations

import cv2
import numpy as np
import pytest

from depthprint.errors import DataError, SettingsError
from depthprint.evaluation.loop_record import LoopRecord
from depthprint.evaluation.loops import MethodLoops
from depthprint.evaluation.metrics import QueryOutcomes, loop_metrics
from depthprint.projection import LaserRow, Pinhole, Spherical
from depthprint.range_image import RangeImage
from depthprint.visualization._style import titled
from depthprint.visualization.atoms import atom_grid, draw_atoms
from depthprint.visualization.confusion_matrix import draw_confusion_matrix
from depthprint.visualization.difference_matrix import _extent, draw_difference_matrix
from depthprint.visualization.flow import PlacedClusters, draw_flow
from depthprint.visualization.path import PathLoops, draw_path
from depthprint.visualization.precision_recall import draw_precision_recall
from depthprint.visualization.range_image import draw_range_image

GENERATOR = np.random.default_rng(0)


def picture(path) -> np.ndarray:
    """The figure as read back; it must be the folder's only file and large enough for a README."""
    assert [p.name for p in path.parent.iterdir()] == [path.name]
    image = cv2.imread(str(path))
    assert image is not None
    assert image.shape[1] >= 900
    return image


def share_of_color(image: np.ndarray, color: str) -> float:
    rgb = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    return float((np.abs(image.astype(int) - rgb[::-1]).max(axis=2) < 12).mean())


def queries() -> QueryOutcomes:
    return QueryOutcomes(
        np.array([4.0, 3.0, 2.0, 1.0]), np.array([1, 1, -1, 1]), np.array([True, True, False, True])
    )


@pytest.mark.parametrize(
    "projection",
    [Pinhole(60, 60, 31.5, 23.5, 64, 48), Spherical(256, 16), LaserRow(180, -np.pi / 2, np.pi / 180)],
)
def test_range_image_of_every_projection(tmp_path, projection):
    depth = (2 + GENERATOR.random((projection.height, projection.width))).astype(np.float32)
    depth[0, : projection.width // 4] = np.nan
    path = draw_range_image(
        RangeImage(depth, projection), tmp_path / "depth.png", data="made", simulated=True
    )
    assert picture(path).std() > 5


def test_hole_is_grey_and_an_image_of_holes_is_refused(tmp_path):
    depth = np.full((48, 64), 2.0, dtype=np.float32)
    depth[:, :32] = np.nan
    depth[0, 63] = 3.0
    camera = Pinhole(60, 60, 31.5, 23.5, 64, 48)
    assert (
        share_of_color(picture(draw_range_image(RangeImage(depth, camera), tmp_path / "d.png")), "#E8E8E8")
        > 0.15
    )
    with pytest.raises(DataError, match="frame 7"):
        draw_range_image(
            RangeImage(np.full((48, 64), np.nan), camera, source="frame 7"), tmp_path / "none.png"
        )


def test_atoms_keep_their_order_sign_and_channels():
    atoms = np.zeros((3, 2, 2))
    atoms[0], atoms[1] = 5.0, -0.1
    grid = atom_grid(atoms, columns=2)
    assert grid.shape == (7, 7, 3)
    assert (grid[1:3, 1:3] == 1).all()
    assert (grid[1:3, 4:6] == 0).all()
    assert (grid[4:6, 1:3] == 0.5).all()
    assert atom_grid(np.ones((1, 4, 2, 5))).shape == (6, 12, 3)
    red = np.zeros((1, 2, 2, 3))
    red[..., 0] = 1
    assert atom_grid(red)[1, 1].tolist() == [1.0, 0.5, 0.5]


def test_atoms_are_drawn_and_checked(tmp_path):
    picture(draw_atoms(GENERATOR.normal(size=(40, 8, 8)), tmp_path / "atoms.png", data="made"))
    with pytest.raises(DataError, match=r"\(64,\)"):
        atom_grid(np.ones(64))
    with pytest.raises(DataError, match="finite"):
        atom_grid(np.full((1, 2, 2), np.nan))
    with pytest.raises(SettingsError, match="column"):
        atom_grid(np.ones((1, 2, 2)), columns=0)


def test_flow_is_drawn_and_cannot_exceed_the_weights(tmp_path):
    first = PlacedClusters(
        GENERATOR.random((48, 64)), np.array([[5.0, 5.0], [50.0, 40.0]]), np.array([1.0, 2.0]), "a"
    )
    second = PlacedClusters(np.full((30, 40), np.nan), np.array([[20.0, 10.0]]), np.array([2.5]), "b")
    flow = np.array([[1.0], [1.5]])
    image = picture(draw_flow(first, second, flow, tmp_path / "flow.png", what="EMD 1.2"))
    assert share_of_color(image, "#0072B2") > 0.0005
    with pytest.raises(DataError, match="no more than the weights"):
        draw_flow(first, second, 2 * flow, tmp_path / "x.png")
    with pytest.raises(DataError, match=r"\(2, 1\)"):
        draw_flow(first, second, flow.T, tmp_path / "x.png")
    with pytest.raises(DataError, match="PlacedClusters"):
        PlacedClusters(np.ones((2, 2)), np.zeros((1, 2)), np.array([-1.0]))
    assert [p.name for p in tmp_path.iterdir()] == ["flow.png"]


def test_flow_of_empty_signatures_and_with_costs(tmp_path):
    empty = PlacedClusters(np.ones((10, 10)), np.empty((0, 2)), np.empty(0))
    one = PlacedClusters(np.ones((10, 10)), np.array([[5.0, 5.0]]), np.array([1.0]))
    image = picture(draw_flow(empty, one, np.empty((0, 1)), tmp_path / "flow.png"))
    assert share_of_color(image, "#0072B2") == 0  # nothing is moved
    picture(draw_flow(one, one, np.ones((1, 1)), tmp_path / "flow.png", costs=np.zeros((1, 1))))


def test_clusters_on_one_row_are_drawn_one_image_above_the_other(tmp_path):
    row = np.stack([np.arange(12.0), np.full(12, 9.5)], axis=1)
    side = PlacedClusters(GENERATOR.random((20, 12)), row, np.ones(12), "frame")
    path = draw_flow(side, side, np.eye(12), tmp_path / "flow.png", costs=GENERATOR.random((12, 12)))
    image = picture(path)
    blue = np.abs(image.astype(int) - [0xB2, 0x72, 0x00]).max(axis=2) < 12
    rows = np.flatnonzero(blue.sum(axis=1) > 0.1 * blue.shape[1])
    assert np.diff(rows).max() > 0.05 * image.shape[0]  # two bands of discs
    assert share_of_color(image, "#0072B2") > 0.005


def test_difference_matrix_shows_what_was_not_compared_in_grey(tmp_path):
    matrix = np.where(np.tri(50, dtype=bool), GENERATOR.random((50, 50)), np.nan)
    image = picture(draw_difference_matrix(matrix, tmp_path / "d.png", method="emd", data="made"))
    assert share_of_color(image, "#E8E8E8") > 0.1
    with pytest.raises(DataError, match="finite"):
        draw_difference_matrix(np.full((2, 2), np.nan), tmp_path / "none.png")
    with pytest.raises(DataError, match="two dimensions"):
        draw_difference_matrix(np.ones(3), tmp_path / "none.png")


def test_difference_matrix_of_every_fifth_frame_counts_frames():
    left, right, bottom, top = _extent((200, 200), (0, 995))
    assert (left, right, bottom, top) == (-2.5, 997.5, 997.5, -2.5)
    assert _extent((200, 200), None) is None


def test_precision_recall_draws_one_curve_a_method(tmp_path):
    path = draw_precision_recall({"emd": queries(), "pixel-l2": queries()}, tmp_path / "pr.png", data="made")
    image = picture(path)
    assert share_of_color(image, "#D55E00") > 0.001
    with pytest.raises(DataError, match="at least one"):
        draw_precision_recall({}, tmp_path / "none.png")
    hopeless = QueryOutcomes(np.array([1.0]), np.array([-1]), np.array([False]))
    with pytest.raises(DataError, match="'emd'"):
        draw_precision_recall({"emd": hopeless}, tmp_path / "none.png")


def test_loops_at_a_threshold_are_true_false_missed_or_unjudged():
    records = (
        LoopRecord(10, 1, 0.1, None, 1, True),
        LoopRecord(11, 2, 0.2, None, -1, True),
        LoopRecord(12, 3, 0.3, None, 0, False),
        LoopRecord(13, 4, 0.9, None, 1, True),
        LoopRecord(14, -1, float("nan"), None, 0, True),
    )
    outcomes = queries()
    method = MethodLoops("emd", records, outcomes, loop_metrics(outcomes), {}, 1.0, 1.0, 2.0)
    loops = PathLoops.at_threshold(method, 0.5)
    assert loops.true.tolist() == [[10, 1]]
    assert loops.false.tolist() == [[11, 2]]
    assert loops.unjudged.tolist() == [[12, 3]]
    assert loops.missed.tolist() == [11, 13, 14]


def test_path_shows_each_kind_of_loop_in_its_color(tmp_path):
    angle = np.linspace(0, 4 * np.pi, 200)
    positions_m = np.stack([30 * np.cos(angle), 20 * np.sin(angle)], axis=1)
    loops = PathLoops(
        true=np.array([[120, 20], [121, 21]]),
        false=np.array([[140, 80]]),
        missed=np.array([160, 161]),
        unjudged=np.array([[180, 80]]),
    )
    image = picture(draw_path(positions_m, loops, tmp_path / "path.png", method="emd", data="made"))
    for color in ("#009E73", "#D55E00", "#E69F00", "#0072B2"):
        assert share_of_color(image, color) > 5e-5
    with pytest.raises(DataError, match="frame 500"):
        draw_path(positions_m, PathLoops.without_truth(np.array([[500, 0]])), tmp_path / "none.png")
    with pytest.raises(DataError, match="finite"):
        draw_path(np.full((3, 2), np.nan), loops, tmp_path / "none.png")


def test_straight_path_without_loops_is_drawn(tmp_path):
    positions_m = np.stack([np.arange(50.0), np.zeros(50)], axis=1)
    image = picture(draw_path(positions_m, PathLoops.without_truth(np.empty((0, 2))), tmp_path / "path.png"))
    for color in ("#009E73", "#D55E00"):
        assert share_of_color(image, color) == 0


def test_title_says_simulated_once_and_fits():
    assert titled("what", "cad51 (simulated)", True) == "what\ncad51 (simulated)"
    assert titled("what", "cad51", True) == "what\ncad51 (simulated)"
    assert max(len(line) for line in titled("a word " * 40, "data " * 40, True).split("\n")) <= 68


@pytest.mark.parametrize("c", [3, 51])
def test_confusion_matrix_of_few_and_many_categories(tmp_path, c):
    counts = GENERATOR.integers(0, 5, (c, c)) + 20 * np.eye(c, dtype=int)
    counts[1] = 0
    picture(
        draw_confusion_matrix(counts, [f"category {k}" for k in range(c)], tmp_path / "c.png", simulated=True)
    )
    with pytest.raises(DataError, match="expected counts"):
        draw_confusion_matrix(counts[:2], ["a"] * c, tmp_path / "none.png")


def test_titles_say_simulated():
    assert titled("Path", "street", True) == "Path\nstreet (simulated)"
    assert titled("Path", "street", False) == "Path\nstreet"
    assert titled("Path", "", True) == "Path\nsimulated"
    assert titled("Path", "", False) == "Path"


def test_drawing_leaves_matplotlibs_settings_alone(tmp_path):
    import matplotlib

    before = dict(matplotlib.rcParams)
    draw_difference_matrix(np.eye(3), tmp_path / "d.png")
    assert dict(matplotlib.rcParams) == before
