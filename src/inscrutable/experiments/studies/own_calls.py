"""Calls of user-defined parts: an error names the part, its method, and the exception or the invalid result."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable, Mapping
from copy import copy
from functools import lru_cache, wraps
from typing import Any

import numpy as np

from inscrutable import validation
from inscrutable.errors import InputError, InscrutableError
from inscrutable.experiments.studies.extensions import EMISSION, MAKER, MEASURE, OBSERVER, PROBLEM, Extension, loaded
from inscrutable.experiments.studies.tasks import pass_interrupt
from inscrutable.mechanisms.played import checked_memoryless
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import LinearForm, Polyhedron, QuadraticForm, SmoothForm

_Check = Callable[[Any, Any, Any, int], Any]
"""Maps (part, result of a method, its arguments, X) to the checked result, or raises an error."""


def own_part(extension: Extension, given: Mapping[str, Any], keys: Mapping[str, Any]) -> Any:
    """Return a part, made with the file's keys and with those of its parameters that the study fills in.

    Raises:
        InputError: It cannot be made; later, where one of its methods fails or returns what it must not.
    """
    thing: Any = loaded(extension)
    known = {*extension.needed, *extension.defaults}
    filled = {key: value for key, value in given.items() if key in extension.given}
    filled |= {key: value for key, value in keys.items() if key in known}
    found = copy(thing) if isinstance(thing, PrivacyMeasure) else _called(extension.spec, thing, **filled)
    n_states = _called(extension.spec, _whole, extension.kind, found, given.get("problem"))
    own_class: Any = type(found)
    object.__setattr__(found, "__class__", _guarded(own_class, extension.spec, extension.kind, n_states))
    return found


def own_number(extension: Extension, given: Mapping[str, Any]) -> float:
    """Return the number from a user-defined function; NaN where it returns none."""
    value = _called(extension.spec, loaded(extension), **{name: given[name] for name in extension.given})
    return float(_called(extension.spec, _one_number, value))


def _called(said: str, function: Callable[..., Any], /, *given: Any, **named: Any) -> Any:
    """Call user code; every exception becomes an error of this package that names the place."""
    module = said.partition(":")[0]
    try:
        return function(*given, **named)
    except InscrutableError as error:
        if str(error).startswith(f"{module}:"):
            raise
        raise type(error)(f"{said}: {error}") from error
    except (Exception, SystemExit) as error:
        pass_interrupt(error)
        lines = [n for frame, n in traceback.walk_tb(error.__traceback__) if frame.f_globals.get("__name__") == module]
        place = f" (line {lines[-1]} of {module})" if lines else ""
        raise InputError(f"{said} failed with {type(error).__name__}: {error}{place}") from error


def _read_only(value: Any) -> Any:
    """Return an array as a read-only view; a part that changes its argument would change what others are given."""
    if not isinstance(value, np.ndarray):
        return value
    found = value.view()
    found.flags.writeable = False
    return found


@lru_cache(maxsize=64)
def _guarded(own_class: Any, spec: str, kind: str, n_states: int) -> Any:
    """Return a subclass of a user-defined class that checks the results of its methods, and gives those that stand in place of
    the library's read-only arguments too."""
    inherited = {name for base in own_class.__mro__ if _is_library(base.__module__) for name in vars(base)}
    checks = {name: _unchecked for name in sorted(inherited) if not name.startswith("_")} | dict(_CHECKS[kind])
    methods = {
        name: _checked(getattr(own_class, name), spec if name == "__call__" else f"{spec}.{name}", check, n_states)
        for name, check in checks.items()
        if _is_own(own_class, name)
    }
    if not methods:  # some searches test for the library's classes themselves
        return own_class
    there = {name: getattr(own_class, name) for name in ("__module__", "__qualname__", "__doc__")}
    return type(own_class.__name__, (own_class,), {"__slots__": (), **there, **methods})


def _is_own(own_class: type, name: str) -> bool:
    """Whether a method is the user's; those of the library need no check."""
    method = inspect.getattr_static(own_class, name, None)
    return inspect.isfunction(method) and not _is_library(method.__module__)


def _is_library(module: str) -> bool:
    return module.startswith("inscrutable.")


def _checked(method: Callable[..., Any], said: str, check: _Check, n_states: int) -> Callable[..., Any]:
    @wraps(method)
    def call(part: Any, *given: Any, **named: Any) -> Any:
        kept = [_read_only(value) for value in given]
        found = _called(said, method, part, *kept, **{name: _read_only(value) for name, value in named.items()})
        return _called(said, check, part, found, given[0] if given else next(iter(named.values()), None), n_states)

    return call


def _whole(kind: str, part: Any, problem: Any) -> int:
    """Check the attributes of a part; return the number of states."""
    if kind == MAKER:
        checked_memoryless(part)
    if kind == PROBLEM:
        _whole_problem(part)
    if problem is not None:
        part = problem
    return validation.count(part.n_states, "n_states") if hasattr(part, "n_states") else 0


def _whole_problem(problem: Any) -> None:
    n_states = validation.count(problem.n_states, "n_states")
    _of_kind(problem.constraints, Polyhedron, "constraints")
    for name, kind in (("linear_form", LinearForm), ("quadratic_form", QuadraticForm), ("smooth_form", SmoothForm)):
        form = getattr(problem, name)() if _is_own(type(problem), name) else None
        if form is not None:
            _whole_form(_of_kind(form, kind, f"what {name} returns"), n_states, f"of {name}")


def _whole_form(form: Any, n_states: int, said: str) -> None:
    size = _of_kind(form.constraints, Polyhedron, f"constraints {said}").n_actions
    rows = (n_states, size)
    for part, shape in {"costs": rows, "hessians": (*rows, size), "linear": rows, "constants": (n_states,)}.items():
        if getattr(form, part, None) is not None:
            _numbers(getattr(form, part), shape, f"{part} {said}")


def _of_kind(value: Any, kind: type, what: str) -> Any:
    if not isinstance(value, kind):
        raise InputError(f"{what} must be a {kind.__name__}, got {value!r:.60}")
    return value


def _numbers(value: Any, shape: tuple[int, ...], what: str, *, limits: bool = True) -> Any:
    """Return numbers of a shape as an array, without NaN, and without infinity but in `limits`."""
    plain = type(value) is np.ndarray and value.dtype == np.float64
    found = value if plain else validation.real_array(value, what)
    if found.shape != shape:
        raise InputError(f"{what} must have shape {shape}, got {found.shape}")
    bad = np.isnan(found) if limits else ~np.isfinite(found)
    if bad.any():
        first = np.argwhere(bad)[0]
        raise InputError(f"{what} must be numbers, got {found[tuple(first)]} at index {first.tolist()}")
    return found


def _one_number(value: Any) -> float:
    try:
        if np.ndim(value) == 0:
            return float(value)
    except (TypeError, ValueError):  # no number, or a ragged list
        pass
    raise InputError(f"the value must be one number, got {value!r:.60}")


def _decisions(problem: Any, value: Any, beliefs: Any, n_states: int) -> Any:
    points = problem.as_points(value)
    _numbers(points, (*np.shape(beliefs)[:-1], problem.n_actions), "decisions", limits=False)
    problem.constraints.check_inside(points, "the decision")
    return np.asarray(value) if problem.is_discrete else points


def _costs(problem: Any, value: Any, actions: Any, n_states: int) -> Any:
    return _numbers(value, (*np.shape(actions)[:-1], n_states), "costs")


def _slopes(problem: Any, value: Any, actions: Any, n_states: int) -> Any:
    return _numbers(value, (*np.shape(actions)[:-1], n_states, problem.n_actions), "gradients")


def _likelihoods(emission: Any, value: Any, observations: Any, n_states: int) -> Any:
    return _numbers(value, (len(observations), n_states), "log-likelihoods")


def _observations(emission: Any, value: Any, states: Any, n_states: int) -> Any:
    try:
        found = np.asarray(value)
    except ValueError as error:  # ragged
        raise InputError(f"observations must all have one shape: {error}") from None
    if found.shape[:1] != np.shape(states):
        raise InputError(f"observations must be {len(states)}, one for each state of the path, got shape {found.shape}")
    return found


def _played(maker: Any, value: Any, beliefs: Any, n_states: int) -> Any:
    problem, lead = maker.problem, (len(beliefs),)
    if not hasattr(value, "action") and not (hasattr(value, "actions") and hasattr(value, "probabilities")):
        raise InputError(f"the answer must have `action`, or `actions` and `probabilities`, got {value!r:.60}")
    if hasattr(value, "probabilities"):
        shares = validation.stochastic_rows(value.probabilities, "probabilities")
        points = _numbers(problem.as_points(value.actions), (*lead, shares.shape[1], problem.n_actions), "actions")
        _numbers(shares, (*lead, shares.shape[1]), "probabilities")
        points = points[shares > 0]
    else:
        points = _numbers(problem.as_points(value.action), (*lead, problem.n_actions), "action")
    problem.check_actions(points)
    return value


def _guesses(observer: Any, value: Any, actions: Any, n_states: int) -> Any:
    return validation.stochastic_rows(_numbers(value, (len(actions), n_states), "guesses"), "guesses")


def _privacy(measure: Any, value: Any, belief: Any, n_states: int) -> float:
    found = _one_number(value)
    if np.isnan(found):
        raise InputError("the value is NaN; expected a number, −inf where the goal is missed")
    return found


def _unchecked(part: Any, value: Any, given: Any, n_states: int) -> Any:
    return value


def _privacies(measure: Any, value: Any, belief: Any, n_states: int) -> Any:
    _numbers(value.privacies, np.shape(value.exact), "privacies")
    return value


_CHECKS: Mapping[str, Mapping[str, _Check]] = {
    MEASURE: {"__call__": _privacy, "upper_bound": _privacy, "values": _privacies},
    MAKER: {"decide_many": _played},
    OBSERVER: {"estimates": _guesses},
    PROBLEM: {"solve": _decisions, "state_costs": _costs, "cost_gradients": _slopes},
    EMISSION: {"log_likelihoods": _likelihoods, "sample": _observations},
}
