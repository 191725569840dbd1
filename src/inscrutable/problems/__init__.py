"""Step 3: what the agent decides, at what cost, under which constraints."""

from inscrutable.problems.base import DecisionProblem, checked_problem
from inscrutable.problems.conflicts import RowConflict
from inscrutable.problems.constraints import Polyhedron, box, simplex
from inscrutable.problems.markowitz import MarkowitzProblem
from inscrutable.problems.portfolios import group_caps, long_short, max_weights, min_weights, turnover
from inscrutable.problems.quadratic import QuadraticProblem

__all__ = [
    "DecisionProblem",
    "MarkowitzProblem",
    "Polyhedron",
    "QuadraticProblem",
    "RowConflict",
    "box",
    "checked_problem",
    "group_caps",
    "long_short",
    "max_weights",
    "min_weights",
    "simplex",
    "turnover",
]
