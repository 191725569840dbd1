"""Tasks of any study, their runners, and their rows.

An identity is a hash of the task's parameters, so neither it nor any draw depends on the order of tasks, on the number of
processes or machines, or on the other tasks of the study.
"""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from typing import Any, NamedTuple, Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from inscrutable.errors import InscrutableError

DONE, FAILED = "done", "failed"
_HASH_CHARACTERS = 32
_WORD = 8  # hexadecimal characters of a 32-bit word
_SECONDS_FOR_INTERRUPT = 0.1
_ENCODER = json.JSONEncoder(separators=(",", ":"), allow_nan=False)


def canonical(value: Any) -> str:
    """Return plain data as canonical JSON: sorted keys, no blanks, floats in full."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=True)


def identity(text: str) -> str:
    """Return the hash of a text."""
    return sha256(text.encode("ascii")).hexdigest()[:_HASH_CHARACTERS]


def child_seed(entropy: int | Sequence[int], text: str) -> np.random.SeedSequence:
    """Return the child of a seed that belongs to a text."""
    key = identity(text)
    words = tuple(int(key[place : place + _WORD], 16) for place in range(0, len(key), _WORD))
    return np.random.SeedSequence(entropy, spawn_key=words)


@dataclass(frozen=True)
class Task:
    """One task of a study: its place in the grid, its parameters, and its identity.

    Args:
        number: Its place in the order of the grid, from 0.
        places: The place of each part's choice.
        text: Its parameters as canonical JSON.
    """

    number: int
    places: tuple[int, ...]
    text: str

    @property
    def key(self) -> str:
        """Its identity: a hash of its parameters."""
        return identity(self.text)

    @property
    def parameters(self) -> dict[str, Any]:
        """Its parameters as plain data."""
        found: dict[str, Any] = json.loads(self.text)
        return found


class TaskGrid(Protocol):
    """The tasks of a study of any kind."""

    def __len__(self) -> int: ...

    def task(self, number: int) -> Task:
        """Return a task by its place."""

    def task_seed(self, task: Task) -> np.random.SeedSequence:
        """Return the child seed of a task."""


def seed_of(grid: TaskGrid, task: Task) -> str:
    """Return the first 64 bits of a task's child seed."""
    return str(int(grid.task_seed(task).generate_state(1, np.uint64)[0]))


@dataclass(frozen=True)
class Listed:
    """Tasks one after another, each with a child of one seed, by its identity unless told otherwise.

    Args:
        count: Their number.
        named: Returns the parameters of a task, by its number.
        entropy: The entropy of the seed whose children the tasks' seeds are.
        first: With children by number, that of the first task.
        is_shared: Whether all tasks have the first child.
    """

    count: int
    named: Callable[[int], dict[str, Any]]
    entropy: int | Sequence[int]
    first: int | None = None
    is_shared: bool = False

    def __len__(self) -> int:
        return self.count

    def task(self, number: int) -> Task:
        """Return a task by its place."""
        return Task(number, (number,), canonical(self.named(number)))

    def task_seed(self, task: Task) -> np.random.SeedSequence:
        """Return the child seed of a task."""
        if self.is_shared:
            return np.random.SeedSequence(self.entropy, spawn_key=(0,))
        if self.first is None:
            return child_seed(self.entropy, task.text)
        return np.random.SeedSequence(self.entropy, spawn_key=(self.first + task.number,))


class Work(NamedTuple):
    """All that a process needs to do the tasks of a study, as texts that any machine can read.

    Args:
        runner: The class that does the tasks.
        study: The study as JSON.
        data_hash: Hash of the data that worlds were fitted to, or None.
        worlds: What was prepared once for all processes, as JSON.
        extensions: User-defined parts, as JSON.
    """

    runner: type[TaskRunner]
    study: str
    data_hash: str | None
    worlds: str
    extensions: str = "[]"


class Row(NamedTuple):
    """The row of one task, as it is stored."""

    number: int
    task: str
    parameters: str
    seed: str
    status: str
    figures: str
    duration: float
    error: str


class Done(NamedTuple):
    """The outcome of one task."""

    task: Task
    status: str
    figures: dict[str, float]
    duration: float
    error: str


class TaskRunner(ABC):
    """Does the tasks of one study."""

    grid: TaskGrid

    @abstractmethod
    def __init__(self, work: Work) -> None:
        """Read the study and the prepared data from the work."""

    @abstractmethod
    def figures(self, task: Task) -> dict[str, float]:
        """Return the figures of one task, by name."""

    def done(self, number: int) -> Done:
        """Do one task; if it fails, the outcome has the reason."""
        started = time.perf_counter()
        task = self.grid.task(number)
        status, error, found = DONE, "", {}
        try:
            found = self.figures(task)
        except InscrutableError as reason:
            status, error = FAILED, f"{type(reason).__name__}: {reason}"
        except (Exception, SystemExit) as reason:  # a user's part may call sys.exit
            pass_interrupt(reason)
            status, error = FAILED, f"unexpected {type(reason).__name__}: {reason}"
        storable = error.encode("utf-8", "backslashreplace").decode()  # a lone surrogate is no UTF-8
        return Done(task, status, found, time.perf_counter() - started, storable)

    def row_of(self, done: Done) -> Row:
        """Return the row of a task, with its identity and the first 64 bits of its child seed."""
        task, status, figures, duration, error = done
        seed = seed_of(self.grid, task)
        return Row(task.number, task.key, task.text, seed, status, figures_text(figures), duration, error)


def pass_interrupt(error: BaseException) -> None:
    """Let Ctrl-C through: compiled code may report it as an error of its own, and it is then sent again at once."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            raise cause
        cause = cause.__cause__ or cause.__context__
    time.sleep(_SECONDS_FOR_INTERRUPT)


def figures_text(figures: dict[str, float]) -> str:
    """Return figures as JSON with floats in full; NaN is null, and infinities are texts that `float` reads."""
    try:
        return _ENCODER.encode(figures)
    except ValueError:  # a number that JSON has not
        return _ENCODER.encode({name: _plain(value) for name, value in figures.items()})


def _plain(value: float) -> float | str | None:
    if value != value:
        return None
    return value if abs(value) != float("inf") else ("Infinity" if value > 0 else "-Infinity")


@lru_cache(maxsize=2)
def runner_of(work: Work) -> TaskRunner:
    """Return this process's runner for a study, made once."""
    return work.runner(work)


def one_by_one(work: Work, numbers: Iterable[int]) -> Iterator[Done]:
    """Do some tasks one after another, each when the caller has taken the one before.

    Linear algebra runs on one thread: with several, the order of a sum, and with it the last digit, may change.
    """
    with threadpool_limits(limits=1):
        runner = runner_of(work)
        for number in numbers:
            yield runner.done(number)


def chunk_of_rows(work: Work, numbers: Iterable[int]) -> list[Row]:
    """Do some tasks and return their rows.

    The rows are made together at the end: between two tasks of 1.5 ms each a row takes three times as long, 5 % of a study.
    """
    found, runner = list(one_by_one(work, numbers)), runner_of(work)
    return [runner.row_of(each) for each in found]
