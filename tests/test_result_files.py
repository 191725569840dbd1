"""Writing results: whole or not at all, the same bytes for the same data, and errors that name the target."""

from __future__ import annotations

import json
import os
import re
from dataclasses import dataclass
from datetime import datetime
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from inscrutable import files
from inscrutable.datasets import output_folder, read_returns, whole_file, write_json, write_table
from inscrutable.errors import InputError
from inscrutable.labels import label_text
from inscrutable.reports.style import save_figure
from sizes import instances

same_folder = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=instances(100)
)
names = st.text(st.characters(codec="utf-8"), max_size=8)


class Colour(Enum):
    RED = "red"


@dataclass(frozen=True)
class Result:
    value: float
    when: datetime


def test_json_is_sorted_plain_and_ends_with_a_newline(tmp_path: Path) -> None:
    data = {
        "z": np.array([1.5, np.nan]),
        "a": [np.int64(3), np.bool_(True), None, pd.NA, pd.NaT, "é"],
        2: (Colour.RED, Path("x") / "y"),
        "r": Result(float("inf"), datetime(2020, 1, 31)),
        "day": pd.Timestamp("2020-01-31"),
        "scalar": np.array(-np.inf),
    }
    write_json(data, tmp_path / "s.json")
    text = (tmp_path / "s.json").read_text("utf-8")
    assert text.endswith("}\n")
    assert "é" in text
    read = json.loads(text)
    assert list(read) == sorted(read)
    assert read == {
        "z": [1.5, None],
        "a": [3, True, None, None, None, "é"],
        "2": ["red", os.path.join("x", "y")],
        "r": {"value": "Infinity", "when": "2020-01-31T00:00:00"},
        "day": "2020-01-31T00:00:00",
        "scalar": "-Infinity",
    }
    assert float(read["scalar"]) == -np.inf


def test_json_does_not_depend_on_the_order_of_keys(tmp_path: Path) -> None:
    write_json({"a": {"x": 1, "y": 0.1}, "b": 2}, tmp_path / "1.json")
    write_json({"b": 2, "a": {"y": 0.1, "x": 1}}, tmp_path / "2.json")
    assert (tmp_path / "1.json").read_bytes() == (tmp_path / "2.json").read_bytes()


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | names,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=3),
)


@same_folder
@given(plain)
def test_plain_data_survive_json(tmp_path: Path, data: Any) -> None:
    write_json(data, tmp_path / "p.json")
    assert json.loads((tmp_path / "p.json").read_text("utf-8")) == data


@pytest.mark.parametrize(
    ("data", "part"),
    [
        ({"a": [1, {2}]}, "data['a'][1] is a set"),
        ({"1": 0, 1: 0}, "two keys that both become '1'"),
        ({"c": 1j}, "data['c'] is a complex"),
        ({"f": pd.DataFrame()}, "data['f'] is a DataFrame"),
        ({"d": {(1, 2): 0}}, "data['d'] has the key (1, 2)"),
        ("\ud800", "UTF-8"),
    ],
)
def test_what_has_no_json_form(tmp_path: Path, data: Any, part: str) -> None:
    with pytest.raises(InputError, match=re.escape(part)):
        write_json(data, tmp_path / "x.json")
    assert list(tmp_path.iterdir()) == []


def test_tables_are_written_in_full(tmp_path: Path) -> None:
    write_table(pd.DataFrame({"A": [0.1 + 0.2, np.nan], "B": [1e-300, 3.0]}, index=["x", "y"]), tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_bytes() == b",A,B\nx,0.30000000000000004,1e-300\ny,,3.0\n"


def test_labels_that_look_like_formulas_are_written_as_text_and_read_back(tmp_path: Path) -> None:
    labels = ["=1+1", "+A", "-B", "@C", "'=D", "plain"]
    frame = pd.DataFrame([[-0.5, -0.25, 0.0, 0.5, 0.25, -1.0]], pd.DatetimeIndex(["2020-01-31"], name="=date"), labels)
    write_table(frame, tmp_path / "t.csv")
    header, row = (tmp_path / "t.csv").read_text().splitlines()
    assert header == "'=date,'=1+1,'+A,'-B,'@C,''=D,plain"
    assert row == "2020-01-31,-0.5,-0.25,0.0,0.5,0.25,-1.0"  # numbers are no labels
    back = read_returns(tmp_path / "t.csv")
    assert [back.index.name, *back.columns] == ["=date", *labels]
    write_table(pd.DataFrame({"note": ["=cmd()", "fine", None]}, index=["@x", "y", -1]), tmp_path / "n.csv")
    assert (tmp_path / "n.csv").read_text() == ",note\n'@x,'=cmd()\ny,fine\n-1,\n"


def test_a_rewritten_file_keeps_its_permissions(tmp_path: Path) -> None:
    target = tmp_path / "private.csv"
    frame = pd.DataFrame({"A": [1.0]})
    write_table(frame, target)
    for mode in (0o600, 0o640, 0o644):
        target.chmod(mode)
        with whole_file(target) as temporary:
            assert temporary.stat().st_mode & 0o077 == 0  # nobody reads it before it has its permissions
            temporary.write_text("new")
        assert target.stat().st_mode & 0o777 == mode


def test_a_link_stays_a_link_and_its_target_is_rewritten(tmp_path: Path) -> None:
    target, link = tmp_path / "real.json", tmp_path / "link.json"
    link.symlink_to("real.json")
    for value in (1, 2):  # the first makes the target
        write_json({"a": value}, link)
        assert link.is_symlink()
        assert target.read_text().split() == ["{", '"a":', str(value), "}"]
    assert sorted(each.name for each in tmp_path.iterdir()) == ["link.json", "real.json"]


def write_half(target: Path) -> None:
    with whole_file(target) as temporary:
        assert temporary.parent == target.parent
        assert temporary.suffix == target.suffix
        temporary.write_text("half")
        raise RuntimeError("half way")


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "t.csv"
    target.write_text("old")
    with pytest.raises(RuntimeError, match="half way"):
        write_half(target)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_target_that_cannot_be_written(tmp_path: Path) -> None:
    frame = pd.DataFrame({"A": [1.0]})
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "folder").mkdir()
    for target in (tmp_path / "none" / "t.csv", tmp_path / "file" / "t.csv", tmp_path / "folder"):
        with pytest.raises(InputError, match=re.escape(f"{target} cannot be written")):
            write_table(frame, target)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["file", "folder"]
    assert list((tmp_path / "folder").iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "umask"), reason="needs permission bits")
def test_written_files_have_ordinary_permissions(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("x")
    write_json({}, tmp_path / "s.json")
    assert (tmp_path / "s.json").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_output_folder_is_created_and_left_clean(tmp_path: Path) -> None:
    folder = output_folder(tmp_path / "a" / "b")
    assert folder == tmp_path / "a" / "b"
    (folder / "kept.txt").write_text("x")
    assert output_folder(str(folder)) == folder
    assert [each.name for each in folder.iterdir()] == ["kept.txt"]


def test_output_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    for path in (tmp_path / "file", tmp_path / "file" / "under"):
        with pytest.raises(InputError, match=re.escape(f"output folder {path} cannot be written")):
            output_folder(path)
    assert (tmp_path / "file").read_text() == "in the way"
    with pytest.raises(InputError, match="an output folder must be given by its path, got NoneType"):
        output_folder(None)  # type: ignore[arg-type]


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder that refuses even the superuser")
def test_output_folder_on_a_read_only_file_system() -> None:
    for path in ("/proc/self", "/proc/self/results"):
        with pytest.raises(InputError, match="cannot be written"):
            output_folder(path)


def test_there_is_one_writer() -> None:
    assert whole_file is files.whole_file


@pytest.mark.parametrize("error", [RuntimeError("no such font"), OSError(28, "No space left on device")])
def test_a_picture_that_fails_leaves_nothing(tmp_path: Path, error: Exception) -> None:
    class Broken(Figure):
        def savefig(self, path: Path, **options: Any) -> None:  # type: ignore[override]
            Path(path).write_bytes(b"half")
            raise error

    expected = InputError if isinstance(error, OSError) else RuntimeError
    with pytest.raises(expected, match=r"no such font|picture\.png cannot be written: No space left"):
        save_figure(Broken(), tmp_path, "picture")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("label", "text"),
    [
        (pd.Timestamp("2020-01-31"), "2020-01-31"),
        (pd.Timestamp("2020-01-31", tz="UTC"), "2020-01-31"),
        (pd.Timestamp("2020-01-31 16:00"), "2020-01-31 16:00:00"),
        (datetime(2020, 1, 31), "2020-01-31"),
        (pd.NaT, "NaT"),
        (pd.Period("2020-01", "M"), "2020-01"),
        (7, "7"),
    ],
)
def test_labels_are_written_as_a_person_would(label: Any, text: str) -> None:
    assert label_text(label) == text
