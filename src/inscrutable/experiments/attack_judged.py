"""Whether published weights hide the beliefs behind them, where these beliefs are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from inscrutable.errors import InputError
from inscrutable.experiments.attack import Attack, Reading
from inscrutable.experiments.attack_over_time import AttackOverTime
from inscrutable.experiments.holding import Reached, Requirement, estimate_quality
from inscrutable.labels import label_text
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel

_NAIVE = "the naive observer, who takes the weights at face value"
_AWARE = "the aware observer, who knows the rule and sees all rows so far"


@dataclass(frozen=True)
class JudgedAttack:
    """What observers read from published weights, compared with the beliefs behind them.

    Args:
        asked: The requirement for a belief to count as hidden; without weights an observer estimates the stationary law.
        reached: The error of each observer, and how often it names the likeliest regime.
        n_rows: Number of rows.
        n_unread: Rows that no belief explains, left out of the naive observer's figures.
    """

    asked: Requirement
    reached: tuple[Reached, ...]
    n_rows: int
    n_unread: int

    def figures(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return {
            "error_without_weights": self.asked.error_without,
            "named_without_weights": self.asked.chance,
            "observers": [each._asdict() | {"is_hidden": self.asked.is_met(each)} for each in self.reached],
            "n_rows": self.n_rows,
            "n_unread": self.n_unread,
        }

    def summary(self) -> str:
        """Return from whom the beliefs are hidden, a line for each observer, and what hidden means."""
        if self.n_rows == 1:
            errors = "; ".join(f"{each.name} errs by {each.error:.3f}" for each in self.reached)
            return f"Compared with your own belief: {errors}; an observer without weights by {self.asked.error_without:.3f}."
        left_out = f" ({self.n_unread} that no belief explains left out)" if self.n_unread else ""
        lines = [f"Compared with your own beliefs in {self.n_rows} rows{left_out}:"]
        for each in self.reached:
            verdict = "not known" if np.isnan(each.error) else "yes" if self.asked.is_met(each) else "no"
            lines.append(f"Hidden from {each.name}: {verdict} ({self.asked.compare(each)}).")
        return "\n".join([*lines, self.asked.meaning(without="weights", state="regime", cases="the rows")])


def judge_attack(attack: Attack, beliefs: pd.DataFrame, over_time: AttackOverTime | None = None) -> JudgedAttack:
    """Return whether weights hide the beliefs behind them.

    Args:
        attack: From `attack_weights`: the naive observer's reading of the weights.
        beliefs: The investor's own beliefs, one column per regime of the model; a row for every row of weights, by label.
        over_time: From `attack_over_time`: the aware observer's reading of the same weights.

    Raises:
        InputError: Regimes or rows are missing.

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
        Hidden from the naive observer, who takes the weights at face value: no (error 0.00 < 0.34, named 100% > 67%).
    """
    held = _aligned(attack, beliefs)
    unread = np.array([row.reading is Reading.IMPLAUSIBLE for row in attack.rows])
    world = attack.model.world
    long_run = HiddenMarkovModel(world.transition, world.emission).initial
    reached = [Reached(_NAIVE, *estimate_quality(np.where(unread[:, None], np.nan, attack.estimates), held))]
    if over_time is not None:
        reached.append(Reached(_AWARE, *estimate_quality(over_time.inferred.mean, held)))
    asked = Requirement(*estimate_quality(np.tile(long_run, (len(held), 1)), held))
    return JudgedAttack(asked, tuple(reached), len(held), int(unread.sum()))


def _aligned(attack: Attack, beliefs: pd.DataFrame) -> Array:
    """Return the beliefs (T,X) of the rows of weights, in the model's order of regimes."""
    regimes = list(attack.model.regimes)
    if set(beliefs.columns) != set(regimes) or len(beliefs.columns) != len(regimes):
        raise InputError(f"beliefs have the columns {list(beliefs.columns)}, expected the model's regimes: {regimes}")
    missing = [label for label in attack.index if label not in beliefs.index]
    if missing or not beliefs.index.is_unique:
        what = f"no row for {label_text(missing[0])}" if missing else "several rows under one label"
        raise InputError(
            f"beliefs have {what}, expected one row for each of the {len(attack)} rows of weights, under the same date or label"
        )
    return np.asarray(beliefs.loc[attack.index, regimes].to_numpy(dtype=np.float64))
