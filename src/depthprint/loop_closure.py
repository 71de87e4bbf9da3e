"""Causal loop closure: each frame is compared with places old enough to be a return, then stored itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import ConvergenceError, DataError, FingerprintError, ModelError, SettingsError
from depthprint.loop_probability import match_probabilities, same_place_odds
from depthprint.loop_status import LoopResult, LoopStatus
from depthprint.loop_threshold import calibrate_threshold, pairs_needed
from depthprint.place import Place, checked_pose
from depthprint.range_image import RangeImage
from depthprint.recognizer import (
    PlaceMatch,
    PlaceRecognizer,
    ReconsideringRecognizer,
    StorableRecognizer,
)

if TYPE_CHECKING:
    from depthprint.place_database import PlaceDatabase

__all__ = ["LoopClosureDetector", "LoopResult", "LoopStatus", "Place", "calibrate_threshold"]

_PROPOSALS = 10
# Pairs of either kind before probabilities are told.
_LEARNED_FROM = 20


class LoopClosureDetector:
    """Online detector over any recogniser that is fitted and still empty.

    recognizer: holds the places; use it through the detector only, so that the numbers agree.
    exclusion_gap: place j may be a loop of frame i when i - j > exclusion_gap.
    threshold: largest distance that closes a loop. None: set anew at each query by ``calibrate_threshold``
        from distances of earlier frames to places beyond their gap, ``calibration_pairs`` drawn per frame
        with ``seed``; until 1 / false_positive_rate pairs were seen, the status is CALIBRATING. Costs that
        many distances a frame, and keeps every description.
    false_positive_rate: share of pairs, see ``calibrate_threshold``; only with threshold None.
    min_places: places old enough that there must be before anything is compared.
    database: a map on disk. Its places are taken up first, in their order, as if they had been added here; each place
        added from then on is committed to it before it can be queried.
    far_m: with poses (of odometry, say), places further away than this serve the calibration whatever their age,
        and nearer ones do not; without, age alone decides.
    probabilities: estimate how probable the match is, and that the place is new (``loop_probability``): frames next
        to each other in time stand for one place, far ones for different places. Costs as a threshold of None. Pairs
        know nothing of earlier frames: where these support a match, its distance, and so its odds, have that too.
    ambiguity: a match is AMBIGUOUS when another proposal, more than ``neighbourhood`` places away, has a distance
        under (1 + ambiguity) times its own. None: not looked at.
    consistent_frames: a match is INCONSISTENT_IN_TIME unless one of so many processed frames before had its best
        proposal within ``neighbourhood`` places of it. 0: not looked at.
    A match that a geometric check refused is FAILED_GEOMETRY; for methods that check, a threshold of 1 closes a
    loop wherever geometry accepts.
    Raises SettingsError for values out of range and for a recogniser whose places cannot be stored, FingerprintError
    for a map of another model, DataError for a damaged one.
    """

    def __init__(
        self,
        recognizer: PlaceRecognizer,
        *,
        exclusion_gap: int = 50,
        threshold: float | None,
        min_places: int = 1,
        false_positive_rate: float = 1e-3,
        calibration_pairs: int = 10,
        seed: int = 0,
        database: PlaceDatabase | None = None,
        far_m: float | None = None,
        probabilities: bool = False,
        ambiguity: float | None = None,
        consistent_frames: int = 0,
        neighbourhood: int = 10,
    ) -> None:
        if exclusion_gap < 0 or min_places < 1 or calibration_pairs < 1:
            raise SettingsError(
                "LoopClosureDetector: expected exclusion_gap >= 0, min_places >= 1, calibration_pairs >= 1, "
                f"got {exclusion_gap}, {min_places} and {calibration_pairs}"
            )
        if threshold is not None and not math.isfinite(threshold):
            raise SettingsError(f"LoopClosureDetector: expected a finite threshold or None, got {threshold}")
        if not 0 < false_positive_rate < 1:
            raise SettingsError(
                f"LoopClosureDetector: expected false_positive_rate in (0, 1), got {false_positive_rate}"
            )
        for name, value in (("far_m", far_m), ("ambiguity", ambiguity)):
            if value is not None and not value > 0:
                raise SettingsError(f"LoopClosureDetector: expected {name} > 0 or None, got {value}")
        if consistent_frames < 0 or neighbourhood < 0:
            raise SettingsError(
                "LoopClosureDetector: expected consistent_frames >= 0 and neighbourhood >= 0, "
                f"got {consistent_frames} and {neighbourhood}"
            )
        self.recognizer = recognizer
        self.far_m = far_m
        self.probabilities = probabilities
        self.ambiguity = ambiguity
        self.consistent_frames = consistent_frames
        self.neighbourhood = neighbourhood
        self.exclusion_gap = exclusion_gap
        self.min_places = min_places
        self.false_positive_rate = false_positive_rate
        self.calibration_pairs = calibration_pairs
        self.seed = seed
        self._fixed_threshold = threshold
        self._places: list[Place] = []
        self._descriptions: list[Any] = []
        self._far_distances: list[float] = []
        self._near_distances: list[float] = []
        self._best_of: dict[int, int] = {}
        self._map: tuple[PlaceDatabase, StorableRecognizer] | None = None
        if database is not None:
            self._take_up(database)

    def __len__(self) -> int:
        return len(self._places)

    @property
    def places(self) -> tuple[Place, ...]:
        """Places stored so far, by number."""
        return tuple(self._places)

    @property
    def threshold(self) -> float | None:
        """Threshold in force for the next query, None while there are too few pairs to calibrate one."""
        if self._fixed_threshold is not None:
            return self._fixed_threshold
        if len(self._far_distances) < pairs_needed(self.false_positive_rate):
            return None
        return calibrate_threshold(self._far_distances, self.false_positive_rate)

    def query(self, image: RangeImage, k: int = 1) -> LoopResult:
        """Look for the place of a frame without storing it; up to k proposals.

        Raises DataError for a frame that is no RangeImage or holds no return, SettingsError for k < 1.
        """
        return self._query(self._describe(image), k)

    def add(self, image: RangeImage, pose: npt.ArrayLike | None = None, stamp: float | None = None) -> int:
        """Store a frame as a place, without comparing it, and return its number.

        pose: (4, 4) T_world_sensor; stamp: seconds, by default the frame's own.
        Raises DataError as ``query`` does, or for a pose that is not (4, 4) and finite.
        """
        return self._add(self._describe(image), image, pose, stamp)

    def process(
        self, image: RangeImage, k: int = 1, pose: npt.ArrayLike | None = None, stamp: float | None = None
    ) -> LoopResult:
        """Query, then add, describing the frame once."""
        description = self._describe(image)
        result = self._query(description, k)
        self._add(description, image, pose, stamp)
        if result.match is not None:
            self._best_of[result.query] = result.match
        return result

    def reconsider(self, number: int, k: int = 1) -> LoopResult:
        """Answer for a frame processed a little earlier, by what the frames since say too: later, but surer.

        A road entered from a bend, say, is known by the frames that follow. number: of the frame as a place; the
        recogniser says how far back it may lie (the detector's: one of the last 16 processed).
        Raises SettingsError for a recogniser that cannot, or another frame.
        """
        recognizer = self.recognizer
        if not isinstance(recognizer, ReconsideringRecognizer):
            raise SettingsError(
                f"LoopClosureDetector: a {type(recognizer).__name__} cannot answer for an earlier frame again"
            )
        if not 0 <= number < len(self._places):
            raise SettingsError(
                f"LoopClosureDetector: expected the number of a place, 0 to {len(self._places) - 1}, got {number}"
            )
        return self._answer(number, k, lambda asked, _: recognizer.reconsider(number, asked))

    def _describe(self, image: RangeImage) -> Any:
        frame = f"frame {len(self._places)}"
        if not isinstance(image, RangeImage):
            raise DataError(f"{frame}: expected a RangeImage, got {type(image).__name__}")
        if not np.isfinite(image.ranges_m).any():
            source = f" ({image.source})" if image.source else ""
            raise DataError(f"{frame}{source}: expected at least one valid range, got none")
        return self.recognizer.describe(image)

    def _query(self, description: Any, k: int) -> LoopResult:
        return self._answer(
            len(self._places),
            k,
            lambda asked, candidates: self.recognizer.query(description, asked, limit=candidates),
        )

    def _answer(self, number: int, k: int, ask: Callable[[int, int], list[PlaceMatch]]) -> LoopResult:
        if k < 1:
            raise SettingsError(f"LoopClosureDetector: expected k >= 1, got {k}")
        candidates = max(0, number - self.exclusion_gap)
        threshold = self.threshold

        def result(
            status: LoopStatus, matches: tuple[PlaceMatch, ...] = (), p: tuple[float, float] | None = None
        ) -> LoopResult:
            return LoopResult(
                number,
                status,
                matches,
                threshold,
                candidates,
                self.exclusion_gap,
                self.min_places,
                *((None, None) if p is None else p),
            )

        if candidates < self.min_places:
            return result(LoopStatus.TOO_FEW_PLACES)
        # Whether a match is ambiguous shows only beside other proposals.
        asked = k if self.ambiguity is None else max(k, _PROPOSALS)
        matches = tuple(ask(asked, candidates))
        if not matches:
            return result(LoopStatus.NO_MATCH)
        for match in matches:
            self._check(match.distance, match.place)
            if not 0 <= match.place < candidates:
                raise ModelError(
                    f"frame {number}: the recogniser proposed place {match.place}, "
                    f"expected one below {candidates}"
                )
        status, rival = self._decide(matches, threshold, number)
        shown = matches[:k] if rival is None else (matches[0], rival, *matches[1:k])[: max(2, k)]
        return result(status, shown, self._probabilities(matches, candidates))

    def _decide(
        self, matches: tuple[PlaceMatch, ...], threshold: float | None, number: int
    ) -> tuple[LoopStatus, PlaceMatch | None]:
        """Status of the best match, and the place that makes it ambiguous."""
        best = matches[0]
        if best.verification is not None and not best.verification.accepted:
            return LoopStatus.FAILED_GEOMETRY, None
        if threshold is None:
            return LoopStatus.CALIBRATING, None
        if best.distance > threshold:
            return LoopStatus.ABOVE_THRESHOLD, None
        if self.ambiguity is not None:
            for other in matches[1:]:
                apart = abs(other.place - best.place) > self.neighbourhood
                if apart and other.distance <= best.distance * (1 + self.ambiguity):
                    return LoopStatus.AMBIGUOUS, other
        if self.consistent_frames:
            recent = range(number - self.consistent_frames, number)
            before = (self._best_of[i] for i in recent if i in self._best_of)
            if not any(abs(place - best.place) <= self.neighbourhood for place in before):
                return LoopStatus.INCONSISTENT_IN_TIME, None
        return LoopStatus.ACCEPTED, None

    def _probabilities(self, matches: tuple[PlaceMatch, ...], candidates: int) -> tuple[float, float] | None:
        """Probability of the best match, and of a new place."""
        fewest = min(len(self._near_distances), len(self._far_distances))
        if not self.probabilities or fewest < _LEARNED_FROM:
            return None
        odds = same_place_odds(
            [match.distance for match in matches], self._near_distances, self._far_distances
        )
        shares = match_probabilities(odds, candidates)
        return float(shares[0]), float(shares[-1])

    def _add(
        self, description: Any, image: RangeImage, pose: npt.ArrayLike | None, stamp: float | None
    ) -> int:
        number = len(self._places)
        T_world_sensor = None if pose is None else checked_pose(pose, number)
        stamp_s = image.stamp_s if stamp is None else float(stamp)
        place = Place(number, stamp_s, T_world_sensor, image.source)
        if self._map is None:
            return self._store(place, description)
        database, recognizer = self._map
        arrays = recognizer.pack(description)
        if database.voxel_m is not None:
            from depthprint.voxels import voxel_points

            arrays.setdefault("points_xyz", voxel_points(image, database.voxel_m))
        # The place is committed only once the recogniser has taken it, so that neither holds one more than the other.
        with database.transaction():
            database.add(place, arrays)
            return self._store(place, description)

    def _store(self, place: Place, description: Any) -> int:
        learning = self._fixed_threshold is None or self.probabilities
        far = self._sample_far_distances(description, place.number, place.T_world_sensor) if learning else []
        near = self._sample_near_distance(description, place.number) if self.probabilities else []
        stored = self.recognizer.add(description)
        if stored != place.number:
            raise ModelError(
                f"frame {place.number}: the recogniser stored it as place {stored}; the detector needs one "
                "that is empty at its start and that nothing else adds to"
            )
        if learning:
            self._far_distances.extend(far)
            self._near_distances.extend(near)
            self._descriptions.append(description)
        self._places.append(place)
        return place.number

    def _take_up(self, database: PlaceDatabase) -> None:
        recognizer = self.recognizer
        if not isinstance(recognizer, StorableRecognizer):
            raise SettingsError(
                f"LoopClosureDetector: the places of a {type(recognizer).__name__} cannot be kept in a database"
            )
        if recognizer.fingerprint != database.fingerprint:
            raise FingerprintError(
                f"{database.path}: expected a map made by model {recognizer.fingerprint}, "
                f"got one of {database.fingerprint}"
            )
        for stored in database:
            self._store(stored.place, recognizer.unpack(stored.arrays))
        self._map = database, recognizer

    def _sample_far_distances(
        self, description: Any, number: int, T_world_sensor: npt.NDArray[np.float64] | None
    ) -> list[float]:
        far = self._far_places(number, T_world_sensor)
        if not len(far):
            return []
        # Seeded by the frame's number, so that the sample does not depend on what else was asked before.
        rng = np.random.default_rng((self.seed, number))
        drawn = np.sort(rng.choice(far, size=min(len(far), self.calibration_pairs), replace=False))
        return self._distances(description, drawn)

    def _far_places(
        self, number: int, T_world_sensor: npt.NDArray[np.float64] | None
    ) -> npt.NDArray[np.int64]:
        """Places known to be others: far away by the poses, else old enough."""
        if self.far_m is None or T_world_sensor is None:
            return np.arange(max(0, number - self.exclusion_gap), dtype=np.int64)
        far = [
            place.number
            for place in self._places
            if place.T_world_sensor is not None
            and np.linalg.norm(place.T_world_sensor[:3, 3] - T_world_sensor[:3, 3]) > self.far_m
        ]
        return np.array(far, dtype=np.int64)

    def _sample_near_distance(self, description: Any, number: int) -> list[float]:
        return self._distances(description, [number - 1]) if number else []

    def _distances(self, description: Any, places: Sequence[int] | npt.NDArray[np.int64]) -> list[float]:
        found = [float(self.recognizer.distance(description, self._descriptions[j])) for j in places]
        for place, distance in zip(places, found, strict=True):
            self._check(distance, int(place))
        return found

    def _check(self, distance: float, place: int) -> None:
        if not math.isfinite(distance):
            raise ConvergenceError(
                f"frame {len(self._places)}: the recogniser's distance to place {place} is {distance}"
            )
