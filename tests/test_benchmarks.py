"""The benchmarks stay alive: their table writer, their peers, and each of them at a tiny size. No time is judged."""

from __future__ import annotations

import io
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

pytest.importorskip("piqp", reason="the peers come with the [bench] extra")
pytest.importorskip("cvxpy", reason="the peers come with the [bench] extra")
pytest.importorskip("pyscipopt", reason="the peers come with the [bench] extra")

from benchmarks import ROOT, decision, forward, growth, many, markets, plots, point, start, timing
from benchmarks.__main__ import GROUPS, INTERRUPTED, RESULTS, SLOW, WRONG, kept, main, measure, write
from benchmarks.decision_peers import GridMethod, slsqp_multistart
from benchmarks.quadratic_peers import PEERS, kkt_residual, polished
from benchmarks.table import (
    BEGIN,
    HEADS,
    Group,
    Quality,
    Row,
    Target,
    at_least,
    at_most,
    between,
    bytes_text,
    markdown,
    seconds_text,
    show,
    summary,
    times_text,
)
from inscrutable import MarkowitzProblem, consistent_beliefs, simplex_grid
from oracles import enumeration

GOOD = Row("solves", "U=3", "1.00 ms", "DAQP", "2.00 ms", "2×", Quality("error ≤ 1e-16"), Target("≥ 10×", False))
BAD = replace(GOOD, what="a|b", quality=Quality("error ≤ 1", False), target=Target())


def group_of(*rows: Row, name: str = "forward") -> Group:
    return Group(name, "A title", "2030-01-31, 2 cores", rows)


# --- the table ------------------------------------------------------------------------------------------------------


def test_durations_and_ratios_are_read_at_a_glance():
    texts = [seconds_text(value) for value in (0.0, 5e-9, 3.21e-6, 4.56e-5, 0.789, 12.34, 1234.5)]
    assert texts == ["0.00 ns", "5.00 ns", "3.21 µs", "45.6 µs", "789 ms", "12.3 s", "1,234 s"]
    assert seconds_text(1.0, "best of 3") == "1.00 s (best of 3)"
    assert [times_text(value) for value in (0.0471, 3.16, 41.4, 1234.0)] == ["0.047×", "3.2×", "41×", "1,234×"]
    assert bytes_text(3 * 2**20) == "3.0 MB"


def test_targets_say_whether_they_are_met():
    assert at_least(12, 10) == Target("≥ 10×", True)
    assert at_least(12, 10, 30) == Target("≥ 10×; ★ ≥ 30×: no", True)
    assert at_least(9, 10, 30) == Target("≥ 10×; ★ ≥ 30×: no", False)
    assert at_most(0.04, 0.5, star=0.05) == Target("≤ 0.5×; ★ ≤ 0.05×: yes", True)
    assert at_most(400, 300, " µs") == Target("≤ 300 µs", False)


def test_a_group_comes_back_as_it_was_kept(tmp_path):
    group = group_of(replace(GOOD, numbers={"seconds": 0.1}), BAD)
    group.save(tmp_path)
    assert Group.load(tmp_path / "forward.json") == group


def test_the_markdown_is_a_table_and_names_what_is_wrong():
    lines = markdown([group_of(GOOD, BAD)], ["growth_steps.png"]).splitlines()
    rows = [line.replace("\\|", "") for line in lines if line.startswith("|")]
    assert len(rows) == 4
    assert {line.count("|") for line in rows} == {len(HEADS) + 1}
    assert [("WRONG" in line, "| no |" in line) for line in rows[2:]] == [(False, True), (True, False)]
    assert lines[-1] == "![growth_steps](growth_steps.png)"


def test_the_printed_table_leaves_out_empty_columns():
    printed = io.StringIO()
    show(group_of(replace(GOOD, ratio="")), Console(file=printed, width=200))
    assert "error ≤ 1e-16" in printed.getvalue()
    assert "ratio" not in printed.getvalue()


def test_the_short_table_holds_what_is_asked():
    assert summary([group_of(BAD)]) == ""
    assert summary([group_of(GOOD, BAD)]).splitlines()[2:] == [
        "| solves | U=3 | 1.00 ms | DAQP, 2.00 ms | 2× | ≥ 10× | no |"
    ]


def test_the_pages_show_the_results_that_are_kept():
    page = (ROOT / "docs" / "benchmarks.md").read_text("utf-8")
    assert BEGIN in page
    assert between(page, summary(kept(RESULTS))) == page
    pictures = sorted(path.name for path in RESULTS.glob("*.png"))
    text = (RESULTS / "table.md").read_text("utf-8")
    assert sorted(text.count(f"({name})") for name in pictures) == [1] * len(pictures)
    assert text.startswith(markdown(kept(RESULTS)).rstrip())


# --- the command ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("row", "code"), [(GOOD, 0), (BAD, WRONG)])
def test_a_wrong_answer_fails_the_run_and_a_missed_target_does_not(row, code, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("benchmarks.__main__.measure", lambda name, quick: group_of(row, name=name))
    assert main(["forward", "start", "--out", str(tmp_path)]) == code
    assert [group.name for group in kept(tmp_path)] == ["forward", "start"]
    assert (tmp_path / "table.md").exists()
    printed = capsys.readouterr()
    assert printed.out.count("A title") == 2
    assert ("WRONG: a|b" if code else "target missed: solves") in printed.err


def test_an_interrupt_keeps_what_was_finished(tmp_path, monkeypatch):
    def interrupted(name, quick):
        if name == "decision":
            raise KeyboardInterrupt
        return group_of(GOOD, name=name)

    monkeypatch.setattr("benchmarks.__main__.measure", interrupted)
    assert main(["--out", str(tmp_path)]) == INTERRUPTED
    assert [group.name for group in kept(tmp_path)] == ["forward"]


def test_an_unknown_group_is_wrong_usage(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["backward"])
    assert stopped.value.code == 2
    assert "choose from forward" in capsys.readouterr().err


# --- timing ---------------------------------------------------------------------------------------------------------


def test_the_first_call_does_not_count():
    calls = []
    found = timing.best_of(3, lambda number: calls.append(number) or number)
    assert calls == [-1, 0, 1, 2]
    assert (found.result, found.how) == (2, "best of 3")
    assert timing.best_of(3, lambda number: number, patience=0.0)[1:] == ("first call", -1)


def test_a_short_loop_is_run_whole_and_a_long_one_in_four_runs_of_neighbours():
    whole = timing.loop(lambda i: i, 7, 10.0)
    assert whole.how == "once"
    assert whole.result[1] == list(range(7))
    part = timing.loop(lambda i: sum(range(20_000)), 4000, 0.01)
    assert part.how == f"extrapolated from {len(part.result[0]):,}"
    gaps = np.diff(part.result[0])
    assert np.count_nonzero(gaps > 1) <= 3
    assert part.result[0][[0, -1]].tolist() == [0, 3999]


# --- the peers ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PEERS)
def test_every_peer_solves_the_programme(name):
    drawn = markets.market(4, 5)
    decoys = simplex_grid(4, 3)[3:6]
    solve = PEERS[name](markets.problem_of(drawn), decoys)
    for i, decoy in enumerate(decoys):
        assert np.abs(solve(i) - enumeration.value(drawn, decoy)[1]).max() < forward.PEER_ERROR


def test_the_reference_of_the_forward_solves_is_exact_and_its_judge_sees_an_error():
    drawn = markets.market(4, 5)
    problem, decoys = markets.problem_of(drawn), simplex_grid(4, 3)
    solve = PEERS["DAQP"](problem, decoys)
    actions = np.array([polished(problem, decoy, solve(i)) for i, decoy in enumerate(decoys)])
    exact = enumeration.values(drawn, decoys)[1]
    assert np.abs(actions - exact).max() < 1e-12
    assert kkt_residual(problem, decoys, actions) < 1e-12
    assert kkt_residual(problem, decoys, np.roll(actions, 1, axis=0)) > forward.RESIDUAL
    assert kkt_residual(problem, decoys, actions * (1 + 1e-6)) > forward.RESIDUAL
    widest = int((actions > 0).sum(axis=1).argmax())
    first, second = np.flatnonzero(actions[widest] > 1e-3)[:2]
    actions[widest, [first, second]] += [1e-6, -1e-6]
    assert kkt_residual(problem, decoys, actions) > forward.RESIDUAL


def test_the_grid_method_finds_the_distance_of_an_explained_action_and_none_elsewhere():
    drawn = markets.market(3, 3)
    problem, belief = markets.problem_of(drawn), np.array([0.2, 0.3, 0.5])
    explained = problem.solve([0.5, 0.4, 0.1])
    empty = next(
        action for action in simplex_grid(3, 4) if math.isinf(consistent_beliefs(problem, action).distance(belief))
    )
    grid = GridMethod(drawn, np.array([explained, empty]))
    assert grid.distance(belief, 0) == pytest.approx(consistent_beliefs(problem, explained).distance(belief), abs=1e-4)
    assert grid.distance(belief, 1) == -np.inf


def test_a_decoy_is_pulled_to_where_it_is_affordable():
    drawn = markets.market(3, 3)
    problem, belief = markets.problem_of(drawn), markets.beliefs(1, 3)[0]
    optimal = float(problem.optimal_cost(belief))
    decoys, _ = slsqp_multistart(drawn, belief, 1.1 * optimal, n_starts=2, rng=np.random.default_rng(0))
    assert len(decoys)
    assert decision.privacy_of_decoy(problem, belief, np.eye(3)[0], optimal) < 1e-3
    reached = [decision.privacy_of_decoy(problem, belief, np.eye(3)[0], (1 + share) * optimal) for share in (0.01, 0.1)]
    assert 0 < reached[0] < reached[1] <= np.linalg.norm(belief - np.eye(3)[0]) + 1e-9


def test_a_decision_that_stays_behind_overspends_or_misstates_is_wrong():
    good = many.Comparison((1e-6, -0.5e-4), 1e-9, -0.1, 861)
    assert good.quality(1e-4).right
    for change in ({"gains": (0.0, -1.1e-4)}, {"off": 1e-5}, {"overspent": 1e-6}):
        assert not replace(good, **change).quality(1e-4).right


def test_what_takes_too_long_is_given_up_and_misses_its_target():
    rows = list(growth.rows(replace(growth.QUICK, assets=(3,), states=(3,), patience=0.01)))
    assert [row.target.met for row in rows] == [False, False, None, None, None]
    assert {row.ours for row in rows} == {"given up after 0.01 s"}


@pytest.mark.parametrize(("seconds", "used", "met"), [(200.0, 0.0, True), (2000.0, 0.0, False), (200.0, 1e9, False)])
def test_time_must_be_linear_and_memory_flat(seconds, used, met, monkeypatch):
    measured = {10: point.Measured(9, 0.1, 2.0, 0.0, 0.0, 0.0), 1000: point.Measured(9, 0.1, seconds, used, 0.0, 0.0)}
    monkeypatch.setattr(growth, "measured_apart", lambda asked, _: measured[asked.steps])
    rows = list(growth.rows(replace(growth.QUICK, steps=(10, 1000))))
    assert [row.target.met for row in rows[:2]] == [None, met]


# --- memory and pictures --------------------------------------------------------------------------------------------


def test_stored_memory_counts_every_array_once():
    whole = np.zeros(1000)
    problem = MarkowitzProblem([[0.1, 0.0]], [np.eye(2)], 1.0)
    assert sum(point.stored({"a": whole, "b": whole[10:], "c": [whole.reshape(10, 100)]}).values()) >= whole.nbytes
    counted = [size for size in point.stored([whole, whole[::2], whole.T]).values() if size == whole.nbytes]
    assert counted == [whole.nbytes]
    assert problem.covariances.nbytes in point.stored(problem).values()


PEAK = """
import numpy as np
from benchmarks import point

point.forget_peak()
before = point.peak_bytes()
block = np.ones(2**23)
del block
print(point.peak_bytes() - before)
"""


def test_the_peak_of_memory_is_seen():
    """In a process of its own, as measurements are: in one that has freed as much, a block needs no new memory."""
    told = subprocess.run([sys.executable, "-c", PEAK], capture_output=True, text=True, check=True, cwd=ROOT)
    assert float(told.stdout) > 0.5 * 2**26 or not point.STATUS.exists()


def test_a_point_is_measured_in_a_process_of_its_own():
    found = point.measured_apart(point.Point(5, 2), 300.0)
    assert found.candidates == 6
    assert found.decided_seconds > 0
    assert found.result_bytes > 0
    assert found.overspent <= growth.SPENT


def test_growth_is_drawn(tmp_path):
    keys = {"seconds": 1e-3, "prepared_seconds": 1e-4, "working_bytes": 0.0, "result_bytes": 1e3}
    rows = [
        Row("growth", "", "", numbers={**keys, "seconds": n * 1e-5, curve: float(n), "is_lottery": is_lottery})
        for curve in ("steps", "assets")
        for n in (10, 100, 1000)
        for is_lottery in (0.0, 1.0)
    ]
    names = plots.draw_growth(rows, tmp_path)
    assert names == ["growth_steps.png", "growth_assets.png", "growth_memory.png"]
    assert all((tmp_path / name).stat().st_size > 5000 for name in names)
    write(tmp_path, [group_of(*rows, name="growth")])
    assert "![growth_memory](growth_memory.png)" in (tmp_path / "table.md").read_text("utf-8")


# --- each benchmark -------------------------------------------------------------------------------------------------


# The processes of `start` do what test_first_calls.py and test_package.py have processes do; what `large` searches,
# test_large_search.py does.
@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=pytest.mark.audit) if each in ("start", "large") else each for each in GROUPS]
)
def test_the_benchmark_runs_at_a_tiny_size(name, tmp_path, monkeypatch):
    monkeypatch.setattr(growth, "measured_apart", lambda asked, _: point.measured(asked))  # apart: once, above
    run = start._run  # the reproduction is run by its own tests
    monkeypatch.setattr(start, "_run", lambda command, *more: "reproduce" in command or run(command, *more))
    group = measure(name, quick=True)
    assert group.rows
    wrong = [row.cells() for row in group.rows if not row.quality.right]
    assert not wrong
    write(tmp_path, [group])
    assert kept(tmp_path) == [group]


@pytest.mark.audit
@pytest.mark.parametrize("name", SLOW)
def test_the_slow_benchmark(name, capsys):
    with capsys.disabled():
        print()
        assert main([name]) == 0
