"""Beliefs under which a decision is nearly optimal, by cutting planes on the value function.

V(π) = min_u π·s(u) lies below π·s(v) for every decision v, so each solved belief gives a valid plane:
ρ(π,u) ≥ π·(s(u) − s(v)), with equality where v = u*(π).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.adversaries.plausibility import MOST_PLANES, nearest_explanation
from inscrutable.axes import Names
from inscrutable.errors import InputError, SolverError
from inscrutable.geometry import simplex_grid
from inscrutable.geometry.hulls import onto_simplex, sum_zero_basis
from inscrutable.geometry.polytopes import (
    Reduced,
    line_ends,
    project_on_rows,
    reduce_polytope,
    sample_polytope,
)
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array

_SHAPE = {1: 0.01, 2: 0.01, 3: 0.01, 4: 0.03}
"""Share of ε by which corners of the outer polytope may exceed it, by number of states up to four. With a third of it, 18 sets
have 1.8 times the corners, and a centre's probability moves by up to 19 %; with three times, .6 times, and by up to 26 %."""
_STEPS, _MOST_SHRINKS = 50, 200
"""Steps of hit-and-run, and most trials on a line: 20 give the same. In one of eight sets over five to seven states the
distribution of a coordinate of 800 members is .18 off with 17 steps, .09 with 50, .08 with 150 and with 400."""
_FIRST_REACH, _FARTHER = 0.3, 3.0
"""Reach of the first projection, and the factor to the next. From .1 to 3, and from 2 to 30, bounds of 36 sets move by 1.5e-5
at most, in .7 to 1 times the time."""


@dataclass(frozen=True, eq=False)
class NearOptimalBeliefs:
    """The convex set Π_ε(u) = {π ∈ Δ : ρ(π,u) ≤ ε}, with an outer polytope of cutting planes, added on demand.

    It has the queries of `BeliefSet`. Members with a regret of at most ε + `accuracy` attain the bounds and distances. The set
    is smooth: up to four states its vertices, centre and samples belong to an outer polytope whose corners exceed ε by at most
    a hundredth of it (three hundredths at four states). Beyond four states, where such a polytope has too many corners, the
    vertices are the members that reach the bounds, the centre is their mean, and samples are drawn by hit-and-run on the set
    itself.

    Source: near-optimal inverse optimisation; equals Theorem 1's set at ε = 0.

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> near_optimal_beliefs(problem, [0.5, 0.5], 0.001).contains([0.52, 0.48])
        True
    """

    problem: DecisionProblem
    action: Array
    regret: float
    accuracy: float
    _planes: list[Array] = field(default_factory=list, repr=False)

    def __repr__(self) -> str:
        return (
            f"beliefs over {self.n_states} states under which the decision costs at most {self.regret:g} above the best"
        )

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return self.problem.n_states

    @property
    def state_names(self) -> Names | None:
        """Labels of the states, where the problem has them."""
        return self.problem.state_names

    @property
    def _level(self) -> float:
        """The excess at which cutting planes stop: half the accuracy. A set is empty if every belief has a larger excess."""
        return 0.5 * self.accuracy

    @cached_property
    def _own_costs(self) -> Array:
        return self.problem.state_costs(self.action)

    @cached_property
    def _explanation(self) -> tuple[Array, float]:
        found = belief_set_of(self.problem, self.action)
        return nearest_explanation(self.problem, self.action) if found.is_empty else (found.interior_point(), 0.0)

    @property
    def plausibility_gap(self) -> float:
        """Smallest regret over all beliefs, in the cost's unit."""
        return self._explanation[1]

    @property
    def residual(self) -> float:
        """Excess of the least regret over ε, in the cost's unit; zero where the set is not empty."""
        return max(self.plausibility_gap - self.regret, 0.0)

    @property
    def is_empty(self) -> bool:
        """Whether the regret exceeds ε under every belief."""
        return self.residual > self._level

    @property
    def dimension(self) -> int:
        """Dimension of the outer polytope, or of the members that reach the bounds; −1 for the empty set."""
        if self.is_empty:
            return -1
        if self._outer is not None:
            return int(self._outer.directions.shape[0])
        corners = self.vertices()
        return int(np.linalg.matrix_rank(corners - corners.mean(axis=0), tol=tolerances.ON_FACE))

    def contains(self, belief: ArrayLike) -> bool:
        """Return whether the decision has a regret of at most ε under the belief."""
        point = validation.one_belief(belief, self.n_states, names=self.state_names)
        return float(self._excess(point)) <= self.accuracy

    @property
    def _room(self) -> float:
        """Return the scale of the accuracy of shapes, in the cost's unit."""
        return self.regret

    def _planes_at(self, beliefs: Array) -> Array:
        """Return the supporting planes of the regret at beliefs (X,) or (T,X), of the same shape."""
        return np.asarray(self._own_costs - self.problem.state_costs(self.problem.solve(beliefs)))

    def _excess(self, beliefs: Array) -> Array:
        """Return the regret minus ε under beliefs (X,) or (T,X); negative inside."""
        return np.asarray((beliefs * self._planes_at(beliefs)).sum(axis=-1) - self.regret)

    @cached_property
    def _outer(self) -> Reduced | None:
        """Return an outer polytope for shapes and samples; None where the set is empty or has more than four states."""
        if self.is_empty or self.n_states not in _SHAPE:
            return None
        self._seed()
        allowed = max(_SHAPE[self.n_states] * self._room, self.accuracy)
        while True:
            outer = self._polytope()
            if outer is None:
                best = self._explanation[0]
                return Reduced(best, np.zeros((0, self.n_states)), np.zeros((0, 0)), np.zeros(0), best[None])
            corners = onto_simplex(outer.vertices)
            outside = corners[self._excess(corners) > allowed]
            if not len(outside) or len(self._planes) > MOST_PLANES:
                return outer
            self._add(outside)

    def _seed(self) -> None:
        if not self._planes:
            self._add(simplex_grid(self.n_states, 6 if self.n_states <= 4 else 2))
            self._add(self._explanation[0][None])

    def _add(self, beliefs: Array) -> None:
        self._planes.extend(self._planes_at(beliefs))

    @cached_property
    def _basis(self) -> Array:
        return sum_zero_basis(self.n_states)

    def _rows(self) -> tuple[Array, Array]:
        """Rows and offsets of the current outer polytope in the coordinates of `_basis` around the simplex's centre.

        Where a state of ruin is less likely than solvers resolve beside its cost, its probability is 0.
        """
        centre = np.full(self.n_states, 1.0 / self.n_states)
        ruined = _ruled_out(self.problem, self._own_costs, self._room)
        planes = np.where(ruined, 0.0, np.array(self._planes))
        scale = max(float(np.abs(planes).max()), self.regret, self.accuracy)
        normals = np.vstack([planes / scale, -np.eye(self.n_states), np.eye(self.n_states)[ruined]])
        level = (self.regret + self._level) / scale
        allowed = np.concatenate([np.full(len(planes), level), np.zeros(len(normals) - len(planes))])
        return np.asarray(normals @ self._basis), np.asarray(allowed - normals @ centre)

    def _polytope(self) -> Reduced | None:
        rows, offsets = self._rows()
        return reduce_polytope(np.full(self.n_states, 1.0 / self.n_states), self._basis.T, rows, offsets)

    def _converge(self, candidate: Callable[[Array, Array], Array]) -> Array:
        """Add a plane at the candidate of the current polytope until the candidate is a member."""
        self._seed()
        centre = np.full(self.n_states, 1.0 / self.n_states)
        for _ in range(MOST_PLANES):
            point: Array = onto_simplex((centre + self._basis @ candidate(*self._rows()))[None])[0]
            plane = self._planes_at(point)
            if float(point @ plane) - self.regret <= self.accuracy:
                return point
            self._planes.append(plane)
        raise SolverError(f"cutting planes for the near-optimal beliefs at regret {self.regret:g} did not converge")

    def nearest(self, belief: ArrayLike) -> Array:
        """Return the member nearest to `belief` (X,); NaN where the set is empty."""
        point = validation.one_belief(belief, self.n_states, names=self.state_names)
        if self.is_empty:
            return np.full(self.n_states, np.nan)
        if self.contains(point):
            return point
        return self._nearest(self._basis.T @ (point - 1.0 / self.n_states))

    def _nearest(self, wanted: Array) -> Array:
        return self._converge(lambda rows, offsets: project_on_rows(rows, offsets, wanted))

    def distance(self, belief: ArrayLike) -> float:
        """Return the Euclidean distance from `belief` (X,) to the set; infinite where it is empty."""
        point = validation.one_belief(belief, self.n_states, names=self.state_names)
        return float("inf") if self.is_empty else float(np.linalg.norm(point - self.nearest(point)))

    def vertices(self) -> Array:
        """Return the corners of the outer polytope, or the members that reach the bounds, shape (V, X)."""
        if self.is_empty:
            return np.zeros((0, self.n_states))
        if self._outer is not None:
            return np.maximum(self._outer.vertices, 0.0)
        members = self._extremes.reshape(-1, self.n_states)
        apart = np.abs(members[:, None] - members[None]).max(axis=2) > tolerances.SAME_BELIEF
        return np.asarray(members[[bool(apart[i, :i].all()) for i in range(len(members))]])

    def bounds(self) -> Array:
        """Return the least and greatest probability of each state, shape (X, 2); NaN where the set is empty."""
        if self.is_empty:
            return np.full((self.n_states, 2), np.nan)
        if self.n_states == 1:
            return np.ones((1, 2))
        limits = np.empty((self.n_states, 2))
        limits[:, 0], limits[:, 1] = np.diag(self._extremes[0]), np.diag(self._extremes[1])
        return limits

    @cached_property
    def _extremes(self) -> Array:
        """Members with the least and the greatest probability of each state, shape (2, X, X)."""
        return np.array([[self._extreme(sign * direction) for direction in self._basis] for sign in (1.0, -1.0)])

    def _extreme(self, direction: Array) -> Array:
        """Return a member with the least `direction`'z, by projections of points ever farther against the direction.

        With x⁺ the member nearest to x − R d, no member is lower by more than √2 ‖x − x⁺‖/R. Kelley's method would have to cut
        off the polytope's corners one by one, and their number grows with the states.
        """
        point, reach = self._explanation[0], _FIRST_REACH
        while True:
            start = self._basis.T @ (point - 1.0 / self.n_states)
            moved = self._nearest(start - reach * direction)
            left = np.sqrt(2.0) * float(np.linalg.norm(moved - point)) / reach
            point, reach = moved, _FARTHER * reach
            if left <= tolerances.NEAR_OPTIMAL:
                return point

    def center(self) -> Array:
        """Return the mean of the corners, shape (X,); NaN where the set is empty."""
        return np.full(self.n_states, np.nan) if self.is_empty else np.asarray(self.vertices().mean(axis=0))

    def sample(self, n: int, *, rng: np.random.Generator) -> Array:
        """Return `n` members drawn uniformly, from the outer polytope up to four states, shape (n, X).

        Raises `InputError` where the set is empty.
        """
        if self.is_empty:
            raise InputError(f"cannot sample an empty set: the regret is above {self.regret:g} under every belief")
        count, source = validation.count(n, "n"), validation.generator(rng)
        if self._outer is None:
            return self._walk(count, source)
        return np.maximum(sample_polytope(self._outer, count, source), 0.0)

    def _walk(self, n: int, rng: np.random.Generator) -> Array:
        """Sample by hit-and-run: on a random line, a trial outside the set shrinks the segment between the planes."""
        corners = self.vertices()
        points = rng.dirichlet(np.ones(len(corners)), size=n) @ corners
        rows, offsets = self._rows()
        centre = np.full(self.n_states, 1.0 / self.n_states)
        for _ in range(_STEPS):
            directions = rng.normal(size=(n, self.n_states - 1))
            slacks = np.maximum(offsets - (points - centre) @ self._basis @ rows.T, 0.0)
            low, high = line_ends(slacks, directions @ rows.T)
            moving = np.arange(n)
            for _ in range(_MOST_SHRINKS):
                step = rng.uniform(low[moving], high[moving])
                trial = onto_simplex(points[moving] + step[:, None] * directions[moving] @ self._basis.T)
                inside = self._excess(trial) <= self.accuracy
                points[moving[inside]] = trial[inside]
                out, step = moving[~inside], step[~inside]
                high[out] = np.where(step > 0, step, high[out])
                low[out] = np.where(step > 0, low[out], step)
                moving = out
                if not len(moving):
                    break
        return points


def near_optimal_beliefs(problem: DecisionProblem, action: ArrayLike, regret: float) -> NearOptimalBeliefs:
    """Return the beliefs under which `action` costs at most `regret` more than the best decision.

    Formula: Π_ε(u) = {π ∈ Δ_X : π·s(u) − V(π) ≤ ε}, convex because V is concave.

    Args:
        problem: The decision problem that the observer knows.
        action: u, shape (U,), feasible.
        regret: ε ≥ 0, in the cost's unit.

    Returns:
        A convex set with the queries of `BeliefSet`; empty where the plausibility gap is above ε.

    Raises:
        InputError: `action` is not a feasible decision or `regret` is negative.

    Cost: some tens of forward solves at the first query. Source: Kelley's cutting planes (SIAM Journal 8, 1960); at
    ε = 0 the paper's Theorem 1.

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> near_optimal_beliefs(problem, [0.5, 0.5], 0.0001).bounds().round(2)
        array([[0.43, 0.57],
               [0.43, 0.57]])
    """
    u = checked_problem(problem).check_action(action)
    epsilon = validation.non_negative(regret, "regret")
    smaller = problem.without_common_costs
    return NearOptimalBeliefs(smaller, u, epsilon, regret_accuracy(smaller, u, epsilon))


def regret_accuracy(problem: DecisionProblem, action: Array, limit: float) -> float:
    """Return the error that is allowed in regrets of a decision (U,): relative to the limit and to its largest regret in a
    single state, which a constant in the costs leaves as it is. States that a limit far below ruin rules out are left out."""
    own = problem.state_costs(action)
    regrets = own - problem.optimal_cost(np.eye(problem.n_states))
    apart = float(np.abs(regrets[~_ruled_out(problem, own, limit)]).max(initial=0.0))
    return max(tolerances.NEAR_OPTIMAL * max(apart, limit), float(regret_rounding(problem, own)))


def _ruled_out(problem: DecisionProblem, own: Array, limit: float) -> np.ndarray:
    """Return which states (X,) have a cost of ruin far above the limit, so that members leave them no probability."""
    return (own >= problem.ruin_cost) & (limit <= tolerances.LEAST_MEMBER_DEPTH * problem.ruin_cost)


def regret_rounding(problem: DecisionProblem, costs: Array) -> Array:
    """Return the error of regrets computed from state costs (…,X), shape (…); costs of ruin are left out."""
    share = max(min(problem.cost_accuracy, tolerances.NEAR_OPTIMAL), 2.0 * tolerances.COST_ROUNDING)
    kept = np.where(costs < problem.ruin_cost, np.abs(costs), 0.0)
    return np.asarray(share * kept.max(axis=-1) + np.finfo(float).tiny)
