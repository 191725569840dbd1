"""The observer of a sequence of decisions, against enumeration of all paths of states and observations."""

from __future__ import annotations

from itertools import product

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    CategoricalEmission,
    GaussianEmission,
    HiddenMarkovModel,
    InputError,
    MarkowitzProblem,
    Mechanism,
    ModelError,
    OriginalDecisionMaker,
    SequenceStatus,
    SequentialAdversary,
    filter_beliefs,
    mechanism,
    reachable_beliefs,
    simplex_grid,
    uniform_prior,
)
from inscrutable.adversaries.inverse_filter import InverseFilter
from sizes import some
from strategies import random_world

EXACT = 1e-12


def random_mechanism(rng: np.random.Generator, beliefs: np.ndarray, n_actions: int, *, mixed: bool) -> Mechanism:
    if mixed:
        shares = rng.dirichlet(np.ones(n_actions), len(beliefs))
    else:
        shares = np.eye(n_actions)[np.arange(len(beliefs)) % n_actions]
    return Mechanism(beliefs, rng.normal(size=(n_actions, 2)), shares, np.zeros_like(shares))


def smallest_filter(world: HiddenMarkovModel, reports: tuple[int, ...]) -> np.ndarray:
    """The agent's beliefs after each report, by Bayes' rule as written."""
    law, held = world.initial, []
    for t, y in enumerate(reports):
        law = law if t == 0 else held[-1] @ world.transition
        law = law * world.emission.probabilities[:, y]
        held.append(law / law.sum())
    return np.array(held)


class Enumerated:
    """Every path of states and observations, with its probability under what was seen."""

    def __init__(
        self,
        world: HiddenMarkovModel,
        mechanism: Mechanism,
        columns: list[int],
        *,
        agent: HiddenMarkovModel | None = None,
        states: np.ndarray | None = None,
        extra: np.ndarray | None = None,
    ) -> None:
        n_steps = len(columns)
        n_symbols = world.emission.n_symbols
        self.paths = []
        for reports in product(range(n_symbols), repeat=n_steps):
            beliefs = smallest_filter(world if agent is None else agent, reports)
            gaps = np.linalg.norm(mechanism.beliefs[None] - beliefs[:, None], axis=2)
            places = gaps.argmin(axis=1)
            assert gaps.min(axis=1).max() < 1e-9
            for path in product(range(world.n_states), repeat=n_steps):
                if states is not None and tuple(states) != path:
                    continue
                weights = np.empty(n_steps)
                for t in range(n_steps):
                    move = world.initial[path[0]] if t == 0 else world.transition[path[t - 1], path[t]]
                    weights[t] = move * world.emission.probabilities[path[t], reports[t]]
                    weights[t] *= mechanism.probabilities[places[t], columns[t]]
                    weights[t] *= 1.0 if extra is None else extra[t, path[t]]
                self.paths.append((path, beliefs, weights))

    def law(self, step: int, last: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Mean belief and state law at `step` given steps up to `last`, and that probability."""
        total, belief, state = 0.0, 0.0, np.zeros(len(self.paths[0][1][0]))
        seen = {}
        for path, beliefs, weights in self.paths:
            # Paths that agree up to `last` are counted once.
            seen[path[: last + 1], beliefs[: last + 1].tobytes()] = (path, beliefs, weights[: last + 1].prod())
        for path, beliefs, weight in seen.values():
            total += weight
            belief = belief + weight * beliefs[step]
            state[path[step]] += weight
        return belief / total, state / total, total


def check_against(found: object, truth: Enumerated, *, smoothed: bool) -> None:
    n_steps = len(found)
    before = 1.0
    for t in range(n_steps):
        mean, state, _ = truth.law(t, n_steps - 1 if smoothed else t)
        assert np.abs(found.mean[t] - mean).max() < EXACT
        assert np.abs(found.states[t] - state).max() < EXACT
        total = truth.law(t, t)[2]
        assert np.exp(found.log_likelihood[t]) == pytest.approx(total / before, rel=1e-11)
        before = total


def playable(truth_world: HiddenMarkovModel, mechanism: Mechanism, n_steps: int, rng: np.random.Generator) -> list[int]:
    """Columns played along a sampled path."""
    path = truth_world.sample(n_steps, rng=rng)
    beliefs = filter_beliefs(truth_world, path.observations).beliefs
    places = np.linalg.norm(mechanism.beliefs[None] - beliefs[:, None], axis=2).argmin(axis=1)
    return [int(rng.choice(len(mechanism.actions), p=mechanism.probabilities[b])) for b in places]


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize(("n_states", "n_symbols", "n_steps"), [(2, 2, 4), (3, 2, 3), (2, 3, 3)])
@pytest.mark.parametrize("seed", range(3))
def test_filter_and_smoother_equal_enumeration(
    seed: int, n_states: int, n_symbols: int, n_steps: int, mixed: bool
) -> None:
    rng = np.random.default_rng([seed, n_states, n_symbols])
    world = random_world(rng, n_states, n_symbols)
    plays = random_mechanism(rng, reachable_beliefs(world, n_steps), 3, mixed=mixed)
    columns = playable(world, plays, n_steps, rng)
    truth = Enumerated(world, plays, columns)
    adversary = SequentialAdversary(world, plays)
    filtered, smoothed = adversary.filter(plays.actions[columns]), adversary.smooth(plays.actions[columns])
    assert filtered.is_exact
    check_against(filtered, truth, smoothed=False)
    check_against(smoothed, truth, smoothed=True)
    assert set(filtered.statuses) == {SequenceStatus.USED}
    for found in (filtered, smoothed):
        assert found.effective_size * (found.weights**2).sum(axis=1) == pytest.approx(1.0, abs=EXACT)
    # Where the models agree, the state given the belief has the belief as its law.
    assert filtered.mean == pytest.approx(filtered.states, abs=EXACT)


@pytest.mark.parametrize("mixed", [False, True])
def test_particles_enough_for_every_path_are_exact(mixed: bool) -> None:
    rng = np.random.default_rng(5)
    world = random_world(rng)
    plays = random_mechanism(rng, reachable_beliefs(world, 4), 3, mixed=mixed)
    columns = playable(world, plays, 4, rng)
    truth = Enumerated(world, plays, columns)
    adversary = SequentialAdversary(world, plays, n_particles=16, rng=rng)
    check_against(adversary.filter(plays.actions[columns]), truth, smoothed=False)
    check_against(adversary.smooth(plays.actions[columns]), truth, smoothed=True)


@pytest.mark.parametrize("n_particles", [0, 16])
@pytest.mark.parametrize("seed", range(3))
def test_an_agent_with_another_model(seed: int, n_particles: int) -> None:
    rng = np.random.default_rng([7, seed])
    world, agent = random_world(rng), random_world(rng)
    plays = random_mechanism(rng, reachable_beliefs(agent, 4), 3, mixed=True)
    columns = [int(c) for c in rng.integers(3, size=4)]
    truth = Enumerated(world, plays, columns, agent=agent)
    adversary = SequentialAdversary(
        world, plays, agent_world=agent, n_particles=n_particles, rng=rng if n_particles else None
    )
    check_against(adversary.filter(plays.actions[columns]), truth, smoothed=False)
    check_against(adversary.smooth(plays.actions[columns]), truth, smoothed=True)
    same = SequentialAdversary(agent, plays).filter(plays.actions[columns])
    assert np.abs(adversary.filter(plays.actions[columns]).mean - same.mean).max() > 1e-3


@pytest.mark.parametrize("n_particles", [0, 16])
def test_known_states_and_a_sensor_of_its_own(n_particles: int) -> None:
    rng = np.random.default_rng(11)
    world = random_world(rng)
    worse = CategoricalEmission([[0.6, 0.4], [0.3, 0.7]])
    plays = random_mechanism(rng, reachable_beliefs(world, 4), 3, mixed=True)
    columns, states, reports = [0, 2, 1, 1], np.array([0, 1, 1, 0]), np.array([1, 0, 0, 1])
    actions, extra = plays.actions[columns], worse.probabilities[:, reports].T
    options = {"n_particles": n_particles, "rng": rng if n_particles else None}
    plain = SequentialAdversary(world, plays, **options)
    sensing = SequentialAdversary(world, plays, sensor=worse, **options)
    for smoothed in (False, True):
        ask = "smooth" if smoothed else "filter"
        known = Enumerated(world, plays, columns, states=states)
        check_against(getattr(plain, ask)(actions, states=states), known, smoothed=smoothed)
        reported = Enumerated(world, plays, columns, extra=extra)
        check_against(getattr(sensing, ask)(actions, observations=reports), reported, smoothed=smoothed)


@pytest.mark.parametrize("n_particles", [0, 500])
def test_a_decision_written_twice_counts_once(n_particles: int) -> None:
    rng = np.random.default_rng(5)
    world = random_world(rng)
    plays = random_mechanism(rng, reachable_beliefs(world, 3), 3, mixed=True)
    part = rng.random(len(plays.beliefs))
    shares = np.column_stack([plays.probabilities, plays.probabilities[:, 0] * part])
    shares[:, 0] *= 1.0 - part
    twice = Mechanism(plays.beliefs, plays.actions[[0, 1, 2, 0]], shares, np.zeros_like(shares))
    options = {"n_particles": n_particles, "rng": rng} if n_particles else {}
    found = SequentialAdversary(world, twice, **options).smooth(plays.actions[[0, 2, 0]])
    check_against(found, Enumerated(world, plays, [0, 2, 0]), smoothed=True)


def test_beliefs_between_the_points_are_mixed_from_their_cell() -> None:
    rng = np.random.default_rng(2)
    for n_states in (2, 3):
        world = random_world(rng, n_states, 3)
        grid = simplex_grid(n_states, 12)
        plays = random_mechanism(rng, grid, 4, mixed=True)
        adversary = SequentialAdversary(world, plays)
        found = adversary.filter(plays.actions[[0, 1, 2]])
        assert not adversary.is_exact
        assert not found.is_exact
        assert 0 < found.interpolation_error.max() <= np.sqrt(2) / 12
        # A mixture keeps the mean, so without decisions the estimate at the first step is the initial law.
        assert adversary.unseen(1).mean[0] == pytest.approx(world.initial, abs=EXACT)
        nearest = SequentialAdversary(world, plays, interpolation="nearest").filter(plays.actions[[0, 1, 2]])
        assert np.abs(nearest.mean - found.mean).max() < 0.15


def test_many_states_use_the_nearest_belief() -> None:
    rng = np.random.default_rng(4)
    world = random_world(rng, 5, 3)
    plays = random_mechanism(rng, simplex_grid(5, 4), 3, mixed=True)
    for options in ({}, {"n_particles": 200, "rng": rng}):
        found = SequentialAdversary(world, plays, **options).smooth(plays.actions[[0, 2, 1, 1]])
        assert found.weights.sum(axis=1) == pytest.approx(1.0)
        assert found.states.sum(axis=1) == pytest.approx(1.0)
        assert 0 < found.interpolation_error.max() < 0.3
    # Weights that favour no belief tell nothing: the state keeps its law, however coarse the beliefs.
    flat = Mechanism(plays.beliefs, np.array([0]), np.ones((len(plays.beliefs), 1)), np.zeros((len(plays.beliefs), 1)))
    law = world.initial @ np.linalg.matrix_power(world.transition, 2)
    assert SequentialAdversary(world, flat).filter([0, 0, 0]).states[2] == pytest.approx(law, abs=EXACT)


def test_a_finer_grid_comes_nearer_to_the_exact_filter() -> None:
    rng = np.random.default_rng(3)
    world = HiddenMarkovModel([[0.8, 0.2], [0.3, 0.7]], CategoricalEmission([[0.7, 0.3], [0.4, 0.6]]))

    def plays(beliefs: np.ndarray) -> Mechanism:
        shares = np.column_stack([beliefs[:, 0] ** 2, 1.0 - beliefs[:, 0] ** 2])
        return Mechanism(beliefs, np.array([0, 1]), shares, np.zeros_like(shares))

    actions = rng.integers(2, size=9)
    exact = SequentialAdversary(world, plays(reachable_beliefs(world, 9))).filter(actions)
    assert exact.is_exact
    gaps = [
        np.abs(SequentialAdversary(world, plays(simplex_grid(2, r))).filter(actions).mean - exact.mean).max()
        for r in (10, 40, 160)
    ]
    assert gaps[0] > gaps[1] > gaps[2]
    assert gaps[2] < 2e-4


@pytest.mark.parametrize("smoothed", some([False, True], 2))
def test_particles_approach_the_exact_law(smoothed: bool) -> None:
    rng = np.random.default_rng(17)
    world = HiddenMarkovModel([[0.8, 0.2], [0.3, 0.7]], CategoricalEmission([[0.7, 0.3], [0.4, 0.6]]))
    plays = random_mechanism(rng, reachable_beliefs(world, 8), 3, mixed=True)
    columns = playable(world, plays, 8, rng)
    ask = "smooth" if smoothed else "filter"
    exact = getattr(SequentialAdversary(world, plays), ask)(plays.actions[columns])
    runs = [
        getattr(SequentialAdversary(world, plays, n_particles=20, rng=np.random.default_rng(s)), ask)(
            plays.actions[columns]
        )
        for s in range(60)
    ]
    means = np.array([run.mean[:, 0] for run in runs])
    # Estimates are ratios, so a bias of order 1/N stands beside the standard error.
    allowed = 4.0 * means.std(axis=0, ddof=1) / np.sqrt(len(runs)) + 0.1 / 20
    assert (np.abs(means.mean(axis=0) - exact.mean[:, 0]) <= allowed).all()
    assert 0 < means.std(axis=0).max() < 0.1
    likelihoods = np.array([np.exp(run.log_likelihood.sum()) for run in runs])
    error = likelihoods.std(ddof=1) / np.sqrt(len(runs))
    assert abs(likelihoods.mean() - np.exp(exact.log_likelihood.sum())) < 4.0 * error  # unbiased


def test_real_observations_approach_quadrature() -> None:
    """One step and two, with the observation integrated on a fine grid."""
    world = HiddenMarkovModel([[0.8, 0.2], [0.3, 0.7]], GaussianEmission([[0.0], [1.5]], [[[1.0]], [[1.0]]]))
    beliefs = simplex_grid(2, 400)
    shares = np.column_stack([beliefs[:, 0], 1.0 - beliefs[:, 0]])
    plays = Mechanism(beliefs, np.array([0, 1]), shares, np.zeros_like(shares))
    y = np.linspace(-8, 10, 361)
    density = np.exp(world.emission.log_likelihoods(y))  # (G, X)
    first = world.initial * density
    pi0 = first / first.sum(axis=1, keepdims=True)
    alpha0 = first * pi0[:, [0]]  # u_0 = 0
    predicted = (pi0 @ world.transition)[:, None] * density[None]
    pi1 = predicted / predicted.sum(axis=2, keepdims=True)
    alpha1 = ((alpha0 @ world.transition)[:, None] * density[None]) * pi1[:, :, [1]]  # u_1 = 1
    means = [
        np.einsum("gx,gz->z", alpha0, pi0) / alpha0.sum(),
        np.einsum("ghx,ghz->z", alpha1, pi1) / alpha1.sum(),
    ]
    found = [
        SequentialAdversary(world, plays, n_particles=500, rng=np.random.default_rng(s)).filter([0, 1])
        for s in range(20)
    ]
    runs = np.array([each.mean[:, 0] for each in found])
    error = runs.std(axis=0, ddof=1) / np.sqrt(len(runs))
    assert (np.abs(runs.mean(axis=0) - [means[0][0], means[1][0]]) < 4.0 * error + 1e-3).all()
    states = np.mean([each.states[1] for each in found], axis=0)
    assert states == pytest.approx(alpha1.sum(axis=(0, 1)) / alpha1.sum(), abs=0.01)


def test_a_decision_never_played_is_a_status() -> None:
    rng = np.random.default_rng(1)
    world = random_world(rng)
    beliefs = reachable_beliefs(world, 3)
    shares = np.zeros((len(beliefs), 3))
    shares[:, 0] = 1.0
    plays = Mechanism(beliefs, np.array([[0.0, 1.0], [0.5, 0.5], [1.0, 0.0]]), shares, np.zeros_like(shares))
    for options in ({}, {"n_particles": 50, "rng": rng}):
        adversary = SequentialAdversary(world, plays, **options)
        played, stray, listed = [0.0, 1.0], [0.1, 0.9], [1.0, 0.0]
        found = adversary.filter([played, stray, listed])
        assert found.statuses == (SequenceStatus.USED, SequenceStatus.NEVER_PLAYED, SequenceStatus.NEVER_PLAYED)
        assert np.isneginf(found.log_likelihood[1:]).all()
        unseen = adversary.filter([played, [np.nan, np.nan], [np.nan, np.nan]])
        assert found.mean == pytest.approx(unseen.mean, abs=EXACT)
        assert unseen.statuses[1] == SequenceStatus.UNSEEN
        asked = adversary.filter([played, stray, listed], nearest=True)
        assert asked.statuses == (SequenceStatus.USED, SequenceStatus.NEAREST, SequenceStatus.NEAREST)
        assert (
            "2 steps    read as the nearest known decisions: none of the mechanism's beliefs plays" in asked.summary()
        )
        assert "never plays it" in found.summary()


@pytest.mark.parametrize("n_particles", [0, 200])
def test_near_decisions_are_read_as_one(n_particles: int) -> None:
    """As under the mechanism in which they are one decision."""
    rng = np.random.default_rng(4)
    world = random_world(rng)
    beliefs = reachable_beliefs(world, 4)
    plays = random_mechanism(rng, beliefs, 6, mixed=True)
    stray = np.array([0.3, -0.2])
    near = np.argsort(np.linalg.norm(plays.actions - stray, axis=1))
    shares = np.column_stack([plays.probabilities[:, near[:3]].sum(axis=1), plays.probabilities[:, near[3:]]])
    joined = Mechanism(beliefs, np.vstack([stray, plays.actions[near[3:]]]), shares, np.zeros_like(shares))
    seen = np.array([plays.actions[near[4]], stray, plays.actions[near[5]], stray])
    for smooth in (False, True):
        pair = []
        for known in (plays, joined):
            drawn = {"n_particles": n_particles, "rng": np.random.default_rng(5)} if n_particles else {}
            observer = SequentialAdversary(world, known, **drawn)
            pair.append((observer.smooth if smooth else observer.filter)(seen, nearest=3))
        np.testing.assert_allclose(pair[0].weights, pair[1].weights, atol=EXACT)
        assert pair[0].log_likelihood == pytest.approx(pair[1].log_likelihood, abs=1e-10)
        assert pair[0].statuses[1] == SequenceStatus.NEAREST
        assert pair[1].statuses[1] == SequenceStatus.USED
    with pytest.raises(InputError, match="nearest"):
        SequentialAdversary(world, plays).filter(seen, nearest=-1)


def test_a_decision_that_contradicts_the_history_is_passed_over() -> None:
    world = HiddenMarkovModel(np.eye(2), CategoricalEmission(np.eye(2)), [0.5, 0.5])
    beliefs = reachable_beliefs(world, 2)
    plays = Mechanism(beliefs, np.array([0, 1]), np.eye(2)[beliefs.argmax(axis=1)], np.zeros((2, 2)))
    found = SequentialAdversary(world, plays).smooth([0, 1, 0])
    assert [each.name for each in found.statuses] == ["USED", "CONTRADICTED", "USED"]
    assert found.mean.tolist() == [[1.0, 0.0]] * 3


def test_an_observation_the_agent_rules_out_leaves_its_prediction() -> None:
    world = HiddenMarkovModel([[0.5, 0.5], [0.5, 0.5]], CategoricalEmission([[0.5, 0.5], [0.5, 0.5]]))
    agent = HiddenMarkovModel(np.eye(2), CategoricalEmission(np.eye(2)), [1.0, 0.0])
    plays = Mechanism(np.eye(2), np.array([0]), np.ones((2, 1)), np.zeros((2, 1)))
    found = SequentialAdversary(world, plays, agent_world=agent).filter([0, 0, 0])
    assert found.mean == pytest.approx(np.tile([1.0, 0.0], (3, 1)))
    assert found.states == pytest.approx(np.full((3, 2), 0.5))


def test_what_the_decisions_tell_lowers_the_error() -> None:
    rng = np.random.default_rng(23)
    world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], CategoricalEmission([[0.8, 0.2], [0.3, 0.7]]))
    beliefs = reachable_beliefs(world, 8)
    plays = random_mechanism(rng, beliefs, 4, mixed=True)
    adversary = SequentialAdversary(world, plays)
    squares = np.zeros((40, 3))
    for run in range(40):
        path = world.sample(8, rng=rng)
        held = filter_beliefs(world, path.observations).beliefs
        places = np.linalg.norm(beliefs[None] - held[:, None], axis=2).argmin(axis=1)
        actions = plays.actions[[rng.choice(4, p=plays.probabilities[b]) for b in places]]
        squares[run] = [
            each.error_of(held) ** 2
            for each in (adversary.unseen(8), adversary.filter(actions), adversary.smooth(actions))
        ]
    prior, filtered, smoothed = squares.mean(axis=0)
    assert smoothed < filtered < prior
    # What the observer expects of itself is what it finds.
    assert filtered == pytest.approx(np.mean(adversary.filter(actions).spread ** 2), rel=0.5)


def test_results_can_be_saved(tmp_path: object) -> None:
    world = random_world(np.random.default_rng(0))
    plays = random_mechanism(np.random.default_rng(0), reachable_beliefs(world, 2), 2, mixed=True)
    found = SequentialAdversary(world, plays).filter(plays.actions[[0, 1]])
    found.save(tmp_path / "found.npz")
    again = type(found).load(tmp_path / "found.npz")
    assert again.statuses == found.statuses
    assert (again.weights == found.weights).all()


def test_reachable_beliefs_are_those_of_the_filter() -> None:
    rng = np.random.default_rng(9)
    world = random_world(rng, 3, 2)
    found = reachable_beliefs(world, 4)
    assert len(found) == 2 + 4 + 8 + 16
    for reports in product(range(2), repeat=4):
        held = filter_beliefs(world, list(reports)).beliefs
        assert np.linalg.norm(found[None] - held[:, None], axis=2).min(axis=1).max() < EXACT
    silent = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], CategoricalEmission(np.ones((2, 1))))
    assert len(reachable_beliefs(silent, 50)) == 1
    with pytest.raises(ModelError, match="within 3 steps"):
        reachable_beliefs(world, 4, limit=10)


def test_what_cannot_be_is_refused() -> None:
    rng = np.random.default_rng(0)
    world = random_world(rng)
    plays = random_mechanism(rng, reachable_beliefs(world, 2), 2, mixed=True)
    adversary = SequentialAdversary(world, plays)
    gaussian = HiddenMarkovModel(world.transition, GaussianEmission([[0.0], [1.0]], [[[1.0]], [[1.0]]]))
    with pytest.raises(InputError, match="n_particles and rng"):
        SequentialAdversary(gaussian, plays)
    with pytest.raises(InputError, match="same symbols"):
        SequentialAdversary(world, plays, agent_world=gaussian, n_particles=5, rng=rng)
    with pytest.raises(InputError, match="rng must be"):
        SequentialAdversary(world, plays, n_particles=5)
    with pytest.raises(InputError, match=r"expected \(T,2\)"):
        adversary.filter([0, 1])
    with pytest.raises(InputError, match="one per decision"):
        adversary.filter(plays.actions, states=[0])
    with pytest.raises(InputError, match="states have 7 in row 1"):
        adversary.filter(plays.actions, states=[0, 7])
    with pytest.raises(InputError, match="no sensor"):
        adversary.filter(plays.actions, observations=[0, 1])
    with pytest.raises(InputError, match="pass its reports"):
        SequentialAdversary(world, plays, sensor=world.emission).filter(plays.actions)
    with pytest.raises(InputError, match="row 1"):
        adversary.filter([[0.0, 1.0], [np.nan, 1.0]])
    with pytest.raises(InputError, match="the world 3"):
        SequentialAdversary(random_world(rng, 3), plays)
    still = HiddenMarkovModel(np.eye(2), world.emission, [1.0, 0.0])
    with pytest.raises(ModelError, match="step 1"):
        SequentialAdversary(still, plays).filter(plays.actions, states=[0, 1])


def test_states_in_another_order_are_refused() -> None:
    """The sensor's rows and the agent's world would be taken for those of other states."""
    names, other = ["calm", "crisis"], ["crisis", "calm"]
    sensor = pd.DataFrame([[0.8, 0.2], [0.3, 0.7]], names)
    moves = pd.DataFrame([[0.9, 0.1], [0.4, 0.6]], names, names)
    world = HiddenMarkovModel(moves, CategoricalEmission(sensor))
    bare = HiddenMarkovModel(moves.to_numpy(), CategoricalEmission(sensor.to_numpy()))
    turned = HiddenMarkovModel(moves.loc[other, other], CategoricalEmission(sensor.loc[other]))
    plays = random_mechanism(np.random.default_rng(0), reachable_beliefs(world, 2), 2, mixed=True)
    for mine, others in ((world, world), (world, bare), (bare, world)):
        SequentialAdversary(mine, plays, agent_world=others, sensor=others.emission)
    with pytest.raises(InputError, match="agent_world has the state labels crisis, calm, world calm, crisis"):
        SequentialAdversary(world, plays, agent_world=turned)
    with pytest.raises(InputError, match="sensor has the state labels crisis, calm, world calm, crisis"):
        SequentialAdversary(world, plays, sensor=turned.emission)
    renamed = HiddenMarkovModel(moves.to_numpy(), bare.emission, names=("regime 2", "regime 1"))
    with pytest.raises(InputError, match="agent_world has the state labels"):
        SequentialAdversary(bare, plays, agent_world=renamed)


def coarse_agent() -> tuple[HiddenMarkovModel, Mechanism]:
    """Three beliefs, a decision each, and an agent that is between them as a rule."""
    world = HiddenMarkovModel([[0.95, 0.05], [0.1, 0.9]], CategoricalEmission([[0.9, 0.1], [0.1, 0.9]]), [0.5, 0.5])
    beliefs = np.array([[0.0, 1.0], [0.5, 0.5], [1.0, 0.0]])
    return world, Mechanism(beliefs, np.arange(3), np.eye(3), np.zeros((3, 3)))


def test_a_grid_too_coarse_for_a_decision_reads_it_with_a_tolerance() -> None:
    world, plays = coarse_agent()
    adversary, actions = SequentialAdversary(world, plays), [2, 0, 1]
    found, later = adversary.filter(actions), adversary.smooth(actions)
    assert [each.name for each in found.statuses] == ["USED", "WIDENED", "USED"]
    assert np.isfinite(found.log_likelihood).all()
    line, transition, reports = plays.beliefs[:, 0], world.transition, world.emission.probabilities
    # Every path of state and point. After decision 2 the points 1 and 2 are possible; of them 1 is nearest to point 0, which
    # plays decision 0, and stands there with half its weight. The other half goes to what was possible before, in proportion.
    stand_in: dict[int, dict[int, list[tuple[int, float]]]] = {0: {2: [(2, 1.0)]}, 1: {}, 2: {1: [(1, 1.0)]}}

    def split(belief: np.ndarray, y: int) -> list[tuple[int, float]]:
        joint = belief * reports[:, y]
        place = joint[0] / joint.sum()
        return [(b, float(np.interp(place, line, np.eye(3)[b]))) for b in range(3)]

    before, laws, laws_later, states = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 2))

    def follow(t: int, x: int, b: int, chance: float, seen: list[int]) -> None:
        before[t, b] += chance
        for place, weight in stand_in[t].get(b, []):
            held(t, x, place, chance * weight, [*seen, place])

    def held(t: int, x: int, b: int, chance: float, seen: list[int]) -> None:
        if chance == 0:
            return
        laws[t, b] += chance
        states[t, x] += chance
        if t == 2:
            for step, place in enumerate(seen):
                laws_later[step, place] += chance
            return
        predicted = plays.beliefs[b] @ transition
        for x_next in range(2):
            for y in range(2):
                for b_next, share in split(predicted, y):
                    follow(t + 1, x_next, b_next, chance * transition[x, x_next] * reports[x_next, y] * share, seen)

    def enumerate_all() -> None:
        for table in (before, laws, laws_later, states):
            table[:] = 0.0
        for x in range(2):
            for y in range(2):
                for b, share in split(world.initial, y):
                    follow(0, x, b, float(world.initial[x] * reports[x, y]) * share, [])

    enumerate_all()  # up to the decision in question
    kept = 0.5 * before[1, 1] / before[1].sum()
    stand_in[1] = {1: [(0, 0.5), (1, kept)], 2: [(2, kept)]}
    enumerate_all()
    np.testing.assert_allclose(found.weights, laws / laws.sum(axis=1, keepdims=True), atol=EXACT)
    np.testing.assert_allclose(later.weights, laws_later / laws_later.sum(axis=1, keepdims=True), atol=EXACT)
    np.testing.assert_allclose(found.states, states / states.sum(axis=1, keepdims=True), atol=EXACT)
    assert found.interpolation_error[1] >= np.linalg.norm(plays.beliefs[1] - plays.beliefs[0])
    assert "tolerance" in found.summary()


def test_what_no_tolerance_explains_is_passed_over() -> None:
    world, _ = coarse_agent()
    finer = np.column_stack([np.linspace(0, 1, 41), np.linspace(1, 0, 41)])
    fine = Mechanism(finer, np.arange(41), np.eye(41), np.zeros((41, 41)))
    found = SequentialAdversary(world, fine).filter([36, 0])
    assert [each.name for each in found.statuses] == ["USED", "CONTRADICTED"]
    assert np.isneginf(found.log_likelihood[1])


def test_a_tolerance_keeps_a_coarse_grid_on_the_track() -> None:
    rng = np.random.default_rng(3)
    world = HiddenMarkovModel(
        0.6 * np.eye(3) + 0.4 * rng.dirichlet(np.ones(3), size=3),
        CategoricalEmission(rng.dirichlet(np.ones(3), size=3)),
    )
    problem = MarkowitzProblem(rng.normal(size=(3, 3)) * 0.1, [np.diag(rng.uniform(0.05, 0.2, 3))] * 3, 1.0)
    held = filter_beliefs(world, world.sample(150, rng=rng).observations).beliefs
    actions = problem.solve(held)
    for resolution in (4, 8):
        agent = mechanism(OriginalDecisionMaker(problem), uniform_prior(3, resolution).beliefs)
        adversary = SequentialAdversary(world, agent)
        found = adversary.filter(actions, nearest=True)
        assert SequenceStatus.WIDENED in found.statuses
        assert found.error_of(held) < adversary.unseen(len(held)).error_of(held)
        assert found.error_of(held) < 2 * found.interpolation_error.mean()


@pytest.mark.parametrize(("scale", "gain"), some([(0.1, 0.03), (0.4, 0.0)], 2))
def test_a_tolerance_does_little_harm_where_the_grid_leads_astray(
    scale: float, gain: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where means are far apart many beliefs share a decision, and the nearest one played misleads as often as not."""
    errors = []
    for seed in range(6):
        rng = np.random.default_rng([seed, 0])
        world = HiddenMarkovModel(
            0.6 * np.eye(3) + 0.4 * rng.dirichlet(np.ones(3), size=3),
            CategoricalEmission(rng.dirichlet(np.ones(3), size=3)),
        )
        problem = MarkowitzProblem(
            rng.normal(size=(3, 3)) * scale, [np.diag(rng.uniform(0.05, 0.2, 3)) for _ in range(3)], 1.0
        )
        held = filter_beliefs(world, world.sample(100, rng=rng).observations).beliefs
        agent = mechanism(OriginalDecisionMaker(problem), uniform_prior(3, 8).beliefs)
        adversary, actions = SequentialAdversary(world, agent), problem.solve(held)
        found = adversary.filter(actions, nearest=True)
        with monkeypatch.context() as patch:
            patch.setattr(InverseFilter, "_widened", lambda *_: None)
            errors.append((found.error_of(held), adversary.filter(actions, nearest=True).error_of(held)))
    read, passed_over = np.array(errors).T
    assert (read <= passed_over + 0.03).all()
    assert read.mean() < passed_over.mean() - gain
