"""The saved state of a sequence of decisions about a private mean."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise

import numpy as np

from inscrutable import tolerances, validation
from inscrutable.alphas.problem import AlphaProblem
from inscrutable.errors import InputError
from inscrutable.files import PathLike
from inscrutable.saved import Saved
from inscrutable.validation import Array

VERSION = 2


@dataclass(frozen=True, eq=False)
class AlphaState(Saved):
    """The saved state of a sequence, without private mean, generator or seed. The aware observer can compute all of it.

    Args:
        rule: What identifies the rule; a file continues under the same rule only.
        mean: The observer's mean, (k,).
        before: P before the step's decision, (k,k); None: the rule's own.
        is_published: Whether the step's decision is published.
        n_published: Number of published decisions.
        n_steps: Number of past steps.
        regret: Total expected regret of all decisions, by the observer's law.
        bits: Total bits that they leaked, by the observer's law.
        latest: The last decision, (n,), or None.
        periods: Dates of the decisions, such as "2024-03-31", ascending; without those that had none.
        has_read: Whether the first step's public observation is read.
        assets: Their labels, in the order of `latest`; None where there are none, and in older files.
        signals: Labels of the mean's entries, likewise.
        version: Version of the file.
    """

    rule: tuple[Array, ...]
    mean: Array
    before: Array | None
    is_published: bool
    n_published: int
    n_steps: int
    regret: float
    bits: float
    latest: Array | None = None
    periods: tuple[str, ...] = ()
    has_read: bool = False
    assets: tuple[str, ...] | None = None
    signals: tuple[str, ...] | None = None
    version: int = VERSION

    def __post_init__(self) -> None:
        if self.version != VERSION:
            raise InputError(f"its version is {self.version!r}, expected {VERSION}")
        for name in ("n_published", "n_steps"):
            validation.count(getattr(self, name), name, least=0)
        validation.finite_array(self.mean, "mean", ndim=1)
        try:
            days = [datetime.fromisoformat(each) for each in self.periods]
        except (TypeError, ValueError) as error:
            raise InputError(f"it has a period that is no date: {error}") from None
        if any(after <= before for before, after in pairwise(days)):
            raise InputError("its periods are not ascending")

    def checked(self, rule: tuple[Array, ...], problem: AlphaProblem, path: PathLike) -> AlphaState:
        """Return this state, or raise `InputError` where `rule` or the labels of `problem` differ from the file's."""
        held = self.assets, self.signals
        for here, there, what in zip(labels_of(problem), held, ("assets", "signals"), strict=True):
            if here is not None and there is not None and here != there:
                raise InputError(
                    f"{path} cannot be continued: it has the {what} {', '.join(there)}, not {', '.join(here)}"
                )
        same = len(rule) == len(self.rule) and all(map(_agree, rule, map(_without_bits, rule, self.rule)))
        if not same:
            raise InputError(
                f"{path} cannot be continued: it is of another rule (another law of the means, risk, risk aversion, "
                "limits, loadings, trading cost or budget). A law that is estimated afresh from private means would reveal "
                "them: keep the one that the sequence began with"
            )
        return self


def labels_of(problem: AlphaProblem) -> tuple[tuple[str, ...] | None, tuple[str, ...] | None]:
    """Return the labels of a problem's assets and signals, as a file keeps them; None where there are none."""
    assets, signals = (
        None if names is None else tuple(map(str, names)) for names in (problem.asset_names, problem.signal_names)
    )
    return assets, signals


def arrays_of(problem: AlphaProblem) -> tuple[Array, ...]:
    """Return arrays that identify a problem: risk, risk aversion, trading cost, loadings and limits.

    The signs of a risk's factors differ between machines; a risk is therefore compared by its variances and by V x for one x
    with distinct entries, in which distinct covariances rarely agree.
    """
    risk, layout = problem.risk, problem.layout
    direction = 0.5 + np.modf(np.arange(risk.n_assets) * 0.5 * (np.sqrt(5.0) - 1.0))[0]
    return (
        risk.diagonal,
        risk.times(direction),
        np.array([problem.risk_aversion]),
        np.array([] if problem.trading_cost is None else [problem.trading_cost]),
        np.zeros((0, 0)) if problem.loadings is None else problem.loadings,
        *(() if layout is None else (layout.lower, layout.upper, layout.general, layout.sides)),
        *(() if layout is None else (layout.equalities, layout.equality_sides)),
    )


def _without_bits(rule: Array, held: Array) -> Array:
    """Older files have the bits between regret and error; those of a direction that is revealed exactly may be rounding."""
    return held[[0, 2]] if (rule.shape, held.shape) == ((2,), (3,)) else held


def _agree(one: Array, other: Array) -> bool:
    if one.shape != other.shape:
        return False
    size = float(np.abs(one[np.isfinite(one)]).max(initial=0.0))
    return bool(np.allclose(one, other, rtol=tolerances.SAME_RULE, atol=tolerances.SAME_RULE * size))
