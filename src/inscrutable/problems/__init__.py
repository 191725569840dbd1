"""Step 3: what the agent decides, at what cost, under which constraints."""

from inscrutable.problems.base import DecisionProblem, checked_problem
from inscrutable.problems.constraints import Polyhedron, box, simplex
from inscrutable.problems.convex import ConvexProblem
from inscrutable.problems.finite import FiniteProblem
from inscrutable.problems.kelly import KellyProblem
from inscrutable.problems.linear import LinearProblem
from inscrutable.problems.markowitz import MarkowitzProblem
from inscrutable.problems.quadratic import QuadraticProblem

__all__ = [
    "ConvexProblem",
    "DecisionProblem",
    "FiniteProblem",
    "KellyProblem",
    "LinearProblem",
    "MarkowitzProblem",
    "Polyhedron",
    "QuadraticProblem",
    "box",
    "checked_problem",
    "simplex",
]
