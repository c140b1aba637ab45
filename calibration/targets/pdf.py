"""A target as a PDF at true scale, with a ruler to check the printer.

Everything is drawn as filled vector shapes in millimetres; no picture is scaled on the
way. The text names kind, size and the words to tell the printer: actual size.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from calibration.targets.detect import charuco_board
from calibration.targets.layout import (
    Charuco,
    Chessboard,
    CircleGrid,
    target_of_print,
)
from mvp.errors import CalibrationError, OutputError
from mvp.wizard import TargetSheet

if TYPE_CHECKING:
    from pathlib import Path

    from calibration.targets.layout import Target
    from mvp.calibrated import TargetPrint
    from mvp.geometry import FloatArray

PAPERS_MM = {
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
    "letter": (215.9, 279.4),
}
_POINTS_PER_MM = 72 / 25.4
_MARGIN_MM = 8.0
_FOOT_MM = 16.0
_TEXT_MM = 3.2
_CIRCLE = 4 / 3 * (np.sqrt(2) - 1)


def target_sheet(printed: TargetPrint, paper: str) -> TargetSheet:
    """The sheet of a target that a cell file describes (``mvp-cell target``).

    Raises:
        CalibrationError: as for ``target_pdf``.
    """
    target = target_of_print(printed, 0.0)
    paper = _paper_name(paper)
    page = _page_mm(target, paper)
    return TargetSheet(
        target_pdf(target, paper=paper),
        _title(target),
        paper,
        page,
        target.size_mm,
        _ruler_mm(page),
    )


def write_target_pdf(path: Path, target: Target, *, paper: str = "A4") -> None:
    """Draw a target in the middle of a sheet, turned if it fits only so.

    Args:
        path: of the file; replaced if it exists.
        target: what to draw.
        paper: a name of ``PAPERS_MM``, in capitals or not.

    Raises:
        CalibrationError: unknown paper or markers, or the target does not fit on it.
        OutputError: the file cannot be written.
    """
    content = target_pdf(target, paper=paper)
    try:
        path.write_bytes(content)
    except OSError as error:
        raise OutputError(
            f"{path}: {error.strerror or error}",
            hint="name another file, or make room",
            where=str(path),
        ) from error


def target_pdf(target: Target, *, paper: str = "A4") -> bytes:
    """The bytes of ``write_target_pdf``.

    Raises:
        CalibrationError: unknown paper, or the target does not fit on it.
    """
    page = _page_mm(target, paper)
    width, height = target.size_mm
    corner = np.array([(page[0] - width) / 2, (page[1] - _FOOT_MM - height) / 2])
    shapes = [shape + corner for shape in _shapes(target)]
    shapes += [_rectangle(*mark) for mark in _ruler_marks(page)]
    drawn = [_path(shape) for shape in shapes]
    words = [_words(text, *place) for text, place in _captions(target, page)]
    unit, top = _POINTS_PER_MM, page[1] * _POINTS_PER_MM
    scale = f"{unit:.9f} 0 0 {-unit:.9f} 0 {top:.6f} cm"
    return _document("\n".join([scale, "0 g", *drawn, *words]), page)


def _paper_name(paper: str) -> str:
    """As ``PAPERS_MM`` spells it."""
    for name in PAPERS_MM:
        if name.lower() == paper.strip().lower():
            return name
    raise CalibrationError(
        f"unknown paper {paper!r}", hint=f"use one of {', '.join(PAPERS_MM)}"
    )


def _page_mm(target: Target, paper: str) -> tuple[float, float]:
    paper = _paper_name(paper)
    page = _fitting(target, PAPERS_MM[paper])
    if page is not None:
        return page
    width, height = target.size_mm
    larger = [name for name, size in PAPERS_MM.items() if _fitting(target, size)]
    paper_words = f"larger paper (--paper {larger[0]}), or " if larger else ""
    raise CalibrationError(
        f"a target of {width:.0f} x {height:.0f} mm does not fit on {paper}",
        hint=f"use {paper_words}fewer or smaller squares",
    )


def _fitting(
    target: Target, paper_mm: tuple[float, float]
) -> tuple[float, float] | None:
    """The page, upright or turned, on which there is room."""
    width, height = target.size_mm
    for page in (paper_mm, paper_mm[::-1]):
        room = (page[0] - 2 * _MARGIN_MM, page[1] - 2 * _MARGIN_MM - _FOOT_MM)
        if width <= room[0] and height <= room[1]:
            return page
    return None


def _shapes(target: Target) -> list[FloatArray]:
    """Black polygons (k, 2), or circles as (12, 2) Bezier points; y down, mm."""
    if isinstance(target, CircleGrid):
        margin = (target.pitch.mm + target.diameter_mm) / 2
        centres = target.points_mm[:, :2] + margin
        return [_circle(centre, target.diameter_mm / 2) for centre in centres]
    if isinstance(target, Charuco):
        return _charuco_shapes(target)
    return _black_squares(target.columns + 1, target.rows + 1, target.square.mm, 0)


def _black_squares(
    columns: int, rows: int, side_mm: float, parity: int
) -> list[FloatArray]:
    row, column = np.divmod(np.arange(rows * columns), columns)
    black = (row + column) % 2 == parity
    return [
        _rectangle(c * side_mm, r * side_mm, side_mm, side_mm)
        for r, c in zip(row[black], column[black], strict=True)
    ]


def _charuco_shapes(target: Charuco) -> list[FloatArray]:
    """Markers where OpenCV's board has them; the squares without one are black."""
    board = charuco_board(target)
    corners = np.array(board.getObjPoints(), dtype=np.float64)[:, :, :2]
    square = np.floor(corners.mean(axis=1) / target.square.mm).astype(np.int64)
    parity = (int(square[0].sum()) + 1) % 2
    shapes = _black_squares(target.columns, target.rows, target.square.mm, parity)
    dictionary = board.getDictionary()
    bits = dictionary.markerSize + 2
    side = target.marker_mm / bits
    for first, number in zip(corners[:, 0], np.ravel(board.getIds()), strict=True):
        image = cv2.aruco.generateImageMarker(dictionary, int(number), bits)
        shapes += _dark_runs(image == 0, first, side)
    return shapes


def _dark_runs(dark: np.ndarray, first: FloatArray, side_mm: float) -> list[FloatArray]:
    """One rectangle for each run of dark bits of a row: no seams inside a row."""
    shapes = []
    for row, bits in enumerate(dark):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], bits, [0]])))
        for start, end in edges.reshape(-1, 2):
            x, y = first + np.array([start, row]) * side_mm
            shapes.append(_rectangle(x, y, (end - start) * side_mm, side_mm))
    return shapes


def _ruler_mm(page: tuple[float, float]) -> float:
    return float(min(200.0, 50 * ((page[0] - 2 * _MARGIN_MM) // 50)))


def _ruler_marks(page: tuple[float, float]) -> list[tuple[float, float, float, float]]:
    """x, y, width, height of the ruler's line and ticks, mm."""
    length = _ruler_mm(page)
    left, line = (page[0] - length) / 2, page[1] - _MARGIN_MM - 2
    marks = [(left, line, length, 0.2)]
    for place in np.arange(0, length + 1, 10):
        tall = 4.0 if place % 50 == 0 else 2.0
        marks.append((left + float(place) - 0.1, line - tall, 0.2, tall))
    return marks


def _captions(
    target: Target, page: tuple[float, float]
) -> list[tuple[str, tuple[float, float]]]:
    length = _ruler_mm(page)
    left = (page[0] - length) / 2
    first = page[1] - _FOOT_MM - 4
    ruler = f"Ruler {length:.0f} mm between the end ticks"
    return [
        (f"{_title(target)}. Print at actual size (100 %).", (left, first)),
        (
            f"{ruler}; measure it, and several squares, with a caliper.",
            (left, first + 4),
        ),
    ]


def _title(target: Target) -> str:
    if isinstance(target, Chessboard):
        return (
            f"Chessboard {target.columns} x {target.rows} inner corners, "
            f"square {target.square.mm:g} mm"
        )
    if isinstance(target, Charuco):
        legacy = ", legacy layout" if target.legacy else ""
        return (
            f"ChArUco {target.columns} x {target.rows} squares of {target.square.mm:g} mm, "
            f"marker {target.marker_mm:g} mm, {target.dictionary}{legacy}"
        )
    kind = "asymmetric" if target.asymmetric else "symmetric"
    return (
        f"Circle grid {target.columns} x {target.rows}, {kind}, pitch "
        f"{target.pitch.mm:g} mm, disc {target.diameter_mm:g} mm"
    )


def _rectangle(x: float, y: float, width: float, height: float) -> FloatArray:
    return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])


def _circle(centre: FloatArray, radius: float) -> FloatArray:
    """Start and three points for each of four Bezier arcs, (13, 2)."""
    k = _CIRCLE
    quarter = np.array([[1, 0], [1, k], [k, 1]])
    turn = np.array([[0, 1], [-1, 0]])
    points = [quarter @ np.linalg.matrix_power(turn, number) for number in range(4)]
    return np.asarray(np.concatenate([*points, quarter[:1]]) * radius + centre)


def _path(shape: FloatArray) -> str:
    numbers = [f"{x:.5f} {y:.5f}" for x, y in shape]
    if len(shape) == 13:
        arcs = [" ".join(numbers[i : i + 3]) + " c" for i in range(1, 13, 3)]
        return " ".join([numbers[0], "m", *arcs, "f"])
    lines = [f"{point} l" for point in numbers[1:]]
    return " ".join([numbers[0], "m", *lines, "f"])


def _words(text: str, x: float, y: float) -> str:
    safe = text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    return f"BT /F1 {_TEXT_MM} Tf 1 0 0 -1 {x:.3f} {y:.3f} Tm ({safe}) Tj ET"


def _document(content: str, page: tuple[float, float]) -> bytes:
    box = f"[0 0 {page[0] * _POINTS_PER_MM:.6f} {page[1] * _POINTS_PER_MM:.6f}]"
    stream = content.encode("ascii")
    bodies = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R "
        f"/Resources << /Font << /F1 5 0 R >> >> >>".encode("ascii"),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(stream), stream),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    out = b"%PDF-1.6\n"
    places = []
    for number, body in enumerate(bodies, start=1):
        places.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    start = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n%s" % (len(bodies) + 1, table)
    trailer = b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n"
    return out + trailer % (len(bodies) + 1, start)
