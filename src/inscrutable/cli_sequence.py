"""The next step of a sequence of decisions, by command: `inscrutable protect --state`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from inscrutable.cli_console import SEED_KNOWN, Speech, results, show_table
from inscrutable.cli_values import UsageError, belief_of, budget_of, history_of

if TYPE_CHECKING:
    from pandas import DataFrame

    from inscrutable.experiments.investor_model import InvestorModel
    from inscrutable.experiments.weight_limits import LimitsPart
    from inscrutable.validation import Array

IF_PUBLIC = (
    "Caution: if these returns are public, an observer who follows them with this model has the same belief without any "
    "weights, and nothing hides it."
)


def belief_now(belief: str | None, returns: Path | None, refused: dict[str, Any]) -> list[float] | Path:
    """Return the belief, or the file of returns that it follows from; other options do not go with a sequence."""
    given = [name for name, option in refused.items() if option is not None]
    if given:
        raise UsageError(
            f"{given[0]} does not go with --state, which takes --belief or --returns, --budget, --publish and --seed; its file "
            "has the decisions so far"
        )
    if belief is not None and returns is None:
        return belief_of(belief, "--belief")
    if returns is not None and belief is None:
        return returns
    raise UsageError("--state needs your belief: one of --belief and --returns")


_FEW_ROWS = 0.05
"""Largest part of a regime's probability that may come from the belief before the first row, without a caution. Of 30 stretches
of the packaged returns the median part is .73 after three rows and .003 after six, the largest .86 after six and .08 after
twelve."""


def belief_after(path: Path, investor: InvestorModel, speech: Speech) -> tuple[Array, DataFrame, list[str]]:
    """Return the belief about the next row after the returns of a file, these, and cautions; say the first two."""
    table = history_of(path, least=1)
    found = investor.belief_after(table)
    named = ", ".join(f"{name} {share:.3f}" for name, share in zip(investor.regimes, found, strict=True))
    speech.log(f"Belief after {len(table)} rows of {path}, to {table.index[-1]:%Y-%m-%d}: {named}")
    apart = investor.start_counts(table)
    few = (
        "Caution: these returns are too few for this belief: by what is held before the first row, a regime's "
        f"probability differs by up to {apart:.2f}; give all returns since the model's first ones."
    )
    more = (
        f"Caution: the beliefs of this model's backtest also rest on {investor.reads}. This belief is that of the returns "
        "alone."
    )
    return found, table, [*([few] if apart > _FEW_ROWS else []), *([more] if investor.reads else [])]


def protect_next(
    model: Path,
    belief: list[float] | Path,
    state: Path,
    budget: str | None,
    publish: bool,
    seed: int | None,
    how: tuple[Speech, LimitsPart],
) -> None:
    """Show what to publish next, and with `publish` draw it once and record it in the file.

    `belief` is one, or a file of returns after which the model's filter holds it.
    """
    speech, limits = how
    asked = None if budget is None else budget_of(budget, speech)

    import numpy as np

    from inscrutable.budgets import remarks_of
    from inscrutable.experiments.own_model import investor_of
    from inscrutable.experiments.protect_sequence import protect_step
    from inscrutable.experiments.silence import budget_in

    investor = investor_of(model, limits)
    held, periods, cautions = (
        belief_after(belief, investor, speech) if isinstance(belief, Path) else (belief, (), list[str]())
    )
    if not state.exists():
        speech.log(
            f"No sequence in {state} yet: it is begun, with this budget and the prices that spend it in the long run."
        )
    cautions = [*remarks_of(asked), *cautions]
    limit = None if asked is None else budget_in(investor.world, investor.problem, asked)
    rng = None if seed is None else np.random.default_rng(seed)
    found = protect_step(investor, held, state, limit, publish=publish, rng=rng, periods=periods)
    if speech.json:
        speech.summary(found.figures() | {"cautions": cautions})
        return
    show_table(found.lines(), "The lottery of this step, from which --publish draws")
    if found.published is not None:
        results().print(f"Publish these weights, which are recorded: {found.written(found.published)}.")
        if seed is not None:
            results().print(SEED_KNOWN)
    for line in [*found.summary().splitlines(), *cautions]:
        results().print(line)
    if isinstance(belief, Path):
        results().print(IF_PUBLIC)
