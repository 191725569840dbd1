"""A backtest at every budget: decisions of CDM and PDM from the frontiers, and the estimates of both observers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from inscrutable.adversaries import BayesianAdversary
from inscrutable.decision_makers import Frontier, privacy_frontier
from inscrutable.experiments.backtest_results import Backtest
from inscrutable.experiments.cell_mechanism import N_NEAREST
from inscrutable.geometry import BeliefSet
from inscrutable.mechanisms import mechanism
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

MOST_STEPS = 330
MULTIPLES = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0)
"""Multiples of the backtest's own budget."""

_WITHOUT = (0.0, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5)
"""Budgets as shares of |c*| (of its mean for a budget of regret), if the backtest's own budget is zero."""

SINGLE, LOTTERY = "CDM", "PDM"
_CHILD_OF_SEED = 4
"""Index of the child seed; the backtest itself draws from the others."""


class Atom(NamedTuple):
    """A possible decision: index, probability, regret in the cost's unit, and privacy."""

    candidate: int
    """Index of a candidate; the number of candidates means the optimal decision."""
    probability: float
    regret: float
    privacy: float


class PlayedAt(NamedTuple):
    """The decisions at one step and budget."""

    atoms: tuple[Atom, ...]
    drawn: int
    sets: tuple[BeliefSet, ...]
    aware: Array | None
    """The estimate of the aware observer from the drawn decision."""


def single_at(frontier: Frontier, limit: float) -> tuple[Atom, ...]:
    """Return the best single decision within a regret; none if no affordable decision has a privacy."""
    place = int(np.searchsorted(frontier.points[:, 0], limit, side="right")) - 1
    return () if place < 0 else (Atom(int(frontier.indices[place]), 1.0, *map(float, frontier.points[place])),)


def lottery_at(frontier: Frontier, limit: float) -> tuple[Atom, ...]:
    """Return the best lottery within an expected regret: one corner of the envelope, or two neighbours."""
    corners = frontier.corners
    right = int(np.searchsorted(corners[:, 0], limit, side="right"))
    if right == 0:
        return ()
    chosen = [(right - 1, 1.0)]
    if right < len(corners):
        share = float((limit - corners[right - 1, 0]) / (corners[right, 0] - corners[right - 1, 0]))
        chosen = [(right - 1, 1.0 - share), (right, share)] if share > 0 else chosen
    return tuple(Atom(_number(frontier, corner), share, *map(float, corners[corner])) for corner, share in chosen)


def _number(frontier: Frontier, corner: int) -> int:
    """Return the index of the candidate at a corner."""
    place = int(np.searchsorted(frontier.points[:, 0], frontier.corners[corner, 0], side="left"))
    return int(frontier.indices[place])


_RULES = {SINGLE: single_at, LOTTERY: lottery_at}


@dataclass(eq=False)
class _AtBudget:
    """A decision maker that plays the frontiers' decisions, in the form that `mechanism` takes."""

    problem: DecisionProblem
    actions: Array
    own: Array
    atoms: Sequence[tuple[Atom, ...]]

    def decide_many(self, beliefs: object) -> object:
        """Not used: `mechanism` calls `table`."""
        raise NotImplementedError

    def table(self, beliefs: object) -> tuple[Array, np.ndarray, Array]:
        """Return the decisions to draw from, the candidates and then every belief's optimal one, and the shares."""
        numbers, shares = np.zeros((len(self.atoms), 2), dtype=np.int64), np.zeros((len(self.atoms), 2))
        for b, atoms in enumerate(self.atoms):
            for k, atom in enumerate(atoms or (Atom(len(self.actions), 1.0, 0.0, 0.0),)):
                numbers[b, k] = atom.candidate + (b if atom.candidate == len(self.actions) else 0)
                shares[b, k] = atom.probability
        return np.vstack([self.actions, self.own]), numbers, shares


class BudgetSweep:
    """The decisions of a backtest's CDM and PDM at every budget, at no more than `MOST_STEPS` of its steps.

    At the backtest's own budget these are the published ones; at others the best candidates, without local refinement. A
    lottery is drawn with the same uniform number at every budget.

    Args:
        result: The backtest.
        most_steps: Number of steps, evenly spaced over time.
    """

    def __init__(self, result: Backtest, most_steps: int = MOST_STEPS) -> None:
        self.result = result
        every = -(-len(result.beliefs) // most_steps)
        self.steps = np.arange(0, len(result.beliefs), every)
        self.beliefs = result.beliefs.to_numpy()[self.steps]
        self.optimal_costs = result.episode.records["ODM"].decisions.optimal_cost[self.steps]
        self.amounts, self.own = _amounts(result)
        seed = np.random.SeedSequence(result.settings.seed).spawn(_CHILD_OF_SEED + 1)[_CHILD_OF_SEED]
        self._luck = np.random.default_rng(seed).random(len(self.steps))

    @property
    def names(self) -> tuple[str, ...]:
        """The decision makers with decisions at every budget."""
        return tuple(name for name in self.result.names if name in ("ODM", *_RULES))

    @property
    def dates(self) -> list[str]:
        """The date of every step."""
        return [f"{date:%Y-%m-%d}" for date in self.result.dates[self.steps]]

    @property
    def scale(self) -> Array:
        """Regret per unit of budget at each step, shape (T,): |c*|, or 1 for a budget of regret."""
        return np.abs(self.optimal_costs) if self.result.budget.is_relative else np.ones(len(self.steps))

    @cached_property
    def frontiers(self) -> tuple[Frontier, ...]:
        """The frontier of every step."""
        return tuple(self._frontier(belief, int(t)) for t, belief in zip(self.steps, self.beliefs, strict=True))

    @cached_property
    def prior_frontiers(self) -> tuple[Frontier, ...]:
        """The frontier of every belief that an observer with a prior holds possible."""
        aware = self.result.aware
        return () if aware is None else tuple(self._frontier(belief, 0) for belief in aware.prior.beliefs)

    def _frontier(self, belief: Array, step: int) -> Frontier:
        result = self.result
        return privacy_frontier(
            result.problem, belief, result.settings.measure.at_step(step), candidates=result.candidates
        )

    def played(self, name: str, budget: int) -> tuple[PlayedAt, ...]:
        """Return a decision maker's decisions at every step at a budget; the ODM's do not depend on it."""
        if name not in _RULES or budget == self.own:
            return self._published(name)
        candidates, rule = self.result.candidates, _RULES[name]
        limits = self.amounts[budget] * self.scale
        atoms = [
            # If no affordable decision has a privacy, the decision is the optimal one.
            rule(front, limits[t]) or (Atom(len(candidates), 1.0, 0.0, -np.inf),)
            for t, front in enumerate(self.frontiers)
        ]
        drawn = [self._drawn(each, t) for t, each in enumerate(atoms)]
        optimal = self.result.episode.records["ODM"].decisions
        actions = np.array(
            [
                optimal.action[self.steps[t]]
                if each[k].candidate == len(candidates)
                else candidates.actions[each[k].candidate]
                for t, (each, k) in enumerate(zip(atoms, drawn, strict=True))
            ]
        )
        aware = self._read(name, self.amounts[budget], actions)
        optimal_sets = optimal.belief_set
        return tuple(
            PlayedAt(
                each,
                drawn[t],
                tuple(
                    optimal_sets[self.steps[t]]
                    if atom.candidate == len(candidates)
                    else candidates.sets[atom.candidate]
                    for atom in each
                ),
                None if aware is None else aware[t],
            )
            for t, each in enumerate(atoms)
        )

    def _drawn(self, atoms: tuple[Atom, ...], t: int) -> int:
        reached = np.cumsum([atom.probability for atom in atoms])
        return min(int(np.searchsorted(reached, self._luck[t], side="right")), len(atoms) - 1)

    def _read(self, name: str, amount: float, actions: Array) -> Array | None:
        """Return the estimates of an observer who knows this rule, this budget and the prior."""
        aware, result = self.result.aware, self.result
        if aware is None:
            return None
        fronts = self.prior_frontiers
        limits = [amount * abs(each.optimal_cost) if result.budget.is_relative else amount for each in fronts]
        atoms = [_RULES[name](each, limit) for each, limit in zip(fronts, limits, strict=True)]
        own = self._optimal_of_prior
        maker = _AtBudget(result.problem, result.candidates.actions, own, atoms)
        played = mechanism(maker, aware.prior.beliefs)
        return BayesianAdversary(played, aware.prior).estimates(actions, nearest=N_NEAREST)

    @cached_property
    def _optimal_of_prior(self) -> Array:
        assert self.result.aware is not None
        return np.asarray(self.result.problem.solve(self.result.aware.prior.beliefs))

    def _published(self, name: str) -> tuple[PlayedAt, ...]:
        record, aware = self.result.episode.records[name], self.result.aware
        sets, privacies = record.decisions.belief_set, self.result.privacy(name)
        found = []
        for t in map(int, self.steps):
            read = None if aware is None else aware.estimates[name][t]
            if record.lotteries is None:
                atom = Atom(-1, 1.0, float(record.decisions.regret[t]), float(privacies[t]))
                found.append(PlayedAt((atom,), 0, (sets[t],), read))
                continue
            lottery = record.lotteries[t]
            apart = np.abs(lottery.actions - record.decisions.action[t]).max(axis=1)
            rows = zip(lottery.probabilities, lottery.regrets, lottery.privacies, strict=True)
            atoms = tuple(Atom(-1, *map(float, row)) for row in rows)
            found.append(PlayedAt(atoms, int(apart.argmin()), tuple(lottery.belief_sets), read))
        return tuple(found)


def _amounts(result: Backtest) -> tuple[Array, int]:
    """Return the budgets, in the unit of the backtest's own, and the index of the latter."""
    own = result.budget.amount
    if own > 0:
        return own * np.array(MULTIPLES), MULTIPLES.index(1.0)
    mean = float(np.abs(result.episode.records["ODM"].decisions.optimal_cost).mean())
    return np.array(_WITHOUT) * (1.0 if result.budget.is_relative else mean), 0
