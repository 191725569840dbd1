"""What is measured of a task: figures of a mechanism against one observer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from inscrutable.adversaries import Adversary, BudgetAwareAdversary, NaiveAdversary, NearOptimalAdversary
from inscrutable.budgets import Budget
from inscrutable.experiments.guesses import guess_error, guesses_of, naive_privacy, top_state_share
from inscrutable.experiments.studies.makers import StudyPlay, StudySetting
from inscrutable.mechanisms.joint import Joint, joint_law
from inscrutable.privacy import Detectability, Leakage, detectability, leakage

_OF_LEAKAGE = {
    "expected_regret": "expected_regret",
    "worst_regret": "worst_regret",
    "silence_share": "silence_share",
    "mutual_information": "mutual_information",
    "min_entropy_leakage": "min_entropy_leakage",
    "maximal_leakage": "maximal_leakage",
    "prior_error": "prior_error",
    "prior_entropy": "prior_entropy",
    "prior_top_state": "prior_top_state_accuracy",
    "n_actions": "n_actions",
}
_OF_DETECTABILITY = ("implausible_share", "expected_gap", "read_auc")


class JudgedPlay:
    """A mechanism in a setting, measured once whatever number of observers look at it."""

    def __init__(self, setting: StudySetting, play: StudyPlay) -> None:
        self.setting = setting
        self.play = play

    @cached_property
    def joint(self) -> Joint:
        """The joint law of belief and decision."""
        return joint_law(self.play.mechanism, self.setting.prior)

    @cached_property
    def leakage(self) -> Leakage:
        """What one decision tells."""
        return leakage(self.play.mechanism, self.setting.prior, self.setting.problem)

    @cached_property
    def detectability(self) -> Detectability:
        """Whether it is seen that something is hidden."""
        return detectability(self.play.mechanism, self.setting.prior, self.setting.problem)

    @cached_property
    def naive_privacy(self) -> float:
        """Mean distance of the belief from Π(u) over decisions that some belief explains; NaN without any."""
        return naive_privacy(self.setting.problem, self.play.mechanism.actions, self.joint)

    def figures(self, observer: Mapping[str, Any], measures: Sequence[str]) -> dict[str, float]:
        """Return the figures asked for, by name, with one observer's error where it is among them."""
        found: dict[str, float] = {}
        if "error" in measures or "top_state" in measures:
            found["error"], found["top_state"] = self._read_by(observer)
        return {name: found[name] if name in found else self._figure(name) for name in measures}

    def _figure(self, name: str) -> float:
        if name in _OF_LEAKAGE:
            return float(getattr(self.leakage, _OF_LEAKAGE[name]))
        if name in _OF_DETECTABILITY:
            return float(getattr(self.detectability, name))
        if name == "cost_share":
            mean = self.setting.mean_cost
            return self.leakage.expected_regret / mean if mean > 0 else float("nan")
        assert name == "naive_privacy"
        return self.naive_privacy

    def _read_by(self, observer: Mapping[str, Any]) -> tuple[float, float]:
        """An observer's root mean square error, and how often it names a most likely state."""
        if observer["name"] == "bayesian":
            return self.leakage.bayes_error, self.leakage.top_state_accuracy
        guesses = guesses_of(self._observer(observer), self.play.mechanism.actions, self.joint)
        return guess_error(self.joint, guesses), top_state_share(self.joint, guesses)

    def _observer(self, data: Mapping[str, Any]) -> Adversary:
        problem, prior = self.setting.problem, self.setting.prior
        if data["name"] == "naive":
            return NaiveAdversary(problem)
        if data["name"] == "near-optimal":
            asked = self.play.asked
            spent = self.leakage.expected_regret if asked is None else asked
            return NearOptimalAdversary(problem, data.get("regret", spent), prior=prior)
        promise = self.play.promise
        return BudgetAwareAdversary(
            problem, Budget.regret(self.leakage.worst_regret) if promise is None else promise, prior=prior
        )
