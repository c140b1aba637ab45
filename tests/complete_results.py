"""What every result of a calibration has to say, whatever was calibrated."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

_QUALITY = (
    "verdict",
    "rms_px",
    "error_95_mm",
    "condition",
    "weakest_direction",
    "chi_square",
    "degrees_of_freedom",
    "chi_square_probability",
    "views",
)
_PROVENANCE = (
    "date",
    "device_serial",
    "method",
    "input_sha256",
    "temperature_source",
    "origin",
    "serial_numbers",
    "built_on",
)
_MADE_FROM_NOTHING = "camera"  # of [calibration]: is built on no other


def missing_of(result: Mapping[str, Any]) -> list[str]:
    """Names of what a ``result.json`` leaves open; of a refused one, why it is."""
    quality, document = result["quality"], result["document"]
    if document is None:
        told = quality["causes"] and quality["next_action"] and quality["reasons"]
        return [] if told else ["causes and next action"]
    stamp = document["provenance"]
    missing = [f"quality.{k}" for k in _QUALITY if quality[k] in (None, "", [])]
    missing += [
        f"provenance.{k}"
        for k in _PROVENANCE
        if stamp[k] in (None, "", {})
        and (k, result["key"]) != ("built_on", _MADE_FROM_NOTHING)
    ]
    if stamp["temperature_source"] != "unknown" and stamp["temperature_c"] is None:
        missing.append("provenance.temperature_c")
    if quality["out_of_sample_px"] is None and quality["out_of_sample_mm"] is None:
        missing.append("quality.out_of_sample")
    if not document.get("covariance"):
        missing.append("covariance")
    missing += [f"rms_px of {v['name']}" for v in quality["views"] if not v["rms_px"]]
    missing += [f"points of {p['view']}" for p in result["points"] if not p["ids"]]
    if len(result["points"]) < len(quality["views"]):
        missing.append("points")
    if quality["verdict"] != "go" and not (
        quality["causes"] and quality["next_action"]
    ):
        missing.append("causes and next action")
    if result["comparison"] is None or not result["comparison"]["words"]:
        missing.append("comparison")
    if not any("mm" in line for line in result["lines"]):
        missing.append("the result in mm")
    if not any("against the calibration before" in line for line in result["lines"]):
        missing.append("the comparison in words")
    return missing
