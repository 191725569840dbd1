"""What does my decision give away, how do I change that, and what does it cost?

Every public name is importable from here and loaded when it is first used, so `import inscrutable` stays fast.
The imports below are the one list of public names: type checkers and editors read them, and so does this module itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

__version__ = "0.2.0"

if TYPE_CHECKING:  # one name a line, written `from inscrutable.module import Name as Name`
    from inscrutable.adversaries import ActionExplanation as ActionExplanation
    from inscrutable.adversaries import Adversary as Adversary
    from inscrutable.adversaries import AffordableBeliefs as AffordableBeliefs
    from inscrutable.adversaries import BayesianAdversary as BayesianAdversary
    from inscrutable.adversaries import BudgetAwareAdversary as BudgetAwareAdversary
    from inscrutable.adversaries import CalibratedSensor as CalibratedSensor
    from inscrutable.adversaries import CostLearningAdversary as CostLearningAdversary
    from inscrutable.adversaries import CostStatus as CostStatus
    from inscrutable.adversaries import DataAdversary as DataAdversary
    from inscrutable.adversaries import EstimatedSensor as EstimatedSensor
    from inscrutable.adversaries import EstimatedWorld as EstimatedWorld
    from inscrutable.adversaries import InferredBeliefs as InferredBeliefs
    from inscrutable.adversaries import InferredWeights as InferredWeights
    from inscrutable.adversaries import LearnedCost as LearnedCost
    from inscrutable.adversaries import LikelihoodStatus as LikelihoodStatus
    from inscrutable.adversaries import LinearView as LinearView
    from inscrutable.adversaries import NaiveAdversary as NaiveAdversary
    from inscrutable.adversaries import NearOptimalAdversary as NearOptimalAdversary
    from inscrutable.adversaries import NearOptimalBeliefs as NearOptimalBeliefs
    from inscrutable.adversaries import Posterior as Posterior
    from inscrutable.adversaries import PosteriorStatus as PosteriorStatus
    from inscrutable.adversaries import ProbeRanking as ProbeRanking
    from inscrutable.adversaries import SensorFamily as SensorFamily
    from inscrutable.adversaries import SensorStatus as SensorStatus
    from inscrutable.adversaries import SequenceStatus as SequenceStatus
    from inscrutable.adversaries import SequentialAdversary as SequentialAdversary
    from inscrutable.adversaries import ShownBeliefs as ShownBeliefs
    from inscrutable.adversaries import UnionBeliefs as UnionBeliefs
    from inscrutable.adversaries import best_probe as best_probe
    from inscrutable.adversaries import calibrate_sensor as calibrate_sensor
    from inscrutable.adversaries import consistent_beliefs as consistent_beliefs
    from inscrutable.adversaries import estimate_sensor as estimate_sensor
    from inscrutable.adversaries import estimate_world as estimate_world
    from inscrutable.adversaries import explain_action as explain_action
    from inscrutable.adversaries import infer_weights as infer_weights
    from inscrutable.adversaries import inverse_kalman_filter as inverse_kalman_filter
    from inscrutable.adversaries import near_optimal_beliefs as near_optimal_beliefs
    from inscrutable.adversaries import plausibility_gap as plausibility_gap
    from inscrutable.alphas import AlphaDecision as AlphaDecision
    from inscrutable.alphas import AlphaDecisionMaker as AlphaDecisionMaker
    from inscrutable.alphas import AlphaDraw as AlphaDraw
    from inscrutable.alphas import AlphaPath as AlphaPath
    from inscrutable.alphas import AlphaProblem as AlphaProblem
    from inscrutable.alphas import AlphaSequence as AlphaSequence
    from inscrutable.alphas import AlphaStatus as AlphaStatus
    from inscrutable.alphas import FactorRisk as FactorRisk
    from inscrutable.alphas import ImpliedViews as ImpliedViews
    from inscrutable.alphas import ViewStatus as ViewStatus
    from inscrutable.alphas import implied_views as implied_views
    from inscrutable.alphas import obfuscated_decision as obfuscated_decision
    from inscrutable.budgets import Budget as Budget
    from inscrutable.datasets.matpower import load_matpower as load_matpower
    from inscrutable.datasets.neighbours import weights_of as weights_of
    from inscrutable.datasets.power import load_ieee_30_bus as load_ieee_30_bus
    from inscrutable.datasets.power_packages import from_pandapower as from_pandapower
    from inscrutable.datasets.power_packages import from_pypsa as from_pypsa
    from inscrutable.decision_makers import Candidates as Candidates
    from inscrutable.decision_makers import CheapestPrivacy as CheapestPrivacy
    from inscrutable.decision_makers import CounterAdversarialDecisionMaker as CounterAdversarialDecisionMaker
    from inscrutable.decision_makers import Decision as Decision
    from inscrutable.decision_makers import Decisions as Decisions
    from inscrutable.decision_makers import DecisionSequence as DecisionSequence
    from inscrutable.decision_makers import DecisionStatus as DecisionStatus
    from inscrutable.decision_makers import DetectabilityCap as DetectabilityCap
    from inscrutable.decision_makers import Envelope as Envelope
    from inscrutable.decision_makers import FiniteRule as FiniteRule
    from inscrutable.decision_makers import FiniteStatus as FiniteStatus
    from inscrutable.decision_makers import Frontier as Frontier
    from inscrutable.decision_makers import GlobalSearch as GlobalSearch
    from inscrutable.decision_makers import Guarantee as Guarantee
    from inscrutable.decision_makers import LeastRegret as LeastRegret
    from inscrutable.decision_makers import LeastRegretStatus as LeastRegretStatus
    from inscrutable.decision_makers import LinearProgramme as LinearProgramme
    from inscrutable.decision_makers import LocalSearch as LocalSearch
    from inscrutable.decision_makers import MaximalLeakageCap as MaximalLeakageCap
    from inscrutable.decision_makers import MeanSquaredErrorFloor as MeanSquaredErrorFloor
    from inscrutable.decision_makers import MixedDecision as MixedDecision
    from inscrutable.decision_makers import MixedDecisions as MixedDecisions
    from inscrutable.decision_makers import NamingErrorFloor as NamingErrorFloor
    from inscrutable.decision_makers import OriginalDecisionMaker as OriginalDecisionMaker
    from inscrutable.decision_makers import PathDecisions as PathDecisions
    from inscrutable.decision_makers import PointwiseLeakageCap as PointwiseLeakageCap
    from inscrutable.decision_makers import PriceCalibration as PriceCalibration
    from inscrutable.decision_makers import PriceStatus as PriceStatus
    from inscrutable.decision_makers import ProbabilisticDecisionMaker as ProbabilisticDecisionMaker
    from inscrutable.decision_makers import RateDistortionCurve as RateDistortionCurve
    from inscrutable.decision_makers import RateDistortionDecisionMaker as RateDistortionDecisionMaker
    from inscrutable.decision_makers import SequentialDecisionMaker as SequentialDecisionMaker
    from inscrutable.decision_makers import SquaredErrorFloor as SquaredErrorFloor
    from inscrutable.decision_makers import StackelbergDecisionMaker as StackelbergDecisionMaker
    from inscrutable.decision_makers import action_grid as action_grid
    from inscrutable.decision_makers import cheapest_privacy as cheapest_privacy
    from inscrutable.decision_makers import decoy_grid as decoy_grid
    from inscrutable.decision_makers import least_regret as least_regret
    from inscrutable.decision_makers import privacy_frontier as privacy_frontier
    from inscrutable.decision_makers import random_candidates as random_candidates
    from inscrutable.decision_makers import rate_distortion_curve as rate_distortion_curve
    from inscrutable.decision_makers.baselines import Calibration as Calibration
    from inscrutable.decision_makers.baselines import CalibrationStatus as CalibrationStatus
    from inscrutable.decision_makers.baselines import CoinDecisionMaker as CoinDecisionMaker
    from inscrutable.decision_makers.baselines import DelayedDecisionMaker as DelayedDecisionMaker
    from inscrutable.decision_makers.baselines import DirichletDecisionMaker as DirichletDecisionMaker
    from inscrutable.decision_makers.baselines import ExponentialDecisionMaker as ExponentialDecisionMaker
    from inscrutable.decision_makers.baselines import KeptDecisionMaker as KeptDecisionMaker
    from inscrutable.decision_makers.baselines import PartialDecisionMaker as PartialDecisionMaker
    from inscrutable.decision_makers.baselines import RoundingDecisionMaker as RoundingDecisionMaker
    from inscrutable.decision_makers.baselines import UniformDecisionMaker as UniformDecisionMaker
    from inscrutable.decision_makers.baselines import calibrate as calibrate
    from inscrutable.errors import DiskError as DiskError
    from inscrutable.errors import InputError as InputError
    from inscrutable.errors import InscrutableError as InscrutableError
    from inscrutable.errors import ModelError as ModelError
    from inscrutable.errors import SolverError as SolverError
    from inscrutable.experiments.alpha_backtest import alpha_backtest as alpha_backtest
    from inscrutable.experiments.alpha_backtest import momentum_alphas as momentum_alphas
    from inscrutable.experiments.alpha_run import AlphaSettings as AlphaSettings
    from inscrutable.experiments.alpha_run import run_alpha_backtest as run_alpha_backtest
    from inscrutable.experiments.attack import attack_weights as attack_weights
    from inscrutable.experiments.audit import audit_pairs as audit_pairs
    from inscrutable.experiments.backtest import run_backtest as run_backtest
    from inscrutable.experiments.comparison import compare as compare
    from inscrutable.experiments.herding import HerdingTable as HerdingTable
    from inscrutable.experiments.herding import HerdStatus as HerdStatus
    from inscrutable.experiments.herding import SocialLearning as SocialLearning
    from inscrutable.experiments.herding import herding_table as herding_table
    from inscrutable.experiments.herding import social_learning as social_learning
    from inscrutable.experiments.investor_model import InvestorModel as InvestorModel
    from inscrutable.experiments.learning import LearningCurve as LearningCurve
    from inscrutable.experiments.learning import learning_curve as learning_curve
    from inscrutable.experiments.protect import protect as protect
    from inscrutable.experiments.reproduction import reproduce as reproduce
    from inscrutable.experiments.skfolio_estimator import PrivatePortfolio as PrivatePortfolio
    from inscrutable.experiments.studies import Study as Study
    from inscrutable.experiments.studies import resume_study as resume_study
    from inscrutable.experiments.studies import run_study as run_study
    from inscrutable.filtering import BeliefFilter as BeliefFilter
    from inscrutable.filtering import FilterResult as FilterResult
    from inscrutable.filtering import filter_beliefs as filter_beliefs
    from inscrutable.geometry import BeliefSet as BeliefSet
    from inscrutable.geometry import simplex_grid as simplex_grid
    from inscrutable.mechanisms import Disclosure as Disclosure
    from inscrutable.mechanisms import Mechanism as Mechanism
    from inscrutable.mechanisms import MechanismRule as MechanismRule
    from inscrutable.mechanisms import MemoryMechanism as MemoryMechanism
    from inscrutable.mechanisms import Prior as Prior
    from inscrutable.mechanisms import at_least as at_least
    from inscrutable.mechanisms import bus_prices as bus_prices
    from inscrutable.mechanisms import delayed as delayed
    from inscrutable.mechanisms import every as every
    from inscrutable.mechanisms import filtered_prior as filtered_prior
    from inscrutable.mechanisms import form_13f as form_13f
    from inscrutable.mechanisms import grouped as grouped
    from inscrutable.mechanisms import long_only as long_only
    from inscrutable.mechanisms import mechanism as mechanism
    from inscrutable.mechanisms import n_port as n_port
    from inscrutable.mechanisms import only as only
    from inscrutable.mechanisms import portfolio_return as portfolio_return
    from inscrutable.mechanisms import predicted_prior as predicted_prior
    from inscrutable.mechanisms import reachable_beliefs as reachable_beliefs
    from inscrutable.mechanisms import rounded as rounded
    from inscrutable.mechanisms import stationary_prior as stationary_prior
    from inscrutable.mechanisms import top as top
    from inscrutable.mechanisms import uniform_prior as uniform_prior
    from inscrutable.privacy import DesiredObfuscation as DesiredObfuscation
    from inscrutable.privacy import Detectability as Detectability
    from inscrutable.privacy import Infeasibility as Infeasibility
    from inscrutable.privacy import Leakage as Leakage
    from inscrutable.privacy import MaximalObfuscation as MaximalObfuscation
    from inscrutable.privacy import NamingError as NamingError
    from inscrutable.privacy import NonExistence as NonExistence
    from inscrutable.privacy import NonUniqueness as NonUniqueness
    from inscrutable.privacy import PathLeakage as PathLeakage
    from inscrutable.privacy import PrivacyMeasure as PrivacyMeasure
    from inscrutable.privacy import RepeatedLeakage as RepeatedLeakage
    from inscrutable.privacy import RivalProblem as RivalProblem
    from inscrutable.privacy import SquaredError as SquaredError
    from inscrutable.privacy import detectability as detectability
    from inscrutable.privacy import leakage as leakage
    from inscrutable.privacy import path_leakage as path_leakage
    from inscrutable.privacy import repeated_leakage as repeated_leakage
    from inscrutable.problems import ConvexProblem as ConvexProblem
    from inscrutable.problems import DecisionProblem as DecisionProblem
    from inscrutable.problems import DispatchProblem as DispatchProblem
    from inscrutable.problems import FiniteProblem as FiniteProblem
    from inscrutable.problems import KellyProblem as KellyProblem
    from inscrutable.problems import Lift as Lift
    from inscrutable.problems import LinearForm as LinearForm
    from inscrutable.problems import LinearProblem as LinearProblem
    from inscrutable.problems import MarkowitzProblem as MarkowitzProblem
    from inscrutable.problems import PiecewiseLinearProblem as PiecewiseLinearProblem
    from inscrutable.problems import Polyhedron as Polyhedron
    from inscrutable.problems import PowerNetwork as PowerNetwork
    from inscrutable.problems import QuadraticForm as QuadraticForm
    from inscrutable.problems import QuadraticProblem as QuadraticProblem
    from inscrutable.problems import RevealedPreferences as RevealedPreferences
    from inscrutable.problems import RowConflict as RowConflict
    from inscrutable.problems import SmoothForm as SmoothForm
    from inscrutable.problems import TradingProblem as TradingProblem
    from inscrutable.problems import box as box
    from inscrutable.problems import dispatch_problem as dispatch_problem
    from inscrutable.problems import group_caps as group_caps
    from inscrutable.problems import long_short as long_short
    from inscrutable.problems import max_weights as max_weights
    from inscrutable.problems import min_weights as min_weights
    from inscrutable.problems import preference_problem as preference_problem
    from inscrutable.problems import revealed_preferences as revealed_preferences
    from inscrutable.problems import simplex as simplex
    from inscrutable.problems import turnover as turnover
    from inscrutable.problems import with_transaction_costs as with_transaction_costs
    from inscrutable.testing import check_adversary as check_adversary
    from inscrutable.testing import check_decision_maker as check_decision_maker
    from inscrutable.testing import check_decision_problem as check_decision_problem
    from inscrutable.testing import check_emission as check_emission
    from inscrutable.testing import check_privacy_measure as check_privacy_measure
    from inscrutable.worlds import CategoricalEmission as CategoricalEmission
    from inscrutable.worlds import Emission as Emission
    from inscrutable.worlds import FittedWorld as FittedWorld
    from inscrutable.worlds import GaussianEmission as GaussianEmission
    from inscrutable.worlds import HiddenMarkovModel as HiddenMarkovModel
    from inscrutable.worlds import KalmanResult as KalmanResult
    from inscrutable.worlds import LinearGaussianWorld as LinearGaussianWorld
    from inscrutable.worlds import PublicPart as PublicPart
    from inscrutable.worlds import SteadyFilter as SteadyFilter
    from inscrutable.worlds import Trajectory as Trajectory
    from inscrutable.worlds import fit_gaussian_hmm as fit_gaussian_hmm
    from inscrutable.worlds import kalman_filter as kalman_filter
    from inscrutable.worlds import steady_filter as steady_filter
    from inscrutable.worlds.neighbours import from_dynamax as from_dynamax
    from inscrutable.worlds.neighbours import from_hmmlearn as from_hmmlearn
    from inscrutable.worlds.neighbours import from_statsmodels as from_statsmodels
else:  # hidden from type checkers, which would otherwise accept any misspelt name
    _START = f"    from {__name__}."
    _EXPORTS = {
        words[3]: words[1].removeprefix(f"{__name__}.")
        for words in (line.split() for line in __loader__.get_source(__name__).splitlines() if line.startswith(_START))
    }
    """The module of every public name."""

    __all__ = sorted(_EXPORTS)

    def __getattr__(name: str) -> object:
        """Load a public name from its module on first use (PEP 562)."""
        if name not in _EXPORTS:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name)
        from importlib import import_module

        value = getattr(import_module(f"{__name__}.{_EXPORTS[name]}"), name)
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        """List the public names, loaded or not."""
        return sorted({*globals(), *_EXPORTS})
