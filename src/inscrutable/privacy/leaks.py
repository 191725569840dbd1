"""Leakage to the aware observer: information, errors and guesses, with the regret of the mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from inscrutable import tolerances
from inscrutable.errors import InputError
from inscrutable.mechanisms import Disclosure, Mechanism, Prior
from inscrutable.mechanisms.disclosed import disclosed, single_decisions
from inscrutable.mechanisms.joint import Joint, joint_law
from inscrutable.mechanisms.matching import checked_mechanism
from inscrutable.mechanisms.priors import checked_prior
from inscrutable.privacy.losses import Loss, checked_loss, on_simplex
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False, repr=False)
class Leakage(Summarised, Saved):
    """Leakage of one decision to the aware observer, who knows the mechanism and the prior.

    Formula: with p(b,u) = w_b K(u|π_b), p(u) = Σ_b p(b,u) and μ_u = E[π|u], the fields below.

    Args:
        mutual_information: I(π;u) = Σ p(b,u) log2(K(u|π_b)/p(u)), in bits.
        bayes_error: √Σ p(b,u) ‖π_b − μ_u‖², the root mean square error of the best estimate; Euclidean, in units of belief.
        prior_error: √Σ w_b ‖π_b − Σ w π‖², the same before any decision is seen: the largest possible.
        top_state_accuracy: Σ_u max_i Σ_b p(b,u) [i is a most likely state of π_b]: how often the best guess of the most
            likely state is right. Where states tie in a belief, each of them counts as right.
        min_entropy_leakage: log2(Σ_u max_b p(b,u) / max_b w_b), in bits: the gain of one guess at the belief.
        maximal_leakage: log2 Σ_u max_{b: w_b>0} K(u|π_b), in bits: the largest min-entropy leakage of any prior on these
            beliefs, and of any guess at any function of the belief.
        expected_regret: Σ p(b,u) ρ(π_b,u), in the cost's unit.
        worst_regret: The largest ρ(π_b,u) of any decision that is played with w_b > 0, in the cost's unit.
        prior_entropy: −Σ w_b log2 w_b, in bits: an upper bound of the leakage.
        prior_top_state_accuracy: max_i Σ_b w_b [i is a most likely state of π_b].
        n_beliefs: Number of beliefs with weight.
        n_actions: Number of distinguishable decisions of positive probability.
        least_error: The error √Σ_u K(u|π_b) ‖π_b − μ_u‖² of the least hidden belief with weight.
        largest_error: This error of the best hidden belief with weight.
        worst_expected_regret: max_b Σ_u K(u|π_b) ρ(π_b,u) over beliefs with weight, in the cost's unit.
        silence_regret: r₀ = min_u Σ w_b ρ(π_b,u), the least regret of a constant decision; NaN where no problem was given.
        pointwise_leakage: max_u log2 max_{b: w_b>0} K(u|π_b)/p(u), in bits: as the maximal leakage, but after the decision
            that leaks most instead of on average.
        bayes_loss: Σ_u p(u) L(p(·|u)), the mean loss of a rival who sees the decision; in L's unit, as the next three. L is
            the square error where no other was given.
        prior_loss: L(w), the same before any decision is seen.
        worth: W = prior_loss − bayes_loss, the value of the decision to the rival: 0 where the decision reveals nothing.
        secret_worth: L(w) − Σ w_b L(δ_b), the value of the belief itself to the rival: no decision is worth more.
        loss: The loss.

    Source: Shannon (1948); Smith, On the foundations of quantitative information flow (2009), for min-entropy leakage;
    Issa, Wagner and Kamath, An operational approach to information leakage (2020), for maximal leakage; Saeidian, Cervia,
    Oechtering and Skoglund, Pointwise maximal leakage (2023).

    Example:
        >>> from inscrutable import FiniteProblem, OriginalDecisionMaker, mechanism, uniform_prior
        >>> problem, prior = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), uniform_prior(2, 3)
        >>> found = leakage(mechanism(OriginalDecisionMaker(problem), prior.beliefs), prior, problem)
        >>> found.mutual_information, found.prior_entropy, found.top_state_accuracy
        (1.0, 2.0, 1.0)
    """

    mutual_information: float
    bayes_error: float
    prior_error: float
    top_state_accuracy: float
    min_entropy_leakage: float
    maximal_leakage: float
    expected_regret: float
    worst_regret: float
    prior_entropy: float = float("nan")
    prior_top_state_accuracy: float = float("nan")
    n_beliefs: int = 0
    n_actions: int = 0
    least_error: float = float("nan")
    largest_error: float = float("nan")
    worst_expected_regret: float = float("nan")
    silence_regret: float = float("nan")
    pointwise_leakage: float = float("nan")
    bayes_loss: float = float("nan")
    prior_loss: float = float("nan")
    worth: float = float("nan")
    secret_worth: float = float("nan")
    loss: str = ""

    @property
    def silence_share(self) -> float:
        """Expected regret as a share of the silence regret r₀; NaN where r₀ is not known or zero."""
        return self.expected_regret / self.silence_regret if self.silence_regret > 0 else float("nan")

    @property
    def error_share(self) -> float:
        """Bayes error as a share of the prior-only error; NaN where the prior leaves none."""
        return self.bayes_error / self.prior_error if self.prior_error > 0 else float("nan")

    @property
    def worth_share(self) -> float:
        """The decision's value to the rival as a share of the belief's; NaN where the belief has none."""
        return self.worth / self.secret_worth if self.secret_worth > 0 else float("nan")

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        share = "" if np.isnan(self.silence_share) else f" ({self.silence_share:.1%} of the silence regret)"
        lines = [
            f"against the aware observer, who knows the mechanism; {self.n_beliefs} beliefs, {self.n_actions} played decisions",
            f"information  {self.mutual_information:.4f} of {self.prior_entropy:.4f} bits "
            f"(min-entropy leakage {self.min_entropy_leakage:.4f}, maximal leakage {self.maximal_leakage:.4f})",
            f"error        {self.bayes_error:.4f} of {self.prior_error:.4f} without the decision "
            f"(between {self.least_error:.4f} and {self.largest_error:.4f} by belief)",
            f"top state    named rightly {self.top_state_accuracy:.1%}, "
            f"without the decision {self.prior_top_state_accuracy:.1%}",
            f"regret       {self.expected_regret:.4g} expected{share}, {self.worst_regret:.4g} at worst",
        ]
        if self.loss:
            told = "" if np.isnan(self.worth_share) else f" ({self.worth_share:.1%})"
            lines.append(
                f"worth        {self.worth:.4g} of the secret's {self.secret_worth:.4g}{told} to the rival: its loss is "
                f"{self.bayes_loss:.4g}, without the decision {self.prior_loss:.4g} ({self.loss})"
            )
        return "\n".join(lines)


def leakage(
    mechanism: Mechanism,
    prior: Prior,
    problem: DecisionProblem | None = None,
    *,
    loss: Loss | None = None,
    disclosure: Disclosure | str | None = None,
) -> Leakage:
    """Return the leakage of one decision of a mechanism to the aware observer, who knows mechanism and prior.

    Formula: those of `Leakage`.

    Args:
        mechanism: K(u|π) with the regrets.
        prior: Weights of the mechanism's beliefs, in any order; it may hold only some of them.
        problem: The decision problem, for the silence regret r₀ = V(Σ w π) − Σ w V(π), exact because costs are linear in
            the belief; None leaves it out.
        loss: The rival's loss, `NamingError()` or `RivalProblem(problem)`; None is the square error.
        disclosure: What is disclosed of a decision, such as `at_least(0.05)`, also as text; None is all of it. Regrets are
            those of the decisions themselves.

    Raises:
        InputError: A belief of the prior is none of the mechanism's, a problem has another number of states, `loss` is none, or
            the disclosure does not suit the decisions, leaves some out, or needs returns.

    Cost: a few passes over the entries of K that are not zero; a second for 2,000 beliefs and 2,000 decisions.

    Source: see `Leakage`.

    Example:
        >>> from inscrutable import Mechanism, Prior
        >>> prior = Prior([[1.0, 0.0], [0.0, 1.0]], [0.5, 0.5])
        >>> silent = Mechanism(prior.beliefs, [[0.0]], [[1.0], [1.0]], [[0.1], [0.3]])
        >>> found = leakage(silent, prior)
        >>> found.mutual_information, found.expected_regret
        (0.0, 0.2)
    """
    shown = single_decisions(Disclosure.of(disclosure), "leakage")
    joint = joint_law(disclosed(checked_mechanism(mechanism), shown) if shown.maps else mechanism, prior)
    held, weights = joint.weights > 0, joint.weights
    regrets, (row, column) = mechanism.expected_regrets, mechanism.sparse[held].nonzero()
    mean = weights @ joint.beliefs
    spread = float(weights @ ((joint.beliefs - mean) ** 2).sum(axis=1))
    by_belief = joint.by_belief(joint.squared_errors)[held]
    top = np.asarray(joint.table.T @ joint.top_states)
    best_guess = float(joint.largest_by_action(joint.mass).sum() / weights.max())
    silence = float("nan") if problem is None else silence_regret(problem, joint.beliefs, weights)
    checked_prior(prior, problem)
    return Leakage(
        mutual_information=mutual_information(joint),
        bayes_error=float(np.sqrt(joint.mass @ joint.squared_errors)),
        prior_error=float(np.sqrt(spread)),
        top_state_accuracy=_share(top.max(axis=1).sum()),
        min_entropy_leakage=_bits(best_guess),
        maximal_leakage=_bits(joint.largest_by_action(joint.conditional).sum()),
        expected_regret=float(weights @ regrets),
        worst_regret=float(mechanism.regrets[held][row, column].max()),
        prior_entropy=entropy(weights),
        prior_top_state_accuracy=_share((weights @ joint.top_states).max()),
        n_beliefs=int(held.sum()),
        n_actions=int((joint.played > 0).sum()),
        least_error=float(np.sqrt(by_belief.min())),
        largest_error=float(np.sqrt(by_belief.max())),
        worst_expected_regret=float(regrets[held].max()),
        silence_regret=silence,
        pointwise_leakage=_bits((joint.conditional / joint.played[joint.column]).max()),
        **_worths(joint, problem, loss),
    )


def _worths(joint: Joint, problem: DecisionProblem | None, given: Loss | None) -> dict[str, Any]:
    """The rival's loss with and without the decision, and the value of the decision and of the belief.

    A value is a mean of nonnegative differences, the loss of the prior's best answer minus L: 0 for a constant decision.
    """
    loss = checked_loss(given, joint.beliefs.shape[1], problem)
    held, shown = joint.weights > 0, joint.played > 0
    weights, beliefs = joint.weights[held], joint.beliefs[held]
    mean = on_simplex((weights @ beliefs)[None])
    secret = float(weights @ loss.excess(beliefs, mean))
    worth = min(
        float(joint.played[shown] @ loss.excess(on_simplex(joint.means[shown]), mean)), secret
    )  # up to rounding
    known = float(weights @ loss.least(beliefs))
    return {
        "bayes_loss": known + (secret - worth),
        "prior_loss": known + secret,
        "worth": worth,
        "secret_worth": secret,
        "loss": "" if given is None else loss.unit,
    }


def silence_regret(problem: DecisionProblem, beliefs: Array, weights: Array) -> float:
    """Return r₀ = min_u Σ w_b ρ(π_b,u) = V(Σ w π) − Σ w_b V(π_b), in the cost's unit; 0 where it is a rounding of V."""
    if checked_problem(problem).n_states != beliefs.shape[1]:
        raise InputError(f"the problem has {problem.n_states} states, the beliefs {beliefs.shape[1]}")
    some = weights > 0
    costs = problem.optimal_cost(beliefs[some])
    found = float(problem.optimal_cost(weights @ beliefs)) - float(weights[some] @ costs)
    return found if found > tolerances.COST_ROUNDING * float(np.abs(costs).max()) else 0.0


def mutual_information(joint: Joint) -> float:
    """Return I(π;u), in bits."""
    found = float(joint.mass @ np.log2(joint.conditional / joint.played[joint.column]))
    return max(found, 0.0)  # rounding only


def entropy(probabilities: Array) -> float:
    """Return −Σ p log2 p, in bits."""
    held = probabilities[probabilities > 0]
    return float(-(held * np.log2(held)).sum()) + 0.0


def _bits(factor: Any) -> float:
    return max(float(np.log2(factor)), 0.0)  # at least one by definition, up to rounding


def _share(value: Any) -> float:
    return min(float(value), 1.0)  # at most one by definition, up to rounding
