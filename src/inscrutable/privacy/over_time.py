"""Leakage of decisions step by step on a belief that moves over time: information and errors along sampled paths."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from inscrutable import tolerances, validation
from inscrutable.adversaries.belief_moves import moves_of
from inscrutable.adversaries.belief_points import BeliefPoints
from inscrutable.adversaries.decision_tables import check_problem, checked_rule
from inscrutable.adversaries.inverse_filter import InverseFilter
from inscrutable.errors import InputError
from inscrutable.filtering import filter_beliefs
from inscrutable.mechanisms import Disclosure, Mechanism
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.disclosed import disclosed_rule
from inscrutable.mechanisms.memory import MechanismRule, MemoryMechanism
from inscrutable.privacy.losses import Loss, checked_loss
from inscrutable.privacy.path_figures import (
    FIGURES,
    Baseline,
    PathDraws,
    PathFigures,
    enumerated,
    sampled,
    unseen_beliefs,
)
from inscrutable.privacy.repeated import SIDE
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel
from inscrutable.worlds.public import joint_symbols

_LEAST_DRAWS = 10


@dataclass(frozen=True, eq=False, repr=False)
class PathLeakage(Summarised, Saved):
    """Leakage of the decisions u_0..u_t to the aware observer, who knows the mechanism and the chain of the belief.

    Arrays but `squared` have shape (T,), one entry a step; information is in bits, errors are in units of belief.

    Args:
        added: I(π_0..π_t; u_t | u_0..u_{t−1}) = E[log2 K(u_t|π_t) − log2 p(u_t|u_0..u_{t−1})]: what the decision of a step
            leaks about the beliefs so far, beyond the decisions before it.
        cumulative: I(π_0..π_t; u_0..u_t), the sum of `added` up to the step; a negative mean over sampled paths counts in the
            sum and is 0 in `added`. With public observations each term is conditional on those up to its own step, so that
            the sum is the directed information: later observations may repeat it.
        belief_information: I(π_t; u_0..u_t): what all decisions so far leak about the present belief.
        state_information: I(x_t; u_0..u_t): what all decisions so far leak about the present state.
        bayes_error: √E‖π_t − E[π_t|u_0..u_t]‖², Euclidean.
        added_se: Standard errors of `added` over the sampled paths.
        cumulative_se: Those of `cumulative`.
        belief_information_se: Those of `belief_information`.
        state_information_se: Those of `state_information`.
        error_se: Those of `bayes_error`.
        squared: Square errors of which `bayes_error` is the root mean, on each sampled path, shape (D,T); one row where all
            sequences were enumerated. The same `rng` gives the same paths of beliefs under every mechanism and disclosure.
        prior_error: The error without decisions at each step, which no rule exceeds; the observer then has the public
            observations alone. On a grid it is the error under the grid's law, a little larger than that under the agent's.
        interpolation_error: Largest expected distance, over steps and paths, between the agent's belief and the mechanism's
            points by which it is represented; 0 where there is no error but sampling.
        n_draws: Number of sampled paths; 0 where all sequences of decisions were enumerated, so that there is no sampling
            error.
        loss: E L(p_t), the mean loss of a rival who has seen all decisions so far, in the unit of the loss L; None where no
            loss was given.
        loss_se: Its standard error over the sampled paths.
        prior_loss: The same without decisions.
        cells_error: Where public real numbers are discretised to cells: the error without decisions from cells minus that
            from the numbers themselves, at one step on average.

    Where the interpolation error is not 0, `bayes_error` is the true distance from the estimate. `added` and `cumulative` use
    the observer's probabilities of decisions: on average they overestimate the bits (Gibbs' inequality), except that decisions
    of probability 0 on the grid are skipped and count as 0. `belief_information` and `state_information` are computed from the
    observer's own law. An event rarer than once in `n_draws` paths is probably in none of them, and so neither in the figures
    nor in their standard errors. With public observations all figures are conditional on those so far.

    Source: the chain rule for mutual information (Shannon, 1948) with the inverse filter of `SequentialAdversary`.

    Example:
        >>> from inscrutable import Prior
        >>> from inscrutable.mechanisms.chains import resting_chain
        >>> chain = resting_chain(Prior([[1.0, 0.0], [0.0, 1.0]], [0.5, 0.5]), 0.0)
        >>> open_book = Mechanism(chain.prior.beliefs, [0, 1], np.eye(2), [[0.0, 1.0], [1.0, 0.0]])
        >>> found = path_leakage(chain, open_book, 3, rng=np.random.default_rng(0), n_draws=10)
        >>> print(found.cumulative, found.belief_information, found.bayes_error)
        [1. 2. 3.] [1. 1. 1.] [0. 0. 0.]
    """

    added: Array
    cumulative: Array
    belief_information: Array
    state_information: Array
    bayes_error: Array
    added_se: Array
    cumulative_se: Array
    belief_information_se: Array
    state_information_se: Array
    error_se: Array
    squared: Array
    prior_error: Array
    interpolation_error: float
    n_draws: int
    loss: Array | None = None
    loss_se: Array | None = None
    prior_loss: Array | None = None
    cells_error: float = 0.0

    @property
    def worth(self) -> Array | None:
        """The value of the decisions so far to the rival at each step, at least 0; None where no loss was given."""
        if self.loss is None or self.prior_loss is None:
            return None
        return np.maximum(self.prior_loss - self.loss, 0.0)

    def __len__(self) -> int:
        return len(self.added)

    @property
    def is_all_public(self) -> bool:
        """Whether the public observations determine the belief, so that nothing can be hidden."""
        return bool((self.prior_error**2 <= tolerances.REACHED_BELIEF).all())

    def summary(self) -> str:
        """Return a line for the first, the middle and the last step, with 95 % intervals."""
        how = f"{self.n_draws} sampled paths" if self.n_draws else "every sequence of decisions"
        lines = [f"{len(self)} decisions on a belief that moves, {how}"]
        for t in dict.fromkeys([0, len(self) // 2, len(self) - 1]):
            lines.append(
                f"after {t + 1:4d}: {self.cumulative[t]:.4f} ± {SIDE * self.cumulative_se[t]:.4f} bits of all beliefs so far, "
                f"{self.belief_information[t]:.4f} ± {SIDE * self.belief_information_se[t]:.4f} of the present one, "
                f"{self.state_information[t]:.4f} ± {SIDE * self.state_information_se[t]:.4f} of the state; "
                f"error {self.bayes_error[t]:.4f} ± {SIDE * self.error_se[t]:.4f} of {self.prior_error[t]:.4f}"
            )
            if self.loss is not None and self.loss_se is not None and self.prior_loss is not None:
                lines[-1] += (
                    f"; the rival's loss {self.loss[t]:.4g} ± {SIDE * self.loss_se[t]:.2g} of {self.prior_loss[t]:.4g}"
                )
        if self.is_all_public:
            lines.append("nothing can be hidden: the public observations determine the belief without any decision")
        if self.cells_error:
            lines.append(
                f"public numbers are discretised to cells, which adds {self.cells_error:.2g} to the error without decisions"
            )
        if self.interpolation_error > tolerances.SAME_BELIEF:
            lines.append(f"on a grid, with an interpolation error of up to {self.interpolation_error:.3g}")
        return "\n".join(lines)


def path_leakage(
    world: HiddenMarkovModel | BeliefChain,
    mechanism: Mechanism | MemoryMechanism | MechanismRule,
    n_steps: int,
    *,
    rng: np.random.Generator,
    n_draws: int = 200,
    loss: Loss | None = None,
    disclosure: Disclosure | str | None = None,
) -> PathLeakage:
    """Return the leakage of decisions on a belief that moves over time: of each step, in total, and about the present
    belief.

    Formula: those of `PathLeakage`, as averages over sampled paths of beliefs and decisions.

    Args:
        world: The world whose observations the agent filters, with a `CategoricalEmission`; or a `BeliefChain` on the
            mechanism's beliefs, such as `filtered_chain` makes from any world. The observer uses its public observations.
        mechanism: K(u|π), drawn independently at every step; a `MemoryMechanism`, whose memory the observer sees where it is
            public; or a `MechanismRule`, with K_t from the observer's law. In a world it is exact on all `reachable_beliefs`;
            on fewer beliefs the agent decides as at the nearest of them, with the error stated.
        n_steps: T, at least 1.
        rng: The source of paths and decisions.
        n_draws: Sampled paths, at least 10. Where decisions lead to no more different laws than that, and the observer knows
            the memory, all of them are enumerated instead, and the figures are exact.
        loss: A rival's loss, such as `RivalProblem(problem)`; None leaves its figures out.
        disclosure: What is disclosed of decisions, how often and how late, such as `every(3) | delayed(2)`, also as text; None
            is all, at once. `added` at step t is then the information in the disclosure of that step, given the public
            observations so far.

    Raises:
        InputError: An argument is malformed, the sensor reports real numbers, a chain is on other beliefs, or a problem has
            other state labels than the world; or a disclosure needs returns, is not a rule's own, or hides steps of a public
            memory.

    Cost: T·n_draws steps of the filter, once for equal sequences: B² multiplications each on a chain of B beliefs, or as many
        as its entries; for a rule as many mechanisms.

    Source: see `PathLeakage`.

    Example:
        >>> from inscrutable import CategoricalEmission, FiniteProblem, OriginalDecisionMaker, mechanism, reachable_beliefs
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.1, 0.9]], CategoricalEmission([[0.8, 0.2], [0.2, 0.8]]))
        >>> agent = OriginalDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]]))
        >>> played = mechanism(agent, reachable_beliefs(world, 3))
        >>> found = path_leakage(world, played, 3, rng=np.random.default_rng(0))
        >>> print(found.cumulative.round(1), (found.bayes_error < found.prior_error).all())
        [1.  1.9 2.3] True
    """
    count = validation.count(n_steps, "n_steps")
    draws, source = validation.count(n_draws, "n_draws", least=_LEAST_DRAWS), validation.generator(rng)
    shown = Disclosure.of(disclosure)
    rule = checked_rule(disclosed_rule(mechanism, shown))
    if not isinstance(world, BeliefChain) and not (
        isinstance(world, HiddenMarkovModel) and joint_symbols(world.emission, world.public) is not None
    ):
        raise InputError(
            "a world with a CategoricalEmission, and a public one of symbols if any, is needed, or a BeliefChain such as "
            f"filtered_chain makes, got {world!r}"
        )
    wanted = None if loss is None else checked_loss(loss, rule.beliefs.shape[1])
    for owner in (mechanism, wanted):
        check_problem(owner, world)
    reader = InverseFilter(moves_of(world, BeliefPoints(rule.beliefs)), rule)
    held = len(rule.beliefs)
    validation.check_room(
        count, "n_steps", f"laws of {held:,} beliefs at every step", lambda steps: float(steps) * held
    )
    validation.check_room(draws, "n_draws", f"figures of {count:,} steps", lambda paths: float(paths) * count * FIGURES)
    unseen = unseen_beliefs(reader, count)
    figures = partial(Baseline, reader, unseen, wanted)
    found = enumerated(reader, figures(), count, draws, shown.schedule)
    if found is None:
        found = sampled(reader, figures, _paths(world, reader, count, draws, source), source, shown.schedule)
    averaged = _averaged(found, unseen.spread if found.prior is None else np.sqrt(found.prior.mean(axis=0)))
    if isinstance(world, BeliefChain) and world.cells is not None:
        averaged = replace(averaged, cells_error=world.cells.symbols_error - world.cells.numbers_error)
    if wanted is None:
        return averaged
    (lost,), (error,) = _averages([found.lost], found.is_sampled, least=-np.inf)
    prior = wanted.bayes_risk(unseen.weights, reader.moves.points)
    prior = prior if found.prior_lost is None else found.prior_lost.mean(axis=0)
    return replace(averaged, loss=lost, loss_se=error, prior_loss=prior)


def _paths(
    world: HiddenMarkovModel | BeliefChain, reader: InverseFilter, n_steps: int, n_draws: int, rng: np.random.Generator
) -> PathDraws:
    """Sampled paths of beliefs."""
    if isinstance(world, BeliefChain):
        places, read = world.public_paths(n_steps, n_draws, rng=rng)
        return PathDraws(places, None, read)
    paths = [world.sample(n_steps, rng=rng) for _ in range(n_draws)]
    held = [filter_beliefs(world, path.observations, public=path.public).beliefs for path in paths]
    beliefs = np.stack(held, axis=1)
    symbols = None if world.public is None else np.array([path.public for path in paths]).T
    return PathDraws(np.asarray(cKDTree(reader.moves.points).query(beliefs)[1]), beliefs, symbols)


def _averaged(found: PathFigures, prior_error: Array) -> PathLeakage:
    """The figures of paths as means with their standard errors, which are 0 where no path was sampled."""
    (added, total, belief, state, squared), errors = _averages(
        [found.added, found.added.cumsum(axis=1), found.belief, found.state, found.squared], found.is_sampled
    )
    root = np.sqrt(squared)
    return PathLeakage(
        added=added,
        cumulative=total,
        belief_information=belief,
        state_information=state,
        bayes_error=root,
        added_se=errors[0],
        cumulative_se=errors[1],
        belief_information_se=errors[2],
        state_information_se=errors[3],
        error_se=np.divide(errors[4], 2.0 * root, out=np.zeros_like(root), where=root > 0),
        squared=found.squared,
        prior_error=prior_error,
        interpolation_error=found.interpolation_error,
        n_draws=len(found.added) if found.is_sampled else 0,
    )


def _averages(figures: list[Array], is_sampled: bool, least: float = 0.0) -> tuple[list[Array], list[Array]]:
    """Means (T,) of figures (D,T), cut off below at `least`, and their standard errors."""
    means = [np.maximum(each.mean(axis=0), least) for each in figures]
    if not is_sampled:
        return means, [np.zeros_like(each) for each in means]
    return means, [each.std(axis=0, ddof=1) / np.sqrt(len(each)) for each in figures]
