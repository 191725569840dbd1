"""Feasible sets of portfolios: caps, floors, groups, long and short, turnover; each some rows of a `Polyhedron`.

Assets are given by their number or by their names, which then name rows in messages. Sets are combined with `&`. A limit on a
sum of magnitudes, Σ|u_j| ≤ g, is a `MagnitudeRegion`: for quadratic and linear costs of any number of assets, for other costs
if at most ten of them can have either sign.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.axes import Axis, Names, axis_labels, few
from inscrutable.errors import InputError, ModelError
from inscrutable.problems.constraints import Bounds, Polyhedron
from inscrutable.problems.magnitudes import limited
from inscrutable.problems.segments import MagnitudeLimit
from inscrutable.validation import Array

Assets = int | Sequence[str]
"""A number of assets, called u[0], u[1], …, or their names."""


def max_weights(
    assets: Assets, limits: ArrayLike | Mapping[str, float], *, min_slack: float = tolerances.MIN_SLACK
) -> Polyhedron:
    """Return {u : u_j ≤ limit_j}, a cap on the weight of every asset or of some.

    Formula: one row u_j ≤ limit_j per finite limit.

    Args:
        assets: The number of assets, or their names.
        limits: One number for all, shape (U,) with inf for no limit, or a mapping from names to limits.
        min_slack: Least distance from a limit that is not tight in an admissible decision.

    Raises:
        InputError: A limit is NaN, a name is unknown or repeated, the shape is wrong, or no limit is finite.

    Cost: none; one bound per limit. Source: the paper, eq. (3).

    Example:
        >>> max_weights(["Food", "Oil"], {"Oil": 0.25}).names
        ('Oil <= 0.25',)
    """
    names = asset_names(assets)
    values = _per_asset(limits, assets, "limits", np.inf)
    return _single_rows(names, values, 1.0, min_slack, _labels(assets))


def min_weights(
    assets: Assets, limits: ArrayLike | Mapping[str, float], *, min_slack: float = tolerances.MIN_SLACK
) -> Polyhedron:
    """Return {u : u_j ≥ limit_j}, a floor on the weight of every asset or of some.

    Formula: one row −u_j ≤ −limit_j per finite limit.

    Args:
        assets: The number of assets, or their names.
        limits: One number for all, shape (U,) with −inf for no limit, or a mapping from names to limits.
        min_slack: Least distance from a limit that is not tight in an admissible decision.

    Raises:
        InputError: A limit is NaN, a name is unknown or repeated, the shape is wrong, or no limit is finite.

    Cost: none; one bound per limit. Source: the paper, eq. (3).

    Example:
        >>> min_weights(2, [0.1, -np.inf]).names
        ('u[0] >= 0.1',)
    """
    names = asset_names(assets)
    values = _per_asset(limits, assets, "limits", -np.inf)
    return _single_rows(names, values, -1.0, min_slack, _labels(assets))


def group_caps(
    assets: Assets,
    groups: Mapping[str, Sequence[Any]],
    caps: float | Mapping[str, float],
    *,
    min_slack: float = tolerances.MIN_SLACK,
) -> Polyhedron:
    """Return {u : Σ_{j in group} u_j ≤ cap}, one row per group: sectors, countries, issuers.

    Args:
        assets: The number of assets, or their names.
        groups: Group name → its assets, by name or number; groups may overlap.
        caps: One number for all groups, or group name → cap; groups left out have none, and inf is none.
        min_slack: Least distance from a cap that is not tight in an admissible decision.

    Raises:
        InputError: A group holds an unknown or repeated asset, a cap belongs to no group, or is NaN.
        ModelError: A group without assets has a cap below zero.

    Cost: none; one row per group. Source: the paper, eq. (3).

    Example:
        >>> group_caps(["Food", "Oil", "Gas"], {"energy": ["Oil", "Gas"]}, 0.4).names
        ('energy <= 0.4',)
    """
    names = asset_names(assets)
    if not isinstance(groups, Mapping) or not groups:
        raise InputError(f"groups must map group names to their assets, got {groups!r}")
    limits = dict(caps) if isinstance(caps, Mapping) else dict.fromkeys(groups, caps)
    unknown = [name for name in limits if name not in groups]
    if unknown:
        raise InputError(f"caps names {unknown[0]!r}, expected one of the groups: {', '.join(map(str, groups))}")
    if not limits:
        raise InputError("caps names no group: give a cap for at least one")
    rows, sides, labels = [], [], []
    for name, cap in limits.items():
        rows.append(
            np.isin(np.arange(len(names)), _numbers(groups[name], assets, f"group {str(name)!r}")).astype(float)
        )
        sides.append(float(validation.finite_array(cap, f"cap of group {name!r}", ndim=0, limits=True)))
        labels.append(f"{name} <= {sides[-1]:g}")
    return Polyhedron(rows, sides, names=labels, min_slack=min_slack, asset_names=_labels(assets))


def long_short(
    assets: Assets,
    *,
    gross: float,
    net: float | tuple[float, float] = 1.0,
    shortable: Sequence[Any] | None = None,
    min_slack: float = tolerances.MIN_SLACK,
) -> Polyhedron:
    """Return {u : Σ|u_j| ≤ gross, Σu_j = net}, holdings long and short.

    Formula: Σ|u_j| ≤ gross, least ≤ Σu_j ≤ greatest net, and u_j ≥ 0 for assets that are not `shortable`; a `MagnitudeRegion`
    where some are.

    Args:
        assets: The number of assets, or their names.
        gross: Largest Σ|u_j|, long and short holdings together, at least |net|.
        net: Σu, one number, or (least, greatest).
        shortable: Assets that may be short, by name or number; None is all of them.
        min_slack: Least slack of a row that is not tight in an admissible decision.

    Raises:
        InputError: An asset is unknown, or a number is not finite.
        ModelError: The gross limit is below |net|, or the least net is above the greatest.

    Cost: none. Source: the paper, eq. (3).

    Example:
        >>> long_short(["A", "B"], gross=1.6, net=1.0).names
        ('net = 1', 'gross <= 1.6')
    """
    names = asset_names(assets)
    most = validation.non_negative(gross, "gross")
    exact = np.ndim(net) == 0
    low, high = _range(net)
    if most < max(low, -high):
        raise ModelError(
            f"gross limit {most:g} is below the net {low if low > 0 else high:g} that is asked for: raise the one or "
            "lower the other"
        )
    chosen = np.arange(len(names)) if shortable is None else _numbers(shortable, assets, "shortable")
    kept, ones, known = np.setdiff1d(np.arange(len(names)), chosen), np.ones(len(names)), _labels(assets)
    labels = [f"{names[j]} >= 0" for j in kept]
    if exact:
        nets, sides = [f"net = {low:g}"], np.zeros(kept.size)
        rows = -np.eye(len(names))[kept]
    else:
        nets = [f"net <= {high:g}", f"net >= {low:g}"]
        sides = np.concatenate([np.zeros(kept.size), [high, -low]])
        rows = np.vstack([-np.eye(len(names))[kept], ones, -ones])
    equal = ([ones], [low]) if exact else (None, None)
    plain = Polyhedron(rows, sides, *equal, names=labels + nets, min_slack=min_slack, asset_names=known)
    name = f"gross <= {most:g}"
    return limited(plain, MagnitudeLimit(ones[None], np.zeros((1, len(names))), most, name))


def turnover(
    previous: ArrayLike | Mapping[str, float],
    limit: float,
    *,
    assets: Sequence[str] | None = None,
    long_only: bool = False,
    min_slack: float = tolerances.MIN_SLACK,
) -> Polyhedron:
    """Return {u : Σ|u_j − previous_j| ≤ limit}, a limit on purchases plus sales against the last published weights.

    `previous` are the weights that were published, not the private optimum: the agent and the observer both know them, so
    that the limit is part of the problem that the observer inverts.

    Formula: Σ|u_j − previous_j| ≤ limit, a `MagnitudeRegion`; one row where all assets can only be bought.

    Args:
        previous: The last published weights, shape (U,), or a mapping (or a pandas series) from names to weights.
        limit: Largest sum of purchases and sales, at least 0, in the weights' unit.
        assets: Names of the assets, in whose order labelled weights are put; None takes a mapping's keys.
        long_only: Whether assets without a previous weight can only be bought; they get a row u_j ≥ 0.
        min_slack: Least slack of a row that is not tight in an admissible decision.

    Raises:
        InputError: A weight is not finite, the limit is negative or names disagree.

    Cost: none. Source: the paper, eq. (3).

    Example:
        >>> region = turnover([0.5, 0.5], 0.2)
        >>> bool(region.violation([0.6, 0.4]) == 0), bool(region.violation([0.7, 0.3]) == 0)
        (True, False)
    """
    order = Axis("asset", None if assets is None else tuple(assets), learns=True)
    weights = validation.finite_array(previous, "previous", ndim=1, axes=(order,))
    names = asset_names(weights.size if order.names is None else [str(name) for name in order.names])
    if len(names) != weights.size:
        raise InputError(f"previous has {weights.size} weights, expected one per asset: {len(names)}")
    most = validation.non_negative(limit, "limit")
    bought = weights <= 0 if long_only else np.zeros(weights.size, dtype=bool)
    plain = Polyhedron(
        -np.eye(weights.size)[bought],
        np.zeros(int(bought.sum())),
        names=[f"{names[j]} >= 0" for j in np.flatnonzero(bought)],
        min_slack=min_slack,
        asset_names=order.names,
    )
    return limited(plain, MagnitudeLimit(np.ones((1, weights.size)), weights[None], most, f"turnover <= {most:g}"))


def asset_names(assets: Assets) -> tuple[str, ...]:
    """Return the names of assets given by their number or their names."""
    if isinstance(assets, str) or not hasattr(assets, "__iter__"):
        return tuple(f"u[{j}]" for j in range(validation.count(assets, "assets")))
    names = tuple(str(name) for name in assets)
    if not names:
        raise InputError("assets is empty, expected at least one name")
    repeated = [name for name in names if names.count(name) > 1]
    if repeated:
        raise InputError(f"assets names {repeated[0]!r} twice; names must differ")
    return names


def _labels(assets: Assets) -> Names | None:
    return None if isinstance(assets, str) or not hasattr(assets, "__iter__") else tuple(assets)


def _are_numbers(assets: Assets) -> bool:
    """Return whether a label of an asset is a number, which then is no place."""
    return any(isinstance(label, (int, float, np.integer)) for label in _labels(assets) or ())


def _numbers(members: Sequence[Any], assets: Assets, what: str) -> np.ndarray:
    """Return the places of assets given by label, by its text, or by place where no label is a number; each once."""
    if isinstance(members, str) or not isinstance(members, Iterable):
        text = "the text " if isinstance(members, str) else ""
        raise InputError(f"{what} must be a list of assets, got {text}{members!r}")
    names, by_label = asset_names(assets), _are_numbers(assets)
    places: dict[Any, int] = {} if by_label else {j: j for j in range(len(names))}
    places |= {name: j for j, name in enumerate(names)} | {label: j for j, label in enumerate(_labels(assets) or ())}
    found = []
    for member in members:
        is_label = isinstance(member, Hashable) and not isinstance(member, (bool, np.bool_))
        if not is_label or (isinstance(member, float) and not by_label) or member not in places:
            number = "" if by_label or isinstance(member, str) else f" or a number below {len(names)}"
            raise InputError(f"{what} has {member!r}, expected one of {few(names, 12)}{number}")
        found.append(places[member])
    if len(set(found)) < len(found):
        raise InputError(f"{what} has {names[max(found, key=found.count)]} twice")
    return np.array(found, dtype=np.int64)


def _per_asset(limits: ArrayLike | Mapping[str, float], assets: Assets, what: str, absent: float) -> Array:
    names = asset_names(assets)
    is_labelled = axis_labels(limits, 0) is not None or (hasattr(limits, "items") and _are_numbers(assets))
    if is_labelled or isinstance(limits, Mapping):
        limits = dict(_pairs(limits, what))
        values = np.full(len(names), absent)
        members = _numbers(list(limits), assets, what)
        values[members] = validation.finite_array(list(limits.values()), what, ndim=1, limits=True)
    else:
        given = validation.real_array(limits, what)
        if given.shape not in ((), (1,), (len(names),)):
            raise InputError(f"{what} must be one number or {len(names)} of them, got {limits!r}")
        values = np.array(np.broadcast_to(given, (len(names),)))
    if np.isnan(values).any() or (values == -absent).any():
        wrong = int(np.flatnonzero(np.isnan(values) | (values == -absent))[0])
        raise InputError(f"{what} has {values[wrong]} for {names[wrong]}; {absent} stands for no limit")
    if not np.isfinite(values).any():
        raise InputError(f"{what} has no finite entry, expected at least one limit")
    return values


def _pairs(limits: Any, what: str) -> list[tuple[Any, Any]]:
    """Labels and numbers of a mapping or a series."""
    if getattr(limits, "ndim", 1) != 1:
        raise InputError(f"{what} must be one number per asset, got shape {limits.shape}")
    pairs = list(limits.items())
    labels = [label for label, _ in pairs]
    twice = [label for label in labels if labels.count(label) > 1]
    if twice:
        raise InputError(f"{what} has {twice[0]!r} {len(twice)} times; labels must differ")
    return pairs


def _single_rows(
    names: tuple[str, ...], values: Array, sign: float, min_slack: float, assets: Names | None
) -> Polyhedron:
    relation = "<=" if sign > 0 else ">="
    labels = [f"{name} {relation} {value:g}" for name, value in zip(names, values, strict=True)]
    n = len(names)
    rows = np.arange(n), np.full(n, sign), sign * values
    return Bounds(n, rows, labels, min_slack=min_slack, asset_names=assets)


def _range(net: float | tuple[float, float]) -> tuple[float, float]:
    if np.ndim(net) == 0:
        value = validation.number_of(net, "net")
        return value, value
    low, high = (float(value) for value in _pair(net))
    if low > high:
        raise ModelError(f"net is from {low:g} to {high:g}, an empty range: swap the two")
    return low, high


def _pair(net: Any) -> Array:
    values = validation.finite_array(net, "net", ndim=1)
    if values.size != 2:
        raise InputError(f"net must be one number or (least, greatest), got {values.size} numbers")
    return values
