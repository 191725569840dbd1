"""The reproduction: the same bytes for the same seed, every claim judged, and curves that obey the mathematics."""

from __future__ import annotations

import dataclasses
import json
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pandas as pd
import pytest
from scipy.optimize import linprog
from scipy.stats import kendalltau

from inscrutable.decision_makers import (
    Envelope,
    LinearProgramme,
    ProbabilisticDecisionMaker,
    action_grid,
    decoy_grid,
    privacy_frontier,
)
from inscrutable.errors import InputError
from inscrutable.experiments.claims import CLAIMS, Rule, Verdict, judge_claims, rank_agreement, saturation_budget
from inscrutable.experiments.market_runs import GLOBAL, PAPER
from inscrutable.experiments.random_markets import MarketLaw, random_market
from inscrutable.experiments.reproduction import Reproduction, ReproductionSettings, reproduce
from inscrutable.reports import reproduction as reports
from inscrutable.reports.reproduction import claims_frame, claims_table, write_reproduction
from sizes import audited, some
from small_runs import nothing_painted
from test_golden_tables import assert_same, golden

EFFORT: dict[str, Any] = {
    "resolution": 10,
    "simulations": 2,
    "market_steps": 2,
    "budgets": (0.1, 1.0, 10.0),
    "starts": (1, 2),
    "sample_resolutions": (2, 4),
}
SMALL = ReproductionSettings(steps=4, markets=3, **EFFORT)
MOVED = ["pdm_more_private", "pdm_more_private_at_every_budget", "cdm_cheaper", "saturates_cdm"]
PAINTED = some([PAPER, GLOBAL], 2)
FIGURES = [
    *(f"{variant}_{what}" for variant in ("paper", "global") for what in ("actions", "beliefs", "privacy", "costs")),
    "paper_tradeoff",
    "global_tradeoff",
    "convergence",
]


@pytest.fixture(scope="module")
def small() -> Reproduction:
    return reproduce(SMALL, jobs=1)


@contextmanager
def painting(variants: Sequence[str]) -> Iterator[None]:
    """Only the figures of some variants are drawn, as one function draws those of any."""
    drawn = reports.draw_variant
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            reports,
            "draw_variant",
            lambda result, variant, place: drawn(result, variant, place) if variant in variants else [],
        )
        yield


@pytest.fixture(scope="module")
def folder(small: Reproduction, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("reproduction")
    with painting(PAINTED):
        write_reproduction(small, place, jobs=2)
    return place


def test_pictures_are_written_relative_to_the_present_folder(
    small: Reproduction, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Processes that drew before, those of the fixture, began in another one."""
    for name in some(("one", "two"), 2):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        with painting([]):
            written = write_reproduction(small, "results", jobs=2)
        assert Path("results", "convergence.png") in written
        assert all((tmp_path / name / path).exists() for path in written)


def test_everything_is_written_whole(small: Reproduction, folder: Path, tmp_path: Path) -> None:
    with nothing_painted():
        write_reproduction(small, tmp_path, jobs=1)
    assert {path.name for path in tmp_path.iterdir()} == {
        *(f"{each}.{end}" for each in FIGURES for end in ("png", "svg")),
        "claims.csv",
        "summary.json",
    }
    painted = [each for each in FIGURES if each.split("_")[0] in (*PAINTED, "convergence")]
    assert len(painted) == 5 * len(PAINTED) + 1
    for name in painted:
        assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert (folder / f"{name}.svg").read_text("utf-8").rstrip().endswith("</svg>")


def test_same_seed_same_bytes_whatever_the_jobs(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Markets by one process and by two, pictures by two and by one: the last one, and in `make audit` those of the paper's
    solvers."""
    seen: list[tuple[int, int]] = []
    again = reproduce(SMALL, jobs=2, progress=lambda done, total: seen.append((done, total)))
    if audited():
        monkeypatch.setattr(reports, "draw_convergence", lambda *_: [])
    with painting([PAPER] if audited() else []):
        write_reproduction(again, tmp_path, jobs=1)
    drawn = [each for each in FIGURES if each.startswith(PAPER if audited() else "convergence")]
    assert drawn
    for name in ("summary.json", "claims.csv", *(f"{each}.svg" for each in drawn)):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()
    assert seen == [(1, 3), (2, 3), (3, 3)]
    assert "jobs" not in (folder / "summary.json").read_text("utf-8")


@pytest.mark.usefixtures("undrawn")
def test_a_worker_that_is_renewed_while_drawing_ends_nothing(
    small: Reproduction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error in the thread that renews it, as warnings are here, would leave the others waiting for ever."""
    drawing = joblib.Parallel.__call__

    def renewing(self: joblib.Parallel, tasks: object) -> object:
        warnings.warn("A worker stopped while some jobs were given to the executor.", UserWarning, stacklevel=1)
        return drawing(self, tasks)

    monkeypatch.setattr(joblib.Parallel, "__call__", renewing)
    assert write_reproduction(small, tmp_path)


def test_its_claims_are_those_it_had(small: Reproduction) -> None:
    """To 1e-5. The paper's local search ends elsewhere where last digits of its trials differ, as they do between the linear
    algebra of two processors: four of its means to a fiftieth of their standard error (measured on three: .013)."""
    found, wanted = claims_frame(small), golden("reproduce")
    local = [each for each in wanted.columns if each.startswith("paper:")]
    moved = wanted.index.isin(MOVED)
    assert_same(found.drop(columns=local), wanted.drop(columns=local), rtol=1e-5, atol=1e-6)
    assert_same(found.loc[~moved, local], wanted.loc[~moved, local], rtol=1e-5, atol=1e-6)
    mean, error = "paper: measured", "paper: standard error"
    assert (abs(found[mean] - wanted[mean])[moved] <= 0.02 * wanted.loc[moved, error]).all()
    assert_same(
        found.loc[moved, local].drop(columns=mean), wanted.loc[moved, local].drop(columns=mean), rtol=0.02, atol=1e-6
    )


def test_another_seed_is_another_market(small: Reproduction) -> None:
    little = {"resolution": 4, "budgets": (0.1, 1.0), "sample_resolutions": (2,)}
    other = reproduce(SMALL.model_copy(update={"seed": 1, "markets": 2, "steps": 2, **little}), jobs=1)
    assert not np.array_equal(other.market.problem.means, small.market.problem.means)


def test_every_claim_is_judged(small: Reproduction, folder: Path) -> None:
    keys = [claim.key for claim in CLAIMS]
    assert len(set(keys)) == len(keys)
    table = claims_table(small)
    assert list(table.index) == keys
    assert set(json.loads((folder / "summary.json").read_text("utf-8"))["claims"]) == set(keys)
    assert set(table["verdict"]) <= {verdict.value for verdict in Verdict}
    written = pd.read_csv(folder / "claims.csv", index_col="key")
    assert list(written.index) == keys
    assert (written["markets"] == 3).all()
    assert list(written.columns) == list(claims_frame(small).columns)
    for word in ("ODM", "CDM", "PDM", "local optimum", "hard", "violate", "lower cost", "saturates", "samples"):
        assert table["claim"].str.contains(word).any()


def test_what_must_hold_in_every_market_does(small: Reproduction) -> None:
    found = {claim.key: claim for claim in small.claims}
    for key in ("odm_exposed", "suboptimal_costs", "cdm_within_budget", "pdm_within_budget_on_average"):
        assert found[key].verdict is Verdict.HOLDS, key
    assert found["pdm_more_private_at_every_budget"].globally.holds
    for run in small.runs:
        for variant in (PAPER, GLOBAL):
            pdm = run.variants[variant].pdm
            assert np.all(run.variants[variant].mixing_gain >= -1e-9)
            assert np.all(pdm.expected_increase <= 0.1 + 1e-6)


def test_trade_off_is_monotone_and_ordered(small: Reproduction) -> None:
    for variant in (PAPER, GLOBAL):
        curves = small.trade_off(variant)
        assert {name: each.shape for name, each in curves.items()} == dict.fromkeys(("ODM", "CDM", "PDM"), (2, 3))
        assert np.all(np.diff(curves["PDM"], axis=1) >= -1e-12)
        assert not curves["ODM"].any()
    globally = small.trade_off(GLOBAL)
    assert np.all(np.diff(globally["CDM"], axis=1) >= 0)
    assert np.all(globally["PDM"] >= globally["CDM"] - 1e-12)


def test_more_samples_and_starts_never_hurt(small: Reproduction) -> None:
    values = small.convergence()
    assert small.sample_sizes == (6, 15)
    assert list(values) == ["action grid", "random actions", "decoy grid"]
    for kind in ("action grid", "decoy grid"):  # the coarser grid is part of the finer one
        assert np.all(np.diff(values[kind], axis=1) >= -1e-12)
    for run in small.runs:
        assert run.starts.shape == (2,)
        assert run.starts[0] == run.variants[PAPER].cdm.privacy[0] <= run.starts[1]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("grid", [action_grid, decoy_grid])
def test_linear_programme_envelope_and_frontier_agree(seed: int, grid: object) -> None:
    market = random_market(rng=np.random.default_rng([5, seed]))
    belief = market.beliefs(1, rng=np.random.default_rng(seed))[0]
    candidates = grid(market.problem, 12)  # type: ignore[operator]
    limit = 0.1 * abs(float(market.problem.optimal_cost(belief)))
    programme = ProbabilisticDecisionMaker(market.problem, candidates=candidates, method=LinearProgramme())
    value = programme.decide(belief).expected_privacy
    assert privacy_frontier(market.problem, belief, candidates=candidates).randomized(limit) == pytest.approx(
        value, abs=1e-7
    )
    # The programme again, from the definitions: regrets and distances of the explained candidates and of u*(π).
    usable = candidates.usable & (candidates.sets.dimension >= 0)
    regrets = np.append(candidates.state_costs[usable] @ belief - market.problem.optimal_cost(belief), 0.0)
    privacies = np.append([candidates.sets[int(i)].distance(belief) for i in np.flatnonzero(usable)], 0.0)
    answer = linprog(
        -privacies, A_ub=regrets[None] / limit, b_ub=[1.0], A_eq=np.ones((1, len(regrets))), b_eq=[1.0], method="highs"
    )
    assert -answer.fun == pytest.approx(value, abs=1e-6)
    envelope = ProbabilisticDecisionMaker(market.problem, candidates=candidates, method=Envelope()).decide(belief)
    assert envelope.expected_privacy >= value - 1e-7  # it also has the polished decision


@pytest.mark.parametrize("seed", range(5))
def test_rank_agreement_is_kendalls(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = rng.integers(0, 4, 12).astype(float), rng.integers(0, 4, 12).astype(float)
    assert rank_agreement(first, second) == pytest.approx(kendalltau(first, second).statistic)


def test_degenerate_sequences() -> None:
    assert rank_agreement([0.1, 0.1 + 1e-9], [1.0, 2.0]) == 0.0
    assert saturation_budget([0.1, 1.0, 3.0], [0.2, 0.5, 0.5]) == 1.0
    assert saturation_budget([0.1, 1.0, 3.0], [0.0, 0.0, 0.0]) == 0.1


def test_verdicts_follow_the_findings(small: Reproduction) -> None:
    """Move one market's record across each rule's bound and see the verdict change."""

    def verdict(key: str, runs: list[object]) -> Verdict:
        return next(claim for claim in judge_claims(runs) if claim.key == key).verdict  # type: ignore[arg-type]

    def changed(variant: str, **fields: object) -> list[object]:
        first = small.runs[0]
        moved = dataclasses.replace(first.variants[variant], **fields)  # type: ignore[arg-type]
        return [dataclasses.replace(first, variants={**first.variants, variant: moved}), *small.runs[1:]]

    over = dataclasses.replace(small.runs[0].variants[GLOBAL].cdm, increase=np.array([0.0, 0.2]))
    assert verdict("cdm_within_budget", changed(GLOBAL, cdm=over)) is Verdict.ONLY_LOCAL
    over = dataclasses.replace(small.runs[0].variants[PAPER].cdm, increase=np.array([0.0, 0.2]))
    assert verdict("cdm_within_budget", changed(PAPER, cdm=over)) is Verdict.ONLY_GLOBAL
    seen = dataclasses.replace(small.runs[0], odm=dataclasses.replace(small.runs[0].odm, privacy=np.array([0.0, 0.1])))
    assert verdict("odm_exposed", [seen, *small.runs[1:]]) is Verdict.FAILS
    wild = changed(PAPER, mixing_gain=np.array([-50.0, -50.0]))
    assert verdict("hard_budget", wild) in (Verdict.INCONCLUSIVE, Verdict.OPEN_LOCAL)  # one market of three

    def gaining(**gains: tuple[float, ...]) -> list[object]:
        moved = []
        for number, run in enumerate(small.runs):
            own = {
                name: dataclasses.replace(run.variants[name], mixing_gain=np.full(2, each[number]))
                for name, each in gains.items()
            }
            moved.append(dataclasses.replace(run, variants={**run.variants, **own}))
        return moved

    worse, unclear, better = (-50.0, -49.0, -51.0), (-1.0, 0.5, 1.0), (1.0, 1.1, 0.9)
    cases = {
        (worse, worse): Verdict.FAILS,
        (worse, better): Verdict.ONLY_GLOBAL,
        (better, worse): Verdict.ONLY_LOCAL,
        (better, better): Verdict.HOLDS,
        (better, unclear): Verdict.OPEN_GLOBAL,
        (unclear, better): Verdict.OPEN_LOCAL,
        (unclear, worse): Verdict.INCONCLUSIVE,
        (unclear, unclear): Verdict.INCONCLUSIVE,
    }
    for (local, globally), expected in cases.items():
        assert verdict("hard_budget", gaining(**{PAPER: local, GLOBAL: globally})) is expected
    assert {claim.rule for claim in CLAIMS} == set(Rule)
    with pytest.raises(InputError, match="at least 2 markets, got 1"):
        judge_claims(small.runs[:1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": -1}, "seed"),
        ({"budget": 0.0}, "budget: should be greater than 0, got 0.0"),
        ({"steps": 1}, "steps"),
        ({"markets": 1}, "markets"),
        ({"law": MarketLaw(regimes=4)}, "3 regimes and 3 assets, the law has 4 and 3"),
    ],
)
def test_bad_settings(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ReproductionSettings(**change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"resolution": 1}, "resolution"),
        ({"simulations": 1}, "simulations"),
        ({"budgets": (1.0, 0.1)}, "budgets: should be numbers that rise, got "),
        ({"budgets": (0.0, 0.1)}, "budgets.0: should be greater than 0, got 0.0"),
        ({"starts": (2, 5)}, "starts should begin with 1, the paper's, got "),
        ({"sample_resolutions": ()}, "sample_resolutions: should have at least 1 entry, got "),
    ],
)
def test_bad_effort(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ReproductionSettings(**change)  # type: ignore[arg-type]


def test_unwritable_folder_is_one_clear_error(small: Reproduction, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="cannot be written"):
        write_reproduction(small, tmp_path / "file")
