"""A comparison: every decision maker against every observer, at equal expected regret."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Annotated, Any, Literal, Self, cast

import numpy as np
import pandas as pd
from pydantic import Field, model_validator
from threadpoolctl import threadpool_limits

from inscrutable import tolerances, validation
from inscrutable.budgets import SilenceShare, remarks_of
from inscrutable.decision_makers import Candidates
from inscrutable.decision_makers.results import Progress
from inscrutable.errors import InputError
from inscrutable.experiments.comparison_measures import ComparisonRow, learned_from_data, measured
from inscrutable.experiments.comparison_sensor import SENSOR_STEPS
from inscrutable.experiments.holding import Reached, Requirement
from inscrutable.experiments.makers import MAKERS, Maker, behave
from inscrutable.experiments.observers import DisclosureText, Observed, Pairs
from inscrutable.experiments.rivals import Rival, is_own, wanting
from inscrutable.experiments.sections import Count, NonNegative, Rising, Section
from inscrutable.experiments.setting import Behaviour, Setting
from inscrutable.experiments.toml_lines import nearest
from inscrutable.labels import listed
from inscrutable.mechanisms import Disclosure, Prior
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.disclosures import EXACT
from inscrutable.mechanisms.joint import top_states
from inscrutable.privacy import leakage
from inscrutable.problems import DecisionProblem
from inscrutable.saved import Saved

_MOST_DRAWN = 2**27
"""Most decisions sampled for one mechanism: one gigabyte."""


class ComparisonSettings(Section):
    """The budgets and numbers of decisions of a comparison.

    Args:
        budgets: Expected regrets, at least 0, ascending.
        unit: Unit of `budgets`. "silence": shares of the silence regret r₀, at which a constant decision is affordable and
            nothing leaks; "cost": shares of E|c*|; "regret": the cost's own unit.
        repeats: Numbers of decisions under one fixed belief, ascending, the first at least 1.
        draws: Number of sampled sequences for each of `repeats`, at least 10.
        pairs: Numbers of pairs of belief and decision seen by an observer who has only data, ascending, each at least 10;
            empty: no such observer. Needs the extra `inscrutable[audit]`.
        disclosure: What observers see of decisions, how often and how late, such as "every(3)|delayed(2)"; "exact": all, at
            once. Single and repeated decisions then mean disclosed ones. The sequential rule takes it into account. Delayed and
            partial trading are then left out, because their observers need all decisions in full.
        rival: A rival's decision problem, as the section [problem] of a study file: {"kind": "own"} for the agent's own
            problem, {"kind": "finite", "costs": [[-1, 0], [1, 0]]} or {"kind": "naming"}; None: no rival, the square error of
            the belief.

    Raises:
        InputError: A number is malformed, the unit or the disclosure is unknown, or the disclosure needs returns.

    Example:
        >>> ComparisonSettings(budgets=(0.1, 0.2), unit="cost").unit
        'cost'
    """

    budgets: Annotated[Rising[NonNegative], Field(min_length=1)] = (0.25, 0.5, 0.75, 1.0)
    unit: Literal["silence", "cost", "regret"] = "silence"
    repeats: Annotated[Rising[Count], Field(min_length=1)] = (1, 10, 100)
    draws: Annotated[int, Field(ge=10, le=1_000_000)] = 500
    pairs: Rising[Pairs] = ()
    disclosure: DisclosureText = "exact"
    rival: Rival | None = None

    @model_validator(mode="after")
    def _fits(self) -> Self:
        numbers = self.draws * self.repeats[-1]
        if numbers > _MOST_DRAWN:
            raise ValueError(
                f"{self.draws:,} draws of {self.repeats[-1]:,} decisions are {numbers:,}, expected at most {_MOST_DRAWN:,}"
            )
        return self


_MOST_NAMED = 2
"""Most decision makers that a summary names; beyond, it gives their number."""


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Saved):
    """Decision makers against observers at equal expected regret.

    Args:
        rows: One row per decision maker and budget; one row for a decision maker that spends nothing.
        left_out: Names of decision makers that do not suit the problem.
        budgets: Requested expected regrets, in the cost's unit.
        unit: Unit in which the budgets were given.
        repeats: Numbers of decisions under one belief.
        n_draws: Number of sampled sequences for them.
        n_beliefs: B, number of beliefs of the prior.
        n_candidates: M, number of distinct candidate decisions.
        prior_entropy: Entropy of the prior in bits, an upper bound of the leakage.
        prior_error: Error without decisions (root mean square), an upper bound for every rule.
        prior_top_state: Probability that an observer without decisions names a most likely state.
        silence_regret: r₀, in the cost's unit.
        mean_cost: E|c*| under the prior, in the cost's unit.
        per_belief_unit: Unit of budgets per belief: "|c*|", or "regret" where c* comes near zero.
        stays: Probability that the belief is the same at the next decision, by the chain; NaN without a chain.
        pairs: Numbers of pairs seen by the observer who has only data.
        disclosure: The disclosure of decisions to observers.
        secret_worth: Worth of the belief to the rival, in its own unit; NaN without a rival.
        prior_loss: The loss of the rival without any decision.
        rival: The unit of the rival's loss; empty without one.
        rival_is_own: Whether the rival has the agent's own problem; it can then always copy.

    Source: for each measure the function that computes it; the paper, Section V-B, for the trade-off.
    """

    rows: tuple[ComparisonRow, ...]
    left_out: tuple[str, ...]
    budgets: tuple[float, ...]
    unit: str
    repeats: tuple[int, ...]
    n_draws: int
    n_beliefs: int
    n_candidates: int
    prior_entropy: float
    prior_error: float
    prior_top_state: float
    silence_regret: float
    mean_cost: float
    per_belief_unit: str
    stays: float = float("nan")
    pairs: tuple[int, ...] = ()
    disclosure: str = "exact"
    secret_worth: float = float("nan")
    prior_loss: float = float("nan")
    rival: str = ""
    rival_is_own: bool = False

    @property
    def makers(self) -> tuple[str, ...]:
        """The decision makers' names, in order."""
        return tuple(dict.fromkeys(row.maker for row in self.rows))

    @property
    def middle_budget(self) -> float:
        """The middle budget, used in the summary and the terminal's table; the lower one of two."""
        return self.budgets[(len(self.budgets) - 1) // 2]

    @property
    def is_moving(self) -> bool:
        """Whether the comparison has a chain of the belief, so that an observer can follow it."""
        return any(np.isfinite(row.path_error) for row in self.rows)

    @property
    def ceilings(self) -> dict[float, float]:
        """Upper bounds of every rule's error over time, by expected regret, where known."""
        return {row.budget: row.path_ceiling for row in self.rows if np.isfinite(row.path_ceiling)}

    @property
    def is_learned(self) -> bool:
        """Whether the cost has a risk aversion, which an observer may not know."""
        return any(np.isfinite(row.learned_holds) for row in self.rows)

    def of(self, maker: str) -> tuple[ComparisonRow, ...]:
        """Return the rows of one decision maker, by ascending budget; raise `InputError` for an unknown name."""
        found = tuple(row for row in self.rows if row.maker == maker)
        if not found:
            raise InputError(f"no decision maker {maker!r}; there are {list(self.makers)}")
        return found

    def frame(self) -> pd.DataFrame:
        """Return all figures, one row per decision maker and budget, in the units of `ComparisonRow`."""
        return pd.DataFrame([self._flat(row) for row in self.rows])

    def _flat(self, row: ComparisonRow) -> dict[str, object]:
        values: dict[str, object] = {
            each.name: getattr(row, each.name)
            for each in fields(row)
            if not each.name.startswith(("repeated_", "data_"))
            and each.name != "told_errors"
            and (self.rival or each.name != "rival_worth")
        }
        for s, n in enumerate(self.repeats):
            values[f"bayes_error_after_{n}"] = float(row.repeated_errors[s])
            values[f"bayes_error_after_{n}_se"] = float(row.repeated_error_se[s])
            values[f"information_after_{n}"] = float(row.repeated_information[s])
            values[f"top_state_after_{n}"] = float(row.repeated_top_state[s])
            values[f"bayes_error_after_{n}_told"] = float(row.told_errors[s])
        for s, n in enumerate(self.pairs):
            values[f"data_error_of_{n}_pairs"] = float(row.data_errors[s])
        return values

    def header(self) -> str:
        """Return one sentence that states what every figure of the comparison is relative to."""
        share = f", {self.silence_regret / self.mean_cost:.1%} of E|c*|" if self.mean_cost > 0 else ""
        return (
            f"prior of {self.n_beliefs} beliefs, {self.prior_entropy:.2f} bits; {self.n_candidates} candidate decisions; "
            f"error without any decision {self.prior_error:.3f}; silence regret {self.silence_regret:.3g}{share}"
            f"{'' if self.disclosure == EXACT else f'; observers are shown {self.disclosure}'}"
        )

    def at(self, budget: float) -> tuple[ComparisonRow, ...]:
        """Return the rows of one budget, in the cost's unit, of all decision makers that spend anything."""
        return tuple(row for row in self.rows if row.budget == budget and row.maker not in SPENDS_NOTHING)

    def summary(self) -> str:
        """Return a few lines: which decision makers hide the belief from which observer, at the middle budget."""
        budget = self.middle_budget
        rows = self.at(budget)
        if not rows or not self.prior_error > 0:
            return "Nothing can be hidden: the prior determines the belief, or no decision maker spends anything."
        worth = (
            f"{budget / self.silence_regret:.0%} of the silence regret" if self.silence_regret > 0 else f"{budget:.3g}"
        )
        last = len(self.repeats) - 1
        seen: dict[str, Callable[[ComparisonRow], tuple[float, float]]] = {
            "naive observer, who takes decisions at face value": lambda row: (row.naive_error, row.naive_top_state),
            "aware observer, who knows the rule and the prior": lambda row: (row.bayes_error, row.top_state_accuracy),
        }
        if self.is_moving:
            following = (
                f"aware observer over time, on a chain where the belief stays the same in {self.stays:.0%} of the steps"
            )
            seen[following] = lambda row: (row.path_error, row.path_top_state)
        if self.repeats[last] > 1:
            later = f"aware observer, who sees {self.repeats[last]} decisions on one belief"
            later += " (the sequential rule assumes that chain)" if self.ceilings else ""
            seen[later] = lambda row: (float(row.repeated_errors[last]), float(row.repeated_top_state[last]))
        asked = Requirement(self.prior_error, self.prior_top_state)
        optimal = next((row for row in self.rows if row.maker in SPENDS_NOTHING), None)
        hiding, unjudged, told = [], [], []
        for who, figures in seen.items():
            reached = [Reached(row.maker, *figures(row)) for row in rows]
            unprotected = None if optimal is None else Reached("optimal decisions", *figures(optimal))
            if unprotected is not None and asked.is_met(unprotected):
                unjudged.append(f"the {_short(who)}")
            else:
                names = [each.name for each in reached if asked.is_met(each)]
                hiding.append(f"from the {_short(who)} by {_few(names, len(rows))}")
            told.append(f"Hidden from the {who}: {asked.judge(reached, unprotected)}.")
        short = [f"the belief is hidden {', '.join(hiding)}"] if hiding else []
        short += [f"hiding the belief from {listed(unjudged)} cannot be judged"] if unjudged else []
        lines = [
            f"In short: at an expected regret of {worth} {'; '.join(short)}.",
            *told,
            asked.meaning(without="decisions", state="state", cases="the cases"),
            self.sensor_summary(),
            self.rival_summary(),
            *self._cautions(),
        ]
        return "\n".join(filter(None, lines))

    def _cautions(self) -> list[str]:
        """Return cautions about budgets above the silence regret."""
        if not self.silence_regret > 0:
            return []
        shares = [budget / self.silence_regret for budget in self.budgets]
        above = [SilenceShare(share) for share in shares if share > 1.0 + tolerances.NO_REGRET]
        return [line for each in above for line in remarks_of(each)]

    def sensor_summary(self) -> str:
        """Return how well the sensor can be estimated from decisions, at the middle budget, as text."""
        rows = [row for row in self.rows if row.budget in (0.0, self.middle_budget) and np.isfinite(row.sensor_error)]
        if not rows:
            return ""
        kept = [row.maker for row in rows if row.sensor_error >= 1.0]
        told = (
            f"The naive observer estimates the sensor from {SENSOR_STEPS} decisions with an error "
            f"{_range(rows, 'sensor_error', '{:.2f} ({})'.format, 'of ')} times the error without decisions"
        )
        return (
            f"{told}; {listed(kept)} {'hides' if len(kept) == 1 else 'hide'} it."
            if kept
            else f"{told}; no rule hides it."
        )

    def rival_summary(self) -> str:
        """Return the rival's worth of the belief and of one decision, and the cost of hiding, at the middle budget, as text."""
        rows = self.at(self.middle_budget)
        if not self.rival or not rows:
            return ""
        if not self.secret_worth > 0:
            return "The belief is worth nothing to this rival, nor is any decision."

        def worth(amount: float, makers: str) -> str:
            return f"{amount:.3g} ({makers}, {amount / self.secret_worth:.0%})"

        told = (
            f"The belief is worth {self.secret_worth:.3g} ({self.rival}) to the rival; one decision, at a regret of up to "
            f"{self.middle_budget:.3g} for the agent, is worth {_range(rows, 'rival_worth', worth)}."
        )
        if self.rival_is_own:
            told += (
                " The rival's problem is the agent's own, so it can always copy: the shares of regret and of worth sum to at "
                "least 1."
            )
        return told

    def __repr__(self) -> str:
        return f"{self.header()}\n{self.summary()}"


def _range(rows: Sequence[ComparisonRow], figure: str, text: Callable[[float, str], str], if_one: str = "") -> str:
    """Return the least and the largest figure with their makers, as `text` writes them; one text where all are equal."""
    least, most = (pick(rows, key=lambda row: getattr(row, figure)) for pick in (min, max))
    if least is most:
        return if_one + text(getattr(least, figure), listed([row.maker for row in rows]))
    return f"from {text(getattr(least, figure), least.maker)} to {text(getattr(most, figure), most.maker)}"


def _short(observer: str) -> str:
    """Return an observer's name without the clause on its knowledge."""
    name, _, knows = observer.partition(", ")
    sees = knows.partition(",")[0].partition(" (")[0].removeprefix("who ")
    return f"{name} who {sees}" if sees.startswith("sees") else name


def _few(names: Sequence[str], n: int) -> str:
    """Return which of n decision makers hide a belief, as text: up to two names, otherwise a number."""
    if len(names) > _MOST_NAMED:
        return f"{len(names)} of {n} decision makers"
    return " and ".join(names) or "none"


def compare(
    problem: DecisionProblem,
    prior: Prior | BeliefChain,
    settings: ComparisonSettings | None = None,
    *,
    makers: Mapping[str, Maker] | None = None,
    candidates: Candidates | None = None,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Comparison:
    """Compare decision makers against observers at equal expected regret under a prior.

    Every decision maker spends the same expected regret under the prior, to a millionth from below; a budget per belief is
    scaled to that. A decision maker that finds nothing more private spends less; its row states how much.

    Args:
        problem: The decision problem.
        prior: The law of the private belief, known to the observers who use one; or a `BeliefChain`, which also has the
            transition of the belief; delayed and partial trading need one.
        settings: Budgets and numbers of repeated decisions; None: the defaults.
        makers: Functions (setting, regret) -> `experiments.setting.Behaviour` by name; None: all of `COMPARED` (rules with a
            memory need a chain).
        candidates: Candidate decisions; None: a grid of about as many decoys as the prior has beliefs, and silence.
        rng: Source of the sampled sequences of repeated decisions, the same for every row.
        progress: Called with (rows done, rows in all).

    Returns:
        A `Comparison`; the same arguments and seed give the same numbers.

    Raises:
        InputError: An argument is malformed, or the prior has another number of states than the problem.

    Cost: for 500 beliefs and 500 candidates some seconds per decision maker and budget; for the sequential rule up to a minute.

    Source: each measure's own; see `ComparisonRow`.

    Example:
        >>> from inscrutable import MarkowitzProblem, uniform_prior
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> settings = ComparisonSettings(budgets=(0.5,), repeats=(1,), draws=10)
        >>> found = compare(problem, uniform_prior(2, 4), settings, rng=np.random.default_rng(0))
        >>> found.makers[:3], round(found.of("ODM")[0].bayes_error, 6)
        (('ODM', 'CDM', 'PDM'), 0.0)
    """
    source = validation.generator(rng)
    setting = Setting.of(problem, prior, candidates)
    known = makers_of(COMPARED, setting) if makers is None else checked_makers(makers)
    tasks = ComparisonTasks(setting, ComparisonSettings() if settings is None else settings, known)
    rows, seed = [], cast(np.random.SeedSequence, source.spawn(1)[0].bit_generator.seed_seq)
    with threadpool_limits(limits=1):  # many small products: threads would slow them down and change last digits
        for done, (name, budget) in enumerate(tasks.pairs):
            # One seed for all rows: none depends on which others there are.
            same = np.random.SeedSequence(seed.entropy, spawn_key=seed.spawn_key)
            row = tasks.row(name, budget, rng=np.random.default_rng(same))
            if row is not None:
                rows.append(row)
            if progress is not None:
                progress(done + 1, len(tasks.pairs))
    return tasks.comparison(rows)


@dataclass(frozen=True, eq=False)
class ComparisonTasks:
    """The tasks of a comparison: a row for every decision maker and budget on one setting, and the result of all rows."""

    setting: Setting
    settings: ComparisonSettings
    makers: Mapping[str, Maker]

    def __post_init__(self) -> None:
        shown = Disclosure.of(self.settings.disclosure)
        object.__setattr__(self, "setting", replace(wanting(self.setting, self.settings.rival), disclosure=shown))

    @cached_property
    def budgets(self) -> tuple[float, ...]:
        """Expected regrets, in the cost's unit."""
        unit = self.setting.unit(self.settings.unit)
        return tuple(unit * share for share in self.settings.budgets)

    @cached_property
    def pairs(self) -> list[tuple[str, float]]:
        """Every decision maker with its budgets, in the cost's unit."""
        return pairs_of(self.makers, self.budgets)

    def row(self, name: str, budget: float, *, rng: np.random.Generator) -> ComparisonRow | None:
        """Return the figures of one task; None if the decision maker does not suit the problem."""
        behaviour = self.makers[name](self.setting, budget)
        shown = self.setting.disclosure
        if behaviour is None or (behaviour.memory is not None and not shown.is_exact):
            return None
        observed = Observed(self.setting, behaviour._replace(asked=budget), detects=True)
        row = measured(name, observed, (self.settings.repeats, self.settings.draws), shown, rng=rng)
        if not self.settings.pairs:
            return row
        return replace(row, data_errors=learned_from_data(observed, self.settings.pairs, shown))

    def comparison(self, rows: Sequence[ComparisonRow]) -> Comparison:
        """Return the comparison of these rows, in the order of the tasks."""
        setting, prior = self.setting, self.setting.prior
        return Comparison(
            rows=tuple(rows),
            left_out=tuple(name for name in self.makers if all(row.maker != name for row in rows)),
            budgets=self.budgets,
            unit=self.settings.unit,
            repeats=self.settings.repeats,
            n_draws=self.settings.draws,
            n_beliefs=int(np.count_nonzero(prior.weights)),
            n_candidates=len(setting.candidates.distinct),
            prior_entropy=prior.entropy,
            prior_error=prior.error,
            prior_top_state=min(float((prior.weights @ top_states(prior.beliefs)).max()), 1.0),
            silence_regret=setting.silence_regret,
            mean_cost=setting.mean_cost,
            per_belief_unit="|c*|" if setting.is_relative else "regret",
            pairs=self.settings.pairs,
            stays=np.nan if setting.chain is None else float(prior.weights @ setting.chain.transition.diagonal()),
            disclosure=self.settings.disclosure,
            **self._rival(),
        )

    def _rival(self) -> dict[str, Any]:
        """Return the worth of the belief to the rival, and its loss without decisions."""
        loss, prior = self.setting.loss, self.setting.prior
        if loss is None:
            return {}
        known = leakage(self.setting.optimal, prior, loss=loss)
        own = is_own(loss, self.setting.problem)
        return {
            "secret_worth": known.secret_worth,
            "prior_loss": known.prior_loss,
            "rival": loss.unit,
            "rival_is_own": own,
        }


COMPARED: Mapping[str, Mapping[str, Any]] = {
    **{name: {"name": name} for name in ("ODM", "CDM", "PDM")},
    "CDM, candidates only": {"name": "CDM", "method": "candidates"},
    "PDM, candidates only": {"name": "PDM", "method": "candidates"},
    "rate-distortion": {"name": "rate-distortion"},
    # A proof gap of one per cent of the squared error affects no figure visibly.
    "Stackelberg": {"name": "Stackelberg", "gap": 0.02},
    **{name: {"name": name} for name in ("uniform", "exponential", "coin")},
    "Dirichlet noise": {"name": "Dirichlet noise", "draws": 200},
    **{name: {"name": name} for name in ("rounding", "delay", "partial trades")},
    # Trying other prices of information would take several times as long.
    "sequential": {"name": "sequential", "information_price": float("inf")},
}
"""Default decision makers of a comparison: names of rows, with the keys of the registry."""

SPENDS_NOTHING = ("ODM",)
"""Decision makers of zero expected regret at every budget: they have one row."""


def makers_named(text: str) -> tuple[str, ...]:
    """Return the names in a text such as "CDM,PDM,rate-distortion", or raise `InputError` for one that `COMPARED` lacks.

    Args:
        text: Names separated by commas; a known name that contains a comma counts as one.
    """
    parts, names = [part.strip() for part in text.split(",")], []
    while parts:
        taken = 2 if ", ".join(parts[:2]) in COMPARED else 1
        names.append(", ".join(parts[:taken]))
        del parts[:taken]
    refuse_unknown(names)
    if len(set(names)) < len(names):
        raise InputError(f"decision makers {text}: {max(names, key=names.count)} is named more than once")
    return tuple(names)


def refuse_unknown(names: Iterable[str]) -> None:
    """Raise `InputError` for the first name that is not in `COMPARED`."""
    for name in names:
        if name not in COMPARED:
            hint = nearest(name, COMPARED) or f"; expected some of {', '.join(COMPARED)}"
            raise InputError(f"there is no decision maker {name!r}{hint}")


def makers_of(names: Iterable[str], setting: Setting | None = None) -> dict[str, Maker]:
    """Return makers of `COMPARED` by name; for a setting without a chain, those that need one are left out."""

    def maker(chosen: Mapping[str, Any]) -> Maker:
        kind = MAKERS[chosen["name"]]

        def made(setting: Setting, regret: float) -> Behaviour | None:
            if not kind.suits(setting):
                return None
            limit = setting.budget(regret) if kind.takes_budget(chosen) else None
            return behave(setting, chosen, limit, regret=regret, seed=lambda: np.random.default_rng(0))

        return made

    still = setting is not None and setting.chain is None
    moving = ("delay", "partial trades", "sequential")
    return {name: maker(COMPARED[name]) for name in names if not (still and name in moving)}


def checked_makers(makers: Mapping[str, Maker]) -> dict[str, Maker]:
    """Return the makers by name, or raise `InputError`."""
    chosen = dict(makers)
    if not chosen or not all(isinstance(name, str) and callable(make) for name, make in chosen.items()):
        raise InputError(
            "makers must be a mapping from names to functions (setting, regret) -> Behaviour, with one at least"
        )
    return chosen


def pairs_of(makers: Iterable[str], budgets: Sequence[float]) -> list[tuple[str, float]]:
    """Return every pair of decision maker and budget; a decision maker that spends nothing comes once."""
    return [(name, budget) for name in makers for budget in ((0.0,) if name in SPENDS_NOTHING else budgets)]
