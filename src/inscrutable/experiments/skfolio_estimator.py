"""A portfolio that hides its belief, as a scikit-learn estimator for skfolio's walk-forward tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.decision_makers import CounterAdversarialDecisionMaker, OriginalDecisionMaker
from inscrutable.errors import InputError
from inscrutable.filtering import filter_beliefs
from inscrutable.problems import MarkowitzProblem
from inscrutable.worlds import GaussianEmission, fit_gaussian_hmm

try:
    from skfolio.optimization import BaseOptimization as _Base
    from sklearn.utils.validation import validate_data
except ImportError:
    _Base, validate_data = object, None


class PrivatePortfolio(_Base):  # type: ignore[misc]
    """An skfolio estimator: counter-adversarial weights under fitted regimes, long only and fully invested.

    Formula: `fit` fits a Gaussian hidden Markov model to X, predicts the belief one step after the last row, and takes the
    decision of `CounterAdversarialDecisionMaker` for it; a budget of 0 gives the optimal weights. `predict`, as in every
    skfolio estimator, holds them over later returns.

    Args:
        regimes: Number of regimes, at least 1.
        budget: Budget for hiding, a share of the optimal cost, at least 0.
        risk_aversion: γ of c(i,u) = γ u'Σ_i u − μ_i'u; skfolio's λ is γ, and PyPortfolioOpt's δ, with a
            term ½ δ u'Σu, is 2 γ.
        restarts: Number of starts of the fit.
        random_state: Seed of the restarts, a whole number; the same data give the same weights.
        portfolio_params: As in any skfolio estimator.

    Raises:
        InputError: skfolio is not installed, or at `fit` a parameter is out of range.

    Cost: the fit's. Source: the paper, eq. (8); skfolio (Delatte, Nicolini, Manzi, 2024).

    Example:
        >>> import numpy as np, pandas as pd
        >>> draws = np.random.default_rng(0).normal(0.01, 0.05, (60, 3))
        >>> fitted = PrivatePortfolio(budget=0.2, restarts=2).fit(pd.DataFrame(draws, columns=["A", "B", "C"]))
        >>> fitted.weights_.shape, round(float(fitted.weights_.sum()), 9)
        ((3,), 1.0)
    """

    def __init__(
        self,
        regimes: int = 2,
        budget: float = 0.1,
        risk_aversion: float = 5.0,
        restarts: int = 5,
        random_state: int = 0,
        portfolio_params: dict[str, Any] | None = None,
    ) -> None:
        if _Base is object:
            raise InputError("PrivatePortfolio needs skfolio: pip install 'inscrutable[data]'")
        super().__init__(portfolio_params=portfolio_params)
        self.regimes, self.budget, self.risk_aversion = regimes, budget, risk_aversion
        self.restarts, self.random_state = restarts, random_state

    def fit(self, X: Any, y: Any = None) -> PrivatePortfolio:
        """Find the weights for the period after the returns X (T,U); y is not used."""
        returns = validate_data(self, X, dtype=np.float64, ensure_min_samples=2)
        rng = np.random.default_rng(self.random_state)
        fitted = fit_gaussian_hmm(returns, self.regimes, rng=rng, n_restarts=self.restarts)
        emission = fitted.world.emission
        assert isinstance(emission, GaussianEmission)
        problem = MarkowitzProblem(emission.means, emission.covariances, self.risk_aversion)
        held = np.asarray(filter_beliefs(fitted.world, returns).beliefs)[-1] @ fitted.world.transition
        open_book = OriginalDecisionMaker(problem)
        maker = open_book if self.budget == 0 else CounterAdversarialDecisionMaker(problem, budget=self.budget)
        self.decision_ = maker.decide(held)
        self.belief_, self.weights_ = held, np.asarray(self.decision_.action)
        return self
