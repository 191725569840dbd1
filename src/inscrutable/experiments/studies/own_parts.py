"""The layout of a study file that may name extensions, made of their plain data; they are imported where a task is done."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache, partial
from typing import Annotated, Any, ClassVar, Literal, Union, get_args

import numpy as np
from pydantic import BeforeValidator, Field, create_model

from inscrutable.adversaries.consistent_sets import consistent_sets
from inscrutable.budgets import Budget
from inscrutable.errors import InputError
from inscrutable.experiments.makers import MAKERS, CounterAdversarial, Goal, MakerSection, Probabilistic, Takes
from inscrutable.experiments.measures import MEASURES, Measure
from inscrutable.experiments.observers import OBSERVERS, Observed, ObserverSection
from inscrutable.experiments.rivals import markowitz_unless_told
from inscrutable.experiments.sections import Grid, Matrix, Section, Several
from inscrutable.experiments.setting import Seed, Setting
from inscrutable.experiments.studies import layout
from inscrutable.experiments.studies.extensions import (
    EMISSION,
    MAKER,
    MEASURE,
    OBSERVER,
    PROBLEM,
    Extension,
    loaded,
)
from inscrutable.experiments.studies.own_calls import own_number, own_part
from inscrutable.experiments.studies.tables import fixed_columns
from inscrutable.privacy import PrivacyMeasure

_SCALAR: Any = bool | int | float | str
_create: Any = create_model  # the type is known at run time alone
_several: Any = Several
_grid: Any = Grid
_annotated: Any = Annotated
_literal: Any = Literal
_union: Any = Union


class OwnMaker(MakerSection):
    """A user-defined decision maker."""

    takes = Takes.EACH
    extension: ClassVar[Extension]

    @classmethod
    def takes_budget(cls, chosen: Mapping[str, Any]) -> bool:
        """Whether it asks for a budget."""
        return "budget" in cls.extension.given

    @classmethod
    def make(cls, setting: Setting, chosen: Mapping[str, Any], amount: Any, seed: Seed) -> Any:
        """Return it."""
        rng = seed() if "rng" in cls.extension.given else None
        budget = amount if isinstance(amount, Budget) else None
        given = {"problem": setting.problem, "budget": budget, "prior": setting.prior, "candidates": setting.candidates}
        return own_part(cls.extension, given | {"rng": rng}, chosen)


class OwnObserver(ObserverSection):
    """A user-defined observer."""

    extension: ClassVar[Extension]

    @classmethod
    def adversary(cls, observed: Observed, chosen: Mapping[str, Any]) -> Any:
        """Return it."""
        setting, played = observed.setting, observed.behaviour.mechanism
        given = {"problem": setting.problem, "prior": setting.prior, "mechanism": played, "regret": observed.asked}
        return own_part(cls.extension, given, chosen)


class OwnProblem(Section):
    """A user-defined decision problem."""

    extension: ClassVar[Extension]


class OwnWorld(Section):
    """A hidden Markov model with a user-defined observation model."""

    extension: ClassVar[Extension]
    transition: Matrix

    @property
    def regimes(self) -> tuple[int]:
        """The number of states."""
        return (len(self.transition),)


def _keys(extension: Extension) -> dict[str, Any]:
    """Return the keys of an extension: a number, a text or a boolean may be a list to sweep, any other value may not."""
    found: dict[str, Any] = dict.fromkeys(extension.needed, (Any, ...))
    for name, default in extension.defaults.items():
        found[name] = (Any, None) if default is None else (_grid[_SCALAR], (default,))
    return found


def _section(extension: Extension, base: type[Section], tag: str) -> Any:
    made: Any = _create(
        f"Own_{extension.name}",
        __base__=base,
        __doc__=extension.meaning or base.__doc__,
        **{tag: (_literal[extension.name], ...)},
        **_keys(extension),
    )
    made.extension = extension
    return made


def _own_measure(extension: Extension) -> Measure:
    said = f"{extension.name}: {extension.meaning or 'a measure of your own'}"
    return Measure(extension.name, said, lambda observed: _measured(extension, observed), extension.sign)


def _measured(extension: Extension, observed: Observed) -> float:
    """Return the mean of a privacy measure over beliefs and decisions, or the value of a function of the mechanism."""
    thing = loaded(extension)
    problem, played = observed.setting.problem, observed.behaviour.mechanism
    if not isinstance(thing, PrivacyMeasure) and not isinstance(thing, type):
        given = {"mechanism": played, "prior": observed.setting.prior, "problem": problem}
        return own_number(extension, given)
    measure = _goal(extension)
    joint = observed.joint
    shown = np.flatnonzero(joint.played > 0)
    sets = consistent_sets(problem, problem.check_actions(np.asarray(played.actions)[shown]))
    place = np.zeros(joint.n_actions, dtype=np.intp)
    place[shown] = np.arange(len(shown))
    values = [measure(joint.beliefs[b], sets[int(place[m])]) for b, m in zip(joint.row, joint.column, strict=True)]
    return float(joint.mass @ np.array(values))


def _hiding(kind: type[CounterAdversarial | Probabilistic], own: Mapping[str, Extension]) -> Any:
    """Return a decision maker's section that may also maximise user-defined privacy measures."""
    made: Any = _create(
        kind.__name__,
        __base__=kind,
        __doc__=kind.__doc__,
        goal=(_grid[_literal[(*get_args(Goal), *own)]], kind.model_fields["goal"].default),
    )
    made.own = {name: partial(_goal, each) for name, each in own.items()}
    return made


def _goal(extension: Extension) -> PrivacyMeasure:
    found: PrivacyMeasure = own_part(extension, {}, {})
    return found


def _refuse_taken(by_kind: Mapping[str, Mapping[str, Extension]]) -> None:
    """Raise `InputError` for an extension whose name is taken."""
    columns = fixed_columns()
    taken: Mapping[str, Any] = {
        MEASURE: (*MEASURES, *columns),
        MAKER: MAKERS,
        OBSERVER: OBSERVERS,
        PROBLEM: ("markowitz", "dispatch"),
    }
    for kind, known in taken.items():
        for name in by_kind.get(kind, {}):
            if name in known:
                what = "column of the rows" if name in columns else kind
                raise InputError(
                    f"the extension {by_kind[kind][name].spec} has the name of a {what} that is there already"
                )


@lru_cache(maxsize=8)
def _layout_of(extensions: tuple[Extension, ...]) -> Any:
    by_kind: dict[str, dict[str, Extension]] = {}
    for each in extensions:
        by_kind.setdefault(each.kind, {})[each.name] = each
    _refuse_taken(by_kind)
    makers = {name: _section(each, OwnMaker, "name") for name, each in by_kind.get(MAKER, {}).items()}
    observers = {name: _section(each, OwnObserver, "name") for name, each in by_kind.get(OBSERVER, {}).items()}
    problems = {name: _section(each, OwnProblem, "kind") for name, each in by_kind.get(PROBLEM, {}).items()}
    worlds = {name: _section(each, OwnWorld, "kind") for name, each in by_kind.get(EMISSION, {}).items()}
    measures = {name: _own_measure(each) for name, each in by_kind.get(MEASURE, {}).items()}
    fields = layout.StudyFile.model_fields
    goals = {name: each for name, each in by_kind.get(MEASURE, {}).items() if each.sign}
    if goals:
        makers |= {"CDM": _hiding(CounterAdversarial, goals), "PDM": _hiding(Probabilistic, goals)}
    there = tuple(
        each
        for each in get_args(layout.MakerSection)
        if not (goals and issubclass(each, (CounterAdversarial, Probabilistic)))
    )
    maker = _named(there, makers)
    observer = _named(get_args(layout.ObserverSection), observers)
    names = _literal[(*MEASURES, *measures)]
    made: Any = _create(
        "StudyFile",
        __base__=layout.StudyFile,
        __doc__=layout.StudyFile.__doc__,
        world=(
            _annotated[
                _any_of((layout.GivenWorld, layout.RandomWorld, layout.FittedWorldSection), worlds), _by("kind")
            ],
            ...,
        ),
        problem=(
            _annotated[
                _annotated[_any_of((layout.MarkowitzSection, layout.DispatchSection), problems), _by("kind")],
                BeforeValidator(markowitz_unless_told),
            ],
            fields["problem"].default,
        ),
        decision_makers=(_several[maker], ...),
        adversaries=(_several[observer], fields["adversaries"].default),
        measures=(_grid[names], fields["measures"].default),
    )
    made.maker_kinds, made.observer_kinds, made.measure_kinds = (
        {**MAKERS, **makers},
        {**OBSERVERS, **observers},
        {**MEASURES, **measures},
    )
    made.extensions = extensions
    return made


def _by(key: str) -> Any:
    return Field(discriminator=key)


def _any_of(known: tuple[Any, ...], own: Mapping[str, Any]) -> Any:
    return _union[(*known, *own.values())]  # of as many as there are


def _named(known: tuple[Any, ...], own: Mapping[str, Any]) -> Any:
    return _annotated[
        _annotated[_any_of(known, own), _by("name")],
        BeforeValidator(layout.named),
    ]


def layout_with(extensions: tuple[Extension, ...]) -> type[layout.StudyFile]:
    """Return the layout of a grid's file that may name these extensions; the plain one without any."""
    if not extensions:
        return layout.StudyFile
    found: type[layout.StudyFile] = _layout_of(extensions)
    return found
