"""Economic dispatch: a public schedule of generators and wind farms that reveals a private wind forecast."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import nnls

from inscrutable import tolerances, validation
from inscrutable.errors import InputError, ModelError
from inscrutable.problems.constraints import Polyhedron
from inscrutable.problems.power_network import PowerNetwork
from inscrutable.problems.quadratic import QuadraticProblem
from inscrutable.validation import Array

_BLOWN = 3.0
"""A farm's default capacity: this many standard deviations above the largest mean."""


class DispatchProblem(QuadraticProblem):
    """The dispatch of a network's generators and wind farms, as `dispatch_problem` makes it.

    Args:
        hessians: Hessians of the costs, shape (X,G+F,G+F).
        linear: Linear terms of the costs, shape (X,G+F).
        constants: Constants of the costs, shape (X,).
        constraints: Limits of units and lines, and the balance.
        network: The network.
        line_rows: Line and sign of the flow of each of the constraints' last rows, which limit lines, shape (K,2).

    Raises:
        InputError: As `QuadraticProblem`.
        ModelError: As `QuadraticProblem`.

    Source: as `dispatch_problem`.

    Example:
        >>> network = PowerNetwork([0.0, 50.0], [0, 1], [80.0, 40.0], [0.02, 0.01], [1.0, 2.0], [[0, 1]], [[0.1, 30.0]])
        >>> problem = dispatch_problem(network)
        >>> schedule = problem.solve([1.0])  # the line is full: the bus behind it pays more
        >>> print(schedule.round(2), problem.bus_prices(schedule).round(2))
        [30. 20.] [2.2 2.4]
    """

    def __init__(
        self,
        hessians: ArrayLike,
        linear: ArrayLike,
        constants: ArrayLike,
        *,
        constraints: Polyhedron,
        network: PowerNetwork,
        line_rows: np.ndarray,
    ) -> None:
        super().__init__(hessians, linear, constants, constraints=constraints)
        self.network, self._line_rows = network, line_rows

    def bus_prices(self, actions: ArrayLike) -> Array:
        """Return the price of one MW more at every bus, shape (N,) or (T,N), cost per MW and hour.

        Formula: λ_n = λ − Σ_l (μ_l⁺ − μ_l⁻) PTDF_ln, with μ ≥ 0, μ = 0 at lines below their limits, and 2 a p + b = λ_n for
        every generator within its limits. Farms are left out: their costs off the schedule are private. The prices are found by
        non-negative least squares: the nearest ones where none supports the schedule, one choice where several do, as where
        all generators are at limits.

        Args:
            actions: Schedules (G+F,) or (T,G+F), MW.

        Raises:
            InputError: A schedule has another length or is outside the feasible set.

        Cost: one non-negative least-squares problem per schedule.
        """
        schedules = self.check_actions(actions)
        found = np.array([self._prices(each) for each in np.atleast_2d(schedules)])
        return found[0] if schedules.ndim == 1 else found

    def _prices(self, schedule: Array) -> Array:
        network, region = self.network, self.constraints
        g, first = len(network.generator_places), len(region.b_ub) - len(self._line_rows)
        tight = np.flatnonzero(region.tight_rows(schedule))
        tight = tight[
            (tight >= first) | (np.abs(region.A_ub[tight, :g]).sum(axis=1) > 0)
        ]  # none of a farm's own limits
        costs = 2.0 * network.quadratic_costs * schedule[:g] + network.slopes
        ones = np.ones((g, 1))  # a price may have either sign
        columns = np.hstack([ones, -ones, -region.A_ub[tight, :g].T])
        scale = np.maximum(np.abs(columns).max(axis=0, initial=0.0), tolerances.ON_FACE)
        multipliers = nnls(columns / scale, costs)[0] / scale
        prices = np.full(network.n_buses, multipliers[0] - multipliers[1])
        full = tight >= first
        lines, signs = self._line_rows[tight[full] - first].T
        return np.asarray(prices - (multipliers[2:][full] * signs) @ network.line_factors(lines))

    def __repr__(self) -> str:
        return f"DispatchProblem({self.n_states} states, {self.n_actions} units, {self.network.n_buses} buses)"


def dispatch_problem(
    network: PowerNetwork,
    wind_buses: ArrayLike = (),
    wind_means: ArrayLike | None = None,
    wind_deviations: ArrayLike | None = None,
    *,
    wind_capacities: ArrayLike | None = None,
    penalty: float = 1.0,
    min_slack: float = tolerances.MIN_SLACK,
) -> DispatchProblem:
    """Return the dispatch of generators and wind farms whose public schedule reveals a private wind forecast.

    Formula: u = (p, q), generation p_g and scheduled wind q_f; c(i,u) = Σ_g (a_g p_g² + b_g p_g + c_g) +
    κ Σ_f E_i[(q_f − W_f)²] with E_i[(q − W)²] = (q − m_if)² + d_if²: the difference between schedule and wind is balanced at a
    price. Σp + Σq meets the load; generators, farms and lines keep their limits: 0 ≤ q_f ≤ w_f. The buses' angles are
    eliminated, and a line that no schedule of these units can load to its limit has no row.

    Args:
        network: Loads, generators and lines.
        wind_buses: Where the farms are, shape (F,), numbered from 0 or by the network's labels; there may be none.
        wind_means: m, expected wind in each regime, shape (X,F), MW, at least 0. None, without farms, is one regime: the
            network's own optimum is `optimal_cost([1.0])`.
        wind_deviations: d, its standard deviations, shape (X,F), MW, at least 0; None is none.
        wind_capacities: w, the farms' capacities, shape (F,), MW, at least 0. None takes the largest m_if + 3 d_if of any
            regime, which a normal forecast exceeds once in 740 hours.
        penalty: κ > 0, cost per MW² and hour of the difference between schedule and wind.
        min_slack: As for `Polyhedron`, MW.

    Returns:
        A quadratic problem with G + F coordinates, generators first; its `bus_prices` are the buses' prices.

    Raises:
        InputError: Shapes disagree, a bus does not exist, a mean, deviation or capacity is negative, there is nothing to
            schedule, or `penalty` is not above zero.
        ModelError: A quadratic cost of the network is negative, the load is more than all units can give, or no schedule meets
            it within the lines' limits; the rows in conflict are named.

    Cost: one sparse factorisation of the network's matrix. Source: economic dispatch with direct-current flows, as in MATPOWER
    (Zimmerman, Murillo-Sánchez, Thomas, IEEE Transactions on Power Systems 26, 2011).

    Example:
        >>> network = PowerNetwork([0.0, 50.0], [0, 1], [80.0, 40.0], [0.02, 0.01], [1.0, 2.0], [[0, 1]], [[0.1, 30.0]])
        >>> problem = dispatch_problem(network, [1], [[5.0], [25.0]])  # calm or windy
        >>> print(problem.solve([[1.0, 0.0], [0.0, 1.0]]).round(1))
        [[30.  13.9  6.1]
         [25.   0.  25. ]]
    """
    if not isinstance(network, PowerNetwork):
        raise InputError(f"network must be a PowerNetwork, such as load_matpower(path), got {network!r:.60}")
    farms = network.places(wind_buses, "wind_buses").reshape(-1)
    means, deviations = _wind(wind_means, wind_deviations, len(farms))
    most = (means + _BLOWN * deviations).max(axis=0) if wind_capacities is None else wind_capacities
    ceilings = validation.finite_array(most, "wind_capacities", ndim=1)
    if ceilings.shape != farms.shape or (ceilings < 0).any():
        raise InputError(f"wind_capacities is {ceilings}; expected one per farm, {len(farms)}, of at least 0 MW")
    price = validation.positive(penalty, "penalty")
    curvatures = np.concatenate([2.0 * network.quadratic_costs, np.full(len(farms), 2.0 * price)])
    region, line_rows = _schedule(network, farms, ceilings, min_slack)
    return DispatchProblem(
        np.tile(np.diag(curvatures), (len(means), 1, 1)),
        np.column_stack([np.tile(network.slopes, (len(means), 1)), -2.0 * price * means]),
        price * (means**2 + deviations**2).sum(axis=1) + network.running_cost,
        constraints=region,
        network=network,
        line_rows=line_rows,
    )


def _wind(wind_means: ArrayLike | None, wind_deviations: ArrayLike | None, n_farms: int) -> tuple[Array, Array]:
    """Means and deviations of the farms' wind, shape (X,F)."""
    if wind_means is None and n_farms:
        raise InputError(f"wind_means is missing; expected (X, {n_farms}), one mean per regime and farm, MW")
    means = validation.finite_array(np.zeros((1, 0)) if wind_means is None else wind_means, "wind_means", ndim=2)
    if means.shape[1] != n_farms or not len(means) or (means < 0).any():
        raise InputError(f"wind_means has shape {means.shape}; expected (X, {n_farms}) of at least 0 MW")
    given = np.zeros_like(means) if wind_deviations is None else wind_deviations
    deviations = validation.finite_array(given, "wind_deviations", ndim=2)
    if deviations.shape != means.shape or (deviations < 0).any():
        raise InputError(
            f"wind_deviations has shape {deviations.shape}; expected {means.shape} as wind_means, at least 0 MW"
        )
    return means, deviations


def _schedule(
    network: PowerNetwork, farms: np.ndarray, ceilings: Array, min_slack: float
) -> tuple[Polyhedron, np.ndarray]:
    """Limits of generators, farms and lines, and the balance; and which line's, with which sign, the last rows are."""
    places = np.concatenate([network.generator_places, farms])
    size, g = len(places), len(network.generator_places)
    if not size:
        raise InputError("the network has no generators and there are no wind farms: nothing can be scheduled")
    least, most = np.concatenate([network.outputs, np.column_stack([np.zeros_like(ceilings), ceilings])]).T
    load = float(network.demand.sum())
    room = tolerances.FEASIBILITY * max(np.abs(least).sum(), np.abs(most).sum())
    if not least.sum() - room <= load <= most.sum() + room:
        raise ModelError(
            f"the load is {load:g} MW, but all units together give {least.sum():g} to {most.sum():g} MW: {g} generators "
            f"{network.outputs[:, 1].sum():g}, {len(farms)} wind farms {ceilings.sum():g}"
        )
    units = [f"generator {j} at bus {network.bus_labels[place]}" for j, place in enumerate(places[:g])]
    units += [f"wind at bus {network.bus_labels[place]}" for place in farms]
    names = [f"{unit} >= {low:g}{' MW' if low else ''}" for unit, low in zip(units, least, strict=True)]
    names += [f"{unit} <= {high:g} MW" for unit, high in zip(units, most, strict=True)]
    rows, sides, limited = _line_rows(network, places, (least, most), min_slack)
    ends, limits = network.line_ends, network.flow_limits
    names += [
        f"line {ends[i][0]}-{ends[i][1]} {'<=' if sign > 0 else '>='} {limits[i, int(sign > 0)]:g} MW"
        for i, sign in limited
    ]
    region = Polyhedron(
        np.vstack([-np.eye(size), np.eye(size), rows]),
        np.concatenate([-least, most, sides]),
        np.ones((1, size)),
        [load],
        names=[*names, "balance"],
        min_slack=min_slack,
    )
    return region, limited


def _line_rows(
    network: PowerNetwork, places: np.ndarray, outputs: tuple[Array, Array], min_slack: float
) -> tuple[Array, Array, np.ndarray]:
    """The limits of lines that some schedule within the units' limits comes near: rows, sides, numbers and signs (K,2)."""
    own, loaded = network.transfer_factors(places), network.load_flows()
    own = np.where(np.abs(own) > tolerances.ON_FACE, own, 0.0)  # no schedule changes the flow on such a line
    rows, sides = (
        np.vstack([own, -own]),
        np.concatenate([network.flow_limits[:, 1] - loaded, loaded - network.flow_limits[:, 0]]),
    )
    scale = np.abs(rows).max(axis=1, initial=0.0)
    greatest = _greatest(rows, outputs, float(network.demand.sum()))
    room = 2.0 * min_slack * scale + tolerances.FEASIBILITY * (1.0 + np.abs(np.where(np.isfinite(sides), sides, 0.0)))
    near = greatest > sides - room
    kept = np.flatnonzero(near & ((scale > 0) | (sides < -tolerances.FEASIBILITY)))
    n_lines = len(own)
    limited = (
        np.column_stack([kept % n_lines, np.where(kept < n_lines, 1, -1)]) if n_lines else np.zeros((0, 2), np.int64)
    )
    return rows[kept], sides[kept], limited


def _greatest(rows: Array, outputs: tuple[Array, Array], load: float) -> Array:
    """Greatest value of each row (n,U) over schedules within the outputs that meet the load: a greedy fill."""
    least, most = outputs
    order = np.argsort(-rows, axis=1)
    room = (most - least)[order]
    before = np.cumsum(room, axis=1) - room
    more = np.clip(load - least.sum() - before, 0.0, room)
    return np.asarray(rows @ least + (np.take_along_axis(rows, order, axis=1) * more).sum(axis=1))
