"""A problem of CVXPY as one cone programme, whose objective is linear in the belief.

CVXPY applies the parameters of a compiled problem anew for every solve, and takes the solution apart: two milliseconds for a
small problem, of which Clarabel needs a fifth. A decision that hides takes thousands of solves.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.validation import Array


class ConeProgramme(NamedTuple):
    """min ½x'Px + c'x with Ax + s = b and s in a cone, P = Σ π_i P_i and c = Σ π_i c_i."""

    squares: Array  # (X,k), the entries of P_i, upper triangles, at k places in the order of columns
    places: np.ndarray  # (k,), the row plus n times the column of each
    slopes: Array  # (X,n), c_i
    rows: Any  # A
    sides: Array  # b
    cones: Any
    first: int  # place of the decision in x
    size: int  # U
    units: Array  # (n,), x in the units of the decision maker, over x here
    constants: Array  # (X,), what the costs have beside this objective

    def objective(self, belief: Array) -> tuple[Any, Array]:
        """Return P and c."""
        from scipy.sparse import csc_array

        n = self.slopes.shape[1]
        starts = np.searchsorted(self.places, n * np.arange(n + 1))
        return csc_array((belief @ self.squares, self.places % n, starts), shape=(n, n)), belief @ self.slopes

    def solve(self, belief: Array) -> Array | None:
        """Return the decision (U,) of least cost; None where Clarabel does not say that it is one."""
        import clarabel

        settings = clarabel.DefaultSettings()
        settings.verbose = False
        solver = clarabel.DefaultSolver(*self.objective(belief), self.rows, self.sides, self.cones, settings)
        found = solver.solve()
        if found.status != clarabel.SolverStatus.Solved:
            return None
        decision = slice(self.first, self.first + self.size)
        return np.asarray(self.units[decision] * np.asarray(found.x)[decision])

    def scaled(self, unit: float, blocks: list[int]) -> ConeProgramme:
        """Return it for x = D y and rows near one: (E A D)y + t = E b, decisions in `unit`, one factor E for rows of a cone.

        The solver's tolerances are for numbers near one.
        """
        from scipy.sparse import diags_array

        units, factors = propagated_units(self, unit, blocks)
        n = self.slopes.shape[1]
        return self._replace(
            squares=self.squares * units[self.places % n] * units[self.places // n],
            slopes=self.slopes * units,
            rows=(diags_array(factors) @ self.rows @ diags_array(units)).tocsc(),
            sides=factors * self.sides,
            units=units,
        )


def propagated_units(programme: ConeProgramme, unit: float, blocks: list[int]) -> tuple[Array, Array]:
    """Return the units D (n,) of all variables, from that of the decision, and factors E (m,) of rows.

    A block of rows that share a cone has the size of its largest known term, its side included; a variable without a unit that
    occurs in it has the unit in which its term is that large.
    """
    size, first = programme.slopes.shape[1], programme.first
    terms, sides = abs(programme.rows).tocoo(), np.abs(programme.sides)
    block = np.repeat(np.arange(len(blocks)), blocks)
    units: Array = np.zeros(size)
    units[first : first + programme.size] = unit
    while True:
        largest = np.zeros(len(blocks))
        np.maximum.at(largest, block, sides)
        np.maximum.at(largest, block[terms.row], terms.data * units[terms.col])
        reached = (units[terms.col] == 0) & (largest[block[terms.row]] > 0) & (terms.data > 0)
        if not reached.any():
            break
        new = np.zeros(size)
        np.maximum.at(new, terms.col[reached], largest[block[terms.row[reached]]] / terms.data[reached])
        units = np.where(units > 0, units, new)
    units = np.exp2(np.round(np.log2(np.where(units > 0, units, 1.0))))
    return units, 1.0 / np.where(largest > 0, largest, 1.0)[block]


def cone_programme(cvxpy: Any, problem: Any, parameter: Any, variable: Any, unit: float) -> ConeProgramme | None:
    """Return a compiled problem as a cone programme, where its data are linear in the parameter (X,); else None. `unit` is the
    size of decisions."""
    from cvxpy.reductions.solvers.conic_solvers.clarabel_conif import dims_to_solver_cones
    from scipy import sparse

    # CVXPY replaces a variable with attributes by others: a plain copy of it keeps its place.
    seen = cvxpy.Variable(variable.size)
    copied = cvxpy.Problem(problem.objective, [*problem.constraints, seen == variable])

    def data_at(values: Array) -> Any:
        parameter.value = values
        variable.save_value(None)
        data, _, inverse = copied.get_problem_data(cvxpy.CLARABEL)
        return data | {"constant": float(inverse[-1]["offset"])}

    each, uneven = [data_at(values) for values in np.eye(parameter.size)], np.arange(1.0, parameter.size + 1.0)
    uneven /= uneven.sum()
    first = each[0]["param_prob"].var_id_to_col.get(seen.id)
    squares = [sparse.triu(data["P"]).tocoo() if "P" in data else sparse.coo_array((1, 1)) for data in each]
    places = [part.row + int(part.shape[0]) * part.col.astype(np.int64) for part in squares]
    taken = np.unique(np.concatenate(places))
    entries = np.zeros((len(each), len(taken)))
    for row, place, part in zip(entries, places, squares, strict=True):
        row[np.searchsorted(taken, place)] = part.data
    made = ConeProgramme(
        entries, taken, np.array([data["c"] for data in each]), each[0]["A"], each[0]["b"],
        dims_to_solver_cones(each[0]["dims"]), first, int(variable.size), np.ones(each[0]["A"].shape[1]),
        np.array([data["constant"] for data in each]),
    )  # fmt: skip
    data, (square, slope) = data_at(uneven), made.objective(uneven)
    rounding = tolerances.EXACT_COST * (np.abs(slope).max() + abs(square).max())
    is_linear = np.abs(data["c"] - slope).max() <= rounding
    is_linear &= "P" not in data or abs(sparse.triu(data["P"]) - square).max() <= rounding
    for other in each:
        is_linear &= abs(data["A"] - other["A"]).max() == 0 and np.array_equal(data["b"], other["b"])
    if not is_linear or first is None:
        return None
    dims = each[0]["dims"]
    blocks = [1] * (dims.zero + dims.nonneg) + [*dims.soc, *(n * (n + 1) // 2 for n in dims.psd)]
    blocks += [3] * (dims.exp + len(dims.p3d))
    if unit != 1.0 and sum(blocks) == len(made.sides):
        made = made.scaled(unit, blocks)
    for belief in (uneven, *np.eye(parameter.size)):  # Clarabel stops short of a solution at some beliefs
        found = made.solve(belief)
        if found is not None:
            parameter.value = belief
            cost = problem.solve(solver=cvxpy.CLARABEL, warm_start=False)
            variable.save_value(found)
            # In another unit than one, CVXPY's own solution may be dearer.
            gap = abs(float(problem.objective.value) - cost) if unit == 1.0 else float(problem.objective.value) - cost
            broken = max((float(np.max(each.violation())) for each in problem.constraints), default=0.0)
            is_it = gap <= tolerances.CONE_COST * max(abs(cost), 1.0) and broken <= tolerances.CONE_COST * unit
            return made if is_it else None
    return None
