"""From a picture of the part to what counts for its pose, and to the session and back.

The drawing is laid where the part is believed to be, the lines are measured, a pose is
found from them, and the drawing is laid there: some times, until nothing moves. At first
every line that was found leads on; in the end only those count that lie where the others
put them. Lines that do not fit the rest are left out; they were taken for others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from calibration.part_pose import PartSight, Resection, SeenCircles, SeenEdges, resect
from calibration.part_pose.problem import PoseProblem
from calibration.wizard.lookout import camera_at
from calibration.wizard.session_store import Finding
from mvp.errors import CalibrationError
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from pydantic import JsonValue

    from calibration.projection import PinholeCamera
    from calibration.wizard.session_store import Sample
    from mvp.geometry import BoolArray, FloatArray, Pose
    from mvp.wizard import PartSights, SeenPart, SessionFacts, Shot

_Points: TypeAlias = list[list[float]]

FEWEST_FEATURES = 4
_ROUNDS = 4
_SETTLED_MM, _SETTLED_RAD = 0.05, 1e-4
_OUTLYING_SIGMA = 5.0
_LEAST_REDUNDANT = 2
_MOST_LEFT_OUT = 0.4
_UNSETTLED = (
    "arm or lens moved while the picture was taken",
    "wait longer before the picture: [settle] in the cell file",
)
_NOT_THERE = (
    "check the light, and that the part lies about where part_pose of the cell says"
)


class StoredSight(FileModel):
    """What one picture shows of the part, in the extras of its sample.

    ``found``: share of the expected edges. ``left_out``: names of lines that did not
    fit the rest.
    """

    ends_part_mm: list[_Points]
    edge_pixels: _Points
    edge: list[int]
    edge_sigma_px: list[float]
    edge_names: list[str]
    centres_part_mm: _Points
    normals_part: _Points
    radii_mm: list[float]
    rim_pixels: _Points
    rim_sigma_px: list[float]
    rim_names: list[str]
    found: float
    left_out: list[str]

    @property
    def sight(self) -> PartSight:
        """As the estimator takes it."""
        edge_sigma = np.array(self.edge_sigma_px, np.float64)
        rim_sigma = np.array(self.rim_sigma_px, np.float64)
        return PartSight(
            circles=SeenCircles(
                _shaped(self.centres_part_mm, 3),
                _shaped(self.normals_part, 3),
                np.array(self.radii_mm, np.float64),
                _shaped(self.rim_pixels, 2),
                _typical(rim_sigma),
                tuple(self.rim_names),
                rim_sigma,
            ),
            edges=SeenEdges(
                np.array(self.ends_part_mm, np.float64).reshape(-1, 2, 3),
                _shaped(self.edge_pixels, 2),
                np.array(self.edge, np.int64),
                _typical(edge_sigma),
                tuple(self.edge_names),
                edge_sigma,
            ),
        )

    @property
    def count(self) -> int:
        """Lines and rims."""
        return len(self.edge_names) + len(self.rim_names)


@dataclass(frozen=True, eq=False)
class Look:
    """What a picture gave.

    Attributes:
        sight: None when nothing of use was measured.
        resection: the poses that explain it.
        reason: why it does not count; empty when it does.
    """

    sight: StoredSight | None
    resection: Resection | None
    reason: str = ""

    def finding(self, shot: Shot) -> Finding:
        """For the session."""
        extra: dict[str, JsonValue] = {}
        if self.sight is not None:
            extra["sight"] = self.sight.model_dump(mode="json")
        if self.reason:
            return Finding(None, self.reason, _NOT_THERE, extra)
        if not shot.settled:
            return Finding(None, *_UNSETTLED, extra)
        return Finding(extra=extra)


def look(
    sights: PartSights, shot: Shot, facts: SessionFacts, camera_from_part: Pose
) -> Look:
    """Measure the part in a picture.

    Args:
        sights: of the task.
        shot: the picture.
        facts: camera and lens.
        camera_from_part: where the part is believed to be.
    """
    camera = camera_at(facts, facts.lens_at(dict(shot.lens_steps)))
    there, found = camera_from_part, Look(None, None, "nothing was measured")
    for _ in range(_ROUNDS):
        seen = sights.measure(shot, there)
        found = _fitted(seen, camera, there, seen.agrees)
        leading = found
        if found.resection is None and not seen.reason:
            leading = _fitted(seen, camera, there, np.ones_like(seen.agrees))
        if leading.resection is None:
            return found
        before, there = there, leading.resection.best.camera_from_part
        moved = float(np.linalg.norm(there.translation_mm - before.translation_mm))
        if moved < _SETTLED_MM and there.angle_to_rad(before) < _SETTLED_RAD:
            break
    return found


def sight_of(sample: Sample) -> StoredSight:
    """What was kept with a sample."""
    return StoredSight.model_validate(sample.extra["sight"])


def _fitted(
    seen: SeenPart, camera: PinholeCamera, near: Pose, counting: BoolArray
) -> Look:
    """A pose from the counting (e,) edges and all rims, without what does not fit."""
    if seen.reason:
        return Look(None, None, seen.reason)
    everything = _stored(seen, counting, ())
    if everything.count < FEWEST_FEATURES:
        return Look(
            everything,
            None,
            f"only {everything.count} lines and holes of the part were found "
            f"({seen.found:.0%} of the expected length)",
        )
    kept = counting.copy()
    left_out: list[str] = []
    while True:
        stored = _stored(seen, kept, tuple(left_out))
        try:
            resection = resect(camera, stored.sight, near=near)
        except CalibrationError as error:
            return Look(stored, None, error.message)
        worst = _worst_edge(camera, stored, resection)
        if worst is None:
            return Look(stored, resection)
        if len(left_out) + 1 > _MOST_LEFT_OUT * counting.sum():
            return Look(stored, None, "the lines that were found do not fit the part")
        left_out.append(stored.edge_names[worst])
        kept[np.flatnonzero(kept)[worst]] = False


def _worst_edge(
    camera: PinholeCamera, stored: StoredSight, resection: Resection
) -> int | None:
    """The edge without which the rest fits far better; None when all fit about alike.

    With the residuals r of an edge and its block h of the hat matrix, chi-square falls
    by r' (1 - h)^-1 r when it is left out.
    """
    edges, best = stored.sight.edges, resection.best
    count, estimate = len(edges.pixels), best.estimate
    if not count or estimate.degrees_of_freedom <= _LEAST_REDUNDANT:
        return None
    pose = best.camera_from_part
    problem = PoseProblem.of(camera, stored.sight)
    jacobian = problem.jacobian((pose.rotation, pose.translation_mm))
    hat = jacobian @ np.linalg.pinv(jacobian)
    first = len(estimate.residuals) - count
    falls = np.zeros(len(edges.ends_part_mm))
    for edge in range(len(falls)):
        own = first + np.flatnonzero(edges.edge == edge)
        left = np.eye(len(own)) - hat[np.ix_(own, own)]
        rows = estimate.residuals[own]
        falls[edge] = rows @ np.linalg.lstsq(left, rows, rcond=None)[0]
    worst = int(falls.argmax())
    rest = (estimate.chi_square - falls[worst]) / (estimate.degrees_of_freedom - 2)
    outlying = falls[worst] > _OUTLYING_SIGMA**2 * max(float(rest), 1.0)
    return worst if outlying else None


def _stored(seen: SeenPart, kept: BoolArray, left_out: tuple[str, ...]) -> StoredSight:
    number = np.cumsum(kept) - 1
    place = kept[seen.edge]
    return StoredSight(
        ends_part_mm=seen.ends_part_mm[kept].tolist(),
        edge_pixels=seen.edge_pixels[place].tolist(),
        edge=number[seen.edge[place]].tolist(),
        edge_sigma_px=seen.edge_sigma_px[place].tolist(),
        edge_names=[n for n, k in zip(seen.edge_names, kept, strict=True) if k],
        centres_part_mm=seen.centres_part_mm.tolist(),
        normals_part=seen.normals_part.tolist(),
        radii_mm=seen.radii_mm.tolist(),
        rim_pixels=seen.rim_pixels.tolist(),
        rim_sigma_px=seen.rim_sigma_px.tolist(),
        rim_names=list(seen.rim_names),
        found=seen.found,
        left_out=list(left_out),
    )


def _shaped(values: _Points, columns: int) -> FloatArray:
    return np.array(values, np.float64).reshape(-1, columns)


def _typical(sigmas: FloatArray) -> float:
    return float(np.sqrt((sigmas**2).mean())) if len(sigmas) else 1.0
