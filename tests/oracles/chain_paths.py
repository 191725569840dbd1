"""All paths of a belief that moves, one by one."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise, product

from inscrutable.mechanisms.chains import BeliefChain


def every_path(chain: BeliefChain, n_steps: int) -> Iterator[tuple[list[int], float]]:
    """Yield every path of a length with its probability."""
    transition = chain.transition.toarray()
    for path in product(range(len(chain.prior)), repeat=n_steps):
        chance = chain.prior.weights[path[0]]
        for before, after in pairwise(path):
            chance *= transition[before, after]
        yield list(path), float(chance)
