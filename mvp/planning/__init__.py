"""The planner: problem in, ranked views with tolerance and explanation out."""

from mvp.planning.problem import (
    DEFAULT_CANDIDATES,
    DEFAULT_STARTS,
    Accept,
    LensBounds,
    PlanningProblem,
    Progress,
)
from mvp.planning.solve import Attempt, KindMargin, Solution, attempt, solve

__all__ = [
    "DEFAULT_CANDIDATES",
    "DEFAULT_STARTS",
    "Accept",
    "Attempt",
    "KindMargin",
    "LensBounds",
    "PlanningProblem",
    "Progress",
    "Solution",
    "attempt",
    "solve",
]
