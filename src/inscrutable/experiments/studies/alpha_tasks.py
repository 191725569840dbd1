"""Private alphas as a study: one task is one rule at one budget in one market."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from inscrutable.experiments.alpha_study import AlphaStudyFile, figures_of
from inscrutable.experiments.studies.kind import Kind
from inscrutable.experiments.studies.tasks import Listed, Task, TaskRunner, Work

_SWEPT = ("objectives", "budgets", "persistence")


def rule_tasks(plan: AlphaStudyFile, data_hash: str | None = None) -> Listed:
    """Return the tasks: each rule at each budget and persistence in every repeat."""
    kept = plan.model_dump(mode="json", exclude={"kind", "name", "note", "seed", "repeats", *_SWEPT})
    swept = list(product(*(getattr(plan, key) for key in _SWEPT)))

    def named(number: int) -> dict[str, Any]:
        place, repeat = divmod(number, plan.repeats)
        objective, budget, persistence = swept[place]
        return {"objective": objective, "budget": budget, "persistence": persistence, "repeat": repeat, **kept}

    return Listed(len(swept) * plan.repeats, named, plan.seed)


class AlphaRunner(TaskRunner):
    """Does the tasks."""

    def __init__(self, work: Work) -> None:
        self.plan = AlphaStudyFile.model_validate_json(work.study)
        self.grid = rule_tasks(self.plan)

    def figures(self, task: Task) -> dict[str, float]:
        """Return the regret and the leakage of one rule; all rules of a repeat are in the same market."""
        of = task.parameters
        seeds = np.random.SeedSequence([self.plan.seed, of["repeat"]]), self.grid.task_seed(task)
        return figures_of(self.plan, of["persistence"], of["budget"], of["objective"], seeds)


ALPHAS = Kind(AlphaStudyFile, rule_tasks, AlphaRunner, has_page=False)
"""Studies of private alphas over budgets."""
