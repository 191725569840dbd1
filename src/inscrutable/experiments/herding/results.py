"""Results of social learning: herding, regret and leakage of agents who see each other's decisions."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
import pandas as pd

from inscrutable.saved import Saved, Summarised, saved_choice
from inscrutable.validation import Array


@saved_choice
class HerdStatus(Enum):
    """Whether figures are exact or simulated, and what counts as herding.

    Example:
        >>> HerdStatus.EXACT.value
        'exact: all public beliefs that can be reached'
    """

    EXACT = "exact: all public beliefs that can be reached"
    SIMULATED = "simulated paths, the public belief of each followed exactly"
    MAJORITIES = (
        "simulated paths with signals of unbounded strength, in fine cells or drawn: no cascade begins, and right and wrong "
        "count the paths on which most decisions are so"
    )


@dataclass(frozen=True, eq=False, repr=False)
class SocialLearning(Summarised, Saved):
    """Results of N agents who decide in turn, each given its own signal and all decisions before.

    Formula: π_n ∝ q_{n−1}(x) p(y_n|x), u_n ~ K(·|π_n), q_n ∝ q_{n−1}(x) Σ_y p(y|x) K(u_n|π(q_{n−1},y)).

    Args:
        public_beliefs: q_N, shape (S,X): every reachable one, or one per path.
        right: Probability that a cascade on a right decision has begun after N decisions. In a cascade no signal changes the
            law of the next decision. It is right if the likeliest decision is optimal in the true state; in a problem without
            finite choices, if its regret is least in the true state. With the status MAJORITIES: the share of paths with more
            than half of the decisions right.
        wrong: Probability that a cascade on a wrong decision has begun.
        none: Probability of neither; the three sum to one.
        welfare: Σ_n E ρ(x,u_n), expected sum of regrets under the true state, in the cost's unit; smaller is better.
        joint: Joint probability of public belief and true state, shape (S,X).
        herds: right, wrong and none after 0..N decisions, shape (N+1,3).
        regrets: E ρ(x,u_n) of every agent, shape (N,).
        prices: E ρ(π_n,u_n) of every agent, shape (N,): the part of its regret due to hiding; the rest is due to its
            limited information.
        leakages: I(π_n;u_n|q_{n−1}) of every agent, shape (N,), in bits: leakage of its decision about its private belief to an
            observer who knows its rule and the decisions before; 0 is perfect privacy.
        truths: E q_n(x), mean probability of the true state under the public belief after 0..N decisions, shape (N+1,).
        welfare_error: Standard error of the welfare; 0 for exact figures, without that of drawn signals.
        n_paths: Number of simulated paths; 0 for exact figures.
        status: How the figures were found.
        n_drawn: Number of signals drawn from each state for a sensor without symbols or cells, else 0. Their error, the same on
            all paths, is in no standard error: other draws show it.

    Source: Bikhchandani, Hirshleifer and Welch (1992); Smith and Sørensen (2000); `social_learning` makes it.

    Example:
        >>> from inscrutable import CategoricalEmission, FiniteProblem, social_learning
        >>> guess, sensor = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), CategoricalEmission([[0.7, 0.3], [0.3, 0.7]])
        >>> print(social_learning(guess, sensor, n_agents=100))
        100 agents: right cascade 75.3%, wrong 24.7%, none 0.0%
        regret 24.82 in all, 0.2468 of the last; leakage 1.0000 bits of the first, 0.0000 of the last
        exact: all public beliefs that can be reached
    """

    public_beliefs: Array
    right: float
    wrong: float
    none: float
    welfare: float
    joint: Array
    herds: Array
    regrets: Array
    prices: Array
    leakages: Array
    truths: Array
    welfare_error: float
    n_paths: int
    status: HerdStatus
    n_drawn: int = 0

    @property
    def n_agents(self) -> int:
        """Number of agents N."""
        return len(self.regrets)

    @property
    def errors(self) -> Array:
        """Standard errors of right, wrong and none, shape (3,); 0 for exact figures, without that of drawn signals."""
        shares = np.array([self.right, self.wrong, self.none])
        return np.sqrt(shares * (1.0 - shares) / self.n_paths) if self.n_paths else np.zeros(3)

    def frame(self) -> pd.DataFrame:
        """Return one row per agent: herding after its decision, regret, leakage, public probability of the true state."""
        return pd.DataFrame(
            {
                **dict(zip(("right", "wrong", "none"), self.herds[1:].T, strict=True)),
                "regret": self.regrets,
                "bits": self.leakages,
                "truth": self.truths[1:],
            },
            index=pd.RangeIndex(1, self.n_agents + 1, name="agent"),
        )

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        what = "majority" if self.status is HerdStatus.MAJORITIES else "cascade"
        drawn = (
            f"\nstandard errors leave out that of {self.n_drawn} signals drawn from each state" if self.n_drawn else ""
        )
        return (
            f"{self.n_agents} agents: right {what} {self.right:.1%}, wrong {self.wrong:.1%}, none {self.none:.1%}\n"
            f"regret {self.welfare:.4g} in all, {self.regrets[-1]:.4g} of the last; leakage {self.leakages[0]:.4f} bits of the "
            f"first, {self.leakages[-1]:.4f} of the last\n{self.status.value}{drawn}"
        )


class Simulation(NamedTuple):
    """How figures were simulated; the defaults mean exact figures."""

    welfare_error: float = 0.0
    n_paths: int = 0
    status: HerdStatus = HerdStatus.EXACT
    n_drawn: int = 0


def found_of(
    beliefs: Array,
    joint: Array,
    herds: Array,
    turns: Array,
    truths: Array,
    how: Simulation = Simulation(),  # noqa: B008
) -> SocialLearning:
    """Return the result, from public beliefs (S,X) with their joint law, and each turn's regret, price and bits, (N,3)."""
    right, wrong, none = (float(each) for each in herds[-1])
    regrets, prices, leakages = np.ascontiguousarray(turns.T)
    welfare = float(regrets.sum())
    return SocialLearning(beliefs, right, wrong, none, welfare, joint, herds, regrets, prices, leakages, truths, *how)
