"""The cost of hiding to agents who learn from each other, one row per decision maker."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.errors import InputError
from inscrutable.experiments.herding.results import SocialLearning
from inscrutable.experiments.herding.turns import social_learning
from inscrutable.mechanisms.played import PlaysMany
from inscrutable.problems import DecisionProblem
from inscrutable.saved import Saved, Summarised
from inscrutable.worlds import Emission

_KNOWN = 0.75
"""Mean public probability of the true state from which it counts as learned."""


@dataclass(frozen=True, eq=False, repr=False)
class HerdingTable(Summarised, Saved):
    """Agents who learn from each other under several rules, each compared with the first.

    Args:
        names: Names of the rules.
        found: The result under each rule.

    Source: `herding_table`.

    Example:
        >>> from inscrutable import CategoricalEmission, FiniteProblem, OriginalDecisionMaker
        >>> guess, sensor = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), CategoricalEmission([[0.7, 0.3], [0.3, 0.7]])
        >>> found = herding_table(guess, sensor, {"ODM": OriginalDecisionMaker(guess)}, n_agents=10)
        >>> round(found["ODM"].wrong, 3)
        0.247
    """

    names: tuple[str, ...]
    found: tuple[SocialLearning, ...]

    def __getitem__(self, name: str) -> SocialLearning:
        if name not in self.names:
            raise InputError(f"no row {name!r}; there are {list(self.names)}")
        return self.found[self.names.index(name)]

    def frame(self) -> pd.DataFrame:
        """Return one row per rule.

        Columns: `bits`, leakage of the first agent's decision; `mean_bits`, the mean over agents; `right`, `wrong`, `none`;
        `learned_by`, the number of agents after which the mean public probability of the true state reaches 0.75, NaN if never;
        `truth`, that probability after all agents; `regret`, of all agents under the true state; `own`, the part due to an
        agent's own hiding; `others`, the other agents' total regret minus that under the first rule, the cost of hiding to
        them; `others_se`, its standard error, 0 for exact figures. Where `own` or `others` is rounding of the regrets, it is 0.
        """
        first = self.found[0]
        base = first.welfare - float(first.prices.sum())
        rows = []
        for each in self.found:
            own, known = float(each.prices.sum()), each.truths >= _KNOWN
            rounding = tolerances.NO_COST * max(each.welfare, first.welfare)
            own, others = (part if abs(part) > rounding else 0.0 for part in (own, each.welfare - own - base))
            rows.append(
                {
                    "bits": float(each.leakages[0]),
                    "mean_bits": float(each.leakages.mean()),
                    "right": each.right,
                    "wrong": each.wrong,
                    "none": each.none,
                    "learned_by": float(known.argmax()) if known.any() else float("nan"),
                    "truth": float(each.truths[-1]),
                    "regret": each.welfare,
                    "own": own,
                    "others": others,
                    "others_se": 0.0 if each is first else float(np.hypot(each.welfare_error, first.welfare_error)),
                    "exact": each.n_paths == 0,
                }
            )
        return pd.DataFrame(rows, index=pd.Index(self.names, name="rule"))

    def lines(self) -> pd.DataFrame:
        """Return the same as text."""
        table, cells = self.frame(), {}
        for column, title, form in (
            ("bits", "leakage, bits", "{:.3f}"),
            ("right", "right", "{:.1%}"),
            ("wrong", "wrong", "{:.1%}"),
            ("learned_by", "learned by", "{:.0f}"),
            ("truth", "truth", "{:.3f}"),
            ("regret", "regret", "{:.3g}"),
            ("own", "own", "{:.3g}"),
            ("others", "others", "{:+.3g}"),
        ):
            cells[title] = ["never" if np.isnan(value) else form.format(value) for value in table[column]]
        return pd.DataFrame(cells, index=table.index)

    def summary(self) -> str:
        """Return the table, and which rules help the others by more than two standard errors."""
        table = self.frame()
        far = np.abs(table["others"]) > 2.0 * table["others_se"]
        helped = table.index[far & (table["others"] < 0)].tolist()
        open_ones = table.index[~far & (table["others_se"] > 0)].tolist()
        told = [f"the others gain by {', '.join(helped)}"] if helped else []
        if open_ones:
            told.append(
                f"the figures do not tell for {', '.join(open_ones)}: within two standard errors of {self.names[0]}"
            )
        told = told or [f"no rule helps the others more than {self.names[0]}"]
        return f"{self.lines().to_string()}\nof {self.found[0].n_agents} agents; {'; '.join(told)}"


def herding_table(
    problem: DecisionProblem,
    emission: Emission,
    decision_makers: Mapping[str, PlaysMany],
    *,
    n_agents: int,
    prior: ArrayLike | None = None,
    rng: np.random.Generator | None = None,
    n_paths: int | None = None,
) -> HerdingTable:
    """Return the results of social learning under each of several rules, for the same agents.

    Formula: `social_learning` for every rule; simulations use the same random numbers.

    Args:
        problem: Every agent's decision problem.
        emission: Every agent's sensor.
        decision_makers: Rules by name, each for all agents; the first is the reference.
        n_agents: N, at least 1.
        prior: Public belief before the first decision, shape (X,); None is the uniform one.
        rng: Source of simulated paths.
        n_paths: As for `social_learning`.

    Raises:
        InputError: There are no rules, or as `social_learning`.

    Cost: one `social_learning` per rule.

    Source: see `social_learning`.

    Example:
        >>> from inscrutable import CategoricalEmission, CoinDecisionMaker, FiniteProblem, OriginalDecisionMaker
        >>> guess, sensor = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), CategoricalEmission([[0.7, 0.3], [0.3, 0.7]])
        >>> rules = {"ODM": OriginalDecisionMaker(guess), "response": CoinDecisionMaker.response(guess, 1.0)}
        >>> print(herding_table(guess, sensor, rules, n_agents=20).frame()[["bits", "wrong", "others"]].round(3).to_string())
                  bits  wrong  others
        rule
        ODM       1.00  0.247   0.000
        response  0.16  0.232   0.272
    """
    if not isinstance(decision_makers, Mapping) or not decision_makers:
        raise InputError(f"decision_makers must be a dict from names to decision makers, got {decision_makers!r}")
    seed = None if rng is None else int(validation.generator(rng).integers(2**62))
    found = [
        social_learning(
            problem,
            emission,
            rule,
            n_agents=n_agents,
            prior=prior,
            rng=None if seed is None else np.random.default_rng(seed),
            n_paths=n_paths,
        )
        for rule in decision_makers.values()
    ]
    return HerdingTable(tuple(map(str, decision_makers)), tuple(found))
