"""The verdict of a backtest: the answer in one sentence, then its basis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.experiments.backtest_results import SEQUENTIAL, Backtest
from inscrutable.experiments.backtest_sequential import SHARE_OF_SILENCE
from inscrutable.experiments.holding import Reached, Requirement, estimate_quality
from inscrutable.experiments.performance import LEVEL
from inscrutable.labels import listed
from inscrutable.reports.names import FULL_NAMES, full_name

_POINTS = 1e4  # basis points of a return


def answer(result: Backtest) -> str:
    """Return one sentence: which weights hide the belief from whom, and at what price; empty where that is not judged."""
    hiding = result.names[1:]
    if result.aware is None or not hiding:
        return ""
    asked, figures = _asked(result), result.figures
    if any(np.isnan(figures[name][key]) for name in hiding for key in ("error_face_value", "error_followed")):
        return ""
    odm = figures[result.names[0]]
    hidden = [who for who, seen in _SEEN.items() if asked.is_met(seen.reached(result.names[0], odm))]
    if hidden:
        whom = f"the {hidden[0]} observer" if len(hidden) == 1 else "both observers"
        return (
            f"In short: these {result.market.frequency.word}s do not tell who hides the investor's belief from {whom}: the "
            f"{FULL_NAMES['ODM']} weights, without protection, pass as well."
        )
    groups: dict[str, list[str]] = {}
    for name in hiding:
        naive, aware = (asked.is_met(seen.reached(name, figures[name])) for seen in _SEEN.values())
        groups.setdefault(_WHOM[naive, aware], []).append(name)
    unit, worth = f" basis points of risk-adjusted return a {result.market.frequency.word}", _worth(result)
    if worth > 0.0:
        unit += f", of {_basis_points(worth)} that the belief is worth"
    parts: list[str] = []
    cost = "a cost of "
    for whom in filter(groups.__contains__, _WHOM.values()):
        names = groups[whom]
        prices = listed([_basis_points(figures[name]["mean_regret"]) for name in names])
        verb = f"hide the investor's belief over {len(result.regimes)} market regimes" if not parts else "hide it"
        parts.append(
            f"{listed([full_name(name) for name in names])} weights {verb} from {whom}, at {cost}{prices}{unit}"
        )
        unit = cost = ""
    return f"In short: {'; '.join(parts)}."


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
_WHOM = {
    (True, True): "both observers, naive and aware of the rule",
    (False, True): "the aware observer alone",
    (True, False): "the naive observer alone",
    (False, False): "neither observer",
}
"""Text for the observers from whom a belief is hidden, by (naive, aware)."""


def verdict(result: Backtest) -> list[str]:
    """Return the verdict, one line each: the answer, its limits, cheaper silence, the estimates, who hides, the price."""
    figures, word = result.figures, result.market.frequency.word
    odm, *hiding = result.names
    own = figures[odm]
    lines = list(filter(None, [answer(result), _holds(result), _silence(result)]))
    lines.append(
        f"Without protection: from the {FULL_NAMES['ODM']} weights, an observer names the investor's likeliest regime in "
        f"{_share(own['share_regime_named'])} of {len(result.beliefs)} {word}s; always naming the commonest is right in "
        f"{_share(own['base_rate'])}."
    )
    if not hiding:
        return lines
    if result.aware is None:
        named = listed([f"{_share(figures[name]['share_regime_named'])} ({full_name(name)})" for name in hiding])
        lines.append(f"Read by the naive observer from altered weights: {named}.")
    else:
        asked = _asked(result)
        described = {
            "naive": "naive observer, who takes the weights at face value",
            "aware": f"aware observer, who knows the rules and follows all {word}s",
        }
        for who, seen in _SEEN.items():
            reached = [seen.reached(full_name(name), figures[name]) for name in hiding]
            unprotected = seen.reached(full_name(odm), own)
            lines.append(f"Hidden from the {described[who]}: {asked.judge(reached, unprotected)}.")
    return [*lines, _price(result, hiding)]


def limits(result: Backtest) -> list[str]:
    """Return the basis of the verdict, one line each: the meaning of "hidden", names and budgets, and ceilings."""
    names = "; ".join(f"{name}: {FULL_NAMES[name]}" for name in result.names if name in FULL_NAMES)
    budget = f"{'budget of ' if result.budget.is_relative else ''}{result.budget}"
    word = result.market.frequency.word
    means = [f"PDM: in the mean of its two outcomes, each {word}"] if "PDM" in result.names else []
    if result.sequential is not None:
        own = f"{SHARE_OF_SILENCE:.0%} of the silence regret, " if result.settings.budget is None else ""
        means.append(f"{SEQUENTIAL}: {own}in the mean of the long run of the fitted regimes, more in single {word}s")
    budget += f" ({'; '.join(means)})" if means else ""
    hiding = result.names[1:]
    said = [f"{names}; each hides within a {budget}."] if hiding else [f"{names}."]
    if hiding:
        sharpe = listed([f"{_change(result.figures[name])} ({name})" for name in hiding])
        said.append(
            f"Realised: the yearly Sharpe ratio after trading costs, against the {FULL_NAMES['ODM']} weights, changes by "
            f"{sharpe}; in brackets {LEVEL:.0%} intervals."
        )
    if result.aware is None or len(result.names) == 1:
        return said
    asked = _asked(result)
    meaning = asked.meaning(without="weights", state="regime", cases=f"{word}s")
    return [meaning, *said, *_ceilings(result)]


def _asked(result: Backtest) -> Requirement:
    own = result.figures[result.names[0]]
    return Requirement(own["error_without"], own["base_rate"])


def _price(result: Backtest, hiding: Sequence[str]) -> str:
    figures = result.figures
    shares = [figures[name]["mean_regret_share"] for name in hiding]
    points = [f"{_basis_points(figures[name]['mean_regret'])} ({full_name(name)})" for name in hiding]
    word = result.market.frequency.word
    price = f"Price: a regret of {listed(points)} basis points a {word} by the investor's own belief"
    if not np.isfinite(shares).all():
        return f"{price}."  # c* is 0
    optimal = np.abs(result.episode.records[result.names[0]].decisions.optimal_cost).mean()
    parts = listed([f"{share:.1%}" for share in shares])
    return f"{price}, {parts} of |c*|, the size of the optimal cost, {_basis_points(optimal)} basis points a {word} on average."


def _basis_points(value: float) -> str:
    """Return a return in basis points with two significant digits, without an exponent."""
    return f"{float(f'{_POINTS * value:.2g}'):g}"


def _holds(result: Backtest) -> str:
    """Return limits of the answer: other draws, and observers who see more than weights; empty without any."""
    return " ".join([*_beyond_public(result), *_other_draws(result)])


def _beyond_public(result: Backtest) -> list[str]:
    """Return a line if public returns alone reveal the belief."""
    if result.public is None or result.figures[result.names[0]]["error_all_returns"] > tolerances.SAME_BELIEF:
        return []
    return [
        "This holds for observers who see the weights alone: these returns are public, and an observer who follows all of "
        "them with this model knows the belief without any weights."
    ]


def _ceilings(result: Backtest) -> list[str]:
    """Return a line on the largest error of any rule of the same regret; none if it is not known."""
    known = {name: result.figures[name]["error_ceiling"] for name in result.names[1:]}
    known = {name: most for name, most in known.items() if np.isfinite(most)}
    if not known or result.sequential is None:
        return []
    without, here = result.sequential.maker.chain.prior.error, result.figures[result.names[0]]["error_without"]
    where = "nearer to" if here < without else "farther from"
    return [
        f"Ceiling: at the regret of {listed(list(known))}, no rule leaves the aware observer an error above "
        f"{listed([f'{most:.2f}' for most in known.values()])}, in the long run of the fitted regimes. There the error without "
        f"weights is {without:.2f}; in these {result.market.frequency.word}s it is {here:.2f}, because their beliefs lie "
        f"{where} the long-run mean."
    ]


def _other_draws(result: Backtest) -> list[str]:
    """Return a line on the other draws in which the sequential rule hides the belief; none if it does in all."""
    if result.aware is None or result.sequential is None or not result.sequential.others:
        return []
    asked, beliefs, others = _asked(result), result.beliefs.to_numpy(), result.sequential.others
    if asked.is_met(_SEEN["aware"].reached("ODM", result.figures[result.names[0]])):
        return []
    held = sum(asked.is_met(Reached(SEQUENTIAL, *estimate_quality(each, beliefs))) for each in others)
    if held == len(others):
        return []
    return [
        f"The {FULL_NAMES[SEQUENTIAL]} rule draws its decisions: {held or 'none'} of {len(others)} other runs over all "
        f"{result.market.frequency.word}s would have hidden the belief from the aware observer."
    ]


def cautions(result: Backtest) -> list[str]:
    """Return cautions on the verdict: hiding that is weak."""
    figures = result.figures
    odm, *hiding = result.names
    optimal = figures[odm]["share_regime_named"]
    said = []
    for name in hiding:
        named = figures[name]["share_regime_named"]
        if len(result.regimes) == 2 and named < 0.5 * figures[odm]["base_rate"]:
            said.append(f"{name}: with two regimes, an observer who reads the opposite is right in {1 - named:.0%}.")
        elif result.aware is None and named > Requirement(0.0, figures[odm]["base_rate"]).most_named:
            said.append(
                f"{name}: the likeliest regime is hardly hidden: named in {_share(named)} instead of {_share(optimal)}."
            )
    return said


def _silence(result: Backtest) -> str:
    """Return a line on the constant portfolio where it costs less than hiding; empty where it does not."""
    spent = {name: result.figures[name]["mean_regret"] for name in result.names[1:]}
    dearer = {name: regret for name, regret in spent.items() if regret > result.silence_regret}
    if not dearer:
        return ""
    worth, beforehand = _worth(result), ""
    if worth > 0.0:
        beforehand = (
            " Known beforehand is the best one for the long-run mean of the belief; it would have cost "
            f"{_POINTS * worth:.3g}."
        )
    return (
        "In hindsight silence would have been cheaper: the best constant portfolio for these beliefs reveals nothing and would "
        f"have cost {_POINTS * result.silence_regret:.3g} basis points a {result.market.frequency.word} instead of "
        f"{listed([f'{_POINTS * each:.3g} ({full_name(name)})' for name, each in dearer.items()])}.{beforehand}"
    )


def _change(figures: Mapping[str, float]) -> str:
    difference, low, high = (figures[f"annual_sharpe_net_minus_odm{end}"] for end in ("", "_low", "_high"))
    return "an undefined amount" if np.isnan(difference) else f"{difference:+.2f} [{low:+.2f}, {high:+.2f}]"


def _share(value: float) -> str:
    return "no share (no weights that a belief explains)" if np.isnan(value) else f"{value:.0%}"
