"""Labelled tables are aligned by their labels or refused, wherever numbers enter."""

from __future__ import annotations

import functools
import inspect
import re
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import inscrutable as ins
from inscrutable import InputError, InscrutableError
from inscrutable.mechanisms.chains import resting_chain
from sizes import some

ASSETS = ["Food", "Oil", "Gas"]
STATES = ["calm", "crisis"]
MEANS = pd.DataFrame([[0.02, 0.05, 0.03], [0.01, -0.06, -0.02]], STATES, ASSETS)
SPREAD = {
    "calm": pd.DataFrame(np.diag([0.02, 0.05, 0.03]) + 0.01, ASSETS, ASSETS),
    "crisis": pd.DataFrame(np.diag([0.04, 0.30, 0.10]) + 0.03, ASSETS, ASSETS),
}
CAPS = pd.Series([0.8, 0.6, 0.7], ASSETS)
BELIEF = pd.Series([0.3, 0.7], STATES)
MONTHS = pd.period_range("2001-01", periods=3, freq="M")
BELIEFS = pd.DataFrame([[0.3, 0.7], [0.5, 0.5], [0.9, 0.1]], MONTHS, STATES)
WEIGHTS = pd.Series([0.5, 0.2, 0.3], ASSETS)
HOLDINGS = pd.DataFrame([[0.5, 0.2, 0.3], [0.6, 0.3, 0.1], [0.2, 0.4, 0.4]], MONTHS, ASSETS)
STEADY = pd.DataFrame([[0.9, 0.1], [0.3, 0.7]], STATES, STATES)
INITIAL = pd.Series([0.6, 0.4], STATES)
RETURNS = pd.DataFrame(np.random.default_rng(5).normal(size=(3, 3)), MONTHS, ASSETS)
ROWS = pd.DataFrame(
    np.vstack([-np.eye(3), [1.0, 0.0, 0.0]]), ["no Food short", "no Oil short", "no Gas short", "cap"], ASSETS
)
SIDES = pd.Series([0.0, 0.0, 0.0, 0.7], ROWS.index)
ONE = pd.DataFrame([[1.0, 1.0, 1.0]], ["sum"], ASSETS)
TABLE = pd.DataFrame([[0.4, 0.6], [0.2, 0.8]], STATES, ["win", "lose"])
GROSS = {
    "calm": pd.DataFrame([[1.0, 1.2, 1.1], [1.0, 0.8, 0.9]], TABLE.columns, ASSETS),
    "crisis": pd.DataFrame([[1.0, 1.5, 1.0], [1.0, 0.7, 0.95]], TABLE.columns, ASSETS),
}
FLOWS = pd.DataFrame([[1.0, 2.0, 1.5], [2.0, 1.0, 1.5], [1.0, 1.0, 3.0]], MONTHS, ASSETS)

DAYS = pd.date_range("2001-01-31", periods=60, freq="ME")
FLAGS = pd.DataFrame(np.random.default_rng(6).normal(size=(60, 3)), DAYS, ASSETS)
SIGNALS = pd.DataFrame({"score": FLAGS["Oil"] + FLAGS["Gas"] ** 2, "signal": FLAGS["Food"] - FLAGS["Gas"]}, DAYS)
LEARNED = pd.DataFrame({"calm": (FLAGS["Oil"] > 0) * 1.0, "crisis": (FLAGS["Oil"] <= 0) * 1.0})


LOADS = pd.DataFrame([[1.0, 0.5], [0.2, -1.0], [0.0, 2.0]], ASSETS, STATES)
SQUARE = pd.DataFrame([[0.04, 0.01], [0.01, 0.09]], STATES, STATES)
OWN = ins.AlphaProblem(SPREAD["calm"], 2.0)
SIGNALLED = ins.AlphaProblem(SPREAD["calm"], 2.0, None, LOADS)


def moving(move: Any, process: Any = SQUARE, sensor: Any = LOADS) -> Any:
    """A linear Gaussian world of two states, read in three columns."""
    return ins.LinearGaussianWorld(0.9 * move, process, sensor, SPREAD["calm"])


def seen_pairs(beliefs: Any, actions: Any) -> Any:
    """What an observer of data reads where states and assets are named, rows in the order given."""
    seen = ins.DataAdversary(beliefs, actions)
    read = seen.estimate(pd.Series([0.4, 1.0, -0.3], ASSETS))
    return pd.Series(read, list(beliefs.columns))[STATES].to_numpy()


def shuffles(value: Any) -> Iterator[Any]:
    """The same labelled numbers in the other order of both axes, and in `make audit` of one axis at a time as well."""
    if isinstance(value, pd.Series):
        yield value.iloc[::-1]
    elif isinstance(value, pd.DataFrame):
        yield from some([value.iloc[::-1, ::-1], value.iloc[::-1], value.iloc[:, ::-1]], 3)
    elif isinstance(value, dict):
        yield dict(reversed(value.items()))
        for key, part in value.items():
            for other in shuffles(part):
                yield {**value, key: other}


def markowitz(means: Any = MEANS, covariances: Any = SPREAD, limits: Any = CAPS) -> ins.MarkowitzProblem:
    return ins.MarkowitzProblem(means, covariances, 2.0, ins.simplex(3) & ins.max_weights(ASSETS, limits))


NAMED = markowitz()
BARE = ins.MarkowitzProblem(MEANS.to_numpy(), [each.to_numpy() for each in SPREAD.values()], 2.0)
SHOWN = NAMED.solve(BELIEF)
SET = ins.consistent_beliefs(NAMED, SHOWN)
BLURRED = ins.NaiveAdversary(NAMED, disclosure="rounded(6)", candidates=[SHOWN]).infer(ins.rounded(6).shown([SHOWN])[0])
PRIOR = ins.uniform_prior(2, 4)
PLAYED = ins.mechanism(ins.OriginalDecisionMaker(NAMED), PRIOR.beliefs)
CANDIDATES = ins.decoy_grid(NAMED, 6)
SENSOR = ins.GaussianEmission(MEANS, SPREAD)
WORLD = ins.HiddenMarkovModel(STEADY, SENSOR, INITIAL)
SYMBOLS = ins.CategoricalEmission([[0.8, 0.2], [0.3, 0.7]])
QUADRATIC: dict[str, Any] = {"constraints": ins.simplex(3)}
NETWORK = ([0.0, 50.0], [0, 1], [80.0, 40.0], [0.02, 0.01], [1.0, 2.0], [[0, 1]], [[0.1, 30.0]])
MODEL = ins.InvestorModel(ins.HiddenMarkovModel(STEADY, SENSOR), NAMED, tuple(ASSETS), tuple(STATES))
WALK = ins.HiddenMarkovModel([[0.9, 0.1], [0.3, 0.7]], SYMBOLS)


def costs(problem: Any) -> Any:
    """What a problem says where states and assets are named, whatever their order inside."""
    states = pd.Series(problem.state_costs(WEIGHTS), problem.state_names)[STATES]
    return states.to_numpy(), problem.optimal_cost(BELIEF), problem.optimal_cost(BELIEFS)


def bought(prices: Any, choices: Any) -> ins.RevealedPreferences:
    return ins.revealed_preferences(prices, choices, efficiency=0.8)


def region_of(region: Any) -> Any:
    held = HOLDINGS if region.asset_names is not None else HOLDINGS.to_numpy()
    return (
        [region.violation(row) for _, row in held.iterrows()] if hasattr(held, "iterrows") else region.violation(held)
    )


def law(world: Any) -> Any:
    found = ins.filter_beliefs(world, RETURNS)
    return found.beliefs[STATES].to_numpy(), found.log_likelihood


def chances(sensor: Any) -> Any:
    return pd.DataFrame(sensor.log_likelihoods(RETURNS), columns=sensor.state_names)[STATES].to_numpy()


def fitted(returns: Any) -> Any:
    found = ins.fit_gaussian_hmm(returns, 1, rng=np.random.default_rng(0), n_restarts=1).world.emission
    return pd.Series(found.means[0], found.asset_names)[ASSETS].to_numpy()


SIMPLE = ins.MarkowitzProblem(MEANS, SPREAD, 2.0)
KNOWN = {"prior": PRIOR, "candidates": CANDIDATES}
MAKERS: dict[str, Callable[[], Any]] = {
    "OriginalDecisionMaker": lambda: ins.OriginalDecisionMaker(NAMED),
    "CounterAdversarialDecisionMaker": lambda: ins.CounterAdversarialDecisionMaker(NAMED, candidates=CANDIDATES),
    "ProbabilisticDecisionMaker": lambda: ins.ProbabilisticDecisionMaker(NAMED, candidates=CANDIDATES),
    "CoinDecisionMaker": lambda: ins.CoinDecisionMaker(NAMED, 0.3),
    "ExponentialDecisionMaker": lambda: ins.ExponentialDecisionMaker(NAMED, 30.0, candidates=CANDIDATES),
    "UniformDecisionMaker": lambda: ins.UniformDecisionMaker(NAMED, 0.1, candidates=CANDIDATES),
    "DirichletDecisionMaker": lambda: ins.DirichletDecisionMaker(
        SIMPLE, 50.0, rng=np.random.default_rng(0), n_draws=20
    ),
    "RoundingDecisionMaker": lambda: ins.RoundingDecisionMaker(NAMED, 0.05),
    "RateDistortionDecisionMaker": lambda: ins.RateDistortionDecisionMaker(NAMED, 0.01, **KNOWN),
    "StackelbergDecisionMaker": lambda: ins.StackelbergDecisionMaker(NAMED, 0.01, **KNOWN),
    "DelayedDecisionMaker": lambda: ins.DelayedDecisionMaker(NAMED, 1),
    "PartialDecisionMaker": lambda: ins.PartialDecisionMaker(NAMED, 0.5),
    "KeptDecisionMaker": lambda: ins.KeptDecisionMaker(ins.OriginalDecisionMaker(NAMED)),
    "SequentialDecisionMaker": lambda: sequential().begin(),
    "DecisionSequence": lambda: published(),
}


def sequential() -> Any:
    chain = resting_chain(PRIOR, 0.8)
    prices = ins.PriceCalibration.at(30.0, float("inf"))
    return ins.SequentialDecisionMaker(
        NAMED, 0.05, chain=chain, candidates=CANDIDATES, calibration=prices, rng=np.random.default_rng(0)
    )


def published() -> Any:
    """A sequence that has a labelled decision behind it."""
    sequence = sequential().begin()
    played = pd.Series(sequence.decide(BELIEF).actions[0], NAMED.asset_names)
    sequence.publish(played.iloc[::-1])
    sequence.observe()
    return sequence


def decided(make: Callable[[], Any]) -> Callable[[Any], Any]:
    """The regrets of a decision, of all its atoms where it is a lottery."""
    made = functools.cache(make)

    def ask(belief: Any) -> Any:
        found = made().decide(belief)
        return found.regret if hasattr(found, "regret") else found.expected_cost

    return ask


# Entry point, labelled input, what it is asked. A second name after a space says which argument.
READ = pd.DataFrame(
    ins.filter_beliefs(
        ins.HiddenMarkovModel(STEADY, ins.CategoricalEmission([[0.8, 0.2], [0.3, 0.7]])),
        np.random.default_rng(7).integers(0, 2, 60),
    ).beliefs,
    columns=STATES,
)
ACCURACY = ins.SensorFamily(lambda q: ins.CategoricalEmission([[q, 1 - q], [1 - q, q]]), [(0.55, 0.95)], ["accuracy"])
CHOICES = ins.FiniteProblem(pd.DataFrame([[0.0, 1.0], [1.0, 0.0]], STATES))
SIGNAL = ins.CategoricalEmission([[0.7, 0.3], [0.3, 0.7]])


def read_transition(beliefs: Any) -> Any:
    """The transition read from beliefs, its states in one order."""
    world = ins.estimate_world(beliefs, n_symbols=2).world
    return pd.DataFrame(world.transition, world.names, world.names).loc[STATES, STATES].to_numpy()


ENTRIES: list[tuple[str, Any, Callable[[Any], Any]]] = [
    ("estimate_sensor beliefs", READ, lambda v: ins.estimate_sensor(v, STEADY).probabilities),
    ("estimate_world", READ, read_transition),
    (
        "calibrate_sensor",
        HOLDINGS,
        lambda v: ins.calibrate_sensor(v, [0, 1, 0], PLAYED, ACCURACY, world=WALK).parameters,
    ),
    (
        "AlphaDecisionMaker",
        SPREAD["crisis"],
        lambda v: ins.AlphaDecisionMaker(OWN, 0.5, prior_covariance=v).error_covariance,
    ),
    ("social_learning", INITIAL, lambda v: ins.social_learning(CHOICES, SIGNAL, n_agents=3, prior=v).regrets),
    (
        "herding_table",
        INITIAL,
        lambda v: (
            ins.herding_table(CHOICES, SIGNAL, {"ODM": ins.OriginalDecisionMaker(CHOICES)}, n_agents=3, prior=v)[
                "ODM"
            ].regrets
        ),
    ),
    ("MarkowitzProblem means", MEANS, lambda v: costs(markowitz(means=v))),
    ("MarkowitzProblem covariances", SPREAD, lambda v: costs(markowitz(covariances=v))),
    ("MarkowitzProblem list", SPREAD["crisis"], lambda v: costs(markowitz(covariances=[SPREAD["calm"], v]))),
    ("max_weights", CAPS, lambda v: costs(markowitz(limits=v))),
    ("max_weights dict", dict(CAPS), lambda v: costs(markowitz(limits=v))),
    ("min_weights", CAPS / 4, lambda v: region_of(ins.min_weights(ASSETS, v))),
    ("QuadraticProblem hessians", SPREAD, lambda v: costs(ins.QuadraticProblem(v, MEANS, **QUADRATIC))),
    ("QuadraticProblem linear", MEANS, lambda v: costs(ins.QuadraticProblem(SPREAD, v, **QUADRATIC))),
    ("QuadraticProblem constants", INITIAL, lambda v: costs(ins.QuadraticProblem(SPREAD, MEANS, v, **QUADRATIC))),
    ("LinearProblem", MEANS, lambda v: costs(ins.LinearProblem(v, ins.simplex(3) & ins.max_weights(ASSETS, CAPS)))),
    ("FiniteProblem", MEANS, lambda v: costs(ins.FiniteProblem(v))),
    ("KellyProblem gross", GROSS, lambda v: costs(ins.KellyProblem(v, TABLE))),
    ("KellyProblem probabilities", TABLE, lambda v: costs(ins.KellyProblem(GROSS, v))),
    (
        "PiecewiseLinearProblem",
        {"calm": MEANS, "crisis": MEANS * 2},
        lambda v: costs(ins.PiecewiseLinearProblem(v, {"calm": INITIAL, "crisis": INITIAL}, ins.simplex(3))),
    ),
    ("Polyhedron A_ub", ROWS, lambda v: region_of(ins.Polyhedron(v, SIDES, ONE, [1.0]))),
    ("Polyhedron b_ub", SIDES, lambda v: region_of(ins.Polyhedron(ROWS, v, ONE, [1.0]))),
    ("Polyhedron A_eq", ONE * [1.0, 2.0, 3.0], lambda v: region_of(ins.Polyhedron(ROWS, SIDES, v, [1.0]))),
    ("Polyhedron slacks", WEIGHTS, NAMED.constraints.slacks),
    ("Polyhedron violation", HOLDINGS, lambda v: np.sort(NAMED.constraints.violation(v))),
    ("Polyhedron is_admissible", WEIGHTS, NAMED.constraints.is_admissible),
    ("Polyhedron bare", WEIGHTS, ins.simplex(3).slacks),
    ("Polyhedron &", dict(CAPS), lambda v: region_of(ins.max_weights(list(v), v) & ins.max_weights(ASSETS, 0.3))),
    ("box lower", CAPS - 0.5, lambda v: region_of(ins.box(v, CAPS))),
    ("box upper", CAPS, lambda v: region_of(ins.box(CAPS - 0.5, v))),
    (
        "group_caps caps",
        {"energy": 0.4, "all": 0.9},
        lambda v: np.sort(region_of(ins.group_caps(ASSETS, {"energy": ASSETS[1:], "all": ASSETS}, v))),
    ),
    ("turnover", WEIGHTS, lambda v: region_of(ins.turnover(v, 0.1))),
    ("turnover assets", dict(WEIGHTS), lambda v: region_of(ins.turnover(v, 0.1, assets=ASSETS))),
    ("with_transaction_costs former", WEIGHTS, lambda v: costs(ins.with_transaction_costs(NAMED, v, linear=0.01))),
    ("with_transaction_costs linear", CAPS, lambda v: costs(ins.with_transaction_costs(NAMED, WEIGHTS, linear=v))),
    (
        "with_transaction_costs quadratic",
        CAPS,
        lambda v: costs(ins.with_transaction_costs(NAMED, WEIGHTS, quadratic=v)),
    ),
    ("TradingProblem", WEIGHTS, lambda v: costs(ins.TradingProblem(NAMED, v, CAPS))),
    ("revealed_preferences prices", FLOWS, lambda v: bought(v, HOLDINGS).utility(WEIGHTS)),
    ("revealed_preferences choices", HOLDINGS, lambda v: bought(FLOWS, v).utility(WEIGHTS)),
    ("RevealedPreferences utility", WEIGHTS, bought(FLOWS, HOLDINGS).utility),
    (
        "preference_problem",
        FLOWS,
        lambda v: ins.preference_problem(
            [bought(each, HOLDINGS) for each in (FLOWS, v)], NAMED.constraints
        ).state_costs(WEIGHTS),
    ),
    (
        "dispatch_problem",
        pd.DataFrame([[5.0, 4.0], [25.0, 9.0]], STATES, ["west", "east"]),
        lambda v: ins.dispatch_problem(ins.PowerNetwork(*NETWORK), [0, 1], v).linear,
    ),
    ("PowerNetwork", pd.Series([0.0, 50.0], ["north", "south"]), lambda v: ins.PowerNetwork(v, *NETWORK[1:]).loads),
    (
        "PowerNetwork labelled",
        pd.Series([0.0, 50.0], ["north", "south"]),
        lambda v: ins.dispatch_problem(
            ins.PowerNetwork(v, ["north", "south"], *NETWORK[2:5], [["north", "south"]], NETWORK[6])
        ).solve([1.0]),
    ),
    ("weights_of", WEIGHTS, lambda v: ins.weights_of(v)[ASSETS].to_numpy()),
    (
        "ConvexProblem",
        WEIGHTS,
        lambda v: ins.ConvexProblem.from_functions(
            NAMED.state_costs, NAMED.cost_gradients, NAMED.constraints, start=v
        ).optimal_cost([0.3, 0.7]),
    ),
    ("DecisionProblem solve", BELIEF, NAMED.solve),
    ("DecisionProblem solve many", BELIEFS, lambda v: np.sort(NAMED.solve(v), axis=0)),
    ("DecisionProblem solve bare", BELIEF, BARE.solve),
    ("DecisionProblem state_costs", WEIGHTS, NAMED.state_costs),
    ("DecisionProblem state_costs bare", WEIGHTS, BARE.state_costs),
    ("DecisionProblem cost_gradients", WEIGHTS, NAMED.cost_gradients),
    ("DecisionProblem expected_cost", BELIEFS, lambda v: np.sort(NAMED.expected_cost(v, HOLDINGS))),
    ("DecisionProblem regret", HOLDINGS, lambda v: np.sort(NAMED.regret(BELIEFS, v))),
    ("DecisionProblem regret dict", dict(WEIGHTS), lambda v: NAMED.regret(BELIEF, v)),
    ("DecisionProblem optimal_cost", BELIEF, NAMED.optimal_cost),
    ("BeliefSet contains", BELIEF, SET.contains),
    ("BeliefSet distance", BELIEF, SET.distance),
    ("BeliefSet nearest", BELIEF, SET.nearest),
    ("BeliefSet violation", BELIEF, SET.violation),
    ("consistent_beliefs", WEIGHTS, lambda v: ins.consistent_beliefs(NAMED, v).residual),
    ("consistent_beliefs bare", WEIGHTS, lambda v: ins.consistent_beliefs(BARE, v).residual),
    ("near_optimal_beliefs", WEIGHTS, lambda v: ins.near_optimal_beliefs(NAMED, v, 0.1).bounds()),
    ("NearOptimalBeliefs", BELIEF, ins.near_optimal_beliefs(NAMED, WEIGHTS, 0.1).distance),
    ("plausibility_gap", WEIGHTS, lambda v: ins.plausibility_gap(NAMED, v)),
    ("explain_action", WEIGHTS, lambda v: ins.explain_action(NAMED, v).belief),
    ("NaiveAdversary", HOLDINGS, lambda v: np.sort(ins.NaiveAdversary(NAMED).estimates(v, nearest=True), axis=0)),
    ("NearOptimalAdversary", WEIGHTS, ins.NearOptimalAdversary(NAMED, 0.1).estimate),
    (
        "BudgetAwareAdversary",
        WEIGHTS,
        lambda v: ins.BudgetAwareAdversary(NAMED, ins.Budget.regret(0.1)).infer(v).bounds(),
    ),
    ("AffordableBeliefs", BELIEF, ins.BudgetAwareAdversary(NAMED, ins.Budget.regret(0.1)).infer(WEIGHTS).distance),
    ("BayesianAdversary", WEIGHTS, lambda v: ins.BayesianAdversary(PLAYED, PRIOR).estimate(v, nearest=True)),
    ("SequentialAdversary", HOLDINGS, lambda v: ins.SequentialAdversary(WALK, PLAYED).filter(v, nearest=True).mean),
    (
        "SequentialAdversary states",
        pd.Series([0, 1, 0], MONTHS),
        lambda v: (
            ins.SequentialAdversary(WALK, PLAYED)
            .filter(pd.DataFrame(HOLDINGS.to_numpy(), MONTHS), states=v, nearest=True)
            .mean
        ),
    ),
    (
        "CostLearningAdversary means",
        MEANS,
        lambda v: round(
            ins.CostLearningAdversary.risk_aversion(v, SPREAD, (1.5, 2.5))
            .learn(pd.DataFrame(SIMPLE.solve(BELIEFS), columns=ASSETS))
            .parameter,
            6,
        ),
    ),
    ("Prior beliefs", BELIEFS, lambda v: ins.Prior(v, pd.Series([0.2, 0.3, 0.5], MONTHS)).mean),
    ("Prior weights", pd.Series([0.2, 0.3, 0.5], MONTHS), lambda v: ins.Prior(BELIEFS.to_numpy(), v).mean[:1] * 0),
    ("Mechanism", BELIEFS, lambda v: ins.Mechanism(v, [[1.0]], np.ones((3, 1)), np.zeros((3, 1))).beliefs),
    (
        "MemoryMechanism",
        BELIEFS,
        lambda v: ins.MemoryMechanism(v, [[1.0]], np.ones((3, 1, 1, 1)), [1.0], np.zeros((3, 1))).beliefs,
    ),
    (
        "PartialDecisionMaker holdings",
        HOLDINGS,
        lambda v: np.sort(ins.PartialDecisionMaker(NAMED, 0.5).memory_mechanism([BELIEF], v).actions, axis=0),
    ),
    ("mechanism", BELIEFS, lambda v: np.sort(ins.mechanism(ins.OriginalDecisionMaker(NAMED), v).beliefs, axis=0)),
    ("HiddenMarkovModel transition", STEADY, lambda v: law(ins.HiddenMarkovModel(v, SENSOR, INITIAL))),
    ("HiddenMarkovModel initial", INITIAL, lambda v: law(ins.HiddenMarkovModel(STEADY, SENSOR, v))),
    ("GaussianEmission means", MEANS, lambda v: chances(ins.GaussianEmission(v, SPREAD))),
    ("GaussianEmission covariances", SPREAD, lambda v: chances(ins.GaussianEmission(MEANS, v))),
    ("GaussianEmission log_likelihoods", RETURNS, lambda v: np.sort(SENSOR.log_likelihoods(v), axis=0)),
    ("CategoricalEmission", TABLE, lambda v: ins.CategoricalEmission(v).log_likelihoods([0, 1])),
    (
        "PublicPart",
        pd.DataFrame([[0.2, 0.5, 0.3], [1.0, -1.0, 0.0]], ["market", "tilt"], ASSETS),
        lambda v: pd.Series(
            ins.HiddenMarkovModel(STEADY, SENSOR, public=ins.PublicPart(v)).public_of(RETURNS)[0], list(v.index)
        )[["market", "tilt"]].to_numpy(),
    ),
    (
        "filter_beliefs public",
        RETURNS,
        lambda v: ins.filter_beliefs(
            ins.HiddenMarkovModel(STEADY, SYMBOLS, INITIAL, public=SENSOR), pd.Series([0, 1, 0], MONTHS), public=v
        ).beliefs.to_numpy(),
    ),
    ("filter_beliefs", RETURNS.iloc[:1], lambda v: ins.filter_beliefs(WORLD, v).beliefs.to_numpy()),
    ("BeliefFilter", RETURNS.iloc[0], lambda v: ins.BeliefFilter(WORLD).update(v)),
    ("fit_gaussian_hmm", pd.concat([RETURNS, RETURNS**2], ignore_index=True), lambda v: np.round(fitted(v), 12)),
    ("DesiredObfuscation", BELIEF, lambda v: ins.DesiredObfuscation(v)(BELIEF, SET)),
    ("DesiredObfuscation callable", BELIEF, lambda v: ins.DesiredObfuscation(lambda _: v)(BELIEF, SET)),
    ("MaximalObfuscation", BELIEF, lambda v: ins.MaximalObfuscation()(v, SET)),
    ("NonExistence", BELIEF, lambda v: ins.NonExistence()(v, SET)),
    ("NonUniqueness", BELIEF, lambda v: ins.NonUniqueness()(v, SET)),
    ("privacy_frontier", BELIEF, lambda v: ins.privacy_frontier(NAMED, v, candidates=CANDIDATES).optimal_cost),
    ("cheapest_privacy", BELIEF, lambda v: ins.cheapest_privacy(NAMED, v, privacy=0.1, candidates=CANDIDATES).regret),
    ("CoinDecisionMaker decoy", BELIEF, lambda v: ins.CoinDecisionMaker(NAMED, 0.3, decoy=v).decoy),
    (
        "DelayedDecisionMaker start",
        WEIGHTS,
        lambda v: ins.DelayedDecisionMaker(NAMED, 1, start=v).decide(BELIEF).action,
    ),
    (
        "Candidates",
        HOLDINGS,
        lambda v: ins.CounterAdversarialDecisionMaker(NAMED, budget=0.9, candidates=v).decide(BELIEF).regret,
    ),
    (
        "calibrate",
        BELIEFS,
        lambda v: round(ins.calibrate(lambda p: ins.CoinDecisionMaker(NAMED, p), 1e-3, v, 1e-3, 1.0).parameter, 6),
    ),
    (
        "least_regret",
        HOLDINGS,
        lambda v: round(ins.least_regret(SIMPLE, PRIOR, [ins.PointwiseLeakageCap(0.3)], candidates=v).regret, 9),
    ),
    (
        "rate_distortion_curve",
        HOLDINGS,
        lambda v: np.round(ins.rate_distortion_curve(SIMPLE, PRIOR, [0.05], candidates=v).rates, 6),
    ),
    (
        "audit_pairs secrets",
        SIGNALS,
        lambda v: (
            ins.audit_pairs(v, FLAGS, shifts=19)
            .frame()
            .loc[["score", "signal"], ["p_value", "error"]]
            .to_numpy(dtype=float)
        ),
    ),
    (
        "audit_pairs published",
        FLAGS,
        lambda v: ins.audit_pairs(SIGNALS["signal"], v, shifts=19).frame()[["p_value", "error"]].to_numpy(dtype=float),
    ),
    ("DataAdversary beliefs", LEARNED, lambda v: seen_pairs(v, FLAGS)),
    ("DataAdversary actions", FLAGS, lambda v: seen_pairs(LEARNED, v)),
    ("attack_weights", HOLDINGS, lambda v: np.sort(ins.attack_weights(MODEL, v).estimates, axis=0)),
    (
        "protect",
        BELIEFS,
        lambda v: np.sort(ins.protect(MODEL, v, 0.1, rng=np.random.default_rng(0)).deterministic.privacy),
    ),
    (
        "protect dict",
        dict(BELIEF),
        lambda v: ins.protect(MODEL, v, 0.1, rng=np.random.default_rng(0)).deterministic.privacy,
    ),
    *((name + " belief", BELIEF, decided(make)) for name, make in MAKERS.items()),
    ("Disclosure", HOLDINGS, lambda v: np.sort(ins.rounded(1)(v), axis=None)),
    ("portfolio_return", HOLDINGS, lambda v: np.sort(ins.portfolio_return()(v, returns=RETURNS), axis=0)),
    ("portfolio_return returns", RETURNS, lambda v: ins.portfolio_return()(HOLDINGS, returns=v)),
    ("grouped", pd.Series(["a", "b", "a"], ASSETS), lambda v: float(str(ins.grouped(v)) == "")),
    ("grouped actions", HOLDINGS, ins.grouped(["a", "b", "a"]).shown),
    ("ShownBeliefs", BELIEF, lambda v: float(BLURRED.contains(v))),
    ("LinearGaussianWorld", STEADY, lambda v: np.linalg.eigvalsh(moving(v).stationary_covariance)),
    ("LinearGaussianWorld process", SQUARE, lambda v: moving(STEADY, process=v).process),
    ("LinearGaussianWorld sensor", LOADS, lambda v: ins.steady_filter(moving(STEADY, sensor=v)).covariance),
    ("kalman_filter", RETURNS[:1], lambda v: ins.kalman_filter(moving(STEADY), v).means.to_numpy()),
    ("FactorRisk", LOADS, lambda v: np.sort(ins.FactorRisk(v, SQUARE, CAPS).diagonal)),
    ("FactorRisk specific", CAPS, lambda v: ins.FactorRisk(LOADS, SQUARE, v).diagonal),
    ("FactorRisk factor_covariance", SQUARE, lambda v: ins.FactorRisk(LOADS, v, CAPS).diagonal),
    ("AlphaProblem", SPREAD["calm"], lambda v: ins.AlphaProblem(v, 2.0, None, LOADS).theta),
    ("AlphaProblem loadings", LOADS, lambda v: np.sort(np.ravel(ins.AlphaProblem(SPREAD["calm"], 2.0, None, v).theta))),
    ("AlphaProblem optimum", BELIEF, lambda v: SIGNALLED.optimum(v)),
    ("AlphaProblem regret", WEIGHTS, lambda v: float(SIGNALLED.regret(BELIEF, v))),
    ("implied_views", WEIGHTS, lambda v: ins.implied_views(OWN, v).nearest(np.zeros(3))),
    ("ImpliedViews distance", WEIGHTS, lambda v: ins.implied_views(OWN, WEIGHTS).distance(v)),
    ("obfuscated_decision", WEIGHTS, lambda v: ins.obfuscated_decision(OWN, v, 0.1).weights),
    ("infer_weights", RETURNS, lambda v: np.sort(ins.infer_weights(pd.Series([0.1, 0.2, 0.3], MONTHS), v).weights)),
    ("infer_weights seen", pd.Series([0.1, 0.2, 0.3], MONTHS), lambda v: ins.infer_weights(v, RETURNS).weights),
]

NO_ARRAYS = """
    AlphaDraw AlphaPath AlphaSequence AlphaSettings AlphaStatus CalibratedSensor EstimatedSensor EstimatedWorld
    HerdStatus HerdingTable LikelihoodStatus LinearView ProbeRanking SensorFamily SensorStatus SocialLearning
    AlphaDecision KalmanResult SteadyFilter ViewStatus steady_filter
    ActionExplanation Adversary AffordableBeliefs Budget Calibration CalibrationStatus CheapestPrivacy CostStatus
    Decision DecisionStatus Decisions Detectability DiskError Emission Envelope FilterResult FittedWorld Frontier
    GlobalSearch Infeasibility InferredBeliefs InputError InscrutableError InvestorModel Leakage LearnedCost
    DetectabilityCap Guarantee LeastRegret LeastRegretStatus MaximalLeakageCap MeanSquaredErrorFloor
    NamingErrorFloor PointwiseLeakageCap SquaredErrorFloor
    FiniteRule FiniteStatus LearningCurve LinearProgramme
    LocalSearch MechanismRule MixedDecision MixedDecisions ModelError PathDecisions
    PathLeakage Posterior
    PosteriorStatus PriceCalibration PriceStatus PrivacyMeasure RateDistortionCurve RepeatedLeakage RowConflict SequenceStatus
    DispatchProblem PrivatePortfolio bus_prices from_dynamax from_hmmlearn from_pandapower from_pypsa from_statsmodels
    load_matpower only
    SolverError Study Trajectory UnionBeliefs action_grid check_adversary check_decision_maker
    check_decision_problem check_emission
    check_privacy_measure compare decoy_grid detectability leakage learning_curve
    load_ieee_30_bus long_short path_leakage
    random_candidates reachable_beliefs repeated_leakage reproduce resume_study run_study
    simplex simplex_grid stationary_prior uniform_prior
    NamingError RivalProblem SquaredError
    InferredWeights at_least delayed every form_13f long_only n_port rounded top
    filtered_prior predicted_prior Lift LinearForm QuadraticForm SmoothForm
""".split()  # noqa: SIM905
"""Public names that take no tables: objects of the library, numbers, names; results are made by the library."""

ELSEWHERE = [
    *("run_backtest", "alpha_backtest", "run_alpha_backtest", "momentum_alphas"),
    *("best_probe", "inverse_kalman_filter"),
]
"""Names whose tables have tests of their own, of dates and assets; and those that take arrays over time without labels."""


NO_TABLES: list[Any] = [[[1.0], [1.0, 2.0]], "text", {}, object(), DAYS]
"""What no entry accepts: rows of other lengths, a text, nothing, an object, dates."""

PACKAGE = Path(ins.__file__).parent


def same(first: Any, second: Any) -> bool:
    if isinstance(first, tuple):
        return all(same(*pair) for pair in zip(first, second, strict=True))
    return np.allclose(
        np.asarray(first, dtype=float), np.asarray(second, dtype=float), rtol=1e-9, atol=1e-12, equal_nan=True
    )


@pytest.mark.parametrize(("name", "value", "ask"), ENTRIES, ids=[name for name, _, _ in ENTRIES])
def test_another_order_of_labels_gives_the_same_or_is_refused(name: str, value: Any, ask: Callable[[Any], Any]) -> None:
    try:
        expected = ask(value)
    except InputError:
        expected = None
    for other in shuffles(value):
        if expected is None:
            with pytest.raises(InputError):
                ask(other)
            continue
        try:
            found = ask(other)
        except InputError:
            continue
        assert same(found, expected), f"{name}: other results for\n{other}"


@pytest.mark.parametrize(
    "order", [STATES, STATES[::-1], ["quiet", "loud"], ["0", "1"], ["1", "2"], ["2", "1"], None], ids=str
)
def test_a_problem_and_a_world_with_other_states_are_refused(order: list[str] | None) -> None:
    world = ins.HiddenMarkovModel(STEADY.to_numpy(), SYMBOLS, names=order)
    chain = resting_chain(ins.Prior(np.eye(2), [0.5, 0.5]), 0.8)
    prices = ins.PriceCalibration.at(3.0, float("inf"))

    def rule(**options: Any) -> ins.SequentialDecisionMaker:
        rng = np.random.default_rng(0)
        return ins.SequentialDecisionMaker(CHOICES, ins.Budget.regret(0.2), calibration=prices, rng=rng, **options)

    known, plain = rule(chain=chain), ins.Mechanism(np.eye(2), [0, 1], np.eye(2), np.zeros((2, 2)))
    draws: dict[str, Any] = {"n_steps": 2, "n_draws": 10, "rng": np.random.default_rng(0)}
    for ask in (
        lambda: rule(world=world),
        lambda: ins.SequentialAdversary(world, known),
        lambda: ins.path_leakage(world, known, **draws),
        lambda: ins.path_leakage(world, plain, loss=ins.RivalProblem(CHOICES), **draws),
    ):
        if order in (STATES, ["0", "1"], ["1", "2"], None):
            ask()
            continue
        with pytest.raises(InputError, match="expected the same ones in the same order"):
            ask()


@pytest.mark.parametrize("order", [STATES, STATES[::-1], None], ids=str)
def test_a_law_of_beliefs_keeps_the_names_of_its_world(order: list[str] | None, tmp_path: Path) -> None:
    world, rng = ins.HiddenMarkovModel(STEADY.to_numpy(), SYMBOLS, names=order), np.random.default_rng(0)
    made = ins.filtered_prior(world, 4, rng=rng, n_steps=2000)
    made.save(tmp_path / "prior.npz")
    for law in (made, ins.Prior.load(tmp_path / "prior.npz"), ins.predicted_prior(world, 4, rng=rng, n_steps=2000)):
        asks: list[Callable[[ins.Prior], Any]] = [
            lambda prior: ins.mechanism(ins.OriginalDecisionMaker(CHOICES), prior),
            lambda prior: ins.StackelbergDecisionMaker(CHOICES, 0.1, prior=prior),
            lambda prior: ins.NearOptimalAdversary(CHOICES, 0.1, prior=prior),
            lambda prior: ins.least_regret(CHOICES, prior, [ins.PointwiseLeakageCap(nats=0.5)]),
        ]
        for ask in asks:
            if order != STATES[::-1]:
                ask(law)
                continue
            with pytest.raises(InputError, match=r"the prior has the state labels .* expected the same ones"):
                ask(law)


@pytest.mark.parametrize("value", NO_TABLES, ids=lambda value: type(value).__name__)
@pytest.mark.parametrize(
    ("name", "ask"), [(name, ask) for name, _, ask in ENTRIES], ids=[name for name, _, _ in ENTRIES]
)
def test_what_is_no_table_is_refused_by_name(name: str, ask: Callable[[Any], Any], value: Any) -> None:
    with pytest.raises((InscrutableError, TypeError, ValueError, AttributeError, LookupError)) as error:
        ask(value)
    if not isinstance(error.value, InscrutableError):  # the entry's own line may read what the value lacks
        files = [Path(frame.filename) for frame in traceback.extract_tb(error.tb)]
        assert not any(PACKAGE in file.parents for file in files), f"{name}: {error.value!r}"


def test_every_public_name_that_takes_tables_is_in_the_table() -> None:
    listed = {name.split()[0] for name, _, _ in ENTRIES} | set(NO_ARRAYS) | set(ELSEWHERE)
    missing = sorted(set(ins.__all__) - listed)
    assert not missing, f"enter them in ENTRIES, or in NO_ARRAYS where they take no tables: {missing}"
    for name in filter(lambda name: inspect.isfunction(getattr(ins, name)), NO_ARRAYS):
        signature = str(inspect.signature(getattr(ins, name)))
        assert not re.search("ArrayLike|DataFrame", signature), f"{name} takes tables: enter it in ENTRIES"
