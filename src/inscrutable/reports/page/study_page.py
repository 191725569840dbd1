"""The page of a study, finished or not: figures by decision maker and budget, and their spread over the repeats."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from inscrutable.experiments.makers import Takes
from inscrutable.experiments.measures import HEADLINES, MEASURES, OF_OBSERVERS
from inscrutable.experiments.studies import Study
from inscrutable.experiments.studies.grid import StudyGrid
from inscrutable.experiments.studies.layout import PAID, StudyFile
from inscrutable.experiments.studies.means import Figure, StudyMeans, means_of, spoken_observer
from inscrutable.experiments.studies.ranking import SAME_COST, Ranking, protection, ranking, times_the_least
from inscrutable.experiments.studies.study import tasks_text
from inscrutable.experiments.studies.sweeps import Sweep, sweep_of
from inscrutable.labels import capital, listed, number_text
from inscrutable.reports.names import full_name, spelled
from inscrutable.reports.page.content import PageContent, PageFigure, PageSlider, PageTable
from inscrutable.reports.page.manifest import manifest_of
from inscrutable.reports.style import MARKERS, REGIME_COLOURS, Look, looks_of

_MOST_CELLS = 25_000
_MOST_REASONS = 20
_TASKS_NAMED = 5
_DIGITS = 6
_DECIMALS = 12

_COSTS = ("silence_share", "cost_share", "expected_regret", "worst_regret")
"""Measures of cost, the most informative first."""
_UNITS = {
    "relative": "shares of |c*|",
    "regret": "in the cost's unit",
    "silence": "shares of the silence regret",
    "cost": "shares of E|c*|",
}
_WORTH = {
    "relative": "{} of |c*|",
    "regret": "{}",
    "silence": "{} of the silence regret",
    "cost": "{} of E|c*|",
}
_HOLDS = {True: "at every belief", False: "in expectation over the beliefs"}


def study_content(study: Study, title: str | None, manifest: Mapping[str, str]) -> PageContent:
    """Return the content of a study's page; `manifest` has further lines for the page's manifest."""
    means, status = means_of(*study.gridded()), study.status()
    shown = _shown(means)
    sweep = sweep_of(study.gridded()[0], list(dict.fromkeys(means.makers)))
    section = file_of(study).budgets
    spent = f"{_UNITS[section.unit]}, {_held(study)}"
    header = ". ".join(filter(None, [study.plan.note.rstrip("."), f"{tasks_text(study.n_tasks)}; budgets: {spent}"]))
    return PageContent(
        title=title or study.plan.name,
        header=f"{capital(header)}.",
        verdict=study_verdict(study),
        cautions=_cautions(study, means, len(shown)),
        tables=[_table(study, means, place, number) for number, place in enumerate(shown)],
        sliders=_sliders(means, shown, _WORTH[section.unit]),
        figures=[*_drawn(means), *_swept(sweep)] if status.done else [],
        failures=_failures(study) if status.failed else [],
        notes=[
            *_NOTES,
            *(
                measure.meaning
                for name, measure in file_of(study).measure_kinds.items()
                if name in file_of(study).measures
            ),
        ],
        manifest={**manifest_of(study), **manifest},
        script="study.js" if status.done else None,
        data=page_data(means, shown) | {"sweep": _sweep_data(sweep, shown)},
    )


def _held(study: Study) -> str:
    """Return where a budget holds, and for which decision makers where that differs."""
    plan, found = file_of(study), dict[bool, list[str]]()
    for name in dict.fromkeys(
        maker.data["name"] for maker, budget in study.gridded()[0].plays if maker.data and budget.data
    ):
        is_each = plan.budgets.hold == "each" and plan.maker_kinds[name].takes is Takes.EACH
        found.setdefault(is_each, []).append(name)
    if len(found) < 2:
        return _HOLDS[next(iter(found), plan.budgets.hold == "each")]
    return ", ".join(f"{_HOLDS[each]} for {listed(found[each])}" for each in (True, False))


_NOTES = (
    "Figures are means over the repeats; ± is half of a 95 % interval (Student's t over the repeats), none for a single one. "
    "With few repeats it is wide, and where repeats share a market two decision makers can differ more clearly than their "
    "intervals say. The verdict uses the repeats in which all decision makers have all figures, where there are any.",
    "Decision makers rank at equal expected regret. At one budget some may spend more than others. All are then compared at "
    "the least regret that one of them spends: the figure of one that spends more is interpolated between its own and that of "
    "a smaller budget, or of the optimal decision, and is told with “about”. Decision makers without a budget are compared at "
    'the middle one. With hold = "mean" in the section [budgets] none spends more than its budget in expectation, and one that '
    "cannot spend as much, or as little, spends less: its decisions are then optimal where even the least noise costs more.",
    "Whether the belief is hidden is judged at the same equal regret, by the measures error and top_state: both parts must "
    "hold.",
    "Observers: naive takes every decision for optimal; near-optimal and budget-aware allow for what is spent; bayesian is the "
    "aware observer, who knows the rule; data has seen pairs of belief and decision alone; sequential is the aware observer "
    "who also knows how the belief moves and follows it through all decisions: its error is that of the later half of 40 "
    "decisions. Where it also reads public observations, its error without decisions is one of its own.",
)


def file_of(study: Study) -> StudyFile:
    """Return the file of a grid."""
    assert isinstance(study.plan, StudyFile)
    return study.plan


def _shown(means: StudyMeans) -> list[int]:
    """Return the settings that the page shows, evenly spaced over all."""
    room = max(1, _MOST_CELLS // max(1, len(means.makers) * len(means.figures)))
    total = len(means.settings)
    return [int(place) for place in np.unique(np.linspace(0, total - 1, min(room, total)).round())]


def _titled(name: str) -> str:
    """Return the title of a measure; for a user-defined measure its name."""
    return MEASURES[name].title if name in MEASURES else name


def title_of(figure: Figure) -> str:
    """Return a figure's title: the measure and the observer."""
    return ", ".join(filter(None, [_titled(figure.measure), spoken_observer(figure.observer)]))


def _table(study: Study, means: StudyMeans, setting: int, number: int) -> PageTable:
    rows = []
    repeats = file_of(study).repeats
    costs = times_the_least(means, setting, means.middle_budget)
    differ = bool(np.nanmax(costs, initial=1.0) > 1.0 + SAME_COST)
    for place, (maker, budget) in enumerate(zip(means.makers, means.budgets, strict=True)):
        counts = means.count[setting, place]
        cells = [
            _cell(means, f, means.mean[setting, place, f], means.half_width[setting, place, f]) for f in _all(means)
        ]
        done = f"{counts.max()} of {repeats}" if counts.max() < repeats else str(counts.max())
        times = [f"{costs[place]:.2g}" if costs[place] > 0 else "–"] if differ else []
        rows.append([spelled(maker), "–" if budget is None else number_text(budget), done, *cells, *times])
    titles = [_TIMES] if differ else []
    columns = ["Decision maker", "budget", "repeats", *map(title_of, means.figures), *titles]
    heading = means.settings[setting] or "All figures"
    return PageTable(heading, columns, rows, ("setting", number) if len(means.settings) > 1 else None)


_TIMES = "cost, times the least at its budget"


def _cell(means: StudyMeans, figure: int, mean: float, half: float) -> str:
    if np.isnan(mean):
        return "–"
    told = _number(means, figure, mean)
    return told if np.isnan(half) else f"{told} ± {_number(means, figure, half, 2)}"


def _number(means: StudyMeans, figure: int, value: float, digits: int = 3) -> str:
    if np.isinf(value):
        return "∞" if value > 0 else "−∞"
    return f"{_without_rounding(means, figure, value):.{digits}g}"


def _without_rounding(means: StudyMeans, figure: int, value: float) -> float:
    """Return a value of a figure to `_DECIMALS` decimals of the figure's size."""
    scale = means.scales[figure]
    return round(value / scale, _DECIMALS) * scale + 0.0


def _sliders(means: StudyMeans, shown: Sequence[int], worth: str) -> list[PageSlider]:
    middle = 0 if means.middle_budget is None else means.amounts.index(means.middle_budget)
    found = [
        PageSlider("figure", "Figure", [title_of(each) for each in means.figures], _first_figure(means)),
        PageSlider("budget", "Budget", [worth.format(number_text(each)) for each in means.amounts], middle),
        PageSlider("setting", "Setting", [means.settings[place] for place in shown], means.first_setting(shown)),
    ]
    return [each for each in found if each.is_movable]


def _first_figure(means: StudyMeans) -> int:
    """Return the index of the figure shown first: that of the verdict."""
    figures = _headline(means)
    return figures[0] if figures else 0


def _drawn(means: StudyMeans) -> list[PageFigure]:
    cost = _cost(means)
    paid = "the budget" if cost is None else f"the {title_of(means.figures[cost])}"
    return [
        PageFigure(
            "tradeoff",
            "Privacy against cost",
            f"The curves are the figure chosen above against {paid}, by decision maker: means over the repeats with 95 % "
            "intervals. The axis is stretched near zero where budgets span several powers of ten. The dashed line, for errors, "
            "is the error of an observer who sees no decision, where the study measures it.",
        ),
        PageFigure(
            "spread",
            "Spread over the repeats at this budget",
            "The line goes from the least to the greatest of all repeats, the box holds the middle half, the bar is the median "
            "and the mark the mean. Decision makers without a budget are the same at each.",
        ),
    ]


def _swept(sweep: Sweep | None) -> list[PageFigure]:
    """Return a figure per facet; the last one's caption names what is not drawn."""
    if sweep is None:
        return []
    curves = "the decision makers" if not sweep.curves_of else f"the values of {sweep.curves_of}"
    told = (
        f"The curves are {curves}. They are the figure chosen above against {sweep.axis}, at the budget chosen above: means "
        "over the repeats with 95 % intervals."
    )
    rest = f" The table has the rest: {sweep.left_out}." if sweep.left_out else ""
    last = len(sweep.facets) - 1
    return [
        PageFigure(
            f"swept{chr(ord('A') + place)}",
            f"Over {sweep.axis}" + (f": {title}" if title else ""),
            told + (rest if place == last else ""),
        )
        for place, (title, _) in enumerate(sweep.facets)
    ]


def _sweep_data(sweep: Sweep | None, shown: Sequence[int]) -> dict[str, Any] | None:
    """Return the script's data over swept keys; settings by their index on the page."""
    if sweep is None:
        return None
    place_of = {setting: place for place, setting in enumerate(shown)}
    values = list(sweep.values) if sweep.is_numeric else list(range(len(sweep.values)))
    ticks = None if sweep.is_numeric else [[place, str(each)] for place, each in enumerate(sweep.values)]
    names = list(dict.fromkeys(curve.name for _, curves in sweep.facets for curve in curves))
    looks = _curve_looks(names) if sweep.curves_of else looks_of(names)
    return {
        "axis": sweep.axis,
        "values": values,
        "ticks": ticks,
        "looks": {name: look._asdict() for name, look in looks.items()},
        "facets": [
            [
                [curve.name, curve.maker, [None if each is None else place_of.get(each) for each in curve.settings]]
                for curve in curves
            ]
            for _, curves in sweep.facets
        ],
    }


def _curve_looks(names: Sequence[str]) -> dict[str, Look]:
    """Looks of the values of a key."""
    lines = ("-", "--", ":", "-.")
    return {
        name: Look(REGIME_COLOURS[place % len(REGIME_COLOURS)], MARKERS[place], lines[place % len(lines)])
        for place, name in enumerate(names)
    }


def _cost(means: StudyMeans) -> int | None:
    """The figure of the cost."""
    return next((means.place[name] for name in _COSTS if name in means.place), None)


def page_data(means: StudyMeans, shown: Sequence[int]) -> dict[str, Any]:
    """Return the script's data, rounded: by setting, play and figure [mean, half width, five quantiles]."""
    names = list(dict.fromkeys(means.makers))
    cost = _cost(means)
    return {
        "makers": names,
        "main": _main(means, names),
        "spelled": {name: spelled(name) for name in names},
        "looks": {name: look._asdict() for name, look in looks_of(names).items()},
        "budgets": means.amounts,
        "figures": [title_of(each) for each in means.figures],
        "errors": [each.measure == "error" for each in means.figures],
        "cost": cost,
        "paid": "budget" if cost is None else title_of(means.figures[cost]),
        "prior": [
            means.place.get(f"prior_error, {each.observer}", means.place.get("prior_error")) for each in means.figures
        ],
        "plays": [
            [names.index(maker), None if budget is None else means.amounts.index(budget)]
            for maker, budget in zip(means.makers, means.budgets, strict=True)
        ],
        "cells": [[[_numbers(means, s, p, f) for f in _all(means)] for p in range(len(means.makers))] for s in shown],
    }


def _main(means: StudyMeans, names: Sequence[str]) -> list[str]:
    """Return the decision makers in the order in which they are drawn: those that the verdict names, then the others."""
    setting, budget = means.first_setting(), means.middle_budget
    ranked = [ranking(means, setting, budget, place).plays for place in _headline(means)]
    named = [means.makers[each[k]] for each in ranked for k in (0, 1, -1) if len(each) > 1]
    return list(dict.fromkeys([*named, *names]))


def _all(means: StudyMeans) -> range:
    return range(len(means.figures))


def _numbers(means: StudyMeans, setting: int, play: int, figure: int) -> list[float | None]:
    place = setting, play, figure
    found = (means.mean[place], means.half_width[place], *means.quantiles[place])
    return [float(_number(means, figure, each, _DIGITS)) if np.isfinite(each) else None for each in found]


def _headline(means: StudyMeans) -> list[int]:
    """Return the verdict's figures, the best informed observer's first."""
    for measure in HEADLINES:
        found = [place for place, figure in enumerate(means.figures) if figure.measure == measure]
        if found:
            return sorted(found, key=lambda place: not means.figures[place].observer.startswith("bayesian"))
    return []


def study_verdict(study: Study) -> list[str]:
    """Return the page's verdict: which rules hide the belief, at which budget and regret; empty for a study without a page."""
    return _verdict(study, means_of(*study.gridded(), paired=True)) if isinstance(study.grid, StudyGrid) else []


def _verdict(study: Study, means: StudyMeans) -> list[str]:
    if not means.count.any():
        return ["No task of this study has figures yet."]
    places = _headline(means)
    if not places:
        return [f"{study.status().done} tasks have figures; the table has their means."]
    setting, budget = means.first_setting(), means.middle_budget
    at = [] if budget is None else [f"at a budget of {_WORTH[file_of(study).budgets.unit].format(number_text(budget))}"]
    at += [f"in the setting {means.settings[setting]}"] if means.settings[setting] else []
    found = {place: ranking(means, setting, budget, place) for place in places}
    holds = protection(means, setting, budget, spoken=full_name)
    equal, costs = _costs_told(means, found[places[0]])
    at += equal
    told = [_ranked(means, setting, *each) for each in found.items()]
    first, *others = list(filter(None, told)) or ["nothing is known yet"]
    return [
        f"In short: {', '.join([*at, first])}.",
        *(f"{capital(each)}." for each in others),
        *costs,
        *holds,
        *_repeats_told(means.count[setting], file_of(study).repeats),
        *_same_told(means.quantiles[setting], int(means.count[setting].max())),
        *study.cautions(),
        *_elsewhere(means, found[places[0]], budget, places[0]),
    ]


def _repeats_told(count: np.ndarray, repeats: int) -> list[str]:
    """Return a sentence on the repeats that a verdict rests on, where these are not all; `count` is that of each figure."""
    least, most = int(count[count > 0].min()), int(count.max())
    if least < most:
        return [
            f"No repeat has all figures: the means rest on {least} to {most} different repeats and may differ for that alone."
        ]
    if most < repeats:
        return [f"This rests on the {most} of {repeats} repeats that have all figures."]
    return []


def _same_told(quantiles: np.ndarray, repeats: int) -> list[str]:
    """Return a sentence where all repeats gave the same figures, whose quantiles along the last axis are then equal."""
    if repeats < 2 or (quantiles[..., -1] > quantiles[..., 0]).any():
        return []
    return [
        f"All {repeats} repeats gave the same figures: intervals of ± 0 do not show how figures would differ in other markets."
    ]


def _costs_told(means: StudyMeans, found: Ranking) -> tuple[list[str], list[str]]:
    """Return a clause on how a ranking equalises costs, and a sentence on their differences."""
    if not found.is_known:
        return ["of decision makers whose costs were not measured and may differ"], []
    if found.regret is None:
        return [], []
    low, high, paid = found.cheapest, found.dearest, means.place[PAID]
    least, most, equal = (_number(means, paid, each) for each in (found.spent[low], found.spent[high], found.regret))
    differ = (
        f"At this budget expected regrets differ, from {least} ({_told(means, found.spenders[low])}) to "
        f"{most} ({_told(means, found.spenders[high])}), {found.times:.1f} times as much."
    )
    return [f"compared at an equal expected regret of {equal} in the cost's unit"], [differ]


def _ranked(means: StudyMeans, setting: int, figure: int, found: Ranking) -> str:
    """Return the sentence on the best, second best and last decision maker by one figure."""
    if not found.plays:
        return ""

    def cell(place: int) -> str:
        play = found.plays[place]
        if found.values[place] != means.mean[setting, play, figure]:
            return f"about {_number(means, figure, found.values[place])}"
        return _cell(means, figure, found.values[place], means.half_width[setting, play, figure])

    told = [cell(0)]
    told += [f"next {_told(means, found.plays[1])}, {cell(1)}"] if len(found.plays) > 2 else []
    told += [f"last {_told(means, found.plays[-1])}, {cell(-1)}"] if len(found.plays) > 1 else []
    kind = means.figures[figure].measure
    best = {1: "largest", -1: "smallest"}[MEASURES[kind].sign] if kind != "top_state" else "rarest"
    return f"the {best} {_spoken(means.figures[figure])} is under {_told(means, found.plays[0])} ({'; '.join(told)})"


def _told(means: StudyMeans, play: int) -> str:
    """Return a decision maker's name within a sentence."""
    return full_name(means.makers[play])


def _spoken(figure: Figure) -> str:
    """Return a figure's name within a sentence, with the observer."""
    kind = MEASURES[figure.measure]
    whom = f" of the {spoken_observer(figure.observer)} observer" if figure.observer else ""
    return f"{kind.spoken or kind.title}{whom}"


def _elsewhere(means: StudyMeans, found: Ranking, budget: float | None, figure: int) -> list[str]:
    """Return in how many settings the same decision maker is the most private, as text."""
    others = [ranking(means, s, budget, figure).plays for s in range(len(means.settings))]
    firsts = [each[0] for each in others if each]
    if len(firsts) < 2 or not found.plays:
        return []
    same = sum(place == found.plays[0] for place in firsts)
    best = _told(means, found.plays[0])
    return [f"By the {_spoken(means.figures[figure])}, {best} is first in {same} of {len(firsts)} settings."]


def _cautions(study: Study, means: StudyMeans, shown: int) -> list[str]:
    status = study.status()
    found = []
    if status.left:
        found.append(
            f"The study is not finished: {status.left} of {status.total} tasks have no row yet. All figures are those of the "
            "rows there are."
        )
    if status.failed:
        found.append(f"{status.failed} of {status.total} tasks failed, for the reasons below; no mean holds them.")
    if file_of(study).repeats == 1:
        found.append("There is one repeat: nothing is known of the spread.")
    if shown < len(means.settings):
        found.append(f"The page shows {shown} of {len(means.settings)} settings; the exported rows have all.")
    if not any(measure in OF_OBSERVERS for measure in file_of(study).measures):
        found.append("The study measures no observer's error: its figures are the mechanism's.")
    return found


def _failures(study: Study) -> list[str]:
    """Return every distinct reason of failure, the most frequent first, with its tasks."""
    tasks: dict[str, list[str]] = {}
    for line in study.errors():
        task, reason = line.split(": ", 1)
        tasks.setdefault(reason, []).append(task.split(" ")[1])
    counts = Counter({reason: len(numbers) for reason, numbers in tasks.items()})
    found = []
    for reason, count in counts.most_common(_MOST_REASONS):
        named = ", ".join(tasks[reason][:_TASKS_NAMED]) + (", …" if count > _TASKS_NAMED else "")
        found.append(f"{'1 task' if count == 1 else f'{count} tasks'} ({named}): {reason}")
    if len(counts) > _MOST_REASONS:
        found.append(f"{len(counts) - _MOST_REASONS} more reasons; the exported rows have all.")
    return found
