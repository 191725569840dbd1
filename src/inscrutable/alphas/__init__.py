"""Beliefs that are numbers: expected returns, signals, set points, and what decisions that follow them say."""

from inscrutable.alphas.obfuscation import AlphaDecision, obfuscated_decision
from inscrutable.alphas.problem import AlphaProblem
from inscrutable.alphas.risk import FactorRisk
from inscrutable.alphas.views import ImpliedViews, ViewStatus, implied_views

__all__ = [
    "AlphaDecision",
    "AlphaProblem",
    "FactorRisk",
    "ImpliedViews",
    "ViewStatus",
    "implied_views",
    "obfuscated_decision",
]
