"""Simple rules that hide a belief, and their calibration to the same expected regret."""

from inscrutable.decision_makers.baselines.calibration import Calibration, CalibrationStatus, calibrate
from inscrutable.decision_makers.baselines.coin import CoinDecisionMaker
from inscrutable.decision_makers.baselines.dirichlet import DirichletDecisionMaker
from inscrutable.decision_makers.baselines.exponential import ExponentialDecisionMaker
from inscrutable.decision_makers.baselines.kept import KeptDecisionMaker
from inscrutable.decision_makers.baselines.path import DelayedDecisionMaker, PartialDecisionMaker
from inscrutable.decision_makers.baselines.rounding import RoundingDecisionMaker
from inscrutable.decision_makers.baselines.uniform import UniformDecisionMaker

__all__ = [
    "Calibration",
    "CalibrationStatus",
    "CoinDecisionMaker",
    "DelayedDecisionMaker",
    "DirichletDecisionMaker",
    "ExponentialDecisionMaker",
    "KeptDecisionMaker",
    "PartialDecisionMaker",
    "RoundingDecisionMaker",
    "UniformDecisionMaker",
    "calibrate",
]
