"""The paper's portfolio: mean-variance in a market with regimes."""

from __future__ import annotations

from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError
from inscrutable.problems.constraints import Polyhedron, checked_region, simplex
from inscrutable.problems.quadratic import QuadraticProblem


class MarkowitzProblem(QuadraticProblem):
    """A mean-variance portfolio whose means and covariances depend on the regime.

    Formula: c(i,u) = γ u'Σ_i u − μ_i'u, without ½, over {u ≥ 0, 1'u = 1} unless constraints are given.

    Args:
        means: μ_i, shape (X,U), return per period as a fraction. Labelled means, covariances and constraints are aligned with
            each other, and labelled arguments of later calls with them.
        covariances: Σ_i, shape (X,U,U), squared return per period; a list or a mapping of frames has labels too.
        risk_aversion: γ > 0, per unit of return.
        constraints: The feasible set; None is `simplex(U)`.

    Raises:
        InputError: Shapes disagree, an entry is not finite, γ is not above zero.
        ModelError: A covariance is indefinite (its smallest eigenvalue is named) or the feasible set is empty.

    Cost: one active-set quadratic programme per belief. Source: the paper, eq. (7).

    Example:
        >>> import numpy as np
        >>> calm, crisis = np.diag([0.01, 0.04]), np.diag([0.09, 0.05])
        >>> problem = MarkowitzProblem([[0.02, 0.03], [-0.03, 0.0]], [calm, crisis], risk_aversion=1.0)
        >>> print(problem.solve([1.0, 0.0]).round(2))
        [0.7 0.3]
    """

    def __init__(
        self,
        means: ArrayLike,
        covariances: ArrayLike,
        risk_aversion: float,
        constraints: Polyhedron | None = None,
    ) -> None:
        states, assets = Axis("state", learns=True), Axis("asset", learns=True)
        self.means = validation.finite_array(means, "means", ndim=2, axes=(states, assets))
        self.covariances = validation.finite_array(covariances, "covariances", ndim=3, axes=(states, assets, assets))
        n_states, n_assets = self.means.shape
        if not self.means.size:
            raise InputError(f"means has shape {self.means.shape}, expected at least one state and one asset")
        if self.covariances.shape != (n_states, n_assets, n_assets):
            raise InputError(
                f"covariances have shape {self.covariances.shape}, expected {(n_states, n_assets, n_assets)} "
                f"for means of shape {self.means.shape}"
            )
        for i, covariance in enumerate(self.covariances):
            validation.check_positive_semidefinite(covariance, f"covariances[{i}]", "a cost must be convex")
        self.risk_aversion = validation.positive(risk_aversion, "risk_aversion")
        super().__init__(
            2.0 * self.risk_aversion * self.covariances,
            -self.means,
            constraints=checked_region(
                simplex(n_assets) if constraints is None else constraints, n_assets, assets, lifts=True
            ),
        )
        self.state_names = states.names

    def __repr__(self) -> str:
        n_states, n_assets = self.means.shape
        return f"MarkowitzProblem({n_states} states, {n_assets} assets, risk aversion {self.risk_aversion:g})"
