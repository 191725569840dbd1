"""Bounds of leaves of decisions over three states: never below the value of a member, and near it where it matters."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks import markets
from inscrutable import consistent_beliefs, decoy_grid
from inscrutable.decision_makers.search.atlas import atlas_of
from inscrutable.decision_makers.search.plane import plane_of
from inscrutable.kernels.three_leaves import SLOTS, bar_dear_leaves, bound_leaves, read_leaf
from inscrutable.kernels.three_states import Here
from test_three_states import drawn_market, here_of

Array = NDArray[np.float64]


# Not kept on disk: a kept one would not see a change of what it is woven from.
@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def bounds_and_values(plane: Any, here: Here, price: float, most: float, bounds: Any, barred: Any, values: Any) -> None:
    bound_leaves(plane.leaves, plane.bands, plane.n_leaves, here, price, bounds)
    bound_leaves(plane.leaves, plane.bands, plane.n_leaves, here, price, barred)
    bar_dear_leaves(plane.leaves, plane.bands, plane.n_leaves, here, most, barred)
    for leaf in range(len(plane.slots)):
        read_leaf(plane.slots[leaf], (here.b0, here.b1, here.b2), here.p0, here.p1, here.sign, price, values[leaf])


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["far", "near"])
@pytest.mark.parametrize("seed", range(6))
def test_no_decision_of_a_leaf_is_worth_more_than_its_bound(seed: int, sign: float) -> None:
    rng = np.random.default_rng(seed)
    problem = markets.problem_of(drawn_market(seed, 2 + seed % 3, spread=seed % 2 == 0))
    plane = plane_of(atlas_of(problem, decoy_grid(problem, 40)))
    assert plane is not None
    n_lines = int(np.count_nonzero(plane.slots[:, 7].any(axis=1)))
    assert n_lines > 0 or seed % 2 == 0
    assert n_lines == len(plane.slots) - plane.n_leaves  # points and segments share no leaf
    costs, n = plane.slots[:, :3], len(plane.slots)
    bounds = np.empty(max(plane.leaves.shape[1], plane.n_leaves + plane.bands.shape[1]))
    barred, values = np.empty_like(bounds), np.empty((n, 2 * SLOTS))
    for belief in rng.dirichlet(np.ones(3), size=20):
        point = belief if sign > 0 else rng.dirichlet(np.ones(3))
        optimal = float(problem.optimal_cost(belief))
        price, most = rng.exponential() / abs(optimal), optimal + rng.exponential() * 0.1 * abs(optimal)
        here = here_of(belief, point, sign, optimal)
        bounds_and_values(plane, here, price, most, bounds, barred, values)
        assert np.all(bounds[:n] >= values[:, :SLOTS].max(axis=1) - 1e-12)
        affordable = (np.einsum("i,lis->ls", belief, costs) <= most - 1e-12).any(axis=1)
        assert np.array_equal(barred[:n][affordable], bounds[:n][affordable])


def test_the_value_of_a_slot_is_its_decisions_privacy_less_its_cost() -> None:
    problem = markets.problem_of(drawn_market(1, 3, spread=False))
    atlas = atlas_of(problem, decoy_grid(problem, 20))
    plane = plane_of(atlas)
    assert plane is not None
    belief, price = np.array([0.5, 0.2, 0.3]), 0.7
    here = here_of(belief, belief, 1.0, 0.0)
    n = len(plane.slots)
    bounds, values = np.empty(1024), np.empty((n, 2 * SLOTS))
    bounds_and_values(plane, here, price, 1.0, bounds, bounds.copy(), values)
    value = values[:, :SLOTS].reshape(-1)
    for slot in np.flatnonzero(plane.name >= 0)[::7]:
        action = atlas.actions[plane.name[slot]]
        privacy = consistent_beliefs(problem, action).distance(belief)
        expected = privacy - price * float(belief @ problem.state_costs(action))
        assert value[slot] == pytest.approx(expected, abs=1e-9)
