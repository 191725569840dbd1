"""Economic dispatch: a public schedule of generators and wind farms that shows a private view of the wind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.errors import InputError, ModelError
from inscrutable.problems.constraints import Polyhedron
from inscrutable.problems.quadratic import QuadraticProblem
from inscrutable.validation import Array

_BLOWN = 3.0
"""Standard deviations above the mean that wind is taken to reach where a farm's capacity is not said."""


@dataclass(frozen=True, eq=False)
class PowerNetwork:
    """A transmission network in the direct-current approximation; buses are numbered from 0.

    Formula: flows = PTDF · injections, from the lines' susceptances; generating u costs a u² + b u per hour.

    Args:
        loads: Demand of every bus, shape (N,), MW.
        generator_buses: Where the generators are, shape (G,).
        capacities: Most each can generate, shape (G,), MW, 0 for one that stands still; the least is 0.
        quadratic_costs: a, shape (G,), cost per MW² and hour.
        linear_costs: b, shape (G,), cost per MW and hour.
        line_ends: The two buses of every line, shape (L,2).
        line_data: Reactance, per unit, and limit, MW, of every line, shape (L,2).

    Raises:
        InputError: Shapes disagree, a bus does not exist, a capacity is negative, a reactance or limit is not above zero, or
            the lines do not connect all buses.

    Source: Wood and Wollenberg, Power Generation, Operation, and Control (1996).

    Example:
        >>> network = PowerNetwork([0.0, 50.0], [0, 1], [80.0, 40.0], [0.02, 0.01], [1.0, 2.0], [[0, 1]], [[0.1, 30.0]])
        >>> network.transfer_factors().round(2)
        array([[ 0., -1.]])
    """

    loads: Array
    generator_buses: Array
    capacities: Array
    quadratic_costs: Array
    linear_costs: Array
    line_ends: Array
    line_data: Array

    def __post_init__(self) -> None:
        for name, ndim in (
            ("loads", 1),
            ("capacities", 1),
            ("quadratic_costs", 1),
            ("linear_costs", 1),
            ("line_data", 2),
        ):
            object.__setattr__(self, name, validation.finite_array(getattr(self, name), name, ndim=ndim))
        for name in ("generator_buses", "line_ends"):
            object.__setattr__(self, name, checked_buses(getattr(self, name), len(self.loads), name))
        g, n_lines = len(self.generator_buses), len(self.line_ends)
        for name in ("capacities", "quadratic_costs", "linear_costs"):
            if getattr(self, name).shape != (g,):
                raise InputError(f"{name} has shape {getattr(self, name).shape}, expected one per generator: {g}")
        if self.line_ends.shape != (n_lines, 2) or self.line_data.shape != (n_lines, 2):
            raise InputError(
                f"line_ends has shape {self.line_ends.shape} and line_data {self.line_data.shape}, expected (L, 2) for both"
            )
        if (self.capacities < 0).any():
            raise InputError(f"capacities has {self.capacities.min():g}; every entry must be at least 0")
        if (self.line_data <= 0).any():
            raise InputError(f"line_data has {self.line_data.min():g}; every entry must be above 0")
        if np.linalg.matrix_rank(self._incidence) < len(self.loads) - 1:
            raise InputError("the lines do not connect all buses")

    @property
    def _incidence(self) -> Array:
        matrix = np.zeros((len(self.line_ends), len(self.loads)))
        rows = np.arange(len(matrix))
        matrix[rows, self.line_ends[:, 0]] = 1.0
        matrix[rows, self.line_ends[:, 1]] -= 1.0
        return matrix

    def transfer_factors(self) -> Array:
        """Return the flow on every line per MW injected at every bus and taken out at bus 0, shape (L,N)."""
        flows = self._incidence / self.line_data[:, :1]
        factors = np.zeros_like(flows)
        factors[:, 1:] = flows[:, 1:] @ np.linalg.inv((self._incidence.T @ flows)[1:, 1:])
        return factors


def dispatch_problem(
    network: PowerNetwork,
    wind_buses: ArrayLike,
    wind_means: ArrayLike,
    wind_deviations: ArrayLike | None = None,
    *,
    wind_capacities: ArrayLike | None = None,
    penalty: float = 1.0,
    min_slack: float = tolerances.MIN_SLACK,
) -> QuadraticProblem:
    """Return the dispatch of generators and wind farms whose public schedule shows a private wind forecast.

    Formula: u = (p, q), generation p_g and scheduled wind q_f; c(i,u) = Σ_g (a_g p_g² + b_g p_g) + κ Σ_f E_i[(q_f − W_f)²]
    with E_i[(q − W)²] = (q − m_if)² + d_if²: what is promised and not blown is balanced at a price. Σp + Σq meets the load,
    generators, farms and lines keep their limits: 0 ≤ q_f ≤ w_f.

    Args:
        network: Loads, generators and lines.
        wind_buses: Where the farms are, shape (F,), numbered from 0; there may be none.
        wind_means: m, expected wind in each regime, shape (X,F), MW, at least 0.
        wind_deviations: d, its standard deviations, shape (X,F), MW, at least 0; None is none.
        wind_capacities: w, most that each farm can give, shape (F,), MW, at least 0. None takes what blows at most: the largest
            m_if + 3 d_if of any regime, which a normal forecast exceeds once in 740 hours.
        penalty: κ > 0, cost per MW² and hour of what is off the schedule.
        min_slack: As for `Polyhedron`, MW.

    Returns:
        A quadratic problem with G + F coordinates, generators first.

    Raises:
        InputError: Shapes disagree, a bus does not exist, a mean, deviation or capacity is negative, there is nothing to
            schedule.
        ModelError: The load is more than all units can give, or no schedule meets it within the lines' limits; the rows in
            conflict are named.

    Cost: one inverse of the network's matrix. Source: economic dispatch with direct-current flows, as in MATPOWER (Zimmerman,
    Murillo-Sánchez, Thomas, IEEE Transactions on Power Systems 26, 2011).

    Example:
        >>> network = PowerNetwork([0.0, 50.0], [0, 1], [80.0, 40.0], [0.02, 0.01], [1.0, 2.0], [[0, 1]], [[0.1, 30.0]])
        >>> problem = dispatch_problem(network, [1], [[5.0], [25.0]])  # calm or windy
        >>> print(problem.solve([[1.0, 0.0], [0.0, 1.0]]).round(1))
        [[30.  13.9  6.1]
         [25.   0.  25. ]]
    """
    farms = checked_buses(wind_buses, len(network.loads), "wind_buses")
    means = validation.finite_array(wind_means, "wind_means", ndim=2)
    if means.shape[1] != len(farms) or not len(means) or (means < 0).any():
        raise InputError(f"wind_means has shape {means.shape}; expected (X, {len(farms)}) of at least 0 MW")
    given = np.zeros_like(means) if wind_deviations is None else wind_deviations
    deviations = validation.finite_array(given, "wind_deviations", ndim=2)
    if deviations.shape != means.shape or (deviations < 0).any():
        raise InputError(
            f"wind_deviations has shape {deviations.shape}; expected {means.shape} as wind_means, at least 0 MW"
        )
    most = (means + _BLOWN * deviations).max(axis=0) if wind_capacities is None else wind_capacities
    ceilings = validation.finite_array(most, "wind_capacities", ndim=1)
    if ceilings.shape != farms.shape or (ceilings < 0).any():
        raise InputError(f"wind_capacities is {ceilings}; expected one per farm, {len(farms)}, of at least 0 MW")
    price = validation.positive(penalty, "penalty")
    bends = np.concatenate([2.0 * network.quadratic_costs, np.full(len(farms), 2.0 * price)])
    return QuadraticProblem(
        np.tile(np.diag(bends), (len(means), 1, 1)),
        np.column_stack([np.tile(network.linear_costs, (len(means), 1)), -2.0 * price * means]),
        price * (means**2 + deviations**2).sum(axis=1),
        constraints=_schedule(network, farms, ceilings, min_slack),
    )


def _schedule(network: PowerNetwork, farms: np.ndarray, ceilings: Array, min_slack: float) -> Polyhedron:
    """Limits of generators, farms and lines, and the balance."""
    places = np.concatenate([network.generator_buses, farms])
    size, g = len(places), len(network.generator_buses)
    if not size:
        raise InputError("the network has no generators and there are no wind farms: nothing can be scheduled")
    most = np.concatenate([network.capacities, ceilings])
    load = float(network.loads.sum())
    if not 0.0 <= load <= most.sum() * (1.0 + tolerances.FEASIBILITY):
        raise ModelError(
            f"the load is {load:g} MW, but all units together give 0 to {most.sum():g} MW: {g} generators "
            f"{network.capacities.sum():g}, {len(farms)} wind farms {ceilings.sum():g}"
        )
    factors = network.transfer_factors()
    own, loaded = factors[:, places], factors @ network.loads
    own = np.where(np.abs(own) > tolerances.ON_FACE, own, 0.0)  # lines that carry one bus's load alone have no row
    limits = network.line_data[:, 1]
    ends = [f"{a}-{b}" for a, b in network.line_ends]
    names = [f"generator {j} at bus {places[j]} >= 0" for j in range(g)]
    names += [f"wind at bus {bus} >= 0" for bus in farms]
    names += [f"generator {j} at bus {places[j]} <= {most[j]:g} MW" for j in range(g)]
    names += [f"wind at bus {places[j]} <= {most[j]:g} MW" for j in range(g, size)]
    names += [f"line {pair} <= {limit:g} MW" for pair, limit in zip(ends, limits, strict=True)]
    names += [f"line {pair} >= -{limit:g} MW" for pair, limit in zip(ends, limits, strict=True)]
    return Polyhedron(
        np.vstack([-np.eye(size), np.eye(size), own, -own]),
        np.concatenate([np.zeros(size), most, limits + loaded, limits - loaded]),
        np.ones((1, size)),
        [load],
        names=[*names, "balance"],
        min_slack=min_slack,
    )


def checked_buses(value: ArrayLike, n_buses: int, name: str) -> np.ndarray:
    """Return bus numbers as ints, or raise `InputError` for one that does not exist."""
    given = np.asarray(value)
    if given.size and given.dtype.kind not in "iu":
        raise InputError(f"{name} must be whole numbers of buses, got {value!r}")
    given = given.astype(np.int64)
    bad = given[(given < 0) | (given >= n_buses)]
    if bad.size:
        raise InputError(f"{name} has bus {int(bad.flat[0])}, expected 0 to {n_buses - 1}")
    return given
