"""Results of an audit of two tables: a lower bound of the leak, or none found with the detectable size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import pandas as pd

from inscrutable.axes import few
from inscrutable.saved import Saved, Summarised

LEVEL = 0.95
POWER = 0.8
_MOST_SOURCES = 6


@dataclass(frozen=True, eq=False)
class Telling(Saved):
    """The share of a secret that one column of the decisions, or one lag, explains alone.

    Args:
        kind: "column" or "lag".
        name: The column's name, or the lag in rows.
        explained: Share of the secret explained by it alone, relative to the mean of the training rows.
        error: Its standard error.
        tells: Whether it is above 0 in a one-sided test, corrected for all columns and lags of a secret.
    """

    kind: str
    name: str
    explained: float
    error: float
    tells: bool


@dataclass(frozen=True, eq=False)
class BlockScore(Saved):
    """The error of one block of rows, predicted by a learner fitted before it.

    Args:
        first: Label of its first row.
        last: Label of its last row.
        error: The learner's error on the block: share wrong, or root mean square in the secret's unit.
        guess_error: The error without decisions.
        explained: Share of the secret explained, by squared error.
        learner: The chosen learner.
        is_judged: Whether the block counts for the claim; earlier blocks only choose a learner.
    """

    first: str
    last: str
    error: float
    guess_error: float
    explained: float
    learner: str
    is_judged: bool


@dataclass(frozen=True, eq=False)
class SecretAudit(Saved):
    """What decisions reveal about one secret.

    Args:
        name: The secret's column.
        kind: "classes" or "numbers".
        classes: Names of the classes.
        is_found: Whether a leak was found, at a level of 5 % for all secrets together.
        p_value: Share of circular shifts, the identity included, that explain as much; by the largest statistic of all secrets.
        error: The learner's error on the test rows: share wrong, or root mean square in the secret's unit.
        error_limit: Upper limit on the error of the best observer, at 95 % for all secrets together.
        guess_error: The error of an observer without decisions, who names the commonest class, or the mean, of the rows before.
        explained: Share of the secret explained by the learners: 1 − squared error / squared error of the guess; of indicators
            for classes. `error` may also be that of the guess, where no learner was better so far.
        explained_limit: Lower limit on the R² of the best observer of numbers, against the variance of the test rows, at 95 %
            for all secrets together; 0 for classes and where nothing is found.
        detectable: The share explained at which the test has a power of about 80 %, if these learners can learn the dependence
            and all rows leak alike; simulations gave 70 to 82 %. For a leak in few rows, such as those of a rare decision, the
            power was 40 %.
        since: Label of the row from which the decisions leak, at the minimum of the summed gain; "" where nothing is found.
        noticed: Label of the row from which the p-value stays low; "" where nothing is found.
        sources: The shares that single columns and lags explain alone.
        blocks: The error of each block of rows.
    """

    name: str
    kind: str
    classes: tuple[str, ...]
    is_found: bool
    p_value: float
    error: float
    error_limit: float
    guess_error: float
    explained: float
    explained_limit: float
    detectable: float
    since: str
    noticed: str
    sources: tuple[Telling, ...]
    blocks: tuple[BlockScore, ...]

    def telling(self) -> tuple[Telling, ...]:
        """Return the columns and lags that leak by themselves, the largest leak first."""
        return tuple(sorted((each for each in self.sources if each.tells), key=lambda each: -each.explained))

    def summary(self) -> str:
        """Return what may be claimed about this secret, in a few lines."""
        if not self.is_found:
            power = f"The power is about {POWER:.0%} for a leak that explains {self.detectable:.1%} of it"
            if self.detectable >= 1.0:
                power = f"The power is at most about {POWER:.0%}, however much of it a leak explains"
            return (
                f"{self.name}: nothing found (p = {self.p_value:.2g}). {power}, if these learners can learn it and all rows "
                f"leak alike; it is less for a leak in few rows.\n  {self._errors()}"
            )
        told = self.telling()
        names = [f"{each.name} ({each.explained:.0%})" for each in told if each.kind == "column"]
        late = [f"{each.name} ({each.explained:.0%})" for each in told if each.kind == "lag"]
        lines = [
            f"{self.name}: leaks (p = {self.p_value:.2g}: one audit in {round(1.0 / self.p_value)} without a leak says so), "
            f"since {self.since}; noticed by {self.noticed}.",
            f"  {self._errors()}",
            f"  explained {self.explained:.1%} of it; columns that leak alone: {few(names, _MOST_SOURCES) or 'none'}"
            + (f"; lags: {few(late, _MOST_SOURCES)}" if late else ""),
        ]
        return "\n".join(lines)

    def _errors(self) -> str:
        if self.kind == "classes":
            return (
                f"the best observer names its class wrongly in at most {self.error_limit:.1%} of the rows ({LEVEL:.0%} "
                f"confidence; this one in {self.error:.1%}), without decisions {self.guess_error:.1%}"
            )
        least = self.explained_limit
        return (
            f"the best observer errs by at most {self.error_limit:.4g} ({LEVEL:.0%} confidence; this one by {self.error:.4g}; "
            f"root mean square), without decisions {self.guess_error:.4g}: "
            + (f"R² at least {least:.1%}" if least > 0.0 else "so no part of it is sure to be explained")
        )


@dataclass(frozen=True, eq=False, repr=False)
class PairsAudit(Summarised, Saved):
    """The least that published decisions leak about secrets, from data and without a model.

    Args:
        secrets: One finding for every secret, in the order given.
        n_rows: Number of complete rows.
        n_judged: Number of test rows, the later ones.
        embargo: Rows left out between training and test rows.
        lags: Rows from the secret to its decision.
        n_shifts: Circular shifts behind the p-values, without the identity.
        learners: Names of the learners.
        notes: The treatment of missing values, unequal dates, constant columns and text.

    Source: `audit_pairs`.
    """

    secrets: tuple[SecretAudit, ...]
    n_rows: int
    n_judged: int
    embargo: int
    lags: tuple[int, ...]
    n_shifts: int
    learners: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def is_found(self) -> bool:
        """Whether any secret leaks."""
        return any(each.is_found for each in self.secrets)

    def of(self, name: str) -> SecretAudit:
        """Return the finding on one secret; raise `KeyError` for an unknown one."""
        return {each.name: each for each in self.secrets}[name]

    def frame(self) -> pd.DataFrame:
        """Return one row per secret, errors as shares wrong or in the secret's unit."""
        names = [field.name for field in fields(SecretAudit) if field.name not in ("classes", "sources", "blocks")]
        rows = [{name: getattr(each, name) for name in names} for each in self.secrets]
        return pd.DataFrame(rows).set_index("name")

    def source_frame(self) -> pd.DataFrame:
        """Return the share that each column and lag explains alone of each secret, with the fields of `Telling`."""
        return _frame([(each.name, part) for each in self.secrets for part in each.sources])

    def block_frame(self) -> pd.DataFrame:
        """Return the error of each block of rows for each secret, with the fields of `BlockScore`."""
        return _frame([(each.name, part) for each in self.secrets for part in each.blocks])

    def summary(self) -> str:
        """Return the verdict, the method, and the treatment of the data, as text."""
        lags = f"lags {', '.join(map(str, self.lags))}" if self.lags != (0,) else "the decision of the same row"
        lines = [
            *(each.summary() for each in self.secrets),
            f"{self.n_rows} rows, the last {self.n_judged} for the test; learners of each block are fitted to the rows before "
            f"it, minus an embargo of {self.embargo}; {lags}; {self.n_shifts} circular shifts; {', '.join(self.learners)}.",
            "These are lower bounds of the leak: other learners may find more.",
            *(f"Note: {note}." for note in self.notes),
        ]
        return "\n".join(lines)


def _frame(parts: Sequence[tuple[str, Telling | BlockScore]]) -> pd.DataFrame:
    """Return one row per part of a secret, under the secret's name."""
    rows = [{field.name: getattr(part, field.name) for field in fields(part)} for _, part in parts]
    return pd.DataFrame(rows, index=pd.Index([name for name, _ in parts], name="secret"))
