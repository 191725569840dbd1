"""A test of leakage without a model: learners predict the secret from decisions, forward in time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import Any

import numpy as np

from inscrutable import tolerances, validation
from inscrutable.adversaries.learners import learners
from inscrutable.errors import InputError
from inscrutable.experiments.audit.bounds import autocorrelations, design_effect, mean_limit, ratio_limit, share_limit
from inscrutable.experiments.audit.forward import N_BLOCKS, Forward, best_before, learn_forward, share_explained
from inscrutable.experiments.audit.pairs import Kind, PairedRows, Target, paired
from inscrutable.experiments.audit.results import LEVEL, POWER, BlockScore, PairsAudit, SecretAudit, Telling
from inscrutable.labels import label_text
from inscrutable.validation import Array

SHIFTS, SHIFTS_OF_MANY, MANY_ROWS = 99, 39, 20_000
_IN_STEPS = 20
_MANY_INDEPENDENT = 30
"""Independent rows above which limits of 95 % hold in 92 to 95 % of simulated audits of autocorrelated numbers and regimes."""
_HEAVY = 0.35
"""Skewness of squared deviations over √rows, at most 1, from which limits are cautioned. In simulations of 60 to 3,000 rows 62
to 82 % of samples of Student's t with 3 degrees of freedom are above (limits of 95 % held in 77 to 80 %), 57 to 98 % of
lognormal ones (73 to 89 %), and of normal ones 23 % with 60 rows (94 %) and .1 % with 300."""
_FORGOTTEN = math.exp(-1.0)
"""Autocorrelation of a secret below which rows count as independent."""
_LEAST_KNOWN = 3
"""Least number of training rows of the first predicted block, which only serves to choose a learner."""
_REPEATS = (
    "{name} repeats itself, so that more than one in twenty shifts leave it as it is: the test cannot find a leak of it, "
    "however large"
)
_ROUNDED = 0.01
"""Rounding may be large beside a number's range; what differs by more than this share of it does not repeat."""
_ALONE = ("ridge, penalty 0.01", "tree")
"""Learners for single columns."""


def audit_pairs(
    secrets: Any,
    published: Any,
    *,
    lags: Sequence[int] = (0,),
    embargo: int | None = None,
    kind: Kind | None = None,
    shifts: int | None = None,
    rng: np.random.Generator | None = None,
) -> PairsAudit:
    """Test whether published decisions leak secrets, from pairs of both and without a model.

    Rows are in order of time. The last six of ten blocks are test blocks; each is predicted by a learner fitted to the rows
    before it, minus an embargo. The learner (ridge, nearest neighbours, a tree) is the one of least error on the blocks before.
    The errors are therefore those of a feasible observer, and the best observer errs at most as much: the one-sided 95 % upper
    limit holds for the best observer too. The test statistic is the share explained, 1 − Σ (y − ŷ)² / Σ (y − ȳ)². Its null
    distribution comes from circular shifts of the secrets against the decisions, with learning and choice repeated for each: a
    shift keeps the autocorrelation of each series and removes the dependence between them.

    Args:
        secrets: One or more columns, (T,) or (T,S): numbers, or classes (text, truth values, whole numbers of at most ten
            values). Labels such as dates join the rows, as do whole numbers. Rows are joined by place, and must be as many,
            where a table is an array, both count rows from 0, or one does and the other has labels of another type.
        published: Decisions, (T,U): numbers, or choices in words.
        lags: Rows from the secret to its decision: 0 the same row, 1 the next one, −1 the one before, counting the rows of
            both tables in order of time.
        embargo: Rows left out between training and test rows; None: the range of the lags plus the rows after which the
            secret's autocorrelation is below 1/e, at most half a block.
        kind: "classes" or "numbers" for all secrets; None decides by the values.
        shifts: Largest number of circular shifts, at least 19; None: 99, or 39 above 20,000 rows. They are evenly spaced, and
            fewer if their distance would be less than the embargo.
        rng: Source of the bootstrap's draws; None is a fixed one, the same at every call.

    Returns:
        A `PairsAudit`. For each secret: the error and its limit, the error without decisions, the p-value, the leak that the
        test finds with a power of about 80 % if all rows leak alike, the date since which it leaks, and the share that each
        column and lag explains alone.

    Raises:
        InputError: The rows of the tables disagree or are numbered from different numbers, fewer than 60 rows are complete,
            numbers and text are mixed, nothing varies, or scikit-learn is missing.

    Cost: 2 s for 300 rows of ten columns and one secret, 30 s for 100,000 rows; proportional to the number of secrets.

    Source: Dawid, prequential analysis (1984), for errors made forward in time; Clopper and Pearson (1934), Götze and Künsch
    (1996) for the limits; permutation by circular shifts.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> regime = rng.random(400) < 0.5
        >>> weights = np.column_stack([regime + rng.normal(size=400), rng.normal(size=400)])
        >>> found = audit_pairs(regime, weights)
        >>> found.is_found, found.secrets[0].error_limit < found.secrets[0].guess_error
        (True, True)
    """
    source = np.random.default_rng(0) if rng is None else validation.generator(rng)
    makers = learners()
    asked = _checked_lags(lags)
    if kind not in (None, "classes", "numbers"):
        raise InputError(f'kind must be "classes" or "numbers", or None to tell by the values, got {kind!r}')
    pairs = paired(secrets, published, asked, kind)
    apart = _embargo(pairs, asked, embargo)
    draw = _shifts(len(pairs.index), apart, shifts)
    streams = dict(zip(sorted(each.name for each in pairs.targets), source.spawn(len(pairs.targets)), strict=True))
    runs = [learn_forward(pairs.features, each.values, draw, apart, makers) for each in pairs.targets]
    p_values, detectable = _judged(np.stack([run.explained() for run in runs]))
    repeats = (p_values[:, -1] > 1.0 - LEVEL) & [_repeats(each, draw) for each in pairs.targets]
    detectable = np.where(repeats, 1.0, detectable)
    level = 1.0 - (1.0 - LEVEL) / len(runs)
    found = [
        _finding(pairs, target, run, judged, apart, level, streams[target.name])
        for target, run, judged in zip(pairs.targets, runs, zip(p_values, detectable, strict=True), strict=True)
    ]
    judged = len(pairs.index) - runs[0].first - runs[0].n_before
    notes = (
        *pairs.notes,
        *_before(asked),
        *(_REPEATS.format(name=each.name) for each, again in zip(pairs.targets, repeats, strict=True) if again),
        *(note for each in pairs.targets for note in _few_independent(each, judged)),
        *(note for each in pairs.targets for note in _heavy_tailed(each)),
    )
    return PairsAudit(tuple(found), len(pairs.index), judged, apart, asked, len(draw) - 1, tuple(makers), notes)


def _before(lags: tuple[int, ...]) -> list[str]:
    """Return a caution where decisions are read that stand before their secret."""
    if lags[0] >= 0:
        return []
    return [
        f"at lag {lags[0]} the decision stands before its secret: what is found there is no leak, unless the secret was known "
        "earlier than its row says"
    ]


def _repeats(target: Target, draw: np.ndarray) -> bool:
    """Return whether so many shifts leave the secret as it is, but for rounding, that no p-value is significant."""
    values = target.values
    rounding = min(tolerances.CONSTANT_COLUMN * float(np.abs(values).max()), _ROUNDED * float(np.ptp(values)))
    same = [bool((np.abs(np.roll(values, int(shift), axis=0) - values) <= rounding).all()) for shift in draw]
    return float(np.mean(same)) > 1.0 - LEVEL + tolerances.BELIEF_SUM


def _few_independent(target: Target, judged: int) -> list[str]:
    """Return a caution where the test rows of a secret have a small effective number; of classes, that of the least."""
    worth = judged / max(design_effect(column) for column in target.values.T)
    if worth >= _MANY_INDEPENDENT:
        return []
    return [
        f"{target.name} is autocorrelated, so that {judged} test rows are worth about {max(worth, 1.0):.0f} independent ones, "
        "and the limit of its best observer's error is too low more often than in one audit of twenty (in simulations with ten "
        "such rows in one of ten, with two in one of four or five)"
    ]


def _heavy_tailed(target: Target) -> list[str]:
    """Return a caution where few rows make up much of a number's variance.

    Source: Hall, The Bootstrap and Edgeworth Expansion (1992): limits on a mean err in proportion to skewness over √rows.
    """
    squares = (target.values[:, 0] - target.values[:, 0].mean()) ** 2
    spread = squares.std()
    if target.kind != "numbers" or not spread > 0:
        return []
    if (((squares - squares.mean()) / spread) ** 3).mean() < _HEAVY * math.sqrt(len(squares)):
        return []
    return [
        f"{target.name} seems to have heavy tails: few rows make up much of its variance. Then the limit of its best "
        "observer's error is too low more often than in one audit of twenty (in simulations in up to one of four)"
    ]


def _checked_lags(lags: Sequence[int]) -> tuple[int, ...]:
    try:
        held = tuple(int(lag) for lag in lags)
        whole = all(int(lag) == lag for lag in lags)
    except (TypeError, ValueError):
        held, whole = (), False
    if not held or not whole or len(set(held)) < len(held):
        raise InputError(f"lags must be whole numbers of rows, each once, such as (0, 1), got {lags!r}")
    return tuple(sorted(held))


def _embargo(pairs: PairedRows, lags: tuple[int, ...], asked: int | None) -> int:
    """Return the rows left out before a block; at least the range of the lags, so that no decision is on both sides."""
    rows, reach = len(pairs.index), max(lags) - min(lags)
    most = rows // N_BLOCKS - _LEAST_KNOWN
    if asked is None:
        steps = max(_forgotten(column) for target in pairs.targets for column in target.values.T)
        found = max(reach, min(steps, rows // (2 * N_BLOCKS)))
    else:
        found = max(validation.count(asked, "embargo", least=0), reach)
    if found > most:
        long = f"lags reach over {reach} rows, which" if reach == found else f"embargo of {found} rows"
        raise InputError(f"{long} leaves too little to learn from in {rows} rows, expected at most {most}")
    return found


def _forgotten(column: Array) -> int:
    below = np.flatnonzero(np.abs(autocorrelations(column)) < _FORGOTTEN)
    return int(below[0]) if len(below) else len(column)


def _shifts(rows: int, embargo: int, asked: int | None) -> np.ndarray:
    """Return evenly spaced shifts, the identity first, a multiple of 20 of them, farther apart than the embargo if possible.

    Evenly spaced shifts form a group, so without a leak all of them are exchangeable. Leaving out only the shifts near the
    identity would not give a group, and would give too many false positives.
    """
    most = (SHIFTS if rows <= MANY_ROWS else SHIFTS_OF_MANY) if asked is None else asked
    validation.count(most, "shifts", least=_IN_STEPS - 1)
    count = _IN_STEPS * max(min(most + 1, rows // (embargo + 1)) // _IN_STEPS, 1)
    return np.asarray(np.round(np.arange(count) * (rows / count)), dtype=np.intp)


def _judged(explained: Array) -> tuple[Array, Array]:
    """Return the p-values after every test block (K,B), and the detectable shares (K,).

    Formula: the test statistic is the largest, over K secrets, of the shares explained (K,S,B) in standard scores over the
    shifts. The share detectable with power 1 − β is the least significant share, minus the mean share of a shift (the cost of
    learning), plus z_{1−β} spreads of shifts. A leak in few rows has a larger spread, so that its power is less.
    """
    centre, spread = explained.mean(axis=1, keepdims=True), explained.std(axis=1, keepdims=True)
    unit = np.where(spread > 0, spread, 1.0)
    scaled = (explained - centre) / unit
    largest = scaled.max(axis=0)
    p_values = (largest[None] >= scaled[:, :1]).mean(axis=1)
    n_shifts = explained.shape[1] - 1
    place = int((1.0 - LEVEL) * (n_shifts + 1) + tolerances.BELIEF_SUM)
    last = explained[:, 1:, -1]
    least = centre[:, 0, -1] + unit[:, 0, -1] * np.sort(largest[1:, -1])[n_shifts - max(place, 1)]
    reach = least - last.mean(axis=1) + NormalDist().inv_cdf(POWER) * last.std(axis=1)
    return np.asarray(p_values), np.asarray(np.clip(reach, 0.0, 1.0))


def _finding(
    pairs: PairedRows,
    target: Target,
    run: Forward,
    judged: tuple[Array, float],
    apart: int,
    level: float,
    rng: np.random.Generator,
) -> SecretAudit:
    p_values, detectable = judged
    truth, n_before = target.values[run.first :], run.n_before
    losses = _losses(target, np.concatenate([run.guesses[None], run.predictions]), truth)
    taken, guess = _taken(run, losses), losses[0]
    is_found = bool(p_values[-1] <= 1.0 - LEVEL)
    limits = [_limit(target, taken[n_before:], level, rng)]
    # Without a finding, the limit is the error without decisions.
    limits += [] if is_found else [_limit(target, guess[n_before:], level, rng)]
    # The lower limit on the best observer's R², 1 − mean squared error / variance of the secret.
    variance = (truth[n_before:, 0] - truth[n_before:, 0].mean()) ** 2
    is_sought = is_found and target.kind == "numbers"
    least = 1.0 - ratio_limit(taken[n_before:], variance, level, rng) if is_sought else 0.0
    since, noticed = _when(pairs, run, truth, p_values) if is_found else ("", "")
    return SecretAudit(
        name=target.name,
        kind=target.kind,
        classes=target.classes,
        is_found=is_found,
        p_value=float(p_values[-1]),
        error=_error(target, taken[n_before:].mean()),
        error_limit=_error(target, max(limits)),
        guess_error=_error(target, guess[n_before:].mean()),
        explained=float(run.explained()[0, -1]),
        explained_limit=least,
        detectable=float(detectable),
        since=since,
        noticed=noticed,
        sources=_sources(pairs, target, apart),
        blocks=_scores(pairs, target, run, (taken, guess)),
    )


def _losses(target: Target, predictions: Array, truth: Array) -> Array:
    """Return the loss of every learner (L,n,C) in every row: 1 for the wrong class, or the squared error."""
    if target.kind == "numbers":
        return np.asarray((predictions[:, :, 0] - truth[:, 0]) ** 2)
    return np.asarray(predictions.argmax(axis=2) != truth.argmax(axis=1), dtype=np.float64)


def _taken(run: Forward, losses: Array) -> Array:
    """Return the losses of the learner of least loss on earlier blocks; the guess without decisions is one learner."""
    sums = np.add.reduceat(losses, [start - run.first for start, _ in run.bounds], axis=1)
    chosen = best_before(sums[:, None])[0]
    return np.asarray(losses[chosen[run.block_of()], np.arange(losses.shape[1])])


def _error(target: Target, loss: float) -> float:
    """Return a mean loss as an error: the share wrong, or the root mean square."""
    return float(np.sqrt(loss) if target.kind == "numbers" else loss)


def _limit(target: Target, losses: Array, level: float, rng: np.random.Generator) -> float:
    return share_limit(losses, level) if target.kind == "classes" else mean_limit(losses, level, rng)


def _gains(run: Forward, truth: Array) -> tuple[Array, Array]:
    """Return by row the guess's squared error minus the chosen learner's, and the guess's."""
    predicted = run.predictions[run.chosen()[0][run.block_of()], np.arange(len(truth))]
    guess = ((truth - run.guesses) ** 2).sum(axis=1)
    return np.asarray(guess - ((truth - predicted) ** 2).sum(axis=1)), np.asarray(guess)


def _when(pairs: PairedRows, run: Forward, truth: Array, p_values: Array) -> tuple[str, str]:
    """Return the row since which decisions leak (least summed gain), and the row from which the p-value stays low."""
    total = np.concatenate([[0.0], _gains(run, truth)[0].cumsum()])
    start = run.first + int(total[:-1].argmin())
    high = np.flatnonzero(p_values > 1.0 - LEVEL)
    block = run.judged_from + (int(high[-1]) + 1 if len(high) else 0)
    return label_text(pairs.index[start]), label_text(pairs.index[run.bounds[block][1] - 1])


def _scores(pairs: PairedRows, target: Target, run: Forward, losses: tuple[Array, Array]) -> tuple[BlockScore, ...]:
    shares, chosen = share_explained(run.taken()[0], run.guess_squares[0]), run.chosen()[0]
    found = []
    for b, (start, stop) in enumerate(run.bounds):
        error, guess = (_error(target, each[start - run.first : stop - run.first].mean()) for each in losses)
        labels = label_text(pairs.index[start]), label_text(pairs.index[stop - 1])
        found.append(BlockScore(*labels, error, guess, float(shares[b]), run.names[chosen[b]], b >= run.judged_from))
    return tuple(found)


def _sources(pairs: PairedRows, target: Target, embargo: int) -> tuple[Telling, ...]:
    """Return the share that each column, and each of several lags, explains alone."""
    makers = {name: make for name, make in learners().items() if name in _ALONE}
    columns, lags = tuple(dict.fromkeys(pairs.columns)), sorted(set(pairs.lags))
    parts = [("column", name, [k for k, each in enumerate(pairs.columns) if each == name]) for name in columns]
    if len(lags) > 1:
        parts += [("lag", f"{lag}", [k for k, each in enumerate(pairs.lags) if each == lag]) for lag in lags]
    needed = NormalDist().inv_cdf(1.0 - (1.0 - LEVEL) / len(parts))
    found = []
    for kind, name, places in parts:
        run = learn_forward(pairs.features[:, places], target.values, np.zeros(1, dtype=np.intp), embargo, makers)
        gains, guess = (each[run.n_before :] for each in _gains(run, target.values[run.first :]))
        share, error, total = 0.0, 0.0, float(guess.sum())
        if total > 0:  # else the guess makes no error, and there is nothing to explain
            share = float(gains.sum()) / total
            off = gains - share * guess
            error = float(np.sqrt(design_effect(off) * len(off)) * off.std()) / total
        found.append(Telling(kind, name, share, error, bool(share > needed * error)))
    return tuple(found)
