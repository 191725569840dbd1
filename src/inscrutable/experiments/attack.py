"""The beliefs that explain each row of published weights, rounding included.

`adversaries.rounded` bounds the regret that rounding can cause; with it the set always contains the true belief.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import pandas as pd

from inscrutable import tolerances, validation
from inscrutable.adversaries import near_optimal_beliefs
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.adversaries.plausibility import nearest_explanation
from inscrutable.adversaries.rounded import allowance, completed, half_unit
from inscrutable.axes import as_texts
from inscrutable.datasets import WeightsTable, missing_steps
from inscrutable.datasets.tables import FULL_PRECISION_DIGITS, decimal_places
from inscrutable.decision_makers.results import Progress
from inscrutable.errors import InputError
from inscrutable.experiments.investor_model import BASIS_POINTS, InvestorModel, checked_model
from inscrutable.labels import label_text
from inscrutable.problems import MarkowitzProblem, Polyhedron
from inscrutable.problems.magnitudes import MagnitudeRegion
from inscrutable.validation import Array

_DRAWN_STATES = 3


class Reading(Enum):
    """The kind of set computed for a row; the text says what the numbers mean."""

    EXACT = "exact: the beliefs these weights are optimal for"
    ROUNDED = "near-optimal: the beliefs these weights are optimal for before rounding are among them"
    NEAR = "near-optimal: the beliefs under which these weights cost at most the regret that was asked for"
    IMPLAUSIBLE = (
        "nearest explanation: no belief explains these weights, rounded or not; shown is the belief of least regret"
    )


@dataclass(frozen=True, eq=False)
class RowReading:
    """The beliefs that explain one row of weights.

    Args:
        reading: How it was read.
        action: û, the weights as a feasible decision, shape (U,).
        adjustment: Largest change of a weight to get there.
        estimate: The observer's estimate, shape (X,): the centre of the exact set; the member of the near-optimal set nearest
            to the middle of its bounds (not the mean of its corners, which cluster where it is curved); or the belief of least
            regret.
        bounds: Least and greatest probability of each regime, shape (X,2); NaN where no belief explains the row.
        corners: Corners of the set, shape (V,X); V = 0 where it is empty, or rounded with more than three regimes.
        residual: Smallest KKT residual over all beliefs, relative to the gradient's scale: 0 where Π(û) holds a belief.
        gap: Smallest regret over all beliefs, in the cost's unit.
        allowance: ε, a bound on the regret that rounding can cause, in the cost's unit; 0 for an exact reading.
    """

    reading: Reading
    action: Array
    adjustment: float
    estimate: Array
    bounds: Array
    corners: Array
    residual: float
    gap: float
    allowance: float


@dataclass(frozen=True, eq=False)
class Attack:
    """Beliefs inferred from rows of weights, in the file's order.

    Args:
        model: The investor's model that the observer assumes.
        index: Labels of the rows, T of them.
        rows: One reading per row.
        decimals: Decimals the weights were rounded to, None for full precision.
        regret: The regret allowed besides rounding, in the cost's unit.
        missed: Per row the most by which its weights miss their sum or a limit beyond what rounding explains, shape (T,).
    """

    model: InvestorModel
    index: pd.Index
    rows: tuple[RowReading, ...]
    decimals: int | None
    regret: float = 0.0
    missed: Array | None = None

    def cautions(self) -> list[str]:
        """Return what may be wrong with the weights: rows that were moved onto their sum or a limit, or that are missing where
        each limits the next."""
        found = [] if self.model.turnover is None else missing_rows(self.index)
        if self.missed is None or not self.missed.any():
            return found
        other = ", --digits states another rounding" if self.model.turnover is None else ""
        written = "in full precision" if self.decimals is None else f"rounded to {decimal_places(self.decimals)}"
        moved = (
            f"Caution: {int((self.missed > 0.0).sum())} of {len(self)} rows miss the sum of the weights, or a limit, by up to "
            f"{self.missed.max():.2g} more than weights {written} can. They are moved onto it, which the beliefs do not allow "
            f"for. --normalise scales rows to the sum 1{other}."
        )
        return [moved, *found]

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def estimates(self) -> Array:
        """The observer's estimates, shape (T,X)."""
        return np.array([row.estimate for row in self.rows])

    @property
    def bounds(self) -> Array:
        """Least and greatest probability of each regime, shape (T,X,2)."""
        return np.array([row.bounds for row in self.rows])

    @property
    def actions(self) -> Array:
        """The weights as feasible decisions, shape (T,U)."""
        return np.array([row.action for row in self.rows])

    def count(self, reading: Reading) -> int:
        """Return the number of rows with a reading."""
        return sum(row.reading is reading for row in self.rows)

    def summary(self) -> str:
        """Return one sentence: how many rows were read, and how."""
        explained = [row for row in self.rows if row.reading is not Reading.IMPLAUSIBLE]
        parts = [f"{len(explained)} of {len(self)} rows are explained by a belief"]
        if explained:
            width = np.mean([(row.bounds[:, 1] - row.bounds[:, 0]).max() for row in explained])
            parts.append(f"they leave the widest regime probability open by {width:.3f} on average")
        if len(explained) < len(self):
            gap = max(row.gap - row.allowance for row in self.rows)
            parts.append(
                f"{len(self) - len(explained)} are given their nearest explanation, which leaves up to {regret_text(gap)} of "
                "regret beyond what is allowed for"
            )
        if self.regret:
            parts.append(f"a regret of {regret_text(self.regret)} is allowed for")
        if self.decimals is not None:
            parts.append(f"rounding to {decimal_places(self.decimals)} is allowed for")
        return "; ".join(parts)


def missing_rows(index: pd.Index) -> list[str]:
    """Return a caution if dates miss steps, where rows are taken to follow one another; otherwise none."""
    missing = missing_steps(list(index)) if isinstance(index, pd.DatetimeIndex) else ""
    return [f"Caution: rows follow one another as single steps, but their dates do not: {missing}."] if missing else []


def attack_weights(
    model: InvestorModel,
    weights: WeightsTable | pd.DataFrame,
    *,
    decimals: int | None = None,
    regret: float = 0.0,
    previous: Any = None,
    progress: Progress | None = None,
) -> Attack:
    """Return the beliefs that explain each row of published weights.

    Formula: Π(û) for weights in full precision, Π_ε(û) = {π : ρ(π,û) ≤ ε} for rounded ones and where Π(û) is empty; û is the
    nearest feasible decision and ε bounds the regret that rounding can cause (`adversaries.rounded`).

    Args:
        model: The investor's model that the observer assumes.
        weights: As `read_weights` returns them, or a frame with one column per asset and one row per decision.
        decimals: Digits after the point that the weights were rounded to, at least 0; None takes them from the table,
            and for a frame means full precision.
        regret: The regret allowed, at least 0, in the cost's unit, a return per row: 0.0005 for 5 basis points. Above 0 the
            sets are near-optimal.
        previous: The weights published before the first row, labelled or in the model's order, where the model limits turnover;
            each row of `weights` then limits the next. None: no limit on the first row.
        progress: Called with (rows done, rows in all).

    Returns:
        An `Attack`; a row that no belief explains has a status and raises no error.

    Raises:
        InputError: Columns are not the model's assets, a cell is not finite, there is no row, or a row violates a
            constraint by more than `tolerances.PUBLISHED_SUM` and more than U half units of its last digit; the model limits
            turnover, and weights are rounded or their dates go back in time.

    Cost: about 0.1 s per rounded row with three regimes, 1 s with five; 1 ms per exact row. Source: the paper, Theorem 1;
    `adversaries.rounded` for rounding.

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> from inscrutable.worlds import GaussianEmission, HiddenMarkovModel
        >>> means, spreads = [[0.02, 0.0], [-0.03, 0.0]], [0.01 * np.eye(2), 0.09 * np.eye(2)]
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], GaussianEmission(means, spreads))
        >>> model = InvestorModel(world, MarkowitzProblem(means, spreads, 2.0), ("A", "B"), ("calm", "crisis"))
        >>> published = pd.DataFrame([model.problem.solve([0.8, 0.2])], columns=["A", "B"]).round(2)
        >>> attack_weights(model, published, decimals=2).bounds[0].round(3)
        array([[0.781, 0.827],
               [0.173, 0.219]])
    """
    frame = weights.frame if isinstance(weights, WeightsTable) else weights
    digits = weights.decimals if isinstance(weights, WeightsTable) and decimals is None else decimals
    if digits is not None:
        digits = validation.count(digits, "decimals", least=0)
    published = _aligned(frame, checked_model(model).assets)
    most = validation.non_negative(regret, "regret")
    if model.turnover is not None:
        validation.time_order(frame.index, "weights")
    if model.turnover is not None and digits is not None:
        raise InputError(
            f"the model limits turnover against the weights before, and these are rounded to {decimal_places(digits)}: a limit "
            "is read from weights in full precision alone; give these, or leave out the limit (--turnover, or the key "
            "turnover of the model's file)"
        )
    half = half_unit(FULL_PRECISION_DIGITS if digits is None else digits)
    missed = [
        _missed(model.region_after(before), row, half, _row_name(frame.index, step), model.assets)
        for step, (before, row) in enumerate(zip((previous, *published[:-1]), published, strict=True))
    ]
    rows: list[RowReading] = []
    for row in published:
        rows.append(_read_row(model.problem_after(rows[-1].action if rows else previous), row, digits, most))
        if progress is not None:
            progress(len(rows), len(published))
    return Attack(model, frame.index, tuple(rows), digits, most, np.array(missed))


def _read_row(problem: MarkowitzProblem, published: Array, decimals: int | None, regret: float) -> RowReading:
    if decimals is None and not regret:
        whole = completed(problem, published, 0.0)
        found = belief_set_of(problem, whole.action)
        if not found.is_empty:
            corners = found.vertices()
            return RowReading(
                Reading.EXACT,
                whole.action,
                whole.adjustment,
                found.center(),
                found.bounds(),
                corners,
                found.residual,
                0.0,
                0.0,
            )
    return _read_near(problem, published, half_unit(FULL_PRECISION_DIGITS if decimals is None else decimals), regret)


def regret_text(regret: float) -> str:
    """Return a regret with its unit: basis points of wealth per row of returns, and the number itself."""
    return f"{regret * BASIS_POINTS:.3g} bp of wealth a row ({regret:.1e})"


def _read_near(problem: MarkowitzProblem, published: Array, half: float, regret: float) -> RowReading:
    whole = completed(problem, published, half)
    reach = half + np.abs(whole.action - published)
    allowed = regret + allowance(problem, whole, reach, is_optimal=not regret)
    near = near_optimal_beliefs(problem, whole.action, allowed)
    residual = belief_set_of(problem, whole.action).residual
    if near.is_empty:
        estimate, gap = nearest_explanation(problem, whole.action)
        nothing = np.full((problem.n_states, 2), np.nan)
        corners = np.zeros((0, problem.n_states))
        return RowReading(
            Reading.IMPLAUSIBLE, whole.action, whole.adjustment, estimate, nothing, corners, residual, gap, allowed
        )
    # A smooth set has many corners above two dimensions, and only triangles are drawn.
    corners = near.vertices() if problem.n_states <= _DRAWN_STATES else np.zeros((0, problem.n_states))
    # The outer polytope's bounds: at most a hundredth of ε too wide, never too narrow.
    bounds = np.column_stack([corners.min(axis=0), corners.max(axis=0)]) if len(corners) else near.bounds()
    middle = bounds.mean(axis=1)
    return RowReading(
        Reading.NEAR if regret else Reading.ROUNDED,
        whole.action,
        whole.adjustment,
        near.nearest(middle / middle.sum()),
        bounds,
        corners,
        residual,
        near.plausibility_gap,
        allowed,
    )


def _aligned(frame: Any, assets: tuple[str, ...]) -> Array:
    if not isinstance(frame, pd.DataFrame):
        raise InputError(f"weights must be a WeightsTable or a DataFrame, got {type(frame).__name__}")
    frame = frame.set_axis(as_texts(frame.columns, assets), axis=1)
    columns = list(frame.columns)
    missing = [asset for asset in assets if asset not in columns]
    unknown = [column for column in columns if column not in assets]
    if missing or unknown or len(columns) != len(assets):
        raise InputError(f"weights must have one column per asset; missing: {missing}, unknown: {unknown}")
    if not len(frame):
        raise InputError("weights has no rows; expected at least one")
    try:
        values = frame[list(assets)].to_numpy(dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"weights must be numbers: {error}") from None
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        row, column = (int(i) for i in bad[0])
        raise InputError(f"weights row {_row_name(frame.index, row)}, asset {assets[column]!r}: {values[row, column]}")
    return np.asarray(values)


def _missed(region: Polyhedron, row: Array, half_unit: float, row_name: str, assets: tuple[str, ...]) -> float:
    """Return by how much a row (U,) misses its sum or a limit beyond what rounding explains: U weights miss a sum by U half
    units. Raises `InputError` for a row that is no weights of the model at all."""
    rows, over, most = region, np.empty(0), list[float]()
    if isinstance(region, MagnitudeRegion):  # its limits' excess, and what a unit in every weight adds to each of them
        rows, over = region.rows, region.excess(row)
        most = [(each.weights.sum() + np.abs(each.linear).sum()) / each.weights.max() for each in region.limits]
    scale = np.abs(rows.A_eq).max(axis=1, initial=0.0)
    amounts = np.concatenate([-rows.slacks(row), np.abs(rows.A_eq @ row - rows.b_eq) / scale, over])
    sizes = np.concatenate(
        [np.abs(rows.A_ub).sum(axis=1) / rows.row_scale, np.abs(rows.A_eq).sum(axis=1) / scale, most]
    )
    # A sum exactly at the tolerance, 1.005, must not fail for its last bit.
    allowed = np.maximum(tolerances.PUBLISHED_SUM, half_unit * sizes) + tolerances.FEASIBILITY
    bad = np.flatnonzero(amounts > allowed)
    if bad.size:
        constraint = int(bad[0])
        name = region.names[constraint]
        if "u[" in name:
            for j, asset in enumerate(assets):
                name = name.replace(f"u[{j}]", f"weight of {asset}")
        raise InputError(
            f"weights row {row_name} misses {name!r} by {amounts[constraint]:.3g}, "
            f"expected at most {allowed[constraint]:.3g} from rounding"
            + ("; short holdings need the limit long_short (--long-short)" if name.endswith(">= 0") else "")
        )
    return float(np.maximum(amounts - half_unit * sizes - tolerances.FEASIBILITY, 0.0).max(initial=0.0))


def _row_name(index: pd.Index, row: int) -> str:
    text = label_text(index[row])
    return str(row) if text == str(row) else f"{row} ({text})"
