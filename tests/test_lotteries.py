"""Lotteries for many beliefs: the search against all pairs of candidates, and what comes out against the adversary."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    DesiredObfuscation,
    MarkowitzProblem,
    MaximalObfuscation,
    MixedDecisions,
    ProbabilisticDecisionMaker,
    consistent_beliefs,
    decoy_grid,
)
from inscrutable.decision_makers.search import lottery_search, partition
from inscrutable.kernels import calls
from oracles.enumeration import upper_concave_envelope
from sizes import instances, paired, some

Array = NDArray[np.float64]

GAP = 1e-7  # gains below this are not looked for
SHAPES = [(2, 2), (2, 4), (3, 2), (3, 3), (3, 5), (4, 3), (4, 5)]  # few assets: large sets; many: single beliefs


def market(n_states: int, n_assets: int, rng: np.random.Generator) -> MarkowitzProblem:
    factors = rng.normal(size=(n_states, n_assets, n_assets + 2)) * 0.2
    covariances = factors @ factors.transpose(0, 2, 1) / n_assets + 0.01 * np.eye(n_assets)
    return MarkowitzProblem(rng.normal(0.05, 0.1, (n_states, n_assets)), covariances, 2.0)


# --- decide_many --------------------------------------------------------------------------------------------------------


class Told(NamedTuple):
    """A decision maker with beliefs, what it aims at, and the result."""

    maker: ProbabilisticDecisionMaker
    beliefs: Array
    points: Array
    sign: float
    mixed: MixedDecisions


def told(shape: tuple[int, int], sign: float, budget: Budget | float, count: int = 12, seed: int = 0) -> Told:
    rng = np.random.default_rng(seed)
    problem, beliefs = market(*shape, rng), rng.dirichlet(np.ones(shape[0]), count)
    points = beliefs if sign > 0 else rng.dirichlet(np.ones(shape[0]), count)
    measure = MaximalObfuscation() if sign > 0 else DesiredObfuscation(points)
    maker = ProbabilisticDecisionMaker(problem, measure, budget, candidates=decoy_grid(problem, 14))
    return Told(maker, beliefs, points, sign, maker.decide_many(beliefs))


CASES = [
    pytest.param(shape, sign, budget, id=f"X{shape[0]}-U{shape[1]}-{'far' if sign > 0 else 'near'}-{budget}")
    for shape in SHAPES
    for sign, budget in [(1.0, 0.1), (-1.0, 0.1), (1.0, 0.005)]
]


@pytest.mark.parametrize(("shape", "sign", "budget"), some(CASES, 2))
def test_every_atom_is_what_the_adversary_sees(shape: tuple[int, int], sign: float, budget: float) -> None:
    case = told(shape, sign, budget)
    problem, mixed = case.maker.problem, case.mixed
    for t, belief in enumerate(case.beliefs):
        cost = float(problem.optimal_cost(belief))
        limit = budget * abs(cost)
        one, least = mixed[t], problem.constraints.min_slack
        assert 1 <= len(one.probabilities) <= 2
        np.testing.assert_allclose(one.probabilities.sum(), 1.0, atol=1e-15)
        for i, action in enumerate(one.actions):
            slack = problem.constraints.slacks(action)
            assert ((slack <= 0.0) | (slack >= least)).all()
            assert problem.constraints.violation(action) <= 1e-12
            seen = consistent_beliefs(problem, action)
            assert not seen.is_empty
            np.testing.assert_allclose(one.privacies[i], sign * seen.distance(case.points[t]), atol=1e-7)
            regret = float(problem.state_costs(action) @ belief) - cost
            np.testing.assert_allclose(one.regrets[i], regret, atol=1e-12 * max(1.0, abs(cost)))
            assert seen.contains(one.decoys[i]) or seen.distance(one.decoys[i]) < 1e-7
        spent = float(one.probabilities @ one.regrets)
        assert spent <= limit * (1.0 + 1e-12)
        np.testing.assert_allclose(one.expected_cost - cost, spent, atol=1e-14)
        np.testing.assert_allclose(one.expected_privacy, one.probabilities @ one.privacies, atol=1e-14)
        assert one.expected_privacy <= one.privacy_bound


@pytest.mark.parametrize(("shape", "sign", "budget"), some(CASES, 3))
def test_no_worse_than_the_grid_nor_than_a_single_decision(shape: tuple[int, int], sign: float, budget: float) -> None:
    case = told(shape, sign, budget, count=instances(6), seed=1)
    problem, candidates = case.maker.problem, case.maker.candidates
    kept = candidates.usable & (candidates.sets.dimension >= 0)
    for t, belief in enumerate(case.beliefs):
        cost = float(problem.optimal_cost(belief))
        regrets = np.maximum(candidates.state_costs[kept] @ belief - cost, 0.0)
        privacies = sign * candidates.sets.distances(case.points[t])[kept]
        envelope = upper_concave_envelope(regrets, privacies, budget * abs(cost))
        assert case.mixed.expected_privacy[t] >= envelope - 2 * GAP
        measure = MaximalObfuscation() if sign > 0 else DesiredObfuscation(case.points[t])
        arguments: Any = {"measure": measure, "budget": budget, "candidates": candidates}
        lottery = ProbabilisticDecisionMaker(problem, **arguments).decide(belief)
        single = CounterAdversarialDecisionMaker(problem, **arguments).decide(belief)
        assert lottery.expected_privacy >= single.privacy - GAP
        assert lottery.expected_privacy >= envelope - 2 * GAP


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_budget_buys_nothing(sign: float) -> None:
    case = told((3, 4), sign, 0.0)
    assert not (case.mixed.expected_cost - case.mixed.optimal_cost).any()
    for t, belief in enumerate(case.beliefs):
        one = case.mixed[t]
        assert len(one.probabilities) == 1
        np.testing.assert_allclose(one.actions[0], case.maker.problem.solve(belief), atol=1e-12)
        if sign > 0:
            assert one.expected_privacy == 0.0
            assert one.status is DecisionStatus.NO_AFFORDABLE_PRIVACY


def test_indexing_padding_and_all_actions_at_once() -> None:
    case = told((3, 5), 1.0, 0.05, count=40)
    mixed = case.mixed
    assert len(mixed) == 40
    assert mixed.actions.shape == (40, 2, 5)
    assert np.isfinite(mixed.actions).all()
    assert {len(mixed[t].probabilities) for t in range(40)} == {1, 2}, "one kind alone would prove little"
    for t in [*range(40), -1]:
        kept = mixed.probabilities[t] > 0
        assert np.array_equal(mixed[t].actions, mixed.actions[t][kept])
        assert np.array_equal(mixed[t].decoys, mixed.decoys[t][kept])
        assert np.array_equal(mixed[t].privacies, mixed.privacies[t][kept])
        single = ~kept[1]
        assert not single or np.array_equal(mixed.actions[t][0], mixed.actions[t][1])
    with pytest.raises(IndexError):
        mixed[40]


def test_sample_draws_the_atoms_by_their_probabilities() -> None:
    case = told((3, 5), 1.0, 0.05, count=40)
    step = int(np.argmin(np.abs(case.mixed.probabilities[:, 1] - 0.5)))
    many = case.maker.decide_many(np.repeat(case.beliefs[step : step + 1], 1000, axis=0))
    drawn = many.sample(rng=np.random.default_rng(1))
    again = many.sample(rng=np.random.default_rng(1))
    assert np.array_equal(drawn.action, again.action)
    assert many.probabilities[0, 1] > 0.05
    second = np.isclose(drawn.privacy, many.privacies[0, 1], atol=1e-9)
    np.testing.assert_allclose(second.mean(), many.probabilities[0, 1], atol=0.04)
    mixed = case.mixed.sample(rng=np.random.default_rng(2))
    for t in (0, step):
        assert np.array_equal(mixed[t].action, mixed.action[t])
        assert any(np.array_equal(mixed[t].action, action) for action in case.mixed[t].actions)


def test_save_and_load(tmp_path: Any) -> None:
    case = told((3, 4), 1.0, 0.05, count=8)
    case.mixed.save(tmp_path / "lotteries.npz")
    loaded = MixedDecisions.load(tmp_path / "lotteries.npz")
    for name in ("actions", "probabilities", "regrets", "privacies", "expected_cost", "price", "decoys"):
        assert np.array_equal(getattr(loaded, name), getattr(case.mixed, name)), name
    assert loaded.status == case.mixed.status
    assert np.array_equal(loaded[3].actions, case.mixed[3].actions)
    one, other = (each.sample(rng=np.random.default_rng(0)) for each in (loaded, case.mixed))
    assert np.array_equal(one.action, other.action)


@pytest.mark.parametrize(("shape", "sign"), paired([(3, 2), (3, 4), (4, 3)], [1.0, -1.0]))
def test_a_belief_among_many_and_alone(shape: tuple[int, int], sign: float) -> None:
    """What the belief before found is a first guess, no more: the value is the same to the search's own gap."""
    rng = np.random.default_rng(3)
    problem, beliefs = market(*shape, rng), rng.dirichlet(np.ones(shape[0]), instances(30, least=14))
    target = rng.dirichlet(np.ones(shape[0]))
    measure = MaximalObfuscation() if sign > 0 else DesiredObfuscation(target)
    maker = ProbabilisticDecisionMaker(problem, measure, 0.1, candidates=decoy_grid(problem, 12))
    whole, back = maker.decide_many(beliefs), maker.decide_many(beliefs[::-1])
    for t in range(len(beliefs)):
        alone = maker.decide_many(beliefs[t : t + 1])
        for other, at in ((alone, 0), (back, len(beliefs) - 1 - t)):
            np.testing.assert_allclose(whole.expected_privacy[t], other.expected_privacy[at], atol=1e-6)
            spent = whole.expected_cost[t] - other.expected_cost[at]
            assert abs(spent) <= 1e-6 * max(1.0, abs(whole.optimal_cost[t])) or sign < 0


# --- threads, compiled or not, memory, progress -------------------------------------------------------------------------


FIELDS = ("probabilities", "regrets", "privacies", "decoys", "actions", "price", "expected_cost", "expected_privacy")


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_same_bytes_for_any_number_of_threads(sign: float, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    problem, beliefs = market(3, 4, rng), rng.dirichlet(np.ones(3), 120)  # thirty chunks
    measure = MaximalObfuscation() if sign > 0 else DesiredObfuscation(rng.dirichlet(np.ones(3)))
    maker = ProbabilisticDecisionMaker(problem, measure, 0.05, candidates=decoy_grid(problem, 10))
    results = []
    for count in (1, 4):
        monkeypatch.setattr(calls, "thread_count", lambda count=count: count)
        mixed = maker.decide_many(beliefs)
        results.append([getattr(mixed, name).tobytes() for name in FIELDS])
    assert results[0] == results[1]


TINY = """
import json, sys
import numpy as np
from inscrutable import DesiredObfuscation, MaximalObfuscation, ProbabilisticDecisionMaker, decoy_grid
sys.path.insert(0, {tests!r})
from test_lotteries import market
out = []
for n_states, n_assets in {shapes!r}:
    rng = np.random.default_rng(0)
    problem, beliefs = market(n_states, n_assets, rng), rng.dirichlet(np.ones(n_states), 2)
    for measure in (MaximalObfuscation(), DesiredObfuscation(np.eye(n_states)[0])):
        maker = ProbabilisticDecisionMaker(problem, measure, 0.1, candidates=decoy_grid(problem, 5))
        mixed = maker.decide_many(beliefs)
        out.append([mixed.expected_privacy.tolist(), mixed.expected_cost.tolist(), mixed.actions.tolist()])
print(json.dumps(out))
"""


def run(script: str, **environment: str) -> str:
    answer = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert answer.returncode == 0, answer.stderr[-2000:]
    return answer.stdout.strip().splitlines()[-1]


def test_threads_of_a_user_share_candidates(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the regions that one of them knows take too much memory, and are forgotten between searches."""
    rng = np.random.default_rng(3)
    problem = market(3, 6, rng)
    beliefs = rng.dirichlet(np.ones(3), 40)
    maker = ProbabilisticDecisionMaker(problem, budget=0.2, candidates=decoy_grid(problem, 20))
    alone = maker.decide_many(beliefs)
    monkeypatch.setattr(partition, "_MOST_FLOATS", 1)
    with ThreadPoolExecutor(3) as pool:
        found = list(pool.map(lambda _: maker.decide_many(beliefs), range(12)))
    for each in found:
        np.testing.assert_array_equal(each.expected_privacy, alone.expected_privacy)
        np.testing.assert_array_equal(each.expected_cost, alone.expected_cost)


def test_what_a_search_reads_stays_whole_while_another_thread_makes_regions() -> None:
    """A search reads regions and the flat arrays with their programmes; a later programme may lie in longer arrays."""
    problem = market(3, 12, np.random.default_rng(3))
    regions = partition.Partition(problem)
    chosen = problem.solve(np.random.default_rng(4).dirichlet(np.ones(3), 400))
    regions.make(regions.holding(chosen[:1]))
    read = regions.arrays
    regions.make(regions.holding(chosen))
    assert regions.arrays.charts.size > read.charts.size, "no array was replaced"
    known = read.size >= 0
    ends = read.chart_at[known] + problem.n_actions * (1 + read.size[known])
    assert ends.max() <= read.charts.size


def test_the_same_numbers_without_compilation() -> None:
    script = TINY.format(tests=os.path.dirname(__file__), shapes=some([(2, 2), (3, 3)], 2))
    with redirect_stdout(io.StringIO()) as printed:
        exec(script, {})
    compiled, plain = json.loads(printed.getvalue()), json.loads(run(script, NUMBA_DISABLE_JIT="1"))
    for one, other in zip(compiled, plain, strict=True):
        for ours, theirs in zip(one, other, strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-7)


MEMORY = """
import resource, sys
import numpy as np
from inscrutable import ProbabilisticDecisionMaker, decoy_grid
from inscrutable.decision_makers.search import lottery_search, region_search
sys.path.insert(0, {tests!r})
from test_lotteries import market
rng = np.random.default_rng(0)
problem = market(3, 3, rng)
maker = ProbabilisticDecisionMaker(problem, budget=0.5, candidates=decoy_grid(problem, 60))
beliefs = rng.dirichlet(np.ones(3), 1_500)
lottery_search._BLOCK = region_search._BLOCK = 128
maker.decide_many(beliefs[:250])
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
mixed = maker.decide_many(beliefs)
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
held = {{id(a): a.nbytes for a in vars(mixed.table).values() if isinstance(a, np.ndarray)}}
assert len(mixed) == 1_500
print(after - before, sum(held.values()) / 1024)
"""


@pytest.mark.audit
def test_memory_beyond_the_result_does_not_grow_with_the_beliefs() -> None:
    """Twelve blocks, of which one is worked on at a time; all at once take 40 MB."""
    grown, held = map(float, run(MEMORY.format(tests=os.path.dirname(__file__))).split())
    assert grown - held < 20 * 1024, f"{grown / 1024:.0f} MB for a result of {held / 1024:.0f} MB"


def test_progress_rises_to_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lottery_search, "_BLOCK", 150)
    case = told((3, 3), 1.0, 0.05, count=2)
    seen: list[tuple[int, int]] = []
    beliefs = np.random.default_rng(0).dirichlet(np.ones(3), 220)
    case.maker.decide_many(beliefs, progress=lambda done, count: seen.append((done, count)))
    done = [steps for steps, _ in seen]
    assert done == sorted(done)
    assert len(done) > 1
    assert {count for _, count in seen} == {220}
    assert seen[-1] == (220, 220)


def test_progress_goes_on_over_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lottery_search, "_BLOCK", 50)
    case = told((3, 3), 1.0, 0.05, count=2)
    seen: list[tuple[int, int]] = []
    beliefs = np.random.default_rng(0).dirichlet(np.ones(3), 175)
    blocks = case.maker.decide_many(beliefs, progress=lambda done, count: seen.append((done, count)))
    done = [steps for steps, _ in seen]
    assert done == sorted(done)
    assert seen[-1] == (175, 175)
    assert {50, 100, 150} <= set(done)
    monkeypatch.undo()
    whole = case.maker.decide_many(beliefs)
    np.testing.assert_allclose(blocks.expected_privacy, whole.expected_privacy, atol=1e-12)


def test_an_interrupt_ends_the_run_and_the_next_one_works() -> None:
    case = told((3, 3), 1.0, 0.05, count=2)
    beliefs = np.random.default_rng(0).dirichlet(np.ones(3), 100)

    def interrupt(done: int, count: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        case.maker.decide_many(beliefs, progress=interrupt)
    assert np.isfinite(case.maker.decide_many(beliefs).expected_privacy).all()


def test_with_few_candidates_one_belief_gets_what_many_get() -> None:
    # Climbing from the best single decision alone ended 4.6 % lower here.
    rng = np.random.default_rng(38)
    factors = rng.normal(size=(3, 6, 6))
    covariances = 0.01 * (factors @ factors.swapaxes(1, 2) + np.eye(6))
    problem = MarkowitzProblem(0.02 * rng.normal(size=(3, 6)), covariances, 5.0)
    beliefs = rng.dirichlet(np.ones(3), 30)[24:]
    maker = ProbabilisticDecisionMaker(problem, candidates=decoy_grid(problem, 8))
    together = maker.decide_many(beliefs).expected_privacy
    alone = np.array([maker.decide(belief).expected_privacy for belief in beliefs])
    assert (alone >= together - 1e-6).all()
