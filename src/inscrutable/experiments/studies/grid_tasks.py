"""The runner of a grid: what tasks of the same market share is made once, and kept while it is needed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from inscrutable.decision_makers import Candidates, action_grid, decoy_grid
from inscrutable.decision_makers.candidate_sources import as_candidates
from inscrutable.errors import ModelError
from inscrutable.experiments.makers import behave
from inscrutable.experiments.measures import figures_of
from inscrutable.experiments.observers import Observed
from inscrutable.experiments.random_markets import WARM_UP
from inscrutable.experiments.rivals import wanting
from inscrutable.experiments.setting import Setting, path_prior
from inscrutable.experiments.studies.extensions import from_text
from inscrutable.experiments.studies.grid import PER_MARKET, StudyGrid
from inscrutable.experiments.studies.layout import GivenWorld, follows
from inscrutable.experiments.studies.own_parts import OwnProblem, OwnWorld, layout_with
from inscrutable.experiments.studies.tasks import Task, TaskRunner, Work
from inscrutable.experiments.studies.worlds import (
    Regimes,
    drawn_world,
    given_world,
    network_of,
    own_problem,
    own_world,
    problem_of,
    regimes_of,
    with_public,
)
from inscrutable.filtering import filter_beliefs
from inscrutable.mechanisms import Prior, filtered_prior, uniform_prior
from inscrutable.mechanisms.chains import BeliefChain, filtered_chain
from inscrutable.problems import DecisionProblem
from inscrutable.worlds import HiddenMarkovModel

BELIEFS = ("world", "problem", "beliefs", "repeat")
"""The parts that determine the law of beliefs."""
_SETTINGS_KEPT = 4
_OBSERVED_KEPT = 2  # tasks that differ in the observer alone follow one another


class GridRunner(TaskRunner):
    """Does the tasks of a grid."""

    grid: StudyGrid

    def __init__(self, work: Work) -> None:
        self.study = layout_with(from_text(work.extensions)).model_validate_json(work.study)
        self.grid = StudyGrid(self.study, work.data_hash)
        prepared, own = json.loads(work.worlds), getattr(self.study.problem, "network", None)
        self._network = None if own is None else network_of(prepared[0])
        self._fitted = [HiddenMarkovModel.from_dict(world) for world in prepared] if own is None else []
        self.setting = lru_cache(_SETTINGS_KEPT)(self._setting)
        self.observed = lru_cache(_OBSERVED_KEPT)(self._observed)

    def figures(self, task: Task) -> dict[str, float]:
        """Return the measures of one mechanism against one observer."""
        observer = self.grid.adversaries[task.places[-1]].data
        assert observer is not None
        return figures_of(
            self.observed(task.places[:-1]),
            observer,
            self.study.measures,
            observers=self.study.observer_kinds,
            kinds=self.study.measure_kinds,
        )

    def _observed(self, places: tuple[int, ...]) -> Observed:
        setting = self.setting(places[:5])
        maker, budget = self.grid.plays[places[5]]
        whole = (*places, 0)

        def seed() -> np.random.Generator:
            return self.grid.stream("decisions", whole, (*PER_MARKET, "decision_maker", "budget"))

        assert maker.data is not None
        chosen = budget.data
        limit = None if chosen is None else setting.budget_of(chosen)
        found = behave(
            setting,
            maker.data,
            limit,
            each=chosen is not None and chosen["hold"] == "each",
            seed=seed,
            kinds=self.study.maker_kinds,
        )
        if found is None:
            raise ModelError(f"the decision maker {maker.data['name']!r} does not suit this problem")
        return Observed(setting, found)

    def _setting(self, places: tuple[int, ...]) -> Setting:
        whole = (*places, 0, 0)
        regimes = self._regimes(whole)
        section = self.grid.problems[places[1]].data
        assert section is not None
        asked: Any = self.study.problem
        if isinstance(asked, OwnProblem):
            problem = own_problem(asked.extension, section, regimes)
        else:
            problem = problem_of(section, regimes, self._network)
        candidates = self._candidates(places[3], problem)
        if not follows(self.study):
            return wanting(Setting(problem, self._prior(whole, regimes, problem), candidates), self.study.rival)
        chain = self._chain(whole, regimes, None)
        moving = Setting(
            problem, chain.prior, candidates, chain, read=lambda public: self._chain(whole, regimes, public)
        )
        return wanting(moving, self.study.rival)

    def _chain(self, places: Sequence[int], regimes: Regimes, public: str | int | None) -> BeliefChain:
        """Return the chain of the belief, with or without a public return; its law is the setting's prior."""
        section = self.grid.beliefs[places[2]].data
        assert section is not None
        assert regimes.world is not None
        world, cuts = (regimes.world, None) if public is None else with_public(regimes.world, public)
        rng = self.grid.stream("beliefs", places, BELIEFS)
        return filtered_chain(world, section["resolution"], rng=rng, cuts=cuts)

    def _regimes(self, places: Sequence[int]) -> Regimes:
        world: Any = self.study.world  # or one of a user's own
        if isinstance(world, GivenWorld):
            return given_world(world)
        if isinstance(world, OwnWorld):
            chosen = self.grid.worlds[places[0]].data
            assert chosen is not None
            return own_world(world.extension, chosen)
        if self._fitted:
            return regimes_of(self._fitted[places[0]])
        law, problem = self.grid.worlds[places[0]].data, self.grid.problems[places[1]].data
        assert law is not None
        assert problem is not None
        rng = self.grid.stream("world", places, ("world", "repeat"))
        # A user-defined problem has none, and takes the regimes alone.
        return drawn_world({"risk_aversion": problem.get("risk_aversion", 1.0), **law}, rng=rng)

    def _prior(self, places: Sequence[int], regimes: Regimes, problem: DecisionProblem) -> Prior:
        section = self.grid.beliefs[places[2]].data
        assert section is not None
        if section["kind"] == "grid":
            return uniform_prior(problem.n_states, section["resolution"])
        assert regimes.world is not None
        rng = self.grid.stream("beliefs", places, BELIEFS)
        if section["kind"] == "stationary":
            return filtered_prior(regimes.world, section["resolution"], rng=rng)
        path = regimes.world.sample(WARM_UP + section["steps"], rng=rng)
        held = np.asarray(filter_beliefs(regimes.world, path.observations).beliefs)[WARM_UP:]
        return path_prior(held)

    def _candidates(self, place: int, problem: DecisionProblem) -> Candidates:
        section = self.grid.candidates[place].data
        assert section is not None
        if "resolution" not in section:
            return as_candidates(problem, None)
        make = action_grid if section["kind"] == "actions" else decoy_grid
        return make(problem, section["resolution"])
