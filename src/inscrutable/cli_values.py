"""Values of options as the library's objects: budgets, beliefs, measures, targets."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os.path import isfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter, Token, validators

from inscrutable.errors import DiskError, InputError, ModelError

if TYPE_CHECKING:
    import pandas as pd

    from inscrutable.budgets import Budget, SilenceShare
    from inscrutable.cli_console import Speech
    from inscrutable.experiments.backtest_public import BesideReturns
    from inscrutable.privacy import PrivacyMeasure

BASIS_POINTS = 10_000

RuleName = Literal["optimal", "cdm", "pdm", "sequential"]
MeasureName = Literal["maximal", "desired", "non-existence", "non-uniqueness", "infeasibility"]


class UsageError(Exception):
    """Wrong usage of the command line: an option is malformed, missing or contradicts another."""


_LOGGER = logging.getLogger(__name__)

_ARGUMENT = re.compile(r"(?:study, key |.*, key constraints: )?(?:n_)?([a-z]\w*)(?:\.[\w-]+)*(?=[: ])")
"""An argument's name, with which the library's messages about it begin; a section may stand before it."""


@contextmanager
def blaming(tokens: Sequence[str]) -> Iterator[None]:
    """Name the option that gave an argument in an error about it, or the file that the option gave."""
    try:
        yield
    except (InputError, ModelError) as error:
        said = f"{error}"
        begun = _ARGUMENT.match(said)
        option = "" if begun is None else f"--{begun[1].replace('_', '-')}"
        value = _given_to(option, tokens)
        if isinstance(error, DiskError) or begun is None or value in (None, begun[0]):  # begun[0] may be a file's name
            raise
        if isfile(value):  # unlike a path, it takes a long list of numbers for no file
            raise (error if value in said else type(error)(f"{value}: {said}")) from None
        if isinstance(error, ModelError):
            raise
        raise InputError(f"{option}{said[begun.end() :]}") from None


@contextmanager
def saying(option: str) -> Iterator[None]:
    """Name the option in an error about its value."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{option}: {error}") from None


def disclosure_of(text: str, option: str = "--disclosure") -> str:
    """Return the text of a disclosure, checked."""
    from inscrutable.mechanisms import Disclosure

    with saying(f"{option} {text}"):
        return str(Disclosure.of(text))


def _given_to(option: str, tokens: Sequence[str]) -> str | None:
    """Return the last value that was given to an option; None where there is none."""
    found = None
    for token, after in zip(tokens, [*tokens[1:], ""], strict=True):
        name, equals, value = token.partition("=")
        if name == option:
            found = value if equals else after
    return found


def budget_of(text: str, speech: Speech | None = None, option: str = "--budget") -> Budget | SilenceShare:
    """Return the budget of "0.1", "10%", "5bp", "regret:0.002" or "silence:0.5"; an unusual value gives a warning."""
    from inscrutable.budgets import is_budget, written_budget

    try:
        found = written_budget(text)
    except InputError as error:
        if is_budget(text):
            raise
        raise UsageError(f"{option}: {error}") from None
    if speech is not None and found.remark:
        speech.log(f"{option} {text}: {found.remark}")
    return found


def budgets_of(text: str) -> tuple[Any, tuple[float, ...]]:
    """Return the unit and the numbers of "0.05,0.1" (shares of |c*|), "silence:0.5,1" or "regret:0.002"."""
    from inscrutable.budgets import Budget, written_budget

    kind, separator, amounts = text.rpartition(":")
    try:
        found = [written_budget(f"{kind}{separator}{part}") for part in amounts.split(",")]
    except InputError:
        raise UsageError(
            f"--budgets {text}: expected shares of |c*| such as 0.05,0.1 or 5%,10%, or silence:0.25,0.5,1, or regrets "
            "such as 5bp,10bp or regret:0.001,0.002"
        ) from None
    units = {"silence" if not isinstance(each, Budget) else "cost" if each.is_relative else "regret" for each in found}
    if len(units) > 1:
        raise UsageError(f"--budgets {text}: expected one unit for all, got {' and '.join(sorted(units))}")
    return units.pop(), tuple(each.amount if isinstance(each, Budget) else each.share for each in found)


def amount_of(text: str, option: str) -> float:
    """Return the amount of "5bp" (basis points) or "0.0005"."""
    return _number(text[:-2], option) / BASIS_POINTS if text.endswith("bp") else _number(text, option)


def covariance_of(path: Path) -> pd.DataFrame:
    """Return the covariance of a file; one that is not symmetric, indefinite, or not of returns as fractions, is refused."""
    import numpy as np

    from inscrutable import tolerances, validation
    from inscrutable.datasets import read_labelled_matrix

    table = read_labelled_matrix(path, is_square=True)
    values = table.to_numpy()
    apart = np.abs(values - values.T)
    if apart.max() > tolerances.SYMMETRY * np.abs(values).max():
        row, column = map(int, np.unravel_index(int(apart.argmax()), apart.shape))
        one, other = table.columns[row], table.columns[column]
        raise InputError(
            f"{path} is not symmetric: {one}, {other} is {values[row, column]:g}, but {other}, {one} is "
            f"{values[column, row]:g}"
        )
    large = values.diagonal() >= 1.0
    if 2 * large.sum() > len(large):
        what = "correlations" if (values.diagonal() == 1.0).all() else "variances of percentages"
        raise InputError(
            f"{path}: {large.sum()} of {len(large)} variances are 1 or more, such as {values.diagonal()[large][0]:g}. These "
            f"look like {what}; expected covariances of returns as fractions, 0.0025 for a standard deviation of 5%: multiply "
            "correlations by both standard deviations, divide variances of percentages by 10,000"
        )
    try:
        validation.check_positive_semidefinite(values, str(path), "a covariance has no negative eigenvalue")
    except ModelError as error:  # a file that holds no covariance
        raise InputError(f"{error}") from None
    return table


def check_labels(path: Path, labels: Sequence[str], other: Path, expected: Sequence[str]) -> None:
    """Raise `InputError` where two files have other labels, in whichever of them a label is misspelt."""
    from inscrutable.axes import few

    mine, theirs = (sorted(set(a) - set(b)) for a, b in ((labels, expected), (expected, labels)))
    if mine or theirs:
        sides = ((path, mine), (other, theirs))
        only = "; ".join(f"only in {file}: {few(names)}" for file, names in sides if names)
        raise InputError(f"{path} and {other} have other labels: {only}")


def whole_number(type_: Any, tokens: Sequence[Token]) -> int:
    """Return a typed whole number; 1.5 is an error and is not rounded."""
    text = tokens[0].value
    try:
        return int(text)
    except ValueError:
        raise ValueError(f'unable to convert "{text}" into a whole number') from None


def whole_numbers_of(text: str, option: str) -> tuple[int, ...]:
    """Return the whole numbers of "0,1,2"."""
    try:
        return tuple(int(part.replace("−", "-")) for part in text.split(","))
    except ValueError:
        raise UsageError(f"{option} {text}: expected whole numbers such as 1,10,100") from None


def one_column(path: Path) -> pd.Series:
    """Return the numbers of a file of dates and one column."""
    from inscrutable.datasets import read_signals

    table = read_signals(path)
    if table.shape[1] != 1:
        raise InputError(f"{path} has {table.shape[1]} columns of numbers, expected one")
    return table.iloc[:, 0]


def beside_of(public: str, private: Path | None, returns: pd.DataFrame, *, embedded: bool) -> BesideReturns:
    """Return the observations of "none", "market", "all", a column or a file, with a private signal's file."""
    from inscrutable.datasets import load_industry_returns, read_signals
    from inscrutable.experiments.backtest_public import ALL, MARKET, NOTHING, BesideReturns

    read: Any = public
    if public not in (NOTHING, MARKET, ALL, *returns.columns):
        if not Path(public).is_file():
            raise UsageError(
                f"--public {public}: expected none, market, all, a file, or one of the columns {', '.join(returns.columns)}"
            )
        read = one_column(Path(public))
    market = load_industry_returns().market if embedded and public == MARKET else None
    return BesideReturns(read, market, None if private is None else read_signals(private))


DATA, WORK, INVESTOR, PRIVACY, OUTPUT = (
    Group(name, sort_key=place)
    for name, place in (("Data", 1), ("Work", 1), ("Investor", 2), ("Privacy", 3), ("Output", 9))
)
"""Headings of the options in the help of every verb."""

Whole = Annotated[int, Parameter(converter=whole_number)]
AT_LEAST_0 = Parameter(validator=validators.Number(gte=0))
Seed = Annotated[Whole, Parameter(group=OUTPUT), AT_LEAST_0]
Out = Annotated[Path, Parameter(group=OUTPUT)]


def belief_of(text: str, option: str) -> list[float]:
    """Return the belief of "0.2,0.3,0.5" or "20%,30%,50%"; the library checks its sum."""
    parts = [part.strip() for part in text.split(",")]
    return [0.01 * _number(part[:-1], option) if part.endswith("%") else _number(part, option) for part in parts]


def measure_of(name: MeasureName, target: str | None) -> PrivacyMeasure:
    """Return the privacy measure of a name, with the target that only desired obfuscation has."""
    from inscrutable.experiments.makers import goal_of
    from inscrutable.privacy import DesiredObfuscation

    if (target is None) == (name == "desired"):
        raise UsageError(
            "--measure desired needs --target: a belief such as 0.2,0.3,0.5, or reverse"
            if target is None
            else f"--target belongs to --measure desired, not to {name}"
        )
    if target is None or target == "reverse":
        return goal_of("reversed" if target else name)
    return DesiredObfuscation(belief_of(target, "--target"))


def _number(text: str, option: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise UsageError(f"{option}: {text.strip()!r} is not a number") from None


def writable_folder(path: Path, verb: str) -> Path:
    """Return a writable folder for a verb's results, checked before the work; it is created with its first file.

    Raises `InputError` where it has the summary.json of another verb.
    """
    from inscrutable.datasets import output_folder
    from inscrutable.datasets.written import check_folder

    check_folder(path, verb, "summary.json")

    before = path.exists()
    folder = output_folder(path)
    if not before:
        folder.rmdir()
    return folder


def history_of(path: Path, *, prices: bool = False, least: int = 2) -> pd.DataFrame:
    """Return the returns of a file, or of one of prices, of at least that many rows; what looks wrong in them is logged."""
    from inscrutable.datasets import read_returns
    from inscrutable.experiments.backtest_inputs import suspicious_returns

    returns = read_returns(path, prices=prices)
    if len(returns) < least:
        raise InputError(f"{path}: {len(returns)} rows of returns, expected at least {least}")
    for each in suspicious_returns(returns) if len(returns) > 1 else ():
        _LOGGER.warning("%s: suspicious returns: %s", path, each)
    return returns
