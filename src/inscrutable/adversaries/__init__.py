"""Observers: what somebody infers about the belief from a decision."""

from inscrutable.adversaries.bayesian import BayesianAdversary, Posterior, PosteriorStatus
from inscrutable.adversaries.budget_aware import AffordableBeliefs, affordable_beliefs
from inscrutable.adversaries.consistent_sets import ConsistentSets, consistent_sets
from inscrutable.adversaries.cost_learning import CostLearningAdversary
from inscrutable.adversaries.data_adversary import DataAdversary
from inscrutable.adversaries.explanations import ActionExplanation, explain_action
from inscrutable.adversaries.fund_values import InferredWeights, infer_weights
from inscrutable.adversaries.interface import Adversary
from inscrutable.adversaries.inverse import plausibility_gap
from inscrutable.adversaries.learned_costs import CostStatus, LearnedCost, UnionBeliefs
from inscrutable.adversaries.near_optimal import NearOptimalBeliefs, near_optimal_beliefs
from inscrutable.adversaries.observers import BudgetAwareAdversary, NaiveAdversary, NearOptimalAdversary
from inscrutable.adversaries.rounded import consistent_beliefs
from inscrutable.adversaries.sensor import (
    CalibratedSensor,
    EstimatedSensor,
    EstimatedWorld,
    LikelihoodStatus,
    LinearView,
    ProbeRanking,
    SensorFamily,
    SensorStatus,
    best_probe,
    calibrate_sensor,
    estimate_sensor,
    estimate_world,
    inverse_kalman_filter,
)
from inscrutable.adversaries.sequence_results import InferredBeliefs, SequenceStatus
from inscrutable.adversaries.sequential import SequentialAdversary
from inscrutable.adversaries.shown_beliefs import ShownBeliefs

__all__ = [
    "ActionExplanation",
    "Adversary",
    "AffordableBeliefs",
    "BayesianAdversary",
    "BudgetAwareAdversary",
    "CalibratedSensor",
    "ConsistentSets",
    "CostLearningAdversary",
    "CostStatus",
    "DataAdversary",
    "EstimatedSensor",
    "EstimatedWorld",
    "InferredBeliefs",
    "InferredWeights",
    "LearnedCost",
    "LikelihoodStatus",
    "LinearView",
    "NaiveAdversary",
    "NearOptimalAdversary",
    "NearOptimalBeliefs",
    "Posterior",
    "PosteriorStatus",
    "ProbeRanking",
    "SensorFamily",
    "SensorStatus",
    "SequenceStatus",
    "SequentialAdversary",
    "ShownBeliefs",
    "UnionBeliefs",
    "affordable_beliefs",
    "best_probe",
    "calibrate_sensor",
    "consistent_beliefs",
    "consistent_sets",
    "estimate_sensor",
    "estimate_world",
    "explain_action",
    "infer_weights",
    "inverse_kalman_filter",
    "near_optimal_beliefs",
    "plausibility_gap",
]
