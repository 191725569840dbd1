"""Mechanisms with a memory, and rules that make a mechanism of a law, against every path of states, reports and memories."""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest

from inscrutable import (
    CategoricalEmission,
    CoinDecisionMaker,
    FiniteProblem,
    HiddenMarkovModel,
    InputError,
    KeptDecisionMaker,
    MarkowitzProblem,
    Mechanism,
    MemoryMechanism,
    PartialDecisionMaker,
    Prior,
    SequenceStatus,
    SequentialAdversary,
    leakage,
    mechanism,
    path_leakage,
    reachable_beliefs,
    simplex_grid,
)
from inscrutable.mechanisms.chains import BeliefChain, resting_chain
from oracles.chain_paths import every_path
from sizes import audited, instances, some
from strategies import random_world

EXACT = 1e-11


def random_chain(rng: np.random.Generator, n_beliefs: int) -> BeliefChain:
    transition = rng.dirichlet(np.ones(n_beliefs), n_beliefs)
    weights = np.linalg.matrix_power(transition, 4000)[0]
    return BeliefChain(Prior(rng.dirichlet(np.ones(3), n_beliefs), weights / weights.sum()), transition)


def random_memory(
    rng: np.random.Generator, beliefs: np.ndarray, n_actions: int, n_memories: int, *, is_public: bool = False
) -> MemoryMechanism:
    """Half of the entries are 0, so that decisions rule out beliefs and memories."""
    table = rng.dirichlet(np.full(n_actions * n_memories, 0.5), (len(beliefs), n_memories))
    table[rng.random(table.shape) < 0.4] = 0.0
    table[..., 0] += 1e-3
    table /= table.sum(axis=-1, keepdims=True)
    shape = (len(beliefs), n_memories, n_actions, n_memories)
    costs = np.zeros((len(beliefs), n_actions))
    initial = rng.dirichlet(np.ones(n_memories))
    return MemoryMechanism(
        beliefs, rng.normal(size=(n_actions, 2)), table.reshape(shape), initial, costs, is_public=is_public
    )


def paths_of_world(world: HiddenMarkovModel, beliefs: np.ndarray, n_steps: int) -> Any:
    """Every path of states and reports: its probability, states, and places of the agent's beliefs."""
    for states in product(range(world.n_states), repeat=n_steps):
        for reports in product(range(world.emission.n_symbols), repeat=n_steps):
            chance, law, places = 1.0, world.initial, []
            for t, (x, y) in enumerate(zip(states, reports, strict=True)):
                chance *= (world.initial[x] if t == 0 else world.transition[states[t - 1], x]) * float(
                    world.emission.probabilities[x, y]
                )
                law = (law if t == 0 else law @ world.transition) * world.emission.probabilities[:, y]
                law = law / law.sum()
                places.append(int(np.abs(beliefs - law).max(axis=1).argmin()))
                assert np.abs(beliefs[places[-1]] - law).max() < 1e-9
            yield chance, states, tuple(places)


def paths_of_chain(chain: BeliefChain, n_steps: int) -> Any:
    for places, chance in every_path(chain, n_steps):
        yield chance, (0,) * n_steps, tuple(places)


def dense(plays: MemoryMechanism) -> np.ndarray:
    shape = (len(plays.beliefs), plays.n_memories, len(plays.actions), plays.n_memories)
    return np.asarray(plays.probabilities.toarray().reshape(shape))


def expected_beliefs(
    paths: Any, plays: MemoryMechanism, columns: list[int], told: list[int] | None, *, smoothed: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Laws of belief (T,B) and state (T,X), and the probability of what was seen up to each step, path by path."""
    table, n_steps, paths = dense(plays), len(columns), list(paths)
    weights = np.zeros((n_steps, len(plays.beliefs)))
    states = np.zeros((n_steps, 1 + max(max(each[1]) for each in paths)))
    chances = np.zeros(n_steps)
    for chance, state, places in paths:
        for memory in product(range(plays.n_memories), repeat=n_steps + 1):
            if told is not None and list(memory) != told:
                continue
            shares = [table[places[t], memory[t], columns[t], memory[t + 1]] for t in range(n_steps)]
            start = chance * (1.0 if told is not None else plays.initial[memory[0]])
            whole = start * np.prod(shares)
            for t in range(n_steps):
                if smoothed:
                    weights[t, places[t]] += whole
                    states[t, state[t]] += whole
    for t in range(n_steps):
        seen: dict[Any, float] = defaultdict(float)
        for chance, state, places in paths:
            seen[state[: t + 1], places[: t + 1]] += chance
        for (state, places), chance in seen.items():
            for memory in product(range(plays.n_memories), repeat=t + 2):
                if told is not None and list(memory) != told[: t + 2]:
                    continue
                shares = [table[places[s], memory[s], columns[s], memory[s + 1]] for s in range(t + 1)]
                whole = chance * np.prod(shares) * (1.0 if told is not None else plays.initial[memory[0]])
                chances[t] += whole
                if not smoothed:
                    weights[t, places[t]] += whole
                    states[t, state[t]] += whole
    return weights / weights.sum(axis=1, keepdims=True), states / states.sum(axis=1, keepdims=True), chances


def played_along(rng: np.random.Generator, plays: MemoryMechanism, places: list[int]) -> tuple[list[int], list[int]]:
    """Decisions and memories drawn along a path of beliefs."""
    table, memory = dense(plays), [int(rng.choice(plays.n_memories, p=plays.initial))]
    columns = []
    for place in places:
        row = table[place, memory[-1]].reshape(-1)
        drawn = int(rng.choice(len(row), p=row))
        columns.append(drawn // plays.n_memories)
        memory.append(drawn % plays.n_memories)
    return columns, memory


@pytest.mark.parametrize("n_particles", [0, 16])
@pytest.mark.parametrize("is_public", [False, True])
def test_filter_and_smoother_equal_enumeration(
    is_public: bool, n_particles: int, fresh_rng: np.random.Generator
) -> None:
    for _ in range(instances(3, least=1)):
        world = random_world(fresh_rng, 2, 2)
        beliefs = reachable_beliefs(world, 3)
        plays = random_memory(fresh_rng, beliefs, 2, 3, is_public=is_public)
        options: dict[str, Any] = {"n_particles": n_particles, "rng": fresh_rng} if n_particles else {}
        adversary = SequentialAdversary(world, plays, **options)
        paths = list(paths_of_world(world, beliefs, 3))
        _, _, places = paths[int(fresh_rng.choice(len(paths), p=[each[0] for each in paths]))]
        columns, memory = played_along(fresh_rng, plays, list(places))
        told = memory if is_public else None
        for smoothed in (False, True):
            found = (adversary.smooth if smoothed else adversary.filter)(plays.actions[columns], memories=told)
            weights, states, chances = expected_beliefs(paths, plays, columns, told, smoothed=smoothed)
            np.testing.assert_allclose(found.weights, weights, atol=EXACT)
            np.testing.assert_allclose(found.states, states, atol=EXACT)
            np.testing.assert_allclose(np.exp(found.log_likelihood.cumsum()), chances, rtol=1e-9)
            assert set(found.statuses) == {SequenceStatus.USED}


@pytest.mark.parametrize("is_public", [False, True])
def test_a_chain_of_beliefs_is_a_world_too(is_public: bool, fresh_rng: np.random.Generator) -> None:
    chain = random_chain(fresh_rng, 3)
    plays = random_memory(fresh_rng, chain.prior.beliefs, 2, 2, is_public=is_public)
    columns, memory = played_along(fresh_rng, plays, list(chain.paths(3, 1, rng=fresh_rng)[:, 0]))
    adversary, told = SequentialAdversary(chain, plays), memory if is_public else None
    for smoothed in (False, True):
        found = (adversary.smooth if smoothed else adversary.filter)(plays.actions[columns], memories=told)
        weights, _, chances = expected_beliefs(paths_of_chain(chain, 3), plays, columns, told, smoothed=smoothed)
        np.testing.assert_allclose(found.weights, weights, atol=EXACT)
        np.testing.assert_allclose(found.states, weights @ chain.prior.beliefs, atol=EXACT)
        np.testing.assert_allclose(np.exp(found.log_likelihood.cumsum()), chances, rtol=1e-9)
    for options in ({"n_particles": 5, "rng": fresh_rng}, {"sensor": CategoricalEmission(np.eye(3))}):
        with pytest.raises(InputError, match="no states"):
            SequentialAdversary(chain, plays, **options)
    with pytest.raises(InputError, match="no states"):
        adversary.filter(plays.actions[columns], states=[0, 0, 0], memories=told)


@pytest.mark.parametrize("n_particles", [0, 16])
def test_what_was_not_seen_or_cannot_be_moves_the_memory_all_the_same(
    n_particles: int, fresh_rng: np.random.Generator
) -> None:
    """A decision that was not seen is any; one that is never played is passed over in the same way."""
    world = random_world(fresh_rng, 2, 2)
    beliefs = reachable_beliefs(world, 3)
    plays = random_memory(fresh_rng, beliefs, 2, 2)
    options: dict[str, Any] = {"n_particles": n_particles, "rng": fresh_rng} if n_particles else {}
    adversary = SequentialAdversary(world, plays, **options)
    hidden = np.vstack([plays.actions[0], [np.nan, np.nan], plays.actions[0]])
    found = adversary.filter(hidden)
    wanted = np.zeros(len(beliefs))
    for middle in range(2):
        weights, _, chances = expected_beliefs(
            paths_of_world(world, beliefs, 3), plays, [0, middle, 0], None, smoothed=False
        )
        wanted += weights[2] * chances[2]
    np.testing.assert_allclose(found.weights[2], wanted / wanted.sum(), atol=EXACT)
    hidden[1] = 99.0
    stray = adversary.filter(hidden)
    assert stray.statuses[1] is SequenceStatus.NEVER_PLAYED
    np.testing.assert_allclose(stray.weights, found.weights, atol=EXACT)
    # A public memory that cannot follow: the decision is passed over, and the memory taken as told.
    still = MemoryMechanism(
        beliefs,
        [0],
        np.tile(np.eye(2)[:, None], (len(beliefs), 1, 1, 1)),
        [1.0, 0.0],
        np.zeros((len(beliefs), 1)),
        True,
    )
    told = SequentialAdversary(world, still, **options).filter([0, 0, 0], memories=[0, 0, 1, 1])
    assert [each.name for each in told.statuses] == ["USED", "CONTRADICTED", "USED"]
    np.testing.assert_allclose(told.mean, adversary.unseen(3).mean, atol=0.2 if n_particles else EXACT)


def test_a_mechanism_is_the_case_of_one_memory(fresh_rng: np.random.Generator) -> None:
    """Copies of a memory change nothing, on a grid that is too coarse for some decisions either."""
    world, grid = random_world(fresh_rng, 3, 3), simplex_grid(3, 4)
    shares = np.eye(6)[fresh_rng.integers(6, size=len(grid))]
    plain = Mechanism(grid, fresh_rng.normal(size=(6, 2)), shares, np.zeros_like(shares))
    split = fresh_rng.dirichlet(np.ones(2), (len(grid), 2))
    table = np.einsum("bu,bnm->bnum", shares, split)
    copied = MemoryMechanism(grid, plain.actions, table, [0.3, 0.7], plain.regrets)
    actions = plain.actions[fresh_rng.integers(6, size=12)]
    one, two = (SequentialAdversary(world, each) for each in (plain, copied))
    for ask in ("filter", "smooth"):
        found, again = (getattr(each, ask)(actions, nearest=True) for each in (one, two))
        assert found.statuses == again.statuses
        np.testing.assert_allclose(found.weights, again.weights, atol=1e-9)
        np.testing.assert_allclose(found.log_likelihood, again.log_likelihood, atol=1e-9)


def bits(joint: dict[tuple[Any, Any], float]) -> float:
    left: dict[Any, float] = defaultdict(float)
    right: dict[Any, float] = defaultdict(float)
    for (a, b), chance in joint.items():
        left[a] += chance
        right[b] += chance
    return sum(p * np.log2(p / left[a] / right[b]) for (a, b), p in joint.items() if p > 0)


def leaked(paths: list[Any], plays: MemoryMechanism, n_steps: int, is_public: bool) -> tuple[float, float, float]:
    """Information of all decisions on all beliefs and on the last, and the error after the last, path by path."""
    table = dense(plays)
    whole: dict[Any, float] = defaultdict(float)
    last: dict[Any, float] = defaultdict(float)
    for chance, _, places in paths:
        for memory in product(range(plays.n_memories), repeat=n_steps + 1):
            for columns in product(range(len(plays.actions)), repeat=n_steps):
                weight = chance * plays.initial[memory[0]]
                for t in range(n_steps):
                    weight *= table[places[t], memory[t], columns[t], memory[t + 1]]
                if weight > 0:
                    seen = (columns, memory) if is_public else columns
                    whole[places, seen] += weight
                    last[places[-1], seen] += weight
    squared = 0.0
    for seen in {each[1] for each in last}:
        law = np.array([last.get((b, seen), 0.0) for b in range(len(plays.beliefs))])
        mean = law @ plays.beliefs / law.sum()
        squared += float(law @ ((plays.beliefs - mean) ** 2).sum(axis=1))
    return bits(whole), bits(last), float(np.sqrt(squared))


@pytest.mark.parametrize("is_public", [False, True])
def test_what_paths_tell_equals_enumeration(is_public: bool, fresh_rng: np.random.Generator) -> None:
    chain, n_steps = random_chain(fresh_rng, 3), 3
    plays = random_memory(fresh_rng, chain.prior.beliefs, 2, 2, is_public=is_public)
    found = path_leakage(chain, plays, n_steps, rng=fresh_rng, n_draws=4000)
    assert (found.n_draws == 0) == is_public  # where the memory is known, every sequence is followed
    wanted = leaked(list(paths_of_chain(chain, n_steps)), plays, n_steps, is_public)
    values = found.cumulative[-1], found.belief_information[-1], found.bayes_error[-1]
    errors = found.cumulative_se[-1], found.belief_information_se[-1], found.error_se[-1]
    for value, error, exact in zip(values, errors, wanted, strict=True):
        assert value == pytest.approx(exact, abs=4.5 * error + 1e-9)
        assert error < 0.03


@pytest.mark.parametrize("is_public", some([False, True], 2))
def test_sampled_paths_agree_with_all_of_them(is_public: bool, fresh_rng: np.random.Generator) -> None:
    chain, n_steps = random_chain(fresh_rng, 4), (7 if is_public else 6) if audited() else 5
    n_actions, n_memories = (2, 2) if is_public else (5, 1)
    runs: list[Any] = []
    while not any(run.n_draws for run in runs):  # few paths are enumerated
        plays = random_memory(fresh_rng, chain.prior.beliefs, n_actions, n_memories, is_public=is_public)
        exact = path_leakage(chain, plays, n_steps, rng=fresh_rng, n_draws=100_000)
        # Events of .1 % are in few of 500 paths, which one instance missed by 9 standard errors; more at once may be
        # enumerated.
        runs = [path_leakage(chain, plays, n_steps, rng=fresh_rng, n_draws=500) for _ in range(8)]
    assert {exact.n_draws} | {run.n_draws for run in runs} == {0, 500}
    for name, error in (
        ("cumulative", "cumulative_se"),
        ("added", "added_se"),
        ("belief_information", "belief_information_se"),
        ("state_information", "state_information_se"),
        ("bayes_error", "error_se"),
    ):
        gap = np.abs(np.mean([getattr(run, name) for run in runs], axis=0) - getattr(exact, name))
        spread = np.sqrt(np.mean([getattr(run, error) ** 2 for run in runs], axis=0) / len(runs))
        assert (gap <= 4.5 * spread + 1e-9).all(), name


class Hedging:
    """Plays the first decision by the observer's mean, the agent's belief, and the decision before."""

    def __init__(self, beliefs: np.ndarray) -> None:
        self.beliefs = beliefs

    def mechanism_for(self, law: Prior, before: Any = None) -> Mechanism:
        first = 0.4 * law.mean[0] + 0.4 * law.beliefs[:, 0] + 0.2 * (0.5 if before is None else before)
        table = np.column_stack([first, 1.0 - first])
        return Mechanism(law.beliefs, np.array([0, 1]), table, np.zeros_like(table))


def test_a_rule_goes_by_what_decisions_alone_tell(fresh_rng: np.random.Generator) -> None:
    world = random_world(fresh_rng, 2, 2)
    beliefs, actions = reachable_beliefs(world, 3), [0, 1, 0]
    rule, paths = Hedging(beliefs), list(paths_of_world(world, beliefs, 3))
    # The mechanisms of the three steps, one after the other.
    tables: list[np.ndarray] = []
    for t in range(3):
        law = np.zeros(len(beliefs))
        for chance, _, places in paths:
            law[places[t]] += chance * np.prod([tables[s][places[s], actions[s]] for s in range(t)])
        before = actions[t - 1] if t else None
        tables.append(rule.mechanism_for(Prior(beliefs, law / law.sum()), before).probabilities)

    def told(keep: Any, likelihood: Any = lambda states: 1.0) -> np.ndarray:
        law = np.zeros(len(beliefs))
        for chance, states, places in paths:
            if keep(states):
                weight = chance * np.prod([tables[s][places[s], actions[s]] for s in range(3)])
                law[places[2]] += weight * likelihood(states)
        return np.asarray(law / law.sum())

    adversary = SequentialAdversary(world, rule)
    np.testing.assert_allclose(adversary.filter(actions).weights[2], told(lambda states: True), atol=EXACT)
    # One who knows more than the decisions still reads them by the mechanisms that they alone made.
    seen = adversary.filter(actions, states=[1, 0, 1])
    np.testing.assert_allclose(seen.weights[2], told(lambda states: states == (1, 0, 1)), atol=EXACT)
    particles = SequentialAdversary(world, rule, n_particles=20, rng=fresh_rng)
    np.testing.assert_allclose(particles.filter(actions).mean, adversary.filter(actions).mean, atol=EXACT)
    np.testing.assert_allclose(particles.smooth(actions).mean, adversary.smooth(actions).mean, atol=EXACT)
    other = random_world(fresh_rng, 2, 2)
    # Under another world an outsider reads the same mechanism, which the agent made in its own.
    apart = SequentialAdversary(other, rule, agent_world=world).filter(actions)
    first = Mechanism(beliefs, np.array([0, 1]), tables[0], np.zeros_like(tables[0]))
    alone = SequentialAdversary(other, first, agent_world=world).filter(actions[:1])
    np.testing.assert_allclose(apart.weights[0], alone.weights[0], atol=EXACT)
    assert adversary.unseen(3).mean.shape == (3, 2)
    with pytest.raises(InputError, match="2 entries"):
        adversary.filter(np.zeros((3, 2)))


def test_a_rule_may_take_another_chain_for_true(fresh_rng: np.random.Generator) -> None:
    chain = random_chain(fresh_rng, 3)
    rule, still, actions = Hedging(chain.prior.beliefs), resting_chain(chain.prior, 1.0), [0, 1, 1, 0]
    found = SequentialAdversary(still, rule, agent_world=chain).filter(actions)
    law, public, before = chain.prior.weights, chain.prior.weights, None
    for t, u in enumerate(actions):
        shares = rule.mechanism_for(Prior(rule.beliefs, public), before).probabilities[:, u]
        law, public, before = law * shares / (law @ shares), public * shares / (public @ shares), u
        np.testing.assert_allclose(found.weights[t], law, atol=EXACT)
        public = public @ chain.transition.toarray()
    with pytest.raises(InputError, match="agent_world must be a BeliefChain"):
        SequentialAdversary(chain, rule, agent_world=random_world(fresh_rng, 3, 2))


def test_what_a_rule_tells_along_paths_equals_enumeration(fresh_rng: np.random.Generator) -> None:
    chain, n_steps = random_chain(fresh_rng, 3), 3
    rule, transition = Hedging(chain.prior.beliefs), chain.transition.toarray()
    wanted = 0.0

    def follow(law: np.ndarray, chance: float, step: int, before: int | None = None) -> None:
        nonlocal wanted
        table = rule.mechanism_for(Prior(rule.beliefs, law), before).probabilities
        played = law @ table
        wanted += chance * float((law[:, None] * table * np.log2(table / played)).sum())
        for u in range(2):
            if step + 1 < n_steps:
                follow((law * table[:, u] / played[u]) @ transition, chance * played[u], step + 1, u)

    follow(chain.prior.weights, 1.0, 0)
    found = path_leakage(chain, rule, n_steps, rng=fresh_rng)
    assert found.n_draws == 0
    assert found.cumulative[-1] == pytest.approx(wanted, abs=1e-9)
    again = path_leakage(chain, rule, 7, rng=fresh_rng, n_draws=100)
    exact = path_leakage(chain, rule, 7, rng=fresh_rng, n_draws=200)
    assert (again.n_draws, exact.n_draws) == (100, 0)
    assert (np.abs(again.bayes_error - exact.bayes_error) <= 4.5 * again.error_se + 1e-9).all()
    assert (np.abs(again.added - exact.added) <= 4.5 * again.added_se + 1e-9).all()


def test_kept_draws_tell_nothing_more_while_the_belief_stays() -> None:
    rng = np.random.default_rng(0)
    problem = MarkowitzProblem(np.eye(3), [np.eye(3)] * 3, 2.0)
    prior = Prior(simplex_grid(3, 3), np.full(10, 0.1))
    maker = CoinDecisionMaker(problem, 0.8, decoy=[0.2, 0.3, 0.5])
    kept = KeptDecisionMaker(maker)
    plays, drawn = kept.memory_mechanism(prior.beliefs), mechanism(maker, prior.beliefs)
    once = leakage(drawn, prior)
    found = path_leakage(resting_chain(prior, 1.0), plays, 40, rng=rng, n_draws=400)
    np.testing.assert_allclose(found.added[1:], 0.0, atol=1e-12)
    np.testing.assert_allclose(found.bayes_error, found.bayes_error[0])
    assert found.bayes_error[0] == pytest.approx(once.bayes_error, abs=4.5 * found.error_se[0])
    afresh = path_leakage(resting_chain(prior, 1.0), drawn, 40, rng=rng, n_draws=100)
    assert afresh.bayes_error[-1] < 0.5 * found.bayes_error[-1]
    # On a belief that moves a new draw tells that it moved.
    moving = path_leakage(resting_chain(prior, 0.8), plays, 4, rng=rng, n_draws=400)
    assert (moving.added[1:] > 0.01).all()
    assert kept.decide(prior.beliefs[3]).expected_regret == maker.decide(prior.beliefs[3]).expected_regret


def test_draws_of_a_maker_that_says_nothing_of_memory_are_kept() -> None:
    class Own:
        problem = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])
        decide_many = staticmethod(CoinDecisionMaker(problem, 0.4, decoy=[0.9, 0.1]).decide_many)

    kept = KeptDecisionMaker(Own())
    assert kept.decide([0.2, 0.8]).expected_regret == pytest.approx(0.4 * 0.6)
    Own.is_memoryless = False  # type: ignore[attr-defined]
    with pytest.raises(InputError, match="present belief alone"):
        KeptDecisionMaker(Own())


def test_kept_draws_by_every_path_of_beliefs_and_draws() -> None:
    """The rule as it is said: a new draw where the belief changed, the old decision where it did not."""
    rng = np.random.default_rng(1)
    chain = random_chain(rng, 3)
    coin = CoinDecisionMaker(
        FiniteProblem([[0.0, 1.0, 0.4], [1.0, 0.0, 0.4], [0.7, 0.2, 0.4]]), 0.4, decoy=[0.2, 0.3, 0.5]
    )
    kept, plain = KeptDecisionMaker(coin), mechanism(coin, chain.prior.beliefs)
    joint: dict[Any, float] = defaultdict(float)
    for chance, _, places in paths_of_chain(chain, 4):
        runs = [0, *np.cumsum([a != b for a, b in pairwise(places)])]
        starts = [places[runs.index(k)] for k in range(runs[-1] + 1)]
        for draws in product(range(len(plain.actions)), repeat=len(starts)):
            weight = chance * np.prod([plain.probabilities[b, u] for b, u in zip(starts, draws, strict=True)])
            joint[tuple(draws[k] for k in runs), places[-1]] += float(weight)
    adversary = SequentialAdversary(chain, kept.memory_mechanism(chain.prior.beliefs))
    for columns in {each[0] for each, weight in joint.items() if weight > 0}:
        law = np.array([joint[columns, b] for b in range(3)])
        found = adversary.filter(plain.actions[list(columns)])
        np.testing.assert_allclose(found.weights[-1], law / law.sum(), atol=EXACT)
        assert np.exp(found.log_likelihood.sum()) == pytest.approx(law.sum())
    path = chain.prior.beliefs[[0, 0, 1, 1, 1, 0]]
    drawn = np.array([kept.draw_path(path, rng=rng) for _ in range(400)])
    assert (drawn[:, 0] == drawn[:, 1]).all()
    assert (drawn[:, 2:5] == drawn[:, [2]]).all()
    shares = [(drawn[:, [0]] == plain.actions).mean(axis=0), (drawn[:, [2]] == plain.actions).mean(axis=0)]
    np.testing.assert_allclose(shares, plain.probabilities[:2], atol=0.12)


def test_partial_trades_between_finitely_many_holdings() -> None:
    rng = np.random.default_rng(2)
    problem = MarkowitzProblem([[0.3, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
    chain = random_chain(rng, 3)
    chain = BeliefChain(Prior(np.array([[0.9, 0.1], [0.5, 0.5], [0.1, 0.9]]), chain.prior.weights), chain.transition)
    holdings = np.column_stack([np.linspace(0, 1, 41), np.linspace(1, 0, 41)])
    rule = PartialDecisionMaker(problem, 0.4)
    plays = rule.memory_mechanism(chain.prior.beliefs, holdings)
    adversary = SequentialAdversary(chain, plays)
    optimal = problem.solve(chain.prior.beliefs)
    for places in product(range(3), repeat=3):
        held = [optimal[places[0]]]
        for place in places:
            aimed = 0.6 * held[-1] + 0.4 * optimal[place]
            held.append(holdings[np.abs(holdings - aimed).sum(axis=1).argmin()])
        found = adversary.filter(np.array(held[1:]))
        assert set(found.statuses) == {SequenceStatus.USED}
        assert found.weights[-1][places[-1]] > 0
    # In steps as fine as these the rule is the one without steps, to the rounding that adds up.
    exact = rule.decide_many(chain.prior.beliefs[[0, 2, 1]]).action
    aimed = [int(np.abs(holdings - each).sum(axis=1).argmin()) for each in exact]
    table, memory = dense(plays), 0
    for place, wanted in zip([0, 2, 1], aimed, strict=True):
        column, memory = (int(each) for each in np.argwhere(table[place, memory])[0])
        assert abs(column - wanted) <= 1
    # The decisions tell the memory, so every sequence is followed.
    assert path_leakage(chain, plays, 3, rng=rng).n_draws == 0
    started = PartialDecisionMaker(problem, 0.4, start=[0.0, 1.0]).memory_mechanism(chain.prior.beliefs, holdings)
    assert (started.probabilities != plays.probabilities).nnz > 0


def test_what_cannot_be_is_refused(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    beliefs = simplex_grid(2, 3)
    good = random_memory(rng, beliefs, 2, 3)
    table, costs = dense(good), good.regrets
    for changed, message in (
        ({"probabilities": table[:, :, :, :2]}, r"shape \(4, 3, 2, 3\)"),
        ({"probabilities": good.probabilities[:, :4]}, r"sparse probabilities of shape \(12, 6\)"),
        ({"probabilities": 1.1 * table}, "sums to 1.1"),
        ({"probabilities": -table}, "at least 0"),
        ({"initial": [0.5, 0.4, 0.0]}, "initial law of the memory sums to 0.9"),
        ({"regrets": costs - 1.0}, "regrets must be at least 0"),
        ({"beliefs": beliefs[:2]}, "need regrets of shape"),
    ):
        parts = {name: getattr(good, name) for name in ("beliefs", "actions", "initial", "regrets")}
        with pytest.raises(InputError, match=message):
            MemoryMechanism(**{**parts, "probabilities": table, **changed})
    good.save(tmp_path / "kept.npz")
    again = MemoryMechanism.load(tmp_path / "kept.npz")
    assert (again.probabilities != good.probabilities).nnz == 0
    assert "3 memories, private" in repr(again)
    world = random_world(rng, 2, 2)
    public = random_memory(rng, beliefs, 2, 3, is_public=True)
    with pytest.raises(InputError, match="memory is public"):
        SequentialAdversary(world, public).filter(public.actions)
    with pytest.raises(InputError, match="without the first one, has 3 entries"):
        SequentialAdversary(world, public).filter(public.actions, memories=[0, 1, 0, 2])
    with pytest.raises(InputError, match="memories have 3 in row 1"):
        SequentialAdversary(world, public).filter(public.actions, memories=[0, 3, 0])
    plain = Mechanism(beliefs, [0], np.ones((4, 1)), np.zeros((4, 1)))
    with pytest.raises(InputError, match="has none"):
        SequentialAdversary(world, plain).filter([0, 0], memories=[0, 0, 0])
    with pytest.raises(InputError, match="expected a Mechanism"):
        SequentialAdversary(world, object())  # type: ignore[arg-type]
    with pytest.raises(InputError, match="present belief alone"):
        KeptDecisionMaker(PartialDecisionMaker(MarkowitzProblem(np.eye(2), [np.eye(2)] * 2, 1.0), 0.5))
    wide = MarkowitzProblem(np.eye(2), [np.eye(2)] * 2, 1.0)
    monkeypatch.setattr("inscrutable.decision_makers.baselines.kept._MOST_ENTRIES", 2**10)
    with pytest.raises(InputError, match="take fewer beliefs"):
        KeptDecisionMaker(CoinDecisionMaker(wide, 0.5, decoy=[0.5, 0.5])).memory_mechanism(simplex_grid(2, 20))
