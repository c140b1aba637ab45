"""The bytes of a failed conversation are kept."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.cell.wire_dumps import dump_folder, keep_with_run

if TYPE_CHECKING:
    from pathlib import Path

    import pytest


def test_dumps_are_kept_with_the_run_and_old_ones_are_dropped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    first = dump_folder()
    assert not first.exists()
    for k in range(25):
        (first.parent / f"2020010{k // 10}T{k:06d}-1").mkdir(parents=True)
    folder = dump_folder()
    assert len(list(folder.parent.iterdir())) == 20
    folder.mkdir()
    (folder / "lens-1.wire.jsonl").write_text("{}\n", encoding="utf-8")
    run = tmp_path / "run"
    run.mkdir()
    keep_with_run(folder, run)
    assert (run / "wire" / "lens-1.wire.jsonl").read_text(encoding="utf-8") == "{}\n"


def test_a_run_without_faults_keeps_nothing(tmp_path: Path) -> None:
    keep_with_run(tmp_path / "never made", tmp_path)
    assert list(tmp_path.iterdir()) == []
