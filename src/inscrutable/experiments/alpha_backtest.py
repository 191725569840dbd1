"""The cost of hiding alphas, and the gain of a rival who copies, month by month."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from inscrutable import validation
from inscrutable.alphas import AlphaDecisionMaker
from inscrutable.axes import Axis
from inscrutable.errors import InputError
from inscrutable.labels import label_text
from inscrutable.validation import Array

_POINTS = 1e4  # basis points
_FIRST = 24  # months that a signal needs


@dataclass(frozen=True, eq=False)
class AlphaBacktest:
    """The worth of an agent's alphas by its own belief, the regret of hiding them, and a copier's gain, one row per month.

    Args:
        maker: The rule.
        index: Labels of the months.
        worth: The gain of the optimum for the alphas over the constant decision, shape (T,), per month.
        given_up: The regret of the published decision, shape (T,).
        taken: Gain of a rival who plays the published decision at the same time, above the constant one, shape (T,).
        realised: Returns of the constant, the published and the optimal decision, shape (T,3); None without returns.
        bits: Leakage of each decision by the observer's law, shape (T,).
        errors: (m − m̂)'Q(m − m̂), m̂ the observer's mean after the decision, shape (T,).
        period: Name of the period of a row, such as "month".
    """

    maker: AlphaDecisionMaker
    index: tuple[Any, ...]
    worth: Array
    given_up: Array
    taken: Array
    realised: Array | None
    bits: Array
    errors: Array
    period: str = "month"

    def caution(self) -> str:
        """Return a sentence where the alphas vary more than the returns that they forecast; else nothing.

        Formula: without limits the worth is m'V⁻¹m / 4γ, and a forecast that explains all of n returns has E[m'V⁻¹m] = n.
        """
        problem = self.maker.problem
        explained = 4.0 * problem.risk_aversion * float(self.worth.mean()) / problem.n_assets
        if explained <= 1.0:
            return ""
        return (
            f"Caution: the alphas are {np.sqrt(explained):.3g} times as large as forecasts that explain all of the returns' "
            "variance (are they in per cent?): no figure here can be trusted."
        )

    def table(self) -> pd.DataFrame:
        """Return one row a month, in basis points and bits."""
        found = pd.DataFrame(
            {"worth": self.worth, "given up": self.given_up, "taken": self.taken},
            index=pd.Index([label_text(each) for each in self.index], name=self.period),
        )
        if self.realised is not None:
            found[["constant", "published", "optimal"]] = self.realised
        return (_POINTS * found).assign(bits=self.bits, error=self.errors)

    def figures(self) -> dict[str, Any]:
        """Return the means as plain data, in basis points and bits; each figure stands with its expectation under the law."""
        maker, points = self.maker, _POINTS
        means = (points * float(each.mean()) for each in (self.worth, self.given_up, self.taken))
        worth, given, taken = means
        silence, regret = points * maker.silence_regret, points * maker.regret
        realised = None if self.realised is None else (points * self.realised.mean(axis=0)).tolist()
        return {
            "period": self.period,
            "n_periods": len(self.worth),
            "worth": {"mean": worth, "by_law": silence},
            "given_up": {"mean": given, "by_law": regret},
            "taken": {"mean": taken, "by_law": silence - regret},
            "bits": {"mean": float(self.bits.mean()), "by_law": maker.bits},
            "error": {"mean": float(self.errors.mean()), "by_law": maker.error},
            "ceiling": maker.ceiling,
            "objective": maker.objective,
            "status": maker.status.value,
            "cautions": [*filter(None, [self.caution()])],
            "realised": realised
            if realised is None
            else dict(zip(("constant", "published", "optimal"), realised, strict=True)),
        }

    def summary(self) -> str:
        """Return a few lines: monthly means beside their expectations under the law of the alphas."""
        found = self.figures()

        def line(name: str, what: str, number: str, of: str = "") -> str:
            mean, law = found[what]["mean"], found[what]["by_law"]
            share = f", {mean / found[of]['mean']:.0%} of the worth" if of and found[of]["mean"] > 0 else ""
            return f"{name:<24}{format(mean, number)} ({format(law, number)}){share}"

        lines = [
            f"basis points a {self.period}, {len(self.worth)} {self.period}s, by the agent's belief; in brackets by the law of "
            "the alphas",
            line("worth of the alphas", "worth", ".2f"),
            line("regret of hiding", "given_up", ".2f", "worth"),
            line("gain of a copier", "taken", ".2f", "worth"),
            line("leakage, bits", "bits", ".3f"),
            line("mean square error", "error", ".4g"),
        ]
        if found["realised"] is not None:
            constant, published, optimal = found["realised"].values()
            lines.append(
                f"{'realised returns':<24}{optimal:.2f} optimal, {published:.2f} published, {constant:.2f} constant"
            )
        return "\n".join(filter(None, [*lines, self.caution()]))

    __str__ = summary


def alpha_backtest(
    maker: AlphaDecisionMaker, alphas: pd.DataFrame, returns: pd.DataFrame | None = None, *, rng: np.random.Generator
) -> AlphaBacktest:
    """Return the cost of hiding alphas by a rule, and the gain of a rival who copies, month by month.

    Formula: with c(u) = γ u'Vu − m'u, the worth is c(u₀) − c(u*), u₀ the constant decision; given up is c(u) − c(u*), taken
    c(u₀) − c(u). Their sum is the worth in every month: a rival who copies gains exactly what hiding does not give up.
    If the alphas follow the law, their means are tr(ΘS), tr(ΘE) and tr(ΘS) − tr(ΘE).

    Args:
        maker: The rule; without trading costs.
        alphas: Private means, (T,k), one row a month, labelled by the problem's signals.
        returns: Returns of the assets in the month after each row's decision, (T,n), same labels; None: no realised returns.
        rng: The source of the draws.

    Raises:
        InputError: Labels disagree, a table is no DataFrame, or the problem has trading costs.

    Cost: O(k²) per month, plus that of the rule.

    Example:
        >>> from inscrutable import AlphaProblem
        >>> maker = AlphaDecisionMaker(AlphaProblem([[0.04]], 2.5), 0.25, prior_covariance=[[4e-4]])
        >>> means = pd.DataFrame([[0.02], [-0.01]], index=["May", "June"])
        >>> found = alpha_backtest(maker, means, rng=np.random.default_rng(0))
        >>> np.allclose(found.given_up + found.taken, found.worth)
        True
    """
    if not isinstance(maker, AlphaDecisionMaker):
        raise InputError(f"maker must be an AlphaDecisionMaker, got {maker!r}")
    problem = maker.problem
    if problem.trading_cost:
        raise InputError(
            f"the problem has a trading cost of {problem.trading_cost:g}: a month's decision is then part of many"
        )
    for name, table in (("alphas", alphas), ("returns", returns)):
        if not isinstance(table, pd.DataFrame) and not (table is None and name == "returns"):
            raise InputError(f"{name} must be a DataFrame with one row a month, got {type(table).__name__}")
    means = np.atleast_2d(problem.check_mean(alphas, "alphas"))
    earned = None
    if returns is not None:
        if not alphas.index.equals(returns.index):
            raise InputError(
                "returns have other rows than alphas; expected what was earned in the month after each of them"
            )
        axes = (None, Axis("asset", problem.asset_names))
        earned = validation.finite_array(returns, "returns", ndim=2, axes=axes)
        if earned.shape[1] != problem.n_assets:
            raise InputError(f"returns have {earned.shape[1]} columns, expected one per asset: {problem.n_assets}")
    path = maker.decide_path(means, rng=validation.generator(rng))
    constant = problem.optimum(maker.start_mean)
    worth = np.asarray(problem.regret(means, constant))
    realised = None
    if earned is not None:
        best = problem.optimum(means)
        realised = np.column_stack(
            [earned @ constant, (earned * path.actions).sum(axis=1), (earned * best).sum(axis=1)]
        )
    risk, actions = problem.risk, path.actions
    gained = ((actions - constant) * problem.alphas(means)).sum(axis=1)
    taken = gained - problem.risk_aversion * (risk.quadratic(actions.T) - risk.quadratic(constant))
    missed = means - path.estimates
    errors = ((missed @ maker.weights) * missed).sum(axis=1)
    return AlphaBacktest(maker, tuple(alphas.index), worth, path.regrets, taken, realised, path.bits, errors)


def momentum_alphas(returns: pd.DataFrame, strength: float = 0.05) -> pd.DataFrame:
    """Return momentum alphas: mean returns over the past year without its last month, standardised across assets.

    Formula: m = strength · σ_i · z_i, with z_i the standard score of the mean return of rows t−12 … t−2 among the assets,
    and σ_i the asset's standard deviation over all rows before t. A row uses earlier rows only; the first 24 rows have no
    signal.

    Args:
        returns: Simple returns, one row a month, (T,n).
        strength: The assumed information coefficient of the signal, above 0.

    Raises:
        InputError: There are no more than 24 rows, or the strength is not above 0.

    Cost: O(T n). Source: Jegadeesh and Titman, Journal of Finance 48 (1993); for the scale Grinold, Journal of Portfolio
    Management 20 (1994).

    Example:
        >>> from inscrutable.datasets import load_industry_returns
        >>> momentum_alphas(load_industry_returns().returns).shape
        (795, 12)
    """
    scale = validation.positive(strength, "strength")
    if len(returns) <= _FIRST:
        raise InputError(f"returns have {len(returns)} rows, expected more than {_FIRST}")
    past = returns.shift(2).rolling(11).mean()
    scores = past.sub(past.mean(axis=1), axis=0).div(past.std(axis=1), axis=0)
    spread = returns.shift(1).expanding().std()
    return (scale * spread * scores).iloc[_FIRST:]
