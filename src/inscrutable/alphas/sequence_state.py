"""What a sequence of decisions about a private mean remembers, as a file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inscrutable import tolerances, validation
from inscrutable.errors import InputError
from inscrutable.files import PathLike
from inscrutable.saved import Saved
from inscrutable.validation import Array

VERSION = 1


@dataclass(frozen=True, eq=False)
class AlphaState(Saved):
    """What is saved of a sequence: no private mean, no generator and no seed. The aware observer can compute all of it.

    Args:
        rule: What the rule is of; a file goes on under the same rule alone, so that what it is of stays frozen.
        mean: The observer's mean, (k,).
        before: P before the step's decision, (k,k); None where it is the rule's own.
        is_published: Whether the step's decision is published.
        n_published: Decisions published.
        n_steps: Steps passed.
        regret: Of all decisions, by the observer's law.
        bits: That they told.
        latest: The last decision, (n,), or None.
        version: Of the file.
    """

    rule: tuple[Array, ...]
    mean: Array
    before: Array | None
    is_published: bool
    n_published: int
    n_steps: int
    regret: float
    bits: float
    latest: Array | None = None
    version: int = VERSION

    def __post_init__(self) -> None:
        if self.version != VERSION:
            raise InputError(f"its version is {self.version!r}, expected {VERSION}")
        for name in ("n_published", "n_steps"):
            validation.count(getattr(self, name), name, least=0)
        validation.finite_array(self.mean, "mean", ndim=1)

    def checked(self, rule: tuple[Array, ...], path: PathLike) -> AlphaState:
        """Return this, or raise `InputError` where the rule is another than that of the file."""
        same = len(rule) == len(self.rule) and all(map(_agree, rule, self.rule))
        if not same:
            raise InputError(
                f"{path} cannot be gone on with: it is of another rule (another law of the means, problem or budget). A law "
                "that is estimated afresh from private means would tell of them: keep the one that the sequence began with"
            )
        return self


def _agree(one: Array, other: Array) -> bool:
    if one.shape != other.shape:
        return False
    size = float(np.abs(one[np.isfinite(one)]).max(initial=0.0))
    return bool(np.allclose(one, other, rtol=tolerances.SAME_RULE, atol=tolerances.SAME_RULE * size))
