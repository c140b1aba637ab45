"""Find views for a task: all features in one if possible, otherwise in several.

Features are split greedily: a view starts with the first feature that is left and takes
in every other one that can be added while the view stays admissible and reachable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import islice
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mvp.cell.calibration_gates import measure_again
from mvp.cell.lens_validity import beyond_words, narrowed_axes
from mvp.cell.objectives import repairs, searched
from mvp.cell.realise_view import RealisedView, realise
from mvp.cell.settled_zoom import settled_zoom
from mvp.cell.unseen import unseen
from mvp.planning.explain import explain
from mvp.planning.rows import RowTable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.arm_setup import ArmSetup
    from mvp.cell.contrast import ContrastForecast
    from mvp.cell.plan_problem import ProblemFactory
    from mvp.planning import Attempt, PlanningProblem, Solution
    from mvp.scene import Feature
    from mvp.visibility import Region

Tell: TypeAlias = Callable[[str], None]

_SOLUTIONS_TRIED = 12
# Solutions compared by contrast while none shows enough, and how much worse one may be.
_COMPARED = 5
_NEARLY_AS_GOOD = 0.8
# A group that is only a trial in a split is searched with less effort.
_TRIAL_STARTS = 8
_TRIAL_CANDIDATES = 8_000
_FIXES = {
    "reach": "move the part, give the arm more room or a larger workspace, or leave "
    "out what stands in its way",
    "lens_range": "widen f_mm, d_mm or a_mm in the task, mount another lens or tube, or "
    "measure the lens over a wider range",
    "max_views": "raise planning.max_views in the task",
}


@dataclass(frozen=True, eq=False)
class Failed:
    """Why a group of features has no view.

    Attributes:
        reason: in the user's words.
        problem: the optical problem, None when the region or the lens leaves nothing.
        attempt: what the search found.
        kind: what stood in the way.
        fix: what would change it.
    """

    features: tuple[Feature, ...]
    reason: str
    kind: str
    problem: PlanningProblem | None = None
    attempt: Attempt | None = None
    fix: str = ""

    @property
    def nearest(self) -> Solution | None:
        """The best compromise found."""
        if self.attempt is None or not self.attempt.solutions:
            return None
        return self.attempt.solutions[0]


@dataclass(frozen=True, eq=False)
class Found:
    """Views and what stayed without."""

    views: tuple[RealisedView, ...]
    failed: tuple[Failed, ...]
    together: Failed | None


@dataclass(frozen=True, eq=False)
class ViewFinder:
    """Searches views for groups of features."""

    factory: ProblemFactory
    arm: ArmSetup
    seed: int
    tell: Tell
    forecast: ContrastForecast | None = None

    def find(self, features: Sequence[Feature], max_views: int) -> Found:
        """All features in one view, or as few views as the greedy split finds."""
        whole = self.group(features)
        if isinstance(whole, RealisedView):
            return Found((whole,), (), None)
        if len(features) == 1:
            return Found((), (whole,), None)
        views, failed = self._split(list(features), max_views)
        return Found(tuple(views), tuple(failed), whole)

    def _split(
        self, left: list[Feature], max_views: int
    ) -> tuple[list[RealisedView], list[Failed]]:
        views: list[RealisedView] = []
        failed: list[Failed] = []
        while left:
            first = left.pop(0)
            if len(views) == max_views:
                failed.append(
                    Failed(
                        (first,),
                        f"the task allows only {max_views} views",
                        "max_views",
                    )
                )
                continue
            self.tell(f"view {len(views) + 1}: {first.id}")
            view = self.group([first])
            if isinstance(view, Failed):
                failed.append(view)
                continue
            view = self._grown(view, left)
            taken = {f.id for f in view.features}
            left = [f for f in left if f.id not in taken]
            views.append(view)
        return views, failed

    def _grown(self, view: RealisedView, left: Sequence[Feature]) -> RealisedView:
        """The view with every further feature that it can take in."""
        trial_only = view
        for feature in left:
            wider = self.group([*trial_only.features, feature], trial=True)
            if isinstance(wider, RealisedView):
                trial_only = wider
        if trial_only is view:
            return view
        thorough = self.group(trial_only.features)
        return thorough if isinstance(thorough, RealisedView) else trial_only

    def group(
        self, features: Sequence[Feature], *, trial: bool = False
    ) -> RealisedView | Failed:
        """One view for all of some features, or why there is none."""
        self.tell(f"visibility of {_names(features)}")
        region = self.factory.common_region(features)
        blind = unseen(self.factory, features, region)
        if blind is not None:
            return Failed(tuple(features), blind.reason, "visibility", fix=blind.fix)
        mounted, *others = self.factory.tubes_mm()
        failure = self._with_tube(features, region, mounted, trial=trial)
        if isinstance(failure, RealisedView) or trial:
            return failure
        for tube_mm in others:
            if not _may_help(failure, tube_mm - mounted):
                continue
            outcome = self._with_tube(features, region, tube_mm, trial=trial)
            if isinstance(outcome, RealisedView):
                return outcome
            if failure.problem is None and outcome.problem is not None:
                failure = outcome
        return failure

    def _with_tube(
        self,
        features: Sequence[Feature],
        region: Region,
        tube_mm: float,
        *,
        trial: bool,
    ) -> RealisedView | Failed:
        lens = self.factory.lens_bounds(tube_mm)
        if lens is None:
            return Failed(
                tuple(features),
                "the task's ranges of f, d and a leave nothing that the lens can do"
                + (f" on the {tube_mm:g} mm tube" if tube_mm else ""),
                "lens_range",
            )
        factory = self.factory
        lens = settled_zoom(factory, features, region, lens, tube_mm, self.seed)
        problem = factory.problem(features, region, lens, tube_mm)
        if trial:
            problem = replace(
                problem, starts=_TRIAL_STARTS, candidates=_TRIAL_CANDIDATES
            )
        self.tell(f"search for {_names(features)}")
        outcome = self._searched(features, problem, tube_mm)
        if isinstance(outcome, Failed) and outcome.kind == "reach" and not trial:
            self.tell(f"search for {_names(features)}, camera clear of everything")
            clear = replace(problem, accept=self.arm.reachable_and_clear)
            again = self._searched(features, clear, tube_mm)
            return again if isinstance(again, RealisedView) else outcome
        return outcome

    def _searched(
        self, features: Sequence[Feature], problem: PlanningProblem, tube_mm: float
    ) -> RealisedView | Failed:
        objective = self.factory.task.config.planning.objective
        found = searched(problem, objective, self.seed)
        admissible = [s for s in found.solutions if s.status == "admissible"]
        if not admissible:
            return _inadmissible(features, problem, found)
        outcome = self._realised(features, problem, admissible, tube_mm)
        if isinstance(outcome, RealisedView):
            return replace(outcome, repairs=repairs(problem, found))
        return replace(outcome, attempt=found)

    def _realised(
        self,
        features: Sequence[Feature],
        problem: PlanningProblem,
        admissible: Sequence[Solution],
        tube_mm: float,
    ) -> RealisedView | Failed:
        """The first solution that the arm can take, or one that shows more contrast.

        Another is taken only if the first shows too little and it is nearly as good.
        """
        reasons: list[str] = []
        good: list[RealisedView] = []
        for solution in islice(admissible, _SOLUTIONS_TRIED):
            if good and solution.t < _NEARLY_AS_GOOD * good[0].solution.t:
                break
            view = realise(
                self.factory,
                self.arm,
                features,
                problem,
                solution,
                tube_mm,
                self.forecast,
            )
            if isinstance(view, RealisedView):
                good.append(view)
                if _shown(view) >= 1 or len(good) == _COMPARED:
                    break
            else:
                reasons.append(view.reason)
        if good:
            return max(good, key=_shown)
        parts = (part for reason in reasons for part in reason.split("; "))
        text = "; ".join(dict.fromkeys(parts))
        return Failed(
            tuple(features),
            f"the arm cannot take any of the {len(reasons)} views that optics allow: "
            f"{text}",
            "reach",
            problem,
            fix=_FIXES["reach"],
        )

    def explained(self, found: Found) -> Found:
        """The same, with what would help the features that stayed without a view."""
        return replace(
            found,
            failed=tuple(self._bound(f) or self._explained(f) for f in found.failed),
        )

    def _bound(self, failed: Failed) -> Failed | None:
        """Say so when only the range over which the lens table holds is in the way."""
        whole = replace(self.factory, beyond=True)
        narrowed = narrowed_axes(whole.table, self.factory.table)
        searched = failed.problem is not None or failed.kind == "lens_range"
        if not narrowed or not searched:
            return None
        self.tell(
            f"whether {_names(failed.features)} can be seen beyond the lens table"
        )
        view = replace(self, factory=whole).group(failed.features)
        if isinstance(view, Failed):
            return None
        file = self.factory.cell.calibrations.files["lens_table"]
        lacks, needs = beyond_words(narrowed, view.steps)
        return replace(
            failed,
            reason=f"{failed.reason}; what binds is the range over which the lens table "
            f"holds ({lacks}; {file}): the motors would go on to a view with {needs}",
            fix=f"measure the lens so far: {measure_again('lens_table')}, and includes "
            f"{needs}",
        )

    def _explained(self, failed: Failed) -> Failed:
        """Ask the planner why, unless the reason lies outside of it."""
        nearest = failed.nearest
        if failed.problem is None or failed.attempt is None or nearest is None:
            return replace(failed, fix=failed.fix or _FIXES[failed.kind])
        if nearest.status == "admissible":
            return replace(failed, fix=failed.fix or _FIXES["reach"])
        self.tell(f"why there is no view of {_names(failed.features)}")
        answer = explain(
            failed.problem,
            failed.attempt,
            seed=self.seed,
            name_face=self.factory.face_name,
            splittable=len(failed.features) > 1,
        )
        blocked = (
            f"; in the way: {', '.join(answer.blockers)}" if answer.blockers else ""
        )
        return replace(
            failed,
            reason=f"{failed.reason}: {answer.reason}{blocked} ({answer.searched})",
            fix=answer.fix,
        )


def _shown(view: RealisedView) -> float:
    """How nearly every line of a view shows enough contrast, 1 when nothing is known."""
    return 1.0 if view.contrast is None else view.contrast.rank


def _may_help(failed: Failed, longer_mm: float) -> bool:
    """Whether another tube could be the cure: d is what holds the view back."""
    if failed.kind == "lens_range":
        return True
    held = set() if failed.nearest is None else set(failed.nearest.duals.bounds)
    return ("d_max" if longer_mm > 0 else "d_min") in held


def _inadmissible(
    features: Sequence[Feature], problem: PlanningProblem, found: Attempt
) -> Failed:
    solutions = found.solutions
    if not solutions:
        return Failed(
            tuple(features),
            "no viewpoint that sees everything lies inside the workspace and the "
            "arm's reach",
            "reach",
            problem,
            found,
        )
    best = solutions[0]
    worst = min(best.margins, key=lambda kind: best.margins[kind].index)
    return Failed(
        tuple(features),
        f"the best view found misses {missed(problem, best)}",
        worst,
        problem,
        found,
    )


def missed(problem: PlanningProblem, best: Solution) -> str:
    """Every requirement that a view misses, worst first, by how much and where."""
    table = RowTable.of(problem)
    found = []
    for kind, margin in sorted(best.margins.items(), key=lambda item: item[1].index):
        if margin.index >= 0:
            continue
        rows = table.mask(kind) & (best.index < 0)
        order = np.argsort(np.where(rows, best.index, np.inf))[: rows.sum()]
        # The image circle is carried as rows in several directions.
        labels = dict.fromkeys(table.labels[row].split(" at ")[0] for row in order)
        where = "" if kind == "visibility" else f" ({_shortened(list(labels), '; ')})"
        amount = f"{abs(margin.value):.3g} {margin.unit}"
        found.append(f"{kind.replace('_', ' ')} by {amount}{where}")
    return ", ".join(found)


def _names(features: Sequence[Feature]) -> str:
    return _shortened([f.id for f in features], ", ")


def _shortened(names: Sequence[str], between: str) -> str:
    """The first three names and how many more there are."""
    shown = between.join(names[:3])
    return shown if len(names) <= 3 else f"{shown} and {len(names) - 3} more"
