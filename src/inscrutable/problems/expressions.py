"""Values and gradients of CVXPY expressions of one variable at many points at once.

An expression is a tree. Its affine parts have one Jacobian for all points, computed once; above them the chain rule uses
formulas for the common atoms, and CVXPY's own gradients, point by point, for others. CVXPY's public `grad` builds the
Jacobians again at every point, some milliseconds each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from inscrutable.validation import Array

Function = Callable[[Array], Array]


@dataclass(eq=False)
class Node:
    """One expression: constant, affine in the variable, affine in other nodes, or an atom of other nodes.

    Entries are in CVXPY's order, the columns of a matrix one after the other.
    """

    expression: Any
    shape: tuple[int, ...]
    constant: Array | None = None  # (size,)
    offset: Array | float = 0.0  # (size,)
    slope: Array | None = None  # (U, size)
    children: list[Node] = field(default_factory=list)
    slopes: list[Array | None] | None = None  # (child's size, size) of an affine atom, None for constants
    is_entrywise: bool = False  # whether each entry depends on the same entries of its arguments alone
    derivative: Function | None = None  # the slope of a function of one argument, entry by entry
    gather: tuple[Function, Function] | None = (
        None  # value (n,) and gradient (n, child's size) of a function of one vector
    )

    @cached_property
    def size(self) -> int:
        """Number of entries."""
        return int(np.prod(self.shape, dtype=np.int64))

    def values(self, points: Array) -> Array:
        """Return the expression's entries (n,size) at points (n,U)."""
        if self.constant is not None:
            return np.broadcast_to(self.constant, (len(points), self.size))
        if self.slope is not None:
            return np.asarray(self.offset + points @ self.slope)
        if self.slopes is not None:
            total = np.tile(self.offset, (len(points), 1))
            for child, slope in zip(self.children, self.slopes, strict=True):
                if slope is not None:
                    total += child.values(points) @ slope
            return total
        inner = [child.values(points) for child in self.children]
        if self.is_entrywise:
            return np.asarray(self.expression.numeric(inner))
        if self.gather is not None:
            return self.gather[0](inner[0])[:, None]
        return np.array(
            [np.ravel(self.expression.numeric(self._shaped(inner, row)), "F") for row in range(len(points))]
        )

    def gradients(self, points: Array) -> Array:
        """Return the Jacobians (n,U,size), NaN outside the domain."""
        if self.slope is not None:
            return np.broadcast_to(self.slope, (len(points), *self.slope.shape))
        total = np.zeros((len(points), points.shape[1], self.size))
        if self.slopes is not None:
            for child, slope in zip(self.children, self.slopes, strict=True):
                if slope is not None:
                    total += child.gradients(points) @ slope
            return total
        inner = [child.values(points) for child in self.children]
        if self.derivative is not None:
            return self.children[0].gradients(points) * self.derivative(inner[0])[:, None, :]
        if self.gather is not None:
            return self.children[0].gradients(points) @ self.gather[1](inner[0])[:, :, None]
        below = [None if child.constant is not None else child.gradients(points) for child in self.children]
        for row in range(len(points)):
            parts = self.expression._grad(self._shaped(inner, row))
            for child, jacobian, part in zip(self.children, below, parts, strict=False):  # constants may have no part
                if jacobian is not None:
                    total[row] += np.nan if part is None else jacobian[row] @ _matrix(part, child.size, self.size)
        return total

    def without_slope(self, point: Array) -> Any:
        """Return the innermost expression that has no finite slope at a point (U,), None where all have one."""
        if self.constant is not None or np.isfinite(self.gradients(point[None])).all():
            return None
        inner = (child.without_slope(point) for child in self.children)
        return next((each for each in inner if each is not None), self.expression)

    def _shaped(self, inner: list[Array], row: int) -> list[Any]:
        return [np.reshape(each[row], child.shape, order="F") for child, each in zip(self.children, inner, strict=True)]


def tree_of(expression: Any, variable: Any) -> Node:
    """Return the tree of an expression in `variable` alone; the variable's value is changed."""
    from cvxpy.atoms.affine.affine_atom import AffAtom
    from cvxpy.atoms.elementwise.elementwise import Elementwise

    node = Node(expression, tuple(expression.shape))
    if expression.is_constant():
        node.constant = np.ravel(_dense(expression.value), order="F").astype(np.float64)
    elif expression.is_affine():
        columns = []
        for point in np.vstack([np.zeros(variable.size), np.eye(variable.size)]):
            variable.save_value(point)
            columns.append(np.ravel(_dense(expression.value), order="F"))
        node.offset = np.array(columns[0], dtype=np.float64)
        node.slope = np.array(columns[1:], dtype=np.float64) - node.offset
    else:
        node.children = [tree_of(each, variable) for each in expression.args]
        if isinstance(expression, AffAtom):
            _describe_affine(node)
        else:
            node.is_entrywise = isinstance(expression, Elementwise) and all(
                child.size == 1 or child.shape == node.shape for child in node.children
            )
            node.derivative, node.gather = _entrywise(node), _gathered(node)
    return node


def _describe_affine(node: Node) -> None:
    """Find the offset and the slopes of an affine atom of other nodes, the same at all points."""
    zero = [np.zeros(child.size) if child.constant is None else child.constant for child in node.children]
    arguments = [np.reshape(each, child.shape, order="F") for child, each in zip(node.children, zero, strict=True)]
    node.offset = np.ravel(_dense(node.expression.numeric(arguments)), order="F").astype(np.float64)
    parts = [*node.expression._grad(arguments), *[None] * len(node.children)]
    node.slopes = [
        None if child.constant is not None else _matrix(part, child.size, node.size)
        for child, part in zip(node.children, parts, strict=False)
    ]


def _entrywise(node: Node) -> Function | None:
    """The slope of an atom that acts on every entry separately."""
    name = type(node.expression).__name__
    if not node.is_entrywise or len(node.children) != 1:
        return None
    if name == "huber":
        most = float(node.expression.M.value)
        return lambda x: 2.0 * np.clip(x, -most, most)
    if name.lower().startswith("power"):
        return _power_slope(float(node.expression.p.value))
    return _ENTRYWISE.get(name)


def _gathered(node: Node) -> tuple[Function, Function] | None:
    """The formula of an atom from one vector to a number."""
    name, first = type(node.expression).__name__, node.children[0]
    if node.size != 1 or any(child.constant is None for child in node.children[1:]):
        return None
    if name.lower().startswith("pnorm") and float(node.expression.p) == 2.0 and node.expression.axis is None:
        return (_length, lambda x: x / np.where(_length(x) > 0.0, _length(x), 1.0)[:, None])
    if name == "log_sum_exp" and node.expression.axis is None:
        return _log_sum, _shares
    if name == "quad_over_lin" and len(node.children) == 2 and node.children[1].size == 1:
        share = 1.0 / float(np.ravel(node.children[1].constant)[0])  # type: ignore[arg-type]
        return (lambda x: share * (x * x).sum(axis=1), lambda x: 2.0 * share * x)
    if name == "QuadForm" and len(first.shape) == 1:
        form = np.reshape(node.children[1].constant, (first.size, first.size), order="F")  # type: ignore[call-overload]
        return (lambda x: np.einsum("ni,ij,nj->n", x, form, x), lambda x: x @ (form + form.T))
    return None


def _power_slope(p: float) -> Function:
    """p x^(p−1), also at 0 where it is finite there; for even p at negative x too."""
    if p > 0 and p % 2 == 0:
        return lambda x: p * x ** (p - 1.0)
    slope = _within(lambda x: p * x ** (p - 1.0))
    return slope if p < 1 else lambda x: np.where(x == 0.0, float(p == 1), slope(x))


def _log_sum(rows: Array) -> Array:
    """log Σ_j e^{x_j}; SciPy's checks of its arguments take ten times as long as this for a few rows."""
    most = rows.max(axis=1)
    return np.asarray(most + np.log(np.exp(rows - most[:, None]).sum(axis=1)))


def _shares(rows: Array) -> Array:
    parts = np.exp(rows - rows.max(axis=1, keepdims=True))
    return np.asarray(parts / parts.sum(axis=1, keepdims=True))


def _length(rows: Array) -> Array:
    return np.asarray(np.linalg.norm(rows, axis=1))


def _within(formula: Function) -> Function:
    """The formula where its argument is positive, NaN elsewhere."""
    return lambda x: np.where(x > 0.0, formula(np.where(x > 0.0, x, 1.0)), np.nan)


_ENTRYWISE: dict[str, Function] = {
    "log": _within(np.reciprocal),
    "exp": np.exp,
    "entr": _within(lambda x: -np.log(x) - 1.0),
    "logistic": lambda x: 0.5 * (1.0 + np.tanh(0.5 * x)),
    "abs": np.sign,
}


def _matrix(part: Any, rows: int, columns: int) -> Array:
    """An atom's slopes as a matrix, whatever CVXPY gives them as."""
    dense = np.asarray(_dense(part), dtype=np.float64)
    return dense * np.eye(rows) if dense.ndim == 0 else dense.reshape(rows, columns)


def _dense(value: Any) -> Any:
    return value.toarray() if hasattr(value, "toarray") else value
