"""The maps of disclosures: decisions (M,U) in, disclosed values (M,V) out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from inscrutable import tolerances
from inscrutable.errors import InputError
from inscrutable.validation import Array

_PRICE_DIGITS = 9
"""Of the largest price at one time; what follows is the rounding of solvers."""


def _of_numbers(what: str) -> Callable[[Callable[..., Array]], Callable[..., Array]]:
    """Refuse finite choices, which have no sizes."""

    def made(function: Callable[..., Array]) -> Callable[..., Array]:
        def checked(points: Array, *values: Any) -> Array:
            if points.ndim != 2:
                raise InputError(f"{what} shows sizes, but the decisions are choices, which have none")
            return function(points, *values)

        return checked

    return made


@_of_numbers("rounded")
def _rounded(points: Array, digits: int) -> Array:
    return np.asarray(np.round(points, digits) + 0.0)  # no −0


@_of_numbers("long_only")
def _long_only(points: Array) -> Array:
    return np.asarray(np.maximum(points, 0.0))


@_of_numbers("at_least")
def _at_least(points: Array, weight: float) -> Array:
    return np.where(np.abs(points) >= weight - tolerances.SAME_ACTION, points, 0.0)


@_of_numbers("top")
def _top(points: Array, count: int) -> Array:
    # Sizes that cannot be distinguished are a tie.
    sizes = np.round(np.abs(points) / tolerances.SAME_ACTION)
    kept = np.argsort(-sizes, axis=1, kind="stable")[:, :count]
    found = np.zeros_like(points)
    np.put_along_axis(found, kept, np.take_along_axis(points, kept, axis=1), axis=1)
    return found


def _grouped(points: Array, labels: tuple[Any, ...]) -> Array:
    group = {label: place for place, label in enumerate(dict.fromkeys(labels))}
    place = np.array([group[label] for label in labels])
    if points.ndim == 1:
        if points.min() < 0 or points.max() >= len(labels):
            raise InputError(f"grouped has {len(labels)} labels, one a choice, but a choice is {points.max()}")
        return np.asarray(place[points])
    if points.shape[1] != len(labels):
        raise InputError(f"grouped has {len(labels)} labels, but decisions have {points.shape[1]} coordinates")
    return np.asarray(points @ np.eye(len(group))[place])


@_of_numbers("only")
def _only(points: Array, places: tuple[int, ...]) -> Array:
    if max(places) >= points.shape[1]:
        raise InputError(f"only shows place {max(places)}, but decisions have {points.shape[1]} coordinates")
    return np.asarray(points[:, list(places)])


@_of_numbers("bus_prices")
def _bus_prices(points: Array, *problem: Any) -> Array:
    if not problem:
        raise InputError("bus_prices needs the dispatch problem whose prices are shown: pass bus_prices(problem)")
    prices = np.atleast_2d(problem[0].bus_prices(points))
    size = 10.0 ** np.ceil(np.log10(np.maximum(np.abs(prices).max(axis=1, keepdims=True), 1.0)))
    return np.asarray(np.round(prices / size, _PRICE_DIGITS) * size + 0.0)


@_of_numbers("portfolio_return")
def _portfolio_return(points: Array, returns: Array) -> Array:
    if points.shape != returns.shape:
        raise InputError(
            f"portfolio_return needs one number an asset, but what comes before it shows {points.shape[1]} of "
            f"{returns.shape[1]}"
        )
    return np.asarray((points * returns).sum(axis=1, keepdims=True))


MAPS: Mapping[str, Callable[..., Array]] = {
    "rounded": _rounded,
    "long_only": _long_only,
    "at_least": _at_least,
    "top": _top,
    "grouped": _grouped,
    "only": _only,
    "bus_prices": _bus_prices,
    "portfolio_return": _portfolio_return,
}
"""Every map by its name."""
