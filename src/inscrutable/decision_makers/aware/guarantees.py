"""Guarantees of every published decision against the aware observer."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from inscrutable import tolerances, validation
from inscrutable.decision_makers.aware.guaranteed_programme import (
    NO_COLUMN,
    SHARED,
    SPARSE,
    PlayedGame,
    RowBlock,
    RowsAndCuts,
)
from inscrutable.errors import InputError
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.mechanisms.joint import joint_law
from inscrutable.mechanisms.matching import points_in
from inscrutable.mechanisms.priors import checked_prior
from inscrutable.mechanisms.same_actions import first_same
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


class Guarantee(RowsAndCuts):
    """A condition on a mechanism K(u|π) under a prior, for `least_regret`; several conditions can be combined.

    Each guarantee can be recomputed from the mechanism of any decision maker.

    Example:
        >>> from inscrutable import FiniteProblem, OriginalDecisionMaker, PointwiseLeakageCap, Prior, mechanism
        >>> problem, prior = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), Prior(np.eye(2), [0.5, 0.5])
        >>> asked: Guarantee = PointwiseLeakageCap(nats=0.5)
        >>> given = asked.reached(mechanism(OriginalDecisionMaker(problem), prior.beliefs), prior, problem)
        >>> round(given, 4), asked.is_met(given)
        (0.6931, False)
    """

    @property
    @abstractmethod
    def limit(self) -> float:
        """The number that was asked for, in the guarantee's unit."""

    is_floor = False
    """Whether the limit is a least value; otherwise it is a largest one."""

    @abstractmethod
    def level(self, game: PlayedGame, table: Array) -> float:
        """Return the level of a table K, from the table alone."""

    def reached(self, mechanism: Mechanism, prior: Prior, problem: DecisionProblem) -> float:
        """Return the level of a mechanism, computed from K, in the guarantee's unit.

        Args:
            mechanism: K(u|π), of any decision maker.
            prior: Weights of the mechanism's beliefs.
            problem: The decision problem, whose optimal decisions the observer compares with.

        Raises:
            InputError: A belief of the prior is none of the mechanism's, or the problem has another number of states or
                other decisions.
        """
        return self.level(*played_game(mechanism, prior, problem))

    def is_met(self, level: float) -> bool:
        """Return whether a level is within the limit, up to the rounding of sums over beliefs."""
        over = self.limit - level if self.is_floor else level - self.limit
        return over <= tolerances.GUARANTEE_MET

    def most(self, game: PlayedGame) -> float:
        """Return the level of a rule that does not depend on the belief: no floor above it can hold."""
        return np.inf


@dataclass(frozen=True)
class PointwiseLeakageCap(Guarantee):
    """A cap on the pointwise maximal leakage of every published decision.

    Formula: log max_π p(π|u)/p(π) = log max_π K(u|π)/p(u) ≤ ε for every u that is played: no guess at anything about the
    belief becomes more than e^ε times as likely to be right after any one decision.

    Args:
        nats: ε, at least 0; for bits, multiply them by ln 2.

    Raises:
        InputError: The cap is negative or not finite.

    Source: Saeidian, Cervia, Oechtering and Skoglund, Pointwise maximal leakage (IEEE Trans. IT 69, 2023).

    Example:
        >>> print(PointwiseLeakageCap(nats=0.5))
        pointwise maximal leakage at most 0.5 nats
    """

    nats: float
    is_by_decision = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "nats", validation.non_negative(self.nats, "nats"))

    def largest_ratio(self, game: PlayedGame) -> float:
        """e^ε, or max 1/w where no rule has a larger ratio."""
        return _capped(self.nats, 1.0 / float(game.weights.min()))[0]

    @property
    def limit(self) -> float:
        """The largest leakage, in nats."""
        return self.nats

    def __str__(self) -> str:
        return f"pointwise maximal leakage at most {self.nats:.4g} nats"

    def level(self, game: PlayedGame, table: Array) -> float:
        """Return log max K(u|π)/p(u), in nats."""
        return float(np.log(max(_ratios(game, table).max(), 1.0)))

    def rows(self, game: PlayedGame) -> RowBlock:
        """Rows K_bm − e^ε q_m ≤ 0 and q_m − Σ_b p_b K_bm ≤ 0, with q of its own."""
        n_beliefs, n_columns = game.shape
        every = SPARSE.identity(n_beliefs * n_columns)
        factor, slope = _capped(self.nats, 1.0 / float(game.weights.min()))
        of_column = SPARSE.kron(np.ones((n_beliefs, 1)), SPARSE.identity(n_columns))
        law = SPARSE.kron(game.weights[None], SPARSE.identity(n_columns))
        n_rows = (n_beliefs + 1) * n_columns
        return RowBlock(
            SPARSE.vstack([every, -law]).tocsr(),
            SPARSE.vstack([-factor * of_column, SPARSE.identity(n_columns)]).tocsr(),
            np.zeros(n_rows),
            np.concatenate([np.full(n_beliefs * n_columns, slope), np.zeros(n_columns)]),
            np.tile(np.arange(n_columns), n_beliefs + 1),
        )

    def toward_prior(self, game: PlayedGame, table: Array) -> Array:
        """Return (x − e^ε)/(x − 1) for a column whose largest ratio x is too large."""
        ratios = _ratios(game, table)
        return _shares(ratios - self.largest_ratio(game), ratios - 1.0)


@dataclass(frozen=True)
class MaximalLeakageCap(Guarantee):
    """A cap on the maximal leakage of the rule.

    Formula: log Σ_u max_π K(u|π) ≤ L: over all decisions, and for any prior on these beliefs, no guess at anything about
    the belief becomes more than e^L times as likely to be right on average.

    Args:
        nats: L, at least 0; for bits, as `Leakage.maximal_leakage` states them, multiply them by ln 2.

    Raises:
        InputError: The cap is negative or not finite.

    Source: Issa, Wagner and Kamath, An operational approach to information leakage (IEEE Trans. IT 66, 2020).

    Example:
        >>> print(MaximalLeakageCap(nats=0.25))
        maximal leakage at most 0.25 nats
    """

    nats: float
    is_by_decision = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "nats", validation.non_negative(self.nats, "nats"))

    def largest_ratio(self, game: PlayedGame) -> float:
        """∞: its price is that of the largest K_bm."""
        return float("inf")

    @property
    def limit(self) -> float:
        """The largest leakage, in nats."""
        return self.nats

    def __str__(self) -> str:
        return f"maximal leakage at most {self.nats:.4g} nats"

    def level(self, game: PlayedGame, table: Array) -> float:
        """Return log Σ_u max_π K(u|π), in nats."""
        return float(np.log(max(table.max(axis=0).sum(), 1.0)))

    def rows(self, game: PlayedGame) -> RowBlock:
        """Rows K_bm − t_m ≤ 0 and Σ_m t_m ≤ e^L, with t of its own."""
        n_beliefs, n_columns = game.shape
        size, (most, slope) = n_beliefs * n_columns, _capped(self.nats, min(game.shape))
        of_column = SPARSE.kron(np.ones((n_beliefs, 1)), SPARSE.identity(n_columns))
        return RowBlock(
            SPARSE.vstack([SPARSE.identity(size), SPARSE.csr_array((1, size))]).tocsr(),
            SPARSE.vstack([-of_column, np.ones((1, n_columns))]).tocsr(),
            np.append(np.zeros(size), most),
            np.append(np.zeros(size), slope),
            np.append(np.full(size, NO_COLUMN), SHARED),
        )

    def toward_honest(self, game: PlayedGame, table: Array) -> float:
        """Return (x − e^L)/(x − 1) where x = Σ_u max_π K(u|π) is too large: the mixture has at most (1 − θ) x + θ."""
        ratio = float(table.max(axis=0).sum())
        over = ratio - _capped(self.nats, min(game.shape))[0]
        return float(_shares(np.array(over), np.array(ratio - 1.0)))


@dataclass(frozen=True)
class DetectabilityCap(Guarantee):
    """A cap on the total variation between the laws of the published and of the optimal decision.

    Formula: ½ Σ_u |p(u) − q(u)| ≤ δ with p(u) = Σ_b w_b K(u|π_b) and q(u) = Σ_b w_b [u = u*(π_b)]: a test of one
    decision, equally likely from either, is right with probability at most (1 + δ)/2.

    Args:
        total_variation: δ, from 0 to 1; at 0 every decision has the probability that it has under the optimal rule.

    Raises:
        InputError: The cap is no number from 0 to 1.

    Source: Neyman and Pearson (1933); `Detectability.total_variation` reports it.

    Example:
        >>> print(DetectabilityCap(0.1))
        total variation to the optimal rule at most 0.1
    """

    total_variation: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "total_variation", _share(self.total_variation, "total_variation"))

    @property
    def limit(self) -> float:
        """The largest total variation."""
        return self.total_variation

    def __str__(self) -> str:
        return f"total variation to the optimal rule at most {self.total_variation:.4g}"

    def level(self, game: PlayedGame, table: Array) -> float:
        """Return ½ Σ_u |p(u) − q(u)|."""
        return min(0.5 * float(np.abs(game.played(table) - game.honest).sum()), 1.0)

    def rows(self, game: PlayedGame) -> RowBlock:
        """Rows p_m − q_m ≤ v_m and Σ_m v_m ≤ δ: the sum of the positive differences is half of the total."""
        n_columns = game.shape[1]
        law = SPARSE.kron(game.weights[None], SPARSE.identity(n_columns))
        return RowBlock(
            SPARSE.vstack([law, SPARSE.csr_array((1, law.shape[1]))]).tocsr(),
            SPARSE.vstack([-SPARSE.identity(n_columns), np.ones((1, n_columns))]).tocsr(),
            np.append(game.honest, self.total_variation),
            np.append(np.zeros(n_columns), 1.0),
            np.append(np.full(n_columns, NO_COLUMN), SHARED),
        )

    def toward_honest(self, game: PlayedGame, table: Array) -> float:
        """Return 1 − δ/x where the total variation x is too large."""
        level = self.level(game, table)
        return float(_shares(np.array(level - self.total_variation), np.array(level)))


@dataclass(frozen=True)
class NamingErrorFloor(Guarantee):
    """A floor on the probability that the best guess of the state is wrong, after every published decision.

    Formula: 1 − max_i E[π_i|u] ≥ e for every u that is played, where E[π_i|u] is the probability of state i for an observer who
    has seen u.

    Args:
        least: e, from 0 to 1; no more than 1 − max_i E[π_i], the observer's error before any decision, is possible.

    Raises:
        InputError: The floor is no number from 0 to 1.

    Source: the Bayes risk of naming the state; compare Smith, On the foundations of quantitative information flow (2009).

    Example:
        >>> print(NamingErrorFloor(0.3))
        naming error after every decision at least 0.3
    """

    least: float
    is_floor = True
    is_by_decision = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "least", _share(self.least, "least"))

    @property
    def limit(self) -> float:
        """The least error, a probability."""
        return self.least

    def __str__(self) -> str:
        return f"naming error after every decision at least {self.least:.4g}"

    def level(self, game: PlayedGame, table: Array) -> float:
        """Return min_u (1 − max_i E[π_i|u])."""
        some = game.played(table) > 0
        return float(1.0 - game.means(table)[some].max())

    def rows(self, game: PlayedGame) -> RowBlock:
        """Rows Σ_b p_b K_bm (π_bi − 1 + e) ≤ 0 for every state i and column m."""
        n_columns = game.shape[1]
        over = _scale(game) * game.weights[:, None] * (game.beliefs - 1.0 + self.least)  # (B,X)
        return _by_columns([SPARSE.kron(state[None], SPARSE.identity(n_columns)) for state in over.T], _scale(game))

    def toward_prior(self, game: PlayedGame, table: Array) -> Array:
        """Return the share at which the largest probability of a state falls to 1 − e; it is linear in the share."""
        means, prior = game.means(table), game.weights @ game.beliefs
        over = means - (1.0 - self.least)
        return np.asarray(_shares(over, means - prior).max(axis=1))

    def most(self, game: PlayedGame) -> float:
        """Return 1 − max_i E[π_i]."""
        return float(1.0 - (game.weights @ game.beliefs).max())


@dataclass(frozen=True)
class _SquareErrors(Guarantee):
    """A floor on mean square errors, by cutting planes: a row for each estimate found so far."""

    least: float
    is_floor = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "least", validation.non_negative(self.least, "least"))

    @property
    def limit(self) -> float:
        """The least mean square error, in squared units of belief."""
        return self.least

    def most(self, game: PlayedGame) -> float:
        """Return Σ w ‖π − Σ w π‖²."""
        return float(game.weights @ ((game.beliefs - game.weights @ game.beliefs) ** 2).sum(axis=1))

    def _cuts_after(self, game: PlayedGame, table: Array, which: np.ndarray) -> RowBlock:
        """The rows of the posterior means after some decisions, for these and their neighbours."""
        near = game.near[which]
        return self._rows(game, near.ravel(), np.repeat(game.means(table)[which], near.shape[1], axis=0))

    @abstractmethod
    def _rows(self, game: PlayedGame, which: np.ndarray, means: Array) -> RowBlock:
        """Return the rows of estimates (n,X) after decisions (n,)."""


@dataclass(frozen=True)
class SquaredErrorFloor(_SquareErrors):
    """A floor on the mean square error of the best estimate of the belief after every published decision.

    Formula: E[‖π − E[π|u]‖² | u] ≥ v for every u that is played.

    Args:
        least: v, at least 0, in squared units of belief (Euclidean); at most Σ w ‖π − Σ w π‖², the square of `Prior.error`.

    Raises:
        InputError: The floor is negative or not finite.

    Source: the Bayes risk of estimation under a squared loss.

    Example:
        >>> print(SquaredErrorFloor(0.04))
        mean square error after every decision at least 0.04
    """

    def __str__(self) -> str:
        return f"mean square error after every decision at least {self.least:.4g}"

    def level(self, game: PlayedGame, table: Array) -> float:
        """Return min_u E[‖π − E[π|u]‖² | u]."""
        return float(game.square_errors(table)[game.played(table) > 0].min())

    def rows(self, game: PlayedGame) -> RowBlock:
        """The rows of estimates at the prior's mean: Σ_b p_b K_bm (v − ‖π_b − μ‖²) ≤ 0, right for any estimate μ."""
        count = game.shape[1]
        return self._rows(game, np.arange(count), np.tile(game.weights @ game.beliefs, (count, 1)))

    def cuts(self, game: PlayedGame, table: Array) -> RowBlock | None:
        """The rows of the posterior means after decisions that miss the floor, for these and their neighbours."""
        missed = self.least - game.square_errors(table)
        which = np.flatnonzero(missed > tolerances.GUARANTEE_ROUNDING)
        if not which.size:
            return None
        return self._cuts_after(game, table, which)

    def toward_prior(self, game: PlayedGame, table: Array) -> Array:
        """Return (v − x)/(x₀ − x) for a column of error x below the floor, where the prior's is x₀: the error is concave."""
        errors = game.square_errors(table)
        return _shares(self.least - errors, self.most(game) - errors)

    def _rows(self, game: PlayedGame, which: np.ndarray, means: Array) -> RowBlock:
        n_columns, scale = game.shape[1], _scale(game)
        short = scale * game.weights[:, None] * (self.least - game.squares(means))  # (B, rows)
        nothing = SPARSE.csr_array((len(which), 0))
        table = of_columns(short, which, n_columns)
        return RowBlock(table, nothing, np.zeros(len(which)), np.full(len(which), scale), which)


@dataclass(frozen=True)
class MeanSquaredErrorFloor(_SquareErrors):
    """A floor on the mean square error of the best estimate of the belief, on average over the published decisions.

    Formula: Σ_u p(u) E[‖π − E[π|u]‖² | u] ≥ v. A `StackelbergDecisionMaker` maximises the left-hand side.

    Args:
        least: v, at least 0, in squared units of belief (Euclidean); at most the square of `Prior.error`.

    Raises:
        InputError: The floor is negative or not finite.

    Source: the Bayes risk of estimation under a squared loss; `Leakage.bayes_error` is its root.

    Example:
        >>> print(MeanSquaredErrorFloor(0.04))
        mean square error of at least 0.04 on average
    """

    def __str__(self) -> str:
        return f"mean square error of at least {self.least:.4g} on average"

    def level(self, game: PlayedGame, table: Array) -> float:
        """Return Σ_u p(u) E[‖π − E[π|u]‖² | u]."""
        return float(game.played(table) @ game.square_errors(table))

    def rows(self, game: PlayedGame) -> RowBlock:
        """The row Σ_m s_m ≤ Σ p ‖π − π₀‖² − v and those of estimates at the prior's mean π₀, s_m ≥ p(u) ‖E[π|u] − π₀‖²."""
        (n_beliefs, n_columns), most = game.shape, self.most(game)
        every = np.arange(n_columns)
        cuts = self._rows(game, every, np.tile(game.weights @ game.beliefs, (n_columns, 1)))
        return RowBlock(
            SPARSE.vstack([SPARSE.csr_array((1, n_beliefs * n_columns)), cuts.table]).tocsr(),
            SPARSE.vstack([np.ones((1, n_columns)), cuts.extra]).tocsr(),
            np.append(most - self.least, cuts.sides),
            np.append(1.0, cuts.slopes),
            np.append(SHARED, cuts.columns),
        )

    def cuts(self, game: PlayedGame, table: Array) -> RowBlock | None:
        """The rows of the posterior means after all decisions that are played, for these and their neighbours."""
        if self.least - self.level(game, table) <= tolerances.GUARANTEE_ROUNDING:
            return None
        which = np.flatnonzero(game.played(table) > 0)
        return self._cuts_after(game, table, which)

    def toward_honest(self, game: PlayedGame, table: Array) -> float:
        """Return (v − x)/(x₀ − x) for an error x below the floor, where the prior's is x₀: the error is concave."""
        level = self.level(game, table)
        return float(_shares(np.array(self.least - level), np.array(self.most(game) - level)))

    def _rows(self, game: PlayedGame, which: np.ndarray, means: Array) -> RowBlock:
        """Rows Σ_b p_b K_bm (2 (π_b − π₀)·(μ − π₀) − ‖μ − π₀‖²) ≤ s_m, right for any estimate μ.

        In units of their largest coefficient: near the prior's mean HiGHS would drop the smallest.
        """
        middle, count = game.weights @ game.beliefs, len(which)
        apart = means - middle
        gains = game.weights[:, None] * (2.0 * (game.beliefs - middle) @ apart.T - (apart**2).sum(axis=1))
        largest = np.abs(gains).max(axis=0)
        unit = np.where(largest > tolerances.GUARANTEE_ROUNDING, largest, 1.0)
        own = SPARSE.csr_array((1.0 / unit, (np.arange(count), which)), shape=(count, game.shape[1]))
        table, nothing = of_columns(gains / unit, which, game.shape[1]), np.zeros(count)
        return RowBlock(table, -own, nothing, nothing, np.full(count, NO_COLUMN))


def played_game(mechanism: Mechanism, prior: Prior, problem: DecisionProblem) -> tuple[PlayedGame, Array]:
    """Return the beliefs with weight, the optimal rule's law on all decisions, and K on them."""
    joint = joint_law(mechanism, prior)
    some, points = joint.weights > 0, points_in(problem, mechanism)
    checked_prior(prior, problem)
    kept, place = np.unique(
        first_same(np.vstack([points, problem.solve_points(joint.beliefs[some])])), return_inverse=True
    )
    place = place.reshape(-1)
    honest = np.bincount(place[len(points) :], weights=joint.weights[some], minlength=len(kept)).astype(np.float64)
    table = np.zeros((len(some), len(kept)))
    np.add.at(table, (joint.row, place[joint.column]), joint.conditional)
    return PlayedGame(joint.beliefs[some], joint.weights[some], honest, np.arange(len(kept))[:, None]), table[some]


def _capped(nats: float, most: float) -> tuple[float, float]:
    """e^nats and its derivative; the largest possible value, and 0, where that is smaller and the cap never binds."""
    return (most, 0.0) if nats >= np.log(most) else (float(np.exp(nats)),) * 2


def _ratios(game: PlayedGame, table: Array) -> Array:
    """max_π K(u|π)/p(u), shape (M,); 1 where u is not played."""
    played = game.played(table)
    return np.where(played > 0, table.max(axis=0) / np.where(played > 0, played, 1.0), 1.0)


def _shares(missed: Array, room: Array) -> Array:
    """The shortfall as a share of the possible gain, at most 1; 0 where the shortfall is rounding.

    Where the prior itself only just gives the guarantee, a larger shortfall counts as rounding, or the share would be 1.
    """
    edge = missed > tolerances.DEAREST_REPAIR * room
    is_missed = missed > np.where(edge, tolerances.GUARANTEE_MET, tolerances.GUARANTEE_ROUNDING)
    return np.where(is_missed, missed / np.where(is_missed, np.maximum(room, missed), 1.0), 0.0)


def _scale(game: PlayedGame) -> float:
    """The factor that brings the largest coefficients of weighted rows near one."""
    return 1.0 / float(game.weights.max())


def of_columns(values: Array, which: np.ndarray, n_columns: int) -> Any:
    """Return rows with values (B,n) for the beliefs' entries in one column each (n,)."""
    belief, row = np.indices(values.shape).reshape(2, -1)
    shape = values.shape[1], len(values) * n_columns
    return SPARSE.csr_array((values.ravel(), (row, belief * n_columns + which[row])), shape=shape)


def _by_columns(tables: list[Any], scale: float) -> RowBlock:
    table = SPARSE.vstack(tables).tocsr()
    n_rows = table.shape[0]
    columns = np.tile(np.arange(n_rows // len(tables)), len(tables))
    return RowBlock(table, SPARSE.csr_array((n_rows, 0)), np.zeros(n_rows), np.full(n_rows, scale), columns)


def _share(value: object, name: str) -> float:
    number = validation.non_negative(value, name)
    if number > 1.0:
        raise InputError(f"{name} must be from 0 to 1, got {number:g}")
    return number
