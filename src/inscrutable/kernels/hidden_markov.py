"""Recursions of a hidden Markov model over X states, T observations and D dimensions, in log space.

With prior a_0 = log p(x_0), transition P and log-likelihoods l_t(i) = log p(y_t | x_t = i):

    filter    m_t = max_i (a_t(i) + l_t(i)),   c_t = m_t + log Σ_i exp(a_t(i) + l_t(i) − m_t)
              log π_t(i) = a_t(i) + l_t(i) − c_t,   a_{t+1}(j) = log Σ_i exp(log π_t(i) + log P_ij)
    smoother  log γ_t(i) = log π_t(i) + log Σ_j exp(log P_ij + log γ_{t+1}(j) − a_{t+1}(j)),   γ_{T-1} = π_{T-1}

The prior stands inside the maximum, so the largest term of each sum is exp(0) and a state that is a thousand
orders of magnitude less likely keeps its exact logarithm for the steps that follow.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.options import internal, kernel


@internal
def _largest(values: Any) -> float:
    largest = -np.inf
    for value in values:
        largest = max(largest, value)
    return largest


@internal
def _log_sum_exp(values: Any) -> float:
    """log Σ exp(values), −inf where every value is −inf."""
    largest = _largest(values)
    if largest == -np.inf:
        return -np.inf
    total = 0.0
    for value in values:
        total += np.exp(value - largest)
    return float(largest + np.log(total))


@kernel
def filter_pass(log_prior: Any, log_transition: Any, log_likelihoods: Any) -> Any:
    """Filter log-likelihoods (T,X): log beliefs, log predictions (T,X), beliefs, predictions (T,X), log c_t (T,).

    Stops at the first observation with c_t = −inf; its entry says which one it was.
    """
    n_steps, n_states = log_likelihoods.shape
    log_beliefs = np.full((n_steps, n_states), -np.inf)
    log_predicted = np.full((n_steps, n_states), -np.inf)
    beliefs = np.zeros((n_steps, n_states))
    predicted = np.zeros((n_steps, n_states))
    increments = np.zeros(n_steps)
    joint = np.empty(n_states)
    prior = log_prior.copy()
    for t in range(n_steps):
        for i in range(n_states):
            joint[i] = prior[i] + log_likelihoods[t, i]
        largest = _largest(joint)
        if largest == -np.inf:
            increments[t] = -np.inf
            break
        total = 0.0
        for i in range(n_states):
            beliefs[t, i] = np.exp(joint[i] - largest)
            total += beliefs[t, i]
        for i in range(n_states):
            beliefs[t, i] /= total
            log_beliefs[t, i] = joint[i] - largest - np.log(total)
        increments[t] = largest + np.log(total)
        for j in range(n_states):
            for i in range(n_states):
                joint[i] = log_beliefs[t, i] + log_transition[i, j]
            prior[j] = _log_sum_exp(joint)
            log_predicted[t, j] = prior[j]
            predicted[t, j] = np.exp(prior[j])
    return log_beliefs, log_predicted, beliefs, predicted, increments


@kernel
def expectation_pass(log_beliefs: Any, log_predicted: Any, log_transition: Any) -> Any:
    """Smooth a filter pass: γ (T,X) and the expected transition counts Σ_t p(x_t, x_{t+1} | y_0..T-1) (X,X)."""
    n_steps, n_states = log_beliefs.shape
    smoothed = np.empty((n_steps, n_states))
    counts = np.zeros((n_states, n_states))
    later = log_beliefs[n_steps - 1].copy()
    ratio = np.empty(n_states)
    terms = np.empty(n_states)
    for j in range(n_states):
        smoothed[n_steps - 1, j] = np.exp(later[j])
    for t in range(n_steps - 2, -1, -1):
        for j in range(n_states):
            reachable = log_predicted[t, j] > -np.inf
            ratio[j] = later[j] - log_predicted[t, j] if reachable else -np.inf
        for i in range(n_states):
            for j in range(n_states):
                terms[j] = log_transition[i, j] + ratio[j]
                counts[i, j] += np.exp(log_beliefs[t, i] + terms[j])
            later[i] = log_beliefs[t, i] + _log_sum_exp(terms)
            smoothed[t, i] = np.exp(later[i])
    return smoothed, counts


@kernel
def gaussian_log_densities(observations: Any, means: Any, factors: Any) -> Any:
    """Log densities (T,X) of N(m_i, L_i L_i') at observations (T,D).

    −½ (D log 2π + ‖L_i⁻¹(y − m_i)‖²) − Σ_d log L_i,dd, by forward substitution.

    Row by row and in one order of summation, so a row's value does not depend on the rows around it.
    """
    n_steps, n_dims = observations.shape
    n_states = means.shape[0]
    densities = np.empty((n_steps, n_states))
    whitened = np.empty(n_dims)
    for i in range(n_states):
        constant = 0.5 * n_dims * np.log(2.0 * np.pi)
        for d in range(n_dims):
            constant += np.log(factors[i, d, d])
        for t in range(n_steps):
            square = 0.0
            for d in range(n_dims):
                rest = observations[t, d] - means[i, d]
                for e in range(d):
                    rest -= factors[i, d, e] * whitened[e]
                whitened[d] = rest / factors[i, d, d]
                square += whitened[d] * whitened[d]
            # Overflow far outside the data ends in inf or nan; both mean a density of zero.
            densities[t, i] = -constant - 0.5 * square if square < np.inf else -np.inf
    return densities
