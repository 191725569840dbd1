"""Results survive a round trip through a file, and foreign files are refused with one sentence."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    BeliefSet,
    CounterAdversarialDecisionMaker,
    Decision,
    Decisions,
    Frontier,
    GlobalSearch,
    Infeasibility,
    InputError,
    MarkowitzProblem,
    MixedDecision,
    MixedDecisions,
    ProbabilisticDecisionMaker,
    consistent_beliefs,
    privacy_frontier,
)


@pytest.fixture(scope="module")
def problem() -> MarkowitzProblem:
    rng = np.random.default_rng(3)
    factors = rng.normal(size=(3, 4, 6))
    return MarkowitzProblem(0.05 * rng.normal(size=(3, 4)), 0.01 * factors @ factors.transpose(0, 2, 1), 2.0)


def same(first: object, second: object) -> bool:
    if isinstance(first, np.ndarray):
        return np.array_equal(first, second, equal_nan=True)
    return first == second


def test_decision_round_trip(problem, tmp_path):
    decision = CounterAdversarialDecisionMaker(problem).decide([0.2, 0.3, 0.5])
    decision.save(tmp_path / "decision.npz")
    again = Decision.load(tmp_path / "decision.npz")
    for name in ("action", "cost", "regret", "privacy", "privacy_bound", "decoy", "status"):
        assert same(getattr(decision, name), getattr(again, name)), name
    assert np.array_equal(decision.belief_set.vertices(), again.belief_set.vertices())
    assert again.summary() == decision.summary()


def test_mixtures_and_frontiers_round_trip(problem, tmp_path):
    makers = ProbabilisticDecisionMaker(problem)
    mixed, many = makers.decide([0.2, 0.3, 0.5]), makers.decide_many([[0.2, 0.3, 0.5], [1, 0, 0]])
    frontier = privacy_frontier(problem, [0.2, 0.3, 0.5], candidates=makers.candidates)
    for number, result in enumerate((mixed, many, frontier)):
        result.save(tmp_path / f"{number}.npz")
        again = type(result).load(tmp_path / f"{number}.npz")
        assert isinstance(again, (MixedDecision, MixedDecisions, Frontier))
    assert same(MixedDecision.load(tmp_path / "0.npz").probabilities, mixed.probabilities)
    assert same(MixedDecisions.load(tmp_path / "1.npz")[1].actions, many[1].actions)
    assert Frontier.load(tmp_path / "2.npz").randomized(0.01) == frontier.randomized(0.01)


DATA = Path(__file__).parent / "data"


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (Decision, "decision"),
        (Decisions, "decisions"),
        (MixedDecision, "mixed_decision"),
        (MixedDecisions, "mixed_decisions"),
    ],
)
def test_files_of_version_0_1_load(kind, name, tmp_path):
    """Two states, three assets: a proved decision, two that miss nothing, a lottery, and two of them."""
    found = kind.load(DATA / f"{name}_0_1.npz")
    many = hasattr(found, "__len__")
    assert found.is_loaded
    assert "privacies were not judged again" in repr(found)
    means, covariances = [[0.2, 0.0, 0.1], [0.0, 0.2, 0.1]], [np.eye(3), np.diag([1.0, 2.0, 1.0])]
    known = MarkowitzProblem(means, covariances, 1.0).optimal_cost([[0.5, 0.5], [0.9, 0.1]] if many else [0.5, 0.5])
    assert found.optimal_cost == pytest.approx(known, abs=1e-12)
    actions = found.actions if hasattr(found, "actions") else found.action
    assert actions.sum(axis=-1) == pytest.approx(1.0, abs=1e-12)
    if many:
        assert found[1].optimal_cost == found.optimal_cost[1]
        assert np.array_equal(found[1].summary(), kind.load(DATA / f"{name}_0_1.npz")[1].summary())
    found.save(tmp_path / "again.npz")
    assert kind.load(tmp_path / "again.npz").summary() == found.summary()


def forge(path: Path, target: Path, change: dict[str, object]) -> None:
    """Write a saved result with other values in some of its fields; functions change what is there."""
    with np.load(path) as stored:
        arrays = dict(stored)
    described = json.loads(str(arrays["description"]))
    fields = described["result"]["fields"]
    for name, value in change.items():
        if callable(value) and "array" in (fields[name] if isinstance(fields[name], dict) else ()):
            arrays[fields[name]["array"]] = value(arrays[fields[name]["array"]].copy())
        else:
            fields[name] = value(fields[name]) if callable(value) else value
    np.savez(target, **{**arrays, "description": np.array(json.dumps(described))})


def first(value: float) -> Callable[[np.ndarray], np.ndarray]:
    def changed(array: np.ndarray) -> np.ndarray:
        array.flat[0] = value
        return array

    return changed


STATUS = {"member": "PROVED", "of": "DecisionStatus"}
FORGED = [
    ("single", {"status": STATUS}, "called proved"),
    ("single", {"status": {"member": "OPTIMAL", "of": "DecisionStatus"}}, "called optimal"),
    ("single", {"status": {"member": "BRILLIANT", "of": "DecisionStatus"}}, "unknown DecisionStatus 'BRILLIANT'"),
    ("single", {"regret": 0.0}, "not the optimal cost and the regret together"),
    ("single", {"cost": {"float": "nan"}}, "not the optimal cost and the regret together"),
    ("single", {"optimal_cost": {"float": "inf"}}, "not finite"),
    ("single", {"privacy": 0.9, "privacy_bound": 0.8}, "a bound below its privacy: 0.8"),
    ("singles", {"regret": first(-1.0)}, "a negative regret: -1"),
    ("singles", {"cost": first(7.0)}, "decision 0 has a cost that is not the optimal cost and the regret together: 7"),
    ("lottery", {"probabilities": first(0.9)}, "do not sum to 1"),
    ("lottery", {"expected_privacy": 0.99}, "an expected privacy that its decisions do not have: 0.99"),
    ("lottery", {"expected_cost": 0.0}, "not the optimal cost and the regret together"),
    ("lotteries", {"probabilities": first(-0.5)}, "a negative probability"),
    ("lotteries", {"regrets": lambda array: array[:, :1]}, "the other columns"),
]


@pytest.mark.parametrize(("which", "change", "said"), FORGED)
def test_files_that_contradict_themselves_are_refused(problem, tmp_path, which, change, said):
    single, mixed = CounterAdversarialDecisionMaker(problem), ProbabilisticDecisionMaker(problem)
    belief, beliefs = [0.2, 0.3, 0.5], [[0.2, 0.3, 0.5], [0.6, 0.3, 0.1]]
    asked = {
        "single": lambda: single.decide(belief),
        "singles": lambda: single.decide_many(beliefs),
        "lottery": lambda: mixed.decide(belief),
        "lotteries": lambda: mixed.decide_many(beliefs),
    }
    found = asked[which]()
    found.save(tmp_path / "true.npz")
    forge(tmp_path / "true.npz", tmp_path / "same.npz", {})
    assert type(found).load(tmp_path / "same.npz").summary() == found.summary()
    forge(tmp_path / "true.npz", tmp_path / "forged.npz", change)
    with pytest.raises(InputError, match=re.escape(said)):
        type(found).load(tmp_path / "forged.npz")


def test_what_is_proved_of_a_lottery_is_not_said_of_one_draw(problem, tmp_path):
    mixed = ProbabilisticDecisionMaker(problem, certify=0.01).decide_many([[0.2, 0.3, 0.5]])
    assert {each.name for each in mixed.status} <= {"PROVED", "GAP_REACHED"}
    rng = np.random.default_rng(0)
    for drawn in (mixed.sample(rng=rng)[0], mixed[0].sample(rng=rng)):
        assert drawn.status.name == "DRAWN"
        drawn.save(tmp_path / "drawn.npz")
        assert Decision.load(tmp_path / "drawn.npz").summary() == drawn.summary()


def test_calls_of_proofs_round_trip_and_older_files_have_none(problem, tmp_path):
    beliefs = [[0.2, 0.3, 0.5], [1, 0, 0]]
    proofs = CounterAdversarialDecisionMaker(problem, method=GlobalSearch(certify=0.1)).decide_many(beliefs)
    lotteries = ProbabilisticDecisionMaker(problem, certify=0.1).decide_many(beliefs)
    path, older = tmp_path / "new.npz", tmp_path / "older.npz"
    for many in (proofs, lotteries):
        assert (many.oracle_calls > 0).all()
        assert many.sample(rng=np.random.default_rng(0))[0].oracle_calls > 0 if many is lotteries else True
        many.save(path)
        again = type(many).load(path)
        assert same(again.oracle_calls, many.oracle_calls)
        assert again[1].oracle_calls == many[1].oracle_calls
        with np.load(path) as stored:
            kept = dict(stored)
        described = json.loads(str(kept["description"]))
        del described["result"]["fields"]["oracle_calls"]
        np.savez(older, **{**kept, "description": np.array(json.dumps(described))})
        assert type(many).load(older).oracle_calls.tolist() == [0, 0]
        assert type(many).load(older)[1].oracle_calls == 0
    plain = CounterAdversarialDecisionMaker(problem).decide_many(beliefs)
    assert plain.oracle_calls.tolist() == [0, 0]


def test_an_empty_set_keeps_its_gap(tmp_path):
    problem = MarkowitzProblem([[0.3, 0.1, 0], [0, 0.1, 0.25]], [np.diag([1.0, 2, 3]), np.diag([3.0, 1, 1])], 0.7)
    made = consistent_beliefs(problem, [0.05, 0.9, 0.05])
    made.save(tmp_path / "set.npz")
    loaded = BeliefSet.load(tmp_path / "set.npz")
    assert loaded.is_empty
    assert loaded.plausibility_gap == made.plausibility_gap > 0.1
    assert loaded.gap_reaches(1e-6)
    assert Infeasibility()([0.3, 0.7], loaded) == Infeasibility()([0.3, 0.7], made)
    dated = replace(made, state_names=tuple(pd.date_range("2020-01-01", periods=2)))
    with pytest.raises(InputError, match=r"set\.npz was not written: .* expected labels that are texts or numbers"):
        dated.save(tmp_path / "set.npz")


def test_foreign_files_are_refused(problem, tmp_path):
    decision = CounterAdversarialDecisionMaker(problem).decide([0.2, 0.3, 0.5])
    path = tmp_path / "decision.npz"
    decision.save(path)
    with pytest.raises(InputError, match="holds a Decision, expected a Frontier"):
        Frontier.load(path)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(InputError, match="not a saved result"):
        Decision.load(path)
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(InputError, match="not a saved result"):
        Decision.load(tmp_path / "text.npz")
    with pytest.raises(InputError, match="not a saved result"):
        Decision.load(tmp_path / "missing.npz")
    with pytest.raises(InputError, match="cannot be written"):
        decision.save(tmp_path / "no" / "folder.npz")
    np.savez(tmp_path / "other.npz", a=np.zeros(2))
    with pytest.raises(InputError, match="not a saved result"):
        Decision.load(tmp_path / "other.npz")


def test_a_file_without_a_value_was_written_by_another_version(problem, tmp_path):
    path = tmp_path / "decision.npz"
    CounterAdversarialDecisionMaker(problem).decide([0.2, 0.3, 0.5]).save(path)
    with np.load(path) as stored:
        arrays = dict(stored)
    described = json.loads(str(arrays["description"]))
    del described["result"]["fields"]["regret"]
    np.savez(path, **(arrays | {"description": np.array(json.dumps(described))}))
    with pytest.raises(InputError, match="another version wrote it, without regret: compute it again"):
        Decision.load(path)


def test_a_flipped_byte_is_noticed_or_harmless(problem, tmp_path):
    decision = CounterAdversarialDecisionMaker(problem).decide([0.2, 0.3, 0.5])
    path = tmp_path / "decision.npz"
    decision.save(path)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for place in np.sort(rng.choice(len(whole), min(400, len(whole)), replace=False)):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        try:
            again = Decision.load(path)
        except InputError:
            refused += 1
        else:
            assert np.array_equal(again.action, decision.action), place
            assert again.regret == decision.regret, place
    assert refused > 100


@pytest.mark.parametrize("described", ["[]", "1", "null", '{"format": "other"}', "[" * 100_000])
def test_a_description_of_another_kind_is_refused(tmp_path, described):
    np.savez(tmp_path / "other.npz", description=np.array(described))
    with pytest.raises(InputError, match=r"other\.npz is not a saved result"):
        Decision.load(tmp_path / "other.npz")


def test_a_failed_save_leaves_the_old_file_and_nothing_else(problem, tmp_path, monkeypatch):
    decision = CounterAdversarialDecisionMaker(problem).decide([0.2, 0.3, 0.5])
    path = tmp_path / "decision.npz"
    decision.save(path)
    before = path.read_bytes()

    def half(stream, **arrays):
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", half)
    with pytest.raises(InputError, match=r"decision\.npz cannot be written: No space left"):
        decision.save(path)
    assert [each.name for each in tmp_path.iterdir()] == ["decision.npz"]
    assert path.read_bytes() == before
