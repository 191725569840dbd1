"""The next step of a sequence of decisions, by command: `inscrutable protect --state`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from inscrutable.cli_console import Speech, results, show_table
from inscrutable.cli_values import belief_of, budget_of

if TYPE_CHECKING:
    from inscrutable.experiments.own_model import LimitsPart


def protect_next(
    model: Path,
    belief: str,
    state: Path,
    budget: str | None,
    publish: bool,
    seed: int | None,
    how: tuple[Speech, LimitsPart],
) -> None:
    """Show what to publish next, and with `publish` draw it once and record it in the file."""
    speech, limits = how
    asked, held = None if budget is None else budget_of(budget, speech), belief_of(belief, "--belief")

    import numpy as np

    from inscrutable.experiments.own_model import investor_of
    from inscrutable.experiments.protect_sequence import protect_step
    from inscrutable.experiments.silence import budget_in

    investor = investor_of(model, limits)
    if not state.exists():
        speech.log(f"No sequence in {state} yet: the prices that spend the budget in the long run are computed once.")
    limit = None if asked is None else budget_in(investor.world, investor.problem, asked)
    rng = None if seed is None else np.random.default_rng(seed)
    found = protect_step(investor, held, state, limit, publish=publish, rng=rng)
    if speech.json:
        speech.summary(found.figures())
        return
    show_table(found.lines(), "The lottery of this step, from which --publish draws")
    if found.published is not None:
        results().print(f"Publish these weights, which are recorded: {found.written(found.published)}.")
    for line in found.summary().splitlines():
        results().print(line)
