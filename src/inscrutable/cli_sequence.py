"""The next step of a sequence of decisions, by command: `inscrutable protect --state`."""

from __future__ import annotations

from pathlib import Path

from inscrutable.cli_console import Speech, results, show_table
from inscrutable.cli_values import belief_of, budget_of


def protect_next(
    model: Path, belief: str, state: Path, budget: str | None, publish: bool, seed: int | None, speech: Speech
) -> None:
    """Show what to publish next, and with `publish` draw it once and record it in the file."""
    limit, held = None if budget is None else budget_of(budget), belief_of(belief, "--belief")

    import numpy as np

    from inscrutable.experiments.investor_model import InvestorModel
    from inscrutable.experiments.protect_sequence import protect_step

    if not state.exists():
        speech.log(f"No sequence in {state} yet: prices that spend the budget in the long run are found first, once.")
    rng = None if seed is None else np.random.default_rng(seed)
    found = protect_step(InvestorModel.load(model), held, state, limit, publish=publish, rng=rng)
    if speech.json:
        speech.summary(found.figures())
        return
    show_table(found.lines(), "What the rule draws from at this step")
    if found.published is not None:
        results().print(f"Publish these weights, which are recorded: {found.written(found.published)}.")
    for line in found.summary().splitlines():
        results().print(line)
