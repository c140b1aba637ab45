"""What happened, one JSON line each, append-only: ``mvp-cell/record/1``.

A line is written and flushed to disk before the arm moves again. The file is enough to
replay a run: what was asked, what was reached, which files were used, and when.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from pydantic import Field, TypeAdapter, ValidationError

from mvp.cell.durable import append_durably, cut_durably
from mvp.errors import RecordError
from mvp.fileedge import FileModel, read_file

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

RECORD_SCHEMA: Literal["mvp-cell/record/1"] = "mvp-cell/record/1"
FIND_RUNS = "name a run folder; `mvp-cell runs` lists them"
FinishReason: TypeAlias = Literal["completed", "aborted", "fault", "error"]


class _Record(FileModel):
    schema_: Literal["mvp-cell/record/1"] = Field(default=RECORD_SCHEMA, alias="schema")
    run_id: str = ""
    seq: int = 0
    t_utc: str = ""


class InputHashes(FileModel):
    """SHA-256 of everything a run depends on."""

    plan: str
    part: str
    task: str
    cell: str
    calibration: dict[str, str]


class DeviceRecord(FileModel):
    """Who answered."""

    role: str
    driver: str
    model: str
    serial: str
    firmware: str
    simulated: bool
    extra: dict[str, str] = Field(default_factory=dict)


class RunStarted(_Record):
    """The run began, or began again after a crash.

    ``cell_file`` is where the cell was found, for the command that resumes the run.
    ``believed_axes``: axes that nothing measures, each with the place where it was taken
    to be before homing, and by whose word.
    """

    type: Literal["run_started"] = "run_started"
    resumed: bool
    part_id: str
    simulated: bool
    inputs: InputHashes
    devices: list[DeviceRecord]
    accepted_calibration: dict[str, str] = Field(default_factory=dict)
    believed_axes: dict[str, str] = Field(default_factory=dict)
    version: str
    cell_file: str = ""


class PartLocated(_Record):
    """Where the part was found before the run's plan was made.

    ``moved_*``: from where it was expected; ``within_*``: how far it was allowed to be.
    ``lines``: the result in words. ``session_sha256``: over everything that it rests
    on, in the folder ``locating`` of the run.
    """

    type: Literal["part_located"] = "part_located"
    base_from_part: list[list[float]]
    expected_base_from_part: list[list[float]]
    moved_mm: float
    moved_deg: float
    within_mm: float
    within_deg: float
    error_95_mm: float | None
    verdict: str
    pictures: int
    lines: list[str]
    session_sha256: str


class ViewStarted(_Record):
    """A view is about to be driven to."""

    type: Literal["view_started"] = "view_started"
    view: str


class Reached(FileModel):
    """Where arm and lens stood when the picture was taken."""

    joints: list[float]
    base_from_tool: list[list[float]]
    lens_steps: dict[str, int]
    position_is_estimated: bool = False


class CaptureTimes(FileModel):
    """Monotonic seconds of the cell's clock."""

    arm_standing_s: float
    lens_standing_s: float
    not_before_s: float
    exposure_start_s: float
    received_s: float


class Stillness(FileModel):
    """How far the picture was displaced between two frames of a view.

    ``shift_px`` and ``sigma_px`` are None where nothing in the picture could show it.
    ``within_px``: how far it was allowed to be. ``likeness``: correlation of the two
    pictures, once laid on each other. ``apart_s``: between the beginnings of the two
    exposures. ``waited_s``: from the arm's standstill to the first of them.
    """

    shift_px: float | None
    sigma_px: float | None
    within_px: float
    likeness: float
    apart_s: float
    waited_s: float


class Captured(_Record):
    """A picture is on disk; written after the image was flushed."""

    type: Literal["captured"] = "captured"
    view: str
    image: str
    sha256: str
    full_scale: int
    exposure_s: float
    gain: float
    exposure_source: Literal["task", "metered"]
    frame_id: int
    dropped: int
    device_time_ns: int | None = None
    asked_joints: list[float]
    asked_lens_steps: dict[str, int]
    reached: Reached
    times: CaptureTimes
    stillness: Stillness | None = None


class Verified(_Record):
    """What the picture says about the promise."""

    type: Literal["verified"] = "verified"
    view: str
    verdict: Literal["pass", "fail", "not measurable"]
    cause: str | None
    verification: dict[str, object]


class ViewSkipped(_Record):
    """A view that was not taken, and why."""

    type: Literal["view_skipped"] = "view_skipped"
    view: str
    reason: str


class Fault(_Record):
    """A device failed or an error ended the run."""

    type: Literal["fault"] = "fault"
    kind: str
    where: str
    message: str
    may_still_move: str = ""


class RunFinished(_Record):
    """The last line of every run that was not killed."""

    type: Literal["run_finished"] = "run_finished"
    reason: FinishReason
    views_captured: int
    views_passed: int


Record: TypeAlias = Annotated[
    RunStarted
    | PartLocated
    | ViewStarted
    | Captured
    | Verified
    | ViewSkipped
    | Fault
    | RunFinished,
    Field(discriminator="type"),
]
_RECORD: TypeAdapter[Record] = TypeAdapter(Record)


def record_schema() -> dict[str, object]:
    """The JSON schema of one line."""
    return _RECORD.json_schema(by_alias=True)


class RecordLog:
    """Appends to ``records.jsonl``; numbers and dates every line.

    Args:
        path: the file; an existing one is continued.
        run_id: stamped into every line.
        utc: the date and time of now, as text.
        first_seq: number of the next line.
    """

    def __init__(
        self, path: Path, run_id: str, utc: Callable[[], str], first_seq: int = 0
    ) -> None:
        self._path = path
        self._run_id = run_id
        self._utc = utc
        self._seq = first_seq

    def write(self, record: Record) -> None:
        """Append one line, on disk when this returns.

        Raises:
            OutputError: the disk does not take it.
        """
        stamped = record.model_copy(
            update={"run_id": self._run_id, "seq": self._seq, "t_utc": self._utc()}
        )
        append_durably(self._path, stamped.model_dump_json(by_alias=True))
        self._seq += 1


def read_records(path: Path, *, repair: bool = False) -> list[Record]:
    """Read a record file.

    A last line without its newline is what a crash leaves while writing; it was never
    promised. With ``repair`` it is cut off.

    Raises:
        RecordError: missing, or a whole line is damaged (with its number).
    """
    raw = read_file(path, RecordError, hint=FIND_RUNS)
    whole, newline, tail = raw.rpartition(b"\n")
    if tail and repair:
        cut_durably(path, len(whole + newline))
    lines = whole.split(b"\n") if whole else []
    records = [_parse(path, number, line) for number, line in enumerate(lines, 1)]
    for number, record in enumerate(records):
        if record.seq != number or record.run_id != records[0].run_id:
            raise _damaged(path, number + 1, "a line is missing, added or foreign")
    return records


def _parse(path: Path, number: int, line: bytes) -> Record:
    try:
        return _RECORD.validate_python(json.loads(line))
    except ValidationError as error:
        raise _damaged(
            path, number, error.errors(include_url=False)[0]["msg"]
        ) from error
    except ValueError as error:
        raise _damaged(path, number, f"not JSON: {error}") from error


def _damaged(path: Path, number: int, why: str) -> RecordError:
    return RecordError(
        f"{path}:{number}: damaged record: {why}",
        hint="the run cannot be resumed safely; start a new one",
        where=f"{path}:{number}",
    )
