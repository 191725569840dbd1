"""The forms of decision problems as plain data: quadratic, linear or smooth costs over a polyhedron.

A problem returns its `quadratic_form()`, `linear_form()` and `smooth_form()`, or None. Searches, proofs and
observers ask for these forms, never for a class, so that a problem of a user's own is searched as the library's are.

Costs with kinks have a form in more variables: v = variables(u) for a decision u, and u = decisions(v), where the kinks are
rows of the feasible set of v. A decision that is optimal for a belief in v is optimal in u, at the same cost in every state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from inscrutable.problems.constraints import Polyhedron
from inscrutable.validation import Array


class Lift(NamedTuple):
    """The maps from decisions to the variables of a form, and back.

    Args:
        variables: Returns v, shape (…,V), of decisions u (…,U); they must be feasible where u is.
        decisions: Returns u of v, so that decisions(variables(u)) = u.
        hessians: H_i, shape (X,U,U), where the costs in the decision are ½u'H_i u + Σ_j κ_j |u_j − b_j| and terms linear in u;
            None for other costs. From rounded decisions an observer reads more with it.
        rates: κ, shape (U,), or 0.
        kinks: b, shape (U,), or 0.

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> from inscrutable.problems import with_transaction_costs
        >>> plain = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> form = with_transaction_costs(plain, [0.5, 0.5], linear=0.02).quadratic_form()
        >>> print(form.lift.variables(np.array([0.6, 0.4])).round(3))  # purchases, then sales
        [0.1 0.  0.  0.1]
    """

    variables: Callable[[Array], Array]
    decisions: Callable[[Array], Array]
    hessians: Array | None = None
    rates: Array | float = 0.0
    kinks: Array | float = 0.0


class _Form:
    """The common part of forms: the maps from decisions to variables and back."""

    lift: Lift | None

    def variables(self, actions: Array) -> Array:
        """Return the variables (…,V) of decisions (…,U): themselves where the form has no lift."""
        return actions if self.lift is None else self.lift.variables(actions)

    def decisions(self, variables: Array) -> Array:
        """Return the decisions (…,U) of variables (…,V)."""
        return variables if self.lift is None else self.lift.decisions(variables)


@dataclass(frozen=True, eq=False)
class QuadraticForm(_Form):
    """Quadratic costs.

    Formula: c(i,u) = ½ v'H_i v + g_i'v + r_i, v = variables(u), over the feasible set of v.

    Args:
        hessians: H_i, shape (X,V,V), symmetric positive semidefinite.
        linear: g_i, shape (X,V).
        constants: r_i, shape (X,), None for zero.
        constraints: The feasible set of v.
        lift: From decisions to variables and back; None where v = u.

    Source: the paper, eq. (3).

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> MarkowitzProblem([[0.2, 0.0]], [np.eye(2)], 1.0).quadratic_form().hessians.shape
        (1, 2, 2)
    """

    hessians: Array
    linear: Array
    constants: Array | None
    constraints: Polyhedron
    lift: Lift | None = None


@dataclass(frozen=True, eq=False)
class LinearForm(_Form):
    """Linear costs, up to a constant in every state.

    Formula: c(i,u) = c_i'v + r_i, v = variables(u), over the feasible set of v.

    Args:
        costs: c_i, shape (X,V).
        constraints: The feasible set of v.
        lift: From decisions to variables and back; None where v = u.

    Source: the paper, eq. (3).

    Example:
        >>> from inscrutable import FiniteProblem
        >>> print(FiniteProblem([[0.0, 4.0], [10.0, 4.0]]).linear_form().costs)
        [[ 0.  4.]
         [10.  4.]]
    """

    costs: Array
    constraints: Polyhedron
    lift: Lift | None = None


@dataclass(frozen=True, eq=False)
class SmoothForm(_Form):
    """Costs with gradients, which the KKT conditions of the inverse problem use.

    Formula: a belief π explains v where −Σ π_i ∇c(i,v) lies in the normal cone of the feasible set at v.

    Args:
        constraints: The feasible set of v.
        gradients: ∇c(i,v) for variables (m,V), shape (m,X,V).
        lift: From decisions to variables and back; None where v = u.
        size: Size of the terms that add up to the gradients, in the cost's unit; gradients of the size of their rounding count
            as zero. 0 where it is not known.

    Source: the paper, Theorem 1.

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> MarkowitzProblem([[0.2, 0.0]], [np.eye(2)], 1.0).smooth_form().gradients(np.array([[0.5, 0.5]])).round(3)
        array([[[0.8, 1. ]]])
    """

    constraints: Polyhedron
    gradients: Callable[[Array], Array]
    lift: Lift | None = None
    size: float = 0.0
