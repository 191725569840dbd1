"""Social learning: closed forms, an enumeration of all signal and decision paths, theory of randomised response, bad input."""

from __future__ import annotations

import os
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

import inscrutable as ins
from inscrutable import HerdStatus, InputError, social_learning
from inscrutable.experiments.herding.signals import signals_of
from inscrutable.reports.herding import write_herding
from sizes import audited, instances, some

SEED = int(os.environ.get("FRESH_SEED", "11"))
GUESS = ins.FiniteProblem([[0.0, 1.0], [1.0, 0.0]])
ACCURACIES = (0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9)


def sensor(p: float) -> ins.CategoricalEmission:
    """Two symbols, right with probability p."""
    return ins.CategoricalEmission([[p, 1 - p], [1 - p, p]])


def gaussian(half: float) -> ins.GaussianEmission:
    """Two states with means −half and half, spread 1."""
    return ins.GaussianEmission([[-half], [half]], [[[1.0]], [[1.0]]])


@pytest.mark.parametrize("p", ACCURACIES)
def test_closed_form_of_cascades(p: float) -> None:
    """Bikhchandani, Hirshleifer and Welch (1992): after two agents, after any even number, and in the end."""
    two = social_learning(GUESS, sensor(p), n_agents=2)
    assert np.allclose([two.right, two.wrong, two.none], [p * (p + 1) / 2, (p - 2) * (p - 1) / 2, p - p**2], atol=1e-12)
    six = social_learning(GUESS, sensor(p), ins.OriginalDecisionMaker(GUESS), n_agents=6)
    assert abs(six.none - (p - p**2) ** 3) < 1e-12
    end = social_learning(GUESS, sensor(p), n_agents=300)
    assert abs(end.right - p * (p + 1) / 2 / (1 - p + p**2)) < 1e-12
    assert end.status is HerdStatus.EXACT
    assert end.n_paths == 0
    assert len(end.public_beliefs) <= 5
    assert abs(end.right + end.wrong + end.none - 1) < 1e-12
    assert abs(end.joint.sum() - 1) < 1e-12


@pytest.mark.parametrize("p", ACCURACIES)
def test_simulated_cascades_are_within_sampling_error(p: float) -> None:
    """The same by simulated paths: within four and a half standard errors."""
    rng = np.random.default_rng([SEED, int(100 * p)])
    found = social_learning(GUESS, sensor(p), n_agents=2, rng=rng, n_paths=20_000)
    exact = social_learning(GUESS, sensor(p), n_agents=2)
    assert found.status is HerdStatus.SIMULATED
    assert found.n_paths == 20_000
    shares = np.array([[each.right, each.wrong, each.none] for each in (found, exact)])
    assert (np.abs(shares[0] - shares[1]) < 4.5 * found.errors).all(), f"FRESH_SEED={SEED}"
    assert abs(found.welfare - exact.welfare) < 4.5 * found.welfare_error
    assert np.abs(found.joint.sum(axis=0) - 0.5).max() < 4.5 * np.sqrt(0.25 / found.n_paths)
    assert abs((found.joint * found.public_beliefs).sum() - found.truths[-1]) < 1e-12


# An enumeration that shares no code with the package: decision makers are functions from a belief to a law.


def cheapest(costs: np.ndarray) -> Any:
    """The optimal choice, ties tossed."""

    def law(belief: np.ndarray) -> np.ndarray:
        expected = belief @ costs
        best = expected < expected.min() + 1e-9
        return np.asarray(best / best.sum())

    return law


def response(costs: np.ndarray, epsilon: float) -> Any:
    """Randomised response around the optimal choice, the first of tied ones."""

    def law(belief: np.ndarray) -> np.ndarray:
        expected = belief @ costs
        found = np.ones(costs.shape[1])
        found[np.flatnonzero(expected < expected.min() + 1e-9)[0]] = np.exp(epsilon)
        return np.asarray(found / found.sum())

    return law


def exponential(costs: np.ndarray, epsilon: float) -> Any:
    """The exponential mechanism."""

    def law(belief: np.ndarray) -> np.ndarray:
        found = np.exp(-epsilon * (belief @ costs))
        return np.asarray(found / found.sum())

    return law


class Enumeration:
    """Every path of signals and decisions of n agents, with its chance in each state."""

    def __init__(self, costs: np.ndarray, table: np.ndarray, prior: np.ndarray, laws: list[Any]) -> None:
        self.costs, self.table, self.prior, self.laws = costs, table, prior, laws
        self.known: dict[tuple[int, ...], np.ndarray] = {}
        self.right = self.wrong = 0.0
        self.regrets, self.bits, self.prices = (np.zeros(len(laws)) for _ in range(3))
        self.own = costs - costs.min(axis=1, keepdims=True)
        self.walk()

    def public(self, history: tuple[int, ...]) -> np.ndarray:
        """P(x | decisions), by Bayes' rule over all signals behind them."""
        if history not in self.known:
            likely = self.prior.copy()
            for n, decision in enumerate(history):
                reported = range(self.table.shape[1])
                chance = [self.table[:, y] * self.law(history[:n], y)[decision] for y in reported]
                likely = likely * np.sum(chance, axis=0)
            self.known[history] = likely / likely.sum()
        return self.known[history]

    @cache  # noqa: B019  # of one enumeration, which ends with its test
    def private(self, history: tuple[int, ...], symbol: int) -> np.ndarray:
        """The agent's belief after a signal."""
        joint = self.public(history) * self.table[:, symbol]
        return np.asarray(joint / joint.sum()) if joint.sum() > 0 else joint

    @cache  # noqa: B019  # as above
    def law(self, history: tuple[int, ...], symbol: int) -> np.ndarray:
        """What the next agent, or one like the last, plays."""
        belief = self.private(history, symbol)
        chosen: np.ndarray = self.laws[min(len(history), len(self.laws) - 1)](belief)
        return chosen if belief.sum() > 0 else np.zeros(self.costs.shape[1])

    def walk(self) -> None:
        """Sum over states, signals and decisions."""
        n_states, n_symbols = self.table.shape
        for history in product(range(self.costs.shape[1]), repeat=len(self.laws)):
            for symbols in product(range(n_symbols), repeat=len(self.laws)):
                for state in range(n_states):
                    chance = self.prior[state]
                    for n, (y, u) in enumerate(zip(symbols, history, strict=True)):
                        chance *= self.table[state, y]
                        chance = chance * self.law(history[:n], y)[u] if chance > 0 else 0.0
                    if chance > 0:
                        self.count(history, symbols, state, chance)

    def count(self, history: tuple[int, ...], symbols: tuple[int, ...], state: int, chance: float) -> None:
        """Add one path."""
        for n, (y, u) in enumerate(zip(symbols, history, strict=True)):
            public, belief = self.public(history[:n]), self.private(history[:n], y)
            weights = public @ self.table
            laws = [self.law(history[:n], each) for each in range(len(weights))]
            marginal = sum(weight * law[u] for weight, law in zip(weights, laws, strict=True))
            self.regrets[n] += chance * self.own[state, u]
            self.prices[n] += chance * (belief @ self.costs[:, u] - (belief @ self.costs).min())
            self.bits[n] += chance * np.log2(laws[y][u] / marginal)
        after = [self.law(history, y) for y in range(self.table.shape[1]) if self.private(history, y).sum() > 0]
        if np.ptp(after, axis=0).max() < 1e-9:
            likeliest = after[0] > after[0].max() - 1e-9
            share = float((self.own[state] < 1e-9)[likeliest].mean())
            self.right += chance * share
            self.wrong += chance * (1 - share)


def random_case(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Costs of whole numbers, so that ties occur, a sensor, sometimes with zeros, and a prior."""
    n_states, n_choices, n_symbols = (int(rng.integers(2, 4)) for _ in range(3))
    costs = rng.integers(0, 3, size=(n_states, n_choices)).astype(float)
    table = rng.integers(0, 4, size=(n_states, n_symbols)) + 1e-300
    table[np.arange(n_states), rng.integers(n_symbols, size=n_states)] += 2
    table[table < 1] = 0.0
    prior = rng.integers(1, 4, size=n_states).astype(float)
    return costs, table / table.sum(axis=1, keepdims=True), prior / prior.sum()


@pytest.mark.parametrize("case", range(instances(12, least=4)))
def test_exact_mode_is_an_enumeration_of_all_paths(case: int) -> None:
    """Cascades, regrets, prices and leakages of two or three agents, who may have different rules."""
    rng = np.random.default_rng([SEED, case])
    costs, table, prior = random_case(rng)
    problem = ins.FiniteProblem(costs)
    epsilon = float(rng.uniform(0.2, 2.0))
    choices = [
        (ins.OriginalDecisionMaker(problem), cheapest(costs)),
        (ins.ExponentialDecisionMaker(problem, epsilon, candidates=np.eye(costs.shape[1]), on_empty="infinite"), None),
    ]
    rules, laws = [], []
    for _ in range(int(rng.integers(2, 4))):
        maker, law = choices[int(rng.integers(2))]
        distinct = costs[:, np.sort(np.unique(costs, axis=1, return_index=True)[1])]
        rules.append(maker)
        laws.append(exponential(costs, epsilon) if law is None else law)
        if distinct.shape != costs.shape:  # copies of a choice are drawn once
            rules[-1], laws[-1] = choices[0][0], cheapest(costs)
    found = social_learning(problem, ins.CategoricalEmission(table), rules, n_agents=len(rules), prior=prior)
    oracle = Enumeration(costs, table, prior, laws)
    told = f"FRESH_SEED={SEED} case {case}"
    assert np.allclose(found.regrets, oracle.regrets, atol=1e-12), told
    assert np.allclose(found.prices, oracle.prices, atol=1e-12), told
    assert np.allclose(found.leakages, oracle.bits, atol=1e-12), told
    assert np.allclose([found.right, found.wrong], [oracle.right, oracle.wrong], atol=1e-12), told
    assert abs(found.welfare - oracle.regrets.sum()) < 1e-12


@pytest.mark.parametrize("p", [0.6, 0.7, 0.85])
def test_randomised_response_is_an_enumeration_too(p: float) -> None:
    """With K choices as many as states, the first of tied choices is the one that is then randomised."""
    for n_states, epsilon in ((2, 1.0), (3, 0.7)):
        costs = 1.0 - np.eye(n_states)
        table = np.full((n_states, n_states), (1 - p) / (n_states - 1))
        np.fill_diagonal(table, p)
        maker = ins.CoinDecisionMaker.response(ins.FiniteProblem(costs), epsilon)
        found = social_learning(ins.FiniteProblem(costs), ins.CategoricalEmission(table), maker, n_agents=3)
        oracle = Enumeration(costs, table, np.full(n_states, 1 / n_states), [response(costs, epsilon)] * 3)
        assert np.allclose(found.regrets, oracle.regrets, atol=1e-12)
        assert np.allclose(found.leakages, oracle.bits, atol=1e-12)
        assert np.allclose([found.right, found.wrong], [oracle.right, oracle.wrong], atol=1e-12)


@pytest.mark.parametrize("kind", ["PDM", "rate-distortion"])
def test_hiding_agents_are_an_enumeration_too(kind: str) -> None:
    """The decision makers that hide, their laws taken belief by belief."""
    costs, prior = np.array([[0.0, 1.0], [1.5, 0.0]]), np.array([0.55, 0.45])
    problem, budget = ins.FiniteProblem(costs), ins.Budget.regret(0.12)
    first = ins.Prior([[0.7, 0.3], [0.3, 0.7]], [0.5, 0.5])
    hiding: dict[str, Any] = {
        "PDM": lambda: ins.ProbabilisticDecisionMaker(problem, budget=budget),
        "rate-distortion": lambda: ins.RateDistortionDecisionMaker(problem, budget, prior=first),
    }
    maker, known = hiding[kind](), {}

    def law(belief: np.ndarray) -> np.ndarray:
        key = tuple(belief.round(13))
        if key not in known and belief.sum() > 0:
            known[key] = np.asarray(ins.mechanism(maker, belief[None], np.eye(2)).probabilities)[0]
        return np.asarray(known.get(key, np.zeros(2)))

    found = social_learning(problem, sensor(0.7), maker, n_agents=3, prior=prior)
    oracle = Enumeration(costs, sensor(0.7).probabilities, prior, [law] * 3)
    assert np.allclose(found.regrets, oracle.regrets, atol=1e-9)
    assert np.allclose(found.prices, oracle.prices, atol=1e-9)
    assert np.allclose(found.leakages, oracle.bits, atol=1e-9)


def began(found: ins.SocialLearning) -> int:
    """The number of decisions after which a cascade may have begun."""
    return int(np.flatnonzero(found.herds[:, 2] < 1 - 1e-9)[0])


def randomised(epsilon: float, p: float = 0.7) -> tuple[ins.SocialLearning, int, float]:
    """What is found for randomised response, the theory's k, and its chance of a right cascade in the end."""
    found = social_learning(GUESS, sensor(p), ins.CoinDecisionMaker.response(GUESS, epsilon), n_agents=1500)
    kept = 1 / (1 + np.exp(-epsilon))
    noisy = p * kept + (1 - p) * (1 - kept)
    k = int(np.log(p / (1 - p)) // np.log(noisy / (1 - noisy))) + 1
    return found, k, float(1 / (1 + ((1 - noisy) / noisy) ** k))


def test_randomised_response_jumps_where_theory_says() -> None:
    """Liu and Rahimian: one decision more starts a cascade below ε = 1.158, 0.733, 0.540; the ruin formula in between."""
    for jump, k in some(((1.158, 2), (0.733, 3), (0.540, 4)), 2):
        (above, n_above, _), (below, n_below, _) = randomised(jump + 1e-3), randomised(jump - 1e-3)
        assert (began(above), began(below)) == (k, k + 1) == (n_above, n_below)
        assert below.right > above.right + 0.04  # less privacy, and still fewer right cascades
    values = []
    for epsilon in (0.35, 0.6, 0.7, 0.8, 1.1, 1.2, 3.0) if audited() else (0.7, 0.8, 3.0):
        found, _, right = randomised(epsilon)
        assert abs(found.right - right) < 1e-9
        assert found.none < 1e-9
        values.append(found.right)
    steps = np.sign(np.diff(values))
    assert set(steps) == {-1, 1}, "the chance of a right cascade is not monotone in ε"


def test_only_the_first_hides() -> None:
    """A sequence of rules: whoever decides after a silent first agent faces the problem of the first."""
    silent = ins.CoinDecisionMaker(GUESS, 1.0, decoy=[1.0, 0.0])
    plain = ins.OriginalDecisionMaker(GUESS)
    found = social_learning(GUESS, sensor(0.7), [silent, *[plain] * 4], n_agents=5)
    without = social_learning(GUESS, sensor(0.7), n_agents=4)
    assert found.leakages[0] == 0
    assert np.allclose(found.leakages[1:], without.leakages, atol=1e-12)
    assert np.allclose(found.regrets[1:], without.regrets, atol=1e-12)
    assert abs(found.right - without.right) < 1e-12


@pytest.mark.parametrize("half", [0.3, 0.8])
def test_first_gaussian_agents_follow_their_thresholds(half: float) -> None:
    """Error of the first two agents against normal tails: the second's threshold is moved by the first's decision."""
    rng = np.random.default_rng([SEED, 3])
    found = social_learning(GUESS, gaussian(half), n_agents=2, rng=rng, n_paths=4000)
    first = norm.cdf(-half)
    threshold = np.log((1 - first) / first) / (2 * half)
    second = (1 - first) * norm.cdf(-threshold - half) + first * norm.cdf(threshold - half)
    assert abs(found.regrets[0] - first) < 2e-3
    assert abs(found.regrets[1] - second) < 0.02
    assert found.status is HerdStatus.MAJORITIES


def test_wrong_majorities_die_out() -> None:
    """Smith and Sørensen: with signals of unbounded strength fewer paths have a wrong majority the longer they are."""
    shares = [
        social_learning(GUESS, gaussian(0.5), n_agents=n, rng=np.random.default_rng([SEED, 5])).wrong for n in (10, 100)
    ]
    assert shares[0] > shares[1] + 0.03


@pytest.mark.audit
def test_wrong_majorities_die_out_in_the_long_run() -> None:
    """The same to a thousand agents, over a thousand paths."""
    shares = [
        social_learning(GUESS, gaussian(0.25), n_agents=n, rng=np.random.default_rng([SEED, 6])).wrong
        for n in (10, 100, 1000)
    ]
    print(f"FRESH_SEED={SEED}: shares of wrong majorities {shares}")
    assert shares[0] > shares[1] > shares[2]


def test_many_dimensions_of_one_line_are_one_number() -> None:
    """A sensor whose evidence lies in one direction gives the cells of that number; any other is drawn."""
    rng = np.random.default_rng(SEED)
    factor = rng.normal(size=(3, 3))
    covariance = factor @ factor.T + np.eye(3)
    direction = np.linalg.cholesky(covariance) @ np.array([0.6, 0.0, 0.8])
    wide = ins.GaussianEmission([-0.5 * direction, 0.5 * direction], [covariance, covariance])
    narrow = signals_of(gaussian(0.5), GUESS, rng).probabilities
    assert np.allclose(narrow[0], narrow[1, ::-1], rtol=1e-9, atol=0), "both tails keep their digits"
    table = signals_of(wide, GUESS, rng).probabilities
    assert np.allclose(table, narrow, atol=1e-9) or np.allclose(table, narrow[:, ::-1], atol=1e-9)
    round_one = ins.GaussianEmission([[0.0, 0.0], [1.0, 0.0]], [np.eye(2), 2 * np.eye(2)])
    found = social_learning(GUESS, round_one, n_agents=3, rng=rng, n_paths=50)
    assert found.status is HerdStatus.MAJORITIES
    assert found.n_drawn == 500
    assert "standard errors leave out that of 500 signals drawn from each state" in str(found)
    cells = social_learning(GUESS, wide, n_agents=3, rng=rng, n_paths=50)
    assert cells.n_drawn == 0
    assert "signals drawn" not in str(cells)
    assert 0 < found.welfare < 1.5


def test_decisions_that_tell_the_belief_tell_every_signal() -> None:
    """Optimal portfolios inside the simplex: the public belief is the filter's, after any number of agents."""
    problem = ins.MarkowitzProblem([[0.02, 0.01], [0.0, 0.01]], [np.diag([0.01, 0.01])] * 2, 5.0)
    table = np.array([[0.7, 0.3], [0.4, 0.6]])
    found = social_learning(problem, ins.CategoricalEmission(table), n_agents=4)
    likelihoods = np.array([np.prod(table[:, list(path)], axis=1) for path in product(range(2), repeat=4)])
    expected = np.unique((likelihoods / likelihoods.sum(axis=1, keepdims=True)).round(10), axis=0)
    assert np.allclose(np.sort(found.public_beliefs[:, 0]), expected[:, 0], atol=1e-9)
    assert found.none == 1
    assert np.allclose(found.prices, 0, atol=1e-12)


def test_portfolios_are_right_in_the_state_that_they_suit() -> None:
    """Between choices no decision is the best of a state: it counts for the state in which it is regretted least."""
    problem = ins.MarkowitzProblem([[0.02, 0.01], [0.0, 0.01]], [np.diag([0.01, 0.01])] * 2, 5.0)
    found = social_learning(problem, gaussian(1.0), n_agents=30, rng=np.random.default_rng(SEED), n_paths=100)
    assert found.right > 0.9
    assert found.truths[-1] > 0.99


def test_degenerate_sensors_and_priors() -> None:
    """Nothing to see, everything to see, and nothing to learn."""
    blind = social_learning(GUESS, ins.CategoricalEmission([[0.4, 0.6], [0.4, 0.6]]), n_agents=3)
    assert (blind.right, blind.wrong) == (0.5, 0.5)
    assert blind.leakages.max() == 0
    seeing = social_learning(GUESS, ins.CategoricalEmission(np.eye(2)), n_agents=3)
    assert seeing.right == 1
    assert seeing.welfare == 0
    assert seeing.leakages[1:].max() == 0
    sure = social_learning(GUESS, sensor(0.7), n_agents=2, prior=[1.0, 0.0])
    assert sure.right == 1
    assert sure.herds[0, 0] == 1
    assert sure.truths[0] == 1
    one = social_learning(ins.FiniteProblem([[1.0]]), ins.CategoricalEmission([[1.0]]), n_agents=1)
    assert one.right == 1
    assert one.welfare == 0


def test_states_are_aligned_by_their_labels() -> None:
    """A sensor that lists the states in another order; one with other states is refused."""
    costs = pd.DataFrame([[0.0, 2.0], [1.0, 0.0]], index=["calm", "wild"])
    table = pd.DataFrame([[0.8, 0.2], [0.3, 0.7]], index=["calm", "wild"])
    prior = pd.Series([0.4, 0.6], index=["calm", "wild"])
    problem = ins.FiniteProblem(costs)
    found = [
        social_learning(problem, ins.CategoricalEmission(rows), n_agents=4, prior=start).welfare
        for rows, start in ((table, prior), (table.loc[["wild", "calm"]], prior[["wild", "calm"]]))
    ]
    assert found[0] == found[1]
    with pytest.raises(InputError, match="other state labels"):
        social_learning(problem, ins.CategoricalEmission(table.set_axis(["calm", "dull"])), n_agents=2)


@pytest.mark.parametrize(("rows", "columns"), [("ba", "uv"), ("ab", "vu"), ("cd", "uv"), ("ab", "wx")])
def test_rules_of_problems_with_other_labels_are_refused(rows: str, columns: str) -> None:
    """Beliefs and choices of another order would be taken for those of the problem."""
    costs = pd.DataFrame([[0.0, 1.0], [3.0, 0.0]], index=list("ab"), columns=list("uv"))
    problem, maker = ins.FiniteProblem(costs), ins.OriginalDecisionMaker(ins.FiniteProblem(costs.to_numpy()))
    other = ins.OriginalDecisionMaker(ins.FiniteProblem(costs.set_axis(list(rows)).set_axis(list(columns), axis=1)))
    assert social_learning(problem, sensor(0.7), maker, n_agents=2).right > 0
    with pytest.raises(InputError, match="expected the same ones in the same order"):
        social_learning(problem, sensor(0.7), other, n_agents=2)
    with pytest.raises(InputError, match="expected the same ones in the same order"):
        ins.herding_table(problem, sensor(0.7), {"known": maker, "other": other}, n_agents=2)


def test_results_print_save_and_frame(tmp_path: Path) -> None:
    """A result and a table come back from disk as they were, and draw."""
    rules = {"ODM": ins.OriginalDecisionMaker(GUESS), "response": ins.CoinDecisionMaker.response(GUESS, 1.0)}
    table = ins.herding_table(GUESS, sensor(0.7), rules, n_agents=12)
    table.save(tmp_path / "table.npz")
    loaded = ins.HerdingTable.load(tmp_path / "table.npz")
    pd.testing.assert_frame_equal(loaded.frame(), table.frame())
    assert str(loaded["ODM"]) == str(table["ODM"])
    assert "exact" in str(table["ODM"])
    frame = table["ODM"].frame()
    assert list(frame.index) == list(range(1, 13))
    assert frame["regret"].sum() == pytest.approx(table["ODM"].welfare)
    assert table.frame().loc["ODM", "others"] == 0
    assert table.frame().loc["response", "own"] > 0
    assert "right majority" in str(social_learning(GUESS, gaussian(1.0), n_agents=2, rng=np.random.default_rng(0)))
    assert all(path.stat().st_size for path in write_herding(table, tmp_path))
    with pytest.raises(InputError, match="no row 'other'"):
        table["other"]
    with pytest.raises(InputError, match="dict from names"):
        ins.herding_table(GUESS, sensor(0.7), {}, n_agents=2)


def test_a_rule_helps_the_others_only_beyond_two_standard_errors() -> None:
    """Simulated gains within two standard errors are left open; exact ones are told, and rounding is no gain."""
    plain, noisy = ins.OriginalDecisionMaker(GUESS), ins.ExponentialDecisionMaker(GUESS, 3.5)
    rules = {"ODM": plain, "noisy": noisy}
    for seed in range(4):
        table = ins.herding_table(GUESS, sensor(0.7), rules, n_agents=13, rng=np.random.default_rng(seed), n_paths=200)
        row, told = table.frame().loc["noisy"], table.summary().splitlines()[-1]
        errors = [each.welfare_error for each in table.found]
        assert row["others_se"] == pytest.approx(np.hypot(*errors))
        gains = row["others"] < -2.0 * row["others_se"]
        assert ("gain by noisy" in told) == gains
        assert ("do not tell for noisy" in told) == (abs(row["others"]) <= 2.0 * row["others_se"])
    exact = ins.herding_table(GUESS, sensor(0.7), {**rules, "same": ins.CoinDecisionMaker(GUESS, 0.0)}, n_agents=4)
    assert exact.frame()["others_se"].tolist() == [0.0] * 3
    assert "do not tell" not in str(exact)


def test_a_table_shows_three_digits_in_any_unit() -> None:
    units = [
        ins.herding_table(problem, sensor(0.7), {"coin": ins.CoinDecisionMaker(problem, 0.5)}, n_agents=4).lines()
        for problem in (GUESS, ins.FiniteProblem(1e-4 * GUESS.costs))
    ]
    for column in ("regret", "own"):
        large, small = (float(each[column].iloc[0]) for each in units)
        assert small == pytest.approx(1e-4 * large, rel=5e-3)
        assert small > 0


def test_randomised_response_over_choices() -> None:
    """K(u|π) of three choices, its worst ratio, and the choices it cannot have."""
    problem = ins.FiniteProblem(1.0 - np.eye(3))
    played = ins.mechanism(ins.CoinDecisionMaker.response(problem, 0.8), np.eye(3), np.eye(3)).probabilities
    expected = (np.ones((3, 3)) + (np.exp(0.8) - 1) * np.eye(3)) / (np.exp(0.8) + 2)
    assert np.allclose(played, expected, atol=1e-12)
    assert np.allclose(ins.mechanism(ins.CoinDecisionMaker.response(problem, 0.0), np.eye(3)).probabilities, 1 / 3)
    for costs in (
        [[0.0, 0.0], [1.0, 0.0]],
        [[0.0, 0.0], [0.0, 1.0]],
    ):  # both orders of a choice that is the best only by a tie
        tied = ins.CoinDecisionMaker.response(ins.FiniteProblem(costs), np.log(3.0))
        shares = ins.mechanism(tied, [[0.3, 0.7]], np.eye(2)).probabilities[0]
        assert shares.tolist() == pytest.approx([0.75, 0.25] if costs[1][1] else [0.25, 0.75])
    with pytest.raises(InputError, match=r"\[2\] are not"):
        ins.CoinDecisionMaker.response(ins.FiniteProblem([[0.0, 1.0, 0.6], [1.0, 0.0, 0.6]]), 1.0)
    with pytest.raises(InputError, match="needs a FiniteProblem"):
        ins.CoinDecisionMaker.response(ins.LinearProblem(np.eye(2), ins.simplex(2)), 1.0)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"n_agents": 0}, "n_agents must be a whole number of at least 1"),
        ({"n_agents": 2.5}, "n_agents must be a whole number"),
        ({"emission": ins.CategoricalEmission(np.full((3, 2), 0.5))}, "the emission has 3 states, the problem 2"),
        ({"emission": [[0.7, 0.3], [0.3, 0.7]]}, "emission must be a sensor"),
        ({"emission": ins.GaussianEmission([[0.0], [1.0]], [[[1.0]]] * 2)}, "rng must be"),
        ({"problem": "guess"}, "problem must be a decision problem"),
        ({"prior": [0.5, 0.6]}, "prior sums to 1.1"),
        ({"prior": [1.0]}, "prior has 1 entries"),
        ({"n_paths": 0, "rng": np.random.default_rng(0)}, "n_paths must be"),
        ({"n_paths": 5}, "rng must be"),
        ({"rng": 3}, "rng must be a numpy.random.Generator"),
        ({"decision_maker": ins.KeptDecisionMaker(ins.OriginalDecisionMaker(GUESS))}, "depends on earlier decisions"),
        ({"decision_maker": ins.DelayedDecisionMaker(GUESS, 1)}, "depends on earlier decisions"),
        ({"decision_maker": "ODM"}, "a decision maker with `problem` and `decide_many` is needed"),
        ({"decision_maker": [ins.OriginalDecisionMaker(GUESS)] * 2}, "2 decision makers for 3 agents"),
        ({"decision_maker": ins.OriginalDecisionMaker(ins.FiniteProblem(np.eye(3)))}, "decides on"),
    ],
)
def test_bad_input_is_refused(change: dict[str, Any], message: str) -> None:
    """What was passed, what was expected."""
    arguments: dict[str, Any] = {"problem": GUESS, "emission": sensor(0.7), "n_agents": 3, **change}
    with pytest.raises(InputError, match=message):
        social_learning(**arguments)


def test_too_many_public_beliefs_need_a_generator() -> None:
    """A rule under which no two histories lead to one belief: exact for a few agents, then simulated or refused."""
    maker = ins.ExponentialDecisionMaker(GUESS, 2.0)
    assert social_learning(GUESS, sensor(0.7), maker, n_agents=6).status is HerdStatus.EXACT
    with pytest.raises(InputError, match="more than 4096 public beliefs"):
        social_learning(GUESS, sensor(0.7), maker, n_agents=14)
    found = social_learning(GUESS, sensor(0.7), maker, n_agents=14, rng=np.random.default_rng(SEED))
    assert found.status is HerdStatus.SIMULATED
    assert found.none == 1


@pytest.mark.parametrize("costs", [[0.0, 2.0], [0.1, 0.7], [2e7, 1.0], [-456.308495463091, 1070.8105937262628]])
@pytest.mark.parametrize("n_choices", [2, 3])
def test_choices_that_cost_the_same_reveal_nothing(costs: list[float], n_choices: int) -> None:
    problem = ins.FiniteProblem(np.tile(np.array(costs)[:, None], n_choices))
    found = social_learning(problem, ins.CategoricalEmission([[0.5, 0.0, 0.5], [0.0, 0.25, 0.75]]), n_agents=3)
    np.testing.assert_array_equal(found.leakages, 0.0)
    assert found.right == pytest.approx(1.0)
    assert problem.tied(np.array([[1.0, 0.0], [0.3, 0.7]])).all()
    for choice in range(n_choices):
        np.testing.assert_allclose(
            ins.consistent_beliefs(problem, choice).bounds(), [[0.0, 1.0], [0.0, 1.0]], atol=1e-12
        )


@pytest.mark.parametrize("constant", [10.0, 1e3, 1e4, 1e6, 1e10])
def test_a_constant_in_all_costs_changes_no_cascade(constant: float) -> None:
    plain = social_learning(GUESS, sensor(0.7), n_agents=3)
    found = social_learning(ins.FiniteProblem(GUESS.costs + constant), sensor(0.7), n_agents=3)
    np.testing.assert_allclose(found.herds, plain.herds, atol=1e-9)


@pytest.mark.parametrize("large", [1e3, 1e6, 1e10])
def test_a_state_of_large_costs_does_not_make_wrong_decisions_right(large: float) -> None:
    # All choose the second, which is wrong in the first state.
    found = social_learning(ins.FiniteProblem([[0.0, 1.0], [large, 0.0]]), sensor(0.7), n_agents=3)
    assert (found.right, found.wrong) == (0.5, 0.5)


def test_a_rule_follows_its_own_problem() -> None:
    # It chooses the second unless the first state's probability is above .9; with this sensor it never is.
    own = ins.OriginalDecisionMaker(ins.FiniteProblem([[0.0, 1.0], [9.0, 0.0]]))
    found = social_learning(
        ins.FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), ins.CategoricalEmission([[0.7, 0.3], [0.3, 0.7]]), own, n_agents=3
    )
    np.testing.assert_allclose(found.regrets, 0.5)
