"""What speaks against the pose of a part."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.verdict import Cause, Limit, Verdict, judged

if TYPE_CHECKING:
    from calibration.part_pose.locate import LocatedPart
    from calibration.part_pose.resection import Resection
    from calibration.part_pose.sightings import PartSight

_IMPROBABLE = 1e-3
_REDUNDANT = Limit(
    "few-features",
    "the number of equations beyond the six that a pose needs",
    "",
    marginal=4,
    no_go=2,
    action="measure more corners, holes or edges",
    at_least=True,
)
_FIT = Limit(
    "features-do-not-fit",
    "the residual by the stated noise",
    "",
    marginal=1.5,
    no_go=4.0,
    action="check which feature is which, the size of the part and the intrinsics",
)
_TURN = Limit(
    "weakly-determined",
    "the uncertainty of the rotation (one sigma of its worst axis)",
    "deg",
    marginal=1.0,
    no_go=5.0,
    action="measure features that are farther apart and not on one line",
)


def judge_resection(sight: PartSight, resection: Resection) -> Verdict:
    """Number of features, ambiguity, residual, and what is weakly determined."""
    estimate = resection.best.estimate
    rest: tuple[Cause, ...] = ()
    if estimate.degrees_of_freedom > 0 and estimate.probability < _IMPROBABLE:
        rest = _FIT.check(float(np.sqrt(estimate.variance_factor)))
    turn = np.sqrt(np.linalg.eigvalsh(estimate.covariance[3:, 3:])[-1])
    return judged(
        _REDUNDANT.check(sight.equations - 6),
        _ambiguity(resection),
        rest,
        _TURN.check(float(np.degrees(turn))),
    )


def judge_located(located: LocatedPart) -> Verdict:
    """Do the views agree on where the part is?"""
    if located.probability >= _IMPROBABLE:
        return judged()
    worst = int(np.linalg.norm(located.off[:, :3], axis=1).argmax())
    return judged(
        [
            Cause(
                "views-disagree",
                "no-go",
                f"the views put the part up to "
                f"{np.linalg.norm(located.off[worst, :3]):.3g} mm apart (view "
                f"{worst + 1}); their covariances do not allow this",
                "check the hand-eye calibration, and that the part did not move",
            )
        ]
    )


def _ambiguity(resection: Resection) -> tuple[Cause, ...]:
    if not resection.ambiguous and not resection.settled_by_prior:
        return ()
    best, other = resection.branches[0], resection.branches[1]
    angle = best.camera_from_part.angle_to_rad(other.camera_from_part)
    settled = "; the expected pose decided" if resection.settled_by_prior else ""
    return (
        Cause(
            "mirror-ambiguity",
            "marginal" if resection.settled_by_prior else "no-go",
            f"a second pose, turned by {np.degrees(angle):.0f} deg, explains the picture "
            f"with {resection.error_ratio:.2g} times the error{settled}",
            "measure features outside of one plane, look at a steeper angle, or state "
            "where the part is expected",
        ),
    )
