"""Decisions about private means, by command: `inscrutable protect --alphas` and `inscrutable backtest --alphas`."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from inscrutable.cli_console import SEED_KNOWN, Speech, replaced, results, show_table
from inscrutable.cli_limits import Held, region_of
from inscrutable.cli_values import (
    DATA,
    INVESTOR,
    PRIVACY,
    UsageError,
    Whole,
    budget_of,
    check_labels,
    covariance_of,
    history_of,
)

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

    from inscrutable.alphas import AlphaDecisionMaker
    from inscrutable.budgets import Budget

_BUDGET = "0.5"
_MOMENTUM = "momentum"
_OF_A_BACKTEST = (
    "returns", "prices", "daily", "train_until", "riskless", "covariance", "risk_aversion", "budget", "seed", "out", "means",
    "speech",
)  # fmt: skip


@Parameter(name="*")
@dataclass(frozen=True)
class AlphaOptions:
    """Options that go with `--alphas`.

    Args:
        alphas: CSV of private means, such as expected returns, instead of a belief: dates, then one column per asset.
        prior_covariance: With `--alphas`: CSV of the public covariance of the alphas. Rows are then independent.
        world: With `--alphas`: JSON of the public linear Gaussian world by which the alphas move.
        public: With a `--world` that has a public sensor: CSV of its observations at each row, one column per number, in
            the order of the sensor's rows.
        covariance: With `--alphas`: CSV of the assets' covariance.
        returns: CSV of returns, as for `backtest`, up to the last row known. The model's filter computes the belief from them.
            With `--alphas` they give an estimate of the assets' covariance.
        factors: With `--alphas` and `--returns`: number of principal factors of that covariance, besides specific variances.
            Default: the sample covariance.
        risk_aversion: With `--alphas`: γ in the cost γ u'Vu − m'u, without a half.
        loadings: With `--alphas`: CSV of the loadings of assets on signals: assets in the first column, one column per signal.
            The alphas are then those of the signals. Default: one signal per asset.
        held: With `--alphas`: what may be held: anything; invested: weights that sum to one; long-only: these, none below zero.
        cap: With `--alphas`: largest weight, such as 0.25 or 25%.
        trading_cost: With `--alphas`: κ. A trade costs κ times its variance.
        objective: With `--alphas`: minimise the leakage in bits, or maximise the observer's mean square error.
    """

    alphas: Annotated[Path | None, Parameter(group=DATA)] = None
    prior_covariance: Annotated[Path | None, Parameter(group=DATA)] = None
    world: Annotated[Path | None, Parameter(group=DATA)] = None
    public: Annotated[Path | None, Parameter(group=DATA)] = None
    covariance: Annotated[Path | None, Parameter(group=DATA)] = None
    returns: Annotated[Path | None, Parameter(group=DATA)] = None
    factors: Annotated[Whole | None, Parameter(group=DATA)] = None
    risk_aversion: Annotated[float | None, Parameter(group=INVESTOR)] = None
    loadings: Annotated[Path | None, Parameter(group=DATA)] = None
    held: Annotated[Held | None, Parameter(group=INVESTOR)] = None
    cap: Annotated[str | None, Parameter(group=INVESTOR)] = None
    trading_cost: Annotated[float | None, Parameter(group=INVESTOR)] = None
    objective: Annotated[Literal["information", "error"], Parameter(group=PRIVACY)] = "information"

    def check(self, **others: Any) -> None:
        """Raise `UsageError` where options do not go together; `others` are those of beliefs."""
        mine = {name: value for name, value in vars(self).items() if value not in (None, "information")}
        if self.alphas is None:
            mine.pop("returns", None)  # of the model's assets
            if mine:
                raise UsageError(f"--{next(iter(mine)).replace('_', '-')} belongs to --alphas")
            return
        given = [name for name, value in others.items() if value is not None]
        if given:
            why = "the private means take the place of a belief"
            if given[0] == "out":
                why = "the results are only printed, as data with --json"
            raise UsageError(f"--alphas takes no --{given[0]}: {why}")
        for one, other in (("prior_covariance", "world"), ("covariance", "returns")):
            if (one in mine) == (other in mine):
                raise UsageError(f"--alphas needs one of --{one.replace('_', '-')} and --{other}")
        if self.factors is not None and self.returns is None:
            raise UsageError("--factors needs --returns, from which that covariance is estimated")
        if self.public is not None and self.world is None:
            raise UsageError("--public needs --world, whose public sensor it reports")
        if self.risk_aversion is None:
            raise UsageError("--alphas needs --risk-aversion, such as 5")

    def maker(self, budget: str | None, speech: Speech) -> AlphaDecisionMaker:
        """Return the rule of these files and numbers."""
        from inscrutable.alphas import AlphaDecisionMaker, AlphaProblem, FactorRisk
        from inscrutable.datasets import read_labelled_matrix
        from inscrutable.experiments.alpha_run import read_linear_world

        if self.covariance is not None:
            risk: Any = covariance_of(self.covariance)
        else:
            assert self.returns is not None
            history = history_of(self.returns)
            risk = history.cov() if self.factors is None else FactorRisk.from_returns(history, self.factors)
        names = [str(each) for each in (risk.names or () if isinstance(risk, FactorRisk) else risk.columns)]
        loads = None if self.loadings is None else read_labelled_matrix(self.loadings)
        prior = None if self.prior_covariance is None else covariance_of(self.prior_covariance)
        if prior is not None:
            source = self.loadings or self.covariance or self.returns
            assert self.prior_covariance is not None
            assert source is not None
            check_labels(
                self.prior_covariance, list(prior.columns), source, names if loads is None else list(loads.columns)
            )
        region = region_of(names, self.held or "anything", self.cap)
        assert self.risk_aversion is not None
        return AlphaDecisionMaker(
            AlphaProblem(risk, self.risk_aversion, region, loads, trading_cost=self.trading_cost),
            _budget(budget, speech),
            prior_covariance=prior,
            world=None if self.world is None else read_linear_world(self.world),
            objective=self.objective,
        )


def _budget(given: str | None, speech: Speech) -> Budget:
    """Return the regret per step; a share refers to the silence regret, and one of more than that gives a warning."""
    from inscrutable.budgets import Budget, SilenceShare

    asked = budget_of(_BUDGET if given is None else given)
    meant = SilenceShare(asked.amount) if isinstance(asked, Budget) and asked.is_relative else asked
    if meant.remark:
        speech.log(f"--budget {given}: {meant.remark}")
    return meant if isinstance(meant, Budget) else Budget(meant.share)


def protect_means(
    options: AlphaOptions,
    budget: str | None,
    state: Path | None,
    publish: bool,
    rng: np.random.Generator | None,
    speech: Speech,
) -> None:
    """Show the rule's cost and leakage, and the decisions that were drawn."""
    from inscrutable.datasets import read_signals
    from inscrutable.experiments.alpha_protect import LAW_IS_PUBLIC, protect_alphas, within_limits

    assert options.alphas is not None
    speech.log(LAW_IS_PUBLIC)
    read = None if options.public is None else read_signals(options.public)
    if read is not None:
        read = read.set_axis(range(read.shape[1]), axis=1)  # a world's file gives its public columns no labels
    means, maker = read_signals(options.alphas), within_limits(options.maker(budget, speech))
    found = protect_alphas(maker, means, state, public=read, publish=publish, rng=rng)
    if speech.json:
        speech.summary(found.figures())
        return
    if found.decisions:
        show_table((100.0 * found.table()).round(2).astype(str), "Decisions, in percent")
    for line in found.summary().splitlines():
        results().print(line)
    if publish and rng is not None:
        results().print(SEED_KNOWN)


@Parameter(name="*")
@dataclass(frozen=True)
class SignalOptions:
    """Private means instead of regimes in a backtest.

    Args:
        alphas: Private expected returns instead of regimes: "momentum", or a CSV of your own: dates, then one column per asset.
            A row is about the period after its date.
        prior_covariance: With `--alphas`: CSV of their public covariance. Rows are then independent.
        world: With `--alphas`: JSON of the public linear Gaussian world by which they move. Default: a law estimated from the
            alphas before the first decision.
        objective: With `--alphas`: minimise the leakage in bits, or maximise the observer's mean square error.
    """

    alphas: Annotated[str | None, Parameter(group=DATA)] = None
    prior_covariance: Annotated[Path | None, Parameter(group=DATA)] = None
    world: Annotated[Path | None, Parameter(group=DATA)] = None
    objective: Annotated[Literal["information", "error"] | None, Parameter(group=PRIVACY)] = None


def alphas_go_with(**options: Any) -> None:
    """Raise `UsageError` where options of a backtest do not go together; `options` are those that were given."""
    means: SignalOptions = options.get("means", SignalOptions())
    if means.alphas is None:
        given = _given(means)
        if given:
            raise UsageError(f"--{given[0]} belongs to --alphas")
        return
    for name, value in options.items():
        if name in _OF_A_BACKTEST:
            continue
        given = _given(value) if is_dataclass(value) else [name.replace("_", "-")]
        if given:
            option = "no-sequential" if given[0] == "sequential" and not value else given[0]
            raise UsageError(
                f"--alphas takes no --{option}: beside a backtest's data it takes --train-until, --riskless, --covariance, "
                "--risk-aversion, --budget, --objective, --prior-covariance and --world"
            )
    if means.prior_covariance is not None and means.world is not None:
        raise UsageError("--alphas needs at most one of --prior-covariance and --world")


def _given(options: Any) -> list[str]:
    return [
        each.name.replace("_", "-")
        for each in fields(options)
        if getattr(options, each.name) not in (None, each.default)
    ]


def backtest_means(
    options: SignalOptions,
    table: pd.DataFrame,
    riskless: pd.Series | None,
    settings: dict[str, Any],
    budget: str | None,
    folder: Path,
    speech: Speech,
) -> None:
    """Show the cost of hiding private means and a copier's gain, and write table, summary and figure."""
    from inscrutable.datasets import read_signals
    from inscrutable.experiments.alpha_protect import LAW_IS_PUBLIC
    from inscrutable.experiments.alpha_run import AlphaSettings, read_linear_world, run_alpha_backtest
    from inscrutable.reports.alphas import write_alphas

    assert options.alphas is not None
    if options.prior_covariance is None and options.world is None:
        speech.log(LAW_IS_PUBLIC.partition(" With")[0])
    chosen = {name: value for name, value in settings.items() if value is not None}
    found = run_alpha_backtest(
        table,
        None if options.alphas == _MOMENTUM else read_signals(options.alphas),
        AlphaSettings(budget=_budget(budget, speech), objective=options.objective or "information", **chosen),
        riskless=riskless,
        prior_covariance=None if options.prior_covariance is None else covariance_of(options.prior_covariance),
        world=None if options.world is None else read_linear_world(options.world),
    )
    files = replaced(folder, "backtest", partial(write_alphas, found), speech)
    if speech.json:
        speech.summary_file(folder / "summary.json")
        return
    speech.sentence(f"{found}\n{found.maker.status.value}\n")
    speech.files(files)
