"""The decisions of a sequential rule along a path of beliefs, and the observer's estimates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from inscrutable import validation
from inscrutable.decision_makers.sequential.prices import PriceStatus, loss_text
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False, repr=False)
class PathDecisions(Summarised, Saved):
    """Decisions along a path of T beliefs.

    Args:
        actions: u_t, shape (T,U); (T,) whole numbers where decisions are finite choices.
        regrets: ρ(π_t,u_t), shape (T,), in the cost's unit.
        observer_means: The observer's estimates E[π_t | what is seen by step t], shape (T,X).
        losses: The observer's expected loss at step t, shape (T,): E[‖π_t − mean_t‖² | what is seen], or another.
        bits: I(π_t; u_t | u_0..u_{t−1}) of the step under the observer's law before it, shape (T,).
        status: Where the prices come from.
        expected_regrets: Mean regret of the step under the observer's law before it, shape (T,).
        own_regrets: Mean regret of the step under the true belief, shape (T,).
        n_off_grid: Number of steps whose belief is not on the law's grid. Such a belief plays as the nearest belief of the
            grid, which the observer's law counts; the calibration does not count the regret under the belief itself.
        lost: The observer's loss in words.

    Source: Bayes' rule at every step.

    Example:
        >>> one = np.zeros(1)
        >>> path = PathDecisions(np.array([0]), one, np.eye(2)[:1], one, one, PriceStatus.GIVEN, one, one, 0)
        >>> len(path)
        1
    """

    actions: Any
    regrets: Array
    observer_means: Array
    losses: Array
    bits: Array
    status: PriceStatus
    expected_regrets: Array
    own_regrets: Array
    n_off_grid: int
    lost: str = "SquaredError()"

    def __post_init__(self) -> None:
        validation.read_only(
            self, "actions", "regrets", "observer_means", "losses", "bits", "expected_regrets", "own_regrets"
        )

    def __len__(self) -> int:
        return len(self.regrets)

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        lines = [
            f"{len(self)} decisions",
            f"regret            mean {self.regrets.mean():.4g}, expected by the observer {self.expected_regrets.mean():.4g}",
            f"observer's        {loss_text(float(np.mean(self.losses)), self.lost)}",
            f"information       {self.bits.mean():.4f} bits a step",
        ]
        if self.n_off_grid:
            lines.append(f"off the grid      {self.n_off_grid} beliefs, which play as the nearest on it")
        return "\n".join([*lines, f"prices            {self.status.value}"])
