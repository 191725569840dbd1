"""One step of a sequence of decisions stored in a file, against an observer who remembers all earlier decisions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.axes import Axis
from inscrutable.budgets import Budget, SilenceShare, as_budget
from inscrutable.datasets import crowded_months
from inscrutable.decision_makers import DecisionSequence, MixedDecision, PriceCalibration, SequentialDecisionMaker
from inscrutable.decision_makers.sequential.sequence import StepFigures
from inscrutable.decision_makers.sequential.state import SequenceState
from inscrutable.errors import InputError
from inscrutable.experiments.backtest_sequential import SHARE_OF_SILENCE
from inscrutable.experiments.investor_model import BASIS_POINTS, InvestorModel, checked_model
from inscrutable.experiments.silence import chain_of
from inscrutable.mechanisms import Prior
from inscrutable.privacy.leaks import silence_regret
from inscrutable.problems import MarkowitzProblem
from inscrutable.validation import Array

_LEAST_SHOWN = 0.0005  # a weight below this is 0.0 per cent
_TIME = "%Y-%m-%dT%H:%M:%S"


@dataclass(frozen=True, eq=False)
class ProtectedStep:
    """The lottery of the sequential rule, the observer's estimate, and the published weights, if any.

    Args:
        model: The investor.
        belief: The investor's own belief, shape (X,).
        lottery: The lottery; improbable weights come last.
        before: The observer's mean belief before this decision, shape (X,).
        after: The observer's mean belief after the published decision; None if nothing was published.
        expected: Expected regret and leakage of this step.
        published: The weights that were drawn and recorded, shape (U,), or None.
        latest: The weights recorded last, by this step or an earlier one, shape (U,), or None.
        is_off_grid: Whether the belief is not on the grid: it plays as the nearest one, which the observer's law counts.
        is_approximate: Whether the observer's law replaces `published` by the nearest weights that the rule could have played.
        n_published: Decisions recorded, this one included.
        spent: Regret of all recorded decisions, by the observer's law, in the cost's unit.
        told: Bits leaked by all recorded decisions, by the observer's law.
        prior_error: Root mean square error of an observer without decisions.
        long_run_error: Root mean square error in the long run, given all decisions.
        ceiling: An upper bound of every rule's long-run error, on the grid and these candidates.
        n_beliefs: Beliefs of the grid.
        budget: Long-run mean regret allowed, in the cost's unit.
        silence: The silence regret, that of one constant portfolio, by the law of the belief.
        prices: The prices of the rule, and the long-run means that were simulated at them.
        n_skipped: Periods since the last decision that had none.
        is_dated: Whether the period of the decision is known.
        revised: The date to which the returns are not those of the last decision, or None.
        decided: The date of the last decision, where the returns have no row after it and the belief is not of this step.
    """

    model: InvestorModel
    belief: Array
    lottery: MixedDecision
    before: Array
    after: Array | None
    expected: StepFigures
    published: Array | None
    latest: Array | None
    is_off_grid: bool
    is_approximate: bool
    n_published: int
    spent: float
    told: float
    prior_error: float
    long_run_error: float
    ceiling: float
    n_beliefs: int
    budget: float
    silence: float
    prices: PriceCalibration
    n_skipped: int = 0
    is_dated: bool = False
    revised: str | None = None
    decided: str | None = None

    def table(self) -> pd.DataFrame:
        """Return one row per portfolio of the lottery, the likeliest first: probability, regret and weights."""
        order = np.argsort(-self.lottery.probabilities, kind="stable")
        columns = [f"weight: {asset}" for asset in self.model.assets]
        weights = pd.DataFrame(np.asarray(self.lottery.actions)[order], columns=columns)
        weights.insert(0, "regret", np.asarray(self.lottery.regrets)[order])
        weights.insert(0, "probability", np.asarray(self.lottery.probabilities)[order])
        return weights.rename_axis("portfolio")

    def figures(self) -> dict[str, Any]:
        """Return everything as plain data, by the names of assets and regimes."""

        def named(values: Array | None, names: tuple[str, ...]) -> dict[str, float] | None:
            return None if values is None else {name: float(each) for name, each in zip(names, values, strict=True)}

        return {
            "n_published": self.n_published,
            "published": named(self.published, self.model.assets),
            "last_published": named(self.latest, self.model.assets),
            "lottery": self.table().to_dict("records"),
            "observer_before": named(self.before, self.model.regimes),
            "observer_after": named(self.after, self.model.regimes),
            "expected_regret": self.expected.own_regret,
            "expected_bits": self.expected.bits,
            "regret_so_far": self.spent,
            "bits_so_far": self.told,
            "long_run_error": self.long_run_error,
            "ceiling": self.ceiling,
            "prior_error": self.prior_error,
            "grid_beliefs": self.n_beliefs,
            "budget": self.budget,
            "silence_regret": self.silence,
            "prices": self.prices.status.name.lower(),
            "belief_off_grid": self.is_off_grid,
            "counted_as_nearest": self.is_approximate,
            "returns_revised_to": self.revised,
            "no_returns_after": self.decided,
        }

    def lines(self) -> pd.DataFrame:
        """Return the table as text for a terminal; weights and probabilities in percent, zeros left out."""
        table = self.table()
        held = table.filter(like="weight: ").to_numpy()
        return pd.DataFrame(
            {
                "probability, %": [_percent(share) for share in table["probability"]],
                "regret, bp": [f"{BASIS_POINTS * regret:.3g}" for regret in table["regret"]],
                "weights, %": [self.holdings(row) for row in held],
            },
            index=pd.Index(range(1, len(table) + 1), name="portfolio"),
        )

    def holdings(self, weights: Array) -> str:
        """Return weights (U,) as text, in percent, the largest first."""
        order = [j for j in np.argsort(-np.abs(weights), kind="stable") if abs(weights[j]) >= _LEAST_SHOWN]
        return ", ".join(f"{self.model.assets[j]} {100.0 * weights[j]:.1f}" for j in order)

    def written(self, weights: Array) -> str:
        """Return weights (U,) as text to six digits, by asset."""
        return ", ".join(f"{asset} {share:.6f}" for asset, share in zip(self.model.assets, weights, strict=True))

    def summary(self) -> str:
        """Return a few sentences: regret, the observer's estimate, and the published weights."""
        own, seen = (BASIS_POINTS * each for each in (self.expected.own_regret, self.expected.regret))
        lines = [
            self._budget_line(),
            f"This step costs {own:.3g} bp of wealth in expectation under your belief, and {seen:.3g} bp on average over the "
            "beliefs that the observer thinks possible; the budget limits the mean of the second figure over many steps. It "
            f"leaks {self.expected.bits:.3f} bits on average.",
            f"The aware observer, who has seen {_counted(self.n_published - (self.published is not None))}, believes "
            f"{self._named(self.before)}.",
        ]
        lines += filter(None, [self.prices.caution()])
        if self.n_skipped:
            lines.append(f"Periods before this one without a decision: {self.n_skipped}. The observer's law moved on.")
        if self.decided is not None:
            lines.append(
                f"Caution: these returns have no row after {self.decided}, on which the last decision rests. This is the step "
                "after it, for a belief of before: add the new rows."
            )
        if self.revised is not None:
            lines.append(
                f"Caution: the returns to {self.revised} are not those of the last decision: they were revised, or begin at "
                "another row. Your belief is that after the returns as they are now."
            )
        if self.is_off_grid:
            lines.append(
                f"Your belief lies between the {self.n_beliefs} beliefs of the grid, as most do. The rule plays as for the "
                "nearest of them, which the observer's law counts; the long-run regret is that of the grid."
            )
        if self.is_approximate:
            lines.append(
                "No belief of the grid leads to these weights: the observer's law takes the nearest weights of the rule."
            )
        if self.after is not None:
            lines.append(f"With the weights published now it holds {self._named(self.after)}.")
            if not self.is_dated:
                lines.append("No date is recorded: publish once a period, as each time counts as one more.")
        lines.append(
            f"{_counted(self.n_published)} published so far: {BASIS_POINTS * self.spent:.3g} bp of wealth and {self.told:.3f} "
            f"bits, in expectation by the observer's law; the budget for as many is "
            f"{BASIS_POINTS * self.budget * self.n_published:.3g} bp, on average in the long run."
        )
        lines.append(
            f"In the long run of the model the observer's error is {self.long_run_error:.3f}; the ceiling is "
            f"{self.ceiling:.3f}, on a grid of {self.n_beliefs} beliefs, and the error without decisions "
            f"{self.prior_error:.3f}. A backtest says whether this hides the belief on your data."
        )
        if self.published is None:
            if self.latest is not None:
                lines.append(f"Last published: {self.written(self.latest)}.")
            lines.append("Nothing was drawn or recorded: --publish draws once and records what it drew.")
        return "\n".join(lines)

    def _budget_line(self) -> str:
        budget, silence = BASIS_POINTS * self.budget, BASIS_POINTS * self.silence
        line = f"Budget: {budget:.3g} bp of wealth a step in the long run; silence, a constant portfolio, costs {silence:.3g}."
        if self.budget < self.silence:
            return line
        return (
            line
            + " So the rule is silent: it publishes one portfolio, whatever your belief. Hiding for less: --budget silence:0.5."
        )

    def _named(self, belief: Array) -> str:
        return ", ".join(f"{name} {share:.2f}" for name, share in zip(self.model.regimes, belief, strict=True))


def _percent(share: float) -> str:
    """Return a positive share in percent; a small one does not look like none."""
    text = f"{100.0 * share:.2f}"
    return "<0.01" if text == "0.00" else text


def _counted(count: int) -> str:
    return f"{count} decision" if count == 1 else f"{count} decisions"


def protect_step(
    model: InvestorModel,
    belief: ArrayLike,
    state: str | Path,
    budget: Budget | float | None = None,
    *,
    publish: bool = False,
    rng: np.random.Generator | None = None,
    periods: Sequence[str] | pd.DataFrame = (),
) -> ProtectedStep:
    """Return the next step of a sequence of decisions stored in a file.

    The rule is `SequentialDecisionMaker` on the law of the predicted belief of the model's world. Without a file, its prices
    are computed first and stored in a new one.

    Args:
        model: The investor.
        belief: π, shape (X,).
        state: The file of the sequence, created if missing.
        budget: Long-run mean regret. None: that of the file; half of the silence regret for a new one, as in a backtest.
        publish: Whether to draw once, record the draw and return it; otherwise nothing is drawn.
        rng: The source of the draw; None: the operating system's entropy, because a known seed reveals the draw.
        periods: Dates of the data that the belief rests on, as "2024-03-31", ascending; none: not recorded. One decision is
            published for each, at its end; where several are new, the observer's law moves on by as many steps. Or the data
            itself, such as returns, with these dates as its index: a change of its earlier rows is then reported.

    Raises:
        InputError: An argument is malformed, a new file's budget is 0 and silence costs more, or the file is damaged or of
            another problem or budget, or in use, or has a decision on the last period or a later one, or on a date between the
            periods, or on any period where none is given for a decision to publish; it is unchanged.
        SolverError: No price was found at which the budget is met.

    Cost: some milliseconds, plus a calibration of up to a minute for a new file.

    Source: see `SequentialDecisionMaker`.

    Example:
        >>> import tempfile
        >>> from inscrutable import GaussianEmission, HiddenMarkovModel, MarkowitzProblem
        >>> sensor = GaussianEmission([[0.02, 0.0], [-0.03, 0.01]], [0.002 * np.eye(2), 0.006 * np.eye(2)])
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], sensor)
        >>> problem = MarkowitzProblem(sensor.means, sensor.covariances, 4.0)
        >>> model = InvestorModel(world, problem, ("A", "B"), ("calm", "turbulent"))
        >>> with tempfile.TemporaryDirectory() as folder:  # a budget that pays for silence, for which no price is sought
        ...     found = protect_step(model, [0.25, 0.75], Path(folder) / "state", Budget.regret(1.0), publish=True)
        >>> print(found.published.round(2), round(found.told, 9))
        [0.5 0.5] 0.0
    """
    checked_model(model)
    problem, path = _labelled(model), Path(state)
    held = validation.one_belief(belief, problem.n_states, names=model.regimes)
    source = np.random.default_rng() if rng is None else validation.generator(rng)
    dates = _dates_of(periods)
    if not path.parent.exists():  # before the minute of a calibration; a mistyped path begins no other sequence
        raise InputError(f"the folder of {path} does not exist: make it, or correct the path")
    chain = chain_of(model.world)
    limit = sequence_budget(model, chain.prior, path) if budget is None else as_budget(budget)
    maker = SequentialDecisionMaker(problem, limit, chain=chain, turnover=model.turnover, rng=source)
    sequence = maker.begin()
    try:
        if path.exists():
            sequence.load(path)
        else:
            _check_budget(maker)
            sequence.save(path)
        last = sequence.period = _last_date(sequence.period, path)
        end = dates[-1] if dates else None
        decided = last if end is not None and last is not None and end <= last else None
        is_whole = decided is None or end == last  # else the rows to the last decision are not all there
        revised = last if is_whole and sequence.digest not in (None, _digest(periods, dates, last)) else None
        skipped = _begin(sequence, dates, path, publish=publish)
        if publish:
            sequence.digest = _digest(periods, dates, sequence.period)
        step = _step(model, held, (maker, sequence), path, source if publish else None)
        return replace(step, n_skipped=skipped, is_dated=bool(dates), revised=revised, decided=decided)
    finally:
        sequence.close()


def _labelled(model: InvestorModel) -> MarkowitzProblem:
    """The model's problem with its labels, which the file keeps."""
    plain = model.problem
    region = plain.constraints.in_order(Axis("asset", model.assets))
    problem = MarkowitzProblem(plain.means, plain.covariances, plain.risk_aversion, region)
    problem.state_names = model.regimes
    return problem


def sequence_budget(model: InvestorModel, prior: Prior, path: Path) -> Budget:
    """Return the budget of the sequence in a file; half of the silence regret where there is none."""
    if path.exists():
        return Budget.regret(SequenceState.load(path).problem.limit)
    return SilenceShare(SHARE_OF_SILENCE).of(silence_regret(model.problem, prior.beliefs, prior.weights))


def _check_budget(maker: SequentialDecisionMaker) -> None:
    """Raise `InputError` for a budget that is lost in rounding and does not pay for silence: no price spends it."""
    table = maker.table
    rounding = tolerances.COST_ROUNDING * float(np.abs(table.optimal_costs).max())
    if maker.limit <= rounding < silence_regret(maker.problem, table.prior.beliefs, table.prior.weights):
        raise InputError(
            f"a budget of {maker.limit:g} leaves only optimal decisions, to which a sequence adds nothing: publish them "
            "without one, or take a larger budget, such as silence:0.5"
        )


def _dates_of(periods: Sequence[str] | pd.DataFrame) -> list[str]:
    """Return the ascending dates in one spelling, whose texts compare as the dates do."""
    texts: Any = periods
    if isinstance(periods, pd.DataFrame):
        if not isinstance(periods.index, pd.DatetimeIndex):
            raise InputError("periods must be dates, or a table with dates as its index")
        texts = periods.index.strftime(_TIME)
    try:
        dates = [_spelt(each) for each in texts]
    except (TypeError, ValueError) as error:
        raise InputError(f"periods must be dates such as 2024-03-31: {error}") from None
    for before, after in pairwise(dates):
        if after <= before:
            raise InputError(f"periods must ascend: {after} comes after {before}")
    crowded = crowded_months([datetime.fromisoformat(each) for each in dates])
    if crowded:
        raise InputError(f"the returns have more than one row for {', '.join(crowded[:8])}, expected one a period")
    return dates


def _spelt(date: str) -> str:
    """A date as it is kept: as 2024-03-31, with the time of day where that is not midnight, without a time zone."""
    return datetime.fromisoformat(date).replace(tzinfo=None).isoformat(timespec="seconds").removesuffix("T00:00:00")


def _last_date(period: str | None, path: Path) -> str | None:
    """The date of the last decision of a file in that spelling, which older files may not have."""
    try:
        return None if period is None else _spelt(period)
    except ValueError:
        raise InputError(f"{path} has a decision on data to {period!r}, expected a date such as 2024-03-31") from None


def _digest(data: Sequence[str] | pd.DataFrame, dates: Sequence[str], last: str | None) -> str | None:
    """Return a hash of the data to a date, to twelve decimals and in any order of columns; None where only dates are given."""
    if last is None or not isinstance(data, pd.DataFrame):
        return None
    rows = data[[each <= last for each in dates]].sort_index(axis=1).round(12) + 0.0  # no -0
    written: Any = "%Y-%m-%d" if all("T" not in each for each in dates) else _TIME
    text = rows.to_csv(index_label="date", date_format=written, float_format="%.12f", lineterminator="\n")
    return sha256(text.encode()).hexdigest()


def _begin(sequence: DecisionSequence, periods: Sequence[str], path: Path, *, publish: bool) -> int:
    """Let the time since the last decision pass, and note that of the next; return how many periods had no decision."""
    last, now = sequence.period, periods[-1] if periods else None
    if publish and last is not None and now is None:
        raise InputError(
            f"{path} has a decision on data to {last}: publish with the returns until now (--returns), whose dates count the "
            "periods"
        )
    if last is not None and periods and periods[0] < last < periods[-1] and last not in periods:
        raise InputError(
            f"{path} has a decision on data to {last}, a date that these returns do not have: a date that was changed would "
            "count as one more period. Give the returns with their former dates"
        )
    new = 0 if last is None else sum(each > last for each in periods)
    if publish and last is not None and now is not None and not new:
        raise InputError(
            f"{path} has a decision on data to {last} already, and these end at {now}: a sequence publishes once a period. "
            "Add the new rows, or leave out --publish to look at this step"
        )
    for _ in range(new):
        sequence.observe()
    if publish:
        sequence.period = now
    return max(new - 1, 0)


def _step(
    model: InvestorModel,
    belief: Array,
    of: tuple[SequentialDecisionMaker, DecisionSequence],
    path: Path,
    draw: np.random.Generator | None,
) -> ProtectedStep:
    maker, sequence = of
    lottery = sequence.decide(belief)
    expected, before, is_off_grid = sequence.expected, sequence.observer, sequence.is_off_grid
    ceiling = float(np.sqrt(maker.ceiling))
    published, after, is_approximate = None, None, False
    if draw is not None:
        published = lottery.sample(rng=draw).action
        is_approximate = not sequence.could_play(published)
        sequence.publish(published, as_nearest=is_approximate)
        after = sequence.observer.mean
        sequence.save(path)
    prior = sequence.begun
    spread = float(prior.weights @ ((prior.beliefs - prior.mean) ** 2).sum(axis=1))
    return ProtectedStep(
        model, belief, lottery, before.mean, after, expected, published, sequence.latest, is_off_grid, is_approximate,
        sequence.n_published, sequence.total_regret, sequence.total_bits, float(np.sqrt(spread)),
        float(np.sqrt(sequence.calibration.loss)), ceiling, len(prior),
        maker.limit, silence_regret(model.problem, prior.beliefs, prior.weights), sequence.calibration,
    )  # fmt: skip
