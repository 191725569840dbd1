"""The tasks of a grid: every combination of its lists' entries, each with an identity and random streams of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import prod
from typing import Any

import numpy as np

from inscrutable.experiments.sections import Section
from inscrutable.experiments.studies.layout import (
    BudgetSection,
    DispatchSection,
    FittedWorldSection,
    GivenWorld,
    RandomWorld,
    StudyFile,
)
from inscrutable.experiments.studies.tasks import Task, canonical, child_seed, identity

PER_MARKET = ("world", "problem", "beliefs", "candidates", "repeat")
"""The parts that tasks on the same market with the same candidates have in common."""


@dataclass(frozen=True)
class Variant:
    """One choice in one part of a study, and its canonical text."""

    data: dict[str, Any] | None
    text: str

    @classmethod
    def of(cls, data: dict[str, Any] | None) -> Variant:
        """Return the variant of plain data; None means that nothing is chosen."""
        return cls(data, canonical(data))


class StudyGrid:
    """All tasks of a study, in order: markets outermost, then decision makers with budgets, then adversaries.

    Args:
        study: The study.
        data_hash: Hash of the data that its world is fitted to, or None.
    """

    def __init__(self, study: StudyFile, data_hash: str | None = None) -> None:
        self.study = study
        self.problems = _problems(study, data_hash)
        self.worlds = _worlds(study, data_hash, self.problems)
        self.beliefs = variants(study.beliefs)
        self.candidates = variants(study.candidates)
        budgets, nothing = _budgets(study.budgets), Variant.of(None)
        makers = [(maker, maker.data or {}) for maker in _joined(study.decision_makers)]
        self.plays = [
            (maker, budget)
            for maker, chosen in makers
            for budget in (budgets if study.maker_kinds[chosen["name"]].takes_budget(chosen) else (nothing,))
        ]
        self.adversaries = _joined(study.adversaries)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Numbers of choices, outermost part first."""
        return (
            len(self.worlds),
            len(self.problems),
            len(self.beliefs),
            len(self.candidates),
            self.study.repeats,
            len(self.plays),
            len(self.adversaries),
        )

    def __len__(self) -> int:
        return prod(self.shape)

    def task(self, number: int) -> Task:
        """Return a task by its place in the order of the grid."""
        places = tuple(int(place) for place in np.unravel_index(number, self.shape))
        return Task(number, places, joined_text(self.parts(places)))

    def task_seed(self, task: Task) -> np.random.SeedSequence:
        """Return the child seed of a task, which follows from its identity."""
        return self.seed(task.text)

    def parts(self, places: Sequence[int]) -> dict[str, str]:
        """Return the canonical text of each part of a task, by name."""
        maker, budget = self.plays[places[5]]
        # Without a rival, tasks have the same identities as before there were rivals.
        rival = {} if self.study.rival is None else {"rival": canonical(self.study.rival.model_dump(exclude_none=True))}
        return {
            "adversary": self.adversaries[places[6]].text,
            "beliefs": self.beliefs[places[2]].text,
            "budget": budget.text,
            "candidates": self.candidates[places[3]].text,
            "decision_maker": maker.text,
            "problem": self.problems[places[1]].text,
            "repeat": str(places[4]),
            **rival,
            "world": self.worlds[places[0]].text,
        }

    def seed(self, text: str) -> np.random.SeedSequence:
        """Return the child seed that belongs to a text."""
        return child_seed(self.study.seed, text)

    def stream(self, use: str, places: Sequence[int], parts: Sequence[str]) -> np.random.Generator:
        """Return the random stream for one use, which depends on some parts of a task and on no other."""
        texts = self.parts(places)
        chosen = {name: texts[name] for name in sorted(parts)}
        return np.random.default_rng(self.seed(joined_text({**chosen, "use": canonical(use)})))


def joined_text(parts: Mapping[str, str]) -> str:
    """Return the canonical text of a mapping from the texts of its values; the keys are in order."""
    return "{" + ",".join(f'"{name}":{text}' for name, text in parts.items()) + "}"


def variants(section: Section) -> list[Variant]:
    """Return every combination of the entries of a section's lists."""
    gridded = {name: value for name, value in section if isinstance(value, tuple) and name not in _FIXED}
    fixed = {name: _plain(value) for name, value in section if name not in gridded and value is not None}
    found = [fixed | dict(zip(gridded, choice, strict=True)) for choice in product(*gridded.values())]
    for each in found:
        if each.get("method") in ("global", "candidates"):
            each.pop("starts", None)
    return list({canonical(each): Variant.of(each) for each in found}.values())


_FIXED = ("wind_buses", "wind_capacities", "means", "volatilities")  # lists that are one value


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _joined(sections: Sequence[Section]) -> list[Variant]:
    found = [variant for section in sections for variant in variants(section)]
    return list({each.text: each for each in found}.values())


def _budgets(section: BudgetSection) -> list[Variant]:
    return [Variant.of({"amount": amount, "unit": section.unit, "hold": section.hold}) for amount in section.values]


def _problems(study: StudyFile, data_hash: str | None) -> list[Variant]:
    """Return the problems; a network from a file is named by the hash of the file."""
    found = variants(study.problem)
    if not isinstance(study.problem, DispatchSection):
        return found
    if study.problem.network is None:  # as tasks were before there were others
        plain = [{key: value for key, value in (each.data or {}).items() if key != "convention"} for each in found]
        return [Variant.of(each) for each in plain]
    return [Variant.of({**(each.data or {}), "sha256": data_hash}) for each in found]


def _worlds(study: StudyFile, data_hash: str | None, problems: Sequence[Variant]) -> list[Variant]:
    """Return the worlds; large tables of numbers are named by a hash, so that rows stay short.

    Random markets are drawn for the least of several risk aversions, which rejects the most, so that all have the same.
    """
    world = study.world
    if isinstance(world, GivenWorld):
        data = world.model_dump(mode="json")
        return [Variant.of({"kind": "given", "sha256": identity(canonical(data))})]
    found = variants(world)
    if isinstance(world, FittedWorldSection):
        found = [Variant.of({**(each.data or {}), "sha256": data_hash}) for each in found]
    if isinstance(world, RandomWorld):
        averse = {each.data["risk_aversion"] for each in problems if each.data and "risk_aversion" in each.data}
        least = {"risk_aversion": min(averse)} if len(averse) > 1 else {}
        found = [Variant.of({**(each.data or {}), **least}) for each in found]
    return found
