"""Draws that are repeated while the belief does not change."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from inscrutable import tolerances, validation
from inscrutable.decision_makers.arguments import Described
from inscrutable.errors import InputError
from inscrutable.mechanisms import Mechanism, mechanism
from inscrutable.mechanisms.drawing import RowDraws
from inscrutable.mechanisms.memory import MemoryMechanism
from inscrutable.mechanisms.played import PlaysMany
from inscrutable.problems import checked_problem
from inscrutable.validation import Array

_MOST_ENTRIES = 2**25
"""The most entries of a memory mechanism; making it takes some 800 MB then."""


class KeptDecisionMaker(Described):
    """The lottery of another decision maker, drawn again only when the belief changes.

    Formula: u_t = u_{t−1} where π_t = π_{t−1}, to `tolerances.SAME_BELIEF`; otherwise u_t ~ K(·|π_t), drawn afresh.

    Repeated decisions on one belief reveal no more than one decision. Each decision alone has the law and the regret of the
    other decision maker's. The decision depends on the past: the rule is not a mechanism K(u|π), but one with a memory.

    Args:
        decision_maker: Anything with `problem` and `decide_many` that decides by the present belief alone.

    Raises:
        InputError: There is no such decision maker.

    Cost: one decision of the other decision maker for each new belief.

    Source: memoised noise, as in Erlingsson, Pihur and Korolova, RAPPOR (2014): an answer is drawn once and repeated.

    Example:
        >>> import numpy as np
        >>> from inscrutable import CoinDecisionMaker, FiniteProblem
        >>> coin = CoinDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), 0.5, decoy=[0.4, 0.6])
        >>> path = [[0.9, 0.1]] * 5 + [[0.8, 0.2]] * 5
        >>> print(KeptDecisionMaker(coin).draw_path(path, rng=np.random.default_rng(6)))
        [0 0 0 0 0 1 1 1 1 1]
    """

    _shown = ("decision_maker",)
    is_memoryless = False
    """False: it depends on earlier decisions."""

    def __init__(self, decision_maker: PlaysMany) -> None:
        self.problem = checked_problem(getattr(decision_maker, "problem", None))
        if not getattr(decision_maker, "is_memoryless", True) or not hasattr(decision_maker, "decide_many"):
            raise InputError(
                f"a decision maker that decides by the present belief alone is needed, got {decision_maker!r}"
            )
        self.decision_maker = decision_maker

    def decide(self, belief: ArrayLike) -> Any:
        """Return the law of a decision on one belief (X,), before it was drawn for the first time."""
        return self.decide_many(validation.one_belief(belief, self.problem.n_states, names=self.problem.state_names))[0]

    def decide_many(self, beliefs: ArrayLike) -> Any:
        """Return the law of each single decision on beliefs (T,X), which is the other decision maker's."""
        return self.decision_maker.decide_many(beliefs)

    def draw_path(self, beliefs: ArrayLike, *, rng: np.random.Generator) -> Any:
        """Return decisions (T,U), or choices (T,), along a path of beliefs (T,X) in the order of time.

        Raises:
            InputError: A belief is no probability vector, or `rng` is no generator.
        """
        held = validation.many_beliefs(beliefs, self.problem.n_states, names=self.problem.state_names)
        moved = np.abs(np.diff(held, axis=0)).max(axis=1, initial=0.0) > tolerances.SAME_BELIEF
        stay = np.concatenate([[0], np.cumsum(moved)])
        played = mechanism(self.decision_maker, held[np.concatenate([[True], moved])])
        drawn = RowDraws(played.sparse)(np.arange(len(played.beliefs)), validation.generator(rng))
        return played.actions[drawn[stay]]

    def memory_mechanism(self, beliefs: ArrayLike) -> MemoryMechanism:
        """Return the rule on beliefs (B,X) as a mechanism whose memory is the belief and the decision drawn for it.

        Memory 0 stands for no decision yet, memory 1 + p for the p-th entry of K above 0, row by row. It is private.

        Raises:
            InputError: Beliefs are malformed, or too many decisions are played on them.
        """
        played = mechanism(self.decision_maker, beliefs)
        return kept_mechanism(played)


def kept_mechanism(played: Mechanism) -> MemoryMechanism:
    """Return a mechanism whose draws are kept while the belief stays, as `KeptDecisionMaker.memory_mechanism` describes it."""
    entries = played.sparse.tocoo()
    belief, action, share = entries.row, entries.col, entries.data
    n_drawn = len(share)
    if n_drawn * (n_drawn + 1) > _MOST_ENTRIES:
        raise InputError(
            f"{n_drawn} pairs of belief and decision to remember need {n_drawn * (n_drawn + 1)} probabilities, at most "
            f"{_MOST_ENTRIES} are made: take fewer beliefs, or a lottery of fewer decisions"
        )
    count = n_drawn + 1
    before, drawn = (each.reshape(-1) for each in np.meshgrid(np.arange(count), np.arange(n_drawn), indexing="ij"))
    stays = (before > 0) & (belief[before - 1] == belief[drawn])
    chance: Array = np.where(stays, before - 1 == drawn, share[drawn])
    some = chance > 0
    before, drawn = before[some], drawn[some]
    rows, columns = belief[drawn].astype(np.int64) * count + before, action[drawn].astype(np.int64) * count + 1 + drawn
    shape = (len(played.beliefs) * count, len(played.actions) * count)
    table = sparse.csr_array((chance[some], (rows, columns)), shape=shape)
    return MemoryMechanism(played.beliefs, played.actions, table, np.eye(count)[0], played.regrets)
