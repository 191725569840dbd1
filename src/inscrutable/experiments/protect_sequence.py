"""One step of a sequence of decisions that is kept in a file: what to publish where an observer remembers all before."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.budgets import Budget, as_budget
from inscrutable.decision_makers import DecisionSequence, MixedDecision, SequentialDecisionMaker
from inscrutable.decision_makers.sequential.sequence import StepFigures
from inscrutable.experiments.backtest_aware import resolution_for
from inscrutable.experiments.investor_model import InvestorModel, checked_model
from inscrutable.mechanisms.chains import BeliefChain, predicted_chain
from inscrutable.validation import Array

_CHAIN_SEED = 0
"""Of the simulated path that says how beliefs move: the same at every step, and no secret."""
_LEAST_SHOWN = 0.0005  # a weight below this is 0.0 per cent


@dataclass(frozen=True, eq=False)
class ProtectedStep:
    """What the sequential rule would draw from, what the observer holds, and what was published, if anything was.

    Args:
        model: The investor.
        belief: The investor's own belief, shape (X,).
        lottery: What to draw from; weights that are drawn seldom come last.
        before: The observer's mean belief before this decision, shape (X,).
        after: The same after the published decision; None where nothing was published.
        expected: What this step costs and tells on average.
        published: The weights that were drawn and recorded, shape (U,), or None.
        n_published: Decisions recorded, this one included.
        spent: Regret of all recorded decisions, by the observer's law, in the cost's unit.
        told: Bits that they told, by the observer's law.
        prior_error: Root mean square error of an observer who sees no decision.
        long_run_error: The same of one who has followed all decisions, in the long run.
    """

    model: InvestorModel
    belief: Array
    lottery: MixedDecision
    before: Array
    after: Array | None
    expected: StepFigures
    published: Array | None
    n_published: int
    spent: float
    told: float
    prior_error: float
    long_run_error: float

    def table(self) -> pd.DataFrame:
        """Return one row per portfolio of the lottery, the likeliest first: its probability, its regret, its weights."""
        order = np.argsort(-self.lottery.probabilities, kind="stable")
        columns = [f"weight: {asset}" for asset in self.model.assets]
        weights = pd.DataFrame(np.asarray(self.lottery.actions)[order], columns=columns)
        weights.insert(0, "regret", np.asarray(self.lottery.regrets)[order])
        weights.insert(0, "probability", np.asarray(self.lottery.probabilities)[order])
        return weights.rename_axis("portfolio")

    def figures(self) -> dict[str, Any]:
        """Return everything as plain data, by the names of assets and regimes."""

        def named(values: Array | None, names: tuple[str, ...]) -> dict[str, float] | None:
            return None if values is None else {name: float(each) for name, each in zip(names, values, strict=True)}

        return {
            "n_published": self.n_published,
            "published": named(self.published, self.model.assets),
            "lottery": self.table().to_dict("records"),
            "observer_before": named(self.before, self.model.regimes),
            "observer_after": named(self.after, self.model.regimes),
            "expected_regret": self.expected.own_regret,
            "expected_bits": self.expected.bits,
            "regret_so_far": self.spent,
            "bits_so_far": self.told,
            "long_run_error": self.long_run_error,
            "prior_error": self.prior_error,
        }

    def lines(self) -> pd.DataFrame:
        """Return the same as text for a screen; weights and probabilities in percent, what is zero left out."""
        table = self.table()
        held = table.filter(like="weight: ").to_numpy()
        return pd.DataFrame(
            {
                "probability, %": [f"{100.0 * share:.2f}" for share in table["probability"]],
                "regret": [f"{regret:.3g}" for regret in table["regret"]],
                "weights, %": [self.holdings(row) for row in held],
            },
            index=pd.Index(range(1, len(table) + 1), name="portfolio"),
        )

    def holdings(self, weights: Array) -> str:
        """Return weights (U,) as text, in percent, the largest first."""
        order = [j for j in np.argsort(-np.abs(weights), kind="stable") if abs(weights[j]) >= _LEAST_SHOWN]
        return ", ".join(f"{self.model.assets[j]} {100.0 * weights[j]:.1f}" for j in order)

    def summary(self) -> str:
        """Return a few sentences: cost, what the observer holds, and what was published."""
        lines = [
            f"This step costs {self.expected.own_regret:.3g} of regret in expectation under your belief, "
            f"{self.expected.regret:.3g} by the observer's law, and tells {self.expected.bits:.3f} bits on average.",
            f"An observer who knows the rule and has seen {_counted(self.n_published - (self.published is not None))} holds "
            f"{self._named(self.before)}.",
        ]
        if self.after is not None:
            lines.append(f"With the weights published now it holds {self._named(self.after)}.")
        lines.append(
            f"{_counted(self.n_published)} published so far: {self.spent:.3g} of regret, {self.told:.3f} bits. In the long run "
            f"its error is {self.long_run_error:.3f}, and {self.prior_error:.3f} without seeing any."
        )
        if self.published is None:
            lines.append("Nothing was drawn or recorded: --publish draws once and records what it drew.")
        return "\n".join(lines)

    def _named(self, belief: Array) -> str:
        return ", ".join(f"{name} {share:.2f}" for name, share in zip(self.model.regimes, belief, strict=True))


def _counted(count: int) -> str:
    return f"{count} decision" if count == 1 else f"{count} decisions"


def chain_of(model: InvestorModel) -> BeliefChain:
    """Return how the investor's belief about the next row moves, on a grid; the same at every call."""
    return predicted_chain(model.world, resolution_for(model.world.n_states), rng=np.random.default_rng(_CHAIN_SEED))


def protect_step(
    model: InvestorModel,
    belief: ArrayLike,
    state: str | Path,
    budget: Budget | float | None = None,
    *,
    publish: bool = False,
    rng: np.random.Generator | None = None,
) -> ProtectedStep:
    """Return what to publish at the next step of a sequence that is remembered in a file.

    The rule is `SequentialDecisionMaker` on the law of the predicted belief of the model's world. Where there is no file its
    prices are found first, and kept in it.

    Args:
        model: The investor.
        belief: π, shape (X,).
        state: The file of the sequence; it is made where there is none.
        budget: Long-run mean regret; None is the model's.
        publish: Whether to draw once, record what was drawn, and return it; otherwise nothing is drawn.
        rng: The source of the draw; None: the operating system, because who knows a seed knows the draw.

    Raises:
        InputError: An argument is malformed, the file is damaged or of another problem or budget, or in use; it is unchanged.
        SolverError: No price was found at which the budget is met.

    Cost: some milliseconds, and the calibration of one to three minutes where the file is new.

    Source: see `SequentialDecisionMaker`.

    Example:
        >>> import inspect
        >>> list(inspect.signature(protect_step).parameters)
        ['model', 'belief', 'state', 'budget', 'publish', 'rng']
    """
    checked_model(model)
    problem, path = model.problem, Path(state)
    held = validation.one_belief(belief, problem.n_states, names=model.regimes)
    source = np.random.default_rng() if rng is None else validation.generator(rng)
    chain = chain_of(model)
    limit = model.budget if budget is None else as_budget(budget)
    sequence = SequentialDecisionMaker(problem, limit, chain=chain, rng=source).begin()
    try:
        if path.exists():
            sequence.load(path)
        else:
            sequence.save(path)
        return _step(model, held, sequence, path, source if publish else None)
    finally:
        sequence.close()


def _step(
    model: InvestorModel, belief: Array, sequence: DecisionSequence, path: Path, draw: np.random.Generator | None
) -> ProtectedStep:
    lottery = sequence.decide(belief)
    expected, before = sequence.expected, sequence.observer
    published, after = None, None
    if draw is not None:
        published = lottery.sample(rng=draw).action
        sequence.publish(published)
        after = sequence.observer.mean
        sequence.save(path)
    prior = sequence.begun
    spread = float(prior.weights @ ((prior.beliefs - prior.mean) ** 2).sum(axis=1))
    return ProtectedStep(
        model, belief, lottery, before.mean, after, expected, published, sequence.n_published, sequence.total_regret,
        sequence.total_bits, float(np.sqrt(spread)), float(np.sqrt(sequence.calibration.loss)),
    )  # fmt: skip
