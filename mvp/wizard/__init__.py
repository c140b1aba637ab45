"""How a calibration talks to people and to the cell: steps, bench, registry.

A wizard is a generator of steps. It knows neither terminal nor driver: whoever drives it
shows each step and sends back an answer, and the bench that it was given moves arm and
lens and takes pictures. Everything that it learns goes into the session's folder, and
its result is computed from that folder alone, so that a session can be resumed after a
crash and computed again without any device.

Writing one (the whole of it)::

    class FocusWizard:
        key = "focus"               # mvp-cell calibrate focus CELL
        writes = "lens_table"       # which file of [calibration] it makes
        sessions = SessionStore     # what keeps its samples

        def steps(self, bench, store, options):
            yield Say("the lens is tried at three settings")
            for number in range(len(store.usable()), 3):
                stand = bench.joints_for(pose_of(number), d_mm=12.9)
                if isinstance(stand, Refusal): ...
                way = bench.way_to(stand.joints)
                if isinstance(way, Refusal): ...
                allowed = yield Allow(f"to view {number + 1}", way.seconds)
                if allowed is Word.UNDO: ...
                if allowed is Word.FINISH: break
                if not allowed: continue
                bench.move(stand.joints)
                sample = store.add(bench.shoot(), Finding(points...), name="...")
                yield Sampled(sample.number, sample.name, sample.usable, ...)
            return self.outcome(store)

        def outcome(self, store):   # from the folder alone: same numbers every time
            return Outcome(self.key, document, quality)

        def page(self, store, outcome):
            return html             # the report; "" when there is none

and one line in ``[project.entry-points."mvp_cell.wizards"]``.

Rules: a wizard looks first at what the store holds already (a resumed session) and goes
on from there; whatever it asks or decides and its result depends on is put into the
store with ``remember`` before it goes on; all randomness comes from ``bench.rng(n)``, n
a number that the store tells.
"""

from mvp.wizard.camera_files import (
    OF_SIMULATED_CELL,
    CameraFiles,
    CameraStatement,
    ImportedCamera,
    load_camera_files,
)
from mvp.wizard.facts import SessionFacts, TargetFacts
from mvp.wizard.part import PartSights, SeenPart, SightView
from mvp.wizard.protocol import (
    Bench,
    Outcome,
    Refusal,
    Shot,
    Stand,
    Store,
    Way,
    Wizard,
    WizardOptions,
)
from mvp.wizard.registry import WIZARDS, load_wizard, wizard_keys
from mvp.wizard.session_files import Sample, SessionFile
from mvp.wizard.steps import (
    Allow,
    Answer,
    Ask,
    Covered,
    Forecast,
    Sampled,
    Say,
    Step,
    Wait,
    Word,
    Working,
)
from mvp.wizard.target_sheet import TargetSheet, load_target_drawer

__all__ = [
    "OF_SIMULATED_CELL",
    "WIZARDS",
    "Allow",
    "Answer",
    "Ask",
    "Bench",
    "CameraFiles",
    "CameraStatement",
    "Covered",
    "Forecast",
    "ImportedCamera",
    "Outcome",
    "PartSights",
    "Refusal",
    "Sample",
    "Sampled",
    "Say",
    "SeenPart",
    "SessionFacts",
    "SessionFile",
    "Shot",
    "SightView",
    "Stand",
    "Step",
    "Store",
    "TargetFacts",
    "TargetSheet",
    "Wait",
    "Way",
    "Wizard",
    "WizardOptions",
    "Word",
    "Working",
    "load_camera_files",
    "load_target_drawer",
    "load_wizard",
    "wizard_keys",
]
