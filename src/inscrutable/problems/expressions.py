"""Values and gradients of CVXPY expressions of one variable, without asking CVXPY anew for what never changes.

An expression is a tree. Its affine parts have one Jacobian for all points, found once; above them the chain rule uses
each atom's own slopes. CVXPY's public `grad` builds the Jacobians again at every point, some milliseconds each.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from inscrutable.validation import Array


@dataclass(eq=False)
class Node:
    """One expression: constant, affine with Jacobian and offset, or an atom of other nodes."""

    expression: Any
    shape: tuple[int, ...]
    constant: Any = None
    slope: Array | None = None  # (U, size), entries of the expression in CVXPY's order
    offset: Array | float = 0.0  # (size,)
    children: list[Node] = field(default_factory=list)
    is_affine_atom: bool = False
    _parts: Any = None

    def value(self, point: Array) -> Any:
        """Return the expression's value at a point (U,)."""
        if self.constant is not None:
            return self.constant
        if self.slope is not None:
            return np.reshape(self.offset + point @ self.slope, self.shape, order="F")
        return self.expression.numeric([child.value(point) for child in self.children])

    def gradient(self, point: Array) -> Array | None:
        """Return the Jacobian (U, size) at a point, None outside the domain."""
        if self.slope is not None:
            return self.slope
        parts = self._parts
        if parts is None:
            parts = self.expression._grad([child.value(point) for child in self.children])
            if self.is_affine_atom:
                self._parts = parts
        size = int(np.prod(self.shape, dtype=np.int64))
        total = np.zeros((point.size, size))
        for child, part in zip(self.children, parts, strict=False):  # constants at the end may have no part
            if child.constant is not None:
                continue
            inner = None if part is None else child.gradient(point)
            if inner is None:
                return None
            dense = part.toarray() if hasattr(part, "toarray") else np.asarray(part, dtype=np.float64)
            total += inner * dense if dense.ndim == 0 else inner @ dense.reshape(inner.shape[1], size)
        return total


def tree_of(expression: Any, variable: Any) -> Node:
    """Return the tree of an expression in `variable` alone; the variable's value is changed."""
    from cvxpy.atoms.affine.affine_atom import AffAtom

    node = Node(expression, tuple(expression.shape))
    if expression.is_constant():
        node.constant = expression.value
    elif expression.is_affine():
        columns = []
        for point in np.vstack([np.zeros(variable.size), np.eye(variable.size)]):
            variable.save_value(point)
            columns.append(np.ravel(_dense(expression.value), order="F"))
        node.offset = np.array(columns[0], dtype=np.float64)
        node.slope = np.array(columns[1:], dtype=np.float64) - node.offset
    else:
        node.children = [tree_of(each, variable) for each in expression.args]
        node.is_affine_atom = isinstance(expression, AffAtom)
    return node


def _dense(value: Any) -> Any:
    return value.toarray() if hasattr(value, "toarray") else value
