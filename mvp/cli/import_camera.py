"""``mvp-cell import-camera CELL FILE``: a camera that another program calibrated."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mvp.cli.options import CellArgument, JsonOption

if TYPE_CHECKING:
    from mvp.cell.exchange_documents import ImportCameraDocument


def import_camera(
    cell: CellArgument,
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="of OpenCV, ROS camera_info or Kalibr"),
    ],
    serial: Annotated[
        str, typer.Option("--serial", metavar="NUMBER", help="of the camera")
    ] = "",
    date: Annotated[
        str,
        typer.Option("--date", metavar="YYYY-MM-DD", help="when it was measured"),
    ] = "",
    temperature_c: Annotated[
        float | None,
        typer.Option("--temperature-c", metavar="T", help="how warm it was then"),
    ] = None,
    sigma: Annotated[
        list[str] | None,
        typer.Option(
            "--sigma",
            metavar="NAME=VALUE",
            help="one standard deviation of fx_px fy_px cx_px cy_px k1 k2 p1 p2 or k3; "
            "may be repeated",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Take over a camera that another program calibrated.

    Put beside the cell file, MARGINAL at best; the calibration before is kept.
    """
    from mvp.cell.import_camera_job import ImportRequest
    from mvp.cell.import_camera_job import import_camera as carry_out
    from mvp.cli.output import print_model

    request = ImportRequest(serial, date, temperature_c, sigma or ())
    document = carry_out(cell, file, request)
    _tell(document, cell)
    if as_json:
        print_model(document)
    return 0


def _tell(document: ImportCameraDocument, cell: str) -> None:
    from mvp.cli.naming import named
    from mvp.cli.output import console, tell_warning

    found, lines = document.document, [f"{document.file}: {document.format}"]
    lines[0] += (
        f", principal distance {document.principal_distance_mm:.4f} mm, principal point "
        f"({found.centre_x_px:.2f}, {found.centre_y_px:.2f}) px, k1 {found.k1:.4f}"
    )
    lines.append(f"put in place: {document.placed}")
    if document.kept:
        lines.append(f"the one before is kept in {document.kept}")
    if document.unused:
        lines.append(f"keys that were not used: {', '.join(document.unused)}")
    lines += [f"not known: {what}" for what in document.unsaid]
    if document.overruled:
        names = ", ".join(document.overruled)
        lines.append(f"the lens table has {names} for every zoom: they count instead")
    origin, verdict = found.provenance.origin, found.quality.verdict.upper()
    lines.append(f"the result is {verdict}, and counts as {origin}")
    for line in lines:
        console().print(line, markup=False)
    for one in document.objections:
        use = "`run` refuses it: " if one.refused else ""
        tell_warning(f"{use}{one.text}", hint=named(one.fix, cell))
