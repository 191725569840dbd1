"""Masked baskets as a study: one task is one kind of disclosure of some funds."""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.experiments.masked_baskets import MaskedBasketFile, errors_by_day, reported, slope_of
from inscrutable.experiments.studies.kind import Kind
from inscrutable.experiments.studies.tasks import Listed, Task, TaskRunner, Work


def shown_tasks(plan: MaskedBasketFile, data_hash: str | None = None) -> Listed:
    """Return the tasks: each kind of disclosure in every repeat."""
    kept = plan.model_dump(mode="json", exclude={"kind", "name", "note", "seed", "shown", "repeats"})

    def named(number: int) -> dict[str, Any]:
        shown, repeat = divmod(number, plan.repeats)
        return {"shown": plan.shown[shown], "repeat": repeat, **kept}

    return Listed(len(plan.shown) * plan.repeats, named, plan.seed)


class MaskedBasketRunner(TaskRunner):
    """Does the tasks."""

    def __init__(self, work: Work) -> None:
        self.plan = MaskedBasketFile.model_validate_json(work.study)
        self.grid = shown_tasks(self.plan)

    def figures(self, task: Task) -> dict[str, float]:
        """Return the slope and the error after the reported days."""
        rng = np.random.default_rng(self.grid.task_seed(task))
        errors = errors_by_day(self.plan, self.plan.shown[task.number // self.plan.repeats], rng)
        return {
            "slope": slope_of(errors),
            **{f"error_after_{day}": float(errors[day - 1]) for day in reported(self.plan)},
        }


MASKED_BASKET = Kind(MaskedBasketFile, shown_tasks, MaskedBasketRunner, has_page=False)
"""Studies of funds that publish masked baskets."""
