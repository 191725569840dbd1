"""The interface of observers of single decisions: a set or posterior, and a point estimate of the belief."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from numpy.typing import ArrayLike

from inscrutable.validation import Array


@runtime_checkable
class Adversary(Protocol):
    """An observer of single decisions.

    Source: the paper, Section III-B; Kerckhoffs' principle for observers who know the rule.

    Example:
        >>> from inscrutable import BayesianAdversary
        >>> issubclass(BayesianAdversary, Adversary)
        True
    """

    def infer(self, action: ArrayLike) -> Any:
        """Return everything the observer concludes from one decision: a set of beliefs, or a posterior."""

    def estimate(self, action: ArrayLike, *, nearest: bool = False) -> Array:
        """Return the observer's guess at the belief, shape (X,); NaN where the observer cannot explain the decision.

        With `nearest` there is an estimate even then: from the nearest decision, or belief, that it can explain.
        """

    def estimates(self, actions: ArrayLike, *, nearest: bool = False) -> Array:
        """Return `estimate` for many decisions, shape (M,X)."""
