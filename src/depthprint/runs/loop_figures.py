"""Figures of a run on a sequence: path, precision and recall, difference matrix, atoms, and the best loop's flow."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import RangeSequence

if TYPE_CHECKING:
    from depthprint.encoder import Encoder
    from depthprint.encoding import Encoding
    from depthprint.evaluation.loop_record import LoopRecord
    from depthprint.evaluation.loops import LoopEvaluation
    from depthprint.range_image import RangeImage
    from depthprint.run_folder import RunFolder
    from depthprint.runs.found_loops import FoundLoops, SampledDistances
    from depthprint.settings import StreamSettings
    from depthprint.signature import Signature
    from depthprint.visualization.flow import PlacedClusters

__all__ = ["draw_evaluation_figures", "draw_loop_figures", "draw_pair_flow"]

FloatArray = npt.NDArray[np.float64]


def draw_loop_figures(
    run: RunFolder,
    sequence: RangeSequence,
    encoder: Encoder,
    evaluation: LoopEvaluation,
    found: FoundLoops,
    sample: SampledDistances,
) -> list[Path]:
    """Draw what there is to draw: path with poses, precision and recall with truth, the rest always."""
    from depthprint.visualization.atoms import draw_atoms
    from depthprint.visualization.range_image import draw_range_image

    data, simulated = sequence.name, sequence.simulated
    method = evaluation.methods[0]
    drawn = []
    if sequence.poses is not None:
        drawn.append(_draw_path(run, sequence, evaluation, found))
        if evaluation.truth.has_positive.any():
            drawn.append(_draw_precision_recall(run, evaluation))
    drawn.append(_draw_differences(run, sequence, sample, method.name))
    best = _best_loop(found)
    if best is not None:
        images = sequence[best.query], sequence[best.match]
        encodings = encoder.describe(images[0]), encoder.describe(images[1])
        for image, frame, name in zip(images, (best.query, best.match), ("query", "match"), strict=True):
            drawn.append(
                draw_range_image(
                    image,
                    run.figure(f"best-loop-{name}"),
                    data=data,
                    simulated=simulated,
                    what=f"frame {frame}",
                )
            )
        drawn.append(
            draw_pair_flow(
                encoder,
                images,
                encodings,
                run.figure("best-loop-flow"),
                titles=(f"frame {best.query}", f"frame {best.match}"),
                data=data,
                simulated=simulated,
            )
        )
    for number, stream in enumerate(encoder.streams):
        pictures = _atom_pictures(stream.dictionary.atoms, encoder.settings.streams[number])
        drawn.append(draw_atoms(pictures, run.figure(f"atoms-{number}"), data="the model's own data"))
    return drawn


def draw_evaluation_figures(
    run: RunFolder, sequence: RangeSequence, evaluation: LoopEvaluation
) -> list[Path]:
    """Draw all methods' precision and recall, and each method's path at its last threshold without a false loop."""
    from depthprint.evaluation.ground_truth import horizontal_positions_m
    from depthprint.visualization.path import PathLoops, draw_path

    if not evaluation.truth.has_positive.any() or sequence.poses is None:
        return []
    drawn = [_draw_precision_recall(run, evaluation)]
    for method in evaluation.methods:
        limit = -method.metrics.threshold_at_100_precision
        if np.isfinite(limit):
            drawn.append(
                draw_path(
                    horizontal_positions_m(sequence.poses, sequence.world_up),
                    PathLoops.at_threshold(method, limit),
                    run.figure(f"path-{method.name}"),
                    method=f"{method.name} at 100 % precision",
                    data=sequence.name,
                    simulated=sequence.simulated,
                )
            )
    return drawn


def draw_pair_flow(
    encoder: Encoder,
    images: tuple[RangeImage, RangeImage],
    encodings: tuple[Encoding, Encoding],
    path: Path,
    *,
    titles: tuple[str, str] = ("A", "B"),
    data: str = "",
    simulated: bool = False,
) -> Path:
    """Draw what flows between two images in the first stream, at the shift at which they are nearest."""
    from depthprint.emd import emd, ground_distances
    from depthprint.encoding import ground_distance
    from depthprint.visualization.flow import draw_flow

    stream = encoder.settings.streams[0]
    first, second = (encoding.signatures[0] for encoding in encodings)
    shifts = encoder.shifts()
    offset = None
    if shifts is not None:
        index = encoder.make_index()
        index.add(encodings[1].signatures)
        offset = shifts[0][index.query(encodings[0].signatures, k=1)[0][2]]
    ground = ground_distance(stream, encoder.settings)
    result = emd(first, second, masses=stream.masses, ground=ground, shift=offset, return_flow=True)
    costs = ground_distances(first, second, ground, offset)
    flow = np.zeros((len(first), len(second))) if result.flow is None else result.flow
    sides = [
        _placed(encoder, image, signature, title)
        for image, signature, title in zip(images, (first, second), titles, strict=True)
    ]
    what = f"view '{stream.view}', EMD {result.value:.3g}"
    return draw_flow(sides[0], sides[1], flow, path, costs=costs, what=what, data=data, simulated=simulated)


def _placed(encoder: Encoder, image: RangeImage, signature: Signature, title: str) -> PlacedClusters:
    from depthprint.encoding import ground_distance
    from depthprint.visualization.flow import PlacedClusters

    stream = encoder.settings.streams[0]
    view, _, _ = encoder.codes(image)
    shown = view.channels[0] if view.depth is None else view.depth
    picture = np.where(view.support, shown, np.nan).astype(np.float64)
    height, width = picture.shape
    dims = ground_distance(stream, encoder.settings).position_dims
    places = _spread_evenly(len(signature))
    if dims:
        places = np.full((len(signature), 2), 0.5)
        places[:, :dims] = signature.points[:, -dims:] / stream.position_weight
    weights = signature.weights / signature.mass if stream.masses == "balanced" else signature.weights
    return PlacedClusters(picture, places * (width, height) - 0.5, weights, title)


def _spread_evenly(n: int) -> FloatArray:
    """Places on a grid for atoms of the whole image, which have none of their own."""
    side = max(1, int(np.ceil(np.sqrt(n))))
    numbers = np.arange(n)
    return (np.stack([numbers % side, numbers // side], axis=1) + 0.5) / side


def _atom_pictures(atoms: FloatArray, stream: StreamSettings) -> FloatArray:
    """Atoms as pictures (k, h, w, c); a coded vector holds one channel after the other."""
    channels = {"normals": 3, "polar": len(stream.channels)}.get(stream.view, 1)
    pixels = atoms.shape[1] // channels
    if stream.atoms == "image":
        height, width = stream.size, pixels // stream.size
    else:
        height, width = stream.patch_shape
        height, width = height or pixels // width, width or pixels // height
    return np.moveaxis(atoms.reshape(len(atoms), channels, height, width), 1, 3)


def _draw_path(
    run: RunFolder, sequence: RangeSequence, evaluation: LoopEvaluation, found: FoundLoops
) -> Path:
    from depthprint.evaluation.ground_truth import horizontal_positions_m
    from depthprint.visualization.path import PathLoops, draw_path

    limit = -np.inf if found.threshold is None else found.threshold
    return draw_path(
        horizontal_positions_m(np.asarray(sequence.poses), sequence.world_up),
        PathLoops.at_threshold(evaluation.methods[0], limit),
        run.figure("path"),
        method=evaluation.methods[0].name,
        data=sequence.name,
        simulated=sequence.simulated,
    )


def _draw_precision_recall(run: RunFolder, evaluation: LoopEvaluation) -> Path:
    from depthprint.visualization.precision_recall import draw_precision_recall

    return draw_precision_recall(
        {method.name: method.queries for method in evaluation.methods},
        run.figure("precision-recall"),
        data=evaluation.data,
        simulated=evaluation.simulated,
    )


def _draw_differences(run: RunFolder, sequence: RangeSequence, sample: SampledDistances, method: str) -> Path:
    from depthprint.visualization.difference_matrix import draw_difference_matrix

    n = len(sample.frames)
    thinned = "" if n == len(sequence) else f", {n} of {len(sequence)} frames"
    return draw_difference_matrix(
        sample.distances,
        run.figure("difference-matrix"),
        method=method,
        data=sequence.name + thinned,
        simulated=sequence.simulated,
        label="information distance",
        frames=(int(sample.frames[0]), int(sample.frames[-1])),
    )


def _best_loop(found: FoundLoops) -> LoopRecord | None:
    """The surest loop; where none was accepted, the nearest match."""
    matched = found.loops or tuple(r for r in found.records if r.match >= 0)
    return min(matched, key=lambda r: r.distance) if matched else None
