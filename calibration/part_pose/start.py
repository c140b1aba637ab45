"""Every pose from which a least squares over one picture should start.

A measured place says that a point of the part lies in a plane through the camera (two
planes for a point, one for each end of an edge): n . (R P + t) = 0. Eliminating t leaves
|L r|^2 in the nine elements of R. It is minimised on the rotation group from sixty starts
spread over all rotations at once, and all distinct minima that put the part in front of
the camera are kept.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.projection import skew, to_normalised

if TYPE_CHECKING:
    from calibration.part_pose.problem import State
    from calibration.part_pose.sightings import PartSight
    from calibration.projection import PinholeCamera
    from mvp.geometry import FloatArray

_STARTS = Rotation.create_group("I").as_matrix()
_AXES = skew(np.eye(3))
_STEPS = 25
_SAME_RAD = float(np.radians(1.0))
_NEAR_RAD = float(np.radians(8.0))


def starts(camera: PinholeCamera, sight: PartSight, most: int = 6) -> list[State]:
    """Rotations and translations of ``camera_from_part``, the best first.

    Args:
        camera: fixed intrinsics.
        sight: what was seen, three points' worth at least.
        most: at most so many, without the mirror images of the best.
    """
    normals, places = planes(camera, sight)
    middle = places.mean(axis=0)
    size = float(np.linalg.norm(places - middle, axis=1).max()) or 1.0
    lever, shift = _eliminated(normals, (places - middle) / size)
    rotations, costs = _minima(lever)
    found: list[State] = []
    for index in np.argsort(costs):
        rotation = rotations[index]
        translation = size * (shift @ rotation.ravel()) - rotation @ middle
        ahead = (places @ rotation.T + translation)[:, 2] > 0
        if ahead.all() and not any(_same(rotation, other) for other, _ in found):
            found.append((rotation, translation))
    found = found[:most]
    for mirror in [mirrored(state, places) for state in found[:1]]:
        if not any(_same(mirror[0], other, _NEAR_RAD) for other, _ in found):
            found.append(mirror)
    return found


def planes(camera: PinholeCamera, sight: PartSight) -> tuple[FloatArray, FloatArray]:
    """Normals (m, 3) in camera axes, and the places (m, 3) of the part in the planes."""
    marks = np.concatenate([sight.points.pixels, sight.circles.pixels])
    points = np.concatenate(
        [sight.points.points_part_mm, sight.circles.centres_part_mm]
    )
    ideal = to_normalised(camera, marks)
    zero, one = np.zeros(len(ideal)), np.ones(len(ideal))
    across = np.stack([one, zero, -ideal[:, 0]], axis=1)
    down = np.stack([zero, one, -ideal[:, 1]], axis=1)
    lines = _lines(to_normalised(camera, sight.edges.pixels), sight)
    ends = sight.edges.ends_part_mm
    return (
        np.concatenate([across, down, lines, lines]),
        np.concatenate([points, points, ends[:, 0], ends[:, 1]]),
    )


def mirrored(state: State, places_part_mm: FloatArray) -> State:
    """The pose whose flattest plane is mirrored in the line of sight.

    A flat part seen with little perspective looks nearly the same in both.
    """
    rotation, translation = state
    middle = places_part_mm.mean(axis=0)
    normal = np.linalg.svd(places_part_mm - middle)[2][2]
    centre = rotation @ middle + translation
    sight = centre / np.linalg.norm(centre)
    half_turn = 2 * np.outer(sight, sight) - np.eye(3)
    turned = half_turn @ rotation @ (2 * np.outer(normal, normal) - np.eye(3))
    return turned, centre - turned @ middle


def _lines(ideal: FloatArray, sight: PartSight) -> FloatArray:
    """Best line (e, 3) through the places of each edge, unit normal in the picture."""
    lines = []
    for edge in range(len(sight.edges.ends_part_mm)):
        places = ideal[sight.edges.edge == edge]
        middle = places.mean(axis=0)
        normal = np.linalg.svd(places - middle, full_matrices=True)[2][1]
        lines.append([*normal, -normal @ middle])
    return np.array(lines).reshape(-1, 3)


def _eliminated(
    normals: FloatArray, places: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """L (9, 9) of the cost, and the (3, 9) matrix that gives the best t from R."""
    rows = np.einsum("mi,mj->mij", normals, places).reshape(-1, 9)
    shift = -np.linalg.pinv(normals) @ rows
    left = rows + normals @ shift
    return np.linalg.qr(np.pad(left, ((0, max(0, 9 - len(left))), (0, 0))))[1], shift


def _minima(lever: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (s, 3, 3) and costs (s,) reached from all starts, by damped steps."""
    rotations = np.array(_STARTS)
    costs = _costs(lever, rotations)
    damping = np.full(len(rotations), 1e-2)
    for _ in range(_STEPS):
        slopes = (_AXES @ rotations[:, None]).reshape(-1, 3, 9) @ lever.T
        normal = slopes @ np.swapaxes(slopes, 1, 2)
        values = rotations.reshape(-1, 9) @ lever.T
        gradient = np.einsum("sij,sj->si", slopes, values)
        size = np.trace(normal, axis1=1, axis2=2) * damping + np.finfo(float).tiny
        damped = normal + size[:, None, None] * np.eye(3)
        step = -np.linalg.solve(damped, gradient[..., None])[..., 0]
        trial = Rotation.from_rotvec(step).as_matrix() @ rotations
        trial_costs = _costs(lever, trial)
        better = trial_costs < costs
        rotations[better], costs[better] = trial[better], trial_costs[better]
        damping = np.where(better, damping / 10, damping * 10).clip(1e-9, 1e6)
    return rotations, costs


def _costs(lever: FloatArray, rotations: FloatArray) -> FloatArray:
    return np.asarray(((rotations.reshape(-1, 9) @ lever.T) ** 2).sum(axis=1))


def _same(rotation: FloatArray, other: FloatArray, limit: float = _SAME_RAD) -> bool:
    chord = float(np.linalg.norm(rotation - other)) / np.sqrt(2)
    return bool(chord < limit)
