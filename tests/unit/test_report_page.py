"""The report says the truth, fetches nothing and cannot be injected."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvp.cell.report import write_report
from mvp.cell.run_document import RunDocument
from mvp.cell.run_folder import encode_png
from mvp.errors import RecordError
from mvp.planning.plan import Plan

if TYPE_CHECKING:
    from pathlib import Path

IDENTITY = np.eye(4).tolist()
EVIL = "<script>alert(1)</script>"


def plan_document(feature: str = "slot edge") -> dict[str, object]:
    view = {
        "id": "v1",
        "features": [feature],
        "part_from_camera": IDENTITY,
        "base_from_tool": IDENTITY,
        "position_mm": [1.0, 2.0, 3.0],
        "view_direction": [0.0, 0.0, 1.0],
        "roll_rad": 0.5,
        "f_mm": 12.5,
        "d_mm": 13.07,
        "a_mm": 0.78,
        "pupil_offset_mm": 2.4,
        "lens_steps": {"zoom": 1, "focus": 2, "iris": 3},
        "joints_rad": [0.1] * 6,
        "exposure_s": 0.0,
        "margins": {
            "resolution": {"value": 0.5, "unit": "px", "normalised": 9.0},
            "focus_far": {
                "value": None,
                "unit": "mm",
                "normalised": None,
                "unbounded": True,
            },
            "visibility": {"value": 2.5, "unit": "mm", "normalised": 2.5},
        },
        "binding": "visibility",
        "tolerance": {
            "position_mm": 1.5,
            "angle_deg": 0.4,
            "d_mm": 0.02,
            "method": "certified",
        },
        "sensitivity": {"1 mm": 0.4},
    }
    stamp = {"file": "part.stl", "sha256": "ab" * 32}
    return {
        "schema": "mvp-cell/plan/1",
        "status": "admissible",
        "seed": 0,
        "part": stamp,
        "task": stamp,
        "cell": {"name": "virtual", "sha256": "cd" * 32, "simulated": True},
        "views": [view],
    }


def run_document(
    verdict: str = "pass", cause: str | None = None, feature: str = "slot edge"
) -> dict[str, object]:
    status = {"pass": "verified", "fail": "failed"}.get(verdict, verdict)
    verification = {
        "verdict": verdict,
        "cause": cause,
        "check_first": "is the lens homed?" if cause else "",
        "explanation": "",
        "edges": [
            {
                "feature": feature,
                "name": feature,
                "predicted_px": 40.0,
                "measured_px": 39.5,
                "measured_sd_px": 0.1,
                "predicted_start_px": [10.0, 10.0],
                "predicted_end_px": [50.0, 10.0],
                "start_px": [10.2, 10.1],
                "end_px": [49.7, 10.1],
                "visible_fraction": 1.0,
                "blur": {"measured_px": 1.0, "predicted_px": 1.1, "c_px": 2.7},
            }
        ],
        "blur": {},
    }
    return {
        "schema": "mvp-cell/run/1",
        "run_id": "r1",
        "folder": "r1",
        "status": "verified" if verdict == "pass" else "failed",
        "cell": "virtual",
        "task": "two edges",
        "simulated": True,
        "views": [
            {
                "id": "v1",
                "features": [feature],
                "status": status,
                "image": "images/v1.png",
                "verification": verification,
            }
        ],
    }


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return run_folder(tmp_path, plan_document(), run_document())


def run_folder(path: Path, plan: dict[str, object], run: dict[str, object]) -> Path:
    (path / "images").mkdir()
    Plan.model_validate(plan)
    RunDocument.model_validate(run)
    (path / "plan.json").write_text(json.dumps(plan), encoding="utf-8")
    (path / "run.json").write_text(json.dumps(run), encoding="utf-8")
    picture = np.full((64, 80), 90, np.uint8)
    (path / "images" / "v1.png").write_bytes(encode_png(picture))
    return path


def page(folder: Path) -> str:
    return write_report(folder).read_text(encoding="utf-8")


class Elements(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.references: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.references += [
            value or ""
            for name, value in attrs
            if name in ("src", "href", "xlink:href")
        ]


def elements(html: str) -> Elements:
    parser = Elements()
    parser.feed(html)
    return parser


def test_the_verdict_comes_before_everything_else(folder: Path) -> None:
    body = page(folder).split("<body>")[1]
    words = re.sub(r"<[^>]+>", " ", body).split()
    assert words[0] == "Verified"


def test_the_page_fetches_nothing_and_runs_no_script(folder: Path) -> None:
    found = elements(page(folder))
    assert "script" not in found.tags
    assert "link" not in found.tags
    assert all(
        ref.startswith(("data:image/png;base64,", "#")) for ref in found.references
    )


def test_the_captured_picture_is_embedded_once_and_enlarged_by_reference(
    folder: Path,
) -> None:
    html = page(folder)
    assert html.count("data:image/png;base64,") == 1
    assert '<use href="#picture-v1"/>' in html


def test_names_from_files_cannot_become_markup(tmp_path: Path) -> None:
    html = page(run_folder(tmp_path, plan_document(EVIL), run_document(feature=EVIL)))
    assert EVIL not in html
    assert "&lt;script&gt;" in html


def test_a_failed_view_names_cause_and_what_to_check(tmp_path: Path) -> None:
    html = page(run_folder(tmp_path, plan_document(), run_document("fail", "defocus")))
    assert "Failed" in html
    assert "Cause: defocus." in html
    assert "is the lens homed?" in html


def test_a_view_that_cannot_be_measured_never_looks_like_a_pass(
    tmp_path: Path,
) -> None:
    html = page(run_folder(tmp_path, plan_document(), run_document("not measurable")))
    assert '<header class="fail">' in html
    assert '<span class="pill pass">' not in html


def test_the_binding_requirement_and_an_unbounded_one_are_marked(folder: Path) -> None:
    html = page(folder)
    assert re.search(r'class="margin binding">\s*<span class="name">visibility', html)
    assert "unbounded" in html


def test_a_margin_below_three_sigmas_is_drawn_as_thin(folder: Path) -> None:
    assert 'class="fill thin" style="width:12.5%"' in page(folder)


def test_a_simulated_cell_is_stamped(folder: Path) -> None:
    assert "simulated cell" in page(folder)


def test_a_damaged_result_is_named(folder: Path) -> None:
    (folder / "run.json").write_text("{", encoding="utf-8")
    with pytest.raises(RecordError, match=r"run\.json"):
        write_report(folder)
    assert not (folder / "report.html").exists()
