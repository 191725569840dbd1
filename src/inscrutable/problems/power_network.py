"""A transmission network in the direct-current approximation: flows on its lines as a function of injections at its buses."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from inscrutable import validation
from inscrutable.axes import axis_labels, few
from inscrutable.errors import InputError
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class PowerNetwork:
    """A transmission network in the direct-current approximation; buses are numbered from 0, or named by labels.

    Formula: flows = PTDF · injections + the flows of phase shifters, from the lines' susceptances 1/x; generating u costs
    a u² + b u + c per hour.

    Args:
        loads: Demand of every bus, shape (N,), MW. A Series or a dict names the buses: they are then given by these labels
            everywhere else.
        generator_buses: The generators' buses, shape (G,).
        capacities: Largest outputs, shape (G,), MW, 0 for a generator that is off, with least outputs of 0; or least and
            largest outputs, shape (G,2).
        quadratic_costs: a, shape (G,), cost per MW² and hour.
        linear_costs: b, shape (G,), cost per MW and hour; or b and c, shape (G,2), c in cost per hour.
        line_ends: The two buses of every line, shape (L,2).
        line_data: Reactance x, per unit, and limit, MW, of every line, shape (L,2); or reactance, least and largest flow, inf
            for no limit, and the flow of a phase shifter at equal angles, MW, shape (L,4), where a reactance may be negative.

    Raises:
        InputError: Shapes disagree, a bus does not exist or a label repeats, an entry is not finite, a least output or flow is
            above the largest, a reactance is zero, the lines do not connect all buses, or one of the short forms (G,) and
            (L,2) has a negative capacity, a reactance or a limit that is not above zero.

    Cost: one sparse factorisation. Source: Wood and Wollenberg, Power Generation, Operation, and Control (1996).

    Example:
        >>> network = PowerNetwork([0.0, 50.0], [0, 1], [80.0, 40.0], [0.02, 0.01], [1.0, 2.0], [[0, 1]], [[0.1, 30.0]])
        >>> network.transfer_factors().round(2)
        array([[ 0., -1.]])
    """

    loads: Any
    generator_buses: Any
    capacities: Array
    quadratic_costs: Array
    linear_costs: Array
    line_ends: Any
    line_data: Array

    def __post_init__(self) -> None:
        self._keep_loads()
        for name in ("generator_buses", "line_ends"):
            self.places(getattr(self, name), name)
            object.__setattr__(self, name, self._as_array(getattr(self, name)))
        for name, ranks in (("capacities", (1, 2)), ("quadratic_costs", 1), ("linear_costs", (1, 2)), ("line_data", 2)):
            given = validation.finite_array(getattr(self, name), name, ndim=ranks, limits=name == "line_data")
            object.__setattr__(self, name, given)
        self._check_generators()
        self._check_lines()
        self._check_connected()

    def _keep_loads(self) -> None:
        labels = axis_labels(self.loads, 0)
        plain = (
            self.loads if labels is None else list(self.loads.values() if isinstance(self.loads, dict) else self.loads)
        )
        loads = validation.finite_array(plain, "loads", ndim=1)
        if labels is not None:
            from pandas import Series

            if any(isinstance(label, (bool, np.bool_)) for label in labels):
                raise InputError(
                    f"loads has a bus that is True or False ({few(labels)}); expected text or whole numbers"
                )
            if len(set(labels)) < len(labels):
                twice = next(label for label in labels if labels.count(label) > 1)
                raise InputError(f"loads has the bus {twice!r} {labels.count(twice)} times; labels must differ")
            object.__setattr__(self, "loads", Series(loads, index=list(labels)))
        else:
            object.__setattr__(self, "loads", loads)

    def _check_generators(self) -> None:
        g = len(self.generator_buses)
        for name, shapes in (
            ("capacities", ((g,), (g, 2))),
            ("quadratic_costs", ((g,),)),
            ("linear_costs", ((g,), (g, 2))),
        ):
            found = getattr(self, name).shape
            if found not in shapes:
                raise InputError(f"{name} has shape {found}, expected one per generator: {g}")
        if self.capacities.ndim == 1 and (self.capacities < 0).any():
            raise InputError(f"capacities has {self.capacities.min():g}; every entry must be at least 0")
        crossed = np.flatnonzero(self.outputs[:, 0] > self.outputs[:, 1])
        if crossed.size:
            least, most = self.outputs[crossed[0]]
            raise InputError(f"capacities[{crossed[0]}] has a least output of {least:g} MW above its most, {most:g} MW")

    def _check_lines(self) -> None:
        shape, n_lines = self.line_data.shape, len(self.line_ends)
        if self.line_ends.shape != (n_lines, 2) or shape not in ((n_lines, 2), (n_lines, 4)):
            raise InputError(
                f"line_ends has shape {self.line_ends.shape} and line_data {shape}, expected (L, 2) for both, or (L, 4)"
            )
        if shape[1] == 2 and (self.line_data <= 0).any():
            raise InputError(f"line_data has {self.line_data.min():g}; every entry must be above 0")
        if not np.isfinite(self.line_data[:, 0]).all() or not (self.line_data[:, 0] != 0).all():
            bad = int((~np.isfinite(self.line_data[:, 0]) | (self.line_data[:, 0] == 0)).argmax())
            raise InputError(
                f"line_data[{bad}] has the reactance {self.line_data[bad, 0]:g}; expected a number that is not 0"
            )
        crossed = np.flatnonzero(self.flow_limits[:, 0] > self.flow_limits[:, 1])
        if crossed.size:
            least, most = self.flow_limits[crossed[0]]
            raise InputError(f"line_data[{crossed[0]}] has a least flow of {least:g} MW above its most, {most:g} MW")
        if not np.isfinite(self.driven_flows).all():
            raise InputError("line_data has a driven flow that is infinite; expected MW")

    def _check_connected(self) -> None:
        a, b = self.line_places.T
        links = sparse.coo_array((np.ones(len(a)), (a, b)), shape=(self.n_buses, self.n_buses))
        count, island = connected_components(links, directed=False)
        if count > 1:
            apart = np.flatnonzero(island != np.bincount(island).argmax())
            raise InputError(
                f"the lines do not connect all buses: there are {count} islands; not joined to the largest are the buses "
                f"{few(self.bus_labels[place] for place in apart)}"
            )

    @property
    def n_buses(self) -> int:
        """Number of buses N."""
        return len(self.loads)

    @cached_property
    def bus_labels(self) -> tuple[Hashable, ...]:
        """The buses' names: their numbers from 0, or the labels of the loads."""
        labels: Iterable[Hashable] = getattr(self.loads, "index", range(self.n_buses))
        return tuple(labels)

    @cached_property
    def demand(self) -> Array:
        """Loads as an array (N,), MW."""
        return np.asarray(self.loads, dtype=np.float64)

    @cached_property
    def outputs(self) -> Array:
        """Least and largest output of every generator, shape (G,2), MW."""
        most = self.capacities
        return most if most.ndim == 2 else np.column_stack([np.zeros_like(most), most])

    @cached_property
    def slopes(self) -> Array:
        """b, shape (G,), cost per MW and hour."""
        return self.linear_costs if self.linear_costs.ndim == 1 else self.linear_costs[:, 0]

    @cached_property
    def running_cost(self) -> float:
        """Σ c, fixed cost per hour."""
        return float(self.linear_costs[:, 1].sum()) if self.linear_costs.ndim == 2 else 0.0

    @cached_property
    def flow_limits(self) -> Array:
        """Least and largest flow over every line, shape (L,2), MW."""
        data = self.line_data
        return data[:, 1:3] if data.shape[1] == 4 else np.column_stack([-data[:, 1], data[:, 1]])

    @cached_property
    def driven_flows(self) -> Array:
        """Flow that phase shifters drive at equal angles, shape (L,), MW."""
        return self.line_data[:, 3] if self.line_data.shape[1] == 4 else np.zeros(len(self.line_data))

    @cached_property
    def generator_places(self) -> np.ndarray:
        """Numbers of the generators' buses, shape (G,)."""
        return self.places(self.generator_buses, "generator_buses")

    @cached_property
    def line_places(self) -> np.ndarray:
        """Numbers of the lines' buses, shape (L,2)."""
        return self.places(self.line_ends, "line_ends").reshape(-1, 2)

    def places(self, buses: ArrayLike, name: str) -> np.ndarray:
        """Return the numbers of buses from 0, or raise `InputError` for one that does not exist."""
        given = self._as_array(buses)
        if hasattr(self.loads, "index"):
            return self._labelled_places(given, name)
        if given.size and given.dtype.kind not in "iu":
            raise InputError(f"{name} must be whole numbers of buses, got {buses!r:.60}")
        given = given.astype(np.int64)
        bad = given[(given < 0) | (given >= self.n_buses)]
        if bad.size:
            raise InputError(f"{name} has bus {int(bad.flat[0])}, expected 0 to {self.n_buses - 1}")
        return given

    def _as_array(self, buses: ArrayLike) -> np.ndarray:
        """Buses as an array; a list of text and numbers keeps both."""
        plain = np.asarray(buses)
        return np.asarray(buses, dtype=object) if plain.dtype.kind == "U" and hasattr(self.loads, "index") else plain

    def __getstate__(self) -> dict[str, object]:
        """A sparse factorisation cannot be pickled: a copy makes its own."""
        return {name: value for name, value in vars(self).items() if name != "_factors"}

    def _labelled_places(self, given: np.ndarray, name: str) -> np.ndarray:
        known = {label: place for place, label in enumerate(self.bus_labels)}
        found = np.empty(given.shape, dtype=np.int64)
        for where, label in np.ndenumerate(given):
            plain = label.item() if isinstance(label, np.generic) else label
            if isinstance(plain, bool) or plain not in known:
                near = get_close_matches(str(plain), [str(each) for each in known], n=1)
                said = f"; did you mean {near[0]}?" if near else ""
                raise InputError(f"{name} has bus {plain!r}, which is none of {few(known)}{said}")
            found[where] = known[plain]
        return found

    @cached_property
    def _incidence(self) -> Any:
        n_lines = len(self.line_ends)
        rows = np.tile(np.arange(n_lines), 2)
        ones = np.concatenate([np.ones(n_lines), -np.ones(n_lines)])
        return sparse.csr_array((ones, (rows, self.line_places.T.ravel())), shape=(n_lines, self.n_buses))

    @cached_property
    def _factors(self) -> Any:
        weighted = sparse.diags_array(1.0 / self.line_data[:, 0]) @ self._incidence
        matrix = sparse.csc_array((self._incidence.T @ weighted)[1:, 1:])
        try:
            return weighted, splu(matrix)
        except RuntimeError:
            raise InputError(
                "the reactances of some lines cancel, so that the flows are not determined: check negative reactances"
            ) from None

    def _flows(self, injections: Array) -> Array:
        """Flows (L,k) for injections at the buses (N,k), balanced at bus 0."""
        if self.n_buses == 1 or not injections.shape[1]:
            return np.zeros((len(self.line_ends), injections.shape[1]))
        weighted, solver = self._factors
        angles = np.zeros_like(injections)
        angles[1:] = solver.solve(np.ascontiguousarray(injections[1:]))
        return np.asarray(weighted @ angles)

    def transfer_factors(self, places: ArrayLike | None = None) -> Array:
        """Return the flow on every line per MW injected at buses, by their numbers, and withdrawn at bus 0.

        Args:
            places: Numbers of buses from 0, shape (K,); None is all of them.

        Returns:
            Shape (L,K), or (L,N).
        """
        chosen = np.arange(self.n_buses) if places is None else np.asarray(places, dtype=np.int64)
        buses, column = np.unique(chosen, return_inverse=True)
        unit = np.zeros((self.n_buses, len(buses)))
        unit[buses, np.arange(len(buses))] = 1.0
        return self._flows(unit)[:, column]

    def line_factors(self, lines: np.ndarray) -> Array:
        """Return the rows of `transfer_factors` for some lines, by their numbers, shape (K,N)."""
        found = np.zeros((len(lines), self.n_buses))
        if len(lines) and self.n_buses > 1:
            weighted, solver = self._factors
            found[:, 1:] = solver.solve(weighted[lines].toarray().T[1:]).T  # the network's matrix is symmetric
        return found

    def load_flows(self) -> Array:
        """Return the flow on every line, shape (L,), MW, if all loads are fed from bus 0, with the phase shifters' flows."""
        given = -self.demand - self._incidence.T @ self.driven_flows
        return np.asarray(self._flows(given[:, None])[:, 0] + self.driven_flows)

    def summary(self) -> str:
        """Return one line for a person to read."""
        return (
            f"{self.n_buses} buses, {len(self.line_ends)} lines, {len(self.generator_buses)} generators of "
            f"{self.outputs[:, 0].sum():g} to {self.outputs[:, 1].sum():g} MW, a load of {self.demand.sum():g} MW"
        )

    def __str__(self) -> str:
        return self.summary()
