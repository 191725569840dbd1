"""Stores of studies that were edited by hand: no verb reads figures from them as if they were the study's."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from inscrutable import cli
from test_option_values import STUDY

EDITS = {
    "a row beyond the tasks": (
        "INSERT INTO rows SELECT 99, task, parameters, seed, status, figures, duration, error FROM rows WHERE number = 0",
        "it has a row 99, the study 2 tasks",
    ),
    "a row before the first": ("UPDATE rows SET number = -1 WHERE number = 0", "it has a row -1"),
    "parameters": ("UPDATE rows SET parameters = replace(parameters, 'ODM', 'CDM')", "row 0 is not that of its task"),
    "no parameters": ("UPDATE rows SET parameters = '{}' WHERE number = 1", "row 1 is not that of its task"),
    "identity": ("UPDATE rows SET task = 'abc' WHERE number = 1", "row 1 is not that of its task"),
    "seed": ("UPDATE rows SET seed = '7' WHERE number = 0", "row 0 has the seed 7, its task"),
    "status": ("UPDATE rows SET status = 'good' WHERE number = 0", "row 0 has the status 'good'"),
    "no numbers": ("UPDATE rows SET figures = '{\"error\": \"abc\"}'", "row 0 has the figure error 'abc', expected a number"),
    "a list": ("UPDATE rows SET figures = '[1]'", "row 0 has the figures '[1]', expected names and numbers"),
    "half a text": ("UPDATE rows SET figures = '{'", "row 0 has figures that cannot be read"),
    "no figures": ("UPDATE rows SET figures = '{}' WHERE number = 1", "row 1 lacks the figure error"),
    "duration": ("UPDATE rows SET duration = 'long' WHERE number = 1", "row 1 has the duration 'long'"),
    "seed of the study": (
        "UPDATE facts SET value = replace(value, '\"seed\":0', '\"seed\":5')",
        "its manifest has seed 0, its study 5",
    ),
    "no manifest": ("DELETE FROM facts WHERE name = 'manifest'", "its manifest has seed None, its study 0"),
    "another manifest": ("UPDATE facts SET value = '[1]' WHERE name = 'manifest'", "its fact manifest is '[1]'"),
    "a study that is none": ("UPDATE facts SET value = '[]' WHERE name = 'study'", "its fact study is '[]'"),
    "extensions": ("UPDATE facts SET value = 'x' WHERE name = 'extensions'", "is damaged or no store of a study"),
}  # fmt: skip


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small study that is done."""
    place = tmp_path_factory.mktemp("studies")
    (place / "study.toml").write_text(STUDY)
    assert cli.main(["study", "run", str(place / "study.toml"), "--out", str(place / "done"), "-q"]) == 0
    return place / "done"


@pytest.mark.parametrize("edit", EDITS)
def test_what_was_edited_is_refused_by_every_verb(
    finished: Path, tmp_path: Path, edit: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "edited"
    shutil.copytree(finished, folder)
    statement, message = EDITS[edit]
    with closing(sqlite3.connect(folder / "study.sqlite")) as store, store:
        store.execute(statement)
    for verb in ("export", "report", "resume"):
        assert cli.main(["study", verb, str(folder)]) == 3, verb
        said = capsys.readouterr().err
        assert f"{folder / 'study.sqlite'} is damaged" in said
        assert message in said


def test_a_manifest_that_was_edited_is_refused_until_it_is_written_anew(
    finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "edited"
    shutil.copytree(finished, folder)
    manifest = folder / "manifest.json"
    before = manifest.read_bytes()
    manifest.write_bytes(before.replace(b'"seed": 0', b'"seed": 5'))
    for verb in ("export", "report", "resume"):
        assert cli.main(["study", verb, str(folder)]) == 3, verb
        assert f"{manifest} is not the manifest in study.sqlite" in capsys.readouterr().err
    manifest.unlink()
    assert cli.main(["study", "export", str(folder)]) == 0
    assert cli.main(["study", "resume", str(folder)]) == 0
    assert manifest.read_bytes() == before
    assert cli.main(["study", "report", str(folder)]) == 0


@pytest.mark.parametrize("key", ["measures", "decision_makers", "adversaries"])
def test_an_empty_list_is_named_with_what_it_may_hold(
    tmp_path: Path, key: str, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [line for line in STUDY.splitlines() if not line.startswith(key)]
    (tmp_path / "study.toml").write_text("\n".join([f"{key} = []", *lines]))
    assert cli.main(["study", "run", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out")]) == 3
    said = capsys.readouterr().err
    assert f"study.toml, line 1, key {key}: " in said
    assert "should have at least 1 entry, got []" in said
