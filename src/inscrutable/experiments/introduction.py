"""The claims of the paper's introduction about copying, herding, delay and partial trades, each with a number and a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from inscrutable import validation
from inscrutable.adversaries import NaiveAdversary
from inscrutable.budgets import Budget
from inscrutable.decision_makers import OriginalDecisionMaker
from inscrutable.decision_makers.baselines import CoinDecisionMaker
from inscrutable.errors import InputError
from inscrutable.experiments.claims import MATERIAL, Finding, Rule, finding_of
from inscrutable.experiments.comparison_markets import PAPER, market_of
from inscrutable.experiments.comparison_watchers import watched
from inscrutable.experiments.herding import social_learning
from inscrutable.experiments.makers import behave
from inscrutable.experiments.observers import Observed
from inscrutable.experiments.setting import Behaviour, Setting
from inscrutable.mechanisms import Disclosure
from inscrutable.mechanisms.played import PlaysMany
from inscrutable.privacy import RivalProblem, leakage
from inscrutable.problems import FiniteProblem
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission

_RESOLUTION = 8
_BUDGET = 0.1
"""Expected regret as a share of E|c*|: the paper's budget."""

_EPSILON = 1.0
_OTHERS = 20


class IntroductionVerdict(Enum):
    """The verdict on a claim of the paper's introduction."""

    HOLDS = "holds"
    AT_FACE_VALUE = "holds only against the naive observer"
    KNOWING = "holds only against the aware observer"
    FAILS = "fails"


@dataclass(frozen=True)
class IntroductionClaim:
    """One claim, judged against the naive and the aware observer.

    Args:
        key: A short name.
        text: The claim.
        criterion: The test in words.
        naive: Finding against the naive observer, who takes every decision for optimal; None where the claim does not concern
            it.
        knowing: Finding against the aware observer, who knows the rule and all decisions before.
        verdict: The verdict from both findings.
    """

    key: str
    text: str
    criterion: str
    naive: Finding | None
    knowing: Finding
    verdict: IntroductionVerdict

    def __str__(self) -> str:
        return f"{self.text}: {self.verdict.value}"


def introduction_claims(n_markets: int = 8, *, rng: np.random.Generator) -> tuple[IntroductionClaim, ...]:
    """Return the claims of the paper's introduction, judged over random markets and sensors.

    Hiding costs at most a tenth of E|c*|, by the paper's CDM, the longest affordable delay, or the smallest affordable fraction
    of each trade. The aware observer filters a belief that stays with probability 0.8. Herding has two states, two choices and
    two symbols with uniformly drawn probabilities, as many sensors as markets; an agent that hides plays ε-randomised response,
    ε = 1.

    Args:
        n_markets: Random markets of the paper's law, and random sensors, at least 2.
        rng: Source of the markets, of the paths of beliefs and of the sensors.

    Raises:
        InputError: There are fewer than two markets, or `rng` is no generator.

    Cost: half a second per market. Source: the paper, Section I.

    Example:
        >>> print(introduction_claims(2, rng=np.random.default_rng(0))[0])
        an observer of an investor's decisions decides as well without its expertise: holds
    """
    if validation.count(n_markets, "n_markets") < 2:
        raise InputError(f"claims are judged over at least 2 markets, got {n_markets}")
    seeds = validation.generator(rng).integers(2**31, size=n_markets)
    worths, errors = (np.array(each) for each in zip(*map(_market, seeds.tolist()), strict=True))
    copying = _judged(
        "copying",
        "an observer of an investor's decisions decides as well without its expertise",
        "share of the belief's worth that reading optimal decisions gives",
        worths,
        (Rule.ALWAYS, 0.99),
    )
    ways = (
        ("altering", "an allocation that is slightly altered hides the belief"),
        ("delay", "delayed decisions hide the belief"),
        ("partial trades", "fractional investments hide the belief"),
    )
    hidden = [
        _judged(key, text, "error about the belief, less that with optimal decisions", errors[:, place], _HIDES)
        for place, (key, text) in enumerate(ways)
    ]
    herded = np.array([_herd(rng) for _ in range(n_markets)])
    kinds = (
        ("herding", "an agent that hides changes how the others herd", _MOVED, _HIDES),
        ("one hides", "an agent that hides makes the others decide worse", _SPENT, _WORSE),
        ("all hide", "agents that all hide make each other decide worse", _SPENT_BY_ALL, _WORSE),
    )
    herds = [
        _judged(key, text, quantity, herded[:, [place]], test)
        for place, (key, text, quantity, test) in enumerate(kinds)
    ]
    return (copying, *hidden, *herds)


_HIDES = (Rule.ON_AVERAGE, MATERIAL)
_WORSE = (Rule.ON_AVERAGE, 0.0)
_MOVED = "chance of a wrong cascade where the first agent hides, less that where none does, in size"
_SPENT_BY_ALL = (
    f"regret of {1 + _OTHERS} agents where all hide, less what hiding costs themselves and theirs where none does"
)
_SPENT = f"regret of the {_OTHERS} agents after the first where it hides, less theirs where none does"


def _judged(key: str, text: str, quantity: str, measured: Array, test: tuple[Rule, float]) -> IntroductionClaim:
    """Return the verdict on quantities (n,2) against the naive and the aware observer, or (n,1) against the latter."""
    found = [finding_of(column[:, None], *test) for column in measured.T]
    naive, knowing = (found[0], found[1]) if len(found) > 1 else (None, found[0])
    verdict = {
        (True, True): IntroductionVerdict.HOLDS,
        (True, False): IntroductionVerdict.AT_FACE_VALUE,
        (False, True): IntroductionVerdict.KNOWING,
        (False, False): IntroductionVerdict.FAILS,
    }[knowing.holds if naive is None else naive.holds, knowing.holds]
    cases = test[0].value.replace("markets", "cases").replace("market", "case")
    return IntroductionClaim(key, text, f"{quantity}: at least {test[1]:g} {cases}", naive, knowing, verdict)


def _market(seed: int) -> tuple[tuple[float, float], list[list[float]]]:
    """Return the worth of optimal decisions to both observers, and the errors (3,2) that each way of hiding adds."""
    market = market_of(PAPER, _RESOLUTION, seed)
    setting = Setting.of(market.problem, market.chain)

    def stream() -> np.random.Generator:
        return np.random.default_rng(seed)

    def read(behaviour: Behaviour) -> Array:
        observed = Observed(setting, behaviour)
        knowing = watched(setting, behaviour, observed.leakage.bayes_error, stream()).error
        return np.array([observed.read_by({"name": "naive"}).error, knowing])

    plain = Behaviour(setting.optimal)
    unhidden = read(plain)
    added = []
    for name in ("CDM", "delay", "partial trades"):
        found = behave(setting, {"name": name}, Budget.relative(_BUDGET), each=name == "CDM", seed=stream)
        assert found is not None
        added.append((read(found) - unhidden).tolist())
    return _worths(Observed(setting, plain)), added


def _worths(observed: Observed) -> tuple[float, float]:
    """Return the share of the belief's worth that observing gives to a naive and to an aware rival with the same problem."""
    problem, joint = observed.setting.problem, observed.joint
    loss = RivalProblem(problem)
    known = leakage(observed.behaviour.mechanism, observed.setting.prior, loss=loss)
    guesses = observed.guesses(NaiveAdversary(problem), Disclosure())
    lost = float(joint.mass @ loss.excess(joint.beliefs[joint.row], guesses[joint.column]))
    return 1.0 - lost / known.secret_worth, known.worth_share


def _herd(rng: np.random.Generator) -> tuple[float, float, float]:
    """Return, for a random sensor, the change of the wrong cascade's probability by hiding, and of the others' regret."""
    problem = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])
    sensor = CategoricalEmission(rng.dirichlet(np.ones(2), size=2))
    plain, hiding = OriginalDecisionMaker(problem), CoinDecisionMaker.response(problem, _EPSILON)
    rules: list[PlaysMany] = [hiding, *[plain] * _OTHERS]
    one, every, none = (
        social_learning(problem, sensor, each, n_agents=1 + _OTHERS, rng=rng) for each in (rules, hiding, plain)
    )
    added = every.regrets - every.prices - none.regrets
    return abs(one.wrong - none.wrong), float((one.regrets - none.regrets)[1:].sum()), float(added.sum())
