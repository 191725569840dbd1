"""Quadratic costs of decisions, each by itself."""

from __future__ import annotations

from typing import Any

from inscrutable.kernels.deferred import deferred
from inscrutable.kernels.options import uncounted_kernel


@deferred(uncounted_kernel)
def quadratic_costs(actions: Any, hessians: Any, linear: Any, costs: Any) -> None:
    """Fill ½ u'H_i u + g_i'u of decisions u (T,U) for all states i, shape (T,X): H_jki at (j·U + k)·X + i, g_ji at j·X + i.

    Coordinates that are zero take no part: a portfolio of many assets holds few.
    """
    size, n_states = actions.shape[1], costs.shape[1]
    for t in range(len(actions)):
        costs[t] = 0.0
        for j in range(size):
            u = actions[t, j]
            if u != 0.0:
                for i in range(n_states):
                    costs[t, i] += u * (linear[j * n_states + i] + 0.5 * u * hessians[(j * size + j) * n_states + i])
                for k in range(j):
                    both = u * actions[t, k]
                    if both != 0.0:
                        for i in range(n_states):
                            costs[t, i] += both * hessians[(j * size + k) * n_states + i]
