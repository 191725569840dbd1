"""The verdict of a backtest: the answer in one sentence, then its basis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.experiments.backtest_results import SEQUENTIAL, Backtest, moves_little
from inscrutable.experiments.backtest_sequential import SHARE_OF_SILENCE
from inscrutable.experiments.holding import Reached, Requirement, best_ranking, estimate_quality
from inscrutable.experiments.performance import LEVEL
from inscrutable.labels import listed
from inscrutable.reports.names import FULL_NAMES, full_name

_POINTS = 1e4  # basis points of a return
_FAR_ABOVE = 3.0
"""The worst decision is told where its regret exceeds the mean by this factor."""
_CLEARLY = 0.05
"""A caution compares two errors where one is smaller by this share of the error without weights."""
_COARSE = 0.1
"""The same for the aware observer's error above the naive one's; it is .04 on the packaged returns."""
_ANOTHER_LAW = 1.5
"""Factor by which the error without weights exceeds the law's own for a caution; it is .84 on the packaged returns."""
_NEARLY_ALWAYS = 0.9
"""A commonest regime that is right in more of the decisions than this leaves few to judge by."""


def answer(result: Backtest) -> str:
    """Return one sentence: which weights hide the belief from whom, and at what price, or that there is nothing to hide.

    It is empty where that is not judged.
    """
    hiding = result.names[1:]
    nothing = nothing_to_hide(result)
    if nothing:
        said = [
            f"{each.what} to hide from {_observers(whom)}: {each.why}" for each, whom in _by_reason(nothing).items()
        ]
        return f"In short: there is {'; there is '.join(said)}{_dearer_than_silence(result)}."
    figures = result.figures
    if result.aware is None or not hiding:
        return ""
    if any(np.isnan(figures[name]["error_followed"]) for name in hiding):
        return ""
    asked = _asked(result)
    groups: dict[str, list[str]] = {}
    unsure, _ = _poor_estimates(result)
    for name in hiding:
        naive, aware = (asked.is_met(seen.reached(name, figures[name])) for seen in _SEEN.values())
        read = None if np.isnan(figures[name]["error_face_value"]) else naive
        groups.setdefault(_HIDING[read, None if aware and name in unsure else aware], []).append(name)
    unit, worth = f" basis points of risk-adjusted return a {result.market.frequency.word}", _worth(result)
    if worth > 0.0:
        unit += f" (the belief is worth {_basis_points(worth)})"
    parts: list[str] = []
    cost = "a cost of "
    for hide in filter(groups.__contains__, _HIDING.values()):
        names = groups[hide]
        prices = listed(
            [_basis_points(figures[name]["mean_regret"]) + _bracketed(_worst(result, name)) for name in names]
        )
        what = hide.format("it" if parts else f"the investor's belief over {len(result.regimes)} market regimes")
        parts.append(f"{listed([full_name(name) for name in names])} weights {what}, at {cost}{prices}{unit}")
        unit = cost = ""
    if _few_others(result):
        parts.append(_few_others(result))
    return f"In short: {'; '.join(parts)}{_dearer_than_silence(result)}."


class _Nothing(NamedTuple):
    """The quantity of which there is nothing to hide, and the reason, as text."""

    what: str
    why: str


def nothing_to_hide(result: Backtest) -> dict[str, _Nothing]:
    """Return the reasons by observer from whom there is nothing to hide; empty where the optimal weights reveal the belief.

    The optimal weights, without protection, then leave an observer no more than is known without them: the belief rests, the
    commonest regime is right as often as the observer, or these weights count as hidden themselves.
    """
    own, word = result.figures[result.names[0]], result.market.frequency.word
    seen = {who: each for who, each in _SEEN.items() if who == "naive" or result.aware is not None}
    if moves_little(result.beliefs):
        why = f"the belief hardly moves over these {len(result.beliefs)} {word}s, and its mean tells it without any weights"
        return dict.fromkeys(seen, _Nothing("nothing", why))
    found, named, is_read = {}, 0.0, False
    weights = f"the {FULL_NAMES['ODM']} weights, without protection,"
    for who, keys in seen.items():
        reached, without = keys.reached(result.names[0], own), own["error_without"]
        # What the naive observer reads, the weights reveal to the aware one, too; NaN, where it reads none, is no reason.
        named = float(np.maximum(named, reached.named))
        is_hidden = _asked(result).is_met(reached) if result.aware is not None else False
        is_read = is_read or (not is_hidden and np.isfinite(reached.error))
        if is_hidden and not is_read:
            found[who] = _Nothing("nothing", f"{weights} pass for hidden as well")
        elif named <= own["base_rate"]:
            why = (
                f"{weights} reveal no likeliest regime that the commonest one does not (named in {reached.named:.0%} of "
                f"{len(result.beliefs)} {word}s, the commonest alone is right in {own['base_rate']:.0%})"
            )
            if reached.error < without:
                why += f", only how likely it is (error {reached.error:.2f}, without weights {without:.2f})"
            found[who] = _Nothing("no regime", why)
    return found


def _by_reason(nothing: Mapping[str, _Nothing]) -> dict[_Nothing, tuple[str, ...]]:
    """Return the observers by reason; both under the naive observer's where the reasons differ in figures alone."""
    observers, reasons = tuple(nothing), list(nothing.values())
    if len({each.why.partition(" (")[0] for each in reasons}) == 1:
        return {reasons[0]: observers}
    return {each: (who,) for who, each in nothing.items()}


def _observers(whom: tuple[str, ...]) -> str:
    return "either observer" if len(whom) > 1 else f"the {whom[0]} observer"


def _dearer_than_silence(result: Backtest) -> str:
    """Return a clause on the rules that cost at least as much as a constant portfolio known beforehand; empty without any."""
    silence = result.known_silence_regret
    spent = {name: result.figures[name]["mean_regret_unlimited"] for name in result.names[1:]}
    dear = [full_name(name) for name, regret in spent.items() if regret > 0.0 and regret >= silence]
    if not dear:
        return ""
    return (
        f"; {listed(dear)} weights cost at least as much as silence, a constant portfolio known beforehand, which reveals "
        f"nothing, at {_basis_points(silence)}: rather than use them, it is cheaper not to act on the belief at all"
    )


def _bracketed(text: str) -> str:
    return f" ({text})" if text else ""


def _worst(result: Backtest, name: str) -> str:
    """Return the largest regret of one decision where it is far above the mean; otherwise nothing."""
    regret, word = result.episode.records[name].decisions.regret, result.market.frequency.word
    if not regret.max() > _FAR_ABOVE * regret.mean() > 0.0:
        return ""
    date = result.dates[int(regret.argmax())]
    when = f"{date:%Y-%m}" if word == "month" else f"{date:%Y-%m-%d}"
    return f"{_basis_points(float(regret.max()))} in the worst {word}, {when}"


def _worth(result: Backtest) -> float:
    """Return what the belief is worth to the investor: the regret of the constant portfolio for its long-run mean, or NaN."""
    known = result.aware is not None and result.rival_is_own
    return result.figures[result.names[0]]["worth_secret"] if known else float("nan")


class _Seen(NamedTuple):
    """Keys of the figures of one observer."""

    error: str
    named: str

    def reached(self, name: str, figures: Mapping[str, float]) -> Reached:
        """Return the observer's error and naming under a decision maker."""
        return Reached(name, figures[self.error], figures[self.named])


_SEEN = {
    "naive": _Seen("error_face_value", "share_regime_named"),
    "aware": _Seen("error_followed", "share_regime_named_followed"),
}
_HIDING = {
    (True, True): "hide {} from both observers, naive and aware of the rule",
    (True, None): "hide {} from the naive observer (from the aware one it cannot be judged)",
    (False, True): "hide {} from the aware observer alone",
    (None, True): "hide {} from the aware observer (no belief explains them to the naive one)",
    (True, False): "hide {} from the naive observer alone",
    (None, None): "may hide {} (the naive observer finds no belief, and from the aware one it cannot be judged)",
    (False, None): "do not hide {} from the naive observer (from the aware one it cannot be judged)",
    (None, False): "do not hide {} from the aware observer (no belief explains them to the naive one)",
    (False, False): "hide {} from neither observer",
}
"""Text for the observers from whom a belief is hidden, by (naive, aware).

It is None of a naive observer to whom no belief explains the weights, and where it seems hidden to poor estimates.
"""


def verdict(result: Backtest) -> list[str]:
    """Return the verdict, one line each: the answer, its limits, cheaper silence, the estimates, who hides, the price."""
    figures, word = result.figures, result.market.frequency.word
    odm, *hiding = result.names
    own = figures[odm]
    first, nothing = answer(result), nothing_to_hide(result)
    lines = list(filter(None, [first or _unjudged(result), _holds(result) if first else "", _silence(result)]))
    lines.append(
        f"Without protection: from the {FULL_NAMES['ODM']} weights, an observer names the investor's likeliest regime in "
        f"{_share(own['share_regime_named'])} of {len(result.beliefs)} {word}s; always naming the commonest is right in "
        f"{_share(own['base_rate'])}."
    )
    if not hiding:
        return lines
    if result.aware is None:
        named = listed([f"{_share(figures[name]['share_regime_named'])} ({full_name(name)})" for name in hiding])
        lines.append(f"The naive observer names it from altered weights in {named}.")
        if SEQUENTIAL in hiding and not np.isnan(figures[SEQUENTIAL]["error_followed"]):
            share, error = (figures[SEQUENTIAL][key] for key in ("share_regime_named_followed", "error_followed"))
            lines.append(
                f"Read by the aware observer from all {full_name(SEQUENTIAL)} weights so far: {_share(share)} (error "
                f"{error:.2f})."
            )
    else:
        asked = _asked(result)
        described = {
            "naive": "naive observer, who takes the weights at face value",
            "aware": f"aware observer, who knows the rules and follows all {word}s",
        }
        for who, seen in _SEEN.items():
            # What even a poor observer reads is not hidden from a better one.
            unsure = _poor_estimates(result)[0] if who == "aware" else set()
            poor = [name for name in hiding if name in unsure and asked.is_met(seen.reached(name, figures[name]))]
            told = asked.judge([seen.reached(full_name(name), figures[name]) for name in hiding if name not in poor])
            if poor:
                unknown = (
                    f"{listed([full_name(name) for name in poor])} cannot be judged, as its estimates are poor here"
                )
                told = unknown if len(poor) == len(hiding) else f"{told}; {unknown}"
            if who in nothing:
                told = f"cannot be judged, as there is {nothing[who].what} to hide"
            lines.append(f"Hidden from the {described[who]}: {told}.")
    return [*lines, _price(result, hiding, worst=not first or bool(nothing))]


def limits(result: Backtest) -> list[str]:
    """Return the basis of the verdict, one line each: the meaning of "hidden", names and budgets, and ceilings."""
    names = "; ".join(f"{name}: {FULL_NAMES[name]}" for name in result.names if name in FULL_NAMES)
    hiding = result.names[1:]
    said = [f"{names}."]
    if hiding:
        said.append(_budgets(result, hiding))
        sharpe = listed([f"{_change(result.figures[name])} ({name})" for name in hiding])
        said.append(
            f"Realised: the yearly Sharpe ratio after trading costs, against the {FULL_NAMES['ODM']} weights, changes by "
            f"{sharpe}; in brackets {LEVEL:.0%} intervals."
        )
    if result.aware is None or len(result.names) == 1:
        return said
    asked = _asked(result)
    meaning = asked.meaning(without="weights", state="regime", cases=f"{result.market.frequency.word}s")
    return [meaning, *said, *_ceilings(result)]


def _budgets(result: Backtest, hiding: Sequence[str]) -> str:
    """Return what each rule may spend, and in which mean."""
    word, part = result.market.frequency.word, result.sequential
    rules = listed([name for name in hiding if name != SEQUENTIAL])
    said = f"Budgets. {rules}: {result.budget} each {word}, PDM on average over its two outcomes."
    if part is None:
        return said
    share = f" ({SHARE_OF_SILENCE:.0%} of the {_basis_points(part.silence_regret)} that silence costs)"
    return (
        f"{said} {SEQUENTIAL}: in the long run of the model's regimes {_basis_points(part.maker.limit)} basis points a {word} "
        f"on average{share if result.settings.budget is None else ''}; a single {word} may cost more."
    )


def _asked(result: Backtest) -> Requirement:
    own = result.figures[result.names[0]]
    return Requirement(own["error_without"], own["base_rate"])


def _price(result: Backtest, hiding: Sequence[str], *, worst: bool) -> str:
    """Return the price of every rule; `worst`: with the worst decision, where the answer does not say it."""
    figures = result.figures
    shares = [figures[name]["mean_regret_share"] for name in hiding]
    who = {
        name: "; ".join(
            filter(None, [full_name(name), _expected(figures[name]), _worst(result, name) if worst else ""])
        )
        for name in hiding
    }
    points = [f"{_basis_points(figures[name]['mean_regret'])} ({who[name]})" for name in hiding]
    word = result.market.frequency.word
    price = f"Price: a regret of {listed(points)} basis points a {word} by the investor's own belief"
    if result.settings.turnover is not None:
        above = listed(
            [f"{_points(each['mean_regret_unlimited'], 3)} ({full_name(name)})" for name, each in figures.items()]
        )
        return (
            f"{price}, each against the best that the limit on turnover allows after the rule's own last weights. Against the "
            f"best without a limit: {above}."
        )
    if not np.isfinite(shares).all():
        return f"{price}."  # c* is 0
    optimal = np.abs(result.episode.records[result.names[0]].decisions.optimal_cost).mean()
    parts = listed([f"{share:.1%}" for share in shares])
    return f"{price}, {parts} of |c*|, the size of the optimal cost, {_basis_points(optimal)} basis points a {word} on average."


_LUCK = 0.1
"""Share of the expected regret by which that of the decisions drawn may differ before both are stated."""


def _expected(figures: Mapping[str, float]) -> str:
    """Return the expected regret of a rule whose draws happened to cost much more or less; else nothing."""
    mean, drawn = figures["mean_expected_regret"], figures["mean_regret"]
    return f"{_basis_points(mean)} in expectation" if abs(drawn - mean) > _LUCK * mean else ""


def _basis_points(value: float) -> str:
    """Return a return in basis points with two significant digits, without an exponent; rounding errors are 0."""
    return _points(value, 2)


def _points(value: float, digits: int) -> str:
    points = float(f"{_POINTS * value:.6f}")
    return f"{float(f'{points:.{digits}g}') + 0.0:g}"


def _holds(result: Backtest) -> str:
    """Return limits of the answer: other draws, and observers who see more than weights; empty without any."""
    return " ".join([*_beyond_public(result), *_of_other_law(result), *_other_draws(result)])


def _of_other_law(result: Backtest) -> list[str]:
    """Return a line where the beliefs rest on more than what the aware observer's law of them does."""
    reads = result.investor.reads
    if result.aware is None or not reads or result.public.number:
        return []
    return [
        f"The aware observer's law of the belief is that of the model's regimes, without {reads}: one who knows how these move "
        "the belief may read more."
    ]


def _beyond_public(result: Backtest) -> list[str]:
    """Return a line if public returns alone reveal the belief."""
    if result.figures[result.names[0]]["error_all_returns"] > tolerances.SAME_BELIEF:
        return []
    return [
        f"This holds for observers who see the weights alone: {result.public.these} are public, and an observer who follows "
        "all of them with this model knows the belief without any weights."
    ]


def _ceilings(result: Backtest) -> list[str]:
    """Return a line on the largest error of any rule of the same regret in the long run; none if it is not known."""
    known = {name: result.figures[name] for name in result.names[1:]}
    known = {name: each for name, each in known.items() if np.isfinite(each["error_ceiling"])}
    if not known or result.sequential is None:
        return []
    without, here = result.sequential.maker.chain.prior.error, result.figures[result.names[0]]["error_without"]
    where = "nearer to" if here < without else "farther from"
    names = listed(list(known))
    most = listed([f"{each['error_ceiling']:.2f}" for each in known.values()])
    spent = listed([_basis_points(each["mean_regret_long_run"]) for each in known.values()])
    word = result.market.frequency.word
    return [
        f"Ceiling: at the regret of {names} in the long run of the model's regimes ({spent} basis points a {word}), "
        f"no rule on the candidate portfolios leaves the aware observer an error above {most} there. The error without weights "
        f"is {without:.2f} there; in these {word}s it is {here:.2f}, because their beliefs lie {where} the long-run mean."
    ]


def _other_draws(result: Backtest) -> list[str]:
    """Return a line on the other draws in which the sequential rule hides the belief; none where that is not judged."""
    if result.aware is None or result.sequential is None or not result.sequential.others:
        return []
    asked, beliefs, others = _asked(result), result.beliefs.to_numpy(), result.sequential.others
    if "aware" in nothing_to_hide(result) or SEQUENTIAL in _poor_estimates(result)[0]:
        return []
    held = sum(asked.is_met(Reached(SEQUENTIAL, *estimate_quality(each, beliefs))) for each in others)
    return [
        f"The {FULL_NAMES[SEQUENTIAL]} rule draws its decisions: {held or 'none'} of {len(others)} other runs over all "
        f"{result.market.frequency.word}s would have hidden the belief from the aware observer."
    ]


def cautions(result: Backtest) -> list[str]:
    """Return cautions on the verdict: nothing to hide, few decisions to judge by, and hiding that is weak."""
    figures = result.figures
    odm, *hiding = result.names
    optimal = figures[odm]["share_regime_named"]
    said, nothing = [], nothing_to_hide(result)
    if nothing and hiding:
        said += [
            f"The verdict judges no rule against {_observers(whom)}: there is {each.what} to hide."
            for each, whom in _by_reason(nothing).items()
        ]
    if hiding and _few_others(result) and len(nothing) < len(_SEEN):
        said.append(f"Few {result.market.frequency.word}s tell whether the regime is hidden: {_few_others(result)}.")
    said += filter(None, [_poor_estimates(result)[1]])
    if result.sequential is not None:
        said += filter(None, [result.sequential.maker.calibration.caution()])
    if "aware" not in nothing:
        said += filter(None, [_ranked(result, name) for name in hiding])
    for name in filter(lambda each: _informs(result, each), hiding):
        errors = (f"{figures[each]['error_followed']:.2f}" for each in (name, odm))
        said.append(
            f"{name} informs the aware observer better than no protection: error {' instead of '.join(errors)}."
        )
    naming = Requirement(0.0, figures[odm]["base_rate"])  # the error without decisions may not be known
    for name in hiding:
        named = figures[name]["share_regime_named"]
        if opposite := naming.opposite(named, result.regimes):
            said.append(f"{name}: {opposite}")
        elif result.aware is None and named > naming.most_named:
            said.append(
                f"{name}: the likeliest regime is hardly hidden: named in {_share(named)} instead of {_share(optimal)}."
            )
    return said


def _ranked(result: Backtest, name: str) -> str:
    """Return a caution where the aware observer ranks a regime well under a rule that counts as hiding; else nothing."""
    if result.aware is None or name in _poor_estimates(result)[0]:
        return ""
    if not _asked(result).is_met(_SEEN["aware"].reached(name, result.figures[name])):
        return ""
    ranking = best_ranking(result.followed_estimates(name).to_numpy(), result.beliefs.to_numpy())
    told = "" if ranking is None else ranking.told(result.regimes, result.market.frequency.word)
    return told and f"{name} counts as hiding from the aware observer, but {told}"


def _informs(result: Backtest, name: str) -> bool:
    """Whether the aware observer over time errs clearly less under a rule than under optimal decisions."""
    unprotected, reached = (result.figures[each]["error_followed"] for each in (result.names[0], name))
    return bool(reached < unprotected - _CLEARLY * result.figures[name]["error_without"])


def _poor_estimates(result: Backtest) -> tuple[set[str], str]:
    """Return the rules of which the aware observer's estimates are poorer than they can be, and why; empty for none.

    It has another law of the belief, or errs more than the naive observer, who knows less.
    """
    if result.aware is None:
        return set(), ""
    figures = {
        name: each for name, each in result.figures.items() if each["bits_followed"] != 0.0
    }  # the others say nothing
    if result.names[0] not in figures:
        return set(), ""
    here, there = figures[result.names[0]]["error_without"], result.aware.prior.error
    if here > max(_ANOTHER_LAW * there, tolerances.SAME_BELIEF):
        return set(figures), (
            "The aware observer expects the belief's long-run law in the model's regimes, and these beliefs follow another: "
            f"without weights it errs by {here:.2f} instead of {there:.2f}. One who knows their law may read them."
        )
    others = {name: each for name, each in figures.items() if name != SEQUENTIAL}  # whose grid is that of its observer
    coarse = [
        f"{each['error_followed']:.2f} instead of {each['error_face_value']:.2f} under {name}"
        for name, each in others.items()
        if each["error_followed"] > each["error_face_value"] + _COARSE * here
    ]
    if not coarse:
        return set(), ""
    return set(others), (
        f"The aware observer errs more than the naive one ({', '.join(coarse)}), though it knows more: where many beliefs "
        "explain a decision, its grid is too coarse to tell how likely each is. A better one reads more than this."
    )


def _few_others(result: Backtest) -> str:
    """Return a clause on a commonest regime that is nearly always right; empty for any other."""
    rate, cases, word = result.figures[result.names[0]]["base_rate"], len(result.beliefs), result.market.frequency.word
    if not _NEARLY_ALWAYS < rate < 1.0:
        return ""
    return (
        f"in only {cases - round(rate * cases)} of {cases} {word}s the likeliest regime is another than the commonest"
    )


def _unjudged(result: Backtest) -> str:
    """Return that no rule is judged under a limit on turnover; else nothing."""
    if result.settings.turnover is None or len(result.names) < 2:
        return ""
    return (
        "No rule is judged: under a limit on turnover the aware observer is modelled for the sequential rule alone, and the "
        "naive observer's errors tell nothing about it."
    )


def _silence(result: Backtest) -> str:
    """Return a line on the constant portfolio where it costs less than hiding; empty where it does not."""
    spent = {name: result.figures[name]["mean_regret_unlimited"] for name in result.names[1:]}
    dearer = {name: regret for name, regret in spent.items() if regret > result.silence_regret}
    if not dearer:
        return ""
    worth, beforehand = _worth(result), ""
    if worth > 0.0:
        beforehand = (
            " The best one known beforehand, that for the long-run mean of the belief, would have cost "
            f"{_points(worth, 3)}, which is what the belief is worth."
        )
    return (
        "In hindsight silence would have been cheaper: the best constant portfolio for these beliefs reveals nothing and would "
        f"have cost {_points(result.silence_regret, 3)} basis points a {result.market.frequency.word} instead of "
        f"{listed([f'{_points(each, 3)} ({full_name(name)})' for name, each in dearer.items()])}.{beforehand}"
    )


def _change(figures: Mapping[str, float]) -> str:
    difference, low, high = (figures[f"annual_sharpe_net_minus_odm{end}"] for end in ("", "_low", "_high"))
    return "an undefined amount" if np.isnan(difference) else f"{difference:+.2f} [{low:+.2f}, {high:+.2f}]"


def _share(value: float) -> str:
    if np.isnan(value):
        return "no share (no weights that a belief explains)"
    return f"{value:.1%}" if 0.0 < value < 1.0 and f"{value:.0%}" in ("0%", "100%") else f"{value:.0%}"
