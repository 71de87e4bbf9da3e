"""Name the class of one depth image by its nearest examples."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from depthprint.errors import DataError
from depthprint.runs.depth_files import labelled_files, read_labelled, read_view
from depthprint.runs.models import require_model
from depthprint.runs.stages import Stages, silent

__all__ = ["NearClass", "run_classify"]


@dataclass(frozen=True)
class NearClass:
    """A class, the distance of its nearest example, and that example."""

    label: str
    distance: float
    example: Path


def run_classify(
    query: Path,
    against: Path,
    *,
    preset: str | None = None,
    model: Path | None = None,
    k: int = 5,
    stages: Stages = silent,
) -> list[NearClass]:
    """Rank the classes of a folder by their example nearest to a depth image, the nearest ``k`` classes first.

    The query itself, where it lies in the folder, is no example. The preset is ``object`` unless said otherwise.
    Raises DataError naming the file or folder that cannot be used.
    """
    from depthprint.classification import NearestComplexityClassifier
    from depthprint.encoder_ablations import suited_encoder
    from depthprint.objects.distances import complexity_distances

    image = read_view(query)
    files = [file for file in labelled_files(against) if file.path.resolve() != query.resolve()]
    if not files:
        raise DataError(f"{against}: expected examples other than the query itself")
    encoder = suited_encoder(require_model(model, preset, "object"), image)
    description = encoder.describe(image)
    examples = encoder.describe_many(read_labelled(files, against), stages("encode the examples"))
    distances = complexity_distances(encoder, [description], examples)
    classifier = NearestComplexityClassifier().fit(None, [file.label for file in files])
    ranking = classifier.predict_with_distances(distances)
    return [
        NearClass(str(label), float(distance), files[neighbour].path)
        for label, distance, neighbour in zip(
            ranking.labels[0][:k], ranking.distances[0][:k], ranking.neighbours[0][:k], strict=True
        )
    ]
