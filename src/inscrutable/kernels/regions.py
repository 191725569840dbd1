"""Critical regions: the decisions on which the same rows are tight, end to end in flat arrays.

On a region u = u_0 + Z v with k free coordinates; with w = (v, 1) costs and rows are those of `faces`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from inscrutable.kernels.faces import place_on_face
from inscrutable.kernels.options import inlined, uncounted
from inscrutable.kernels.set_distance import Face

UNKNOWN = -1


class Regions(NamedTuple):
    """K regions of a problem with X states, U actions and R inequality rows."""

    size: Any  # (K,) free coordinates k; UNKNOWN where the programme is not made yet
    n_rows: Any  # (K,)
    n_set_rows: Any  # (K,) how many of the rows describe the consistent set: probabilities, then multipliers
    scale: Any  # (K,) size of the gradients
    is_point: Any  # (K,) whether a decision has one belief: the gradients of X states have rank X − 1
    curve_at: Any  # (K,) where the costs (X, k+1, k+1) of each begin
    row_at: Any  # (K,) the rows (m, X, k+1)
    chart_at: Any  # (K,) the origin (U,), then Z (U, k)
    curves: Any  # flat
    rows: Any  # flat
    charts: Any  # flat
    tight: Any  # (K,R)
    n_observable: Any  # (K,) how many tight rows bind the consistent set: not those of mere copies
    observable: Any  # (K,R) their numbers
    beyond: Any  # (K,R) the region in which one row is loose instead of tight, or tight instead of loose
    bounds: Any  # (low (U,), high (U,)) values that single rows leave to coordinates


@inlined
def face_of(regions: Any, number: int, n_states: int) -> Face:
    """Costs (X, k+1, k+1) and rows (m, X, k+1) of a region."""
    k, m = regions.size[number] + 1, regions.n_rows[number]
    first, start = regions.curve_at[number], regions.row_at[number]
    curves = regions.curves[first : first + n_states * k * k].reshape((n_states, k, k))
    rows = regions.rows[start : start + m * n_states * k].reshape((m, n_states, k))
    return Face(curves, rows, regions.n_set_rows[number], regions.scale[number])


@inlined
def chart_of(regions: Any, number: int) -> Any:
    """The origin (U,) and Z (U, k) of a region."""
    n_actions, first = regions.bounds[0].size, regions.chart_at[number]
    origin = regions.charts[first : first + n_actions]
    first += n_actions
    return origin, regions.charts[first : first + n_actions * regions.size[number]].reshape((n_actions, -1))


@uncounted
def locate(regions: Any, number: int, action: Any, w: Any) -> None:
    """Fill w = (Z'(u − u_0), 1) of a decision u (U,)."""
    origin, span = chart_of(regions, number)
    for a in range(span.shape[1]):
        w[a] = 0.0
    for j in range(origin.size):
        away = action[j] - origin[j]
        if away != 0.0:
            for a in range(span.shape[1]):
                w[a] += span[j, a] * away
    w[span.shape[1]] = 1.0


@uncounted
def decision_in(regions: Any, number: int, w: Any, action: Any) -> None:
    """Fill the decision (U,) at w."""
    origin, span = chart_of(regions, number)
    place_on_face(origin, span, regions.bounds, w, action)


@uncounted
def has_multipliers(regions: Any, number: int, n_states: int) -> bool:
    """Whether every observable row has a multiplier of its own, in order."""
    return bool(regions.n_set_rows[number] - n_states == regions.n_observable[number])
