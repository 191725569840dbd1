"""Trading with costs: the rate and the aim of trades for a time-varying private mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inscrutable import tolerances
from inscrutable.alphas.problem import AlphaProblem
from inscrutable.errors import InputError, ModelError
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class TradingPolicy:
    """The optimal trading where m is known: u_t = (1 − rate) u_{t−1} + rate · u*(ahead · m_t).

    Formula: q = (−γ + √(γ² + 4γκ))/2, rate = q/κ, ahead = (I + (q/γ)(I − A))⁻¹; deciding for m̂ instead of m costs in the
    long run (m̂ − m)'Θ(m̂ − m) a step, Θ = weight · ahead' Θ₀ ahead with weight = rate² (γ + κ + q)/γ and Θ₀ that without
    trading costs.

    Args:
        rate: Share of the distance to the aim that is traded, from 0 to 1; 1 without trading costs.
        ahead: Discount of means by their decay, shape (k,k).
        weight: Of Θ₀, above 0.

    Source: Gârleanu and Pedersen, Journal of Finance 68 (2013), propositions 1 and 2 without discounting.
    """

    rate: float
    ahead: Array
    weight: float

    def theta(self, free: Array) -> Array:
        """Return Θ for the Θ₀ of free trading, both (k,k)."""
        return np.asarray(self.weight * self.ahead.T @ free @ self.ahead)

    def aim(self, problem: AlphaProblem, mean: Array, centre: Array) -> Array:
        """Return the aim of trading for a mean (k,) that reverts to `centre`."""
        return problem.optimum(centre + self.ahead @ (mean - centre))


def trading_policy(problem: AlphaProblem, transition: Array) -> TradingPolicy | None:
    """Return the optimal trading for m_{t+1} = A m_t + ω; None without trading costs.

    Raises:
        InputError: The problem also has inequalities, for which no such rule is known.
        ModelError: The mean grows faster than trading follows, so the mean cost is infinite.
    """
    gamma, kappa = problem.risk_aversion, problem.trading_cost
    if not kappa:
        return None
    if problem.has_inequalities:
        raise InputError(
            f"trading_cost is {kappa:g} and the constraints have inequalities: no rule is known for both; leave one "
            "of them out"
        )
    value = 2.0 * gamma * kappa / (gamma + np.sqrt(gamma * (gamma + 4.0 * kappa)))
    rate = value / kappa
    radius = float(np.abs(np.linalg.eigvals(transition)).max(initial=0.0))
    if (1.0 - rate) * radius >= 1.0 - tolerances.STABLE:
        raise ModelError(
            f"the mean grows by {radius:.6g} a step and trading follows at a rate of {rate:.6g}: (1 − rate) times the spectral "
            f"radius is {(1.0 - rate) * radius:.6g}, expected less than 1"
        )
    identity = np.eye(len(transition))
    ahead = np.linalg.inv(identity + value / gamma * (identity - transition))
    return TradingPolicy(float(rate), ahead, float(rate**2 * (gamma + kappa + value) / gamma))
