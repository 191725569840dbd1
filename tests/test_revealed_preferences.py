"""Choices at prices: consistency and its index against enumeration of cycles, utilities against the choices themselves."""

from __future__ import annotations

from fractions import Fraction
from itertools import permutations

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    InputError,
    ModelError,
    PiecewiseLinearProblem,
    Polyhedron,
    RevealedPreferences,
    SolverError,
    check_decision_problem,
    consistent_beliefs,
    preference_problem,
    revealed_preferences,
    simplex,
)
from sizes import instances


def by_cycles(prices: np.ndarray, choices: np.ndarray, efficiency: float) -> tuple[bool, float]:
    """Consistency and the index, by every cycle of different observations."""
    spent = prices @ choices.T
    ratios = spent / np.diag(spent)[:, None]
    consistent, index = True, 1.0
    for length in range(2, len(prices) + 1):
        for cycle in permutations(range(len(prices)), length):
            steps = [ratios[t, s] for t, s in zip(cycle, cycle[1:] + cycle[:1], strict=True)]
            index = min(index, max(steps))
            consistent &= not (max(steps) <= efficiency and min(steps) < efficiency)
    return consistent, index


@pytest.mark.parametrize("seed", range(instances(40, least=10)))
def test_consistency_and_index_equal_enumeration(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count, goods = int(rng.integers(1, 6)), int(rng.integers(2, 4))
    prices, choices = rng.uniform(0.5, 2.0, (count, goods)), rng.uniform(0.1, 3.0, (count, goods))
    for efficiency in (1.0, 0.9, 0.7):
        found = revealed_preferences(prices, choices, efficiency=efficiency)
        consistent, index = by_cycles(prices, choices, efficiency)
        assert found.is_consistent == consistent
        assert found.efficiency_index == pytest.approx(index, rel=1e-12)
        spent = prices @ choices.T
        steps = [spent[t, s] / spent[t, t] for t, s in zip(found.cycle, found.cycle[1:] + found.cycle[:1], strict=True)]
        if consistent:
            assert not found.cycle
        else:
            assert len(set(found.cycle)) == len(found.cycle)
            assert max(steps) <= efficiency
            assert min(steps) < efficiency


def exact(prices: np.ndarray, choices: np.ndarray) -> list[list[Fraction]]:
    """Spending ratios without rounding."""
    paid, bought = ([[Fraction(float(each)) for each in row] for row in table] for table in (prices, choices))
    spent = [[sum(p * x for p, x in zip(price, choice, strict=True)) for choice in bought] for price in paid]
    return [[each / spent[t][t] for each in row] for t, row in enumerate(spent)]


def exact_verdict(ratios: list[list[Fraction]], efficiency: Fraction) -> tuple[bool, Fraction]:
    """Consistency and the index by every cycle, without rounding."""
    consistent, index = True, Fraction(1)
    for length in range(2, len(ratios) + 1):
        for cycle in permutations(range(len(ratios)), length):
            steps = [ratios[t][s] for t, s in zip(cycle, cycle[1:] + cycle[:1], strict=True)]
            index = min(index, max(steps))
            consistent &= not (max(steps) <= efficiency and min(steps) < efficiency)
    return consistent, index


def nearly_tied(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Small whole numbers, where ties are frequent, some bundles moved off a budget line by a share of 1e-9 to 1e-13."""
    count = int(rng.integers(2, 5))
    prices, choices = rng.integers(1, 5, (count, 2)).astype(float), rng.integers(0, 5, (count, 2)) + 1.0
    for s, t in rng.integers(0, count, (3, 2)):
        gap = rng.choice([0.0, 1.0, -1.0]) * 10.0 ** -rng.integers(9, 14)
        spent, other = prices[t] @ choices[t], prices[t] @ choices[s]
        choices[s] *= (1.0 + gap) * spent / other
    return prices, choices


def check_numbers(found: RevealedPreferences, ratios: list[list[Fraction]]) -> None:
    """Afriat's inequalities, and the order of what one budget ranks, in exact arithmetic but for the numbers' own digits."""
    efficiency, everybody = Fraction(found.efficiency), range(len(ratios))
    u, rate = ([Fraction(float(each)) for each in numbers] for numbers in (found.utilities, found.multipliers))
    assert min(rate) >= 1
    for t in everybody:
        for s in everybody:
            excess = ratios[t][s] - efficiency
            size = abs(u[t]) + abs(u[s]) + rate[t] * (abs(excess) + Fraction(1, 10**3))
            assert u[s] - u[t] - rate[t] * excess <= Fraction(2, 10**12) * size, (t, s)


def test_near_ties_are_judged_as_in_exact_arithmetic(fresh_rng: np.random.Generator) -> None:
    verdicts, tied = [], 0
    for _ in range(60):
        prices, choices = nearly_tied(fresh_rng)
        ratios = exact(prices, choices)
        off = [abs(float(each - 1)) for row in ratios for each in row]
        if any(1e-15 < each < 5e-14 for each in off):  # neither a tie nor a gap of the data
            continue
        tied += any(1e-14 < each < 2e-9 for each in off)
        rounded = [[Fraction(1) if abs(each - 1) < Fraction(1, 10**14) else each for each in row] for row in ratios]
        found = revealed_preferences(prices, choices)
        consistent, index = exact_verdict(rounded, Fraction(1))
        assert found.is_consistent == consistent
        assert found.efficiency_index == pytest.approx(float(index), rel=2e-15)
        verdicts.append(consistent)
        if consistent:
            check_numbers(found, rounded)
        else:
            with pytest.raises(ModelError) as caught:
                found.utility(choices)
            advice = float(str(caught.value).rpartition(" ")[2])
            assert advice < index
            assert revealed_preferences(prices, choices, efficiency=advice).is_consistent
    assert {True, False} <= set(verdicts)
    assert tied > 10


@pytest.mark.parametrize("gap", [1e-9, 1e-10, 1e-11, 1e-12, 1e-13])
def test_efficiencies_next_to_the_index_have_their_verdict(gap: float, fresh_rng: np.random.Generator) -> None:
    told = 0
    while told < 4:  # most draws are consistent: their index is one
        prices, choices = fresh_rng.uniform(0.5, 2.0, (4, 3)), fresh_rng.uniform(0.1, 3.0, (4, 3))
        index = revealed_preferences(prices, choices).efficiency_index
        if index == 1.0:
            continue
        told += 1
        ratios = exact(prices, choices)
        for efficiency in (index * (1.0 - gap), min(1.0, index * (1.0 + gap))):
            found = revealed_preferences(prices, choices, efficiency=efficiency)
            assert found.is_consistent == exact_verdict(ratios, Fraction(efficiency))[0] == (efficiency < index)
            if found.is_consistent:
                check_numbers(found, ratios)
                assert np.isfinite(found.utility(choices)).all()


def test_the_advised_efficiency_explains_the_choices() -> None:
    """The index is 2/3, printed as 0.666667 where it is rounded to the nearest: nothing explains the choices there."""
    prices, choices = [[2.0, 1.0], [1.0, 2.0]], [[4.0, 1.0], [1.0, 4.0]]
    found = revealed_preferences(prices, choices)
    assert found.efficiency_index == pytest.approx(2 / 3)
    with pytest.raises(ModelError, match=r"below 0\.666666, such as 0\.666666$"):
        found.utility(choices)
    assert "efficiency index 0.666666" in found.summary()
    assert revealed_preferences(prices, choices, efficiency=0.666666).is_consistent
    assert not revealed_preferences(prices, choices, efficiency=0.666667).is_consistent
    even = revealed_preferences([[2.0, 1.0], [1.0, 2.0]], [[2.0, 1.0], [1.0, 2.0]])
    with pytest.raises(ModelError, match=r"below 0\.8, such as 0\.799999$"):
        even.utility([1.0, 1.0])
    hopeless = revealed_preferences([[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 1.0]], efficiency=0.5)
    with pytest.raises(ModelError, match="none will do"):
        hopeless.utility([1.0, 1.0])


def test_ties_of_decimal_prices_are_ties() -> None:
    """0.1·3 + 0.2·3 = 0.9 = 0.1·1 + 0.2·4 in decimals, not in binary: every step of the cycle is an indifference."""
    found = revealed_preferences([[0.1, 0.2], [0.1, 0.2]], [[3.0, 3.0], [1.0, 4.0]])
    assert found.is_consistent
    assert found.utilities == pytest.approx([0.0, 0.0])
    assert revealed_preferences([[0.2, 0.1], [0.1, 0.2]], [[2.0, 1.0], [1.0, 2.0]], efficiency=0.8).is_consistent


def test_near_ties_that_no_floats_resolve_keep_their_verdict() -> None:
    """Ratios are the prices where each choice is one unit of a good of its own. Each choice is half as dear as the one above
    it, which is dearer than its own budget by 1e-9 alone: λ grows by 5e8 with each of 40, beyond floating point."""
    prices = np.full((40, 40), 2.0) - np.eye(40)
    above = np.arange(39)
    prices[above, above + 1], prices[above + 1, above] = 0.5, 1.0 + 1e-9
    few = revealed_preferences(prices[:9, :9], np.eye(9))
    check_numbers(few, exact(prices[:9, :9], np.eye(9)))
    assert few.multipliers.max() >= 5e8**8 * 0.999
    many = revealed_preferences(prices, np.eye(40))
    assert many.is_consistent
    assert many.efficiency_index == 1.0
    assert "consistent       yes" in many.summary()
    with pytest.raises(SolverError, match=r"consistent at efficiency 1, .* such as 0\.999999$"):
        many.utility(np.eye(40))
    assert np.isfinite(revealed_preferences(prices, np.eye(40), efficiency=0.999999).utility(np.eye(40))).all()


def test_the_samples_hold_both_kinds() -> None:
    found = [
        revealed_preferences(rng.uniform(0.5, 2.0, (5, 2)), rng.uniform(0.1, 3.0, (5, 2))).is_consistent
        for rng in map(np.random.default_rng, range(40))
    ]
    assert 5 < sum(found) < 35


def test_a_textbook_violation() -> None:
    """Each bundle is bought although the other was cheaper: p¹x² = 4 < 5 = p¹x¹ and p²x¹ = 4 < 5 = p²x²."""
    found = revealed_preferences([[2.0, 1.0], [1.0, 2.0]], [[2.0, 1.0], [1.0, 2.0]])
    assert not found.is_consistent
    assert set(found.cycle) == {0, 1}
    assert found.efficiency_index == pytest.approx(0.8)
    with pytest.raises(ModelError, match=r"below 0\.8"):
        found.utility([1.0, 1.0])
    assert "no: " in found.summary()
    assert revealed_preferences([[2.0, 1.0], [1.0, 2.0]], [[2.0, 1.0], [1.0, 2.0]], efficiency=0.79).is_consistent


def test_a_cycle_of_three_without_one_of_two() -> None:
    prices = [[1.0, 1.0, 2.0], [2.0, 1.0, 1.0], [1.0, 2.0, 1.0]]
    choices = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    weak = revealed_preferences(prices, choices)
    assert weak.is_consistent  # every step of the cycle is an indifference
    assert weak.efficiency_index == 1.0
    prices = [[1.0, 0.9, 2.0], [2.0, 1.0, 0.8], [0.7, 2.0, 1.0]]
    strict = revealed_preferences(prices, choices)
    assert strict.cycle in {(0, 1, 2), (1, 2, 0), (2, 0, 1)}
    assert strict.efficiency_index == pytest.approx(0.9)


def test_indifference_and_a_strict_step_violate_at_index_one() -> None:
    found = revealed_preferences([[1.0, 1.0], [1.0, 2.0]], [[1.0, 1.0], [2.0, 0.0]])
    assert found.is_consistent
    found = revealed_preferences([[1.0, 1.0], [1.0, 0.5]], [[2.0, 0.0], [1.0, 1.0]])
    assert found.is_consistent
    found = revealed_preferences([[1.0, 1.0], [1.0, 2.0]], [[2.0, 0.0], [1.0, 1.0]])
    assert not found.is_consistent
    assert found.efficiency_index == 1.0


@pytest.mark.parametrize("seed", range(4))
def test_cobb_douglas_choices_are_rational(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shares, prices = rng.dirichlet(np.ones(3)), rng.uniform(0.5, 2.0, (30, 3))
    choices = shares * rng.uniform(1.0, 4.0, (30, 1)) / prices
    found = revealed_preferences(prices, choices)
    assert found.is_consistent
    assert found.efficiency_index == 1.0
    check_rationalises(found, prices, choices, rng)
    # Observed choices are ranked as the true utility ranks them wherever one budget holds both.
    truth = (shares * np.log(choices)).sum(axis=1)
    affordable = prices @ choices.T <= (prices * choices).sum(axis=1)[:, None]
    t, s = np.nonzero(affordable)
    assert (truth[t] >= truth[s] - 1e-12).all()
    assert (found.utility(choices)[t] >= found.utility(choices)[s] - 1e-8).all()


def check_rationalises(
    found: RevealedPreferences, prices: np.ndarray, choices: np.ndarray, rng: np.random.Generator
) -> None:
    best = found.utility(choices)
    assert best == pytest.approx(found.utilities, abs=1e-8) or found.efficiency < 1.0
    for t, price in enumerate(prices):
        spent = found.efficiency * (price @ choices[t])
        others = rng.dirichlet(np.ones(len(price)), 50) * spent / price
        assert (found.utility(others) <= best[t] + 1e-8).all()
    low, high = rng.uniform(0.0, 3.0, (2, 50, prices.shape[1]))
    assert (found.utility(0.5 * (low + high)) >= 0.5 * (found.utility(low) + found.utility(high)) - 1e-9).all()
    assert (found.utility(low + 0.1) > found.utility(low)).all()


@pytest.mark.parametrize("seed", range(6))
def test_random_choices_are_rationalised_below_their_index(seed: int) -> None:
    rng = np.random.default_rng([3, seed])
    prices, choices = rng.uniform(0.5, 2.0, (8, 3)), rng.uniform(0.1, 3.0, (8, 3))
    index = revealed_preferences(prices, choices).efficiency_index
    found = revealed_preferences(prices, choices, efficiency=0.999 * index)
    assert found.is_consistent
    check_rationalises(found, prices, choices, rng)
    if index < 1.0:
        assert not revealed_preferences(prices, choices, efficiency=min(1.0, 1.001 * index)).is_consistent


def preferences_of(shares: np.ndarray, rng: np.random.Generator) -> RevealedPreferences:
    prices = rng.uniform(0.5, 2.0, (12, len(shares)))
    return revealed_preferences(prices, shares * 3.0 / prices)


@pytest.mark.parametrize("seed", range(4))
def test_consistent_beliefs_of_a_choice_hold_the_belief_behind_it(seed: int) -> None:
    rng = np.random.default_rng([5, seed])
    states = [preferences_of(rng.dirichlet(np.ones(3)), rng) for _ in range(3)]
    prices = rng.uniform(0.5, 2.0, 3)
    budget = Polyhedron(np.vstack([-np.eye(3), prices]), [0.0, 0.0, 0.0, 3.0])
    problem = preference_problem(states, budget)
    held = rng.dirichlet(np.ones(3), 12)
    choices = problem.solve(held)
    costs = problem.state_costs(choices)
    for i, state in enumerate(states):
        assert costs[:, i] == pytest.approx(-state.utility(choices))
    # No other affordable bundle is better under the belief.
    others = rng.dirichlet(np.ones(3), 300) * 3.0 / prices
    assert ((held * costs).sum(axis=1) <= (held @ problem.state_costs(others).T).min(axis=1) + 1e-9).all()
    for belief, choice in zip(held, choices, strict=True):
        found = consistent_beliefs(problem, choice)
        assert found.contains(belief)
        # The corners explain the choice too.
        for corner in found.vertices():
            assert problem.regret(corner / corner.sum(), choice) < 1e-3
    told = {tuple(consistent_beliefs(problem, c).bounds().round(6).ravel()) for c in choices}
    assert len(told) > 1


def test_piecewise_linear_costs_keep_the_promises_of_a_problem() -> None:
    rng = np.random.default_rng(8)
    slopes = [rng.normal(size=(4, 3)), rng.normal(size=(2, 3))]
    problem = PiecewiseLinearProblem(slopes, [rng.normal(size=4), rng.normal(size=2)], simplex(3))
    check_decision_problem(problem, rng=rng)


def test_tables_are_aligned_by_their_labels_or_refused() -> None:
    prices = pd.DataFrame([[1.0, 2.0], [2.0, 1.0]], columns=["tea", "milk"], index=["May", "June"])
    choices = pd.DataFrame([[2.0, 1.0], [1.5, 2.0]], columns=["tea", "milk"], index=["May", "June"])
    found = revealed_preferences(prices, choices)
    shuffled = revealed_preferences(prices, choices.loc[["June", "May"], ["milk", "tea"]])
    assert np.array_equal(shuffled.choices, found.choices)
    assert shuffled.goods == ("tea", "milk")
    assert shuffled.utility(pd.Series([1.0, 3.0], ["milk", "tea"])) == found.utility([3.0, 1.0])
    assert np.array_equal(revealed_preferences(prices.to_numpy(), choices).choices, found.choices)
    with pytest.raises(InputError, match="missing: tea, milk; not expected: cups, jugs"):
        revealed_preferences(prices, choices.set_axis(["cups", "jugs"], axis=1))
    other = revealed_preferences(prices[["milk", "tea"]], choices)
    budget = Polyhedron(np.vstack([-np.eye(2), [1.0, 1.0]]), [0.0, 0.0, 3.0])
    both = preference_problem([found, other], budget)
    assert np.abs(both.state_costs([1.0, 2.0])[0] - both.state_costs([1.0, 2.0])[1]) < 1e-9


def test_what_cannot_be_is_refused(tmp_path: object) -> None:
    good = [[1.0, 1.0]]
    with pytest.raises(InputError, match="same"):
        revealed_preferences(good, [[1.0]])
    with pytest.raises(InputError, match=r"prices has -1 at index \[0, 1\]"):
        revealed_preferences([[1.0, -1.0]], good)
    with pytest.raises(InputError, match="costs nothing"):
        revealed_preferences(good, [[0.0, 0.0]])
    with pytest.raises(InputError, match="at most 1"):
        revealed_preferences(good, good, efficiency=1.5)
    with pytest.raises(InputError, match="one per state"):
        preference_problem([], simplex(2))
    with pytest.raises(InputError, match="one per state"):
        preference_problem(revealed_preferences(good, good), simplex(2))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="expected 2 goods"):
        revealed_preferences(good, good).utility([1.0, 2.0, 3.0])
    with pytest.raises(InputError, match="as many"):
        PiecewiseLinearProblem([[[1.0, 0.0]]], [], simplex(2))
    with pytest.raises(InputError, match="state 0"):
        PiecewiseLinearProblem([[[1.0, 0.0]]], [[0.0, 1.0]], simplex(2))
    one = revealed_preferences(good, good)
    with pytest.raises(ModelError, match="no minimum"):
        preference_problem([one], Polyhedron(-np.eye(2), [0.0, 0.0]))
    one.save(tmp_path / "one.npz")
    assert RevealedPreferences.load(tmp_path / "one.npz").utility([2.0, 2.0]) == one.utility([2.0, 2.0])
