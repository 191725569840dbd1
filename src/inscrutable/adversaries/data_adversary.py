"""The observer who learns from past pairs of beliefs and decisions, without costs, rule or prior."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.adversaries.learners import Learner, learners
from inscrutable.axes import Axis, ordered_array
from inscrutable.errors import InputError
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.mechanisms.joint import Joint, joint_law
from inscrutable.validation import Array

LEAST_PAIRS, MOST_PAIRS = 10, 10_000_000
"""Fewer pairs cannot be divided into those that are learned from and those that judge; more, of twelve assets and three states,
take over a gigabyte."""
_TRIED_SHARE = 0.3
"""Share of the pairs (the last ones) on which learners are compared; the best one is then fitted to all pairs."""


class DataAdversary:
    """An observer who has learned from pairs of belief and decision, and knows neither costs nor rule nor prior.

    Formula: the estimate is the prediction ŷ(u) of one learner (ridge regression, nearest neighbours, a tree, or the mean
    belief): the one of least error on the last 30 % of the pairs after fitting to the first 70 %. Negative entries are set to
    0, and the sum is scaled to one.

    Args:
        beliefs: The beliefs of past decisions, shape (n,X), n at least 10; in order of time where they have one.
        actions: The decisions, shape (n,U); (n,) where they are finite choices, numbers or texts. A choice that is in no pair
            counts as none of those seen.

    Raises:
        InputError: An argument is malformed, or scikit-learn, the extra `inscrutable[audit]`, is missing.

    Cost: a few milliseconds for a thousand pairs, and as much for every call that reads decisions.

    Source: the learners of `audit_pairs`; scikit-learn.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> first = rng.random(500)
        >>> seen = DataAdversary(np.column_stack([first, 1 - first]), (first > 0.6).astype(int))
        >>> seen.estimate(1).round(1)
        array([0.8, 0.2])
    """

    def __init__(self, beliefs: ArrayLike, actions: ArrayLike) -> None:
        # Rows keep their labels even where these are 0, 1, …: a reversed table has them in another order.
        rows = [_row_labels(each) for each in (beliefs, actions)]
        if None not in rows and rows[0] != rows[1]:
            raise InputError(
                "rows of beliefs and actions have other labels, or stand in another order: they must be pairs"
            )
        states = Axis("state", learns=True)
        self._beliefs = validation.stochastic_rows(beliefs, "beliefs", axes=(None, states))
        self._assets = Axis("asset", learns=True)
        given = ordered_array(actions, "actions", (None, self._assets))
        if given.ndim not in (1, 2) or len(given) != len(self._beliefs) or not given.size:
            raise InputError(
                f"actions must be as many decisions as there are beliefs, {len(self._beliefs)}, got shape {given.shape}"
            )
        if len(given) < LEAST_PAIRS:
            raise InputError(f"an observer of data needs at least {LEAST_PAIRS} pairs, got {len(given)}")
        self._choices = _distinct(given) if given.ndim == 1 else None
        self._width = None if given.ndim == 1 else given.shape[1]
        self._points = self._read(given)
        self.learner = self._best()

    @classmethod
    def of(cls, mechanism: Mechanism, prior: Prior, n_pairs: int, *, rng: np.random.Generator) -> Self:
        """Return an observer that has seen `n_pairs` pairs drawn from a prior and a mechanism, both unknown to it."""
        beliefs, actions = sampled_pairs(joint_law(mechanism, prior), mechanism, n_pairs, rng)
        return cls(beliefs, actions)

    def __repr__(self) -> str:
        return f"DataAdversary({len(self._beliefs)} pairs, {self.learner})"

    def infer(self, action: ArrayLike) -> Array:
        """Return the estimated mean belief after a decision, shape (X,); this observer has no posterior law."""
        return self.estimate(action)

    def estimate(self, action: ArrayLike, *, nearest: bool = False) -> Array:
        """Return the estimate of the belief after one decision, shape (X,); it always exists, so `nearest` has no effect."""
        given = ordered_array(action, "action", (self._assets,))
        return np.asarray(self.estimates(given[None], nearest=nearest)[0])

    def estimates(self, actions: ArrayLike, *, nearest: bool = False) -> Array:
        """Return `estimate` for many decisions (M,U), shape (M,X); (M,) where they are finite choices."""
        given = ordered_array(actions, "actions", (None, self._assets))
        if given.ndim != (1 if self._width is None else 2) or (given.ndim == 2 and given.shape[1] != self._width):
            wanted = "(M,)" if self._width is None else f"(M,{self._width})"
            raise InputError(f"actions must be many decisions of shape {wanted}, got shape {given.shape}")
        points = self._read(given)
        return self._fitted(self.learner, self._points, self._beliefs, points) if len(points) else self._beliefs[:0]

    def _read(self, actions: np.ndarray) -> Array:
        """Return decisions as points; a finite choice becomes its indicator vector."""
        if self._choices is not None:
            _check_known(actions)
            return np.asarray(actions[:, None] == self._choices[None], dtype=np.float64)
        return validation.finite_array(actions, "actions", ndim=2)

    def _best(self) -> str:
        """Return the learner of least error on the last pairs."""
        known = len(self._points) - max(int(_TRIED_SHARE * len(self._points)), 1)
        errors = {}
        for name in (MEAN, *learners()):
            guesses = self._fitted(name, self._points[:known], self._beliefs[:known], self._points[known:])
            errors[name] = float(((guesses - self._beliefs[known:]) ** 2).sum())
        return min(errors, key=lambda name: errors[name])

    @staticmethod
    def _fitted(name: str, known: Array, beliefs: Array, read: Array) -> Array:
        make: Learner = _mean if name == MEAN else learners()[name]
        found = np.maximum(make(known, read)(beliefs[:, None, :])[:, 0], 0.0)
        return np.asarray(found / found.sum(axis=1, keepdims=True))


MEAN = "mean"
_UNKNOWN = ("nan", "<NA>", "NaT")
"""What numpy and pandas write for a missing value."""


def _row_labels(table: Any) -> tuple[Any, ...] | None:
    return tuple(table.index) if hasattr(table, "to_numpy") and hasattr(table, "index") else None


def _distinct(choices: np.ndarray) -> np.ndarray:
    """Return the choices that differ, sorted where they have an order."""
    _check_known(choices)
    try:
        return np.unique(choices)
    except TypeError:  # numbers and texts
        found = np.empty(len(kinds := dict.fromkeys(choices.tolist())), dtype=object)
        found[:] = list(kinds)
        return found


def _check_known(choices: np.ndarray) -> None:
    missing = np.isnan(choices) if choices.dtype.kind in "fc" else np.zeros(len(choices), dtype=np.bool_)
    if choices.dtype.kind in "OMm":
        missing = np.array([_is_missing(each) for each in choices], dtype=np.bool_)
    if missing.any():
        i = int(missing.argmax())
        raise InputError(f"actions has {choices[i]} at index [{i}]; every choice must be known")


def _is_missing(choice: Any) -> bool:
    return choice is None or (not isinstance(choice, str) and str(choice) in _UNKNOWN)


def _mean(known: Array, read: Array) -> Any:
    return lambda targets: np.broadcast_to(targets.mean(axis=0), (len(read), *targets.shape[1:]))


def sampled_pairs(
    joint: Joint, mechanism: Mechanism, n_pairs: int, rng: np.random.Generator
) -> tuple[Array, np.ndarray]:
    """Return beliefs (n,X) and decisions (n,U) drawn independently from their joint law."""
    count = validation.count(n_pairs, "n_pairs")
    if count > MOST_PAIRS:
        raise InputError(f"n_pairs must be at most {MOST_PAIRS:,}, got {count:,}")
    drawn = validation.generator(rng).choice(len(joint.mass), size=count, p=joint.mass / joint.mass.sum())
    return joint.beliefs[joint.row[drawn]], np.asarray(mechanism.actions)[joint.column[drawn]]
