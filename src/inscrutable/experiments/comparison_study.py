"""`compare` as a resumable study: the shipped study file with other settings, and the comparison of its rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from inscrutable.experiments.comparison import Comparison, ComparisonSettings
from inscrutable.experiments.studies.comparison_tasks import ComparisonFile, comparison_from, market_from
from inscrutable.experiments.studies.study import Study
from inscrutable.experiments.studies.tasks import Row
from inscrutable.experiments.studies.whole import Counted, all_rows, rows_of_whole, shipped
from inscrutable.experiments.weight_limits import LimitsPart
from inscrutable.files import PathLike


def comparison_study(
    settings: ComparisonSettings,
    makers: Sequence[str] | None = None,
    *,
    market: str,
    resolution: int,
    seed: int,
    limits: LimitsPart = LimitsPart(),  # noqa: B008  # frozen
) -> Study:
    """Return the shipped study with these settings, decision makers of `COMPARED`, market and seed in place of its values."""
    chosen = settings.model_dump() | {"seed": seed, "market": market, "resolution": resolution}
    chosen |= {} if limits.is_empty else {"limits": limits.model_dump(exclude_none=True)}
    chosen |= {} if makers is None else {"decision_makers": tuple(makers)}
    return Study.of(shipped("comparison") | chosen)


def compared(
    study: Study,
    folder: PathLike | None = None,
    *,
    jobs: int = 1,
    again: bool = True,
    say: Callable[[str], None],
    progress: Counted,
) -> tuple[Comparison, str]:
    """Run a study of this kind as `all_rows` does, and return the comparison with a line on its market.

    It calls `say` with that line as soon as it is known.
    """
    plan = study.plan
    assert isinstance(plan, ComparisonFile)

    def prepared(worlds: Sequence[dict[str, Any]]) -> None:
        say(f"{worlds[0]['note']}; {len(worlds[0]['weights'])} beliefs")

    return _whole(plan, *all_rows(study, folder, jobs=jobs, again=again, prepared=prepared, progress=progress))


def comparison_of(study: Study) -> tuple[Comparison, str]:
    """Return the comparison of a finished study of this kind, with a line on its market.

    Raises:
        InputError: The study is of another kind, was not run, or is not finished.
    """
    return _whole(*rows_of_whole(study, ComparisonFile, "comparison"))


def _whole(plan: ComparisonFile, rows: Sequence[Row], worlds: Sequence[dict[str, Any]]) -> tuple[Comparison, str]:
    market = market_from(worlds)
    return comparison_from(plan, market, rows), market.note
