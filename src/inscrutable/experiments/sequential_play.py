"""The sequential rule in an experiment: its long-run mechanism, and the aware observer's error over time.

Its decisions depend on the observer's law, so no single table K(u|π) describes it, and it is simulated. At every step the
observer knows K_t and updates its law of the belief exactly; only paths and decisions are random. The long-run mechanism is
K̄(u|π) = E[K_t(u|π) | π_t = π], which an observer of a single decision, without earlier ones, knows.

The observer always knows the true chain of the belief. The rule may assume another one: `truth` then differs from its own
chain. With a disclosure, K̄ is the mean over the disclosed steps, and numbers of repeated decisions count disclosed ones.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from inscrutable.budgets import Budget
from inscrutable.decision_makers import SequentialDecisionMaker
from inscrutable.decision_makers.sequential.step import StepTable
from inscrutable.experiments.setting import Behaviour, Repeated, Seed, Setting, Watched
from inscrutable.mechanisms import Mechanism
from inscrutable.mechanisms.chains import BeliefChain, resting_chain
from inscrutable.mechanisms.joint import top_states
from inscrutable.privacy import Loss, SquaredError
from inscrutable.validation import Array

WATCHED_FIRST = 20
"""Burn-in steps, after which errors count as long-run errors."""

LONG_PATHS = (10, 60)
"""Number of paths and of steps per path for long-run figures; every step solves a programme of about 10 ms."""

OTHER_PATHS = (5, 60)
"""The same numbers where the true chain differs from the rule's."""

STILL_PATHS = 12
"""Number of paths with a constant belief; each has the largest number of repeated decisions."""


class _Figures(NamedTuple):
    """Figures of the aware observer over time, on D paths at T steps, each (T,D)."""

    squared: Array  # E‖π_t − E[π_t|u_0..u_t]‖², as expected by the observer
    named: Array  # probability of naming a most likely state
    bits: Array  # I(π_t; u_t | u_0..u_{t−1})
    regret: Array  # regret of the true belief, expected over the draw


@dataclass(frozen=True, eq=False)
class SequentialPlay:
    """A sequential rule in a setting whose chain is known."""

    setting: Setting
    maker: SequentialDecisionMaker
    seed: Seed

    @property
    def _chain(self) -> BeliefChain:
        assert self.setting.chain is not None
        return self.setting.chain

    @cached_property
    def _long_run(self) -> tuple[_Figures, Mechanism]:
        found, table = self._followed(self.maker, self._chain, LONG_PATHS)
        return found, table

    @property
    def mechanism(self) -> Mechanism:
        """K̄, the long-run mechanism."""
        return self._long_run[1]

    @property
    def regret(self) -> float:
        """The expected regret in the long run, from the calibration."""
        return self.maker.calibration.regret

    @cached_property
    def watched(self) -> Watched:
        """The error of the aware observer who sees every decision."""
        found = self._long_run[0]
        error, error_se, ceiling = self._error(found.squared[WATCHED_FIRST:].mean(axis=0))
        bits = found.bits[WATCHED_FIRST:].mean(axis=0)
        half, _ = self._followed(self.maker, staying(self._chain, 0.5), OTHER_PATHS)
        double, _ = self._followed(self.maker, staying(self._chain, 2.0), OTHER_PATHS)
        return Watched(
            error,
            error_se,
            min(float(found.named[WATCHED_FIRST:].mean()), 1.0),
            float(bits.mean()),
            float(bits.std(ddof=1) / np.sqrt(len(bits))),
            ceiling,
            float(np.sqrt(half.squared[WATCHED_FIRST:].mean())),
            float(np.sqrt(double.squared[WATCHED_FIRST:].mean())),
        )

    def _error(self, squared: Array) -> tuple[float, float, float]:
        """Return the aware observer's error, its standard error and its ceiling, from squared errors on D paths.

        Where the rule's loss is the squared error, its calibration simulated the same observer for much longer and gives the
        error.
        """
        if not isinstance(self.maker.loss, SquaredError):
            error = float(np.sqrt(squared.mean()))
            spread, ceiling = float(squared.std(ddof=1)) / np.sqrt(len(squared)), float("nan")
        else:
            prices = self.maker.calibration
            error, spread, ceiling = float(np.sqrt(prices.loss)), prices.loss_se, float(np.sqrt(self.maker.ceiling))
        return error, spread / (2.0 * error) if error > 0 else 0.0, ceiling

    def repeated(self, steps: tuple[int, ...], *, told: bool) -> Repeated:
        """Return the errors on one belief that the observer knows to be constant; `told`: the rule knows it too.

        Prices are the long-run ones in both cases, so the regret with `told` differs.
        """
        prior = self.setting.prior
        still = resting_chain(prior, 1.0)
        maker = self._knowing(still) if told else self.maker
        schedule = maker.disclosure.schedule
        made = schedule.offset + (np.array(steps) - 1) * schedule.period
        at = made + schedule.lag  # when they are seen
        found, _ = self._followed(maker, still, (STILL_PATHS, int(at[-1]) + 1))
        # Control variate: the error after the first decision is known exactly, and paths give the decrease from there. A fitted
        # coefficient instead of one would depend on the draw.
        since, before = found.squared[at], 0.0
        if schedule.is_immediate and isinstance(maker.loss, SquaredError):
            since, before = since - found.squared[0], maker.begin().expected.loss
        squared, spread = since.mean(axis=1) + before, since.std(axis=1, ddof=1) / np.sqrt(STILL_PATHS)
        errors = np.sqrt(np.maximum(squared, 0.0))
        return Repeated(
            errors,
            np.divide(spread, 2.0 * errors, out=np.zeros_like(errors), where=errors > 0),
            found.bits.cumsum(axis=0)[made].mean(axis=1),
            np.minimum(found.named[at].mean(axis=1), 1.0),
            float(found.regret.mean()),
        )

    def published(self, path: np.ndarray) -> Array:
        """Return decisions (T,U) along a path of beliefs, given as indices (T,) into the prior."""
        problem = self.setting.problem
        played = self.maker.decide_path(self.setting.prior.beliefs[path], rng=self.seed())
        return np.asarray(problem.as_points(played.actions))

    def _knowing(self, chain: BeliefChain) -> SequentialDecisionMaker:
        """Return the rule at the same prices that assumes another chain."""
        maker = self.maker
        return SequentialDecisionMaker(
            maker.problem,
            maker.budget,
            chain=chain,
            candidates=self.setting.candidates,
            loss=maker.loss,
            information_price=maker.information_price,
            disclosure=maker.disclosure,
            calibration=maker.calibration,
            rng=self.seed(),
        )

    def _followed(
        self, maker: SequentialDecisionMaker, truth: BeliefChain, size: tuple[int, int]
    ) -> tuple[_Figures, Mechanism]:
        """Simulate paths of a belief with the chain `truth`, and return the average mechanism under each belief."""
        prior, rng = self.setting.prior, self.seed()
        n_paths, n_steps = size
        places = truth.paths(n_steps, n_paths, rng=rng)
        points = prior.beliefs - prior.mean
        squares, top = (points**2).sum(axis=1), top_states(prior.beliefs)
        found = np.empty((4, n_steps, n_paths))
        lag, values = maker.disclosure.schedule.lag, maker.table
        weighed, seen, last = np.zeros((len(prior), values.n_values)), np.zeros(len(prior)), None
        actions = values.columns.problem.as_actions(values.columns.points)
        for d in range(n_paths):
            sequence, law = maker.begin(), prior.weights
            held = deque([law] * (lag + 1), maxlen=lag + 1)
            for t, place in enumerate(places[:, d]):
                step = sequence.step
                law = law if t == 0 else np.asarray(law @ truth.transition)
                joint = law[:, None] * step.rows
                if t >= WATCHED_FIRST and sequence.is_shown:
                    seen = seen + law
                    weighed[:, step.numbers] += joint
                own, columns = step.rows[place], values.cheapest[place, step.numbers]
                order = np.argsort(columns)  # in the order of the decisions, not of the disclosed values
                drawn = order[rng.choice(len(own), p=own[order] / own.sum())]
                found[3, t, d] = own @ values.regrets[place, step.numbers]
                found[2, t, d] = 0.0
                if sequence.is_shown:
                    found[2, t, d] = _information(step.rows, joint)
                    law = joint[:, drawn] / joint[:, drawn].sum()
                held.append(law)
                present = held[0]
                for _ in range(lag):
                    present = np.asarray(present @ truth.transition)
                mean = present @ points
                found[0, t, d] = max(float(present @ squares - mean @ mean), 0.0)
                found[1, t, d] = float((present @ top).max())
                if t == n_steps - 1:
                    last = sequence.mechanism if sequence.is_shown else sequence.mechanism_for(sequence.observer)
                sequence.publish(actions[columns[drawn]])
        assert last is not None
        return _Figures(*found), _averaged(last, _as_decisions(values, weighed), seen)


def sequential(
    setting: Setting, regret: float, seed: Seed, information_price: float | None, loss: Loss | None = None
) -> Behaviour | None:
    """Return the behaviour of the sequential rule at an expected long-run regret; None without a chain."""
    if setting.chain is None:
        return None
    if regret <= 0.0:
        return Behaviour(setting.optimal)
    maker = SequentialDecisionMaker(
        setting.problem,
        Budget.regret(regret),
        chain=setting.chain,
        candidates=setting.candidates,
        loss=loss,
        information_price=information_price,
        disclosure=setting.disclosure,
        rng=seed(),
    )
    play = SequentialPlay(setting, maker, seed)
    return Behaviour(play.mechanism, play=play)


def staying(chain: BeliefChain, longer: float) -> BeliefChain:
    """Return the chain on which beliefs stay half as long, or twice as long: T² or (I + T)/2. Both keep the prior."""
    step = chain.transition
    if longer < 1:
        return BeliefChain(chain.prior, sparse.csr_array(step @ step))
    return BeliefChain(chain.prior, sparse.csr_array(0.5 * (sparse.eye_array(len(chain.prior)) + step)))


def _information(rows: Array, joint: Array) -> float:
    """I(π;u) in bits of the joint law of K (B,n)."""
    some = joint > 0
    chances = np.broadcast_to(joint.sum(axis=0), rows.shape)
    return max(float(joint[some] @ np.log2(rows[some] / chances[some])), 0.0)


def _as_decisions(table: StepTable, joint: Array) -> Any:
    """Return the joint law (B,M) of belief and decision, from that of belief and disclosed value (B,C)."""
    rows, values = np.nonzero(joint > 0)
    entries = joint[rows, values], (rows, table.cheapest[rows, values])
    return sparse.csr_array(sparse.coo_array(entries, shape=(len(joint), len(table.columns))))


def _averaged(last: Mechanism, weighed: Any, seen: Array) -> Mechanism:
    """Return K̄ on the beliefs, weighted by the simulated laws; a belief without weight plays as in the last step."""
    some = seen > 0
    scale = sparse.diags_array(np.divide(1.0, seen, out=np.zeros_like(seen), where=some))
    rest = sparse.diags_array((~some).astype(np.float64)) @ last.sparse
    return Mechanism(last.beliefs, last.actions, sparse.csr_array(scale @ weighed + rest), last.regrets)
