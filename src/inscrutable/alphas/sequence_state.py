"""What a sequence of decisions about a private mean remembers, as a file."""

from __future__ import annotations

from dataclasses import dataclass

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
    """What is saved of a sequence: no private mean, no generator and no seed. The aware observer can compute all of it.

    Args:
        rule: What the rule is of; a file goes on under the same rule alone, so that what it is of stays frozen.
        mean: The observer's mean, (k,).
        before: P before the step's decision, (k,k); None where it is the rule's own.
        is_published: Whether the step's decision is published.
        n_published: Decisions published.
        n_steps: Steps passed.
        regret: Of all decisions, by the observer's law.
        bits: That they told.
        latest: The last decision, (n,), or None.
        version: Of the file.
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
    version: int = VERSION

    def __post_init__(self) -> None:
        if self.version != VERSION:
            raise InputError(f"its version is {self.version!r}, expected {VERSION}")
        for name in ("n_published", "n_steps"):
            validation.count(getattr(self, name), name, least=0)
        validation.finite_array(self.mean, "mean", ndim=1)

    def checked(self, rule: tuple[Array, ...], path: PathLike) -> AlphaState:
        """Return this, or raise `InputError` where the rule is another than that of the file."""
        same = len(rule) == len(self.rule) and all(map(_agree, rule, self.rule))
        if not same:
            raise InputError(
                f"{path} cannot be continued: it is of another rule (another law of the means, risk, risk aversion, "
                "limits, loadings, trading cost or budget). A law that is estimated afresh from private means would reveal "
                "them: keep the one that the sequence began with"
            )
        return self


def arrays_of(problem: AlphaProblem) -> tuple[Array, ...]:
    """Return what distinguishes a problem from others: risk, risk aversion, trading cost, loadings and limits.

    Factors of one risk differ between machines by their signs, so that a risk is compared by its variances and by V x for one
    x, whose entries are all different: distinct covariances that agree in both are exceptions.
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


def _agree(one: Array, other: Array) -> bool:
    if one.shape != other.shape:
        return False
    size = float(np.abs(one[np.isfinite(one)]).max(initial=0.0))
    return bool(np.allclose(one, other, rtol=tolerances.SAME_RULE, atol=tolerances.SAME_RULE * size))
