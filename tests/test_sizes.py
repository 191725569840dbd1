"""What `make test` leaves out is done by `make audit`."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

import conftest
from sizes import AUDIT, instances, paired, some
from tools import audit


def test_a_part_is_drawn_unless_all_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(AUDIT, raising=False)
    assert [instances(60), instances(12), instances(2), instances(12, least=2)] == [7, 3, 2, 2]
    assert some(range(10), 4) == [0, 4, 8]
    assert paired("abc", [1, 2]) == [("a", 1), ("b", 2), ("c", 1)]
    assert paired([1, 2], "abc") == [(1, "a"), (2, "b"), (1, "c")]
    monkeypatch.setenv(AUDIT, "1")
    assert [instances(60), instances(3, least=1)] == [60, 3]
    assert some(range(10), 4) == list(range(10))
    assert paired("ab", [1, 2]) == [("a", 1), ("a", 2), ("b", 1), ("b", 2)]


def test_the_audit_asks_for_all_and_takes_every_module_that_draws_a_part(monkeypatch: pytest.MonkeyPatch) -> None:
    marks: dict[str, list[str]] = {"drawn": [], "plain": []}
    modules = {"drawn": SimpleNamespace(instances=instances), "plain": SimpleNamespace(answer=42)}
    items = [
        SimpleNamespace(path=Path(f"test_{name}.py"), module=modules[name], add_marker=marks[name].append)
        for name in marks
    ]
    for settings, marked in (({}, []), (audit.settings(2), ["audit"])):
        monkeypatch.delenv(AUDIT, raising=False)
        for name, value in settings.items():
            monkeypatch.setenv(name, value)
        conftest.pytest_collection_modifyitems(items)
        assert marks == {"drawn": marked, "plain": []}
