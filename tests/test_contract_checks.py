"""Checkers of measures, decision makers, adversaries and sensors: silent on what is shipped, loud on each broken promise."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from inscrutable import (
    BayesianAdversary,
    BudgetAwareAdversary,
    CategoricalEmission,
    CoinDecisionMaker,
    CounterAdversarialDecisionMaker,
    DelayedDecisionMaker,
    DesiredObfuscation,
    DirichletDecisionMaker,
    ExponentialDecisionMaker,
    FiniteProblem,
    GaussianEmission,
    Infeasibility,
    InputError,
    LinearProblem,
    MarkowitzProblem,
    MaximalObfuscation,
    NaiveAdversary,
    NearOptimalAdversary,
    NonExistence,
    NonUniqueness,
    OriginalDecisionMaker,
    PrivacyMeasure,
    ProbabilisticDecisionMaker,
    RateDistortionDecisionMaker,
    StackelbergDecisionMaker,
    UniformDecisionMaker,
    check_adversary,
    check_decision_maker,
    check_emission,
    check_privacy_measure,
    decoy_grid,
    mechanism,
    simplex,
    uniform_prior,
)
from sizes import paired, some

MARKET = MarkowitzProblem(
    [[0.02, 0.0, 0.01], [-0.01, 0.02, 0.0], [0.0, -0.01, 0.02]],
    [np.diag(row) for row in ([0.01, 0.02, 0.03], [0.03, 0.01, 0.02], [0.02, 0.03, 0.01])],
    5.0,
)
CHOICES = FiniteProblem([[0.0, 1.0, 0.4], [1.0, 0.0, 0.4], [0.5, 0.6, 0.4]])
ROWS = LinearProblem([[0.1, 0.5, 0.3], [0.4, 0.2, 0.3], [0.3, 0.3, 0.1]], simplex(3))
PROBLEMS = {"market": MARKET, "choices": CHOICES, "linear": ROWS}
PRIOR = uniform_prior(3, 5)


# ---- what is shipped is sound --------------------------------------------------------------------------------------


MEASURES = [
    MaximalObfuscation(),
    DesiredObfuscation([0.2, 0.3, 0.5]),
    DesiredObfuscation(np.full((2, 3), 1 / 3)),
    NonUniqueness(),
    NonExistence(),
    Infeasibility(),
]


@pytest.mark.parametrize(("measure", "name"), some(paired(MEASURES, list(PROBLEMS)[::-1]), 2), ids=str)
def test_shipped_measures_keep_their_promises(measure, name):
    check_privacy_measure(measure, PROBLEMS[name])


def makers(problem):
    """Every decision maker that plays in all kinds of problems."""
    few = {"candidates": decoy_grid(problem, 6)}
    yield OriginalDecisionMaker(problem)
    yield CounterAdversarialDecisionMaker(problem)
    yield ProbabilisticDecisionMaker(problem)
    yield CoinDecisionMaker(problem, 0.3)
    yield UniformDecisionMaker(problem, 0.1, **few)
    yield ExponentialDecisionMaker(problem, 10.0, **few)
    yield DelayedDecisionMaker(problem, 1)
    yield RateDistortionDecisionMaker(problem, prior=PRIOR, budget=0.1, **few)
    yield StackelbergDecisionMaker(problem, prior=PRIOR, budget=0.1, **few)


@pytest.mark.parametrize(("name", "number"), some(paired(list(PROBLEMS), range(9)), 2))
def test_shipped_decision_makers_keep_their_promises(name, number):
    check_decision_maker(list(makers(PROBLEMS[name]))[number])


def test_noise_with_a_seed_is_a_law():
    check_decision_maker(DirichletDecisionMaker(MARKET, 10.0, rng=np.random.default_rng(0), n_draws=50))


OBSERVERS = {
    "naive": NaiveAdversary,
    "near-optimal": lambda problem: NearOptimalAdversary(problem, 0.01),
    "budget-aware": lambda problem: BudgetAwareAdversary(problem, 0.1),
    "Bayesian": lambda problem: BayesianAdversary(mechanism(OriginalDecisionMaker(problem), PRIOR.beliefs), PRIOR),
}


@pytest.mark.parametrize(("name", "observer"), some(paired(list(PROBLEMS), list(OBSERVERS)), 2))
def test_shipped_adversaries_keep_their_promises(name, observer):
    check_adversary(OBSERVERS[observer](PROBLEMS[name]), PROBLEMS[name])


@pytest.mark.parametrize(
    "sensor",
    [
        CategoricalEmission([[0.9, 0.1, 0.0], [0.5, 0.2, 0.3]]),
        CategoricalEmission([[0.5, 0.5], [0.5, 0.5]]),
        GaussianEmission([[0.0, 1.0], [0.1, 1.0]], [np.eye(2), 2 * np.eye(2)]),
        GaussianEmission([[0.0]], [[[1.0]]]),
    ],
)
def test_shipped_sensors_keep_their_promises(sensor):
    check_emission(sensor)


# ---- each promise, broken ------------------------------------------------------------------------------------------


class Odd(PrivacyMeasure):
    """The distance, of which a test breaks one part."""

    def __init__(self, **broken):
        for name, value in broken.items():
            setattr(self, name, value)
        self.calls = 0

    def say(self, belief, belief_set):
        return belief_set.distance(belief)

    def __call__(self, belief, belief_set):
        self.calls += 1
        return self.say(belief, belief_set)


def spoil(belief, belief_set):
    if isinstance(belief, np.ndarray):
        belief[:] = 0.0
    return 0.0


def counting():
    measure = Odd()
    measure.say = lambda belief, belief_set: float(measure.calls)
    return measure


def told(privacies, exact):
    return lambda belief, sets: SimpleNamespace(privacies=privacies(len(sets)), exact=exact(len(sets)))


MEASURES = {
    "a privacy is one number": Odd(say=lambda belief, belief_set: np.zeros(2)),
    "a privacy is not NaN": Odd(say=lambda belief, belief_set: np.nan),
    "a measure leaves the belief as it was": Odd(say=spoil),
    "a measure asked again says the same": counting(),
    "no set that holds a belief is worth more than upper_bound": Odd(upper_bound=lambda belief: 1e-3),
    r"the shape of values\(...\).privacies": Odd(values=told(lambda n: np.zeros(n + 1), lambda n: np.ones(n, bool))),
    r"the shape of values\(...\).exact": Odd(values=told(np.zeros, lambda n: True)),
    "values are what single sets are worth": Odd(values=told(lambda n: np.full(n, 9.0), lambda n: np.ones(n, bool))),
    "values are what single sets are worth, or above": Odd(
        values=told(lambda n: np.full(n, -9.0), lambda n: np.zeros(n, bool))
    ),
    "an indicator is 0 or −∞": Odd(is_indicator=True, upper_bound=lambda belief: 2.0),
    "the sign of a reference is 1 or −1": Odd(reference=lambda belief: SimpleNamespace(point=belief, sign=2.0)),
    "a measure with a reference is ± the distance to it": Odd(
        reference=lambda belief: SimpleNamespace(point=np.eye(3)[0], sign=1.0)
    ),
    "at_step gives a measure": Odd(at_step=lambda step: None),
}


@pytest.mark.parametrize("promise", MEASURES)
def test_a_promise_that_a_measure_breaks_is_named(promise):
    with pytest.raises(AssertionError, match=f"broken promise: {promise}"):
        check_privacy_measure(MEASURES[promise], CHOICES)


class Maker:
    """Plays two corners of the simplex with equal chances, of which a test breaks one part."""

    problem = ROWS

    def __init__(self, **broken):
        self.broken = broken
        self.calls = 0

    def decide_many(self, beliefs):
        self.calls += 1
        count = len(beliefs)
        answer = {"actions": np.tile(np.eye(3)[:2], (count, 1, 1)), "probabilities": np.full((count, 2), 0.5)}
        for name, value in self.broken.items():
            answer[name] = value(self, np.asarray(beliefs))
        return SimpleNamespace(**{name: value for name, value in answer.items() if value is not None})


def nothing(*_):
    return None


def spoiled(maker, beliefs):
    beliefs[:] = 0.0
    return 0.0


def shares(row):
    return lambda maker, beliefs: np.tile(row, (len(beliefs), 1))


def corner(number):
    return lambda maker, beliefs: np.eye(3)[np.full(len(beliefs), number(maker, beliefs))]


ONE = {"actions": nothing, "probabilities": nothing}
MAKERS = {
    "decide_many leaves the beliefs as they were": Maker(regret=spoiled),
    "an answer has `action`, or `actions` and `probabilities`": Maker(**ONE),
    "the shape of action": Maker(**ONE, action=lambda maker, beliefs: np.zeros((1, 3))),
    "the shape of actions": Maker(actions=lambda maker, beliefs: np.zeros((len(beliefs), 3))),
    "the shape of probabilities": Maker(probabilities=lambda maker, beliefs: np.full((1, 2), 0.5)),
    "probabilities are at least 0 and sum to one": Maker(probabilities=shares([0.6, 0.6])),
    "probabilities are at least 0 and sum": Maker(probabilities=shares([1.1, -0.1])),
    "what is played is feasible": Maker(
        actions=lambda maker, beliefs: np.tile(2 * np.eye(3)[:2], (len(beliefs), 1, 1))
    ),
    "a stated regret is the problem's": Maker(regret=lambda maker, beliefs: np.ones(len(beliefs))),
    "the shape of regret": Maker(regret=lambda maker, beliefs: np.ones(1)),
    "a decision maker asked again plays the same": Maker(**ONE, action=corner(lambda maker, beliefs: maker.calls % 2)),
    "a decision maker decides for one belief alone as among many": Maker(
        **ONE, action=corner(lambda maker, beliefs: int(len(beliefs) > 1))
    ),
}


@pytest.mark.parametrize("promise", MAKERS)
def test_a_promise_that_a_decision_maker_breaks_is_named(promise):
    check_decision_maker(Maker())
    with pytest.raises(AssertionError, match=f"broken promise: {promise}"):
        check_decision_maker(MAKERS[promise])


def test_one_decision_is_as_among_many():
    maker = Maker()
    maker.decide = lambda belief: SimpleNamespace(action=np.eye(3)[2])
    with pytest.raises(AssertionError, match="broken promise: a decision maker decides for one as decide_many"):
        check_decision_maker(maker)


def test_one_belief_that_is_hidden_worse_than_among_many_is_named():
    maker = Maker(expected_privacy=lambda maker, beliefs: np.full(len(beliefs), 0.5 if len(beliefs) > 1 else 0.49))
    with pytest.raises(
        AssertionError, match="broken promise: a decision maker hides one belief alone as well as among"
    ):
        check_decision_maker(maker)
    even = Maker(expected_privacy=lambda maker, beliefs: np.full(len(beliefs), 0.5))
    check_decision_maker(even)
    even.decide = lambda belief: SimpleNamespace(
        actions=np.eye(3)[:2], probabilities=np.full(2, 0.5), expected_privacy=0.5 + 1e-3 * (belief.max() > 0.95)
    )
    with pytest.raises(
        AssertionError, match="broken promise: a decision maker hides one belief as well as decide_many"
    ):
        check_decision_maker(even)


def test_who_has_a_memory_may_decide_otherwise_alone():
    maker = Maker(**ONE, action=corner(lambda maker, beliefs: int(len(beliefs) > 1)))
    maker.is_memoryless = False
    check_decision_maker(maker)


class Observer:
    """Always guesses the middle, of which a test breaks one part."""

    def __init__(self, **broken):
        self.calls = 0
        for name, value in broken.items():
            setattr(self, name, value)

    def infer(self, action):
        return None

    def guess(self, actions, nearest):
        return np.full((len(actions), 3), 1 / 3)

    def estimate(self, action, *, nearest=False):
        return self.guess(np.asarray(action)[None], nearest)[0]

    def estimates(self, actions, *, nearest=False):
        self.calls += 1
        return self.guess(actions, nearest)


def spoiling(actions, nearest):
    actions[...] = 0
    return np.full((len(actions), 3), 1 / 3)


def by_place(actions, nearest):
    return np.eye(3)[np.arange(len(actions)) % 3]


MIDDLE = np.full(3, 1 / 3)
ADVERSARIES = {
    "leaves the decisions as they were": Observer(guess=spoiling),
    "the shape of estimates": Observer(guess=lambda actions, nearest: np.full((len(actions), 2), 0.5)),
    r"the shape of estimate\(": Observer(estimate=lambda action, nearest=False: np.full((1, 3), 1 / 3)),
    "beliefs, or NaN throughout": Observer(guess=lambda actions, nearest: np.full((len(actions), 3), 0.5)),
    "beliefs, also where no belief explains the decision": Observer(
        guess=lambda actions, nearest: np.full((len(actions), 3), np.nan)
    ),
    "one decision is read as among many": Observer(estimate=lambda action, nearest=False: np.eye(3)[0]),
    "nearest changes no guess there was": Observer(
        guess=lambda actions, nearest: np.tile(np.eye(3)[0] if nearest else MIDDLE, (len(actions), 1))
    ),
}


@pytest.mark.parametrize("promise", ADVERSARIES)
def test_a_promise_that_an_adversary_breaks_is_named(promise):
    check_adversary(Observer(), CHOICES)
    with pytest.raises(AssertionError, match=f"broken promise: .*{promise}"):
        check_adversary(ADVERSARIES[promise], CHOICES)


def test_an_order_of_decisions_that_matters_is_named():
    rival = Observer()
    seen = {}

    def guess(actions, nearest):
        # Right alone and as a whole, wrong in another order.
        for place, action in enumerate(actions.tolist()):
            seen.setdefault(action, place)
        return by_place(actions, nearest) if rival.calls > 2 else np.full((len(actions), 3), 1 / 3)

    rival.guess = guess
    with pytest.raises(AssertionError, match="broken promise: decisions are read the same again, in any order"):
        check_adversary(rival, CHOICES)


class Sensor:
    """Two states that differ in their mean, of which a test breaks one part."""

    n_states = 2

    def __init__(self, **broken):
        self.calls = 0
        for name, value in broken.items():
            setattr(self, name, value)

    def log_likelihoods(self, observations):
        return -0.5 * (np.asarray(observations)[:, None] - np.array([0.0, 1.0])) ** 2

    def sample(self, states, *, rng):
        return rng.normal(size=len(states)) + np.asarray(states)

    def to_dict(self):
        return {"type": "shifted"}


def with_entry(value):
    def log_likelihoods(observations):
        table = Sensor().log_likelihoods(observations)
        table[0, 0] = value
        return table

    return log_likelihoods


FREE = np.random.default_rng(1)
SENSORS = {
    "n_states is a whole number of at least 1": Sensor(n_states=2.0),
    "sample draws one observation a state": Sensor(sample=lambda states, rng: rng.normal(size=3)),
    "sample draws the same from the same rng": Sensor(sample=lambda states, rng: FREE.normal(size=len(states))),
    r"the shape of log_likelihoods\(observations\)": Sensor(log_likelihoods=lambda seen: np.zeros(len(seen))),
    "a log-likelihood is below": Sensor(log_likelihoods=with_entry(np.nan)),
    r"a log-likelihood is below \+∞": Sensor(log_likelihoods=with_entry(np.inf)),
    "what a state draws is possible in it": Sensor(log_likelihoods=lambda seen: np.full((len(seen), 2), -np.inf)),
    "a row depends on its own observation alone": Sensor(
        log_likelihoods=lambda seen: Sensor().log_likelihoods(seen) - np.mean(seen)
    ),
    "a state's draws are likeliest in that state": Sensor(
        sample=lambda states, rng: rng.normal(size=len(states)) + 1.0 - np.asarray(states)
    ),
    "to_dict is plain data": Sensor(to_dict=lambda: {"type": "shifted", "means": np.zeros(2)}),
    "to_dict has a text under `type`": Sensor(to_dict=lambda: {"kind": "shifted"}),
}


@pytest.mark.parametrize("promise", SENSORS)
def test_a_promise_that_a_sensor_breaks_is_named(promise):
    check_emission(Sensor())
    with pytest.raises(AssertionError, match=f"broken promise: {promise}"):
        check_emission(SENSORS[promise])


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (lambda: check_privacy_measure(3, CHOICES), "derived from PrivacyMeasure"),
        (lambda: check_privacy_measure(MaximalObfuscation(), 3), "must be a decision problem"),
        (lambda: check_decision_maker(3), "`problem` and `decide_many`"),
        (lambda: check_decision_maker(Maker(), tolerance=0), "tolerance"),
        (lambda: check_adversary(3, CHOICES), "`infer`, `estimate` and `estimates`"),
        (lambda: check_adversary(Observer(), 3), "must be a decision problem"),
        (lambda: check_emission(3), "an Emission with"),
        (lambda: check_emission(Sensor(), rng=3), "rng must be"),
    ],
)
def test_what_cannot_be_checked_is_refused(check, message):
    with pytest.raises(InputError, match=message):
        check()
