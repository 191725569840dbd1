"""The inverse filter under a disclosure: parts of decisions, at some steps, with a delay."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.adversaries.decision_tables import DecisionTables, checked_rule
from inscrutable.adversaries.inverse_filter import ForwardPass, InverseFilter
from inscrutable.adversaries.sequence_evidence import Evidence, impossible_step
from inscrutable.adversaries.sequence_results import SequenceStatus
from inscrutable.axes import Axis
from inscrutable.errors import InputError
from inscrutable.mechanisms.disclosed import checked_for, disclosed, disclosed_rule
from inscrutable.mechanisms.disclosures import Disclosure
from inscrutable.mechanisms.memory import with_memory
from inscrutable.validation import Array


class ShownSteps:
    """A mechanism under a disclosure, for an observer of sequences.

    Args:
        given: A mechanism, with or without memory, or a rule.
        disclosure: What is disclosed of its decisions.

    Raises:
        InputError: `given` is no mechanism or rule, or the disclosure does not suit it.
    """

    def __init__(self, given: Any, disclosure: Disclosure) -> None:
        self.disclosure, self.rule = disclosure, checked_rule(given)
        self._mechanism = checked_for(given, disclosure)
        if disclosure.maps and not disclosure.needs_returns:
            self.rule = checked_rule(disclosed_rule(given, disclosure))

    @property
    def actions(self) -> Any:
        """An example of a disclosed value; None where it is not known yet."""
        return np.zeros((1, 1)) if self.disclosure.needs_returns else getattr(self.rule.given, "actions", None)

    def decided(self, shown: Array) -> Array:
        """Return the disclosed value of each step's decision (T,V), from the values by step of disclosure.

        Raises:
            InputError: Something is shown where the disclosure shows nothing.
        """
        schedule = self.disclosure.schedule
        if schedule.is_immediate:
            return shown
        lag, found = schedule.lag, np.full(shown.shape, np.nan)
        for t in np.flatnonzero(~np.isnan(shown[:, 0])):
            if t < lag or not schedule.shows(int(t) - lag):
                raise InputError(
                    f"actions row {t} has numbers, but {self.disclosure} shows nothing at step {t}: pass what it shows, "
                    "disclosure(actions)"
                )
            found[t - lag] = shown[t]
        return found

    def tables(self, returns: ArrayLike | None, n_steps: int, steps: Axis) -> list[DecisionTables] | None:
        """Return the decision tables of each step under the returns (T,U); None where they are the same at every step.

        Raises:
            InputError: Returns are missing, not needed, or of another shape.
        """
        self.disclosure.check_returns(returns)
        if returns is None:
            return None
        held = validation.finite_array(returns, "returns", ndim=2, axes=(steps, Axis("asset")))
        if len(held) != n_steps:
            raise InputError(f"returns has {len(held)} rows, expected one a decision: {n_steps}")
        return [DecisionTables(with_memory(disclosed(self._mechanism, self.disclosure, row))) for row in held]

    def late(self, reader: InverseFilter, evidence: Evidence, passed: ForwardPass) -> ForwardPass:
        """Return the law of each step's belief given the decisions shown with the schedule's lag.

        Evidence of the state has no lag; `passed` contains the laws given it.
        """
        lag, n_steps = self.disclosure.schedule.lag, len(evidence)
        found = replace(
            passed,
            beliefs=np.empty_like(passed.beliefs),
            states=np.empty_like(passed.states),
            errors=np.empty_like(passed.errors),
            statuses=(*[SequenceStatus.UNSEEN] * min(lag, n_steps), *passed.statuses[: max(n_steps - lag, 0)]),
        )
        sums = np.concatenate(
            [[0.0], np.cumsum(np.where(np.isfinite(passed.log_likelihood), passed.log_likelihood, 0.0))]
        )
        totals = np.empty(n_steps)
        for t in range(n_steps):
            s = t - lag
            laws, error, total = (None, 0.0, 0.0) if s < 0 else (passed.laws[s], passed.errors[s], sums[s + 1])
            for step in range(max(s + 1, 0), t + 1):
                laws, more = reader.predicted(laws, read=evidence.read_at(step))
                laws = laws._replace(weights=laws.weights * evidence.states[step][:, None, None])
                weight = laws.totals()
                if not weight[0] > 0:
                    raise impossible_step(step)
                laws, error, total = (
                    laws.divided(weight),
                    error + more[0],
                    total + np.log(weight[0]) + evidence.offsets[step],
                )
            assert laws is not None
            found.beliefs[t], found.states[t] = laws.of_belief()[0], laws.of_state()[0]
            found.errors[t], totals[t] = error, total
        # A decision of probability zero was skipped: its step keeps the log-likelihood −inf.
        logs = np.diff(totals, prepend=0.0)
        passed_over = np.flatnonzero(np.isinf(passed.log_likelihood[: max(n_steps - lag, 0)])) + lag
        logs[passed_over] = -np.inf
        return replace(found, log_likelihood=logs)
