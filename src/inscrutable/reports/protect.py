"""Tables and pictures of weights to publish instead of the optimal ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from inscrutable.datasets import output_folder, write_json, write_table
from inscrutable.decision_makers import Decision, MixedDecision
from inscrutable.experiments.episodes import relative_increase
from inscrutable.experiments.investor_model import BASIS_POINTS
from inscrutable.experiments.protect import Protection, implausible_rows, privacy_text
from inscrutable.geometry import BeliefSet
from inscrutable.labels import label_text
from inscrutable.reports.simplex_plots import plot_beliefs
from inscrutable.reports.style import BLACK, GREY, as_written, drawing, look_of, looks_of, save_figure
from inscrutable.validation import Array

_SMALLEST_SHOWN = 0.0005

OPTIMAL, PUBLISH, ATOM, DRAWN = "ODM: optimal", "CDM: publish this", "PDM: atom", "PDM: or this draw"


def protect_table(protection: Protection) -> pd.DataFrame:
    """Return the weights to publish, their regret and an observer's inference: a few rows per belief.

    Args:
        protection: From `protect`.

    Returns:
        A frame on (row label, what). What: the optimal weights (ODM), the weights to publish (CDM), every atom of the
        lottery (PDM) and its draw. Columns: its probability (none for the draw); the regret in the cost's unit
        and as a share of |c*|; the privacy Ψ under the chosen measure; the distance from the belief to the naive observer's
        estimate; that estimate, the centre of its set, for each regime; its most likely regime; the weights of all assets.

    Example: see `write_protect`.
    """
    model = protection.model
    records: list[dict[str, Any]] = []
    keys: list[tuple[Any, str]] = []
    for step, label in enumerate(protection.index):
        for what, probability, action, belief_set, regret, privacy in _options(protection, step):
            keys.append((label, what))
            seen = belief_set.center()
            optimal_cost = float(protection.deterministic.optimal_cost[step])
            record: dict[str, Any] = {
                "probability": probability,
                "regret": regret,
                "regret / |c*|": float(relative_increase(regret, optimal_cost)),
                "privacy": privacy,
                "distance": belief_set.distance(protection.beliefs[step]),
            }
            record.update({f"observer: {regime}": seen[i] for i, regime in enumerate(model.regimes)})
            record["observer names"] = "nothing" if belief_set.is_empty else model.regimes[int(seen.argmax())]
            record.update({f"weight: {asset}": action[j] for j, asset in enumerate(model.assets)})
            records.append(record)
    index = pd.MultiIndex.from_tuples(keys, names=[protection.index.name or "row", "what"])
    return pd.DataFrame(records, index=index)


def _options(protection: Protection, step: int) -> list[tuple[str, float, Array, BeliefSet, float, float]]:
    """Return (what, probability, action, set, regret, privacy) of all options in one row."""
    publish: Decision = protection.deterministic[step]
    lottery: MixedDecision = protection.lotteries[step]
    drawn: Decision = protection.drawn[step]
    belief, optimal_set = protection.beliefs[step], protection.optimal_sets[step]
    own = float(protection.measure.at_step(step)(belief, optimal_set))
    options = [
        (OPTIMAL, 1.0, protection.optimal[step], optimal_set, 0.0, own),
        (PUBLISH, 1.0, publish.action, publish.belief_set, publish.regret, publish.privacy),
    ]
    for k, share in enumerate(lottery.probabilities):
        name = f"{ATOM} {k + 1}"
        each = (lottery.belief_sets[k], float(lottery.regrets[k]), float(lottery.privacies[k]))
        options.append((name, float(share), lottery.actions[k], *each))
    options.append((DRAWN, np.nan, drawn.action, drawn.belief_set, drawn.regret, drawn.privacy))
    return options


def option_lines(protection: Protection, step: int) -> pd.DataFrame:
    """Return one row's options side by side as text, for a terminal; weights below half a basis point left out."""
    table = pd.DataFrame(protect_table(protection).loc[protection.index[step]]).T
    lines = table.map(lambda value: value if isinstance(value, str) else "" if np.isnan(value) else f"{value:z.4f}")
    lines.loc["privacy"] = [
        privacy_text(protection.measure, float(value), 4) for value in table.loc["privacy"].to_numpy()
    ]
    lines.loc["regret"] = [f"{BASIS_POINTS * value:.3g}" for value in table.loc["regret"].to_numpy(dtype=float)]
    lines.loc["regret / |c*|"] = [f"{value:z.1%}" for value in table.loc["regret / |c*|"]]
    lines = lines.rename(index={"regret": "regret, bp"})
    weights = [f"weight: {asset}" for asset in protection.model.assets]
    idle = [name for name in weights if np.abs(table.loc[name].to_numpy(dtype=float)).max() < _SMALLEST_SHOWN]
    if np.array_equal(lines.loc["privacy"], lines.loc["distance"]):  # of maximal obfuscation they are one
        idle.append("distance")
    if protection.planned is not None:
        planned = [f"{value:z.4f}" for value in protection.planned.rows[step].action]
        lines.insert(0, "planned", pd.Series(planned, index=weights).reindex(lines.index).fillna(""))
    lines = lines.drop(index=idle)
    lines.index.name = None
    return lines


def row_lines(protection: Protection) -> pd.DataFrame:
    """Return one line per belief as text, for a terminal: regret and privacy of the CDM, and the belief read from it."""
    regimes = protection.model.regimes
    lines = []
    for step, belief in enumerate(protection.beliefs):
        publish = protection.deterministic[step]
        nothing, seen = publish.belief_set.is_empty, publish.belief_set.center()
        share = float(relative_increase(publish.regret, publish.optimal_cost))
        lines.append(
            {
                "your belief": " ".join(f"{value:.2f}" for value in belief),
                "observer concludes": "" if nothing else " ".join(f"{value:.2f}" for value in seen),
                "names": "nothing" if nothing else regimes[int(seen.argmax())],
                "privacy": privacy_text(protection.measure, publish.privacy, 3),
                **({} if protection.certified is None else {"at most": f"{publish.privacy_bound:z.3f}"}),
                "regret, bp": f"{BASIS_POINTS * publish.regret:.3g}",
                "of |c*|": f"{share:.1%}",
                "changed by": f"{0.5 * np.abs(publish.action - protection.optimal[step]).sum():.3f}",
                **_from_planned(protection, step, publish.action),
            }
        )
    return pd.DataFrame(lines, index=protection.index)


def _from_planned(protection: Protection, step: int, action: Array) -> dict[str, str]:
    """Return the difference of weights from the planned ones, if there were any."""
    if protection.planned is None:
        return {}
    return {"from planned": f"{0.5 * np.abs(action - protection.planned.rows[step].action).sum():.3f}"}


def published_weights(protection: Protection, *, drawn: bool = False) -> pd.DataFrame:
    """Return the weights to publish, one row per belief and one column per asset, in the form `read_weights` reads.

    `drawn` False gives the CDM's weights, True the PDM's draws.
    """
    actions = protection.drawn.action if drawn else protection.deterministic.action
    index = protection.index.rename(protection.index.name or "row")
    return pd.DataFrame(actions, index=index, columns=pd.Index(protection.model.assets))


def what_each_says(protection: Protection, step: int) -> dict[str, BeliefSet]:
    """Return the naive observer's set for each option of one row, by its name in the picture."""
    lottery = protection.lotteries[step]
    said = {"ODM": protection.optimal_sets[step]}
    for k, share in enumerate(lottery.probabilities):
        if share >= _SMALLEST_SHOWN:
            said[f"PDM, atom {k + 1}: {share:.1%}"] = lottery.belief_sets[k]
    said["CDM"] = protection.deterministic.belief_set[step]  # plotted last: a cross stays visible on an atom's square
    return said


def plot_protected_beliefs(protection: Protection, step: int, axes: Any) -> None:
    """Draw one row for any number of regimes: the belief, and the naive observer's inference from each option."""
    regimes = protection.model.regimes
    place = np.arange(len(regimes))
    axes.plot(place, protection.beliefs[step], "*", color=BLACK, markersize=9, label="private belief", zorder=4)
    said = what_each_says(protection, step)
    looks = looks_of(said)
    for shift, (name, held) in zip(np.linspace(-0.3, 0.3, len(said)), said.items(), strict=True):
        look = looks[name]
        bounds = held.bounds()
        axes.vlines(place + shift, bounds[:, 0], bounds[:, 1], color=look.colour, linewidth=2, alpha=0.5)
        axes.plot(place + shift, held.center(), look.marker, color=look.colour, label=name)
    axes.set_xticks(place, [as_written(each) for each in regimes])
    axes.set_ylabel("probability")
    axes.set_ylim(-0.04, 1.04)


def plot_protected_weights(protection: Protection, step: int, axes: Any) -> None:
    """Draw the main weights of one row: optimal, to publish, and the lottery's draw."""
    actions = np.array([protection.optimal[step], protection.deterministic.action[step], protection.drawn.action[step]])
    held = np.flatnonzero(np.abs(actions).max(axis=0) >= 0.005)
    place = np.arange(len(held))
    for k, (name, label) in enumerate((("ODM", "optimal"), ("CDM", "publish"), ("PDM", "or this draw"))):
        look = look_of(name)
        bars = actions[k, held]
        axes.barh(place + 0.27 * (k - 1), bars, height=0.25, color=look.colour, label=f"{name}: {label}")
    axes.set_yticks(place, [as_written(protection.model.assets[j]) for j in held])
    axes.invert_yaxis()
    axes.axvline(0.0, color=GREY, linewidth=0.5)
    axes.set_xlabel("weight")


def write_protect(protection: Protection, folder: Path) -> list[Path]:
    """Write the tables, a summary and the pictures of a protection into a folder and return their paths.

    Args:
        protection: From `protect`. The pictures show its last row.
        folder: Created where needed.

    Returns:
        protect.csv, publish.csv (CDM) and publish_drawn.csv (PDM), which an attack can read, summary.json,
        protect_beliefs and protect_weights as .png and .svg.

    Raises:
        InputError: A file cannot be written.

    Example:
        >>> import tempfile
        >>> from inscrutable.experiments.investor_model import InvestorModel
        >>> from inscrutable.experiments.protect import protect
        >>> from inscrutable.problems import MarkowitzProblem
        >>> from inscrutable.worlds import GaussianEmission, HiddenMarkovModel
        >>> means, spreads = [[0.02, 0.0], [-0.03, 0.0]], [0.01 * np.eye(2), 0.09 * np.eye(2)]
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], GaussianEmission(means, spreads))
        >>> model = InvestorModel(world, MarkowitzProblem(means, spreads, 2.0), ("A", "B"), ("calm", "crisis"))
        >>> protection = protect(model, [0.8, 0.2], rng=np.random.default_rng(0))
        >>> protect_table(protection)["observer: calm"].iloc[:2].round(2).tolist()[0]
        0.8
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     len(write_protect(protection, Path(folder)))
        8
    """
    target = output_folder(folder)
    paths = [target / name for name in ("protect.csv", "publish.csv", "publish_drawn.csv", "summary.json")]
    write_table(protect_table(protection), paths[0])
    write_table(published_weights(protection), paths[1])
    write_table(published_weights(protection, drawn=True), paths[2])
    write_json(protect_summary(protection), paths[3])
    last = len(protection) - 1
    if len(protection.model.regimes) == 3:
        with drawing(height=3.6, subplot_kw={"projection": "ternary"}) as (figure, axes):
            plot_beliefs(axes, protection.beliefs[last], what_each_says(protection, last), protection.model.regimes)
            paths += save_figure(figure, target, "protect_beliefs")
    else:
        with drawing() as (figure, axes):
            plot_protected_beliefs(protection, last, axes)
            figure.legend(loc="outside lower center", ncols=2)
            paths += save_figure(figure, target, "protect_beliefs")
    with drawing(height=3.0) as (figure, axes):
        plot_protected_weights(protection, last, axes)
        figure.legend(loc="outside lower center", ncols=3)
        paths += save_figure(figure, target, "protect_weights")
    return paths


def protect_summary(protection: Protection) -> dict[str, Any]:
    """Return a protection's figures as plain data: budget, cost, privacy, and each row's conclusion and weights."""
    rows = []
    for step, label in enumerate(protection.index):
        publish, lottery, drawn = protection.deterministic[step], protection.lotteries[step], protection.drawn[step]
        rows.append(
            {
                "row": label_text(label),
                "belief": protection.beliefs[step],
                "optimal": protection.optimal[step],
                "optimal_cost": publish.optimal_cost,
                "publish": publish.action,
                "regret": publish.regret,
                "privacy": publish.privacy,
                "privacy_bound": publish.privacy_bound,
                "status": publish.status.name.lower(),
                "observer_concludes": publish.belief_set.center(),
                "observer_bounds": publish.belief_set.bounds(),
                "budget_aware_bounds": protection.aware_bounds[step],
                "lottery": {
                    "actions": lottery.actions,
                    "probabilities": lottery.probabilities,
                    "expected_regret": lottery.expected_regret,
                    "expected_privacy": lottery.expected_privacy,
                    "privacy_bound": lottery.privacy_bound,
                    "status": lottery.status.name.lower(),
                },
                "drawn": drawn.action,
            }
        )
    return {
        "sentence": protection.summary(),
        "verdict": protection.verdict,
        "budget": str(protection.budget),
        "measure": type(protection.measure).__name__,
        "certified": protection.certified,
        "assets": list(protection.model.assets),
        "regimes": list(protection.model.regimes),
        "implausible_rows": [int(step) for step in implausible_rows(protection)],
        "rows": rows,
    }
