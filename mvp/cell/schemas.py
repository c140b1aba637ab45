"""Every file format and document of the program with its JSON schema."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.calibrated import (
    CameraCalibration,
    LensTableCalibration,
    MeasuredTarget,
    RigidCalibration,
)
from mvp.cell.calibrate_document import CalibrateDocument
from mvp.cell.cell_config import CellConfig
from mvp.cell.check_items import CheckDocument
from mvp.cell.documents import (
    DriversDocument,
    ErrorDocument,
    InitDocument,
    ReportDocument,
    RunsDocument,
    TargetDocument,
)
from mvp.cell.exchange_documents import ExportCameraDocument, ImportCameraDocument
from mvp.cell.features_document import FeaturesDocument
from mvp.cell.home_job import HomeDocument
from mvp.cell.jog_job import JogDocument
from mvp.cell.plugged_in import DevicesDocument
from mvp.cell.records import record_schema
from mvp.cell.recover_job import RecoverDocument
from mvp.cell.run_document import RunDocument
from mvp.cell.simulation import Simulation
from mvp.cell.task_config import TaskConfig
from mvp.cell.truth_compared import TruthDocument
from mvp.planning.plan import Plan
from mvp.wizard import Sample, SessionFile

if TYPE_CHECKING:
    from pydantic import BaseModel

MODELS: dict[str, type[BaseModel]] = {
    "cell": CellConfig,
    "task": TaskConfig,
    "camera": CameraCalibration,
    "lens-table": LensTableCalibration,
    "rigid": RigidCalibration,
    "target-size": MeasuredTarget,
    "target": TargetDocument,
    "plan": Plan,
    "run": RunDocument,
    "features": FeaturesDocument,
    "error": ErrorDocument,
    "check": CheckDocument,
    "home": HomeDocument,
    "recover": RecoverDocument,
    "jog": JogDocument,
    "simulation": Simulation,
    "drivers": DriversDocument,
    "devices": DevicesDocument,
    "runs": RunsDocument,
    "report": ReportDocument,
    "init": InitDocument,
    "calibrate": CalibrateDocument,
    "truth": TruthDocument,
    "export-camera": ExportCameraDocument,
    "import-camera": ImportCameraDocument,
    "calibration-session": SessionFile,
    "calibration-sample": Sample,
}


def all_schemas() -> dict[str, dict[str, object]]:
    """JSON schema by file name without its ending."""
    found: dict[str, dict[str, object]] = {
        name: model.model_json_schema(by_alias=True) for name, model in MODELS.items()
    }
    found["record"] = record_schema()
    return found
