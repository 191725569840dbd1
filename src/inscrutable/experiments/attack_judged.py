"""Whether published weights hide the beliefs behind them, where these beliefs are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from inscrutable import validation
from inscrutable.errors import InputError
from inscrutable.experiments.attack import Attack, Reading
from inscrutable.experiments.attack_over_time import AttackOverTime
from inscrutable.experiments.holding import (
    Reached,
    Requirement,
    StateRanking,
    best_ranking,
    estimate_quality,
    requirement_of,
)
from inscrutable.labels import label_text
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel

_MISLED = 1.1
"""Factor of the error without weights beyond which the aware observer's is too large; .85 is met under the sequential rule on
the packaged returns, 1.14 with two columns of the beliefs exchanged."""
_OVERCONFIDENT = 2.0
"""Factor of its expected error beyond which the aware observer assumes another rule than that of the weights: beside the true
rule the factor is .9 to 1.9 on the packaged and on simulated returns, 2.4 to 13 with a tenth to ten times its budget."""
_NAIVE = "the naive observer, who takes the weights at face value"
_AWARE = "the aware observer, who knows the rule and sees all rows so far"


class JudgedObserver(NamedTuple):
    """The errors of one observer over the rows that it could read.

    `asked` is the requirement for the beliefs of these rows to count as hidden; None where no row was read, and where the
    stationary law, which an observer without weights estimates, is not unique. `n_off` is the number of rows that the assumed
    rule does not play. If they are the majority, or if the error is far above `expected`, the error under the true rule, then
    the observer is misled by a wrong rule and not by these weights.
    """

    reached: Reached
    asked: Requirement | None
    n_read: int
    n_off: int = 0
    ranking: StateRanking | None = None
    expected: float = float("inf")

    @property
    def is_hidden(self) -> bool | None:
        """Whether the beliefs are hidden from it; None where that is not known, and for a single row."""
        if self.asked is None or self.n_read < 2 or 2 * self.n_off > self.n_read or self.is_misled:
            return None
        return self.asked.is_met(self.reached)

    @property
    def is_misled(self) -> bool:
        """Whether the beliefs would count as hidden although the aware observer errs far more than it expects, or more than
        without weights: the assumed rule, or the beliefs, are then not those of the weights."""
        if self.asked is None or self.n_read < 2 or not self.asked.is_met(self.reached):
            return False
        odd = min(_OVERCONFIDENT * self.expected, _MISLED * self.asked.error_without)
        return bool(self.reached.name == _AWARE and self.reached.error > odd)

    def summary(self, regimes: Sequence[str]) -> str:
        """Return the verdict in one sentence, with what the observer's estimate nevertheless tells."""
        if self.n_read == 0:
            return f"Hidden from {self.reached.name}: not known, as no belief explains any row."
        if 2 * self.n_off > self.n_read > 1:
            return (
                f"Hidden from {self.reached.name}: cannot be judged, as {self.n_off} of {self.n_read} rows are none that this "
                f"rule plays (error {self.reached.error:.2f})."
            )
        if self.is_misled and self.asked is not None:
            return (
                f"Hidden from {self.reached.name}: cannot be judged, as it errs by {self.reached.error:.2f}, where it expects "
                f"{self.expected:.2f}, and {self.asked.error_without:.2f} without weights: see whether the rule, its budget "
                "and the model are those of the weights, and these beliefs too, each under its regime's name."
            )
        if self.is_hidden is None or self.asked is None:
            without = "" if self.asked is None else f"; without weights the error is {self.asked.error_without:.3f}"
            return f"Error of {self.reached.name}: {self.reached.error:.3f}{without}."
        verdict = f"Hidden from {self.reached.name}: {'yes' if self.is_hidden else 'no'} ({self.asked.compare(self.reached)})."
        if not self.is_hidden:
            return verdict
        told = self.asked.caution(self.reached.named, self.ranking, regimes)
        return f"{verdict[:-1]}, but {told}" if told else verdict


@dataclass(frozen=True)
class JudgedAttack:
    """What observers read from published weights, compared with the beliefs behind them.

    Args:
        observers: The naive observer and, where its reading was given, the aware one.
        n_rows: Number of rows; the naive observer reads those that a belief explains.
        regimes: Names of the regimes.
    """

    observers: tuple[JudgedObserver, ...]
    n_rows: int
    regimes: tuple[str, ...]

    def figures(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return {
            "n_rows": self.n_rows,
            "observers": [
                {
                    **each.reached._asdict(),
                    "n_read": each.n_read,
                    "is_hidden": each.is_hidden,
                    "ranked_rightly": None if each.ranking is None else each.ranking.share,
                    "error_without_weights": None if each.asked is None else each.asked.error_without,
                    "named_by_chance": None if each.asked is None else each.asked.chance,
                }
                for each in self.observers
            ],
        }

    def summary(self) -> str:
        """Return from whom the beliefs are hidden, a line for each observer, and what hidden means."""
        left_out = self.n_rows - self.observers[0].n_read
        text = f"; the naive observer reads {self.observers[0].n_read} of them" if left_out else ""
        rows = "1 row" if self.n_rows == 1 else f"{self.n_rows} rows"
        meant = [
            each.asked.meaning(without="weights", state="regime", cases="the rows")
            for each in self.observers
            if each.asked is not None and each.is_hidden is not None
        ]
        lines = [
            f"Compared with your own beliefs in {rows}{text}:",
            *(each.summary(self.regimes) for each in self.observers),
        ]
        return "\n".join([*lines, *dict.fromkeys(meant)])


def judge_attack(attack: Attack, beliefs: pd.DataFrame, over_time: AttackOverTime | None = None) -> JudgedAttack:
    """Return whether weights hide the beliefs behind them.

    Args:
        attack: From `attack_weights`: the naive observer's reading of the weights.
        beliefs: The investor's own beliefs, one column per regime of the model; a row for every row of weights, by label.
        over_time: From `attack_over_time`: the aware observer's reading of the same weights.

    Raises:
        InputError: Regimes or rows are missing, or a row is no belief.

    Example:
        >>> from inscrutable import GaussianEmission, MarkowitzProblem
        >>> from inscrutable.experiments.attack import attack_weights
        >>> from inscrutable.experiments.investor_model import InvestorModel
        >>> sensor = GaussianEmission([[0.02, 0.0], [-0.03, 0.01]], [0.002 * np.eye(2), 0.006 * np.eye(2)])
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], sensor)
        >>> problem = MarkowitzProblem(sensor.means, sensor.covariances, 4.0)
        >>> model = InvestorModel(world, problem, ("A", "B"), ("calm", "turbulent"))
        >>> held = pd.DataFrame([[0.8, 0.2], [0.3, 0.7]], columns=["calm", "turbulent"])
        >>> published = pd.DataFrame(problem.solve(held.to_numpy()), columns=["A", "B"])
        >>> print(judge_attack(attack_weights(model, published), held).summary().splitlines()[1])
        Hidden from the naive observer, who takes the weights at face value: no (error 0.00 < 0.26, named 100% > 67%).
    """
    held = _aligned(attack, beliefs)
    read = np.array([row.reading is not Reading.IMPLAUSIBLE for row in attack.rows])
    world = attack.model.world
    found = [_observer(_NAIVE, world, attack.estimates[read], held[read])]
    if over_time is not None:
        found[0] = found[0]._replace(ranking=None)  # only the better informed observer is judged
        found.append(
            _observer(_AWARE, world, over_time.inferred.mean, held)._replace(
                n_off=over_time.n_off, expected=over_time.expected_error
            )
        )
    return JudgedAttack(tuple(found), len(held), attack.model.regimes)


def _observer(name: str, world: HiddenMarkovModel, estimates: Array, held: Array) -> JudgedObserver:
    asked = requirement_of(world, held) if len(held) else None
    reached = Reached(name, *estimate_quality(estimates, held))
    return JudgedObserver(reached, asked, len(held), ranking=best_ranking(estimates, held))


def _aligned(attack: Attack, beliefs: pd.DataFrame) -> Array:
    """Return the beliefs (T,X) of the rows of weights, in the model's order of regimes."""
    regimes = list(attack.model.regimes)
    if not isinstance(beliefs, pd.DataFrame):
        raise InputError(f"beliefs must be a DataFrame with one column per regime, got {type(beliefs).__name__}")
    if set(beliefs.columns) != set(regimes) or len(beliefs.columns) != len(regimes):
        raise InputError(f"beliefs have the columns {list(beliefs.columns)}, expected the model's regimes: {regimes}")
    missing = [label for label in attack.index if label not in beliefs.index]
    if missing or not beliefs.index.is_unique:
        what = f"no row for {label_text(missing[0])}" if missing else "several rows under one label"
        raise InputError(
            f"beliefs have {what}, expected one row for each of the {len(attack)} rows of weights, under the same date or label"
        )
    return validation.many_beliefs(beliefs.loc[attack.index, regimes].to_numpy(), len(regimes))
