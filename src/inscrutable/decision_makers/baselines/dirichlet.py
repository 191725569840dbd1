"""Noise on the weights of a portfolio."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.decision_makers.baselines.candidate_lotteries import CandidateLotteries
from inscrutable.decision_makers.baselines.lottery import CandidateLottery
from inscrutable.decision_makers.candidate_sources import is_simplex
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.results import DecisionStatus
from inscrutable.errors import InputError
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


class DirichletDecisionMaker(CandidateLottery):
    """The optimal weights with Dirichlet noise, rounded to the nearest candidate.

    Formula: u = the candidate nearest to w, w ~ Dirichlet(κ u*(π)), so that E[w] = u*(π) and Var w_j = w̄_j(1 − w̄_j)/(κ + 1)
    with w̄ = u*(π). Weights of zero stay zero: the noise adds no asset.

    Rounding makes the lottery finite. Its probabilities are frequencies in `n_draws` draws. Their quantile levels are drawn
    once, from `rng`, and used for every belief, so that a belief always has the same lottery; this lottery is played, and its
    leakage measured. It approximates the continuous noise where `n_draws` is large compared with the number of candidates
    near u*(π); with fewer draws beliefs share decisions less often, and more leaks.

    Args:
        problem: A decision problem over the simplex {u ≥ 0 : Σu = 1}.
        concentration: κ, above 0; the larger, the less noise.
        candidates: Decisions to round to; None is about 5,000 decoys. Equal ones count once; inadmissible ones and those that
            no belief explains are left out.
        n_draws: Number of draws per lottery, at least 1.
        rng: Source of the levels.

    Raises:
        InputError: An argument is malformed, the feasible set is not the simplex, or no candidate is left.

    Cost: `n_draws` quantiles for each weight that is not zero, and as many nearest candidates, per belief. Source: the
    Dirichlet mechanism of Gohari, Wu, Hawkins, Hale and Topcu, Differential privacy on the unit simplex (2021).

    Example:
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> found = DirichletDecisionMaker(problem, 1e6, rng=np.random.default_rng(0)).decide([0.5, 0.5])
        >>> bool(np.abs(found.actions - 0.5).max() < 0.01)
        True
    """

    _shown = ("concentration",)

    def __init__(
        self,
        problem: DecisionProblem,
        concentration: float,
        *,
        rng: np.random.Generator,
        candidates: Candidates | ArrayLike | None = None,
        n_draws: int = 1000,
    ) -> None:
        super().__init__(problem, candidates)
        if problem.is_discrete or not is_simplex(problem):
            raise InputError(
                f"Dirichlet noise needs portfolio weights on the simplex, constraints=None; got {problem!r}"
            )
        self.concentration = validation.positive(concentration, "concentration")
        n_draws = validation.count(n_draws, "n_draws")
        # A level of zero would have no logarithm.
        self._levels = np.maximum(validation.generator(rng).random((n_draws, problem.n_actions)), np.finfo(float).tiny)

    def _lotteries(self, beliefs: Array) -> CandidateLotteries:
        from scipy.spatial import cKDTree

        optimal = np.atleast_1d(self.problem.optimal_cost(beliefs))
        held = self.candidates.actions[self.choices]
        tree, n_draws = cKDTree(held), len(self._levels)
        rows = []
        for weights in self.problem.solve_points(beliefs):
            _, place = tree.query(dirichlet_quantiles(self.concentration * weights, self._levels))
            rows.append(np.unique(place, return_counts=True))
        widest = max(len(place) for place, _ in rows)
        places = np.array([np.pad(place, (0, widest - len(place)), mode="edge") for place, _ in rows])
        shares = np.array([np.pad(met / n_draws, (0, widest - len(met))) for _, met in rows])
        numbers = self.choices[places]
        costs = (self.candidates.state_costs[numbers] * beliefs[:, None]).sum(axis=2)
        regrets = np.maximum(costs - optimal[:, None], 0.0)
        statuses = (DecisionStatus.RULE_OF_THUMB,) * len(beliefs)
        return CandidateLotteries(self.problem, self.candidates, beliefs, numbers, shares, regrets, optimal, statuses)


def dirichlet_quantiles(shapes: Array, levels: Array) -> Array:
    """Return points of a Dirichlet law with parameters (U,) at levels in (0, 1), shape (n,U): normalised gamma quantiles.

    Parameters of zero give weights of zero.
    """
    from scipy.special import gammaincinv, gammaln

    some = np.flatnonzero(shapes > 0)
    held, level = shapes[some], levels[:, some]
    with np.errstate(divide="ignore"):
        logs = np.log(gammaincinv(held, level))
    # P(a, x) ≈ x^a / Γ(a + 1) for small x, also where x underflows and P does not.
    logs = np.where(np.isfinite(logs), logs, (np.log(level) + gammaln(held + 1.0)) / held)
    found = np.exp(logs - logs.max(axis=1, keepdims=True))
    points = np.zeros(levels.shape)
    points[:, some] = found / found.sum(axis=1, keepdims=True)
    return points
