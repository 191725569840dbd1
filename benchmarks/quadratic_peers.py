"""Other people's ways to minimise ½u'H(y)u + g(y)'u over the simplex for one decoy y after the other.

Every peer is used as its interface allows best: set up once and given new numbers, warm-started. H(y) = Σ y_i H_i is
formed for each decoy, as every one of them needs it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inscrutable import MarkowitzProblem

Array = NDArray[np.float64]
Solve = Callable[[int], Array]

INTERIOR_POINT_ACCURACY = 1e-9
"""Asked of PIQP, absolute and relative, in place of its 1e-8: costs of monthly returns are far below one."""

HELD = 1e-9  # a weight that DAQP leaves above this is held; its own rounding is a thousand times smaller
_EQUALITY = 5


class Costs:
    """H(y) and g(y) of every decoy, formed in place."""

    def __init__(self, problem: MarkowitzProblem, decoys: Array) -> None:
        size = problem.n_actions
        self.hessians, self.linear, self.decoys = problem.hessians.reshape(problem.n_states, -1), problem.linear, decoys
        self._flat = np.empty(size * size)
        self._square = self._flat.reshape(size, size)

    def at(self, index: int) -> tuple[Array, Array]:
        """H(y), overwritten by the next call, and g(y)."""
        decoy = self.decoys[index]
        np.dot(decoy, self.hessians, out=self._flat)
        return self._square, decoy @ self.linear


def daqp_loop(problem: MarkowitzProblem, decoys: Array) -> Solve:
    """DAQP, one model for all decoys, from the active set of the decoy before."""
    import daqp

    costs, size = Costs(problem, decoys), problem.n_actions
    lower, upper = np.append(np.zeros(size), 1.0), np.append(np.full(size, np.inf), 1.0)
    sense = np.append(np.zeros(size, dtype=np.int32), np.int32(_EQUALITY))
    model: Any = daqp.Model()
    model.setup(*costs.at(0), np.ones((1, size)), upper, lower, sense)

    def solve(index: int) -> Array:
        hessian, linear = costs.at(index)
        model.update(H=hessian, f=linear)
        action, _, flag, _ = model.solve()
        if flag != 1:
            raise RuntimeError(f"DAQP ended with flag {flag} at decoy {index}")
        return np.asarray(action)

    return solve


def piqp_loop(problem: MarkowitzProblem, decoys: Array) -> Solve:
    """PIQP's dense solver, its workspace kept.

    It is set up anew for each decoy: `update` takes as long, and on half of the markets it diverges after it.
    """
    import piqp

    costs, size = Costs(problem, decoys), problem.n_actions
    solver: Any = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = INTERIOR_POINT_ACCURACY
    row, one = np.asfortranarray(np.ones((1, size))), np.ones(1)
    bounds = {"x_l": np.zeros(size), "x_u": np.full(size, np.inf)}

    def solve(index: int) -> Array:
        hessian, linear = costs.at(index)
        solver.setup(hessian.T, linear, A=row, b=one, **bounds)  # symmetric, and column-major without a copy
        status = solver.solve()
        if status != piqp.PIQP_SOLVED:
            raise RuntimeError(f"PIQP ended with {status} at decoy {index}")
        return np.array(solver.result.x)

    return solve


def cvxpy_loop(problem: MarkowitzProblem, decoys: Array) -> Solve:
    """CVXPY with the decoy as a parameter, canonicalised once, solved by Clarabel."""
    import cvxpy

    cp: Any = cvxpy
    decoy = cp.Parameter(problem.n_states, nonneg=True)
    action = cp.Variable(problem.n_actions)
    curved = [cp.quad_form(action, cp.psd_wrap(hessian)) for hessian in problem.hessians]
    cost = sum(decoy[i] * each / 2 for i, each in enumerate(curved)) + (decoy @ problem.linear) @ action
    programme = cp.Problem(cp.Minimize(cost), [action >= 0, cp.sum(action) == 1])

    def solve(index: int) -> Array:
        decoy.value = decoys[index]
        programme.solve(solver=cp.CLARABEL)
        return np.asarray(action.value)

    return solve


PEERS: dict[str, Callable[[MarkowitzProblem, Array], Solve]] = {
    "DAQP": daqp_loop,
    "PIQP": piqp_loop,
    "CVXPY/Clarabel": cvxpy_loop,
}


def polished(problem: MarkowitzProblem, decoy: Array, action: Array) -> Array:
    """DAQP's answer with the equations of its held assets solved directly and refined once."""
    held = np.flatnonzero(action > HELD)
    size = held.size
    hessian = np.tensordot(decoy, problem.hessians, 1)[np.ix_(held, held)]
    scale = float(np.abs(hessian).max())
    system = np.ones((size + 1, size + 1))
    system[:size, :size], system[size, size] = hessian / scale, 0.0
    right = np.append(-(decoy @ problem.linear)[held] / scale, 1.0)
    solution = np.linalg.solve(system, right)
    solution += np.linalg.solve(system, right - system @ solution)
    result = np.zeros_like(action)
    result[held] = solution[:size]
    return result


def kkt_residual(problem: MarkowitzProblem, decoys: Array, actions: Array) -> float:
    """The largest violation of the first-order conditions on the simplex, relative to the gradient's scale."""
    gradients = decoys @ problem.linear
    for i, hessian in enumerate(problem.hessians):
        gradients += decoys[:, i, None] * (actions @ hessian)
    held = actions > 0
    level = (gradients * held).sum(axis=1) / held.sum(axis=1)
    off = gradients - level[:, None]
    stationary = np.where(held, np.abs(off), np.maximum(-off, 0.0)).max(axis=1) / np.abs(gradients).max(axis=1)
    feasible = np.maximum(np.abs(actions.sum(axis=1) - 1), np.maximum(-actions, 0).max(axis=1))
    return float(np.maximum(stationary, feasible).max())
