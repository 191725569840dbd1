"""Step 3: decision problems, their costs and feasible sets."""

from inscrutable.problems.afriat import (
    RevealedPreferences,
    preference_problem,
    revealed_preferences,
)
from inscrutable.problems.base import DecisionProblem, checked_problem
from inscrutable.problems.conflicts import RowConflict
from inscrutable.problems.constraints import Polyhedron, box, simplex
from inscrutable.problems.convex import ConvexProblem
from inscrutable.problems.dispatch import DispatchProblem, dispatch_problem
from inscrutable.problems.finite import FiniteProblem
from inscrutable.problems.forms import Lift, LinearForm, QuadraticForm, SmoothForm
from inscrutable.problems.kelly import KellyProblem
from inscrutable.problems.linear import LinearProblem
from inscrutable.problems.markowitz import MarkowitzProblem
from inscrutable.problems.piecewise_linear import PiecewiseLinearProblem
from inscrutable.problems.portfolios import group_caps, long_short, max_weights, min_weights, turnover
from inscrutable.problems.power_network import PowerNetwork
from inscrutable.problems.quadratic import QuadraticProblem, quadratic_problem
from inscrutable.problems.transaction_costs import TradingProblem, with_transaction_costs

__all__ = [
    "ConvexProblem",
    "DecisionProblem",
    "DispatchProblem",
    "FiniteProblem",
    "KellyProblem",
    "Lift",
    "LinearForm",
    "LinearProblem",
    "MarkowitzProblem",
    "PiecewiseLinearProblem",
    "Polyhedron",
    "PowerNetwork",
    "QuadraticForm",
    "QuadraticProblem",
    "RevealedPreferences",
    "RowConflict",
    "SmoothForm",
    "TradingProblem",
    "box",
    "checked_problem",
    "dispatch_problem",
    "group_caps",
    "long_short",
    "max_weights",
    "min_weights",
    "preference_problem",
    "quadratic_problem",
    "revealed_preferences",
    "simplex",
    "turnover",
    "with_transaction_costs",
]
