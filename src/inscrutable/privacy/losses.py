"""A rival's loss from not knowing the belief: a concave Bayes risk of its law."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from inscrutable.errors import InputError
from inscrutable.problems import DecisionProblem, FiniteProblem, checked_problem
from inscrutable.validation import Array


class Loss(ABC):
    """The loss of a rival that does not know the belief.

    Formula: L(p) = min_a Σ p(π) ℓ(π,a), the Bayes risk of a law p of the belief: concave, and least, L(δ_π), where the belief
    is known. For all losses here the best answer depends on the mean E[π] of the law alone.

    Attributes:
        unit: Its unit, in words.

    Source: DeGroot, Uncertainty, information, and sequential experiments (1962).

    Example:
        >>> isinstance(SquaredError(), Loss)
        True
    """

    unit: str

    @abstractmethod
    def least(self, beliefs: Array) -> Array:
        """Return L(δ_π), the loss where the belief is known, for beliefs (n,X): shape (n,)."""

    @abstractmethod
    def excess(self, beliefs: Array, estimates: Array) -> Array:
        """Return the loss beyond L(δ_π), at least 0, of the best answer to an estimate.

        Beliefs (n,X) and estimates (n,X) are paired; a single one of either stands for all: shape (n,).
        """

    def bayes_risk(self, laws: Array, beliefs: Array) -> Array:
        """Return L(p) of laws (…,B) on beliefs (B,X): shape (…)."""
        means = np.asarray(laws) @ beliefs
        return np.asarray(laws @ self.least(beliefs) + self._forgone(laws, beliefs, means))

    @abstractmethod
    def _forgone(self, laws: Array, beliefs: Array, means: Array) -> Array:
        """Return L(p) − Σ p L(δ_π) ≥ 0 of laws (…,B) whose means (…,X) are known."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"


class SquaredError(Loss):
    """The square error of the best estimate of the belief, the default loss.

    Formula: ℓ(π,a) = ‖π − a‖², so that L(p) = Σ p(π) ‖π − E[π]‖²: a variance.

    Source: the estimate of least mean square error is the posterior mean.

    Example:
        >>> from inscrutable import Prior
        >>> prior = Prior([[1.0, 0.0], [0.0, 1.0]], [0.5, 0.5])
        >>> print(SquaredError().bayes_risk(prior.weights, prior.beliefs))
        0.5
    """

    unit = "squared units of belief"

    def least(self, beliefs: Array) -> Array:
        """Return zeros, the loss where the belief is known."""
        return np.zeros(len(beliefs))

    def excess(self, beliefs: Array, estimates: Array) -> Array:
        """Return ‖π − estimate‖²."""
        return np.asarray(((beliefs - estimates) ** 2).sum(axis=-1))

    def _forgone(self, laws: Array, beliefs: Array, means: Array) -> Array:
        centre = beliefs.mean(axis=0)  # squares about the middle lose few digits
        return np.maximum(laws @ self.excess(beliefs, centre) - self.excess(means, centre), 0.0)


class DecisionLoss(Loss):
    """A loss that is the cost of a rival's decision, in a problem on the same states.

    Example:
        >>> RivalProblem(FiniteProblem([[0.0, 1.0], [1.0, 0.0]])).rival(2)
        FiniteProblem(2 states, 2 choices)
    """

    @abstractmethod
    def rival(self, n_states: int) -> DecisionProblem:
        """Return the rival's decision problem on `n_states` states."""

    def least(self, beliefs: Array) -> Array:
        """Return V(π)."""
        return _values(self.rival(beliefs.shape[-1]), np.atleast_2d(beliefs))

    def excess(self, beliefs: Array, estimates: Array) -> Array:
        """Return π·s(a) − V(π) with the rival's best decision a under the estimate."""
        held, problem = np.atleast_2d(beliefs), self.precise(beliefs.shape[-1])
        costs = problem.state_costs(problem.solve(on_simplex(np.atleast_2d(estimates))))
        return np.asarray(np.maximum((held * costs).sum(axis=-1) - _values(problem, held), 0.0))

    def precise(self, n_states: int) -> DecisionProblem:
        """Return the rival's problem without costs that all its decisions share, to full precision."""
        return self.rival(n_states).without_common_costs

    def _forgone(self, laws: Array, beliefs: Array, means: Array) -> Array:
        problem = self.precise(beliefs.shape[-1])
        found = _values(problem, on_simplex(means.reshape(-1, means.shape[-1]))).reshape(means.shape[:-1])
        return np.asarray(np.maximum(found - laws @ _values(problem, beliefs), 0.0))


class RivalProblem(DecisionLoss):
    """The Bayes risk of a rival's own decision problem.

    Formula: ℓ(π,a) = Σ_i π_i c(i,a) with the rival's costs c, so that L(p) = V(E[π]), V(π) = min_a Σ_i π_i c(i,a).

    Args:
        problem: The rival's decision problem on the same states, in its own unit. Costs are linear in the belief, so that its
            best decision is the optimal one for the mean of its law.

    Raises:
        InputError: `problem` is no decision problem.

    Cost: one decision of the rival per law. Source: Blackwell, Equivalent comparisons of experiments (1953): the
    value of an observation is the gain of a decision problem.

    Example:
        >>> from inscrutable import FiniteProblem, Prior
        >>> wager = RivalProblem(FiniteProblem([[-1.0, 0.0], [1.0, 0.0]]))  # win or lose 1, or stay out
        >>> prior = Prior([[1.0, 0.0], [0.0, 1.0]], [0.5, 0.5])
        >>> print(wager.bayes_risk(prior.weights, prior.beliefs), wager.least(prior.beliefs))
        0.0 [-1.  0.]
    """

    unit = "the rival's cost"

    def __init__(self, problem: DecisionProblem) -> None:
        self.problem = checked_problem(problem)

    def rival(self, n_states: int) -> DecisionProblem:
        """Return the rival's problem; raise `InputError` where it has another number of states."""
        if self.problem.n_states != n_states:
            raise InputError(f"the rival's problem has {self.problem.n_states} states, the beliefs {n_states}")
        return self.problem

    def __repr__(self) -> str:
        return f"RivalProblem({self.problem!r})"


class NamingError(DecisionLoss):
    """The probability that the rival names the wrong state.

    Formula: ℓ(π,i) = 1 − π_i, so that L(p) = 1 − max_i E[π]_i.

    Source: Smith, On the foundations of quantitative information flow (2009).

    Example:
        >>> from inscrutable import Prior
        >>> prior = Prior([[0.9, 0.1], [0.2, 0.8]], [0.5, 0.5])
        >>> print(NamingError().bayes_risk(prior.weights, prior.beliefs).round(3))
        0.45
    """

    unit = "share of states named wrongly"

    def rival(self, n_states: int) -> DecisionProblem:
        """Return the choice of a state, at cost 1 for each but the true one."""
        return FiniteProblem(1.0 - np.eye(n_states))


def checked_loss(loss: Any, n_states: int, problem: DecisionProblem | None = None) -> Loss:
    """Return a loss on `n_states` states, those of the agent's problem where it is given; the square error for None.

    Raises:
        InputError: It is no loss, or on other states, or the rival's problem names them otherwise than the agent's.
    """
    if loss is None:
        return SquaredError()
    if not isinstance(loss, Loss):
        raise InputError(f"loss must be SquaredError(), NamingError(), RivalProblem(problem) or None, got {loss!r}")
    if isinstance(loss, DecisionLoss):
        other = loss.rival(n_states).state_names
        own = None if problem is None else problem.state_names
        if own is not None and other is not None and tuple(own) != tuple(other):
            raise InputError(
                f"the rival's problem has the state labels {list(other)}, expected {list(own)} in the same order"
            )
    return loss


def loss_of_rule(loss: Any, n_states: int, problem: DecisionProblem) -> Loss:
    """Return a loss against which rules are solved: the square error itself, or one with a rival's problem.

    Raises:
        InputError: As `checked_loss`, or it is another loss: a rule for the square error would be taken for a rule for it.
    """
    found = checked_loss(loss, n_states, problem)
    if type(found) is not SquaredError and not isinstance(found, DecisionLoss):
        raise InputError(
            f"no rule is made against the loss {loss!r}: give SquaredError(), NamingError() or RivalProblem(problem), also "
            "of a problem of your own; `leakage` judges every rule by any loss"
        )
    return found


def on_simplex(means: Array) -> Array:
    """Return means (n,X) of beliefs, projected on the simplex to remove rounding."""
    held = np.maximum(means, 0.0)
    return np.asarray(held / held.sum(axis=-1, keepdims=True))


def _values(problem: DecisionProblem, beliefs: Array) -> Array:
    return np.atleast_1d(np.asarray(problem.optimal_cost(beliefs), dtype=np.float64))
