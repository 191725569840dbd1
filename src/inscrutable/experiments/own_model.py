"""A user-written model in one TOML file: risk aversion, budget, limits on weights, and optionally regimes."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field, ValidationError

from inscrutable.budgets import Budget, SilenceShare, written_budget
from inscrutable.datasets import read_labelled_matrix
from inscrutable.decision_makers.candidate_sources import is_simplex
from inscrutable.errors import InputError
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.experiments.model_file import Stack, Vector
from inscrutable.experiments.sections import (
    Label,
    Matrix,
    NonNegative,
    Positive,
    Section,
    expected,
    mistakes,
    shortened,
)
from inscrutable.experiments.silence import budget_in
from inscrutable.experiments.toml_lines import Place, TomlSource, nearest, read_toml
from inscrutable.experiments.weight_limits import LimitsPart
from inscrutable.problems import MarkowitzProblem, Polyhedron
from inscrutable.worlds import GaussianEmission, HiddenMarkovModel

Names = Annotated[list[Label], Field(min_length=1)]
_FILES = {"means": "means_file", "covariances": "covariance_files"}
"""Keys of numbers, and those that name files of them."""


class InvestorPart(Section):
    """The investor's risk aversion and its budget for privacy."""

    risk_aversion: Positive | None = Field(
        default=None, description="γ of γu'Σu − μ'u, without a half; 5 for a backtest"
    )
    budget: str | float | None = Field(
        default=None, description='as on the command line: 0.1, "10%", "5bp", "regret:0.002"; a tenth of |c*|'
    )
    cost_bps: NonNegative | None = Field(default=None, description="cost per unit traded, in basis points; 10")


class RegimesPart(Section):
    """User-defined regimes instead of fitted ones: transition, means and covariances, per row of the returns."""

    names: Names = Field(description="of the regimes, in the order of a belief's entries")
    assets: list[Label] | None = Field(
        default=None, description="in the order of the columns; needed without `means_file`"
    )
    transition: Matrix = Field(description="probability of each regime in the next row, one row per regime")
    initial: Vector | None = Field(
        default=None,
        description="probability of each regime in the first row, before its returns are seen; the long run's",
    )
    means: Matrix | None = Field(default=None, description="mean simple returns as fractions: regimes by assets")
    means_file: str | None = Field(
        default=None, description="the same as a CSV: regimes in the first column, assets in the header"
    )
    covariances: Stack | None = Field(default=None, description="covariance matrices of the returns, one per regime")
    covariance_files: list[str] | None = Field(
        default=None, description="the same as CSVs, one per regime, assets in the first column and in the header"
    )

    def world(self, folder: Path) -> HiddenMarkovModel:
        """Return the hidden Markov model; files lie in `folder`.

        Raises:
            InputError: Means or covariances are given twice or are missing, or sizes or labels disagree.
            ModelError: A matrix has no meaning as such.
        """
        for key, file in _FILES.items():
            if (getattr(self, key) is None) == (getattr(self, file) is None):
                raise InputError(f"give one of {key} and {file}")
        names, assets = tuple(self.names), None if self.assets is None else tuple(self.assets)
        if self.means_file is not None:
            table = read_labelled_matrix(folder / self.means_file, rows=names, columns=assets)
            values, assets = table.to_numpy(), tuple(table.columns)
        else:
            if assets is None:
                raise InputError("assets is missing: the names of the columns of means")
            values = _matrix(self.means, "means", (len(names), len(assets)))
        if self.covariance_files is not None:
            if len(self.covariance_files) != len(names):
                raise InputError(
                    f"covariance_files has {len(self.covariance_files)} files, expected {len(names)}: one per regime"
                )
            found = [read_labelled_matrix(folder / each, rows=assets, columns=assets) for each in self.covariance_files]
            covariances = np.array([each.to_numpy() for each in found])
        else:
            covariances = _matrix(self.covariances, "covariances", (len(names), len(assets), len(assets)))
        means = pd.DataFrame(values, index=list(names), columns=list(assets))
        if np.any(values < -1.0):
            row, column = (int(place) for place in np.argwhere(values < -1.0)[0])
            raise InputError(
                f"the mean return of {assets[column]} in {names[row]} is {values[row, column]:g}, a loss of more than "
                "everything; expected simple returns as fractions, .01 for one per cent: divide percentages by 100, "
                "covariances by 10,000"
            )
        emission = GaussianEmission(means, covariances)
        return HiddenMarkovModel(self.transition, emission, self.initial, names=names)


def _matrix(values: Any, what: str, shape: tuple[int, ...]) -> Any:
    try:
        found = np.array(values, dtype=np.float64)
    except ValueError:
        raise InputError(f"{what} has rows of different lengths, expected the shape {shape}") from None
    if found.shape != shape:
        raise InputError(f"{what} has shape {found.shape}, expected {shape}: regimes, then assets")
    return found


class OwnModelFile(Section):
    """The whole file; every section may be left out."""

    note: str = Field(default="", description="one line on where the model comes from")
    investor: InvestorPart = Field(default=InvestorPart())
    constraints: LimitsPart = Field(default=LimitsPart())
    regimes: RegimesPart | None = None


@dataclass(frozen=True, eq=False)
class OwnModel:
    """A model file with its content, checked as far as possible without returns.

    Args:
        file: Content of the file.
        source: The file with the line of each key.
        folder: Folder of the files that it names.
        world: The regimes' world; None where a backtest fits them.
    """

    file: OwnModelFile
    source: TomlSource
    folder: Path
    world: HiddenMarkovModel | None

    @classmethod
    def of_limits(cls, limits: LimitsPart) -> OwnModel:
        """Return a model that has only limits."""
        return cls(OwnModelFile(constraints=limits), TomlSource("options"), Path(), None)

    @classmethod
    def load(cls, path: Path) -> OwnModel:
        """Return the model of a TOML file.

        Raises:
            InputError: The file cannot be read, a key is unknown or missing, or a value is invalid; the message names line and
                key.
            ModelError: A matrix has no meaning as such.
        """
        data, source = read_toml(path, "model")
        try:
            file = OwnModelFile.model_validate(data)
        except ValidationError as error:
            first, *others = mistakes(error, data)
            more = f" (and {len(others)} more {'mistakes' if len(others) > 1 else 'mistake'})" if others else ""
            raise InputError(_said(first, source) + more) from None
        with source.saying(("investor", "budget")):
            budget_of(file.investor)
        with source.saying(("regimes",)):
            world = None if file.regimes is None else file.regimes.world(path.parent)
        return cls(file, source, path.parent, world)

    @property
    def files(self) -> list[Path]:
        """The files that the model names."""
        sectors, regimes = self.file.constraints.sectors, self.file.regimes
        named = [sectors] if isinstance(sectors, str) else []
        if regimes is not None:
            named += [each for each in (regimes.means_file, *(regimes.covariance_files or ())) if each is not None]
        return [self.folder / each for each in named]

    def region(self, assets: tuple[str, ...]) -> Polyhedron | None:
        """Return the feasible set of weights of assets; None where the file has no limits."""
        if self.file.constraints.is_empty:
            return None

        def saying(key: str) -> AbstractContextManager[None]:
            place = ("constraints", key)
            return self.source.saying(place) if place in self.source.lines else nullcontext()  # options have no line

        return self.file.constraints.region(assets, self.folder, saying)

    def limits(self, assets: tuple[str, ...]) -> LimitsPart:
        """Return the limits on weights of assets but that on turnover, without names of files."""
        return self.file.constraints.model_copy(update={"turnover": None}).resolved(assets, self.folder)

    def with_limits(self, limits: LimitsPart) -> OwnModel:
        """Return the model with limits that replace those of the file."""
        replaced = {("constraints", key) for key in limits.model_dump(exclude_none=True)}
        left = {place: line for place, line in self.source.lines.items() if place[:2] not in replaced}
        file = self.file.model_copy(update={"constraints": limits.over(self.file.constraints)})
        return replace(self, file=file, source=replace(self.source, lines=left))

    def investor(self, limits: LimitsPart | None = None) -> InvestorModel:
        """Return the investor of a file with regimes; `limits` replace those of the file.

        Raises:
            InputError: The file has no regimes, or the limits name other assets.
            ModelError: No weights satisfy all limits.
        """
        if self.world is None:
            raise InputError(
                f"{self.source.name} has no section [regimes]: without returns to fit them to, a model needs the regimes' "
                "names, transition, means and covariances"
            )
        emission = self.world.emission
        assert isinstance(emission, GaussianEmission)
        assert emission.asset_names is not None
        assets, regimes = tuple(map(str, emission.asset_names)), tuple(map(str, self.world.names))
        told = self if limits is None else self.with_limits(limits)
        means = pd.DataFrame(emission.means, index=list(regimes), columns=list(assets))
        region = told.region(assets)
        with self.source.saying(("constraints",)):
            problem = MarkowitzProblem(means, emission.covariances, self.file.investor.risk_aversion or 5.0, region)
        turnover = told.file.constraints.turnover
        with self.source.saying(("investor", "budget")):
            budget = budget_in(self.world, problem, budget_of(self.file.investor) or Budget(0.1))
        made = InvestorModel(self.world, problem, assets, regimes, budget, self.file.note, turnover)
        return replace(made, limits=told.limits(assets))


def budget_of(part: InvestorPart) -> Budget | SilenceShare | None:
    """Return the budget of a section; None if it has none."""
    return None if part.budget is None else written_budget(part.budget)


def investor_of(path: Path, limits: LimitsPart | None = None) -> InvestorModel:
    """Return the investor of a backtest's model.json or of a model.toml; `limits` replace those of the file.

    Raises:
        InputError: The file is not a model, or the limits do not suit it.
        ModelError: No weights satisfy all limits.
    """
    if path.suffix.lower() == ".toml":
        return OwnModel.load(path).investor(limits)
    model = InvestorModel.load(path)
    return model if limits is None or limits.is_empty else _limited(model, limits, path)


def _limited(model: InvestorModel, limits: LimitsPart, path: Path) -> InvestorModel:
    """The model with some limits replaced."""
    problem, turnover = model.problem, model.turnover if limits.turnover is None else limits.turnover
    given = limits.model_copy(update={"turnover": None})
    if given.is_empty:
        return replace(model, turnover=turnover)
    held = model.limits or LimitsPart()
    if held.region(model.assets).names != problem.constraints.names:  # a problem of other limits
        if not is_simplex(problem):
            raise InputError(
                f"{path} does not name the limits of its feasible set, so that none of them can be replaced: give all limits "
                "in a model.toml, or repeat the backtest that wrote the file"
            )
        held = LimitsPart()
    known = given.over(held).resolved(model.assets)
    limited = MarkowitzProblem(problem.means, problem.covariances, problem.risk_aversion, known.region(model.assets))
    return replace(model, problem=limited, turnover=turnover, limits=known)


def _said(problem: Any, source: TomlSource) -> str:
    place: Place = problem["loc"]
    where = source.at(place)
    if problem["type"] == "extra_forbidden":
        known = _keys(place[:-1])
        return f"{where}: there is no such key{nearest(str(place[-1]), known)}; expected one of: {', '.join(known)}"
    if problem["type"] == "missing":
        return f"{source.at(place[:-1]) if place[:-1] else source.name}: the key {place[-1]} is missing"
    told = f"{where}: {expected(problem)}, got {shortened(problem['input'])}"
    is_text = problem["type"] == "list_type" and isinstance(problem["input"], str)
    file = _FILES.get(str(place[1])) if is_text else None
    return told if file is None else f"{told}; the key for a file is {file}"


def _keys(place: Place) -> list[str]:
    parts: dict[str, type[Section]] = {"investor": InvestorPart, "constraints": LimitsPart, "regimes": RegimesPart}
    return list(parts.get(str(place[0]) if place else "", OwnModelFile).model_fields)
