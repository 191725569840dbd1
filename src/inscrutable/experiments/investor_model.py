"""The investor's world, decision problem and budget as one JSON file, which a backtest writes and other commands read.

Floats are written in full, so a loaded model gives the same digits; nothing in the file is ever executed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.axes import Axis, as_texts
from inscrutable.budgets import Budget
from inscrutable.datasets import write_json
from inscrutable.errors import InputError, InscrutableError
from inscrutable.experiments.performance import frequency_of
from inscrutable.files import path_of, read_json
from inscrutable.filtering import filter_beliefs
from inscrutable.problems import MarkowitzProblem, Polyhedron, turnover
from inscrutable.problems.magnitudes import MagnitudeRegion
from inscrutable.problems.segments import MagnitudeLimit
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, GaussianEmission, HiddenMarkovModel
from inscrutable.worlds.hidden_markov import default_names

if TYPE_CHECKING:
    import pandas as pd

    from inscrutable.experiments.model_file import ModelFile, ProblemPart
    from inscrutable.experiments.weight_limits import LimitsPart

FORMAT = "inscrutable investor model"
VERSION = 1
BASIS_POINTS = 10_000.0  # costs are returns on wealth a row


@dataclass(frozen=True, eq=False)
class InvestorModel:
    """A model of an investor: its hidden Markov model, its portfolio problem and its budget.

    Args:
        world: The hidden Markov model of X regimes behind the returns. Names of its states, if any, are the regimes; labels of
            its sensor, if any, are the assets, in any order.
        problem: The portfolio problem, X regimes and U assets.
        assets: U different labels, in the order of the weights.
        regimes: X different labels, in the order of a belief's entries.
        budget: The default budget of regret for privacy.
        note: One line on the source of the model.
        turnover: Largest sum of purchases and sales relative to the last published weights; None: no limit. `problem` does not
            include it.
        step: Time between two rows of returns, such as "month"; empty where not known. Returns of another step are refused.
        reads: What the beliefs rest on besides the returns, such as the name of a public number; empty for nothing.
        limits: Limits on weights that `problem` was made with, so that each can be replaced; None where they are not known.
        unlimited: The problem without the limit on turnover that `problem` includes for one decision, by `after`; else None.

    Raises:
        InputError: The numbers or names of regimes or assets disagree, or a label is duplicated.

    Cost: none. Source: the paper's Section V, fitted to data.

    Example:
        >>> import numpy as np
        >>> from inscrutable.worlds import GaussianEmission, HiddenMarkovModel
        >>> means, spreads = [[0.02, 0.01], [-0.03, 0.0]], [0.01 * np.eye(2), 0.04 * np.eye(2)]
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], GaussianEmission(means, spreads))
        >>> model = InvestorModel(world, MarkowitzProblem(means, spreads, 5.0), ("A", "B"), world.names)
        >>> model.budget
        Budget(amount=0.1, is_relative=True)
    """

    world: HiddenMarkovModel
    problem: MarkowitzProblem
    assets: tuple[str, ...]
    regimes: tuple[str, ...]
    budget: Budget = Budget(0.1)  # noqa: RUF009  # frozen
    note: str = ""
    turnover: float | None = None
    step: str = ""
    reads: str = ""
    limits: LimitsPart | None = None
    unlimited: MarkowitzProblem | None = None

    def __repr__(self) -> str:
        told = f"; {self.note}" if self.note else ""
        return (
            f"investor in {len(self.assets)} assets under regimes {', '.join(self.regimes)}, budget {self.budget}{told}"
        )

    def __post_init__(self) -> None:
        if not isinstance(self.world, HiddenMarkovModel):
            raise InputError(f"world must be a HiddenMarkovModel, got {self.world!r}")
        if not isinstance(self.problem, MarkowitzProblem):
            raise InputError(f"problem must be a MarkowitzProblem, got {self.problem!r}")
        object.__setattr__(self, "assets", _labels(self.assets, "assets", self.problem.n_actions))
        object.__setattr__(self, "regimes", _labels(self.regimes, "regimes", self.problem.n_states))
        if self.world.n_states != self.problem.n_states:
            raise InputError(f"the world has {self.world.n_states} regimes, the problem {self.problem.n_states}")
        _check_names(self.world, self.problem, self.assets, self.regimes)
        if not isinstance(self.budget, Budget):
            raise InputError(f"budget must be a Budget such as Budget.relative(0.1), got {self.budget!r}")
        if self.turnover is not None:
            object.__setattr__(self, "turnover", validation.non_negative(self.turnover, "turnover"))

    @property
    def net(self) -> float | None:
        """The sum of the weights of every portfolio; None where the feasible set does not fix it."""
        region = self.problem.constraints
        share = np.linalg.lstsq(region.A_eq.T, np.ones(len(self.assets)), rcond=None)[0]
        fixed = np.allclose(share @ region.A_eq, 1.0, rtol=0.0, atol=tolerances.FEASIBILITY)
        return round(float(share @ region.b_eq), _NET_DIGITS) if fixed else None

    def problem_after(self, previous: ArrayLike | None) -> MarkowitzProblem:
        """Return the problem where `previous` were the last published weights, (U,) or labelled; None where there were none."""
        if self.turnover is None or previous is None:
            return self.problem
        problem = self.problem
        return MarkowitzProblem(problem.means, problem.covariances, problem.risk_aversion, self.region_after(previous))

    def region_after(self, previous: ArrayLike | None) -> Polyhedron:
        """Return the feasible weights of that problem."""
        region = self.problem.constraints
        if self.turnover is None or previous is None:
            return region
        return region & turnover(previous, self.turnover, assets=self.assets, min_slack=region.min_slack)

    def after(self, previous: ArrayLike | None) -> InvestorModel:
        """Return the investor at the decision after `previous`, with the limit on turnover as part of the problem.

        Raises:
            InputError: Turnover is limited and `previous` is missing, or the other way round.
            ModelError: No feasible weights are within the limit on turnover.
        """
        if self.turnover is not None and previous is None:
            raise InputError(
                "the weights published last are missing, from which a limited turnover counts: give them (--previous)"
            )
        if previous is None:
            return self
        if self.turnover is None:
            raise InputError(
                "turnover is not limited, and the weights published last matter only where it is: limit it (--turnover), or "
                "leave them out (--previous)"
            )
        return replace(self, problem=self.problem_after(previous), turnover=None, unlimited=self.problem)

    def belief_after(self, returns: pd.DataFrame) -> Array:
        """Return the filter's belief (X,) about the row after returns (T,U), with one column per asset in any order.

        Raises:
            InputError: Columns are not the assets, a number is missing, or dates have another step than the model.
        """
        return self._predicted(self.world, returns)

    def start_counts(self, returns: pd.DataFrame) -> float:
        """Return the largest effect of the belief before the first row on a regime's probability after returns (T,U).

        Each regime is taken for certain at that row in turn. Errors are those of `belief_after`.
        """
        world = self.world
        ends = [
            self._predicted(HiddenMarkovModel(world.transition, world.emission, each, names=world.names), returns)
            for each in np.eye(len(self.regimes))
        ]
        return float(np.ptp(ends, axis=0).max())

    def _predicted(self, world: HiddenMarkovModel, returns: pd.DataFrame) -> Array:
        word = step_of(returns.index)
        if self.step and word and word != self.step:
            raise InputError(
                f"returns have one row a {word}, the model one a {self.step}: give returns of the model's step"
            )
        named = returns.set_axis(as_texts(returns.columns, self.assets), axis=1)
        places = Axis("asset", self.assets).order(tuple(named.columns), "returns")
        rows = named if places is None else named.iloc[:, places]
        known = isinstance(world.emission, GaussianEmission) and world.emission.asset_names is not None
        return np.asarray(np.asarray(filter_beliefs(world, rows if known else rows.to_numpy()).predicted)[-1])

    def summary(self) -> str:
        """Return two lines for a person to read."""
        size = f"{len(self.regimes)} regimes ({', '.join(self.regimes)}), {len(self.assets)} assets"
        return f"{size}, risk aversion {self.problem.risk_aversion:g}, budget {self.budget}\n{self.note}".rstrip()

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the model as JSON, atomically, every float in full.

        Raises:
            InputError: The file cannot be written, or the world has a user-defined sensor.
        """
        if not isinstance(self.world.emission, (CategoricalEmission, GaussianEmission)):
            raise InputError(f"a {type(self.world.emission).__name__} cannot be saved; only this library's sensors can")
        data = {
            "format": FORMAT,
            "version": VERSION,
            "note": self.note,
            "assets": list(self.assets),
            "regimes": list(self.regimes),
            "budget": {"amount": self.budget.amount, "is_relative": self.budget.is_relative},
            "world": self.world.to_dict(),
            "problem": problem_data(self.problem),
        } | {
            **({} if self.turnover is None else {"turnover": self.turnover}),
            **({"step": self.step} if self.step else {}),
            **({"reads": self.reads} if self.reads else {}),
            **({} if self.limits is None else {"limits": self.limits.model_dump(exclude_none=True)}),
        }
        write_json(data, path)
        return Path(path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> InvestorModel:
        """Return the model in a file written by `save`.

        Raises:
            InputError: The file cannot be read, is not a saved model or has a later version; or a key is missing, unknown, or
                has a value of the wrong type or shape. The message names file and key.
            ModelError: The numbers have the right shape but are invalid, such as an indefinite covariance.
        """
        from inscrutable.experiments.model_file import checked

        source = path_of(path, "a model's file")
        return _built(source, checked(source, _read(source)))


def problem_data(problem: MarkowitzProblem) -> dict[str, Any]:
    """Return a portfolio problem as plain data with arrays."""
    whole = problem.constraints
    limits = whole.limits if isinstance(whole, MagnitudeRegion) else ()
    region = whole.rows if isinstance(whole, MagnitudeRegion) else whole
    given = [{**each._asdict(), "linear": np.broadcast_to(each.linear, region.n_actions)} for each in limits]
    return {
        "type": "markowitz",
        "means": problem.means,
        "covariances": problem.covariances,
        "risk_aversion": problem.risk_aversion,
        "constraints": {
            "A_ub": region.A_ub,
            "b_ub": region.b_ub,
            "A_eq": region.A_eq,
            "b_eq": region.b_eq,
            "names": list(region.names),
            "min_slack": region.min_slack,
            **({"limits": given} if given else {}),
        },
    }


def problem_of(given: ProblemPart, naming: Callable[[str], AbstractContextManager[None]]) -> MarkowitzProblem:
    """Return the problem of checked data; `naming` adds the key to an error's message."""
    with naming("problem.constraints"):
        rows = given.constraints
        region = Polyhedron(
            rows.A_ub or None,
            rows.b_ub or None,
            rows.A_eq or None,
            rows.b_eq or None,
            names=rows.names,
            min_slack=rows.min_slack,
        )
        if rows.limits:
            limits = [
                MagnitudeLimit(
                    np.array(each.weights), np.array(each.centers), each.most, each.name, np.array(each.linear or 0.0)
                )
                for each in rows.limits
            ]
            region = MagnitudeRegion(region, limits)
    with naming("problem"):
        return MarkowitzProblem(given.means, given.covariances, given.risk_aversion, region)


def _labels(given: Any, what: str, count: int) -> tuple[str, ...]:
    if isinstance(given, str) or not all(isinstance(label, str) for label in given):
        raise InputError(f"{what} must be a sequence of texts, got {given!r}")
    labels = tuple(given)
    if len(labels) != count or len(set(labels)) != count:
        raise InputError(f"{what} must be {count} different labels, got {len(labels)}: {list(labels)}")
    return labels


def _check_names(
    world: HiddenMarkovModel, problem: MarkowitzProblem, assets: tuple[str, ...], regimes: tuple[str, ...]
) -> None:
    unnamed = world.names == default_names(world.n_states) and not set(world.names) & set(regimes)
    if world.names != regimes and not unnamed:
        raise InputError(
            f"the world's states are {list(world.names)}, the regimes {list(regimes)}; expected the same order"
        )
    known = (("asset", problem.asset_names, assets), ("state", problem.state_names, regimes))
    for what, found, given in known:
        if found is not None and tuple(map(str, found)) != given:
            raise InputError(
                f"the problem has the {what} labels {list(found)}, the model {list(given)}; expected the same order"
            )
    sensor = world.emission
    if not isinstance(sensor, GaussianEmission) or sensor.asset_names is None:
        return
    labels = list(sensor.asset_names)
    if set(labels) != set(assets):
        raise InputError(f"the world's sensor has the assets {labels}, the model {list(assets)}")
    if labels != list(assets) and np.array_equal(sensor.means, problem.means):
        raise InputError(
            f"the world's sensor has the assets in the order {labels}, the model in the order {list(assets)}, with the same "
            "means in each place: give both in the order of the means"
        )


_NET_DIGITS = 12  # of the sum: a whole number is one, without the rounding of least squares


def step_of(index: pd.Index) -> str:
    """Return the time between dated rows, such as "month"; empty for labels, few rows and other distances."""
    import pandas as pd

    if not isinstance(index, pd.DatetimeIndex) or len(index) < _FEW_DATES:
        return ""
    found = frequency_of(index).step
    return "" if found == _OTHER else found


_FEW_DATES, _OTHER = 4, "period"
"""Rows from which on the median distance of dates is taken for their step, and the word for a distance without a name."""


def checked_model(model: Any) -> InvestorModel:
    """Return an investor model, or raise `InputError`."""
    if not isinstance(model, InvestorModel):
        raise InputError(f"model must be an InvestorModel, such as InvestorModel.load returns, got {model!r}")
    return model


def _read(source: Path) -> dict[str, Any]:
    data = read_json(source, "a model.json saved by a backtest")
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise InputError(f'{source} is no saved model: expected a JSON object with "format": "{FORMAT}"')
    if data.get("version") != VERSION:
        raise InputError(f"{source} has model version {data.get('version')!r}; this release reads version {VERSION}")
    return data


def _built(source: Path, file: ModelFile) -> InvestorModel:
    with _naming(source, "world"):
        world = HiddenMarkovModel.from_dict(file.world.model_dump())
    problem = problem_of(file.problem, partial(_naming, source))
    with _naming(source, "budget"):
        budget = Budget(file.budget.amount, file.budget.is_relative)
    with _naming(source, "assets and regimes"):
        names = tuple(file.assets), tuple(file.regimes)
        made = InvestorModel(world, problem, *names, budget, file.note, file.turnover, file.step)
    return replace(made, reads=file.reads, limits=file.limits)


@contextmanager
def _naming(source: Path, key: str) -> Iterator[None]:
    """Add file and key to the message of a library error."""
    try:
        yield
    except InscrutableError as error:
        raise type(error)(f"{source}, key {key}: {error}") from None
