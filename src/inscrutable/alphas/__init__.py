"""Gaussian private means (expected returns, signals, set points): decisions about them and what these reveal."""

from inscrutable.alphas.decision_maker import AlphaDecisionMaker
from inscrutable.alphas.obfuscation import AlphaDecision, obfuscated_decision
from inscrutable.alphas.plans import AlphaStatus
from inscrutable.alphas.problem import AlphaProblem
from inscrutable.alphas.risk import FactorRisk
from inscrutable.alphas.sequence import AlphaDraw, AlphaPath, AlphaSequence
from inscrutable.alphas.views import ImpliedViews, ViewStatus, implied_views

__all__ = [
    "AlphaDecision",
    "AlphaDecisionMaker",
    "AlphaDraw",
    "AlphaPath",
    "AlphaProblem",
    "AlphaSequence",
    "AlphaStatus",
    "FactorRisk",
    "ImpliedViews",
    "ViewStatus",
    "implied_views",
    "obfuscated_decision",
]
