"""Where tasks are done: what tasks of the same market share is made once and kept while it is needed."""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from inscrutable.decision_makers import Candidates, action_grid, decoy_grid
from inscrutable.decision_makers.candidates import as_candidates
from inscrutable.errors import InscrutableError
from inscrutable.experiments.random_markets import WARM_UP
from inscrutable.experiments.studies.figures import JudgedPlay
from inscrutable.experiments.studies.grid import PER_MARKET, StudyGrid, Task, TaskGrid
from inscrutable.experiments.studies.layout import GivenWorld, StudyFile
from inscrutable.experiments.studies.makers import StudySetting, play
from inscrutable.experiments.studies.markets import Regimes, drawn_world, given_world, problem_of, regimes_of
from inscrutable.experiments.studies.seeds import seed_numbers
from inscrutable.filtering import filter_beliefs
from inscrutable.mechanisms import Prior, filtered_prior, uniform_prior
from inscrutable.problems import DecisionProblem
from inscrutable.worlds import HiddenMarkovModel

DONE, FAILED = "done", "failed"
_SETTINGS_KEPT = 4
_PLAYS_KEPT = 2  # tasks that differ in the observer alone follow one another
_SECONDS_FOR_INTERRUPT = 0.1
_ENCODER = json.JSONEncoder(separators=(",", ":"), allow_nan=False)


class Work(NamedTuple):
    """What a process needs to know of a study in order to do its tasks, as texts that any machine can read.

    Args:
        study: The study as JSON.
        data_hash: Hash of the data that worlds were fitted to, or None.
        worlds: Fitted worlds as JSON, by the place of the choice.
    """

    study: str
    data_hash: str | None
    worlds: str


class Row(NamedTuple):
    """One task done, as it is stored."""

    number: int
    task: str
    parameters: str
    seed: str
    status: str
    figures: str
    duration: float
    error: str


class Done(NamedTuple):
    """What came of one task. Rows are made of many at once: in between two tasks the same work takes four times as long."""

    task: Task
    status: str
    figures: dict[str, float]
    duration: float
    error: str


class Shop(ABC):
    """Does the tasks of one study, of whatever kind."""

    grid: TaskGrid

    @abstractmethod
    def figures(self, task: Task) -> dict[str, float]:
        """Return the figures of one task, by name."""

    def done(self, number: int) -> Done:
        """Do one task; one that fails says why."""
        started = time.perf_counter()
        task = self.grid.task(number)
        status, error, found = DONE, "", {}
        try:
            found = self.figures(task)
        except InscrutableError as reason:
            status, error = FAILED, f"{type(reason).__name__}: {reason}"
        except Exception as reason:
            _pass_interrupt(reason)
            status, error = FAILED, f"unexpected {type(reason).__name__}: {reason}"
        taken = time.perf_counter() - started
        return Done(task, status, found, taken, error)

    def rows(self, done: Sequence[Done]) -> list[Row]:
        """Return the rows of tasks: what came of them, with their identities and seeds."""
        keys = [each.task.key for each in done]
        seeds = self.seeds([each.task for each in done], keys)
        figures = [figures_text(each.figures) for each in done]
        return [
            Row(each.task.number, key, each.task.text, str(seed), each.status, text, each.duration, each.error)
            for each, key, seed, text in zip(done, keys, seeds, figures, strict=True)
        ]

    def seeds(self, tasks: Sequence[Task], keys: Sequence[str]) -> list[int]:
        """Return the child seed of each task as one number."""
        return [int(self.grid.task_seed(task).generate_state(1, np.uint64)[0]) for task in tasks]


class Workshop(Shop):
    """Does the tasks of a grid."""

    grid: StudyGrid

    def __init__(self, work: Work) -> None:
        self.study = StudyFile.model_validate_json(work.study)
        self.grid = StudyGrid(self.study, work.data_hash)
        self._fitted = [HiddenMarkovModel.from_dict(world) for world in json.loads(work.worlds)]
        self.setting = lru_cache(_SETTINGS_KEPT)(self._setting)
        self.judged = lru_cache(_PLAYS_KEPT)(self._judged)

    def seeds(self, tasks: Sequence[Task], keys: Sequence[str]) -> list[int]:
        """Return the child seed of each task as one number, for all at once."""
        return seed_numbers(self.study.seed, keys)

    def figures(self, task: Task) -> dict[str, float]:
        """Return the measures of one mechanism against one observer."""
        observer = self.grid.adversaries[task.places[-1]].data
        assert observer is not None
        return self.judged(task.places[:-1]).figures(observer, self.study.measures)

    def _judged(self, places: tuple[int, ...]) -> JudgedPlay:
        setting = self.setting(places[:5])
        maker, budget = self.grid.plays[places[5]]
        whole = (*places, 0)

        def seed() -> np.random.Generator:
            return self.grid.stream("decisions", whole, (*PER_MARKET, "decision_maker", "budget"))

        assert maker.data is not None
        return JudgedPlay(setting, play(setting, maker.data, budget.data, seed=seed))

    def _setting(self, places: tuple[int, ...]) -> StudySetting:
        whole = (*places, 0, 0)
        regimes = self._regimes(whole)
        section = self.grid.problems[places[1]].data
        assert section is not None
        problem = problem_of(section, regimes)
        prior = self._prior(whole, regimes, problem)
        return StudySetting(problem, prior, self._candidates(places[3], problem))

    def _regimes(self, places: Sequence[int]) -> Regimes:
        world = self.study.world
        if isinstance(world, GivenWorld):
            return given_world(world)
        if self._fitted:
            return regimes_of(self._fitted[places[0]])
        law, problem = self.grid.worlds[places[0]].data, self.grid.problems[places[1]].data
        assert law is not None
        assert problem is not None
        rng = self.grid.stream("world", places, ("world", "repeat"))
        return drawn_world(law, problem["risk_aversion"], rng=rng)

    def _prior(self, places: Sequence[int], regimes: Regimes, problem: DecisionProblem) -> Prior:
        section = self.grid.beliefs[places[2]].data
        assert section is not None
        if section["kind"] == "grid":
            return uniform_prior(problem.n_states, section["resolution"])
        assert regimes.world is not None
        rng = self.grid.stream("beliefs", places, ("world", "problem", "beliefs", "repeat"))
        if section["kind"] == "stationary":
            return filtered_prior(regimes.world, section["resolution"], rng=rng)
        path = regimes.world.sample(WARM_UP + section["steps"], rng=rng)
        held = np.asarray(filter_beliefs(regimes.world, path.observations).beliefs)[WARM_UP:]
        points, met = np.unique(held, axis=0, return_counts=True)
        return Prior(points, met / met.sum())

    def _candidates(self, place: int, problem: DecisionProblem) -> Candidates:
        section = self.grid.candidates[place].data
        assert section is not None
        if "resolution" not in section:
            return as_candidates(problem, None)
        make = action_grid if section["kind"] == "actions" else decoy_grid
        return make(problem, section["resolution"])


def _pass_interrupt(error: BaseException) -> None:
    """Give way to Ctrl-C: compiled code may report it as an error of its own, and it is then sent again at once."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            raise cause
        cause = cause.__cause__ or cause.__context__
    time.sleep(_SECONDS_FOR_INTERRUPT)


def figures_text(figures: dict[str, float]) -> str:
    """Return figures as JSON, floats in full; no number is null, infinities are texts that `float` reads."""
    try:
        return _ENCODER.encode(figures)
    except ValueError:  # a number that JSON has not
        return _ENCODER.encode({name: _plain(value) for name, value in figures.items()})


def _plain(value: float) -> float | str | None:
    if value != value:
        return None
    return value if abs(value) != float("inf") else ("Infinity" if value > 0 else "-Infinity")


@lru_cache(maxsize=2)
def workshop(work: Work) -> Shop:
    """Return this process's workshop for a study, made once."""
    from inscrutable.experiments.studies.kinds import kind_named

    return kind_named(json.loads(work.study).get("kind")).shop(work)


def done_of(work: Work, numbers: Iterable[int]) -> Iterator[Done]:
    """Do some tasks one after another, each as soon as the one before is taken.

    Linear algebra runs on one thread: with several, the order of a sum, and with it the last digit, may change.
    """
    with threadpool_limits(limits=1):
        place = workshop(work)
        for number in numbers:
            yield place.done(number)


def chunk_of_rows(work: Work, numbers: Iterable[int]) -> list[Row]:
    """Do some tasks and return their rows."""
    done = list(done_of(work, numbers))
    return workshop(work).rows(done)
