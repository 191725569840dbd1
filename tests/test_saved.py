"""Results survive a round trip through a file, and foreign files are refused with one sentence."""

from __future__ import annotations

import json

import numpy as np
import pytest

from inscrutable import (
    CounterAdversarialDecisionMaker,
    Decision,
    Frontier,
    GlobalSearch,
    InputError,
    MarkowitzProblem,
    MixedDecision,
    MixedDecisions,
    ProbabilisticDecisionMaker,
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
