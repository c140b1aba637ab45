"""What a job says while it works, for whoever listens."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

Tell: TypeAlias = Callable[[str], None]


def unheard(text: str) -> None:
    """Nobody listens."""
