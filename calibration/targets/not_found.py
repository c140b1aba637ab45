"""Why a ChArUco board was not found: other markers, mirrored, or another layout."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from calibration.targets.layout import Charuco

_FAMILIES = ("4X4_1000", "5X5_1000", "6X6_1000", "7X7_1000", "ARUCO_ORIGINAL")
_ENOUGH = 4


def why_no_board(grey: NDArray[np.uint8], target: Charuco) -> tuple[str, str]:
    """Reason and action; empty where there is nothing to be said.

    Args:
        grey: (rows, columns) of 8 bits, in which the board was not found.
        target: what was looked for.
    """
    wanted = _markers(grey, target.dictionary)
    if wanted >= _ENOUGH:
        return (
            f"{wanted} markers of {target.dictionary} are there, but not as on a board "
            f"of {target.columns} x {target.rows} squares",
            "check columns, rows and the layout (legacy or not) of the print",
        )
    if _markers(np.ascontiguousarray(grey[:, ::-1]), target.dictionary) >= _ENOUGH:
        return (
            "the markers are mirrored",
            "print the target anew without mirroring; check whether the camera's picture "
            "is flipped",
        )
    family = target.dictionary.split("_")[0]
    for other in _FAMILIES:
        if other.split("_")[0] != family and _markers(grey, other) >= _ENOUGH:
            kind = other.rsplit("_", 1)[0] if other[0].isdigit() else other
            return (
                f"the picture shows markers of the family {kind}, not of "
                f"{target.dictionary}",
                "name the dictionary of the print",
            )
    return "", ""


def _markers(grey: NDArray[np.uint8], dictionary: str) -> int:
    number = getattr(cv2.aruco, f"DICT_{dictionary}")
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(number))
    _, ids, _ = detector.detectMarkers(grey)
    return 0 if ids is None else len(ids)
