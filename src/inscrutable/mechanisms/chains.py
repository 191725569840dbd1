"""Markov chains of the private belief on the points of a prior, for rules that depend on earlier decisions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.csgraph import connected_components, shortest_path

from inscrutable import tolerances, validation
from inscrutable.errors import InputError
from inscrutable.mechanisms.drawing import RowDraws
from inscrutable.mechanisms.matching import checked_mechanism
from inscrutable.mechanisms.played import Mechanism
from inscrutable.mechanisms.priors import STEPS_OF_LAW, Prior, checked_prior, grid_visits, predicted
from inscrutable.mechanisms.public_cells import N_CELLS, PublicCells, cells_of, errors_of
from inscrutable.saved import Summarised
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel

_MEASURED = 4_000
"""Steps on which the error of cells is measured: a standard error of the difference of about a hundredth of the error."""
_DRAWN_TO = 0.5
"""Pseudo-counts by which rare moves are shrunk to the symbols' shares over more moves: 4 and 20 leave larger errors."""


@dataclass(frozen=True, eq=False, repr=False)
class BeliefChain(Summarised):
    """A Markov chain on the points of a prior, whose law at every step is the prior.

    Formula: Pr(π_{t+1} = π_b' | π_t = π_b) = T_bb' with w T = w; backwards in time R_bb' = w_b' T_b'b / w_b.

    Args:
        prior: The points π_b and their weights w_b.
        transition: T, shape (B,B), rows that sum to one, plain or sparse.
        public: With one of Z public symbols at each move: Z tables T_z of shape (B,B) whose sum is T, with T_z[b,b'] the
            probability of moving to b' with the symbol z. None: no symbols.
        cells: Where the symbols are cells of real numbers: the cells, and the error that they add.

    Raises:
        InputError: The shape is wrong, a row is no probability vector, the prior is not stationary, or the public tables are
            negative or do not sum to the transition.

    Source: Kemeny and Snell, Finite Markov Chains (1960), chapter V, for the chain backwards in time.

    Example:
        >>> chain = BeliefChain(Prior([[1.0, 0.0], [0.0, 1.0]], [0.5, 0.5]), [[0.9, 0.1], [0.1, 0.9]])
        >>> print(chain.reversed.toarray())
        [[0.9 0.1]
         [0.1 0.9]]
    """

    prior: Prior
    transition: Any
    public: Sequence[Any] | None = None
    cells: PublicCells | None = None

    def __post_init__(self) -> None:
        checked_prior(self.prior)
        table = _rows(self.transition, len(self.prior))
        off = np.abs(table.T @ self.prior.weights - self.prior.weights)
        if off.max() > tolerances.TRANSITION_SUM:
            b = int(off.argmax())
            raise InputError(
                f"the chain does not keep the prior: belief {b} has weight {self.prior.weights[b]:.10g} before a step and "
                f"{(table.T @ self.prior.weights)[b]:.10g} after it"
            )
        object.__setattr__(self, "transition", table)
        if self.public is not None:
            object.__setattr__(self, "public", _parts(self.public, table))

    @property
    def n_public(self) -> int:
        """Number of public symbols; 1 where there are none."""
        return 1 if self.public is None else len(self.public)

    @cached_property
    def forgets(self) -> bool:
        """Whether the far future does not depend on the present belief: one class of beliefs with weight, without a period."""
        some = self.prior.weights > 0
        moves: Any = self.transition[some][:, some]
        moves.eliminate_zeros()  # stored zeros are no moves
        if connected_components(moves, connection="strong")[0] > 1:
            return False
        steps = shortest_path(moves, unweighted=True, indices=0).astype(np.int64)
        one, other = moves.nonzero()
        return bool(np.gcd.reduce(steps[one] + 1 - steps[other]) == 1)

    @cached_property
    def reversed(self) -> Any:
        """R, the law of the belief one step ago given today's, sparse (B,B); a point without weight stays where it is."""
        weights = self.prior.weights
        some = weights > 0
        inverse = np.divide(1.0, weights, out=np.zeros_like(weights), where=some)
        back = sparse.diags_array(inverse) @ self.transition.T @ sparse.diags_array(weights)
        back = sparse.csr_array(back + sparse.diags_array((~some).astype(np.float64)))
        scaled: Any = sparse.diags_array(1.0 / back.sum(axis=1)) @ back
        return sparse.csr_array(scaled)

    def lagged(self, mechanism: Mechanism, n_steps: int) -> Mechanism:
        """Return the mechanism of the optimal decision of `n_steps` steps ago: R^d K.

        The mechanism must be on the prior's beliefs, in their order; otherwise `InputError` is raised.
        """
        known = checked_mechanism(mechanism).beliefs
        self.checked_beliefs(known)
        if validation.count(n_steps, "n_steps", least=0) == 0:
            return mechanism
        table = mechanism.probabilities
        for _ in range(n_steps):
            table = self.reversed @ table
        return Mechanism(known, mechanism.actions, table, mechanism.regrets)

    def checked_beliefs(self, beliefs: Array) -> None:
        """Raise `InputError` unless a mechanism's beliefs are those of the prior, in their order."""
        known = self.prior.beliefs
        if beliefs.shape != known.shape or np.abs(beliefs - known).max() > tolerances.SAME_BELIEF:
            raise InputError("the mechanism must be on the beliefs of the chain's prior, in their order")

    def histories(self, n_steps: int, n_draws: int, *, rng: np.random.Generator) -> np.ndarray:
        """Return sampled pasts of every belief as places among the beliefs, shape (n_steps+1, B, n_draws).

        In the order of time; the last entries are the beliefs themselves.
        """
        steps, draws = validation.count(n_steps, "n_steps", least=0), validation.count(n_draws, "n_draws")
        drawn, count, source = RowDraws(self.reversed), len(self.prior), validation.generator(rng)
        found = np.empty((steps + 1, count, draws), dtype=np.intp)
        found[-1] = np.arange(count)[:, None]
        for step in range(steps - 1, -1, -1):
            found[step] = drawn(found[step + 1], source)
        return found

    def paths(self, n_steps: int, n_draws: int, *, rng: np.random.Generator) -> np.ndarray:
        """Return sampled paths in the order of time as places among the beliefs, shape (n_steps, n_draws).

        The first belief has the law of the prior, and so has every later one.
        """
        return self.public_paths(n_steps, n_draws, rng=rng)[0]

    def public_paths(
        self, n_steps: int, n_draws: int, *, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Return sampled paths as `paths` does, and their public symbols, of the same shape; None where there are none."""
        count, draws = validation.count(n_steps, "n_steps"), validation.count(n_draws, "n_draws")
        size = len(self.prior)
        tables = self.transition if self.public is None else sparse.csr_array(sparse.hstack(list(self.public)))
        drawn = RowDraws(tables)
        found = np.empty((count, draws), dtype=np.intp)
        found[0] = validation.generator(rng).choice(size, size=draws, p=self.prior.weights)
        if self.public is not None:  # one step before the first, because the first belief has a symbol too
            found[0] = drawn(found[0], rng)
        for step in range(1, count):
            found[step] = drawn(found[step - 1] % size, rng)
        return (found, None) if self.public is None else (found % size, found // size)

    def summary(self) -> str:
        """Return a line or two for a person to read."""
        stay = float(self.prior.weights @ self.transition.diagonal())
        read = "" if self.cells is None else f"\npublic observations: {self.cells}"
        return f"{self.prior.summary()}; the belief stays the same in {stay:.1%} of the steps{read}"


def _parts(given: Any, transition: Any) -> tuple[Any, ...]:
    """Public tables as sparse arrays that sum to the transition."""
    try:
        tables = tuple(sparse.csr_array(each) for each in given)
    except (TypeError, ValueError):  # no tables, or texts
        tables = ()
    if not tables or any(each.shape != transition.shape for each in tables):
        raise InputError(f"public must be tables of shape {transition.shape}, one for every public symbol")
    for z, each in enumerate(tables):
        if each.nnz and not (np.isfinite(each.data).all() and each.data.min() >= 0):
            raise InputError(f"public table {z} has an entry that is no probability")
    off: Any = sparse.csr_array(sum(tables[1:], start=tables[0]) - transition)
    if off.nnz and np.abs(off.data).max() > tolerances.TRANSITION_SUM:
        raise InputError(
            f"the public tables must sum to the transition; they are off by {np.abs(off.data).max():.3g} at most"
        )
    return tables


def resting_chain(prior: Prior, stay: float) -> BeliefChain:
    """Return the chain that keeps the belief with a probability, and otherwise draws it from the prior.

    Formula: T = a I + (1 − a) 1 w'. It keeps any prior; after d steps Pr(still there) = a^d.

    Args:
        prior: The law of the belief.
        stay: a in [0, 1].

    Raises:
        InputError: `stay` is no probability, or `prior` no prior.

    Cost: B² numbers. Source: a mixture of the identity and of independent draws.

    Example:
        >>> print(resting_chain(Prior([[1.0, 0.0], [0.0, 1.0]], [0.5, 0.5]), 0.8).transition.toarray())
        [[0.9 0.1]
         [0.1 0.9]]
    """
    checked_prior(prior)
    share = validation.non_negative(stay, "stay")
    if share > 1:
        raise InputError(f"stay must be at most 1, got {share:g}")
    count = len(prior)
    return BeliefChain(prior, share * np.eye(count) + (1.0 - share) * np.tile(prior.weights, (count, 1)))


def filtered_chain(
    world: HiddenMarkovModel,
    resolution: int,
    *,
    rng: np.random.Generator,
    n_steps: int = STEPS_OF_LAW,
    cuts: ArrayLike | int | None = None,
) -> BeliefChain:
    """Return the Markov chain of a world's filtered belief, binned on the regular grid of beliefs.

    Formula: T_bb' = share of the steps with π_t nearest to π_b whose next belief is nearest to π_b'; the path is closed to a
    ring, so that the prior, `filtered_prior` of the same arguments, is the chain's law to the last digit.

    It is an approximation that the next bin depends on the present one alone; a finer grid improves it. Where the world has
    public observations, the chain's `public` tables are shares of the same steps by symbol. Real numbers are replaced by their
    cell; `cells` states by how much that raises the error of an observer who sees no decision.

    Args:
        world: The hidden Markov model whose observations the agent filters.
        resolution: r, at least 1: beliefs are multiples of 1/r.
        rng: The source of the simulated path.
        n_steps: Length of the simulated path, at least 1; the first tenth is left out.
        cuts: For public real numbers: the number of cells of similar p(x|z); None is 24. Or, for one number, rising cut points
            of symbols `np.searchsorted(cuts, z)`.

    Raises:
        InputError: A number is not whole or below 1, `rng` is no generator, or cuts are not asked for, or do not rise.
        ModelError: As `filtered_prior`.

    Cost: one simulated and filtered path. Source: Ulam's method.

    Example:
        >>> from inscrutable import CategoricalEmission
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.1, 0.9]], CategoricalEmission([[0.8, 0.2], [0.2, 0.8]]))
        >>> chain = filtered_chain(world, 10, rng=np.random.default_rng(0), n_steps=1000)
        >>> chain.transition.shape == (len(chain.prior), len(chain.prior))
        True
    """
    return _measured(world, _binned(world, resolution, rng, n_steps, cuts), rng, ahead=False)


def _binned(
    world: HiddenMarkovModel, resolution: int, rng: np.random.Generator, n_steps: int, cuts: ArrayLike | int | None
) -> BeliefChain:
    """The chain, with cells whose errors are not measured yet."""
    asked = _asked_cells(cuts)
    prior, places, weights, public = grid_visits(world, resolution, rng=rng, n_steps=n_steps)
    later = np.roll(places, -1)

    def counted(some: Any) -> Any:
        pairs = weights[some], (places[some], later[some])
        return sparse.csr_array(sparse.coo_array(pairs, shape=(len(prior), len(prior))))

    counts = counted(slice(None))
    scale = sparse.diags_array(1.0 / counts.sum(axis=1))
    cells = _cells(world, public, asked, rng)
    if public is None:
        return BeliefChain(prior, scale @ counts)
    read = np.roll(public if cells is None else cells.symbols(public), -1)
    n_public = world.public_emission.n_symbols if cells is None else len(cells)  # type: ignore[union-attr]
    tables = [counted(read == symbol) for symbol in range(n_public)]
    if cells is not None and cells.cuts is None:
        tables = _shrunk(counts, tables)
    return BeliefChain(prior, scale @ counts, [scale @ each for each in tables], cells)


def _shrunk(counts: Any, tables: list[Any]) -> list[Any]:
    """Counts of moves by symbol, which sum to the counts (B,B): shares of rare moves are shrunk to those of their next belief.

    These are shrunk to those of all moves, so that no symbol has probability 0.
    """
    share = np.array([each.sum() for each in tables]) / counts.sum()
    own = np.array([each.sum(axis=0) for each in tables])  # (Z,B)
    of_next = (own + _DRAWN_TO * share[:, None]) / (counts.sum(axis=0) + _DRAWN_TO)
    whole = counts.tocoo()
    found = []
    for each, mean in zip(tables, of_next, strict=True):
        here = np.asarray(each[whole.row, whole.col]).reshape(-1)
        some = whole.data * (here + _DRAWN_TO * mean[whole.col]) / (whole.data + _DRAWN_TO)
        found.append(sparse.csr_array(sparse.coo_array((some, (whole.row, whole.col)), shape=counts.shape)))
    return found


def _asked_cells(cuts: ArrayLike | int | None) -> Array | int | None:
    if cuts is None or isinstance(cuts, (int, np.integer)):
        return None if cuts is None else validation.count(cuts, "cuts", least=2)
    limits = validation.finite_array(cuts, "cuts", ndim=1)
    if not limits.size or (np.diff(limits) <= 0).any():
        raise InputError(f"cuts must be rising numbers, or the number of cells, got {limits.tolist()}")
    return limits


def _cells(
    world: HiddenMarkovModel, public: np.ndarray | None, asked: Array | int | None, rng: np.random.Generator
) -> PublicCells | None:
    """The cells of public numbers on a path; None where nothing is public, or symbols are."""
    emission = world.public_emission
    if emission is None or public is None or isinstance(emission, CategoricalEmission):
        if asked is not None:
            raise InputError("cuts are for a world in which real numbers are public")
        return None
    if isinstance(asked, np.ndarray):
        if public[0].size != 1:
            raise InputError(f"cuts are for one number, got {public[0].size} a step: give the number of cells, or None")
        return PublicCells(emission, np.full(world.n_states, 1.0 / world.n_states), None, asked)
    return cells_of(world, public, N_CELLS if asked is None else asked, rng=rng.spawn(1)[0])


def _measured(world: HiddenMarkovModel, chain: BeliefChain, rng: np.random.Generator, *, ahead: bool) -> BeliefChain:
    """The chain with the error that its cells add for an observer who sees no decision, on a path of its own; no number of
    `rng` is drawn."""
    if chain.cells is None or chain.public is None:
        return chain
    path = world.sample(_MEASURED, rng=rng.spawn(1)[0])
    forwards = [sparse.csr_array(each.T) for each in chain.public]
    law, means = chain.prior.weights, np.empty((_MEASURED, world.n_states))
    for t, symbol in enumerate(chain.cells.symbols(path.public)):
        moved = forwards[symbol] @ law
        if not moved.sum() > 0:  # a symbol of probability 0 on the grid is ignored
            moved = chain.transition.T @ law
        law = moved / moved.sum()
        means[t] = law @ chain.prior.beliefs
    numbers, symbols, error = errors_of(world, path, means, ahead=ahead)
    return replace(chain, cells=replace(chain.cells, numbers_error=numbers, symbols_error=symbols, error_se=error))


stationary_chain = filtered_chain
"""The former name of `filtered_chain`."""


def predicted_chain(
    world: HiddenMarkovModel,
    resolution: int,
    *,
    rng: np.random.Generator,
    n_steps: int = STEPS_OF_LAW,
    cuts: ArrayLike | int | None = None,
) -> BeliefChain:
    """Return the Markov chain of the belief about the next state: `filtered_chain` one step ahead.

    Arguments and errors as `filtered_chain`; the chain's prior is `predicted_prior`.
    """
    filtered = _binned(world, resolution, rng, n_steps, cuts)
    prior, place = predicted(filtered.prior, world)
    if len(prior) == len(filtered.prior):
        chain = replace(filtered, prior=prior)
    else:  # moves from and to beliefs that are one, by their weights
        to = sparse.csr_array((np.ones(len(place)), (np.arange(len(place)), place)), shape=(len(place), len(prior)))
        mean = sparse.diags_array(1.0 / prior.weights) @ to.T @ sparse.diags_array(filtered.prior.weights)
        tables = None if filtered.public is None else [mean @ each @ to for each in filtered.public]
        chain = BeliefChain(prior, mean @ filtered.transition @ to, tables, filtered.cells)
    return _measured(world, chain, rng, ahead=True)


def _rows(transition: Any | ArrayLike, count: int) -> Any:
    """A stochastic matrix as a sparse array of rows, shape (B,B)."""
    given: Any = transition if sparse.issparse(transition) else validation.stochastic_rows(transition, "transition")
    if given.shape != (count, count):
        raise InputError(
            f"transition must be of shape {(count, count)}, one row and column a belief, got {given.shape}"
        )
    table = sparse.csr_array(given)
    sums = table.sum(axis=1)
    if (
        not np.isfinite(table.data).all()
        or table.data.min(initial=0.0) < 0
        or np.abs(sums - 1).max() > tolerances.TRANSITION_SUM
    ):
        raise InputError("transition must have rows of probabilities that sum to one")
    return table
