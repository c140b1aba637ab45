"""What ``mvp-cell check`` writes down."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import Field

from mvp.errors import DeviceError, MvpCellError
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from mvp.devices import Finding

CHECK_SCHEMA: Literal["mvp-cell/check/1"] = "mvp-cell/check/1"


class CheckItem(FileModel):
    """One thing that was checked; a warning has passed, but should be looked at."""

    name: str
    passed: bool
    detail: str
    hint: str = ""
    warning: bool = False


class CheckedFrame(FileModel):
    """The test picture.

    Attributes:
        round_trip_ms: from asking for it to having it.
        mean_grey: 0 black, 1 full scale.
        saturated_fraction: of the pixels.
    """

    width_px: int
    height_px: int
    exposure_s: float
    round_trip_ms: float
    mean_grey: float
    saturated_fraction: float


class CheckedDevice(FileModel):
    """A device that answered.

    Attributes:
        homed: whether it knows where it is; null for devices that need no homing.
        answer_ms: how long it took to say where it stands.
        data_age_ms: how old that was then; null where the device does not date it.
        frame: of a camera.
    """

    role: Literal["arm", "lens", "camera"]
    driver: str
    model: str
    serial: str
    firmware: str
    simulated: bool
    extra: dict[str, str] = Field(default_factory=dict)
    homed: bool | None = None
    answer_ms: float | None = None
    data_age_ms: float | None = None
    frame: CheckedFrame | None = None


class CheckDocument(FileModel):
    """All things that were checked; ``passed`` when every one did."""

    schema_: Literal["mvp-cell/check/1"] = Field(default=CHECK_SCHEMA, alias="schema")
    cell: str
    passed: bool
    items: list[CheckItem]
    devices: list[CheckedDevice] = Field(default_factory=list)


def good(name: str, detail: str) -> CheckItem:
    """Nothing to do."""
    return CheckItem(name=name, passed=True, detail=detail)


def doubtful(name: str, detail: str, hint: str) -> CheckItem:
    """A run may begin, but somebody should look at this."""
    return CheckItem(name=name, passed=True, detail=detail, hint=hint, warning=True)


def failed(name: str, detail: str, hint: str) -> CheckItem:
    """A run would not get far."""
    return CheckItem(name=name, passed=False, detail=detail, hint=hint)


def failure(name: str, error: Exception) -> CheckItem:
    """An error as an item; one that is not ours is a mistake in a driver."""
    if isinstance(error, DeviceError):
        return failed(name, error.detail, error.hint)
    if isinstance(error, MvpCellError):
        return failed(name, error.message, error.hint)
    return failed(
        name, f"{type(error).__name__}: {error}", "a mistake in the driver; report it"
    )


def attempt(name: str, check: Callable[[], str]) -> CheckItem:
    """What ``check`` says, or the error that it raises."""
    try:
        return good(name, check())
    except Exception as error:
        return failure(name, error)


def from_findings(prefix: str, findings: Iterable[Finding]) -> list[CheckItem]:
    """A driver's findings as items."""
    return [
        CheckItem(
            name=f"{prefix} {one.name}",
            passed=one.level != "failed",
            detail=one.detail,
            hint=one.hint,
            warning=one.level == "warning",
        )
        for one in findings
    ]
