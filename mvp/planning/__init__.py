"""The planner: problem in, ranked views with tolerance and explanation out."""

from mvp.constraints.sigma import Uncertainty
from mvp.planning.chance import failure_probability
from mvp.planning.cures import Cure
from mvp.planning.explain import Conflict, Explanation, explain
from mvp.planning.paper_objective import (
    PAPER_1,
    PAPER_2,
    PRESETS,
    PaperSolution,
    solve_paper,
)
from mvp.planning.paper_table import PaperWeights
from mvp.planning.problem import (
    DEFAULT_CANDIDATES,
    DEFAULT_STARTS,
    Accept,
    LensBounds,
    PlanningProblem,
    Progress,
)
from mvp.planning.recheck import Recheck, recheck
from mvp.planning.relaxation import Amount, relaxed
from mvp.planning.sensitivity import sensitivity
from mvp.planning.solution import KindMargin, Solution, evaluate
from mvp.planning.solve import Attempt, attempt, solve
from mvp.planning.tolerance import Certificate, ToleranceBox, certify, proven
from mvp.planning.tube import TubeAdvice, tube_needed

__all__ = [
    "DEFAULT_CANDIDATES",
    "DEFAULT_STARTS",
    "PAPER_1",
    "PAPER_2",
    "PRESETS",
    "Accept",
    "Amount",
    "Attempt",
    "Certificate",
    "Conflict",
    "Cure",
    "Explanation",
    "KindMargin",
    "LensBounds",
    "PaperSolution",
    "PaperWeights",
    "PlanningProblem",
    "Progress",
    "Recheck",
    "Solution",
    "ToleranceBox",
    "TubeAdvice",
    "Uncertainty",
    "attempt",
    "certify",
    "evaluate",
    "explain",
    "failure_probability",
    "proven",
    "recheck",
    "relaxed",
    "sensitivity",
    "solve",
    "solve_paper",
    "tube_needed",
]
