"""Which result it is, whatever its file looks like."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mvp.fileedge import FileModel


def content_sha256(model: FileModel) -> str:
    """SHA-256 of everything that a result says; of one written as a new file too."""
    return hashlib.sha256(model.model_dump_json(by_alias=True).encode()).hexdigest()
