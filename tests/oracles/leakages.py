"""What a mechanism gives away, by definition: loops over beliefs and decisions in plain Python."""

from __future__ import annotations

from collections.abc import Sequence
from math import log2, sqrt

Table = Sequence[Sequence[float]]


def joint(weights: Sequence[float], table: Table) -> list[list[float]]:
    """p(b,u) = w_b K(u|b)."""
    return [[w * k for k in row] for w, row in zip(weights, table, strict=True)]


def marginal(law: Table) -> list[float]:
    """p(u)."""
    return [sum(row[m] for row in law) for m in range(len(law[0]))]


def entropy(law: Sequence[float]) -> float:
    """In bits."""
    return -sum(p * log2(p) for p in law if p > 0)


def mutual_information(weights: Sequence[float], table: Table) -> float:
    """H(belief) + H(decision) − H(both), in bits."""
    law = joint(weights, table)
    return entropy(weights) + entropy(marginal(law)) - entropy([p for row in law for p in row])


def posterior(weights: Sequence[float], table: Table, m: int) -> list[float]:
    """p(b|u_m)."""
    column = [row[m] for row in joint(weights, table)]
    return [p / sum(column) for p in column]


def mean(weights: Sequence[float], beliefs: Table) -> list[float]:
    """Σ w π."""
    return [sum(w * b[i] for w, b in zip(weights, beliefs, strict=True)) for i in range(len(beliefs[0]))]


def squared(a: Sequence[float], b: Sequence[float]) -> float:
    """‖a − b‖²."""
    return sum((x - y) ** 2 for x, y in zip(a, b, strict=True))


def conditional_errors(weights: Sequence[float], table: Table, beliefs: Table) -> list[float]:
    """√E[‖π − E[π|u]‖² | π_b] of the beliefs with weight."""
    played = marginal(joint(weights, table))
    estimate = {m: mean(posterior(weights, table, m), beliefs) for m, p in enumerate(played) if p > 0}
    return [
        sqrt(sum(k * squared(beliefs[b], estimate[m]) for m, k in enumerate(row) if k > 0))
        for b, row in enumerate(table)
        if weights[b] > 0
    ]


def bayes_error(weights: Sequence[float], table: Table, beliefs: Table) -> float:
    """√E‖π − E[π|u]‖²."""
    held = [w for w in weights if w > 0]
    errors = conditional_errors(weights, table, beliefs)
    return sqrt(sum(w * e**2 for w, e in zip(held, errors, strict=True)))


def prior_error(weights: Sequence[float], beliefs: Table) -> float:
    """√E‖π − E[π]‖²."""
    middle = mean(weights, beliefs)
    return sqrt(sum(w * squared(b, middle) for w, b in zip(weights, beliefs, strict=True)))


def guess_right(law: Sequence[float], beliefs: Table) -> float:
    """Largest share of a law's beliefs that one state is a most likely state of."""
    states = range(len(beliefs[0]))
    return max(sum(p for p, b in zip(law, beliefs, strict=True) if b[i] >= max(b) - 1e-9) for i in states)


def top_state_accuracy(weights: Sequence[float], table: Table, beliefs: Table) -> float:
    """How often the best guess of a most likely state is right."""
    played = marginal(joint(weights, table))
    return sum(p * guess_right(posterior(weights, table, m), beliefs) for m, p in enumerate(played) if p > 0)


def min_entropy_leakage(weights: Sequence[float], table: Table) -> float:
    """In bits."""
    law = joint(weights, table)
    return log2(sum(max(row[m] for row in law) for m in range(len(table[0]))) / max(weights))


def maximal_leakage(weights: Sequence[float], table: Table) -> float:
    """In bits."""
    held = [row for w, row in zip(weights, table, strict=True) if w > 0]
    return log2(sum(max(row[m] for row in held) for m in range(len(table[0]))))


def pointwise_leakage(weights: Sequence[float], table: Table) -> float:
    """log2 max p(b|u)/p(b), in bits."""
    played = marginal(joint(weights, table))
    return max(
        log2(q / w)
        for m, p in enumerate(played)
        if p > 0
        for q, w in zip(posterior(weights, table, m), weights, strict=True)
        if q > 0
    )


def variation(p: Sequence[float], q: Sequence[float]) -> float:
    """½ Σ |p − q|."""
    return 0.5 * sum(abs(a - b) for a, b in zip(p, q, strict=True))


def errors_after(weights: Sequence[float], table: Table, beliefs: Table) -> tuple[float, float]:
    """Least error of naming the state, and least mean square error, after any decision that is played."""
    naming, square = [], []
    for m, p in enumerate(marginal(joint(weights, table))):
        if p > 0:
            law = posterior(weights, table, m)
            middle = mean(law, beliefs)
            naming.append(1.0 - max(middle))
            square.append(sum(q * squared(b, middle) for q, b in zip(law, beliefs, strict=True)))
    return min(naming), min(square)
