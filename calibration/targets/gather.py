"""From pictures of a target to observations, with every rejected picture and its reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibration.observations import Observations
from calibration.targets.checks import (
    PictureFigures,
    check_picture,
    measure_picture,
    same_picture,
)
from calibration.targets.detect import Detection, Rejection, detect
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Iterable

    import numpy as np
    from numpy.typing import NDArray

    from calibration.targets.layout import Target


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture and its name.

    Attributes:
        name: for reports, such as the name of the file.
        grey: (rows, columns), 8 bits.
    """

    name: str
    grey: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Gathered:
    """What all pictures gave.

    Attributes:
        observations: the usable views, in the order given.
        accepted: numbers of the usable pictures, so that poses can be paired with them.
        detections: one for each accepted picture.
        figures: one for each accepted picture.
        rejected: number, name and reason of every other picture.
    """

    observations: Observations
    accepted: tuple[int, ...]
    detections: tuple[Detection, ...]
    figures: tuple[PictureFigures, ...]
    rejected: tuple[tuple[int, str, Rejection], ...]


def gather(pictures: Iterable[Picture], target: Target) -> Gathered:
    """Detect and check; pictures are read one at a time.

    Raises:
        CalibrationError: no picture is usable; the reasons are in the message.
    """
    good: list[tuple[int, str, Detection, PictureFigures]] = []
    rejected: list[tuple[int, str, Rejection]] = []
    size: tuple[int, int] | None = None
    for number, picture in enumerate(pictures):
        own = (picture.grey.shape[1], picture.grey.shape[0])
        size = size or own
        found = _other_size(own, size) or examined(picture.grey, target)
        if isinstance(found, tuple):
            twin = next((g[1] for g in good if same_picture(g[2], found[0])), None)
            if twin is None:
                good.append((number, picture.name, *found))
                continue
            found = _duplicate(twin)
        rejected.append((number, picture.name, found))
    if not good or size is None:
        raise _nothing(rejected)
    return Gathered(
        Observations.from_views(
            [g[2].points_mm for g in good],
            [g[2].pixels for g in good],
            size_px=size,
            names=[g[1] for g in good],
        ),
        tuple(g[0] for g in good),
        tuple(g[2] for g in good),
        tuple(g[3] for g in good),
        tuple(rejected),
    )


def examined(
    grey: NDArray[np.uint8], target: Target
) -> tuple[Detection, PictureFigures] | Rejection:
    """Detection and figures of one picture, or why it is not used."""
    found = detect(grey, target)
    if isinstance(found, Rejection):
        return found
    figures = measure_picture(grey, found)
    return check_picture(figures, found) or (found, figures)


def _other_size(own: tuple[int, int], size: tuple[int, int]) -> Rejection | None:
    if own == size:
        return None
    return Rejection(
        "another-size",
        f"the picture has {own[0]} x {own[1]} px, the first one {size[0]} x {size[1]}",
        "remove it: it comes from another camera or another setting",
    )


def _duplicate(twin: str) -> Rejection:
    return Rejection(
        "duplicate",
        f"the target stands as in {twin}",
        "move camera or target between pictures",
    )


def _nothing(rejected: list[tuple[int, str, Rejection]]) -> CalibrationError:
    reasons = "; ".join(f"{name}: {why.reason}" for _, name, why in rejected[:5])
    return CalibrationError(
        f"no picture shows the target well enough: {reasons or 'there are no pictures'}",
        hint=rejected[0][2].action if rejected else "take pictures of the target",
    )
