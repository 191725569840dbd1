"""The memory of a sequence of decisions, as a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from inscrutable import tolerances, validation
from inscrutable.decision_makers.sequential.laws import ChainLaw
from inscrutable.decision_makers.sequential.prices import PriceCalibration
from inscrutable.decision_makers.sequential.step import StepTable
from inscrutable.errors import InputError
from inscrutable.mechanisms.disclosures import EXACT
from inscrutable.saved import Saved
from inscrutable.validation import Array

VERSION = 1


@dataclass(frozen=True, eq=False)
class SequenceProblem(Saved):
    """The problem of a sequence: beliefs, their chain, decisions, state costs, the cap and the mean regret allowed."""

    beliefs: Array
    weights: Array
    transition: Any
    decisions: Array
    state_costs: Array
    cap: Array  # (2,): amount and whether it is relative; −1 for none
    limit: float
    disclosure: str = EXACT
    rival: Array | None = None  # costs of its answers, (A,X), or (…,) if infinitely many; None for the square error
    turnover: float | None = None
    assets: tuple[str, ...] | None = None  # labels; None where there are none, and in older files
    states: tuple[str, ...] | None = None

    def check(self, other: SequenceProblem) -> None:
        """Raise `InputError` where another differs by more than rounding."""
        named = {
            "beliefs": "other beliefs",
            "weights": "a law of the belief that is another",
            "transition": "a chain that is another",
            "decisions": "other decisions, such as those of other limits",
            "state_costs": "other costs",
            "cap": "another cap on the regret",
            "limit": f"another budget, a mean regret of {other.limit:.8g} a step instead of {self.limit:.8g}",
            "rival": "another loss of the observer",
            "turnover": f"another limit on turnover, {_limit(other.turnover)} instead of {_limit(self.turnover)}",
        }
        if self.disclosure != other.disclosure:
            raise InputError(
                f"it is of another problem: it has decisions disclosed as {other.disclosure}, not as {self.disclosure}"
            )
        for here, there, what in ((self.assets, other.assets, "assets"), (self.states, other.states, "states")):
            if here is not None and there is not None and here != there:
                raise InputError(
                    f"it is of another problem: it has the {what} {', '.join(there)}, not {', '.join(here)}"
                )
        for name, said in named.items():
            mine, theirs = (_plain(getattr(each, name)) for each in (self, other))
            if mine.shape != theirs.shape or not np.allclose(mine, theirs, rtol=_SAME, atol=_SAME * _size(mine)):
                raise InputError(f"it is of another problem: it has {said}")


_SAME = tolerances.SAME_BELIEF


def _plain(value: Any) -> Array:
    if value is None:
        return np.empty(0)
    return np.asarray(value.toarray() if hasattr(value, "toarray") else value, dtype=np.float64)


def _limit(turnover: float | None) -> str:
    return "none" if turnover is None else f"{turnover:.8g}"


def _size(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def problem_of(table: StepTable, law: ChainLaw, limit: float) -> SequenceProblem:
    """Return the problem of a sequence on a table."""
    cap = np.array([-1.0, 0.0] if table.cap is None else [table.cap.amount, float(table.cap.is_relative)])
    found, prior = table.columns, table.prior
    costs, shown = found.found.costs, str(table.disclosure)
    moves = law.chain.transition
    if law.chain.public is not None:
        moves = sparse.csr_array(sparse.hstack(list(law.chain.public)))
    # A rival's points are differences of costs: a change of all its answers' costs changes nothing.
    stakes = table.stakes
    rival = stakes.directions if stakes.width else None
    if stakes.rival is not None:  # also its loss at the known belief
        rival = np.hstack([stakes.directions.ravel(), stakes.spare])
    most = table.turnover if np.isfinite(table.turnover) else None
    names = found.problem.asset_names, found.problem.state_names
    labels = [None if each is None else tuple(map(str, each)) for each in names]
    return SequenceProblem(
        prior.beliefs, prior.weights, moves, found.points, costs, cap, limit, shown, rival, most, *labels
    )


@dataclass(frozen=True, eq=False)
class SequenceState(Saved):
    """The saved memory of a sequence, without the agent's beliefs, generator or seed.

    It holds the observer's law, the prices, and the mean regrets under that law: an observer of the decisions can compute all
    of it except `n_off_grid`, the number of beliefs off the grid, and `digest`, for which it takes the data.
    """

    problem: SequenceProblem
    calibration: PriceCalibration
    price_index: int
    state: Array
    kept: int
    has_published: bool
    has_looked: bool
    n_published: int
    n_approximate: int
    n_off_grid: int
    regret: float
    bits: float
    latest: Array | None = None  # (U,): the decision published last
    n_steps: int = 0  # so far; decides whether the next decision is disclosed
    period: str | None = None  # of the decision published last, such as the date of the data it rests on
    digest: str | None = None  # hash of that data, by which a revision of it shows
    version: int = VERSION

    def __post_init__(self) -> None:
        if self.version != VERSION:
            raise InputError(f"its version is {self.version!r}, expected {VERSION}")
        for name in ("n_published", "n_approximate", "n_off_grid", "price_index", "n_steps"):
            validation.count(getattr(self, name), name, least=0)
        for name in ("regret", "bits"):
            validation.non_negative(getattr(self, name), name)
        for name in ("has_published", "has_looked"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{name} must be True or False, got {getattr(self, name)!r}")
        for name in ("period", "digest"):
            if not isinstance(getattr(self, name), (str, type(None))):
                raise InputError(f"{name} must be a text or None, got {getattr(self, name)!r}")
        law = validation.stochastic_rows(self.state, "law", ndim=1)
        if len(law) != len(self.problem.beliefs):
            raise InputError(f"it has a law of {len(law)} beliefs, expected {len(self.problem.beliefs)}")
        if self.price_index >= len(self.calibration.shares):
            raise InputError(f"it has price {self.price_index} of {len(self.calibration.shares)}")
        validation.count(self.kept, "kept", least=-1)
        if (self.latest is None) != (self.n_published == 0):
            raise InputError(
                f"it has {self.n_published} decisions, and {'no' if self.latest is None else 'a'} latest one"
            )
        if self.latest is not None:
            shape = validation.finite_array(self.latest, "latest", ndim=1).shape
            if shape != self.problem.decisions.shape[1:]:
                raise InputError(
                    f"its latest decision is of shape {shape}, expected {self.problem.decisions.shape[1:]}"
                )
