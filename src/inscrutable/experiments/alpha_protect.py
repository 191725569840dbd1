"""Published decisions in place of the optimal ones for private means, month after month."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from inscrutable import tolerances, validation
from inscrutable.alphas import AlphaDecisionMaker, AlphaDraw, AlphaStatus
from inscrutable.axes import Axis
from inscrutable.datasets import crowded_months, missing_steps
from inscrutable.errors import InputError
from inscrutable.labels import label_text
from inscrutable.validation import Array

LAW_IS_PUBLIC = (
    "The law of the alphas (the prior covariance or the world) counts as public: a law estimated from your own alphas "
    "reveals them. With --state the first run fixes the law; another one is an error later."
)

_FAR = 6.0
"""Standard deviations of the public law beyond which an alpha is named: one in 500 million of its draws lies there."""
_SEED = 0  # public like the law: every run computes the same rule
_MANY_ASSETS = 60
_DRAWS, _FEWER_DRAWS = 1000, 200
"""Means drawn to simulate the regret under limits to 1 or 2 %: 3 s for 60 assets; fewer means, 12 s for 500 assets."""


def within_limits(maker: AlphaDecisionMaker) -> AlphaDecisionMaker:
    """Return the rule that spends the budget under inequalities; other rules unchanged.

    See `AlphaDecisionMaker.under_limits`. Where the alphas have no stationary law, the rule is unchanged and spends at most the
    budget.
    """
    problem = maker.problem
    if not problem.has_inequalities or not maker.has_long_run:
        return maker
    draws = _DRAWS if problem.n_assets <= _MANY_ASSETS else _FEWER_DRAWS
    return maker.under_limits(draws=draws, rng=np.random.default_rng(_SEED))


@dataclass(frozen=True, eq=False)
class ProtectedAlphas:
    """Drawn decisions for private means, and the observer's estimate.

    Args:
        maker: The rule.
        index: Labels of the means' rows.
        decisions: One drawn decision per row; empty where nothing was drawn.
        n_published: Decisions recorded so far.
        spent: Regret of all recorded decisions, by the observer's law.
        told: Bits leaked by all recorded decisions.
        expected: Mean regret and bits of the next decision, by the observer's law.
        farthest: Largest distance of an alpha from the mean of its public law, in standard deviations; NaN where that law
            depends on public observations or has no end.
        date: Date of the last recorded decision, such as "2024-03-31"; None where no date is recorded.
        decided: The date of the decision recorded before, where `alphas` are not of a later period.
        gaps: Months without a decision between the recorded ones, as text; empty if none.
        is_unread: Whether the first decision was drawn without the public observation of its row.
    """

    maker: AlphaDecisionMaker
    index: tuple[Any, ...]
    decisions: tuple[AlphaDraw, ...]
    n_published: int
    spent: float
    told: float
    expected: tuple[float, float]
    farthest: float = float("nan")
    date: str | None = None
    decided: str | None = None
    gaps: str = ""
    is_unread: bool = False

    def table(self) -> pd.DataFrame:
        """Return the drawn decisions, one row each, by the assets' names."""
        names = self.maker.problem.asset_names
        columns = [f"asset {j}" for j in range(self.maker.problem.n_assets)] if names is None else list(names)
        rows = [label_text(each) for each in self.index[: len(self.decisions)]]
        return pd.DataFrame([each.action for each in self.decisions], index=pd.Index(rows, name="row"), columns=columns)

    def figures(self) -> dict[str, Any]:
        """Return everything as plain data."""
        maker, simulated = self.maker, self.maker.simulated_regret
        return {
            "decisions": self.table().to_dict("index"),
            "regrets": [each.regret for each in self.decisions],
            "regret_a_step": maker.regret,
            "simulated_regret": None if simulated is None else simulated._asdict(),
            "silence_regret": maker.silence_regret,
            "bits_a_step": maker.bits,
            "error_a_step": maker.error,
            "ceiling": maker.ceiling,
            "status": maker.status.value,
            "n_published": self.n_published,
            "regret_so_far": self.spent,
            "bits_so_far": self.told,
            "last_date": self.date,
            "gaps": self.gaps,
            "is_first_unread": self.is_unread,
            "farthest_alpha": self.farthest if np.isfinite(self.farthest) else None,
        }

    def summary(self) -> str:
        """Return a few sentences: the rule's cost and leakage in the long run, now and so far."""
        maker = self.maker
        simulated, most = maker.simulated_regret, "at most " if maker.problem.has_inequalities else ""
        lines = [maker.summary()]
        saved = maker.regret - (0.0 if simulated is None else simulated.mean)
        if simulated is not None and maker.status is not AlphaStatus.SILENT:
            if saved > tolerances.SIMULATED_SPENT * maker.regret:
                lines.append(
                    "The limits make hiding cheaper, so the rule hides more: its simulated regret, "
                    f"{simulated.mean:.4g} ± {simulated.standard_error:.2g} per step, equals the budget."
                )
        elif most and not maker.has_long_run:
            lines.append(
                "The limits make hiding cheaper, but the alphas have no stationary law: the budget is not spent in full."
            )
        lines.append(
            f"The next decision costs {most}{self.expected[0]:.4g} on average and leaks {most}{self.expected[1]:.4f} bits."
        )
        if self.n_published:
            count = "1 decision" if self.n_published == 1 else f"{self.n_published} decisions"
            lines.append(
                f"{count} published so far: {most}{self.spent:.4g} of regret, {most}{self.told:.4f} bits, by the observer's "
                "law."
            )
            lines.append(
                "No date is recorded: publish once a period, as each time counts as one more."
                if self.date is None
                else f"The last one is of {self.date}."
            )
        if self.decided is not None:
            counted = "It counts" if self.decisions else "The next one would count"
            lines.append(
                f"Caution: a decision of {self.decided} is recorded already, and these alphas are of "
                f"{label_text(self.index[0])}. {counted} as one more period: "
                f"where they are not new, two draws about them reveal more than the bits stated."
            )
        if self.gaps:
            lines.append(f"Caution: {self.gaps}.")
        if self.is_unread:
            lines.append(
                "Caution: the first decision was drawn without the public observation of its row. Its regret and bits are "
                "those of an observer who has not read it."
            )
        if self.farthest > _FAR:
            lines.append(
                f"Caution: these alphas lie up to {self.farthest:.3g} standard deviations from the mean of their public law. "
                "It is not theirs (are they in per cent?), and regret and bits are figures of that law."
            )
        if not self.decisions:
            lines.append("Nothing was drawn or recorded: --publish draws once and records what it drew.")
        return "\n".join(lines)


def protect_alphas(
    maker: AlphaDecisionMaker,
    alphas: pd.DataFrame,
    state: str | Path | None = None,
    *,
    public: pd.DataFrame | None = None,
    publish: bool = False,
    rng: np.random.Generator | None = None,
) -> ProtectedAlphas:
    """Return drawn decisions for private means, against an observer who knows the rule and remembers all decisions.

    Args:
        maker: The rule.
        alphas: Means, one row per step, labelled by the problem's signals.
        state: The file of the sequence so far, created if missing; each run takes one row. Where its label is a date, the file
            keeps it, and the summary names repeated and missing periods. None: the rows are one whole sequence, and all
            decisions are drawn.
        public: The public observation of each row, (T,q), with the same row labels, where the world has a public sensor; each
            is read before the row's decision. Columns are aligned with the world's. The first row may be left out, with a
            caution in the summary.
        publish: With `state`: draw once and record; otherwise nothing is drawn.
        rng: The source of the draws; None: the operating system's entropy, because a known seed reveals the draw.

    Raises:
        InputError: Labels disagree, public observations are missing, there are many rows for one step, or the file is of
            another rule or in use.

    Cost: that of the rule once, plus O(k²) per row.

    Example:
        >>> from inscrutable import AlphaProblem
        >>> maker = AlphaDecisionMaker(AlphaProblem([[0.04]], 2.5), 0.25, prior_covariance=[[4e-4]])
        >>> found = protect_alphas(maker, pd.DataFrame([[0.02]]), rng=np.random.default_rng(0))
        >>> len(found.decisions), round(found.told, 6)
        (1, 1.0)
    """
    source = np.random.default_rng() if rng is None else validation.generator(rng)
    means = maker.problem.check_mean(alphas, "alphas").reshape(-1, maker.problem.n_signals)
    read = _public_rows(maker, alphas, public)
    sequence = maker.begin()
    drawn, decided, date = [], None, _date_of(alphas.index)
    if state is None:
        for step, mean in enumerate(means):
            if step or read is not None:
                sequence.observe(None if read is None else read[step])
            drawn.append(sequence.decide(mean, rng=source))
            sequence.publish(drawn[-1])
    else:
        if len(means) != 1:
            raise InputError(f"alphas have {len(means)} rows, expected one: with a state every run is one step")
        try:
            if Path(state).exists():
                sequence.load(state)
            else:
                sequence.save(state)
            last = sequence.periods[-1] if sequence.periods else None
            if date is not None:
                dated = (*sequence.periods, date)
                is_later = last is None or date > last
                decided = None if is_later and not crowded_months(_days(dated)) else last
                sequence.periods = dated if publish and is_later else sequence.periods
            if read is not None:
                sequence.observe(read[0])
            elif publish and sequence.n_published:
                _need_public(maker)
            if publish:
                drawn.append(sequence.decide(means[0], rng=source))
                sequence.publish(drawn[0])
                sequence.save(state)
        finally:
            sequence.close()
    expected = sequence.upcoming()
    return ProtectedAlphas(
        maker,
        tuple(alphas.index),
        tuple(drawn),
        0 if state is None else sequence.n_published,
        sequence.total_regret,
        sequence.total_bits,
        expected,
        _farthest(maker, means),
        sequence.periods[-1] if sequence.periods else None,
        decided,
        missing_steps(_days(sequence.periods)),
        bool(drawn) and read is None and maker.world is not None and maker.world.public is not None,
    )


def _date_of(index: pd.Index) -> str | None:
    """Return the date of the only row; None where it has none."""
    return f"{index[0]:%Y-%m-%d}" if isinstance(index, pd.DatetimeIndex) and len(index) == 1 else None


def _days(periods: tuple[str, ...]) -> list[datetime]:
    return [datetime.fromisoformat(each) for each in periods]


def _farthest(maker: AlphaDecisionMaker, means: Array) -> float:
    """Return the largest distance of means (T,k) from that of their public law, in standard deviations.

    NaN for a law that moves: after public observations, or from a given first one.
    """
    world = maker.world
    if maker.silence is None or (world is not None and (world.public is not None or world.is_begun)):
        return float("nan")
    apart, deviations = np.abs(means - maker.start_mean), np.sqrt(np.diag(maker.silence))
    known = deviations > 0.0
    return float(np.max(apart[:, known] / deviations[known], initial=np.inf if apart[:, ~known].any() else 0.0))


def _public_rows(maker: AlphaDecisionMaker, alphas: pd.DataFrame, public: pd.DataFrame | None) -> Array | None:
    """The public observation of each row of the alphas, (T,q); None where there are none."""
    if public is None:
        if len(alphas) > 1:
            _need_public(maker)
        return None
    if maker.world is None or maker.world.public is None:
        raise InputError(
            "public observations are given, but no world with a public sensor: give that as world, or leave public out"
        )
    if not public.index.equals(alphas.index):
        raise InputError("public has other rows than alphas; expected one public observation for each of them")
    columns = Axis("public column", maker.world.public_names)
    return validation.finite_array(public, "public", ndim=2, axes=(None, columns))


def _need_public(maker: AlphaDecisionMaker) -> None:
    if maker.world is not None and maker.world.public is not None:
        raise InputError(
            "the world has a public sensor: give the public observation of each row (public=, or --public FILE); the first "
            "decision needs none"
        )
