"""A run folder: plan, records, pictures, log, result. Nothing is ever overwritten."""

from __future__ import annotations

import hashlib
import shutil
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from pydantic import ValidationError

from mvp.cell.durable import output_error, sync_folder, write_durably
from mvp.cell.lock import held_by, holding
from mvp.cell.records import FIND_RUNS, Captured, Record, read_records
from mvp.cell.run_document import RunDocument
from mvp.errors import OutputError, RecordError
from mvp.fileedge import read_file
from mvp.planning.plan import Plan

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from contextlib import AbstractContextManager

    import numpy as np
    from numpy.typing import NDArray

    from mvp.devices import Frame

_Model = TypeVar("_Model", Plan, RunDocument)


@dataclass(frozen=True)
class RunFolder:
    """Paths inside ``<parent>/<run_id>``."""

    path: Path

    @property
    def run_id(self) -> str:
        """The folder's name."""
        return self.path.name

    @property
    def plan_file(self) -> Path:
        """The plan as it was run."""
        return self.path / "plan.json"

    @property
    def records_file(self) -> Path:
        """What happened, append-only."""
        return self.path / "records.jsonl"

    @property
    def document_file(self) -> Path:
        """The result."""
        return self.path / "run.json"

    @property
    def log_file(self) -> Path:
        """Every log line."""
        return self.path / "log.jsonl"

    @property
    def images(self) -> Path:
        """Pictures that have a record line."""
        return self.path / "images"

    @property
    def locating(self) -> Path:
        """Session in which the part was found, where the run looked for it first."""
        return self.path / "locating"

    @property
    def part_pose_file(self) -> Path:
        """Where the part was found."""
        return self.path / "part_pose.json"

    @property
    def figures(self) -> Path:
        """Drawings for the report."""
        return self.path / "figures"

    @property
    def quarantine(self) -> Path:
        """Pictures without a record line."""
        return self.path / "quarantine"

    def store(self, view_id: str, frame: Frame) -> tuple[str, str]:
        """Write a picture losslessly; on disk when this returns.

        Raises:
            OutputError: the disk does not take it, or a picture is already there.
        """
        content = encode_png(frame.pixels)
        target = self.images / f"{view_id}.png"
        if target.exists():
            raise OutputError(
                f"{target}: this picture already exists",
                hint="a run never overwrites a picture; start a new run",
                where=str(target),
            )
        write_durably(target, content)
        name = target.relative_to(self.path).as_posix()
        return name, hashlib.sha256(content).hexdigest()

    def load(self, captured: Captured) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """The pixels of a recorded picture, checked against the record.

        Raises:
            RecordError: missing, changed, or unreadable.
        """
        file = self.path / captured.image
        content = read_file(
            file,
            RecordError,
            hint="the picture is named in records.jsonl; restore it or start a new run",
        )
        if hashlib.sha256(content).hexdigest() != captured.sha256:
            raise RecordError(
                f"{file}: the picture has changed since it was taken",
                hint="restore it from a copy or start a new run",
                where=str(file),
            )
        return decode_png(content)

    def read_plan(self) -> Plan:
        """The plan of this run.

        Raises:
            RecordError: missing or damaged.
        """
        return _read(self.plan_file, Plan)

    def read_document(self) -> RunDocument:
        """The last written result.

        Raises:
            RecordError: missing or damaged.
        """
        return _read(self.document_file, RunDocument)

    def write_document(self, document: RunDocument) -> None:
        """Replace the result, durably."""
        text = document.model_dump_json(by_alias=True, indent=1)
        write_durably(self.document_file, text.encode())

    def records(self, *, repair: bool = False) -> list[Record]:
        """What happened so far."""
        return read_records(self.records_file, repair=repair)

    def set_aside_unrecorded(self, records: Sequence[Record]) -> list[str]:
        """Move every picture without a record line to quarantine; return their names.

        Raises:
            OutputError: the folder does not take it.
        """
        known = {r.image for r in records if isinstance(r, Captured)}
        files = sorted(self.images.iterdir())
        unknown = [f for f in files if f.relative_to(self.path).as_posix() not in known]
        try:
            for file in unknown:
                self.quarantine.mkdir(exist_ok=True)
                number = sum(1 for _ in self.quarantine.iterdir())
                file.replace(self.quarantine / f"{number:03d}-{file.name.lstrip('.')}")
            if unknown:
                sync_folder(self.quarantine)
        except OSError as error:
            raise output_error(self.quarantine, error) from error
        return [file.name for file in unknown]

    def in_progress(self) -> AbstractContextManager[None]:
        """Around everything that adds to the run: one process at a time.

        Raises:
            RecordError: another process works on it.
        """
        return holding(self.records_file, what=f"the run {self.run_id}")

    @property
    def is_in_progress(self) -> bool:
        """Whether a process works on it now."""
        return held_by(self.records_file) is not None

    @contextmanager
    def dropped_on_error(self) -> Iterator[None]:
        """Leave no folder behind when it cannot even be begun."""
        try:
            yield
        except BaseException:
            shutil.rmtree(self.path, ignore_errors=True)
            raise


@contextmanager
def parent_dropped_on_error(parent: Path) -> Iterator[None]:
    """Leave none of the folders behind that were made for a run which never began."""
    missing = [path for path in (parent, *parent.parents) if not path.exists()]
    try:
        yield
    except BaseException:
        for path in missing:
            # Somebody else may have put something there meanwhile.
            with suppress(OSError):
                path.rmdir()
        raise


def create_run_folder(parent: Path, name: str) -> RunFolder:
    """Make a new folder; a number is appended when the name is taken.

    Raises:
        OutputError: the parent cannot take it.
    """
    try:
        parent.mkdir(parents=True, exist_ok=True)
        for number in range(1, 1000):
            path = parent / (name if number == 1 else f"{name}-{number}")
            try:
                path.mkdir()
            except FileExistsError:
                continue
            folder = RunFolder(path.resolve())
            with folder.dropped_on_error():
                folder.images.mkdir()
                sync_folder(parent)
            return folder
    except OSError as error:
        raise output_error(parent, error) from error
    raise OutputError(
        f"{parent}: no free name for {name}", hint="name another folder with --out"
    )


def find_run(run: str, parents: Sequence[Path]) -> RunFolder:
    """A run by path, or by id in one of the folders.

    Raises:
        RecordError: no such run.
    """
    for path in (*((parent / run) for parent in parents), Path(run)):
        if (path / "records.jsonl").is_file() or (path / "run.json").is_file():
            return RunFolder(path.resolve())
    places = ", ".join(str(p) for p in parents)
    raise RecordError(
        f"no run {run!r}: neither a run folder nor an id in {places}",
        hint="`mvp-cell runs` lists them; --out names another folder",
        where=run,
    )


def list_runs(parent: Path) -> list[RunFolder]:
    """Every run folder below a folder, newest last."""
    if not parent.is_dir():
        return []
    return [RunFolder(p) for p in sorted(parent.iterdir()) if (p / "run.json").exists()]


def encode_png(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """Lossless PNG, 8 or 16 bits per pixel."""
    import cv2

    done, content = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 3])
    if not done:
        raise ValueError(f"no PNG of {pixels.dtype} {pixels.shape}")
    return content.tobytes()


def decode_png(content: bytes) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The pixels of a PNG as they were stored.

    Raises:
        RecordError: not a picture.
    """
    import cv2
    import numpy as np

    pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise RecordError("the picture file is damaged", hint="start a new run")
    return (
        pixels.astype(np.uint16)
        if pixels.dtype == np.uint16
        else pixels.astype(np.uint8)
    )


def _read(path: Path, model: type[_Model]) -> _Model:
    content = read_file(path, RecordError, hint=FIND_RUNS)
    try:
        return model.model_validate_json(content)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        raise RecordError(
            f"{path}: damaged: {problem['msg']}",
            hint="the run cannot be used; start a new one",
            where=str(path),
        ) from error
