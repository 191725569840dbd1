"""What a search is given: candidates by critical region, distinct, plausible and admissible, and the beliefs to hide."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import consistent_sets
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.decoys import decided_by
from inscrutable.decision_makers.search.faces import face_programme
from inscrutable.decision_makers.search.partition import Partition
from inscrutable.geometry.equal_rows import distinct_patterns
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.geometry.low_discrepancy import simplex_cover
from inscrutable.kernels.region_climb import Scene
from inscrutable.kernels.region_search import Table
from inscrutable.problems import DecisionProblem, QuadraticProblem, quadratic_problem
from inscrutable.validation import Array

_ON_EDGE = 50
"""Beliefs on an edge of the simplex; with 12, 2 of 40 lotteries over six states and three assets lose 28 %."""
_ENOUGH = 1000
"""Candidates to start from: with the 66 of a grid of tenths alone 1 of 60 decisions over three states loses 70 %."""


class Pairs(NamedTuple):
    """E beliefs on the edges of the simplex."""

    decoys: Array  # (E,X)
    actions: Array  # (E,U)


class Atlas:
    """The decisions among which a search chooses; `index` says which candidate each one is."""

    def __init__(self, problem: DecisionProblem, candidates: Candidates) -> None:
        form, quadratic = problem.quadratic_form(), quadratic_problem(problem)
        assert form is not None, "an atlas is of quadratic costs"
        assert quadratic is not None
        self.asked, self.form = problem, form
        self.problem = quadratic.without_common_costs
        """The quadratic problem in the form's variables, which are what is called decisions here; no constants."""
        sets = candidates.sets
        first = sets.distinct == np.arange(len(candidates))
        variables = self.form.variables(candidates.actions)
        usable = candidates.usable
        if self.form.lift is not None:
            usable = usable & quadratic.constraints.is_admissible(variables)
        chosen = np.flatnonzero(first & usable & (sets.dimension >= 0))
        decoys = sets.start if candidates.decoys is None else candidates.decoys
        self.index = chosen
        self.candidates = candidates
        self.actions = variables[self.index]
        tight = quadratic.constraints.tight_rows(self.actions)
        self.patterns, face = distinct_patterns(tight)
        self.size = (quadratic.n_states, quadratic.n_actions, tight.shape[1])
        """Numbers of states, variables, and inequality rows."""
        self.axes = _seen_directions(quadratic)
        self.partition = Partition(self.problem)
        self.partition.numbers(self.patterns)
        self.table = Table(
            np.ascontiguousarray(self.problem.state_costs(self.actions)),
            np.ascontiguousarray(decoys[chosen]),
            face.reshape(-1).astype(np.int64),
            np.ascontiguousarray(decoys[chosen] @ self.axes),
        )

    @cached_property
    def pairs(self) -> Pairs:
        """Beliefs in two states only whose decisions no other belief explains, a few for each pair of states.

        Where other sets are larger than points, such decisions are the border of those that some belief explains.
        """
        n_states = self.problem.n_states
        first, second = np.triu_indices(n_states, 1)
        share = (np.arange(_ON_EDGE) + 0.5) / _ON_EDGE
        corners = np.eye(n_states)
        decoys = share[:, None] * corners[first][:, None] + (1.0 - share)[:, None] * corners[second][:, None]
        decoys = decoys.reshape(-1, n_states)
        actions = self.problem.solve(decoys)
        alone = consistent_sets(self.problem, actions).dimension == 0
        return Pairs(decoys[alone], actions[alone])

    def __len__(self) -> int:
        return len(self.index)

    def decisions(self, variables: Array) -> Array:
        """Return the decisions (…,U) of the problem that was asked for from those (…,V) of its form."""
        return self.form.decisions(variables)


def _seen_directions(problem: QuadraticProblem) -> Array:
    """Orthonormal directions (X,A) of beliefs that decisions can tell: where states cost alike some cannot be told."""
    curves = face_programme(problem, np.zeros(len(problem.constraints.b_ub), dtype=bool)).curves[:, :-1]
    basis = sum_zero_basis(problem.n_states)
    directions, sizes, _ = np.linalg.svd(basis.T @ curves.reshape(len(curves), -1), full_matrices=False)
    seen = sizes > tolerances.RANK * max(float(sizes.max(initial=0.0)), float(np.abs(problem.linear).max()))
    return np.array(basis if seen.sum() == basis.shape[1] else basis @ directions[:, seen], order="C")


def atlas_of(problem: DecisionProblem, candidates: Candidates) -> Atlas:
    """Return the atlas of candidates, made at first use and kept with them; few are joined by decoys of the search's own."""

    def made() -> Atlas:
        if len(candidates) >= _ENOUGH:
            return Atlas(problem, candidates)
        return Atlas(problem, candidates.joined(decided_by(problem, simplex_cover(problem.n_states, _ENOUGH))))

    return candidates.once("atlas", made)


def scene_of(problem: QuadraticProblem, beliefs: Array, points: Array, sign: float, limits: Array) -> Scene:
    """Return the scene of beliefs (T,X), points (T,X), the sign of the distance from them, and budgets (T,) of regret.

    Costs are those of `problem`, an atlas's: what all decisions cost alike in a state is left out, and no digit is lost to it.
    """
    # Copies, all of one layout: kernels would be compiled anew for one that is read-only.
    held, aims, spent = (np.array(values, dtype=np.float64, order="C") for values in (beliefs, points, limits))
    return Scene(held, aims, sign, costs_at(problem, held, held)[0], spent, np.zeros(len(held)))


def costs_at(problem: QuadraticProblem, decoys: Array, beliefs: Array) -> tuple[Array, np.ndarray]:
    """Costs (T,) under beliefs (T,X) of the optimal decisions of decoys (T,X), and which of them are admissible."""
    actions = problem.solve_rows(decoys)
    return (problem.state_costs(actions) * beliefs).sum(axis=1), problem.constraints.is_admissible(actions)


def farthest_corners(points: Array) -> Array:
    """Return the distances of points (T,X) from the corners of the simplex that are farthest: ‖p‖² − 2 min p_i + 1."""
    least = points[:, 0]
    for column in points.T[1:]:
        least = np.minimum(least, column)
    return np.asarray(np.sqrt(np.einsum("ti,ti->t", points, points) - 2.0 * least + 1.0))
