"""The cells of a proof with their bounds, which are computed exactly only where needed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable.decision_makers.proofs.cell_programmes import allowed_weights, bounds_by, cell_weights
from inscrutable.validation import Array


class DescribedCells(NamedTuple):
    """Cells with bounds of the gain at their corners and of the regret; `final` ones are not cut."""

    corners: np.ndarray  # (C,X)
    gains: Array  # (C,X)
    regrets: Array  # (C,X,K)
    final: np.ndarray  # (C,)
    lost: Array  # (C,) largest loss of `regrets` because decisions between corners are not known
    kinks: np.ndarray  # (C,) how often in a row a cell was cut at a kink

    def pick(self, which: np.ndarray) -> DescribedCells:
        """Return some of them."""
        return DescribedCells(*(part[which] for part in self))


class BoundedCells:
    """Cells with bounds (C,) for one question: first by the weights of the last question, exact on demand."""

    def __init__(self, cells: DescribedCells) -> None:
        self.cells = cells
        self._weights = np.zeros(cells.regrets.shape[::2])
        self.ask(0.0, None)

    def ask(self, budget: float, multiplier: float | None) -> None:
        """Set another question: the largest gain under a budget, or the largest gain minus `multiplier` times the regret."""
        self._budget, self._multiplier = budget, multiplier
        self._weights = allowed_weights(self._weights, multiplier)
        self._exact = np.zeros(len(self.cells.final), dtype=np.bool_)
        self.bounds = self._by_weights(np.arange(len(self.cells.final)))

    def largest(self) -> float:
        """Return the largest bound, −∞ without cells."""
        return float(self.bounds[self._worst(np.arange(len(self.bounds)), 1)].max(initial=-np.inf))

    def above(self, floor: float) -> np.ndarray:
        """Return the cells whose exact bounds are above a floor."""
        self._refine(np.flatnonzero((self.bounds > floor) & ~self._exact))
        return np.flatnonzero(self.bounds > floor)

    def worst_open(self, floor: float, most: int) -> np.ndarray:
        """Return at most `most` cells that are not final, those of the largest exact bounds above a floor."""
        worst = self._worst(np.flatnonzero((self.bounds > floor) & ~self.cells.final), most)
        return np.asarray(worst[self.bounds[worst] > floor])

    def without_loss(self, which: np.ndarray) -> Array:
        """Return an estimate of the bounds of some cells if decisions between corners were known."""
        return np.asarray(self.bounds[which] - self._weights[which].sum(axis=1) * self.cells.lost[which])

    def keep(self, which: np.ndarray) -> None:
        """Keep only the cells `which` (C,)."""
        self.cells = self.cells.pick(which)
        self._weights, self._exact, self.bounds = self._weights[which], self._exact[which], self.bounds[which]

    def close(self, cell: int, gain: float, regret: float) -> None:
        """Make a cell final: its privacy is the same throughout."""
        self.cells.gains[cell], self.cells.regrets[cell], self.cells.final[cell] = gain, regret, True
        self._exact[cell] = False

    def take(self, others: BoundedCells) -> None:
        """Add cells that were bounded for the same question."""
        self.cells = DescribedCells(*(np.concatenate(pair) for pair in zip(self.cells, others.cells, strict=True)))
        self._weights = np.concatenate([self._weights, others._weights])
        self._exact = np.concatenate([self._exact, others._exact])
        self.bounds = np.concatenate([self.bounds, others.bounds])

    def _worst(self, among: np.ndarray, most: int) -> np.ndarray:
        while True:
            worst = among[np.argsort(-self.bounds[among], kind="stable")[:most]]
            rough = worst[~self._exact[worst]]
            if not rough.size:
                return np.asarray(worst)
            self._refine(rough)

    def _refine(self, which: np.ndarray) -> None:
        gains, regrets = self.cells.gains[which], self.cells.regrets[which]
        self._weights[which] = cell_weights(gains, regrets, self._budget, self._multiplier)
        self.bounds[which] = self._by_weights(which)
        self._exact[which] = True

    def _by_weights(self, which: np.ndarray) -> Array:
        price = self._budget if self._multiplier is None else 0.0
        return bounds_by(self._weights[which], self.cells.gains[which], self.cells.regrets[which], price)
