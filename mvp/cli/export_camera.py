"""``mvp-cell export-camera CELL``: the camera of a cell for another program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mvp.cli.options import AcceptOption, CellArgument, JsonOption


def export_camera(
    cell: CellArgument,
    to: Annotated[
        str, typer.Option("--to", metavar="FORMAT", help="opencv, ros or kalibr")
    ] = "opencv",
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE.yaml", help="where to write it")
    ] = Path("camera.yaml"),
    at: Annotated[
        str,
        typer.Option(
            "--at",
            metavar="ZOOM,FOCUS,IRIS",
            help="motor steps to which the intrinsics belong; else those of the "
            "camera calibration",
        ),
    ] = "",
    accept_calibration: AcceptOption = "",
    as_json: JsonOption = False,
) -> int:
    """Write the camera for OpenCV, ROS or Kalibr.

    Intrinsics belong to one setting of the lens; the file says to which.
    """
    from mvp.cell.export_camera_job import export_camera as carry_out
    from mvp.cli.output import console, print_model, tell_warning

    document = carry_out(cell, out, to, at=at, accept=accept_calibration)
    for warning in document.warnings:
        tell_warning(warning)
    console().print(
        f"{document.file}: {document.format}, for {document.setting}; principal "
        f"distance {document.principal_distance_mm:.4f} mm",
        markup=False,
    )
    if as_json:
        print_model(document)
    return 0
