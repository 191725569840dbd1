"""Decisions about private means, by command: `inscrutable protect --alphas`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from inscrutable.cli_console import Speech, results, show_table
from inscrutable.cli_values import DATA, INVESTOR, PRIVACY, UsageError, Whole, budget_of

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

    from inscrutable.alphas import AlphaDecisionMaker

_BUDGET = "0.5"


@Parameter(name="*")
@dataclass(frozen=True)
class AlphaOptions:
    """What `--alphas` needs beside the alphas.

    Args:
        alphas: CSV of private means instead of a belief: dates, then one column per asset.
        prior_covariance: With `--alphas`: CSV of the public covariance of the alphas, each row a draw of its own.
        world: With `--alphas`: JSON of the public linear Gaussian world that moves them.
        covariance: With `--alphas`: CSV of the assets' covariance.
        returns: With `--alphas`: CSV of returns that the assets' covariance is estimated from.
        factors: With `--returns`: principal factors of that covariance, and specific variances. Default: all of it.
        risk_aversion: With `--alphas`: γ in γ u'Vu − m'u.
        trading_cost: With `--alphas`: κ, trading costs κ times the risk of what is traded.
        objective: With `--alphas`: tell the fewest bits, or leave the largest mean square error.
    """

    alphas: Annotated[Path | None, Parameter(group=DATA)] = None
    prior_covariance: Annotated[Path | None, Parameter(group=DATA)] = None
    world: Annotated[Path | None, Parameter(group=DATA)] = None
    covariance: Annotated[Path | None, Parameter(group=DATA)] = None
    returns: Annotated[Path | None, Parameter(group=DATA)] = None
    factors: Annotated[Whole | None, Parameter(group=DATA)] = None
    risk_aversion: Annotated[float | None, Parameter(group=INVESTOR)] = None
    trading_cost: Annotated[float | None, Parameter(group=INVESTOR)] = None
    objective: Annotated[Literal["information", "error"], Parameter(group=PRIVACY)] = "information"

    def check(self, others: dict[str, Any]) -> None:
        """Raise `UsageError` where options do not go together; `others` are those of beliefs that were given."""
        mine = {name: value for name, value in vars(self).items() if value not in (None, "information")}
        if self.alphas is None:
            if mine:
                raise UsageError(f"--{next(iter(mine)).replace('_', '-')} belongs to --alphas")
            return
        given = [name for name, value in others.items() if value is not None]
        if given:
            raise UsageError(f"--alphas takes no --{given[0]}: the private means take the place of a belief")
        for one, other in (("prior_covariance", "world"), ("covariance", "returns")):
            if (one in mine) == (other in mine):
                raise UsageError(f"--alphas needs one of --{one.replace('_', '-')} and --{other}")
        if self.factors is not None and self.returns is None:
            raise UsageError("--factors are of the covariance that --returns gives")
        if self.risk_aversion is None:
            raise UsageError("--alphas needs --risk-aversion, such as 5")

    def maker(self, budget: str | None) -> AlphaDecisionMaker:
        """Return the rule that the files and numbers say."""
        from inscrutable.alphas import AlphaDecisionMaker, AlphaProblem, FactorRisk
        from inscrutable.budgets import Budget
        from inscrutable.datasets import read_returns
        from inscrutable.experiments.alpha_files import read_linear_world

        if self.covariance is not None:
            risk: Any = _square(self.covariance)
        else:
            assert self.returns is not None
            history = read_returns(self.returns)
            risk = history.cov() if self.factors is None else FactorRisk.from_returns(history, self.factors)
        assert self.risk_aversion is not None
        asked = budget_of(_BUDGET if budget is None else budget)
        return AlphaDecisionMaker(
            AlphaProblem(risk, self.risk_aversion, trading_cost=self.trading_cost),
            asked if isinstance(asked, Budget) else asked.share,
            prior_covariance=_square(self.prior_covariance),
            world=None if self.world is None else read_linear_world(self.world),
            objective=self.objective,
        )


def _square(path: Path | None) -> pd.DataFrame | None:
    from inscrutable.datasets import read_labelled_matrix

    return None if path is None else read_labelled_matrix(path, is_square=True)


def protect_means(
    options: AlphaOptions,
    budget: str | None,
    state: Path | None,
    publish: bool,
    rng: np.random.Generator | None,
    speech: Speech,
) -> None:
    """Show what the rule costs and tells, and the decisions that were drawn."""
    from inscrutable.datasets import read_signals
    from inscrutable.experiments.alpha_protect import LAW_IS_PUBLIC, protect_alphas

    assert options.alphas is not None
    speech.log(LAW_IS_PUBLIC)
    found = protect_alphas(options.maker(budget), read_signals(options.alphas), state, publish=publish, rng=rng)
    if speech.json:
        speech.summary(found.figures())
        return
    if found.decisions:
        show_table((100.0 * found.table()).round(2).astype(str), "Decisions, in percent")
    for line in found.summary().splitlines():
        results().print(line)
