"""The kinds of study: the layout of each kind's file, its tasks, and their runner.

A file names its kind. It can name only these, so that a study file stays plain data.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from inscrutable.datasets.matpower import load_matpower
from inscrutable.errors import InputError, ModelError
from inscrutable.experiments.sections import PlanFile
from inscrutable.experiments.studies.alpha_tasks import ALPHAS
from inscrutable.experiments.studies.comparison_tasks import COMPARISON
from inscrutable.experiments.studies.extensions import Extension
from inscrutable.experiments.studies.grid import StudyGrid, variants
from inscrutable.experiments.studies.grid_tasks import GridRunner
from inscrutable.experiments.studies.kind import Kind
from inscrutable.experiments.studies.layout import DispatchSection, FittedWorldSection, GivenWorld, StudyFile
from inscrutable.experiments.studies.masked_tasks import MASKED_BASKET
from inscrutable.experiments.studies.own_parts import layout_with
from inscrutable.experiments.studies.reproduction_tasks import REPRODUCTION
from inscrutable.experiments.studies.tables import table_of
from inscrutable.experiments.studies.worlds import (
    fitted_world,
    given_world,
    hash_of_data,
    hash_of_network,
    plain_network,
    problem_of,
    training_of,
)


def _network(plan: StudyFile) -> str | None:
    """The file of a study's own network."""
    return plan.problem.network if isinstance(plan.problem, DispatchSection) else None


def _hash(plan: StudyFile, base: Path) -> str | None:
    own = _network(plan)
    if own is not None:
        return hash_of_network(own, base)
    return hash_of_data(plan.world, base) if isinstance(plan.world, FittedWorldSection) else None


def _check(plan: StudyFile, base: Path) -> None:
    if isinstance(plan.world, FittedWorldSection):
        for covariance in plan.world.covariance or (None,):
            training_of(plan.world, max(plan.world.regimes), covariance, base)
    own = _network(plan)
    if own is not None and isinstance(plan.world, GivenWorld) and isinstance(plan.problem, DispatchSection):
        network = load_matpower(base / own, convention=plan.problem.convention)
        for choice in variants(plan.problem):
            assert choice.data is not None
            with suppress(ModelError):  # contradictory limits are reported by the rows
                problem_of(choice.data, given_world(plan.world), network)


def _fitted(plan: StudyFile, base: Path, grid: StudyGrid) -> list[dict[str, Any]]:
    """Return the worlds or the network, read or fitted once and here, so that all machines work with the same digits."""
    own = _network(plan)
    if own is not None and isinstance(plan.problem, DispatchSection):
        return [plain_network(load_matpower(base / own, convention=plan.problem.convention))]
    if not isinstance(plan.world, FittedWorldSection):
        return []
    found = []
    for place, choice in enumerate(grid.worlds):
        assert choice.data is not None
        rng = grid.stream("fit", (place, 0, 0, 0, 0, 0, 0), ("world",))
        found.append(fitted_world(plan.world, choice.data, base, rng=rng))
    return found


GRID = Kind(StudyFile, StudyGrid, GridRunner, _hash, _fitted, table_of, _check)
"""Studies of every combination of the entries of a file's lists."""

OTHER_KINDS: Mapping[str, Kind] = {
    "reproduction": REPRODUCTION,
    "comparison": COMPARISON,
    "masked basket": MASKED_BASKET,
    "alphas": ALPHAS,
}
"""The values of the key `kind` of a file; a file without it is a grid."""


def kind_named(name: str | None) -> Kind:
    """Return a kind by its name in a file; None, for a file without a name, is a grid."""
    return OTHER_KINDS.get(name or "", GRID)


def layout_of_kind(name: str | None, extensions: tuple[Extension, ...]) -> type[PlanFile]:
    """Return the layout of a kind's file that may name these extensions.

    Raises:
        InputError: There are extensions and the kind is no grid, which alone can use them.
    """
    kind = kind_named(name)
    if not extensions:
        return kind.layout
    if kind is not GRID:
        raise InputError(f"a study of kind {name!r} has no place for extensions; expected a grid, which names no kind")
    return layout_with(extensions)


def kind_of(plan: PlanFile) -> Kind:
    """Return the kind of a study's file."""
    return kind_named(getattr(plan, "kind", None))
