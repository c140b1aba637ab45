"""The report of a calibration: one self-contained HTML page that prints well."""

from calibration.report.from_camera import camera_report
from calibration.report.from_hand_eye import hand_eye_report
from calibration.report.from_lens import lens_report
from calibration.report.from_part import PartPicture, part_report
from calibration.report.from_session import about_session
from calibration.report.model import About, LeftOut, Photo, Quantity, ReportData
from calibration.report.refused import refused_report
from calibration.report.write import render_report, write_report

__all__ = [
    "About",
    "LeftOut",
    "PartPicture",
    "Photo",
    "Quantity",
    "ReportData",
    "about_session",
    "camera_report",
    "hand_eye_report",
    "lens_report",
    "part_report",
    "refused_report",
    "render_report",
    "write_report",
]
