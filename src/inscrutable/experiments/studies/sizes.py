"""Limits on sizes: a study that does not fit into memory is refused before it runs, with the largest size that fits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import exp, lgamma, prod
from typing import NamedTuple

from inscrutable import validation
from inscrutable.experiments.sections import PlanFile
from inscrutable.experiments.studies.grid import StudyGrid
from inscrutable.experiments.studies.layout import GivenWorld, RandomWorld, StudyFile
from inscrutable.experiments.toml_lines import Place
from inscrutable.mechanisms.priors import STEPS_OF_LAW

MOST_TASKS = 10_000_000


class Demand(NamedTuple):
    """The memory that one key of a study needs.

    Args:
        place: The key.
        value: Its value.
        table: The table that is made of it.
        size: Returns how many numbers the table has, for any value of the key.
    """

    place: Place
    value: int
    table: str
    size: Callable[[int], float]

    def refusal(self) -> str:
        """Return the message on what is too large, and on what fits; empty where it fits into memory."""
        return validation.excess(self.value, self.table, self.size, "other sizes of the study")


_CANDIDATES = 5000.0
"""Decoys where a study names no resolution."""

_EACH = 64.0
"""Numbers kept for one belief by a decision maker that plays one decision or two."""

_MIX_ALL = ("uniform", "exponential", "rate-distortion", "Stackelberg")
"""Decision makers that may play any candidate."""

_LARGE = 100.0  # logarithm from which a number of points is no longer computed


def points(coordinates: int, resolution: int) -> float:
    """Return the approximate number of points of a regular grid on the simplex, however large."""
    exponent = lgamma(resolution + coordinates) - lgamma(coordinates) - lgamma(resolution + 1)
    return exp(min(exponent, 2.0 * _LARGE))


def too_large(study: StudyFile) -> Demand | None:
    """Return the first key of a grid that needs more memory than there is, if any."""
    return next((each for each in _demands(study) if each.refusal()), None)


def _demands(study: StudyFile) -> Iterator[Demand]:
    world = study.world
    regimes = len(world.means) if isinstance(world, GivenWorld) else max(world.regimes)
    assets = max(world.assets) if isinstance(world, RandomWorld) else 1
    if isinstance(world, GivenWorld):
        assets = max(map(len, world.means), default=1)
    if isinstance(world, RandomWorld):
        yield Demand(("world", "assets"), assets, "covariances in every regime", lambda u: float(regimes) * u * u)
    if not isinstance(world, GivenWorld):
        yield Demand(
            ("world", "regimes"), regimes, "regimes with their covariances", lambda x: float(x) * (x + assets**2)
        )
    yield from _laws(study, regimes, assets)
    for kind in study.candidates.kind:
        n = regimes if kind == "decoys" else assets
        for resolution in study.candidates.resolution or ():
            yield _grid_of(kind, n, resolution, regimes + assets)
    for number, maker in enumerate(study.decision_makers):
        draws = getattr(maker, "draws", None)
        if draws is not None:
            where = ("decision_makers", number, "draws")
            yield Demand(
                where, draws, "draws of noisy weights", lambda d: float(d) * assets * _fewest_beliefs(study, regimes)
            )


def _grid_of(kind: str, coordinates: int, resolution: int, width: int) -> Demand:
    place = ("candidates", "resolution")
    return Demand(place, resolution, f"a grid of {kind}", lambda r: points(coordinates, r) * width)


def _laws(study: StudyFile, regimes: int, assets: int) -> Iterator[Demand]:
    """Return the demands of the law of beliefs: its grid, its path, and the probability of each candidate at each belief."""
    steps = getattr(study.beliefs, "steps", ())
    for each in steps:
        yield Demand(("beliefs", "steps"), each, "a path of observations", lambda n: float(n) * (regimes + assets))
    if study.beliefs.kind == "path":  # no more points can be met than it has steps
        return
    grids = study.candidates.resolution
    candidates = points(regimes, max(grids)) if grids and "decoys" in study.candidates.kind else _CANDIDATES
    mixes = any(maker.name in _MIX_ALL for maker in study.decision_makers)
    beside, table = (
        (candidates, "chances of every candidate") if mixes else (_EACH, "decisions with what explains them")
    )
    is_met = study.beliefs.kind == "stationary"  # by a path, whose beliefs join the candidates

    def numbers(resolution: int) -> float:
        count = points(regimes, resolution)
        met = min(count, float(STEPS_OF_LAW)) if is_met else count
        return met * (beside + (met if is_met and mixes else 0.0))

    for resolution in study.beliefs.resolution:
        place = ("beliefs", "resolution")
        yield Demand(place, resolution, f"{table} under every belief of the grid", numbers)


def _fewest_beliefs(study: StudyFile, regimes: int) -> float:
    beliefs = study.beliefs
    return points(regimes, min(beliefs.resolution)) if beliefs.kind == "grid" else 1.0


def too_many(plan: PlanFile, total: int) -> str | None:
    """Return the message for a study with more tasks than any machine can do, such as by a typing error; else None."""
    if total <= MOST_TASKS:
        return None
    made_of = ""
    if isinstance(plan, StudyFile):
        shape = StudyGrid(plan).shape
        made_of = (
            f" (settings {prod(shape[:4]):,} x repeats {plan.repeats:,} x decision makers with budgets {shape[5]:,} x "
            f"adversaries {shape[6]:,})"
        )
    return f"{total:,} tasks{made_of}, expected at most {MOST_TASKS:,}"
