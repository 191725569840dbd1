"""Beliefs that are numbers: expected returns, signals, set points, and what decisions that follow them say."""

from inscrutable.alphas.problem import AlphaProblem
from inscrutable.alphas.risk import FactorRisk

__all__ = ["AlphaProblem", "FactorRisk"]
