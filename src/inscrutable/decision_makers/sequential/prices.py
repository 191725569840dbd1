"""The two prices of a sequential rule, and their long-run means."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from inscrutable import validation
from inscrutable.decision_makers.sequential.step import Prices
from inscrutable.errors import InputError
from inscrutable.saved import Saved, Summarised, saved_choice
from inscrutable.validation import Array

_SQUARED = "SquaredError()"


def loss_text(loss: float, lost: str) -> str:
    """Return a mean loss in words: of a square error its root, in units of belief."""
    return f"error {np.sqrt(loss):.4f}" if lost == _SQUARED else f"loss {loss:.4g} ({lost})"


@saved_choice
class PriceStatus(Enum):
    """Where the prices of a sequential rule come from; the text says what to do about it.

    Example:
        >>> PriceStatus.CALIBRATED.value
        'calibrated: the simulated long-run regret is the budget'
    """

    CALIBRATED = "calibrated: the simulated long-run regret is the budget"
    MIXED_PRICE = (
        "mixed: the long-run regret jumps over the budget as the price changes, so one of two prices is drawn once, before the "
        "first step, and is public; the budget holds on average over that draw"
    )
    WITHIN_ERROR = (
        "within its error: the simulated long-run regret differs from the budget by at most three standard errors, which are "
        "large; the rule may cost more than the budget, or less"
    )
    BELOW = (
        "below: at no price is the simulated long-run regret the budget, it is less; what public observations tell, a cap, or "
        "too few decisions may be the cause"
    )
    SILENT = "silent: the budget affords the best constant decision, which reveals nothing"
    GIVEN = "given: the prices were not calibrated, so no long-run regret is promised"


@dataclass(frozen=True, eq=False, repr=False)
class PriceCalibration(Summarised, Saved):
    """Prices of regret and information, and the long-run means that were simulated at them.

    Args:
        regret_prices: s, shape (n,): one price, or two of which one is drawn; in loss per unit of regret, or in nats per
            unit of regret where the price of information is infinite.
        information_price: λ, in loss per nat; infinite where information alone counts.
        shares: Probabilities of the prices, shape (n,).
        regret: Simulated long-run mean regret under the observer's law, in the cost's unit; NaN where it was not simulated.
        regret_se: Its standard error.
        loss: Simulated long-run mean loss of the observer.
        loss_se: Its standard error.
        bits: Simulated information a step.
        budget: The regret asked for.
        status: Where the prices come from.
        lost: The observer's loss in words.

    Raises:
        InputError: A price is negative, or the shares do not sum to one.

    Source: the long-run averages of the rule, simulated with common random numbers.

    Example:
        >>> PriceCalibration.at(100.0, float("inf")).status.name
        'GIVEN'
    """

    regret_prices: Array
    information_price: float
    shares: Array
    regret: float = float("nan")
    regret_se: float = float("nan")
    loss: float = float("nan")
    loss_se: float = float("nan")
    bits: float = float("nan")
    budget: float = float("nan")
    status: PriceStatus = PriceStatus.GIVEN
    lost: str = _SQUARED

    def __post_init__(self) -> None:
        prices = validation.finite_array(self.regret_prices, "regret_prices", ndim=1)
        shares = validation.stochastic_rows(self.shares, "shares", ndim=1)
        if not len(prices) or prices.shape != shares.shape or prices.min() < 0:
            raise InputError(f"prices of at least 0 with a share each are needed, got {prices} and {shares}")
        if not (
            isinstance(self.information_price, (int, float, np.integer, np.floating)) and self.information_price >= 0
        ):
            raise InputError(f"information_price must be at least 0, got {self.information_price!r}")
        object.__setattr__(self, "regret_prices", prices)
        object.__setattr__(self, "shares", shares)
        validation.read_only(self, "regret_prices", "shares")

    @classmethod
    def at(cls, regret_price: float, information_price: float) -> PriceCalibration:
        """Return given prices, without a simulation."""
        return cls(np.array([validation.non_negative(regret_price, "regret_price")]), information_price, np.ones(1))

    def prices(self, index: int) -> Prices:
        """Return the prices of one draw."""
        return Prices(float(self.regret_prices[index]), float(self.information_price))

    def caution(self) -> str:
        """Return a sentence where the long-run regret may well be another than the budget, by simulation; else nothing."""
        if self.status is not PriceStatus.WITHIN_ERROR:
            return ""
        off, error = (each / self.budget for each in (self.regret - self.budget, self.regret_se))
        return (
            "The budget of the sequential rule is met only within the error of its simulation: the long-run regret is "
            f"{off:+.0%} from it, with a standard error of {error:.0%}."
        )

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        listed = " or ".join(
            f"{price:.6g} ({share:.1%})" for price, share in zip(self.regret_prices, self.shares, strict=True)
        )
        alone = "information alone" if np.isinf(self.information_price) else f"{self.information_price:.4g} a nat"
        return "\n".join(
            [
                f"price of regret       {listed}",
                f"price of information  {alone}",
                f"long-run regret       {self.regret:.4g} ± {self.regret_se:.2g} of {self.budget:.4g}",
                f"observer's            {loss_text(self.loss, self.lost)}, {self.bits:.4f} bits a step",
                f"status                {self.status.value}",
            ]
        )
