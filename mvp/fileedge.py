"""What everything shares that is read from or written to a file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.errors import InputError


class FileModel(BaseModel):
    """Frozen; unknown keys and non-finite numbers are refused."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, strict=False
    )


def read_file(
    path: Path, refusal: type[InputError], *, hint: str, at_most: int = -1
) -> bytes:
    """The content of a file.

    Args:
        path: where it is.
        refusal: the error to raise when it cannot be read.
        hint: of that error.
        at_most: how many bytes are read; -1: all.

    Raises:
        refusal: in the system's own words.
    """
    try:
        with path.open("rb") as file:
            return file.read(at_most)
    except OSError as error:
        raise refusal(
            f"{path}: {error.strerror or error}", hint=hint, where=str(path)
        ) from error
