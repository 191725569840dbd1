"""The verdict of a backtest in a few lines: what an observer reads, what is hidden from whom, and at what price."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from inscrutable import tolerances
from inscrutable.experiments.backtest_results import SEQUENTIAL, Backtest
from inscrutable.experiments.backtest_sequential import SHARE_OF_SILENCE
from inscrutable.experiments.holding import Reached, Requirement, estimate_quality
from inscrutable.experiments.performance import LEVEL

_POINTS = 1e4  # basis points of a return

FULL_NAMES = {"ODM": "optimal", "CDM": "counter-adversarial", "PDM": "probabilistic", SEQUENTIAL: "sequential"}
"""What the abbreviations of decision makers stand for."""


def spelled(name: str) -> str:
    """Return a decision maker's name with its abbreviation written out; settings after a comma stay."""
    short, comma, settings = name.partition(",")
    return f"{FULL_NAMES[short]} ({short}){comma}{settings}" if short in FULL_NAMES else name


def _full(name: str) -> str:
    """Return a decision maker's name without its abbreviation; settings after a comma stay."""
    short, comma, settings = name.partition(",")
    return f"{FULL_NAMES.get(short, short)}{comma}{settings}"


def verdict(result: Backtest) -> list[str]:
    """Return what was found, a line each: what an observer reads, what is hidden from whom, and what it costs."""
    figures, word = result.figures, result.market.frequency.word
    odm, *hiding = result.names
    own = figures[odm]
    lines = [
        f"Without protection: from the {FULL_NAMES['ODM']} weights, an observer names the investor's likeliest regime in "
        f"{_share(own['share_regime_named'])} of {len(result.beliefs)} {word}s; always naming the commonest is right in "
        f"{_share(own['base_rate'])}."
    ]
    if not hiding:
        return lines
    if result.aware is None:
        named = _and([f"{_share(figures[name]['share_regime_named'])} ({_full(name)})" for name in hiding])
        lines.append(f"Read by the naive observer from altered weights: {named}.")
    else:
        asked = _asked(result)
        for who, error, named in (
            ("naive observer, who takes the weights at face value", "error_face_value", "share_regime_named"),
            (
                f"aware observer, who knows the rules and follows all {word}s",
                "error_followed",
                "share_regime_named_followed",
            ),
        ):
            reached = [Reached(_full(name), figures[name][error], figures[name][named]) for name in hiding]
            lines.append(f"Hidden from the {who}: {asked.judge(reached)}.")
    return [*lines, _price(result, hiding)]


def limits(result: Backtest) -> list[str]:
    """Return what the verdict rests on, a line each: what "hidden" means, names and budgets, and ceilings."""
    names = "; ".join(f"{name}: {FULL_NAMES[name]}" for name in result.names if name in FULL_NAMES)
    budget = f"{'budget of ' if result.budget.is_relative else ''}{result.budget}"
    if result.sequential is not None and result.settings.budget is None:
        budget += f" ({SEQUENTIAL}: {SHARE_OF_SILENCE:.0%} of the silence regret, in the long run)"
    hiding = result.names[1:]
    said = [f"{names}; each hides within a {budget}."] if hiding else [f"{names}."]
    if hiding:
        sharpe = _and([f"{_change(result.figures[name])} ({name})" for name in hiding])
        said.append(
            f"Realised: the yearly Sharpe ratio after trading costs, against the {FULL_NAMES['ODM']} weights, changes by "
            f"{sharpe}; in brackets {LEVEL:.0%} intervals."
        )
    if result.aware is None or len(result.names) == 1:
        return said
    word = result.market.frequency.word
    asked = _asked(result)
    meaning = asked.meaning(without="weights", state="regime", cases=f"{word}s")
    return [meaning, *said, *_ceilings(result)]


def _asked(result: Backtest) -> Requirement:
    own = result.figures[result.names[0]]
    return Requirement(own["error_without"], own["base_rate"])


def _price(result: Backtest, hiding: Sequence[str]) -> str:
    figures = result.figures
    shares = [figures[name]["mean_regret_share"] for name in hiding]
    points = [f"{_POINTS * figures[name]['mean_regret']:.2g} ({_full(name)})" for name in hiding]
    price = (
        f"Price: a regret of {_and(points)} basis points a {result.market.frequency.word} by the investor's own belief"
    )
    if not np.isfinite(shares).all():
        return f"{price}."  # c* is 0
    return f"{price}, {_and([f'{share:.1%}' for share in shares])} of the optimal cost |c*|."


def _beyond_public(result: Backtest) -> list[str]:
    """Whom nothing is hidden from; no line where it is nobody."""
    if result.public is None or result.figures[result.names[0]]["error_all_returns"] > tolerances.SAME_BELIEF:
        return []
    return [
        "The verdict holds for observers who see the weights alone. These returns are public: whoever follows all of them with "
        "this model knows the belief without any weights."
    ]


def _ceilings(result: Backtest) -> list[str]:
    """What no rule exceeds that costs as much as each; no line where it is not known."""
    known = {name: result.figures[name]["error_ceiling"] for name in result.names[1:]}
    known = {name: most for name, most in known.items() if np.isfinite(most)}
    if not known or result.sequential is None:
        return []
    without = result.sequential.maker.chain.prior.error
    return [
        f"Ceiling, in the long run of the fitted regimes: no rule that costs as much as {_and(list(known))} leaves an aware "
        f"observer who follows it an error above {_and([f'{most:.2f}' for most in known.values()])}, of {without:.2f} without "
        "weights."
    ]


def _luck(result: Backtest) -> list[str]:
    """In how many other draws the sequential rule hides the belief; no line where it does in all of them."""
    if result.sequential is None or not result.sequential.others:
        return []
    asked, beliefs, others = _asked(result), result.beliefs.to_numpy(), result.sequential.others
    held = sum(asked.is_met(Reached(SEQUENTIAL, *estimate_quality(each, beliefs))) for each in others)
    if held == len(others):
        return []
    return [
        f"The {FULL_NAMES[SEQUENTIAL]} rule draws its decisions: {held or 'none'} of {len(others)} other draws would have "
        "hidden the belief from the aware observer."
    ]


def _and(words: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def cautions(result: Backtest) -> list[str]:
    """Return what the verdict leaves out: who needs no weights, other draws, weak hiding, and silence that costs less."""
    figures, word = result.figures, result.market.frequency.word
    odm, *hiding = result.names
    told = figures[odm]["share_regime_named"]
    said = []
    for name in hiding:
        named = figures[name]["share_regime_named"]
        if len(result.regimes) == 2 and named < 0.5 * figures[odm]["base_rate"]:
            said.append(f"{name}: with two regimes, an observer who reads the opposite is right in {1 - named:.0%}.")
        elif result.aware is None and named > Requirement(0.0, figures[odm]["base_rate"]).most_named:
            said.append(
                f"{name}: the likeliest regime is hardly hidden: named in {_share(named)} instead of {_share(told)}."
            )
    dearer = {
        name: figures[name]["mean_regret"] for name in hiding if figures[name]["mean_regret"] > result.silence_regret
    }
    if dearer:
        said.append(
            f"Silence would have been cheaper: one constant portfolio, known only in hindsight, tells nothing and would have "
            f"cost {_POINTS * result.silence_regret:.3g} basis points a {word} instead of "
            f"{_and([f'{_POINTS * spent:.3g} ({_full(name)})' for name, spent in dearer.items()])}."
        )
    return [*_beyond_public(result), *_luck(result), *said]


def _change(figures: Mapping[str, float]) -> str:
    difference, low, high = (figures[f"annual_sharpe_net_minus_odm{end}"] for end in ("", "_low", "_high"))
    return "an undefined amount" if np.isnan(difference) else f"{difference:+.2f} [{low:+.2f}, {high:+.2f}]"


def _share(value: float) -> str:
    return "no share (no weights that a belief explains)" if np.isnan(value) else f"{value:.0%}"
