"""The schema of a saved investor model: its keys and their types, checked before anything is built."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from inscrutable.errors import InputError
from inscrutable.experiments.sections import Label, Matrix, Section, mistakes, shortened
from inscrutable.experiments.toml_lines import key_text
from inscrutable.experiments.weight_limits import LimitsPart

Vector = list[float]
Stack = list[list[list[float]]]


class CategoricalPart(Section):
    """A sensor with symbols."""

    type: Literal["categorical"]
    probabilities: Matrix


class GaussianPart(Section):
    """A sensor with real vectors."""

    type: Literal["gaussian"]
    means: Matrix
    covariances: Stack
    asset_names: list[Label] | None


class LinearPart(Section):
    """The public part of a sensor."""

    type: Literal["part"]
    matrix: Matrix
    names: list[Label] | None
    asset_names: list[Label] | None


class WorldPart(Section):
    """A hidden Markov model."""

    transition: Matrix
    initial: Vector
    names: list[Label]
    emission: CategoricalPart | GaussianPart = Field(discriminator="type")
    public: CategoricalPart | GaussianPart | LinearPart | None = None


class LimitPart(Section):
    """A limit on a sum of magnitudes."""

    weights: Matrix
    centers: Matrix
    most: float
    name: Label
    linear: Vector = Field(default_factory=list)


class ConstraintsPart(Section):
    """A feasible set."""

    A_ub: Matrix
    b_ub: Vector
    A_eq: Matrix
    b_eq: Vector
    names: list[Label]
    min_slack: float
    limits: list[LimitPart] = Field(default_factory=list)


class ProblemPart(Section):
    """A mean-variance portfolio."""

    type: Literal["markowitz"]
    means: Matrix
    covariances: Stack
    risk_aversion: float
    constraints: ConstraintsPart


class BudgetPart(Section):
    """A budget."""

    amount: float
    is_relative: bool


class ModelFile(Section):
    """The whole file."""

    format: str
    version: int
    note: str
    assets: list[Label]
    regimes: list[Label]
    budget: BudgetPart
    world: WorldPart
    problem: ProblemPart
    turnover: float | None = None
    step: str = ""
    reads: str = ""
    limits: LimitsPart | None = None


def checked(source: Path, data: dict[str, Any]) -> ModelFile:
    """Return the content of a file, or raise one `InputError` if a key is missing or has an invalid value."""
    try:
        return ModelFile.model_validate(data)
    except ValidationError as error:
        first, *more = mistakes(error, data)
        others = f" (and {len(more)} more)" if more else ""
        value = "" if first["type"] == "missing" else f", got {shortened(first['input'])}"
        raise InputError(f"{source}, key {key_text(first['loc'])}: {first['msg']}{value}{others}") from None
