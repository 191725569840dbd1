"""Hidden Markov models fitted by other packages, read from their own objects; none of the packages is imported."""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable import validation
from inscrutable.axes import few
from inscrutable.errors import InputError
from inscrutable.validation import Array
from inscrutable.worlds.emissions import CategoricalEmission, GaussianEmission
from inscrutable.worlds.hidden_markov import HiddenMarkovModel


def from_hmmlearn(model: Any) -> HiddenMarkovModel:
    """Return the world of a fitted `GaussianHMM` or `CategoricalHMM` of hmmlearn.

    Formula: P = ``transmat_``, rows sum to one; π_0 = ``startprob_``; states in its order.

    Args:
        model: The fitted model; any kind of covariance.

    Raises:
        InputError: It was not fitted, or has another observation model, such as a mixture or counts of several trials.
        ModelError: A covariance is singular.

    Cost: none. Source: hmmlearn, module `hmm`.

    Example:
        >>> from types import SimpleNamespace
        >>> fitted = SimpleNamespace(
        ...     transmat_=[[0.9, 0.1], [0.3, 0.7]], startprob_=[1.0, 0.0], emissionprob_=[[0.8, 0.2], [0.1, 0.9]]
        ... )
        >>> from_hmmlearn(fitted).transition
        array([[0.9, 0.1],
               [0.3, 0.7]])
    """
    parts = _fitted(model, ("transmat_", "startprob_"), "a fitted GaussianHMM or CategoricalHMM of hmmlearn")
    if hasattr(model, "weights_"):
        raise InputError(
            f"{type(model).__name__} has mixtures as its observation model, expected Gaussian or categorical ones"
        )
    if hasattr(model, "n_trials"):  # its probabilities are of one trial, its observations are counts
        raise InputError(f"{type(model).__name__} observes counts of trials, expected a GaussianHMM or CategoricalHMM")
    if hasattr(model, "emissionprob_"):
        return HiddenMarkovModel(parts[0], CategoricalEmission(model.emissionprob_), parts[1])
    means, covariances = _fitted(model, ("means_", "covars_"), "a fitted GaussianHMM of hmmlearn")
    if getattr(model, "covariance_type", "") == "spherical":  # hmmlearn 0.3.3 repeats each of them for every dimension
        covariances = covariances[:: len(covariances) // len(means)]
    return HiddenMarkovModel(parts[0], GaussianEmission(means, covariances), parts[1])


def from_statsmodels(results: Any) -> HiddenMarkovModel:
    """Return the world of a Markov regression of statsmodels on an intercept alone.

    Formula: P is the transpose of its regime_transition, whose columns sum to one; means const[i], variances sigma2[i], or
    sigma2 for all; the initial law is the stationary one, as there by default.

    Args:
        results: The result of `MarkovRegression(...).fit()`.

    Raises:
        InputError: It is no such result, has regressors, autoregression, or a transition that varies in time.
        ModelError: A variance is zero, or the stationary law is not unique.

    Cost: none. Source: statsmodels, `tsa.regime_switching`; Hamilton (Econometrica 57, 1989).

    Example:
        >>> from_statsmodels("fit")
        Traceback (most recent call last):
        ...
        inscrutable.errors.InputError: expected the results of MarkovRegression(...).fit() of statsmodels, got 'fit'
    """
    what = "the results of MarkovRegression(...).fit() of statsmodels"
    transition, given, model = (_attribute(results, name, what) for name in ("regime_transition", "params", "model"))
    table = validation.finite_array(transition, "regime_transition", ndim=(2, 3))
    table = table[:, :, None] if table.ndim == 2 else table
    if table.shape[2] > 1:
        raise InputError("the transition varies in time, expected a constant one")
    names = [str(name) for name in _attribute(model, "param_names", what)]
    values = dict(zip(names, np.asarray(given, dtype=np.float64).tolist(), strict=True))
    n_states = len(table)
    others = [name for name in names if not name.startswith(("p[", "const", "sigma2"))]
    if others:
        raise InputError(f"the regression has {few(others)}; expected an intercept and variances alone")
    means, variances = (
        [values.get(f"{part}[{i}]", values.get(part, 0.0 if part == "const" else np.nan)) for i in range(n_states)]
        for part in ("const", "sigma2")
    )
    law = GaussianEmission(np.array(means)[:, None], np.array(variances)[:, None, None])
    return HiddenMarkovModel(table[:, :, 0].T, law)


def from_dynamax(params: Any) -> HiddenMarkovModel:
    """Return the world of a parameter set of a Gaussian or categorical HMM of dynamax.

    Formula: P = transitions.transition_matrix; π_0 = initial.probs; means and covs, or probs of one categorical variable.

    Args:
        params: As `hmm.initialize` and `hmm.fit_em` return it.

    Raises:
        InputError: It is no such set, or has another observation model.
        ModelError: A covariance is singular.

    Cost: none. Source: dynamax, module `hidden_markov_model`.

    Example:
        >>> from types import SimpleNamespace as Set
        >>> params = Set(
        ...     initial=Set(probs=[0.5, 0.5]), transitions=Set(transition_matrix=[[0.9, 0.1], [0.2, 0.8]]),
        ...     emissions=Set(means=[[0.0], [1.0]], covs=[[[1.0]], [[2.0]]]),
        ... )
        >>> from_dynamax(params)
        HiddenMarkovModel(2 states, GaussianEmission(2 states, 1 dimensions))
    """
    what = "a parameter set of a Gaussian or categorical HMM of dynamax"
    initial, transitions, emissions = (
        _attribute(params, name, what) for name in ("initial", "transitions", "emissions")
    )
    start, rows = _attribute(initial, "probs", what), _attribute(transitions, "transition_matrix", what)
    if hasattr(emissions, "probs"):
        table = validation.finite_array(emissions.probs, "emissions.probs", ndim=(2, 3))
        if table.ndim == 3 and table.shape[1] != 1:
            raise InputError(f"emissions.probs has {table.shape[1]} variables; expected one")
        law: Any = CategoricalEmission(table.reshape(len(table), -1))
    else:
        means = np.asarray(_attribute(emissions, "means", what), dtype=np.float64)
        law = GaussianEmission(means, np.asarray(_attribute(emissions, "covs", what), dtype=np.float64))
    return HiddenMarkovModel(np.asarray(rows, dtype=np.float64), law, np.asarray(start, dtype=np.float64))


def _attribute(given: Any, name: str, what: str) -> Any:
    if not hasattr(given, name):
        raise InputError(f"expected {what}, got {given!r:.60}")
    return getattr(given, name)


def _fitted(model: Any, names: tuple[str, ...], what: str) -> list[Array]:
    missing = [name for name in names if not hasattr(model, name)]
    if missing:
        raise InputError(f"expected {what}, which has {few(missing)}; got {model!r:.60}")
    return [np.asarray(getattr(model, name), dtype=np.float64) for name in names]
