"""A plan names files so that its cell can be moved, and finds them again."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.cell.places import as_found, as_stored

if TYPE_CHECKING:
    from pathlib import Path

    import pytest


def test_a_file_inside_the_cell_is_stored_relative_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = tmp_path / "cell"
    file = home / "tasks" / "edge.toml"
    file.parent.mkdir(parents=True)
    file.write_text("")
    assert as_stored(file, home) == "tasks/edge.toml"
    monkeypatch.chdir(tmp_path)
    assert as_found("tasks/edge.toml", home) == file
    moved = home.rename(tmp_path / "elsewhere")
    assert as_found("tasks/edge.toml", moved).is_file()


def test_a_file_outside_the_cell_is_stored_as_it_is(tmp_path: Path) -> None:
    home, file = tmp_path / "cell", tmp_path / "part.step"
    home.mkdir()
    file.write_text("")
    stored = as_stored(file, home)
    assert stored == str(file.resolve())
    assert as_found(stored, home) == file.resolve()
