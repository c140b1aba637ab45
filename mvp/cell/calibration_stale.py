"""Calibrations that were made with others than are in place now.

Hand-eye belongs to a camera and a lens table, the pose of a part to both and to hand-eye:
when one of them is measured anew, what was computed with the former one is stale. Files
say what they were made with; of one that does not say, the dates tell a part of it.
"""

from __future__ import annotations

from datetime import date
from typing import TYPE_CHECKING

from mvp.calibrated.content import BUILDS_ON, inputs_sha256
from mvp.cell.calibration_gates import NAMES, Objection, measure_again

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.cell.calibrations import CalibrationModels

_OWNER = {"sensor": "camera"}


def of_inputs(found: CalibrationModels, *, simulated: bool) -> Iterator[Objection]:
    """Made with another calibration than the one in place, or before it.

    Nominal values were not made with anything.

    Args:
        found: the calibrations.
        simulated: the cell is; there a date alone only warns.
    """
    for name in NAMES:
        provenance = getattr(found, name).provenance
        if provenance.origin == "nominal":
            continue
        if provenance.built_on:
            yield from _other(found, name, provenance.built_on)
        else:
            yield from _earlier(found, name, refused=not simulated)


def _other(
    found: CalibrationModels, name: str, built_on: dict[str, str]
) -> Iterator[Objection]:
    present = inputs_sha256(name, found.camera, found.lens_table, found.hand_eye)
    for used, sha256 in present.items():
        if used not in built_on or built_on[used] == sha256:
            continue
        if used == "sensor":
            mode = f"{found.camera.width_px} x {found.camera.height_px} px"
            what = f"another size or pitch of pixels than the {mode} of"
        else:
            what = f"another {used} calibration than"
        yield _stale(found, name, f"was made with {what} {_in_place(found, used)}")


def _earlier(
    found: CalibrationModels, name: str, *, refused: bool
) -> Iterator[Objection]:
    if name == "part_pose" and found.part_pose.by_hand_eye is None:
        return  # not found by a camera
    own = getattr(found, name).provenance.date
    for used in BUILDS_ON[name]:
        if used == "sensor":
            continue
        other = getattr(found, used).provenance
        if other.origin == "measured" and _before(own, other.date):
            text = f"is of {own}, before {_in_place(found, used)}"
            yield _stale(found, name, text, refused=refused)


def _in_place(found: CalibrationModels, used: str) -> str:
    owner = _OWNER.get(used, used)
    made = getattr(found, owner).provenance.date
    return f"the {owner} in place ({found.files[owner]}, of {made})"


def _before(one: str, other: str) -> bool:
    """Whole days; what is not a date says nothing."""
    try:
        return date.fromisoformat(one[:10]) < date.fromisoformat(other[:10])
    except ValueError:
        return False


def _stale(
    found: CalibrationModels, name: str, why: str, *, refused: bool = True
) -> Objection:
    path = found.files[name]
    return Objection(
        name,
        path,
        f"{path}: this {name} calibration is stale: it {why}",
        measure_again(name),
        refused=refused,
        stale=True,
    )
