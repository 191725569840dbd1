"""What decisions on a belief that moves give away, against every path of states, reports, beliefs and decisions."""

from __future__ import annotations

from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest

from inscrutable import (
    CategoricalEmission,
    GaussianEmission,
    HiddenMarkovModel,
    InputError,
    MarkowitzProblem,
    Mechanism,
    OriginalDecisionMaker,
    PathLeakage,
    leakage,
    mechanism,
    path_leakage,
    reachable_beliefs,
    repeated_leakage,
    simplex_grid,
)
from inscrutable.mechanisms.chains import BeliefChain, filtered_chain, resting_chain
from strategies import uneven_chain

WORLD = HiddenMarkovModel([[0.9, 0.1], [0.25, 0.75]], CategoricalEmission([[0.8, 0.2], [0.3, 0.7]]))
N_STEPS = 3


def some_mechanism(beliefs: np.ndarray, n_actions: int = 3, seed: int = 1, *, mixed: bool = True) -> Mechanism:
    rng = np.random.default_rng(seed)
    table = rng.dirichlet(np.full(n_actions, 0.5), size=len(beliefs))
    if not mixed:
        table = np.eye(n_actions)[table.argmax(axis=1)]
    return Mechanism(beliefs, rng.normal(size=(n_actions, 2)), table, np.zeros_like(table))


def paths_of_world(world: HiddenMarkovModel, beliefs: np.ndarray) -> Any:
    """Every path of states and reports: its probability, its states, and the places of the agent's beliefs."""
    reports, n_symbols = world.emission.probabilities, world.emission.n_symbols
    for states in product(range(world.n_states), repeat=N_STEPS):
        for seen in product(range(n_symbols), repeat=N_STEPS):
            chance, law, places = 1.0, world.initial, []
            for t in range(N_STEPS):
                chance *= world.initial[states[0]] if t == 0 else world.transition[states[t - 1], states[t]]
                chance *= reports[states[t], seen[t]]
                law = (law if t == 0 else law @ world.transition) * reports[:, seen[t]]
                law = law / law.sum()
                places.append(int(np.linalg.norm(beliefs - law, axis=1).argmin()))
                assert np.linalg.norm(beliefs[places[-1]] - law) < 1e-9
            yield float(chance), states, tuple(places)


def paths_of_chain(chain: BeliefChain) -> Any:
    """The same of a chain, where the state is one drawn from the belief."""
    transition = chain.transition.toarray()
    for places in product(range(len(chain.prior)), repeat=N_STEPS):
        chance = chain.prior.weights[places[0]]
        for before, after in pairwise(places):
            chance *= transition[before, after]
        for state, share in enumerate(chain.prior.beliefs[places[-1]]):
            yield float(chance * share), (state,) * N_STEPS, places


def information(joint: dict[tuple[Any, Any], float]) -> float:
    """I(a;b) of a joint law by (a, b), in bits."""
    left: dict[Any, float] = {}
    right: dict[Any, float] = {}
    for (a, b), chance in joint.items():
        left[a] = left.get(a, 0.0) + chance
        right[b] = right.get(b, 0.0) + chance
    return sum(p * np.log2(p / (left[a] * right[b])) for (a, b), p in joint.items() if p > 0)


def enumerated(paths: list[Any], played: Mechanism, t: int) -> tuple[float, float, float, float]:
    """Information of all beliefs, of the present one and of the state after step t, and the error."""
    whole: dict[Any, float] = {}
    present: dict[Any, float] = {}
    state: dict[Any, float] = {}
    for chance, states, places in paths:
        for actions in product(range(len(played.actions)), repeat=t + 1):
            weight = chance
            for place, action in zip(places, actions, strict=False):
                weight *= played.probabilities[place, action]
            for table, key in ((whole, places[: t + 1]), (present, places[t]), (state, states[t])):
                table[key, actions] = table.get((key, actions), 0.0) + weight
    squared = 0.0
    for actions in {each[1] for each in present}:
        held = [(place, chance) for (place, seen), chance in present.items() if seen == actions]
        total = sum(chance for _, chance in held)
        if total > 0:
            mean = sum(chance * played.beliefs[place] for place, chance in held) / total
            squared += sum(chance * float(((played.beliefs[place] - mean) ** 2).sum()) for place, chance in held)
    return information(whole), information(present), information(state), float(np.sqrt(squared))


def check(found: PathLeakage, paths: list[Any], played: Mechanism, last_state_only: bool) -> None:
    wanted = np.array([enumerated(paths, played, t) for t in range(N_STEPS)])
    pairs = [
        (found.cumulative, found.cumulative_se, wanted[:, 0]),
        (found.added, found.added_se, np.diff(wanted[:, 0], prepend=0.0)),
        (found.belief_information, found.belief_information_se, wanted[:, 1]),
        (found.state_information, found.state_information_se, wanted[:, 2]),
        (found.bayes_error, found.error_se, wanted[:, 3]),
    ]
    for number, (values, errors, exact) in enumerate(pairs):
        steps = slice(N_STEPS - 1, None) if number == 3 and last_state_only else slice(None)
        assert (np.abs(values - exact)[steps] <= 4.5 * errors[steps] + 1e-9).all()
        assert errors.max() < 0.05


@pytest.mark.parametrize("mixed", [True, False])
def test_a_world_by_every_path(mixed: bool) -> None:
    played = some_mechanism(reachable_beliefs(WORLD, N_STEPS), mixed=mixed)
    found = path_leakage(WORLD, played, N_STEPS, rng=np.random.default_rng(0), n_draws=2000)
    assert found.interpolation_error < 1e-9
    check(found, list(paths_of_world(WORLD, played.beliefs)), played, last_state_only=False)
    for t in range(N_STEPS):  # without a decision
        held: dict[int, float] = {}
        for chance, _, places in paths_of_world(WORLD, played.beliefs):
            held[places[t]] = held.get(places[t], 0.0) + chance
        mean = sum(chance * played.beliefs[b] for b, chance in held.items())
        error = sum(chance * float(((played.beliefs[b] - mean) ** 2).sum()) for b, chance in held.items())
        assert found.prior_error[t] == pytest.approx(np.sqrt(error), abs=1e-9)


@pytest.mark.parametrize("mixed", [True, False])
def test_a_chain_by_every_path(mixed: bool) -> None:
    chain = uneven_chain()
    played = some_mechanism(chain.prior.beliefs, 2, mixed=mixed)
    found = path_leakage(chain, played, N_STEPS, rng=np.random.default_rng(0), n_draws=4000)
    check(found, list(paths_of_chain(chain)), played, last_state_only=True)
    np.testing.assert_allclose(found.prior_error, chain.prior.error)


def test_a_belief_that_rests_is_that_of_repeated_decisions() -> None:
    chain = resting_chain(uneven_chain().prior, 1.0)
    played = some_mechanism(chain.prior.beliefs)
    found = path_leakage(chain, played, 8, rng=np.random.default_rng(0), n_draws=3000)
    again = repeated_leakage(played, chain.prior, (1, 4, 8), rng=np.random.default_rng(1), n_draws=3000)
    for s, n in enumerate((1, 4, 8)):
        apart = abs(found.belief_information[n - 1] - again.mutual_information[s])
        assert apart <= 4.5 * (found.belief_information_se[n - 1] + again.information_se[s]) + 1e-12
        # One belief for ever: all beliefs are the present one.
        allowed = 4.5 * (found.cumulative_se[n - 1] + again.information_se[s]) + 1e-12
        assert abs(found.cumulative[n - 1] - again.mutual_information[s]) <= allowed
        allowed = 4.5 * (found.error_se[n - 1] + again.error_se[s]) + 1e-12
        assert abs(found.bayes_error[n - 1] - again.bayes_error[s]) <= allowed


def test_the_first_step_is_one_decision_and_silence_tells_nothing() -> None:
    chain = uneven_chain()
    played = some_mechanism(chain.prior.beliefs)
    told = leakage(played, chain.prior)
    found = path_leakage(chain, played, 1, rng=np.random.default_rng(0), n_draws=4000)
    assert found.n_draws == 0
    assert found.cumulative[0] == pytest.approx(told.mutual_information, abs=1e-12)
    assert found.bayes_error[0] == pytest.approx(told.bayes_error, abs=1e-12)
    silent = Mechanism(played.beliefs, [[0.0, 1.0]], np.ones((3, 1)), np.zeros((3, 1)))
    nothing = path_leakage(chain, silent, 4, rng=np.random.default_rng(0), n_draws=10)
    for values in (nothing.added, nothing.cumulative, nothing.belief_information, nothing.state_information):
        np.testing.assert_allclose(values, 0.0, atol=1e-12)
    np.testing.assert_allclose(nothing.bayes_error, nothing.prior_error)
    quiet = Mechanism(reachable_beliefs(WORLD, 3), [[0.0, 1.0]], np.ones((14, 1)), np.zeros((14, 1)))
    still = path_leakage(WORLD, quiet, 3, rng=np.random.default_rng(0), n_draws=10)
    np.testing.assert_allclose(still.cumulative, 0.0, atol=1e-12)
    np.testing.assert_allclose(still.bayes_error, still.prior_error)


def test_a_coarse_grid_states_its_error_and_a_chain_takes_any_sensor() -> None:
    grid = simplex_grid(2, 6)
    coarse = path_leakage(WORLD, some_mechanism(grid), 5, rng=np.random.default_rng(0), n_draws=20)
    assert coarse.interpolation_error > 1e-3
    assert "interpolation error" in coarse.summary()
    assert np.isfinite(coarse.cumulative).all()
    real = HiddenMarkovModel(WORLD.transition, GaussianEmission([[0.0], [1.0]], [[[1.0]], [[1.0]]]))
    chain = filtered_chain(real, 8, rng=np.random.default_rng(0), n_steps=3000)
    found = path_leakage(chain, some_mechanism(chain.prior.beliefs), 4, rng=np.random.default_rng(0), n_draws=20)
    assert (found.bayes_error <= found.prior_error + 4.5 * found.error_se).all()
    assert len(found) == 4
    assert "after    4" in found.summary()
    with pytest.raises(InputError, match="BeliefChain"):
        path_leakage(real, some_mechanism(grid), 3, rng=np.random.default_rng(0))


def test_a_decision_that_no_belief_of_the_grid_plays_leaves_the_bits_finite(fresh_rng) -> None:
    """Every belief plays a decision of its own; no more is known than which of the grid's it is."""
    for seed in (0, int(fresh_rng.integers(2**32))):  # the first had inf ± nan bits
        rng = np.random.default_rng(seed)
        moves = 0.9 * np.eye(3) + 0.1 * rng.dirichlet(np.ones(3), size=3)
        world = HiddenMarkovModel(moves, CategoricalEmission(rng.dirichlet(np.ones(3), size=3)))
        problem = MarkowitzProblem(rng.normal(0, 0.3, (3, 4)), [np.eye(4)] * 3, 1.0)
        beliefs = simplex_grid(3, 8)
        played = mechanism(OriginalDecisionMaker(problem), beliefs)
        found = path_leakage(world, played, 6, rng=np.random.default_rng(seed), n_draws=200)
        for bits, deviation in (
            (found.belief_information, found.belief_information_se),
            (found.state_information, found.state_information_se),
        ):
            assert np.isfinite(deviation).all()
            assert ((bits >= 0) & (bits <= np.log2(len(beliefs)))).all()


def test_the_same_seed_gives_the_same_figures_and_they_are_saved(tmp_path: Any) -> None:
    chain = uneven_chain()
    played = some_mechanism(chain.prior.beliefs)
    one, other = (path_leakage(chain, played, 3, rng=np.random.default_rng(5), n_draws=20) for _ in range(2))
    np.testing.assert_array_equal(one.cumulative, other.cumulative)
    one.save(tmp_path / "found.npz")
    again = PathLeakage.load(tmp_path / "found.npz")
    np.testing.assert_array_equal(again.bayes_error, one.bayes_error)


def test_malformed_arguments_are_refused() -> None:
    chain, rng = uneven_chain(), np.random.default_rng(0)
    played = some_mechanism(chain.prior.beliefs)
    with pytest.raises(InputError, match="n_steps"):
        path_leakage(chain, played, 0, rng=rng)
    with pytest.raises(InputError, match="n_draws"):
        path_leakage(chain, played, 2, rng=rng, n_draws=1)
    with pytest.raises(InputError, match="rng"):
        path_leakage(chain, played, 2, rng=0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="on the beliefs of the chain"):
        path_leakage(chain, some_mechanism(simplex_grid(3, 2)), 2, rng=rng)
    with pytest.raises(InputError, match="expected a Mechanism"):
        path_leakage(chain, None, 2, rng=rng)  # type: ignore[arg-type]
