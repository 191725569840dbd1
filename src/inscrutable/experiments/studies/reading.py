"""Read a study file: errors state file, line, the expectation and the nearest valid name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from difflib import get_close_matches
from math import prod
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from inscrutable.errors import InputError, ModelError
from inscrutable.experiments.makers import WithMemory
from inscrutable.experiments.observers import ALL, NOTHING, SequentialObserver
from inscrutable.experiments.sections import PlanFile, expected, shortened
from inscrutable.experiments.studies.extensions import Extension
from inscrutable.experiments.studies.grid import StudyGrid, variants
from inscrutable.experiments.studies.kinds import OTHER_KINDS, layout_of_kind
from inscrutable.experiments.studies.layout import (
    DispatchSection,
    GivenWorld,
    GridBeliefs,
    RandomWorld,
    StationaryBeliefs,
    StudyFile,
)
from inscrutable.experiments.studies.sizes import too_large, too_many
from inscrutable.experiments.studies.worlds import given_world, problem_of
from inscrutable.experiments.toml_lines import Place, TomlSource, nearest, read_toml

_NEAR = 0.5
_BY_NAME = ("decision_makers", "adversaries")
_OWN = ", or a part of your own that --extension module:name gives"
StudySource = TomlSource


def read_study(path: Path, extensions: tuple[Extension, ...] = ()) -> tuple[PlanFile, StudySource]:
    """Return the study of a TOML file, or raise one `InputError` that says where it is wrong."""
    hint = f"; what was run into it goes on with `inscrutable study resume {path}`"
    data, source = read_toml(path, "study", hint)
    return checked_study(data, source, extensions), source


def checked_study(data: Any, source: StudySource, extensions: tuple[Extension, ...] = ()) -> PlanFile:
    """Return a study from plain data, or raise one `InputError`."""
    data = dict(data) if isinstance(data, Mapping) else data
    if not isinstance(data, dict):
        raise InputError(f"{source.name}: a study is a table of keys, got {type(data).__name__}")
    try:
        study = _layout(data, source, extensions).model_validate(data)
    except ValidationError as error:
        problems = error.errors(include_url=False)
        first = min(problems, key=lambda each: each["type"] != "extra_forbidden")  # a misspelt key explains others
        others = len(problems) - 1
        more = f" (and {others} more {'mistake' if others == 1 else 'mistakes'})" if others else ""
        raise InputError(_said(first, data, source, extensions) + more) from None
    if isinstance(study, StudyFile):
        _check_together(study, source)
    return study


def _layout(
    data: dict[str, Any], source: StudySource | None = None, extensions: tuple[Extension, ...] = ()
) -> type[PlanFile]:
    """Return the layout of a file, by the kind that it names; a file that names none is a grid."""
    name = data.get("kind")
    if source is not None and "kind" in data and name not in OTHER_KINDS:
        near = nearest(str(name), OTHER_KINDS)
        raise InputError(f"{source.at(('kind',))}: unknown {shortened(name)}{near}; {_one_of(OTHER_KINDS)}, or no kind")
    return layout_of_kind(name, extensions)


def _said(
    problem: ErrorDetails, data: dict[str, Any], source: StudySource, extensions: tuple[Extension, ...] = ()
) -> str:
    place = _without_tags(problem["loc"], data)
    kind, context = problem["type"], problem.get("ctx", {})
    where = source.at(place)
    if kind == "extra_forbidden":
        known = _known_keys(problem["loc"][:-1], data, extensions)
        return f"{where}: there is no such key{nearest(str(place[-1]), known)}; expected one of: {', '.join(known)}"
    if kind == "missing":
        names = _names_of(place) if place[-1] in StudyFile.model_fields else []
        choice = f"; {_one_of(names)}" if names else ""
        return f"{source.at(place[:-1]) if place[:-1] else source.name}: the key {place[-1]} is missing{choice}"
    if kind == "union_tag_not_found":
        key = str(context["discriminator"]).strip("'")
        given = problem["input"]
        near = get_close_matches(key, given, n=1, cutoff=_NEAR) if isinstance(given, dict) else []
        if near:
            return f"{source.at((*place, near[0]))}: there is no such key; did you mean {key}?"
        return f"{where}: the key {key} is missing; {_one_of(_names_of(place))}"
    if kind == "union_tag_invalid":
        names = [each.strip(" '") for each in str(context["expected_tags"]).split(",")]
        key = str(context["discriminator"]).strip("'")
        where, own = source.at((*place, key)), "" if extensions else _OWN
        return f"{where}: unknown {context['tag']!r}{nearest(str(context['tag']), names)}; {_one_of(names)}{own}"
    if kind == "literal_error":
        names = [each.strip("' ") for each in str(context["expected"]).replace(" or ", ", ").split(",")]
        given = problem["input"]
        own = _OWN if place[-1] == "kind" and not extensions else ""
        return f"{where}: unknown {shortened(given)}{nearest(str(given), names)}; {_one_of(names)}{own}"
    return f"{where}: {_expected(problem)}, got {shortened(problem['input'])}"


def _expected(problem: ErrorDetails) -> str:
    """Return what was expected of a value, in the words of a file."""
    if problem["type"] == "model_attributes_type" and problem["loc"][0] in _BY_NAME:
        return "should be a name, or a table with the key name"
    return expected(problem)


def _one_of(names: Iterable[str]) -> str:
    return f"expected one of: {', '.join(names)}"


def _names_of(place: Place) -> list[str]:
    """The names that may stand where a section has none."""
    annotation: Any = StudyFile.model_fields[str(place[0])].annotation
    return [
        str(get_args(model.model_fields[key].annotation)[0])
        for model in _models(annotation)
        for key in ("kind", "name")
        if key in model.model_fields
    ]


def _models(annotation: Any) -> list[type[BaseModel]]:
    """Every section that an annotation allows."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]


def _known_keys(
    place: tuple[int | str, ...], data: dict[str, Any], extensions: tuple[Extension, ...] = ()
) -> list[str]:
    """The keys of the section in which an unknown one stands."""
    fields_of = _layout(data, extensions=extensions).model_fields
    if not place:
        return list(fields_of)
    models = _models(fields_of[str(place[0])].annotation)
    for model in models:
        fields = model.model_fields
        tag = fields.get("kind") or fields.get("name")
        if len(models) == 1 or (tag is not None and place[-1] in get_args(tag.annotation)):
            return list(fields)
    return sorted({name for model in models for name in model.model_fields})


def _without_tags(place: tuple[int | str, ...], data: Any) -> Place:
    """Return a place in the file, without the names that pydantic adds for a choice, and without indices of no list."""
    found: list[int | str] = []
    here = data
    for last, part in ((number == len(place) - 1, each) for number, each in enumerate(place)):
        if isinstance(here, dict) and (part in here or (last and isinstance(part, str) and part not in _tag(here))):
            found.append(part)
            here = here.get(part)
        elif isinstance(here, list) and isinstance(part, int) and part < len(here):
            found.append(part)
            here = here[part]
    return tuple(found)


def _tag(section: dict[str, Any]) -> tuple[Any, ...]:
    return (section.get("kind", "markowitz"), section.get("name"))


def _check_together(study: StudyFile, source: StudySource) -> None:
    """Refuse parts that are well formed but do not fit together."""
    _check_size(study, source)
    _check_listed_once(study, source)
    _check_followed(study, source)
    world = study.world
    if isinstance(study.problem, DispatchSection) and not isinstance(world, GivenWorld):
        raise InputError(
            f'{source.at(("problem", "kind"))}: dispatch needs a world of kind "given", got "{world.kind}"'
        )
    if isinstance(world, RandomWorld) and isinstance(study.beliefs, StationaryBeliefs) and 1.0 in world.persistence:
        raise InputError(
            f'{source.at(("world", "persistence"))}: beliefs of kind "stationary" need numbers below 1, got 1: regimes that '
            "never change have no long-run law"
        )
    if not isinstance(world, GivenWorld):
        return
    if not isinstance(study.beliefs, GridBeliefs) and world.transition is None:
        raise InputError(
            f'{source.at(("beliefs", "kind"))}: beliefs of kind "{study.beliefs.kind}" need the key transition in '
            "[world], expected its matrix"
        )
    with source.saying(("world",)):
        regimes = given_world(world)
    # A network is checked where the file is looked for, a problem of a user's own where it is imported.
    if getattr(study.problem, "network", None) is not None or hasattr(study.problem, "extension"):
        return
    for choice in variants(study.problem):
        assert choice.data is not None
        with source.saying(("problem",)), suppress(ModelError):  # contradictory limits are reported by the rows
            problem_of(choice.data, regimes)


def _check_listed_once(study: StudyFile, source: StudySource) -> None:
    """Raise `InputError` for a decision maker or an observer with equal options that is listed twice."""
    for key in _BY_NAME:
        listed = list(getattr(study, key))
        for number, each in enumerate(listed):
            if each in listed[:number]:
                name = getattr(each, "name", each)
                raise InputError(f'{source.at((key, number))}: "{name}" is listed twice with the same options')


def _check_followed(study: StudyFile, source: StudySource) -> None:
    """Raise `InputError` for rules and observers that need a chain of beliefs, or observed returns, without these."""
    for number, maker in enumerate(study.decision_makers):
        if isinstance(maker, WithMemory) and not isinstance(study.beliefs, StationaryBeliefs):
            raise InputError(
                f'{source.at(("decision_makers", number))}: the rule "{maker.name}" needs beliefs that move; expected '
                f'[beliefs] of kind "stationary", got "{study.beliefs.kind}"'
            )
    for number, each in enumerate(study.adversaries):
        if not isinstance(each, SequentialObserver):
            continue
        if not isinstance(study.beliefs, StationaryBeliefs):
            raise InputError(
                f'{source.at(("adversaries", number))}: the observer "sequential" follows beliefs that move; expected '
                f'[beliefs] of kind "stationary", got "{study.beliefs.kind}"'
            )
        reads = [one for one in each.public or () if one not in (NOTHING, ALL)]
        if reads and "categorical" in getattr(study.world, "sensor", ()):
            raise InputError(
                f"{source.at(('adversaries', number, 'public'))}: {reads[0]!r} is a return, which a world of "
                'sensor = "categorical" does not report; expected sensor = "gaussian" in [world], or a fitted or given one'
            )


def _check_size(study: StudyFile, source: StudySource) -> None:
    """Refuse sizes that fit into no memory, and more tasks than any machine can do."""
    demand = too_large(study)
    if demand is not None:
        raise InputError(f"{source.at(demand.place)}: {demand.refusal()}")
    many = too_many(study, prod(StudyGrid(study).shape))
    if many is not None:
        raise InputError(f"{source.at(('repeats',))}: {many}")
