"""Distributions that a test pretends were installed."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


def install(site: Path, name: str, version: str, entry_points: str = "") -> None:
    """Leave in a folder what an installer leaves beside a distribution's modules.

    The folder has to be put on the path by the test.
    """
    info = site / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
    )
    if entry_points:
        (info / "entry_points.txt").write_text(entry_points)
