"""A rival's decision problem as a section of a file: the agent's own, another portfolio, a finite choice or naming."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError

from inscrutable.errors import InputError, ModelError
from inscrutable.experiments.sections import EvenMatrix, Likely, Positive, Probability, Section, first_mistake
from inscrutable.experiments.setting import Setting
from inscrutable.experiments.toml_lines import read_toml
from inscrutable.privacy import Loss, NamingError, RivalProblem
from inscrutable.problems import (
    DecisionProblem,
    FiniteProblem,
    MarkowitzProblem,
    Polyhedron,
    max_weights,
    min_weights,
    simplex,
)


class OwnRival(Section):
    """The agent's own problem: a rival who would invest as the agent does."""

    kind: Literal["own"]


class MarkowitzRival(Section):
    """A portfolio of the same assets in the same regimes, with the rival's risk aversion and limits."""

    kind: Literal["markowitz"]
    risk_aversion: Positive = 5.0
    max_weight: Likely | None = None
    min_weight: Probability | None = None


class FiniteRival(Section):
    """A finite choice, such as a wager on the regime: one row of costs per regime."""

    kind: Literal["finite"]
    costs: EvenMatrix


class NamingRival(Section):
    """The name of the regime; a wrong name costs 1."""

    kind: Literal["naming"]


def markowitz_unless_told(value: Any) -> Any:
    """Return a section without a kind as a portfolio section."""
    return {"kind": "markowitz", **value} if isinstance(value, dict) else value


Rival = Annotated[
    Annotated[OwnRival | MarkowitzRival | FiniteRival | NamingRival, Field(discriminator="kind")],
    BeforeValidator(markowitz_unless_told),
]
RIVAL: TypeAdapter[Any] = TypeAdapter(Rival)


def read_rival(path: Path) -> Any:
    """Return the rival of a TOML file: the section `[problem]` as in a study file, or of a kind for rivals only.

    Raises:
        InputError: The file cannot be read, is not TOML, or holds anything else.
    """
    data, _ = read_toml(path, "rival")
    if set(data) != {"problem"}:
        raise InputError(f"{path} has the keys {sorted(data)}, expected the section [problem] alone")
    try:
        return RIVAL.validate_python(data["problem"])
    except ValidationError as error:
        raise InputError(f"{path}, section [problem]: {first_mistake(error, data['problem'])}") from None


def loss_of(rival: Any, problem: DecisionProblem) -> Loss:
    """Return a rival's loss, in the regimes of the agent's problem.

    Raises:
        InputError: Its costs are no table, the number of regimes differs, or it needs returns and the agent's problem has none.
        ModelError: No weights satisfy its limits.
    """
    try:
        return _loss_of(rival, problem)
    except (InputError, ModelError) as error:
        raise type(error)(f"rival: {error}") from None


def _loss_of(rival: Any, problem: DecisionProblem) -> Loss:
    if isinstance(rival, NamingRival):
        return NamingError()
    if isinstance(rival, OwnRival):
        return RivalProblem(problem)
    if isinstance(rival, FiniteRival):
        found = RivalProblem(FiniteProblem(rival.costs))
        found.rival(problem.n_states)
        return found
    if not isinstance(problem, MarkowitzProblem):
        raise InputError('a rival of kind "markowitz" needs an agent with a portfolio; expected own, finite or naming')
    limits = weight_limits(rival.model_dump(exclude_none=True), problem.n_actions)
    return RivalProblem(MarkowitzProblem(problem.means, problem.covariances, rival.risk_aversion, limits))


def is_own(loss: Loss | None, problem: DecisionProblem) -> bool:
    """Whether a rival has the agent's own problem; it can then always copy."""
    if not isinstance(loss, RivalProblem):
        return False
    other = loss.problem
    if other is problem:
        return True
    if not (isinstance(other, MarkowitzProblem) and isinstance(problem, MarkowitzProblem)):
        return False
    own = [_numbers(each) for each in (other, problem)]
    return all(
        first.shape == second.shape and np.array_equal(first, second) for first, second in zip(*own, strict=True)
    )


def _numbers(problem: MarkowitzProblem) -> list[Any]:
    region = problem.constraints.rows_in_full
    rows = np.column_stack([region.A_ub, region.b_ub])
    gamma = np.array([problem.risk_aversion])
    return [problem.means, problem.covariances, gamma, np.unique(rows, axis=0), region.A_eq, region.b_eq]


def wanting(setting: Setting, rival: Any) -> Setting:
    """Return a setting with a rival's problem; without a rival the setting itself."""
    return setting if rival is None else replace(setting, loss=loss_of(rival, setting.problem))


def weight_limits(section: Mapping[str, Any], assets: int) -> Polyhedron | None:
    """Return the feasible set of a portfolio with a largest or least weight; None where there is neither."""
    if "max_weight" not in section and "min_weight" not in section:
        return None
    region = simplex(assets)
    if "max_weight" in section:
        region = region & max_weights(assets, section["max_weight"])
    if "min_weight" in section:
        region = region & min_weights(assets, section["min_weight"])
    return region
