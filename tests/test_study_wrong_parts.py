"""What a study says of parts of a user's own that fail, or return what they must not: always the part and what was wrong."""

from __future__ import annotations

import re
import sys

import pytest

from inscrutable import Study, run_study
from sizes import some

PARTS = """
from typing import NamedTuple
import numpy as np
from inscrutable import DecisionProblem, LinearForm, PrivacyMeasure, QuadraticForm, box
from inscrutable.privacy.measures import Values

class Valves(DecisionProblem):
    def __init__(self):
        self.targets = np.array([[0.2, 0.9], [0.8, 0.6]])
        self.constraints = box([0.0, 0.0], [1.0, 1.0])
    @property
    def n_states(self): return 2
    def solve(self, beliefs): return np.clip(np.asarray(beliefs) @ self.targets, 0.0, 1.0)
    def state_costs(self, actions): return 0.5 * (self.cost_gradients(actions) ** 2).sum(axis=-1)
    def cost_gradients(self, action): return np.asarray(action)[..., None, :] - self.targets

class Coin:
    n_states, heads = 2, np.array([0.9, 0.2])
    def log_likelihoods(self, observations):
        return np.log(np.where(np.asarray(observations)[:, None] == 1, self.heads, 1 - self.heads))
    def sample(self, states, *, rng): return (rng.random(len(states)) < self.heads[states]).astype(int)
    def to_dict(self): return {"type": "coin"}

class Hidden(PrivacyMeasure):
    def __call__(self, belief, belief_set):
        return 1.0 if belief_set.is_empty else float(abs(belief_set.center()[-1] - belief[-1]))

class Played(NamedTuple):
    action: object

class Mixed(NamedTuple):
    actions: object
    probabilities: object

class Optimal:
    def __init__(self, problem): self.problem = problem
    def decide_many(self, beliefs): return Played(self.problem.solve(beliefs))

class Middle:
    def __init__(self, problem): self.problem = problem
    def infer(self, action): return self.estimate(action)
    def estimate(self, action, *, nearest=False): return np.full(2, 0.5)
    def estimates(self, actions, *, nearest=False): return np.full((len(actions), 2), 0.5)
"""
RAGGED = "[[1.0], [1.0, 2.0]]"
SOLVE, COSTS, SLOPES = (f"def {name}(self, given): return {{0}}" for name in ("solve", "state_costs", "cost_gradients"))
FORM = "def quadratic_form(self): return QuadraticForm({0}, -self.targets, None, self.constraints)"
LIKELY, DRAWN = "def log_likelihoods(self, observations): return {0}", "def sample(self, states, *, rng): return {0}"
JUDGED = "def __call__(self, belief, belief_set): return {0}"
DECIDED = "def decide_many(self, beliefs): return {0}"
GUESSED = "def estimates(self, actions, *, nearest=False): return {0}"

# The part that is made wrong, what stands in place of its own, and what the failed task says after the part's name.
WRONG = [
    # As they should be: the task is done.
    *((part, "pass", "") for part in ("Valves", "Coin", "Hidden", "Optimal", "Middle")),
    ("Valves", SOLVE.format(RAGGED), r"\.solve: action must be numbers: .*inhomogeneous"),
    ("Valves", SOLVE.format("None"), r"\.solve: action has shape \(\), expected 2 coordinates"),
    ("Valves", SOLVE.format("'much'"), r"\.solve: action must be numbers: could not convert string"),
    ("Valves", SOLVE.format("super().solve(given)[..., :1]"), r"\.solve: action has shape \(5, 1\), expected 2"),
    ("Valves", SOLVE.format("super().solve(given)[:-1]"), r"\.solve: decisions must have shape \(5, 2\), got \(4, 2\)"),
    ("Valves", SOLVE.format("super().solve(given) * np.nan"), r"\.solve: decisions must be numbers, got nan at index \[0, 0\]"),
    ("Valves", SOLVE.format("super().solve(given) + 1"), r"\.solve: the decision row 0 is outside .* violated by 0\.8"),
    ("Valves", SOLVE.format("1 / 0"), r"\.solve failed with ZeroDivisionError: division by zero \(line \d+ of wrong_\d+\)"),
    ("Valves", COSTS.format(RAGGED), r"\.state_costs: costs must be numbers: .*inhomogeneous"),
    ("Valves", COSTS.format("None"), r"\.state_costs: costs must have shape \(5, 2\), got \(\)"),
    ("Valves", COSTS.format("super().state_costs(given).sum(-1)"), r"\.state_costs: costs must have .*got \(5,\)"),
    ("Valves", COSTS.format("super().state_costs(given) * np.nan"), r"\.state_costs: costs must be numbers, got nan at"),
    ("Valves", SLOPES.format(RAGGED), r"\.cost_gradients: gradients must be numbers: .*inhomogeneous"),
    ("Valves", SLOPES.format("super().cost_gradients(given)[..., :1]"), r"\.cost_gradients: .*\(5, 2, 2\), got \(5, 2, 1\)"),
    ("Valves", "n_states = 'two'", r": n_states must be a whole number of at least 1, got 'two'"),
    ("Valves", "n_states = property(lambda self: self.missing)", " failed with AttributeError: .* no attribute 'missing'"),
    ("Valves", "constraints = property(lambda self: None, lambda self, _: None)", ": constraints must be a Polyhedron"),
    ("Valves", "def __init__(self): pass", " failed with AttributeError: .* no attribute 'constraints'"),
    ("Valves", "def __init__(self): raise RuntimeError('no licence')", r" failed with RuntimeError: no licence \(line"),
    ("Valves", "def quadratic_form(self): return 3", ": what quadratic_form returns must be a QuadraticForm, got 3"),
    ("Valves", FORM.format(RAGGED), ": hessians of quadratic_form must be numbers: .*inhomogeneous"),
    ("Valves", FORM.format("np.ones((2, 2))"), r": hessians of quadratic_form must have shape \(2, 2, 2\), got \(2, 2\)"),
    ("Valves", "def linear_form(self): return LinearForm([1.0], self.constraints)", r": costs of linear_form .* got \(1,\)"),
    ("Valves", "def smooth_form(self): return 3", ": what smooth_form returns must be a SmoothForm, got 3"),
    ("Coin", LIKELY.format(RAGGED), r"\.log_likelihoods: log-likelihoods must be numbers: .*inhomogeneous"),
    ("Coin", LIKELY.format("super().log_likelihoods(observations).T"), r"\.log_likelihoods: .*\(15, 2\), got \(2, 15\)"),
    ("Coin", LIKELY.format("super().log_likelihoods(observations) * np.nan"), r"\.log_likelihoods: .* got nan at"),
    ("Coin", LIKELY.format("{}['rate']"), r"\.log_likelihoods failed with KeyError: 'rate' \(line"),
    ("Coin", DRAWN.format("None"), r"\.sample: observations must be 15, one for each state of the path, got shape \(\)"),
    ("Coin", DRAWN.format("[1]"), r"\.sample: observations must be 15, .* got shape \(1,\)"),
    ("Coin", DRAWN.format("[[1]] + [[1, 2]] * (len(states) - 1)"), r"\.sample: observations must all have one shape"),
    ("Coin", "n_states = None", ": n_states must be a whole number of at least 1, got None"),
    ("Coin", f"means = {RAGGED}", ": means must be numbers: .*inhomogeneous"),
    ("Hidden", JUDGED.format("[1.0, 2.0]"), r": the value must be one number, got \[1\.0, 2\.0\]"),
    ("Hidden", JUDGED.format(RAGGED), r": the value must be one number, got \[\[1\.0\], \[1\.0, 2\.0\]\]"),
    ("Hidden", JUDGED.format("None"), ": the value must be one number, got None"),
    ("Hidden", JUDGED.format("'much'"), ": the value must be one number, got 'much'"),
    ("Hidden", JUDGED.format("1j"), ": the value must be one number, got 1j"),
    ("Hidden", JUDGED.format("np.nan"), ": the value is NaN"),
    ("Hidden", JUDGED.format("belief_set.middle"), " failed with AttributeError: .* no attribute 'middle'"),
    ("Hidden", "def upper_bound(self, belief): return None", r"\.upper_bound: the value must be one number, got None"),
    ("Hidden", "def values(self, belief, sets): return Values(['a'], np.ones(1, bool))", r"\.values: privacies must be"),
    ("Optimal", DECIDED.format("None"), r"\.decide_many: the answer must have `action`, or .* got None"),
    ("Optimal", DECIDED.format(f"Played({RAGGED})"), r"\.decide_many: action must be numbers: .*inhomogeneous"),
    ("Optimal", DECIDED.format("Played('much')"), r"\.decide_many: action must be numbers: could not convert string"),
    ("Optimal", DECIDED.format("Played(np.full((4, 2), 0.5))"), r"\.decide_many: action must have .*got \(4, 2\)"),
    ("Optimal", DECIDED.format("Played(np.full((5, 2), np.nan))"), r"\.decide_many: action must be numbers, got nan at"),
    ("Optimal", DECIDED.format("Played(np.full((5, 2), 5.0))"), r"\.decide_many: action row 0 is outside .* off by 9"),
    ("Optimal", DECIDED.format("Mixed(np.full((5, 1, 2), 0.5), np.full((5, 1), 0.5))"), r"\.decide_many: .* sums to 0\.5"),
    ("Optimal", DECIDED.format("Mixed(np.full((5, 2), 0.5), np.full((5, 1), 1.0))"), r"\.decide_many: actions must have shape"),
    ("Optimal", DECIDED.format(f"Mixed(np.full((5, 1, 2), 0.5), {RAGGED})"), r"\.decide_many: probabilities .*inhomogeneous"),
    ("Optimal", DECIDED.format("beliefs[99]"), r"\.decide_many failed with IndexError: .* \(line"),
    ("Optimal", "def __init__(self, problem): pass", ": a decision maker with `problem` and `decide_many` is needed"),
    ("Middle", GUESSED.format(RAGGED), r"\.estimates: guesses must be numbers: .*inhomogeneous"),
    ("Middle", GUESSED.format("None"), r"\.estimates: guesses must have shape \(5, 2\), got \(\)"),
    ("Middle", GUESSED.format("'much'"), r"\.estimates: guesses must be numbers: could not convert string"),
    ("Middle", GUESSED.format("np.full(2, 0.5)"), r"\.estimates: guesses must have shape \(5, 2\), got \(2,\)"),
    ("Middle", GUESSED.format("np.full((5, 2), np.nan)"), r"\.estimates: guesses must be numbers, got nan at index \[0, 0\]"),
    ("Middle", GUESSED.format("np.full((5, 2), 3.0)"), r"\.estimates: guesses row 0 sums to 6, expected 1"),
    ("Middle", "def estimates(self, actions): return actions", r"\.estimates failed with TypeError: .* argument 'nearest'"),
]  # fmt: skip


def plan_of(part):
    """A small study in which the part that is called Wrong has its place."""
    moves = {"transition": [[0.9, 0.1], [0.3, 0.7]]}
    market = {"kind": "given", "means": [[0.1, 0.2], [0.2, 0.1]], "covariances": [[[1.0, 0.0], [0.0, 1.0]]] * 2}
    plan = {
        "name": "wrong",
        "world": market | moves,
        "beliefs": {"kind": "grid", "resolution": 4},
        "candidates": {"resolution": 4},
        "budgets": {"unit": "regret", "values": 0.02},
        "decision_makers": "ODM",
        "measures": ["error", "expected_regret"],
    }
    return plan | {
        "Valves": {"problem": {"kind": "Wrong"}},
        "Coin": {"world": {"kind": "Wrong"} | moves, "problem": {"kind": "Valves"}, "beliefs": {"kind": "path", "steps": 5}},
        "Hidden": {"decision_makers": {"name": "CDM", "goal": "Wrong"}},
        "Optimal": {"decision_makers": "Wrong"},
        "Middle": {"adversaries": "Wrong"},
    }[part]  # fmt: skip


def errors_of(module, part, body, tmp_path, monkeypatch):
    """What a study says of a part in which a body stands in place of its own; empty if nothing failed."""
    (tmp_path / f"{module}.py").write_text(f"{PARTS}\nclass Wrong({part}):\n    {body}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    own = [f"{module}:Wrong", f"{module}:Valves"]
    study = run_study(Study.of(plan_of(part), extensions=own), tmp_path / "out")
    sys.modules.pop(module)
    return "\n".join(study.errors())


@pytest.mark.parametrize("number", some(range(len(WRONG)), 4))
def test_a_wrong_part_is_named_with_what_is_wrong(number, tmp_path, monkeypatch):
    part, body, said = WRONG[number]
    module = f"wrong_{number}"
    errors = errors_of(module, part, body, tmp_path, monkeypatch)
    assert bool(errors) == bool(said), errors
    if said:
        assert re.search(rf"^task 0 \(\w+\): InputError: {module}:Wrong{said}", errors), errors


IN_PLACE = [
    ("Valves", "def solve(self, beliefs): beliefs -= beliefs.mean(); return super().solve(beliefs)", r"\.solve"),
    ("Valves", "def state_costs(self, actions): actions *= 0.5; return super().state_costs(actions)", r"\.state_costs"),
    ("Valves", "def optimal_cost(self, beliefs): beliefs[:] = 0.5; return super().optimal_cost(beliefs)", r"\.optimal_cost"),
    ("Middle", "def estimates(self, actions, **how): actions[:] = 0; return super().estimates(actions)", r"\.estimates"),
]  # fmt: skip


@pytest.mark.parametrize("number", range(len(IN_PLACE)))
def test_a_part_cannot_change_what_it_is_given(number, tmp_path, monkeypatch):
    part, body, said = IN_PLACE[number]
    module = f"changes_{number}"
    errors = errors_of(module, part, body, tmp_path, monkeypatch)
    place = rf"InputError: {module}:Wrong{said} failed with ValueError: .* read-only \(line \d+ of {module}\)"
    assert re.search(place, errors), errors


@pytest.mark.parametrize(
    ("part", "body", "said"),
    [
        (
            "Optimal",
            DECIDED.format("exit(0)"),
            r"InputError: {}:Wrong\.decide_many failed with SystemExit: 0 \(line \d+",
        ),
        (
            "Valves",
            "def optimal_cost(self, beliefs): raise SystemExit(0)",
            r"InputError: {}:Wrong\.optimal_cost failed with SystemExit: 0 \(line \d+",
        ),
    ],
)
def test_a_part_that_ends_the_program_fails_its_task_alone(part, body, said, tmp_path, monkeypatch):
    errors = errors_of(f"ends_{part}", part, body, tmp_path, monkeypatch)
    assert re.search(rf"^task 0 \(\w+\): {said.format(f'ends_{part}')}", errors), errors


def test_an_error_that_is_no_utf_8_is_kept_in_its_row(tmp_path, monkeypatch):
    body = r"def decide_many(self, beliefs): raise ValueError('caf\udcff caf\xe9')"
    assert "ValueError: caf\\udcff caf\xe9 " in errors_of("unwritten", "Optimal", body, tmp_path, monkeypatch)


def test_an_observation_model_without_means_needs_a_problem_of_its_own(tmp_path, monkeypatch):
    (tmp_path / "without_means.py").write_text(PARTS)
    monkeypatch.syspath_prepend(str(tmp_path))
    plan = plan_of("Coin") | {"world": {"kind": "Coin", "transition": [[0.9, 0.1], [0.3, 0.7]]}}
    del plan["problem"]
    study = run_study(Study.of(plan, extensions=["without_means:Coin"]), tmp_path / "out")
    sys.modules.pop("without_means")
    assert "of kind markowitz takes the means and covariances of the observations" in "\n".join(study.errors())
