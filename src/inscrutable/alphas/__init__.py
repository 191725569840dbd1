"""Beliefs that are numbers: expected returns, signals, set points, and what decisions that follow them say."""

from inscrutable.alphas.decision_maker import AlphaDecisionMaker
from inscrutable.alphas.plans import AlphaStatus
from inscrutable.alphas.problem import AlphaProblem
from inscrutable.alphas.risk import FactorRisk
from inscrutable.alphas.sequence import AlphaDecision, AlphaPath, AlphaSequence

__all__ = [
    "AlphaDecision",
    "AlphaDecisionMaker",
    "AlphaPath",
    "AlphaProblem",
    "AlphaSequence",
    "AlphaStatus",
    "FactorRisk",
]
