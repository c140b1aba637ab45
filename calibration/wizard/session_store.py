"""The folder of a calibration session: facts, samples, pictures.

::

    <folder>/session.json     facts of the cell, and what was remembered (answers, ...)
             samples.jsonl    one line for each sample, appended; or {"undone": number}
             images/*.png     lossless

A picture is on disk before its line, and the line before anything moves again. After a
crash a picture without a line is written over by the next sample, and half a line at the
end of the file is cut off; so nothing is lost that was told, and nothing is there twice.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from pydantic import ValidationError

from calibration.observations import Observations
from mvp.calibrated import MeasuredTarget
from mvp.cell.durable import (
    append_durably,
    cut_durably,
    output_error,
    sync_folder,
    write_durably,
)
from mvp.cell.run_folder import decode_png, encode_png
from mvp.errors import RecordError
from mvp.fileedge import read_file
from mvp.wizard import Sample, SessionFile

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray
    from pydantic import JsonValue

    from calibration.targets import Detection
    from mvp.wizard import SessionFacts, Shot

__all__ = ["Finding", "Sample", "SessionStore"]

TARGET_SIZE = "target_size"  # as a person measured it, among what is remembered
_SESSION, _SAMPLES = "session.json", "samples.jsonl"
_NO_SESSION = "name the folder of a session, such as calibration/sessions/camera-..."


@dataclass(frozen=True)
class Finding:
    """What a wizard makes of a shot.

    Attributes:
        detection: points of the target; None when there are none, or other things count.
        reason: why the sample does not count; empty when it does.
        action: what to do about it.
        extra: what only this wizard understands.
    """

    detection: Detection | None = None
    reason: str = ""
    action: str = ""
    extra: Mapping[str, JsonValue] = field(default_factory=dict)


class SessionStore:
    """Samples of one session, on disk before they count. See the module's text."""

    def __init__(self, path: Path, file: SessionFile, samples: list[Sample]) -> None:
        self._path = path
        self._file = file
        self._facts = _with_size(file)
        self._samples = samples
        self._taken = max((sample.number for sample in samples), default=0)

    @classmethod
    def create(cls, folder: Path, facts: SessionFacts) -> SessionStore:
        """A new session in a folder that does not exist yet.

        Raises:
            OutputError: the folder exists, or the disk does not take it.
        """
        try:
            folder.mkdir(parents=True)
            (folder / "images").mkdir()
            sync_folder(folder.parent)
        except OSError as error:
            raise output_error(folder, error) from error
        store = cls(folder, SessionFile(facts=facts), [])
        store._write()
        return store

    @classmethod
    def open(cls, folder: Path, *, repair: bool = False) -> SessionStore:
        """A session that was begun.

        Args:
            folder: of it.
            repair: cut off half a line at the end, as a crash leaves it.

        Raises:
            RecordError: not a session, damaged, or a picture is not the one recorded.
        """
        file = _session_file(folder / _SESSION)
        lines = _lines(folder / _SAMPLES, repair=repair)
        samples, taken = _replayed(folder / _SAMPLES, lines)
        store = cls(folder, file, samples)
        store._taken = taken
        for sample in samples:
            store._check_image(sample)
        return store

    @property
    def path(self) -> Path:
        """The session's folder."""
        return self._path

    @property
    def facts(self) -> SessionFacts:
        """As they were when the session began, the target as large as then measured."""
        return self._facts

    @property
    def samples(self) -> tuple[Sample, ...]:
        """Those that were not taken back, in the order taken."""
        return tuple(self._samples)

    @property
    def count(self) -> int:
        """How many samples there are."""
        return len(self._samples)

    def usable(self, role: str = "calibration") -> tuple[Sample, ...]:
        """Samples of a role that count."""
        return tuple(s for s in self._samples if s.usable and s.role == role)

    @property
    def next_number(self) -> int:
        """Number of the next sample; never used twice, also when one is taken back."""
        return self._taken + 1

    def add(
        self,
        shot: Shot,
        finding: Finding,
        *,
        name: str = "",
        role: str = "calibration",
    ) -> Sample:
        """Keep a picture and what was found in it; on disk when this returns.

        Raises:
            OutputError: the disk does not take it; then there is no such sample.
        """
        content = encode_png(shot.pixels)
        sample = _sample(self.next_number, role, name, content, shot, finding)
        write_durably(self._path / sample.image, content)
        append_durably(self._path / _SAMPLES, sample.model_dump_json(by_alias=True))
        self._samples.append(sample)
        self._taken = sample.number
        return sample

    def undo(self) -> Sample | None:
        """Take the last sample back; its picture stays. None: there is none.

        Raises:
            OutputError: the disk does not take it.
        """
        if not self._samples:
            return None
        last = self._samples[-1]
        append_durably(self._path / _SAMPLES, json.dumps({"undone": last.number}))
        return self._samples.pop()

    def remember(self, key: str, value: JsonValue) -> None:
        """Keep an answer or a decision that the result depends on; on disk at once.

        Raises:
            OutputError: the disk does not take it.
        """
        changed = {**self._file.remembered, key: value}
        self._file = self._file.model_copy(update={"remembered": changed})
        self._facts = _with_size(self._file)
        self._write()

    def recall(self, key: str) -> JsonValue:
        """What was remembered; None when nothing was."""
        return self._file.remembered.get(key)

    def image(self, sample: Sample) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """The pixels as they were taken.

        Raises:
            RecordError: the file is damaged.
        """
        return decode_png(self._content(sample))

    def observations(self, samples: Sequence[Sample]) -> Observations:
        """The points of some samples, one view each, as the estimators take them."""
        sensor = self.facts.sensor
        return Observations.from_views(
            [sample.found_points_mm for sample in samples],
            [sample.found_pixels for sample in samples],
            size_px=(sensor.width_px, sensor.height_px),
            names=[sample.name for sample in samples],
        )

    def sha256(self) -> str:
        """Over everything that a result depends on: facts, answers, samples.

        Over the files as they are, so that a later version of the program, which may
        keep more, finds the same.
        """
        digest = hashlib.sha256()
        for name in (_SESSION, _SAMPLES):
            path = self._path / name
            if path.exists():
                digest.update(read_file(path, RecordError, hint=_NO_SESSION))
        return digest.hexdigest()

    def _write(self) -> None:
        text = self._file.model_dump_json(by_alias=True, indent=1)
        write_durably(self._path / _SESSION, text.encode())

    def _content(self, sample: Sample) -> bytes:
        return read_file(
            self._path / sample.image,
            RecordError,
            hint="copy the whole folder of the session",
        )

    def _check_image(self, sample: Sample) -> None:
        if hashlib.sha256(self._content(sample)).hexdigest() != sample.sha256:
            raise RecordError(
                f"{self._path / sample.image}: not the picture that was taken",
                hint="copy the whole folder of the session again",
                where=str(self._path / sample.image),
            )


def _with_size(file: SessionFile) -> SessionFacts:
    """The facts, with what a person measured since."""
    target, told = file.facts.target, file.remembered.get(TARGET_SIZE)
    if target is None or not isinstance(told, dict):
        return file.facts
    sized = target.sized(MeasuredTarget.model_validate(told))
    return file.facts.model_copy(update={"target": sized})


def _sample(
    number: int, role: str, name: str, content: bytes, shot: Shot, finding: Finding
) -> Sample:
    found = finding.detection
    return Sample(
        number=number,
        name=name or f"{role} {number}",
        role=role,
        image=f"images/{number:03d}.png",
        sha256=hashlib.sha256(content).hexdigest(),
        usable=not finding.reason,
        reason=finding.reason,
        action=finding.action,
        ids=[] if found is None else found.ids.tolist(),
        points_mm=[] if found is None else found.points_mm.tolist(),
        pixels=[] if found is None else found.pixels.tolist(),
        joints=[float(j) for j in shot.joints],
        base_from_tool=shot.base_from_tool.matrix.tolist(),
        lens_steps=dict(shot.lens_steps),
        full_scale=shot.full_scale,
        exposure_s=shot.exposure_s,
        gain=shot.gain,
        times_s=dict(shot.times_s),
        settled=shot.settled,
        extra=dict(finding.extra),
    )


def _session_file(path: Path) -> SessionFile:
    content = read_file(path, RecordError, hint=_NO_SESSION)
    try:
        return SessionFile.model_validate_json(content)
    except ValidationError as error:
        raise _damaged(path, error.errors(include_url=False)[0]["msg"]) from error


def _lines(path: Path, *, repair: bool) -> list[bytes]:
    """Whole lines; a session that was only just begun has none."""
    if not path.exists():
        return []
    raw = read_file(path, RecordError, hint=_NO_SESSION)
    whole, newline, tail = raw.rpartition(b"\n")
    if tail and not repair:
        raise RecordError(
            f"{path}: the last line is cut off",
            hint="copy the whole folder again; where a crash did it, go on with "
            "`mvp-cell calibrate ... --resume`",
            where=str(path),
        )
    if tail:
        cut_durably(path, len(whole + newline))
    return whole.split(b"\n") if whole else []


def _replayed(path: Path, lines: list[bytes]) -> tuple[list[Sample], int]:
    """The samples that were not taken back, and the highest number ever used."""
    samples: list[Sample] = []
    taken = 0
    for place, line in enumerate(lines, 1):
        try:
            entry = json.loads(line)
            if isinstance(entry, dict) and entry.keys() == {"undone"}:
                if not samples or samples[-1].number != entry["undone"]:
                    raise _damaged(path, "takes back what is not there", place)
                samples.pop()
                continue
            sample = Sample.model_validate(entry)
        except ValidationError as error:
            why = error.errors(include_url=False)[0]["msg"]
            raise _damaged(path, why, place) from error
        except ValueError as error:
            raise _damaged(path, f"not JSON: {error}", place) from error
        if sample.number != taken + 1:
            raise _damaged(path, "a line is missing, added or foreign", place)
        samples.append(sample)
        taken = sample.number
    return samples, taken


def _damaged(path: Path, why: str, line: int | None = None) -> RecordError:
    where = f"{path}:{line}" if line else str(path)
    return RecordError(
        f"{where}: damaged: {why}",
        hint="this session cannot be used; copy it again, or begin a new one",
        where=where,
    )
