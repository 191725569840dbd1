"""Learners of a secret from decisions alone, by scikit-learn: nearest neighbours, ridge regression, a tree."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from inscrutable import tolerances, validation
from inscrutable.errors import InputError
from inscrutable.validation import Array

Fitted = Callable[[Array], Array]
"""Maps targets (n,S,C) of the training rows to predictions (m,S,C): S separate tasks on the same decisions."""
Learner = Callable[[Array, Array], Fitted]
"""Maps training decisions (n,P) and test decisions (m,P) to a predictor; work that depends on these alone is done once."""

_LEAST_NEIGHBOURS = 10
_RIDGE_SHARES = (0.01, 0.3)
"""Ridge penalties as shares of a standardised column's sum of squares."""
_MOST_LEAVES = 32
_LEAST_LEAF = 10
_LEAST_LEAF_SHARE = 0.01
_MOST_ROWS = 5_000
"""Latest rows that neighbours and trees learn from; with more rows they take minutes."""


def learners() -> Mapping[str, Learner]:
    """Return the learners by name, the simplest first; raise `InputError` without scikit-learn."""
    _imported()
    ridge = {f"ridge, penalty {share:g}": _ridge(share) for share in reversed(_RIDGE_SHARES)}
    return {
        name: _unchecked(each) for name, each in {**ridge, "nearest neighbours": _neighbours, "tree": _tree}.items()
    }


def _unchecked(learner: Learner) -> Learner:
    """The same without scikit-learn's checks of parameters and numbers, which on hundreds of rows take half of the time."""

    def trusting(known: Array, read: Array) -> Fitted:
        from sklearn import config_context

        def trusted() -> Any:
            return config_context(assume_finite=True, skip_parameter_validation=True)

        with trusted():
            fitted = learner(known, read)

        def predict(targets: Array) -> Array:
            with trusted():
                return fitted(targets)

        return predict

    return trusting


def _neighbours(known: Array, read: Array) -> Fitted:
    from sklearn.neighbors import NearestNeighbors

    points, queries = _standardised(known[-_MOST_ROWS:], read)
    # Equal decisions are predicted once.
    queries, place = np.unique(queries, axis=0, return_inverse=True)
    count = min(max(_LEAST_NEIGHBOURS, round(np.sqrt(len(points)))), len(points))
    near = NearestNeighbors(n_neighbors=count).fit(points).kneighbors(queries, return_distance=False)

    def predict(targets: Array) -> Array:
        latest = targets[-len(points) :]
        total = np.zeros((len(queries), *targets.shape[1:]))
        for column in near.T:
            total += latest[column]
        return np.asarray((total / count)[place.reshape(-1)])

    return predict


def _ridge(share: float) -> Learner:
    def learner(known: Array, read: Array) -> Fitted:
        from sklearn.linear_model import Ridge

        points, queries = _standardised(known, read)

        def predict(targets: Array) -> Array:
            flat = targets.reshape(len(targets), -1)
            fitted = Ridge(alpha=share * len(points), solver="cholesky").fit(points, flat)
            return np.asarray(fitted.predict(queries)).reshape(len(queries), *targets.shape[1:])

        return predict

    return learner


def _tree(known: Array, read: Array) -> Fitted:
    from sklearn.tree import DecisionTreeRegressor

    # Trees compute in single precision, and so does this: otherwise the same number could fall on either side of a split. They
    # take numbers within 1e-7 for equal, so decisions come in units of their spread; and a variance of 2e-16 for none, so
    # targets come in units of a power of two near their spread, which rounds nothing. They compute variances as differences of
    # squares, so whole thousands of units near the mean are taken off.
    scaled = _standardised(known[-_MOST_ROWS:], read)
    points, queries = (np.ascontiguousarray(part, dtype=np.float32) for part in scaled)
    leaf = max(_LEAST_LEAF, int(_LEAST_LEAF_SHARE * len(points)))

    def predict(targets: Array) -> Array:
        latest = targets[-len(points) :]
        found = np.empty((len(queries), *targets.shape[1:]))
        for s in range(targets.shape[1]):
            tree = DecisionTreeRegressor(min_samples_leaf=leaf, max_leaf_nodes=_MOST_LEAVES, random_state=0)
            unit = np.ldexp(1.0, np.frexp(latest[:, s].std())[1])
            step = tolerances.COMMON_COST * unit
            centre = step * np.round(latest[:, s].mean(axis=0) / step)
            tree.fit(points, (latest[:, s] - centre) / unit, check_input=False)
            found[:, s] = centre + unit * tree.predict(queries, check_input=False).reshape(len(queries), -1)
        return found

    return predict


def _standardised(known: Array, read: Array) -> tuple[Array, Array]:
    """Return both standardised by the mean and spread of the training decisions."""
    centre, spread = known.mean(axis=0), known.std(axis=0)
    unit = np.where(validation.constant_columns(known), 1.0, spread)
    return np.asarray((known - centre) / unit), np.asarray((read - centre) / unit)


def _imported() -> Any:
    try:
        import sklearn
    except ImportError as error:
        raise InputError(
            f"learning from data alone needs scikit-learn, which could not be loaded ({error}): "
            "pip install 'inscrutable[audit]'"
        ) from None
    return sklearn
