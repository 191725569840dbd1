"""Candidates arranged for the search: distinct, plausible, admissible, by critical region."""

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
