"""Step 6: who decides, and how much of the belief the decision gives away."""

from inscrutable.decision_makers.aware.cheapest_rule import LeastRegret, LeastRegretStatus, least_regret
from inscrutable.decision_makers.aware.guarantees import (
    DetectabilityCap,
    Guarantee,
    MaximalLeakageCap,
    MeanSquaredErrorFloor,
    NamingErrorFloor,
    PointwiseLeakageCap,
    SquaredErrorFloor,
)
from inscrutable.decision_makers.aware.rate_distortion import (
    RateDistortionCurve,
    RateDistortionDecisionMaker,
    rate_distortion_curve,
)
from inscrutable.decision_makers.aware.stackelberg import StackelbergDecisionMaker
from inscrutable.decision_makers.candidate_sources import action_grid, decoy_grid, random_candidates
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.cheapest import CheapestPrivacy, cheapest_privacy
from inscrutable.decision_makers.counter_adversarial import CounterAdversarialDecisionMaker, GlobalSearch
from inscrutable.decision_makers.frontier import Frontier, privacy_frontier
from inscrutable.decision_makers.local_search import LocalSearch
from inscrutable.decision_makers.original import OriginalDecisionMaker
from inscrutable.decision_makers.probabilistic import Envelope, LinearProgramme, ProbabilisticDecisionMaker
from inscrutable.decision_makers.results import Decision, Decisions, DecisionStatus, MixedDecision, MixedDecisions
from inscrutable.decision_makers.sequential.finite import FiniteRule, FiniteStatus
from inscrutable.decision_makers.sequential.path import PathDecisions
from inscrutable.decision_makers.sequential.prices import PriceCalibration, PriceStatus
from inscrutable.decision_makers.sequential.rule import SequentialDecisionMaker
from inscrutable.decision_makers.sequential.sequence import DecisionSequence

__all__ = [
    "Candidates",
    "CheapestPrivacy",
    "CounterAdversarialDecisionMaker",
    "Decision",
    "DecisionSequence",
    "DecisionStatus",
    "Decisions",
    "DetectabilityCap",
    "Envelope",
    "FiniteRule",
    "FiniteStatus",
    "Frontier",
    "GlobalSearch",
    "Guarantee",
    "LeastRegret",
    "LeastRegretStatus",
    "LinearProgramme",
    "LocalSearch",
    "MaximalLeakageCap",
    "MeanSquaredErrorFloor",
    "MixedDecision",
    "MixedDecisions",
    "NamingErrorFloor",
    "OriginalDecisionMaker",
    "PathDecisions",
    "PointwiseLeakageCap",
    "PriceCalibration",
    "PriceStatus",
    "ProbabilisticDecisionMaker",
    "RateDistortionCurve",
    "RateDistortionDecisionMaker",
    "SequentialDecisionMaker",
    "SquaredErrorFloor",
    "StackelbergDecisionMaker",
    "action_grid",
    "cheapest_privacy",
    "decoy_grid",
    "least_regret",
    "privacy_frontier",
    "random_candidates",
    "rate_distortion_curve",
]
