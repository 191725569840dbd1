"""Disclosures: what they show, what observers make of it, and that less shown never tells more."""

from __future__ import annotations

import os
import re
from itertools import pairwise, product
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import hadamard

import inscrutable as ins
from inscrutable import Disclosure, InputError
from inscrutable.cli import main
from inscrutable.experiments.backtest_inputs import BacktestSettings
from inscrutable.experiments.comparison import ComparisonSettings, makers_of
from inscrutable.experiments.disclosing import DisclosureRow, DisclosureTable, under_disclosures
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.mechanisms.chains import BeliefChain, resting_chain
from inscrutable.mechanisms.disclosed import disclosed, shown_classes
from inscrutable.reports.backtest import table_of
from sizes import instances
from small_runs import learned_from_few

SEED = int(os.environ.get("FRESH_SEED", "7"))
RNG = np.random.default_rng(SEED)
CASES = 12

SHORTER = [  # what is shown first, and less
    ("exact", "at_least(0.01)"),
    ("at_least(0.01)", "at_least(0.05)"),
    ("at_least(0.05)", "at_least(0.3)"),
    ("exact", "long_only()"),
    ("exact", "rounded(1)"),
    ("exact", "top(2)"),
    ("top(2)", "top(1)"),
    ("exact", "grouped([a, b, a])"),
    ("rounded(1)", "rounded(1)|long_only()"),
    ("long_only()", "long_only()|grouped([a, b, a])|rounded(0)"),
]
RARER = [
    ("exact", "every(2)"),
    ("every(2)", "every(4)"),
    ("every(2, 1)", "every(4, 3)"),
    ("every(1)", "delayed(1)"),
    ("delayed(1)", "delayed(2)"),
    ("every(2)|delayed(1)", "every(2)|delayed(2)"),
    ("delayed(2)", "delayed(2)|every(2)"),
    ("exact", "form_13f()"),
    ("n_port()", "form_13f()"),
]


def market(rng: np.random.Generator, n_states: int = 2) -> tuple[BeliefChain, ins.Mechanism]:
    """A chain on a few beliefs, and a mechanism of long and short decisions, some of which are equal."""
    count, n_actions = int(rng.integers(2, 5)), int(rng.integers(2, 6))
    beliefs = rng.dirichlet(np.ones(n_states), size=count)
    weights = rng.dirichlet(np.ones(count)) * (rng.random(count) < 0.8)
    prior = ins.Prior(beliefs, weights / weights.sum() if weights.sum() > 0 else np.full(count, 1 / count))
    actions = rng.normal(scale=0.4, size=(n_actions, 3)).round(int(rng.integers(1, 4)))
    table = rng.dirichlet(0.4 * np.ones(n_actions), size=count)
    return resting_chain(prior, float(rng.random())), ins.Mechanism(
        beliefs, actions, table, rng.random((count, n_actions))
    )


def stepwise(text: str, actions: Any) -> Any:
    """What a schedule shows, one operation on a list after the other."""
    stream: list[Any] = list(actions)
    for part in text.split("|") if text != "exact" else []:
        name, numbers = part[: part.index("(")], [int(x) for x in part[part.index("(") + 1 : -1].split(",")]
        if name == "every":
            n, offset = (*numbers, 0)[:2]
            stream = [x if t % n == offset else None for t, x in enumerate(stream)]
        else:
            stream = ([None] * numbers[0] + stream)[: len(stream)]
    return stream


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 4), st.integers(0, 3), st.booleans()), max_size=4), st.integers(1, 20))
def test_schedules_are_what_they_do_to_a_stream_step_by_step(parts: list[tuple[int, int, bool]], n_steps: int) -> None:
    text = "|".join(f"every({n}, {k % n})" if is_every else f"delayed({k})" for n, k, is_every in parts) or "exact"
    expected = stepwise(text, range(n_steps))
    if all(x is None for x in stepwise(text, range(1000))):
        with pytest.raises(InputError, match="never shows"):
            Disclosure.of(text)
        return
    shown = Disclosure.of(text)(np.arange(n_steps))
    assert [None if np.isnan(x) else int(x) for x in shown] == expected
    assert Disclosure.of(str(Disclosure.of(text))) == Disclosure.of(text)


def test_maps_show_what_they_say() -> None:
    held = [[0.62, -0.13, 0.04, 0.47]]
    for text, expected in {
        "exact": held,
        "rounded(1)": [[0.6, -0.1, 0.0, 0.5]],
        "long_only()": [[0.62, 0.0, 0.04, 0.47]],
        "at_least(0.1)": [[0.62, -0.13, 0.0, 0.47]],
        "top(2)": [[0.62, 0.0, 0.0, 0.47]],
        "top(9)": held,
        "grouped([x, y, y, x])": [[1.09, -0.09]],
        "long_only()|grouped([x, y, y, x])|rounded(1)": [[1.1, 0.0]],
    }.items():
        np.testing.assert_allclose(Disclosure.of(text).shown(held), expected, atol=1e-12, err_msg=text)
    np.testing.assert_allclose(ins.portfolio_return().shown(held, returns=[0.1, 0.2, 0.3, 0.4]), [[0.236]])
    assert ins.top(1).shown([[0.5, 0.5]]).tolist() == [[0.5, 0.0]], "ties go to the first"
    assert ins.grouped([7, 3, 7])([0, 1, 2]).tolist() == [0.0, 1.0, 0.0]
    named = pd.DataFrame(held, columns=list("ABCD"))
    mixed = pd.DataFrame([[0.4, 0.3, 0.2, 0.1]], columns=list("DCBA"))
    assert ins.portfolio_return()(named, returns=mixed).item() == pytest.approx(0.236)


def test_text_and_tables_say_the_same() -> None:
    whole = ins.long_only() | ins.every(3, offset=2) | ins.delayed(2) | ins.grouped(["energy", "real estate"])
    assert Disclosure.of(str(whole)) == whole
    assert (
        Disclosure.of({"long_only": True, "every": [3, 2], "delayed": 2, "grouped": ["energy", "real estate"]}) == whole
    )
    assert Disclosure.of({"every": {"n": 3, "offset": 2}}) == ins.every(3, 2)
    assert hash(Disclosure.of("every(3)")) == hash(ins.every(3))
    assert str(Disclosure()) == "exact"
    assert Disclosure.of("exact") == Disclosure.of(None) == Disclosure()
    assert ins.form_13f().schedule == ins.n_port().schedule == (ins.every(3, 2) | ins.delayed(2)).schedule
    assert "1 step late" in Disclosure.of("delayed(1)").summary()
    assert "2 steps late" in Disclosure.of("delayed(2)").summary()
    assert "45 days" in ins.form_13f().summary()
    assert "February 2026" in ins.n_port().summary()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("every(2)|every(2, 1)", "never shows"),
        ("every(0)", "at least 1"),
        ("every(2, 2)", "below 2"),
        ("every(1.5)", "whole number"),
        ("delayed(-1)", "at least 0"),
        ("rounded(16)", "at most 15"),
        ("at_least(-0.1)", "at least 0"),
        ("top(0)", "at least 1"),
        ("grouped([])", "one at least"),
        ("grouped(3)", "labels"),
        ("form_13f(3)", "below 3"),
        ("sometimes(3)", "there is no disclosure 'sometimes'"),
        ("every(1, 2, 3)", "other arguments"),
        ("every(3", "is written as"),
        ("every(3)+delayed(1)", "is written as"),
        ("().__class__", "is written as"),
        ("", "is written as"),
        (3, "is written as"),
        ({"every": "x"}, "whole number"),
    ],
)
def test_malformed_disclosures_are_refused(text: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Disclosure.of(text)


@settings(max_examples=instances(200))
@given(st.floats(0, allow_nan=False, allow_infinity=False))
def test_the_text_of_a_disclosure_is_read_back_exactly(weight: float) -> None:
    assert Disclosure.of(str(ins.at_least(weight))) == ins.at_least(weight)


@pytest.mark.parametrize(
    ("weight", "text"), [(1234567.0, "1234567"), (0.1234567891, "0.1234567891"), (0.05, "0.05"), (2, "2")]
)
def test_the_text_of_a_size_has_all_digits(weight: float, text: str) -> None:
    assert str(ins.at_least(weight)) == f"at_least({text})"
    assert Disclosure.of(f"at_least({text})") == ins.at_least(weight)


def test_a_disclosure_is_joined_with_nothing_else() -> None:
    with pytest.raises(TypeError, match="unsupported operand"):
        ins.every(3) | 3  # type: ignore[operator]


def test_maps_that_do_not_suit_are_refused() -> None:
    with pytest.raises(InputError, match="2 labels"):
        ins.grouped(["a", "b"]).shown([[0.1, 0.2, 0.7]])
    with pytest.raises(InputError, match="choices"):
        ins.rounded(1).shown([0, 1])
    with pytest.raises(InputError, match="pass `returns`"):
        ins.portfolio_return()([[0.5, 0.5]])
    with pytest.raises(InputError, match="does not use them"):
        ins.rounded(1)([[0.5, 0.5]], returns=[[0.1, 0.1]])
    with pytest.raises(InputError, match="shows 1 of 2"):
        (ins.grouped(["a", "a"]) | ins.portfolio_return())([[0.5, 0.5]], returns=[[0.1, 0.1]])


def test_labelled_decisions_are_refused_where_coordinates_are_meant_by_position() -> None:
    network = ins.PowerNetwork([0.0, 50.0], [0, 1], [80.0, 40.0], [0.02, 0.01], [1.0, 2.0], [[0, 1]], [[0.1, 30.0]])
    dispatch = ins.dispatch_problem(network, [0, 1], [[5.0, 4.0], [25.0, 9.0]])
    plain = dispatch.solve([[0.5, 0.5]])
    held = pd.DataFrame(plain, columns=list("dcba"))
    for disclosure in (ins.only([0]), ins.grouped(list("abab")), ins.bus_prices(dispatch)):
        np.testing.assert_array_equal(disclosure.shown(pd.DataFrame(plain)), disclosure.shown(plain))
        for table in (held, held[list("abcd")]):
            with pytest.raises(InputError, match="their order is not known here"):
                disclosure.shown(table)
            with pytest.raises(InputError, match="their order is not known here"):
                disclosure(table)


def test_a_mechanism_is_merged_as_a_loop_merges_it() -> None:
    for _ in range(CASES):
        _, played = market(RNG)
        for text in {each for pair in SHORTER for each in pair}:
            shown = Disclosure.of(text)
            seen = disclosed(played, shown)
            rows = [tuple(np.round(row, 9) + 0.0) for row in np.atleast_2d(shown.shown(played.actions))]
            for b, row in enumerate(played.probabilities):
                summed: dict[Any, float] = {}
                for key, share in zip(rows, row, strict=True):
                    summed[key] = summed.get(key, 0.0) + share
                found = {
                    tuple(np.round(u, 9) + 0.0): k for u, k in zip(seen.actions, seen.probabilities[b], strict=True)
                }
                assert found == pytest.approx(summed, abs=1e-12), text
            np.testing.assert_allclose(seen.expected_regrets, played.expected_regrets, atol=1e-12)


def figures(found: ins.Leakage) -> np.ndarray:
    return np.array([value for value in vars(found).values() if not isinstance(value, str)], dtype=np.float64)


def test_less_shown_of_a_decision_never_tells_more() -> None:
    for _ in range(CASES):
        chain, played = market(RNG)
        plain = ins.leakage(played, chain.prior)
        np.testing.assert_allclose(
            figures(plain), figures(ins.leakage(played, chain.prior, disclosure="exact")), atol=1e-12
        )
        for more, less in SHORTER:
            first, second = (ins.leakage(played, chain.prior, disclosure=each) for each in (more, less))
            assert second.mutual_information <= first.mutual_information + 1e-12, (more, less)
            assert second.bayes_error >= first.bayes_error - 1e-12, (more, less)
            assert second.top_state_accuracy <= first.top_state_accuracy + 1e-12, (more, less)
            assert second.maximal_leakage <= first.maximal_leakage + 1e-12, (more, less)
            for name in ("expected_regret", "worst_regret", "worst_expected_regret", "prior_error"):
                assert getattr(second, name) == pytest.approx(getattr(plain, name), abs=1e-12)


def test_rarer_and_later_never_tells_more() -> None:
    """All sequences of five of at most five decisions are followed: figures without a sampling error."""
    rng, count = np.random.default_rng([SEED, 5]), instances(CASES, least=2)
    for case in range(count):
        chain, played = market(rng)
        for more, less in RARER if case < count // 2 else [pair for pair in SHORTER if "top" in pair[1]]:
            first, second = (
                ins.path_leakage(chain, played, 5, rng=np.random.default_rng(0), n_draws=5**5, disclosure=each)
                for each in (more, less)
            )
            assert first.n_draws == second.n_draws == 0
            assert (second.bayes_error >= first.bayes_error - 1e-9).all(), (more, less)
            assert (second.belief_information <= first.belief_information + 1e-9).all(), (more, less)


def test_exact_changes_no_figure_over_time() -> None:
    chain, played = market(RNG)
    plain, same = (
        ins.path_leakage(chain, played, 5, rng=np.random.default_rng(3), **more)  # type: ignore[arg-type]
        for more in ({}, {"disclosure": Disclosure()})
    )
    for name in vars(plain):
        np.testing.assert_array_equal(getattr(plain, name), getattr(same, name))


def enumerated_law(chain: BeliefChain, played: ins.Mechanism, seen: list[Any], step: int) -> np.ndarray:
    """The law of π_step given decisions by step (None: not seen), by all paths of beliefs."""
    weights, table = chain.prior.weights, chain.transition.toarray()
    law = np.zeros(len(weights))
    for path in product(range(len(weights)), repeat=step + 1):
        chance = weights[path[0]] * np.prod([table[a, b] for a, b in pairwise(path)])
        for s, b in enumerate(path):
            if seen[s] is not None:
                chance *= played.probabilities[b, seen[s]].sum()
        law[path[-1]] += chance
    return law / law.sum()


@pytest.mark.parametrize(
    "text", ["exact", "every(2)", "delayed(1)", "every(3, 1)|delayed(2)", "rounded(0)|delayed(1)|every(2)"]
)
def test_a_sequence_is_read_as_enumeration_reads_it(text: str) -> None:
    shown = Disclosure.of(text)
    for _ in range(3):
        chain, played = market(RNG)
        places = RNG.integers(0, len(played.actions), size=5)
        if not played.probabilities.min() > 0:
            continue
        look = shown_classes(played.actions, shown)[1]
        found = ins.SequentialAdversary(chain, played, disclosure=shown).filter(shown(played.actions[places]))
        for t in range(5):
            known = [
                np.flatnonzero(look == look[places[s]])
                if shown.schedule.shows(s) and s + shown.schedule.lag <= t
                else None
                for s in range(t + 1)
            ]
            expected = enumerated_law(chain, played, known, t)
            np.testing.assert_allclose(found.weights[t], expected, atol=1e-12)
            np.testing.assert_allclose(found.mean[t], expected @ chain.prior.beliefs, atol=1e-12)


def test_probabilities_of_what_is_shown_multiply_to_those_of_the_sequence() -> None:
    """Late decisions have the chances that the same ones have at once."""
    chain, played = market(RNG)
    acts = played.actions[RNG.integers(0, len(played.actions), size=6)]
    for lag in range(4):
        now = ins.SequentialAdversary(chain, played, disclosure="every(2)").filter(ins.every(2)(acts))
        shown = ins.every(2) | ins.delayed(lag)
        late = ins.SequentialAdversary(chain, played, disclosure=shown).filter(shown(acts))
        np.testing.assert_allclose(late.log_likelihood[lag:], now.log_likelihood[: 6 - lag], atol=1e-12)


def test_a_sensor_is_read_at_once_where_decisions_are_late() -> None:
    """Joint enumeration over states: an agent that knows the state, a rival with a sensor of its own and old decisions."""
    sure = ins.CategoricalEmission(np.eye(2))
    world = ins.HiddenMarkovModel([[0.8, 0.2], [0.3, 0.7]], sure, [0.6, 0.4])
    own = np.array([[0.7, 0.3], [0.2, 0.8]])
    table = np.array([[0.9, 0.1], [0.25, 0.75]])
    played = ins.Mechanism(np.eye(2), [0, 1], table, np.zeros((2, 2)))
    rival = ins.SequentialAdversary(world, played, sensor=ins.CategoricalEmission(own), disclosure="delayed(2)")
    acts, heard = np.array([0, 1, 1, 0, 1]), [0, 0, 1, 1, 0]
    found = rival.filter(ins.delayed(2)(acts), observations=heard)
    totals = []
    for t in range(5):
        law = np.zeros(2)
        for path in product(range(2), repeat=t + 1):
            chance = world.initial[path[0]] * np.prod([world.transition[a, b] for a, b in pairwise(path)])
            chance *= np.prod([own[x, heard[s]] for s, x in enumerate(path)])
            chance *= np.prod([table[x, acts[s]] for s, x in enumerate(path) if s + 2 <= t])
            law[path[-1]] += chance
        totals.append(law.sum())
        np.testing.assert_allclose(found.mean[t], law / law.sum(), atol=1e-12)
    np.testing.assert_allclose(found.log_likelihood.cumsum(), np.log(totals), atol=1e-12)


@pytest.mark.parametrize("flip", [0.05, 0.3, 0.5])
def test_a_chain_of_two_states_seen_late_is_guessed_as_the_formula_says(flip: float) -> None:
    chain = BeliefChain(ins.Prior(np.eye(2), [0.5, 0.5]), [[1 - flip, flip], [flip, 1 - flip]])
    book = ins.Mechanism(np.eye(2), [0, 1], np.eye(2), 1 - np.eye(2))
    acts = np.array([0, 1, 1, 0, 0, 1, 0])
    for d in range(5):
        error = (1 - (1 - 2 * flip) ** d) / 2
        found = ins.path_leakage(chain, book, 7, rng=RNG, n_draws=300, disclosure=ins.delayed(d))
        np.testing.assert_allclose(found.bayes_error[d:] ** 2, 2 * error * (1 - error), atol=1e-12)
        read = ins.SequentialAdversary(chain, book, disclosure=ins.delayed(d)).filter(ins.delayed(d)(acts))
        np.testing.assert_allclose(read.mean[d:].min(axis=1), error, atol=1e-12)
        if flip < 0.5:
            np.testing.assert_array_equal(read.mean[d:].argmax(axis=1), acts[: 7 - d])


def test_sampled_paths_agree_with_all_paths() -> None:
    """A mechanism with a private memory, of which decisions are left out, is sampled; with one memory all is enumerated."""
    chain, played = market(np.random.default_rng(2))
    count, n_actions = played.probabilities.shape
    table = np.zeros((count, 2, n_actions, 2))
    for before, after in product(range(2), repeat=2):  # a memory that nothing depends on
        table[:, before, :, after] = 0.5 * played.probabilities
    memory = ins.MemoryMechanism(played.beliefs, played.actions, table, [0.5, 0.5], played.regrets)
    for text in ("every(2)|delayed(1)", "at_least(0.3)|every(3, 1)"):
        exact = ins.path_leakage(chain, played, 6, rng=RNG, n_draws=5000, disclosure=text)
        drawn = ins.path_leakage(chain, memory, 6, rng=RNG, n_draws=400, disclosure=text)
        assert (exact.n_draws, drawn.n_draws) == (0, 400)
        for name in ("cumulative", "belief_information"):
            gap = np.abs(getattr(exact, name) - getattr(drawn, name))
            assert (gap <= 5 * getattr(drawn, f"{name}_se") + 1e-9).all(), (text, name)
        assert (np.abs(exact.bayes_error - drawn.bayes_error) <= 5 * drawn.error_se + 1e-9).all()


def test_an_observer_of_single_decisions_knows_no_more_than_is_shown() -> None:
    chain, played = market(RNG, n_states=3)
    for text in ("rounded(1)", "top(1)", "long_only()|grouped([a, a, b])"):
        shown = Disclosure.of(text)
        rival = ins.BayesianAdversary(played, chain.prior, disclosure=text)
        values = shown.shown(played.actions)
        look = shown_classes(played.actions, shown)[1]
        joint = chain.prior.weights[:, None] * played.probabilities
        for m, value in enumerate(values):
            law = joint[:, look == look[m]].sum(axis=1)
            if law.sum() > 0:
                np.testing.assert_allclose(rival.infer(value).weights, law / law.sum(), atol=1e-12)
    with pytest.raises(InputError, match="single decisions"):
        ins.BayesianAdversary(played, chain.prior, disclosure="delayed(1)")


def test_the_naive_observer_keeps_every_candidate_that_looks_so() -> None:
    problem = ins.MarkowitzProblem([[0.04, 0.0, 0.02], [0.0, 0.03, 0.01]], [0.1 * np.eye(3), 0.2 * np.eye(3)], 1.0)
    beliefs = ins.uniform_prior(2, 12).beliefs
    optimal = problem.solve(beliefs)
    prior = ins.uniform_prior(2, 12)
    makers: list[Any] = [
        lambda **more: ins.NaiveAdversary(problem, **more),
        lambda **more: ins.NearOptimalAdversary(problem, 1e-5, **more),
        lambda **more: ins.NearOptimalAdversary(problem, 1e-5, prior=prior, **more),
        lambda **more: ins.BudgetAwareAdversary(problem, ins.Budget.regret(1e-5), prior=prior, **more),
    ]
    for make in makers:
        plain = make()
        same = make(disclosure="at_least(1e-9)", candidates=optimal)
        np.testing.assert_allclose(same.estimates(optimal), plain.estimates(optimal), atol=1e-12)
        blurred = make(disclosure="rounded(1)", candidates=optimal)
        values = ins.rounded(1).shown(optimal)
        for belief, value in zip(beliefs, values, strict=True):
            held = blurred.infer(value)
            alike = [u for u, v in zip(optimal, values, strict=True) if np.abs(v - value).max() < 1e-9]
            assert held.contains(belief)
            assert len(held.members) == len(alike)
            assert not np.isnan(blurred.estimate(value)).any()
        far = np.array([9.0, 9.0, 9.0])
        assert blurred.infer(far).is_empty
        assert np.isnan(blurred.estimate(far)).all()
        assert not np.isnan(blurred.estimate(far, nearest=True)).any()
    with pytest.raises(InputError, match="candidates"):
        ins.NaiveAdversary(problem, disclosure="rounded(1)")
    with pytest.raises(InputError, match="needs none"):
        ins.NaiveAdversary(problem, candidates=optimal)


def test_returns_tell_decisions_apart_unless_they_are_rounded() -> None:
    chain, played = market(np.random.default_rng(SEED % 1000 + 1))
    acts = played.actions[RNG.integers(0, len(played.actions), size=6)]
    returns = RNG.normal(scale=0.1, size=(6, 3))
    plain = ins.SequentialAdversary(chain, played).filter(acts)
    value = ins.portfolio_return()
    through = ins.SequentialAdversary(chain, played, disclosure=value)
    found = through.filter(value(acts, returns=returns), returns=returns)
    np.testing.assert_allclose(found.weights, plain.weights, atol=1e-9)
    coarse = value | ins.rounded(0)  # every return is zero
    blind = ins.SequentialAdversary(chain, played, disclosure=coarse)
    nothing = blind.filter(coarse(acts, returns=0.01 * returns), returns=0.01 * returns)
    np.testing.assert_allclose(nothing.weights, np.tile(chain.prior.weights, (6, 1)), atol=1e-12)
    with pytest.raises(InputError, match="pass `returns`"):
        through.filter(value(acts, returns=returns))
    with pytest.raises(InputError, match="needs returns, which are not given"):
        ins.path_leakage(chain, played, 3, rng=RNG, disclosure=value)
    with pytest.raises(InputError, match="has no returns"):
        ins.leakage(played, chain.prior, disclosure=value)


def test_what_cannot_be_disclosed_so_is_refused() -> None:
    chain, played = market(RNG)
    with pytest.raises(InputError, match="shows nothing at step 0"):
        ins.SequentialAdversary(chain, played, disclosure="delayed(1)").filter(played.actions[[0, 0]])
    with pytest.raises(InputError, match="single decisions"):
        ins.leakage(played, chain.prior, disclosure="every(3)")
    table = np.zeros((len(played.beliefs), 2, len(played.actions), 2))
    table[:, :, :, 0] = played.probabilities[:, None]
    public = ins.MemoryMechanism(played.beliefs, played.actions, table, [1.0, 0.0], played.regrets, is_public=True)
    with pytest.raises(InputError, match="memory is public"):
        ins.path_leakage(chain, public, 3, rng=RNG, disclosure="every(3)")

    class Rule:
        beliefs = played.beliefs

        def mechanism_for(self, law: ins.Prior, before: Any = None) -> ins.Mechanism:
            return played

    with pytest.raises(InputError, match="was made for"):
        ins.path_leakage(chain, Rule(), 3, rng=RNG, disclosure="every(3)")
    with pytest.raises(InputError, match="was made for"):
        ins.SequentialAdversary(chain, Rule(), disclosure="rounded(3)")


def test_compare_reads_what_is_shown() -> None:
    """The sequence of a chain that is drawn anew at every step is no more than single decisions; every(1) changes nothing."""
    problem = ins.MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
    chain = resting_chain(ins.uniform_prior(2, 6), 0.7)
    names = ("ODM", "uniform", "delay", "partial trades")[: instances(4)]
    tables = {}
    for text in ("exact", "every(1)", "rounded(1)", "every(3)|delayed(1)"):
        asked = ComparisonSettings(budgets=(0.5,), repeats=(1,), draws=10, disclosure=text)
        with learned_from_few():
            found = ins.compare(problem, chain, asked, makers=makers_of(names), rng=np.random.default_rng(0))
        assert set(found.left_out) == (set() if "every(1)" in text or text == "exact" else set(names[2:]))
        tables[text] = found.frame().set_index("maker")
    pd.testing.assert_frame_equal(tables["exact"], tables["every(1)"], rtol=0, atol=1e-12)
    plain, blurred, rare = (
        tables[text].loc[["ODM", "uniform"]] for text in ("exact", "rounded(1)", "every(3)|delayed(1)")
    )
    played = ins.mechanism(ins.OriginalDecisionMaker(problem), chain.prior.beliefs)
    shown = ins.leakage(played, chain.prior, disclosure="rounded(1)")
    assert blurred.loc["ODM", "bayes_error"] == pytest.approx(shown.bayes_error, abs=1e-12)
    assert blurred.loc["ODM", "mutual_information"] == pytest.approx(shown.mutual_information, abs=1e-12)
    for name in ("expected_regret", "worst_regret", "cost_share"):
        np.testing.assert_array_equal(plain[name], blurred[name])
    for column in ("bayes_error", "naive_error", "path_error"):
        assert blurred.loc["ODM", column] > plain.loc["ODM", column]
    steps = ins.path_leakage(chain, played, 12, rng=RNG, n_draws=400, disclosure="every(3)|delayed(1)")
    expected = np.sqrt(np.mean(steps.bayes_error[-6:] ** 2))
    assert rare.loc["ODM", "path_error"] == pytest.approx(expected, abs=5 * rare.loc["ODM", "path_error_se"] + 0.01)
    assert rare.loc["ODM", "path_bits"] == pytest.approx(
        steps.added[-6:].mean(), abs=5 * rare.loc["ODM", "path_bits_se"] + 0.03
    )
    with pytest.raises(InputError, match="returns"):
        ComparisonSettings(disclosure="portfolio_return()")
    with pytest.raises(InputError, match="no disclosure 'often'"):
        ComparisonSettings(disclosure="often()")


def test_a_study_asks_observers_by_what_they_are_shown(tmp_path: Any) -> None:
    plan = {
        "name": "shown",
        "world": {"kind": "random"},
        "beliefs": {"kind": "grid", "resolution": 4},
        "decision_makers": ["ODM"],
        "measures": ["error"],
        "adversaries": [
            {"name": "bayesian", "disclosure": ["exact", {"rounded": 1}, "top(1)|rounded(1)"]},
            {"name": "naive", "disclosure": ["exact", "rounded(1)"]},
            {"name": "near-optimal", "disclosure": "rounded(1)"},
            {"name": "budget-aware", "disclosure": "rounded(1)"},
        ],
    }
    study = ins.run_study(ins.Study.of(plan), tmp_path / "study")
    assert study.status().failed == 0, list(study.errors())
    means = study.means()
    errors = means[means["measure"] == "error"].set_index("adversary")["mean"]
    assert errors["bayesian, exact"] <= errors["bayesian, rounded(1)"] <= errors["bayesian, top(1)|rounded(1)"]
    plan["adversaries"] = [{"name": "bayesian", "disclosure": "every(3)"}]
    with pytest.raises(InputError, match="alone reads"):
        ins.Study.of(plan)


@pytest.mark.usefixtures("coarse")
def test_a_backtest_has_one_more_rival_where_a_disclosure_is_asked_for() -> None:
    draw = np.random.default_rng(0)
    spread = np.repeat([0.01, 0.05, 0.02, 0.05], 20)[:, None]
    months = pd.date_range("2001-01", periods=80, freq="ME")
    returns = pd.DataFrame(0.01 + spread * draw.normal(size=(80, 2)), index=months, columns=["A", "B"])
    returns = returns.iloc[: 60 + instances(20, least=6)]
    asked = {"regimes": 2, "train_until": "2005-12", "sequential": False}
    found = {
        text: ins.run_backtest(returns, BacktestSettings(**asked, disclosure=text), restarts=2)
        for text in ("exact", "every(3)|delayed(2)", "portfolio_return()")
    }
    plain = table_of(found["exact"])
    late = table_of(found["every(3)|delayed(2)"])
    more = [label for label in late.index if "every(3)|delayed(2)" in label]
    assert len(more) == 2
    assert np.isfinite(late.loc[more].to_numpy()).all()
    pd.testing.assert_frame_equal(plain, late.drop(index=more))
    value, seen = (found["portfolio_return()"].disclosed_estimates("ODM"), found["exact"].followed_estimates("ODM"))
    assert np.isfinite(value.to_numpy()).all()
    assert value.shape == seen.shape
    with pytest.raises(InputError, match="no disclosure"):
        BacktestSettings(disclosure="now()")


def test_schedules_of_months_are_refused_on_rows_of_weeks() -> None:
    returns = 0.01 * np.random.default_rng(0).normal(size=(60, 2))
    weeks, months = (pd.date_range("2001-01", periods=60, freq=each) for each in ("W-FRI", "ME"))
    for text, told in (
        ("form_13f(0)", r"every\(13\)\|delayed\(7\)"),
        ("top(1)|n_port()", r"every\(13\)\|delayed\(9\)"),
    ):
        asked = BacktestSettings(regimes=2, train_until="2002-01", sequential=False, disclosure=text)
        with pytest.raises(InputError, match=f"the steps here are weeks: .*{told}"):
            ins.run_backtest(pd.DataFrame(returns, index=weeks, columns=["A", "B"]), asked, restarts=1)
    asked = BacktestSettings(regimes=2, train_until="2004-12", sequential=False, disclosure="form_13f(0)")
    monthly = ins.run_backtest(pd.DataFrame(returns[:54], index=months[:54], columns=["A", "B"]), asked, restarts=1)
    assert any("form_13f(0)" in label for label in table_of(monthly).index)


@pytest.mark.usefixtures("undrawn")
def test_commands_on_a_model_of_weeks_take_no_schedule_of_months(
    tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    means, spreads = [[0.02, 0.01], [-0.03, 0.0]], [0.01 * np.eye(2), 0.04 * np.eye(2)]
    world = ins.HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], ins.GaussianEmission(means, spreads))
    problem = ins.MarkowitzProblem(means, spreads, 5.0)
    shown = {}
    for step in ("week", "month"):
        model = InvestorModel(world, problem, ("A", "B"), world.names, step=step).save(tmp_path / f"{step}.json")
        ask = ["--model", str(model), "--resolution", "4", "-q", "--out", str(tmp_path / step)]
        assert main(["disclose", *ask, "--steps", "12", "--draws", "10", "--json"]) == 0
        capsys.readouterr()
        table = pd.read_csv(tmp_path / step / "disclosures.csv")
        shown[step] = set(table.iloc[:, 0])
    assert shown["month"] - shown["week"] == {"form_13f()"}
    ask = ["--model", str(tmp_path / "week.json"), "--resolution", "4", "-q", "--out", str(tmp_path / "other")]
    for command in (
        ["disclose", *ask, "--disclosures", "exact;n_port()"],
        ["compare", *ask, "--disclosure", "n_port()"],
    ):
        assert main(command) == 3
        assert "n_port counts in steps of a month, and the steps here are weeks" in capsys.readouterr().err


def test_schedules_side_by_side() -> None:
    chain = resting_chain(ins.Prior(np.eye(2), [0.5, 0.5]), 0.8)
    book = ins.Mechanism(np.eye(2), [0, 1], np.eye(2), 1 - np.eye(2))
    table = under_disclosures(chain, book, ["exact", "every(3)", "every(3)|delayed(2)"], 24, rng=RNG, n_draws=50)
    flips = [0.5 * (1 - 0.8**age) for age in range(5)]
    for text, ages in {"exact": [0], "every(3)": [0, 1, 2], "every(3)|delayed(2)": [2, 3, 4]}.items():
        expected = np.sqrt(np.mean([2 * flips[age] * (1 - flips[age]) for age in ages]))
        row = table.of(text)
        assert row.error == pytest.approx(expected, abs=5 * row.error_se + 1e-9)
        # The first decision tells one bit, each further one whether the belief has flipped since the last.
        flip, count = flips[len(ages)], 24 // len(ages)
        told = 1.0 - (count - 1) * (flip * np.log2(flip) + (1 - flip) * np.log2(1 - flip))
        assert row.total == pytest.approx(told, abs=5 * row.total_se + 1e-9)
    assert table.prior_error == pytest.approx(np.sqrt(0.5))
    for wrong, said in ((["every(20)"], "steps"), (["exact", "exact"], "different"), ([], "one at least")):
        with pytest.raises(InputError, match=said):
            under_disclosures(chain, book, wrong, 24, rng=RNG)
    with pytest.raises(InputError, match="no row"):
        table.of("every(2)")


def test_the_verb_writes_a_table_and_a_picture(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    asked = ["disclose", "--market", "paper", "--resolution", "3", "--draws", "10", "--steps", "8", "--out", str(out)]
    assert main([*asked, "--disclosures", "exact; every(2)|delayed(1)"]) == 0
    said = capsys.readouterr().out
    assert "every(2)|delayed(1)" in said
    assert "in 8 steps" in said
    assert list(pd.read_csv(out / "disclosures.csv")["disclosure"]) == ["exact", "every(2)|delayed(1)"]
    assert {"disclosures.csv", "disclosures.png", "disclosures.svg", "summary.json"} <= {
        each.name for each in out.iterdir()
    }
    assert main([*asked, "--disclosures", "sometimes()"]) == 3


@pytest.mark.parametrize(("n_late", "named"), [(5, ""), (6, "exact"), (7, "delayed(7) and exact")])
def test_the_picture_names_the_schedules_without_a_curve(n_late: int, named: str, tmp_path: Any) -> None:
    asked = [
        "disclose",
        "--market",
        "paper",
        "--resolution",
        "3",
        "--draws",
        "10",
        "--steps",
        "16",
        "--out",
        str(tmp_path),
    ]
    shown = ["exact", *(f"delayed({late})" for late in range(1, n_late + 1))]
    assert main([*asked, "--disclosures", ";".join(shown)]) == 0
    told = re.findall("<!-- not drawn: (.*) -->", (tmp_path / "disclosures.svg").read_text("utf-8"))
    assert told == ([named] if named else [])


@pytest.mark.usefixtures("coarse", "undrawn")
def test_the_verb_makes_the_sequential_rule_for_each_schedule(
    tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    asked = ["disclose", "--market", "paper", "--resolution", "3", "--draws", "10", "--steps", "8", "--out", str(out)]
    assert main([*asked, "--rule", "sequential", "--disclosures", "exact; every(2)"]) == 0
    assert "decisions are made for each" in capsys.readouterr().out
    exact, quarterly = pd.read_csv(out / "disclosures.csv").error
    assert quarterly > exact > 0.0


def test_every_schedule_has_the_regret_of_its_own_rule(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """Two of three decisions are optimal ones: silence costs a third of what it costs where all are shown."""
    market = ["--market", "paper", "--resolution", "3", "--draws", "10", "--steps", "8", "--out", str(tmp_path)]
    assert main(["disclose", *market, "--rule", "sequential", "--disclosures", "every(2);every(3)"]) == 0
    half, third = pd.read_csv(tmp_path / "disclosures.csv").expected_regret
    assert half > 0.0
    assert third == pytest.approx(2.0 / 3.0 * half, rel=1e-9)
    assert f"at an expected regret of {third:.3g} to {half:.3g}" in capsys.readouterr().out
    assert main(["disclose", *market, "--rule", "rate-distortion", "--disclosures", "every(2);every(3)"]) == 0
    same = pd.read_csv(tmp_path / "disclosures.csv").expected_regret
    assert same.tolist() == pytest.approx([half, half], rel=1e-6)
    assert f"at an expected regret of {half:.3g}." in capsys.readouterr().out


def test_a_rule_that_draws_one_of_two_prices_is_read_as_the_mean_over_the_draw() -> None:
    """The price is public: squares of errors, bits and regrets are means over it."""
    chain = resting_chain(ins.uniform_prior(2, 4), 0.8)

    def rule(shown: Disclosure, prices: ins.PriceCalibration) -> ins.SequentialDecisionMaker:
        problem, budget = ins.FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), ins.Budget.regret(0.1)
        made: dict[str, Any] = {"chain": chain, "disclosure": shown, "calibration": prices, "rng": RNG}
        return ins.SequentialDecisionMaker(problem, budget, **made)

    def read(*prices: float, **more: Any) -> DisclosureTable:
        shares = [0.25, 0.75][: len(prices)] if len(prices) > 1 else [1.0]
        given = ins.PriceCalibration(np.array(prices), np.inf, np.array(shares), **more)
        asked = ["exact", "every(2)|delayed(1)"]
        return under_disclosures(
            chain, lambda shown: rule(shown, given), asked, 6, rng=np.random.default_rng(SEED), n_draws=10
        )

    cheap, dear, drawn = read(2.0), read(9.0), read(2.0, 9.0, regret=0.1)
    for low, high, both in zip(cheap.rows, dear.rows, drawn.rows, strict=True):
        assert both.error**2 == pytest.approx(0.25 * low.error**2 + 0.75 * high.error**2, rel=1e-12)
        for name in ("bits", "total"):
            mean = 0.25 * getattr(low, name) + 0.75 * getattr(high, name)
            assert getattr(both, name) == pytest.approx(mean, rel=1e-12)
        assert low.error > high.error
        assert both.regret == 0.1
        assert np.isnan(low.regret)


def test_errors_that_differ_by_noise_alone_are_no_ranking() -> None:
    def said(*errors: tuple[float, float], is_shared: bool = False) -> str:
        """The sentence on errors with standard errors, whose paths differ from row to row by independent noise, or alike."""
        noise = np.zeros((len(errors), 8)) + hadamard(8)[1] if is_shared else hadamard(8)[1 : 1 + len(errors)]
        paths = [each**2 + 2.0 * each * se * np.sqrt(7.0) * z for (each, se), z in zip(errors, noise, strict=True)]
        rows = [
            DisclosureRow(f"every({k})", 0.1, 0.01, *each, np.array([each[0]]), squared, 1.0, 0.1, 0.0)
            for k, (each, squared) in enumerate(zip(errors, paths, strict=True))
        ]
        return DisclosureTable(tuple(rows), 0.5, 1, 3).summary()

    assert "errs alike with each, by 0.346 (69% of 0.500" in said((0.346, 0.0), (0.346 + 1e-16, 0.0), (0.346, 0.0))
    assert "errs alike with each" in said((0.316, 0.002), (0.315, 0.002))
    told = said((0.316, 0.002), (0.2, 0.01), (0.314, 0.002), (0.21, 0.01))
    assert "errs least with every(1) or every(3), by 0.200" in told
    assert "most with every(0) or every(2), by 0.316" in told
    between = said((0.3, 0.01), (0.32, 0.01), (0.34, 0.01))  # the second differs from neither of the others
    assert "errs least with every(0), by 0.300" in between
    assert "most with every(2), by 0.340" in between
    together = said((0.3, 0.02), (0.32, 0.02), is_shared=True)
    assert "errs least with every(0), by 0.300" in together
    assert "most with every(1), by 0.320" in together
    assert "errs by 0.316 (63% of 0.500" in said((0.316, 0.002))


@pytest.mark.usefixtures("undrawn")
def test_no_schedule_is_named_for_both_ends(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["disclose", "--market", "paper", "--resolution", "8", "--rule", "rate-distortion", "--draws", "20"]
    for shown in (["exact"], ["exact", "delayed(1)", "every(3)"]):
        assert main([*asked, "--disclosures", ";".join(shown), "--out", str(tmp_path)]) == 0
        sentence = capsys.readouterr().out.split("In short: ")[1]
        assert all(sentence.count(each) <= 1 for each in shown)


def test_errors_of_schedules_are_means_over_the_same_paths() -> None:
    """The stated standard errors, of errors and of their differences, are the spread over simulations."""
    chain = resting_chain(ins.uniform_prior(2, 3), 0.9)
    table = [[0.6, 0.4, 0.0], [0.5, 0.4, 0.1], [0.1, 0.4, 0.5], [0.0, 0.4, 0.6]]
    played = ins.Mechanism(chain.prior.beliefs, [0, 1, 2], table, np.zeros((4, 3)))
    asked, rng = ["exact", "delayed(1)"], np.random.default_rng([SEED, 8])
    runs = [under_disclosures(chain, played, asked, 12, rng=rng, n_draws=50).rows for _ in range(40)]
    errors = np.array([[row.error for row in rows] for rows in runs])
    stated = np.mean([[row.error_se for row in rows] for rows in runs], axis=0)
    np.testing.assert_allclose(errors.std(axis=0, ddof=1) / stated, 1.0, atol=0.5)
    influences = [np.subtract(*(row.squared / (2.0 * row.error) for row in rows)) for rows in runs]
    apart = np.mean([each.std(ddof=1) / np.sqrt(len(each)) for each in influences])
    assert np.diff(errors).std(ddof=1) / apart == pytest.approx(1.0, abs=0.5)
    assert apart < 0.7 * np.hypot(*stated)
