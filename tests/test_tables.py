"""The user's own files: what is read comes back as written, and everything wrong is named with line and column."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from inscrutable import tolerances
from inscrutable.datasets import (
    load_industry_returns,
    read_beliefs,
    read_returns,
    read_weights,
    simple_returns,
    write_table,
)
from inscrutable.errors import InputError
from sizes import instances

GOOD = "date,A,B\n2020-01-31,0.01,-0.02\n2020-02-29,0.03,0.04\n"
same_folder = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=instances(100)
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "mine.csv"


def refused(call: Any, path: Path, *parts: str, **options: Any) -> str:
    """The one-line message of the `InputError`, which names the file and contains every part."""
    with pytest.raises(InputError) as caught:
        call(path, **options)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    for part in parts:
        assert part in message, message
    return message


# ---- files that are no tables -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (b"", ["is empty"]),
        (b"\xef\xbb\xbf", ["is empty"]),
        (b" \r\n\n", ["is empty"]),
        (b"date,A\n", ["only a header"]),
        (b"date,A\r\n\r\n\r\n", ["only a header"]),
        (b"date;A\n2020-01-31;0,01\n2020-02-29;0.02\n", ["line 2", "'0,01'", "not both"]),
        (b"date\tA\n2020-01-31\t1,234\n", ["line 2", "'1,234'", "thousands"]),
        (b"date,A\n2020-01-31,0.1\n2020-02-29,Z\xfcrich\n", ["line 3", "0xfc", "UTF-8"]),
        (GOOD.encode("utf-16"), ["UTF-16"]),
        (b"\x00\x01\x02\x03,A\n", ["binary"]),
        (b"PK\x03\x04\x14\x00", ["Excel"]),
        (b'date,A\n2020-01-31,0.1\n2020-02-29,"0.1\n', ["line 3", "quotes"]),
        (b'date,A\n2020-01-31,"0.1"x\n', ["line 2", "quotes"]),
        (b"date,A,B\n2020-01-31,0.1,0.2\n2020-02-29,0.1\n", ["line 3", "2 cells", "expected 3"]),
        (b"date,A\n\n2020-01-31,0.1,0.2\n", ["line 3", "3 cells", "expected 2"]),
        (b"date,A,A\n2020-01-31,0.1,0.2\n", ["line 1", "'A'", "duplicated", "columns 2 and 3"]),
        (b"date,A, A \n2020-01-31,0.1,0.2\n", ["'A'", "duplicated"]),
        (b"date,A,\n2020-01-31,0.1,0.2\n", ["line 1", "column 3", "blank"]),
    ],
)
@pytest.mark.parametrize("reader", ["returns", "beliefs", "weights"])
def test_unusable_file(file: Path, reader: str, content: bytes, parts: list[str]) -> None:
    file.write_bytes(content)
    if reader == "weights":
        refused(read_weights, file, *parts, assets=["A"])
    else:
        refused(read_returns if reader == "returns" else read_beliefs, file, *parts)


@pytest.mark.parametrize("reader", [read_returns, read_beliefs, lambda path: read_weights(path, assets=["A"])])
def test_no_file_at_all(tmp_path: Path, reader: Any) -> None:
    refused(reader, tmp_path / "nowhere.csv", "does not exist")
    refused(reader, tmp_path, "is a folder")
    (tmp_path / "file").write_text("x")
    refused(reader, tmp_path / "file" / "under.csv", "cannot be read")
    refused(reader, tmp_path / ("x" * 300), "cannot be read")
    for path, said in ((None, "must be given by its path, got NoneType"), ("a\0b", "is no path")):
        with pytest.raises(InputError, match=said):
            reader(path)


@pytest.mark.parametrize("prices", [pd.Series([1.0, 2.0]), np.ones((3, 2)), pd.DataFrame({"A": ["1", "x"]})])
def test_prices_that_are_no_table_of_numbers(prices: Any) -> None:
    with pytest.raises(InputError, match="prices must be"):
        simple_returns(prices)


# ---- cells ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cell", "parts"),
    [
        ("abc", ["found 'abc'", "expected a number"]),
        ("", ["missing (empty cell)"]),
        ("   ", ["missing (empty cell)"]),
        ("NaN", ["missing ('NaN')"]),
        ("n/a", ["missing ('n/a')"]),
        ("inf", ["infinite ('inf')"]),
        ("-Infinity", ["infinite"]),
        ("1e999", ["infinite ('1e999')"]),
        ("3.4%", ["found '3.4%'", "0.025"]),
        ('"1,234.5"', ["found '1,234.5'", "without commas"]),
        ("1_000", ["found '1_000'"]),
        ("٣", ["expected a number"]),
        ("0x1p-3", ["expected a number"]),
        ("x" * 500, ["x…'"]),
    ],
)
@pytest.mark.parametrize("reader", ["returns", "prices", "beliefs", "weights"])
def test_cell_that_is_no_number(file: Path, reader: str, cell: str, parts: list[str]) -> None:
    file.write_text(f"date,A,B\n2020-01-31,0.5,0.5\n\n2020-02-29,0.5,{cell}\n", "utf-8")
    calls = {
        "returns": lambda path: read_returns(path),
        "prices": lambda path: read_returns(path, prices=True),
        "beliefs": lambda path: read_beliefs(path),
        "weights": lambda path: read_weights(path, assets=["A", "B"]),
    }
    message = refused(calls[reader], file, "line 4, column 'B'", *parts)
    assert len(message) < 400


def test_line_numbers_count_lines_inside_quotes(file: Path) -> None:
    file.write_text('date,"A\nlong"\n2020-01-31,0.1\n2020-02-29,oops\n')
    refused(read_returns, file, "line 4", "oops")


# ---- dates ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dates", "parts"),
    [
        (["2020-01-31", ""], ["line 3, column 'date'", "date missing"]),
        (["2020-01-31", "NaT"], ["line 3", "date missing"]),
        (["2020-01-31", "soon"], ["line 3", "found 'soon'", "2020-01-31"]),
        (["soon", "2020-01-31"], ["line 2", "found 'soon'"]),
        (["0", "1"], ["line 2", "found '0'"]),
        (["2020-01-31", "2020-02-30"], ["line 3", "2020-02-30"]),
        (["2020-01-31", "2020-13-01"], ["line 3", "2020-13-01"]),
        (["2020-01-31", "20200231"], ["line 3", "20200231"]),
        (["2020-01-31", "29/02/2020"], ["line 3", "29/02/2020"]),
        (["0001-01-31", "2020-01-31"], ["line 2", "0001-01-31"]),
        (["2020-01-31 25:00", "2020-02-01 00:00"], ["line 2", "25:00"]),
        (["2020-01-31", "2020-01-31"], ["line 3, column 'date'", "duplicated", "line 2"]),
        (["2020-01-31 02:00", "2020-01-31 02:00"], ["line 3", "duplicated", "change of the clocks", "UTC offsets"]),
        (
            ["2020-01-31 02:00Z", "2020-01-31 03:00"],
            ["line 3", "has no UTC offset", "expected one in all rows or in none"],
        ),
        (["31.01.2020 24:00", "01.02.2020 00:00"], ["line 2", "24:00"]),
        (["2020-02-29", "2020-01-31"], ["line 3, column 'date'", "goes back in time", "'2020-02-29'"]),
        (["01/02/2020", "01/03/2020"], ["line 2", "day first or month first", "YYYY-MM-DD"]),
        # increasing with the month first, with the day first the newest row stands first
        (["01/10/2020", "02/09/2020"], ["line 2", "day first or month first"]),
        (["01/03/2020", "02/02/2020", "03/01/2020"], ["line 2", "day first or month first"]),
    ],
)
@pytest.mark.parametrize("reader", [read_returns, read_beliefs])
def test_bad_date(file: Path, reader: Any, dates: list[str], parts: list[str]) -> None:
    file.write_text("date,A,B\n" + "".join(f"{each},0.5,0.5\n" for each in dates))
    refused(reader, file, *parts)


@pytest.mark.parametrize(
    ("dates", "expected"),
    [
        (["2020-01-31", "2020-02-29"], ["2020-01-31", "2020-02-29"]),
        (["2020-1-5", "2020-02-29"], ["2020-01-05", "2020-02-29"]),
        (["2020/01/31", "2020/02/29"], ["2020-01-31", "2020-02-29"]),
        (["2020-01", "2020-02"], ["2020-01-31", "2020-02-29"]),
        (["202011", "202012"], ["2020-11-30", "2020-12-31"]),
        (["20201101", "20201211"], ["2020-11-01", "2020-12-11"]),
        (["31.01.2020", "01.02.2020"], ["2020-01-31", "2020-02-01"]),
        (["03.04.2020", "04.05.2020"], ["2020-04-03", "2020-05-04"]),
        (["31/01/2020", "01/02/2020"], ["2020-01-31", "2020-02-01"]),
        (["1/31/2020", "2/1/2020"], ["2020-01-31", "2020-02-01"]),
        # the day first would be in no order
        (["01/10/2020", "02/09/2020", "03/11/2020"], ["2020-01-10", "2020-02-09", "2020-03-11"]),
        (["2020-01-31 00:00:00-05:00", "2020-02-03 00:00:00-05:00"], ["2020-01-31", "2020-02-03"]),
        (["2020-01-31T16:00", "2020-01-31T17:00"], ["2020-01-31 16:00", "2020-01-31 17:00"]),
        (["31.01.2020 16:00", "31.01.2020 17:30:05"], ["2020-01-31 16:00", "2020-01-31 17:30:05"]),
        # instants, in UTC: the hour that a change of the clocks repeats comes twice
        (
            ["2020-10-25T02:00+02:00", "2020-10-25T02:00+01:00"],
            ["2020-10-25 00:00+00:00", "2020-10-25 01:00+00:00"],
        ),
    ],
)
def test_notations_of_dates(file: Path, dates: list[str], expected: list[str]) -> None:
    file.write_text("date,A\n" + "".join(f"{each},0.5\n" for each in dates))
    assert list(read_returns(file).index) == [pd.Timestamp(each) for each in expected]


# ---- returns and prices ------------------------------------------------------------------------------


def test_one_column_of_dates_is_not_enough(file: Path) -> None:
    file.write_text("date\n2020-01-31\n")
    refused(read_returns, file, "line 1", "at least one asset column")
    refused(read_beliefs, file, "line 1", "at least one regime column")


def test_one_asset_and_one_row_are_enough(file: Path) -> None:
    file.write_text("date,A\n2020-01-31,0.1\n")
    assert read_returns(file).to_dict("list") == {"A": [0.1]}


def test_header_forgotten(file: Path) -> None:
    file.write_text("2020-01-31,0.1,0.2\n2020-02-29,0.1,0.3\n")
    refused(read_returns, file, "line 1", "starts with data")


def test_numeric_tickers_are_labels(file: Path) -> None:
    file.write_text("date,600519,000001\n2020-01-31,0.1,0.2\n")
    assert list(read_returns(file).columns) == ["600519", "000001"]


def test_an_accent_is_the_same_however_it_is_written(file: Path) -> None:
    file.write_text("date,Énergie,Pétrole\n2020-01-31,0.1,0.2\n", "utf-8")
    assert list(read_returns(file).columns) == ["\u00c9nergie", "P\u00e9trole"]
    weights = file.with_name("weights.csv")
    weights.write_text("P\u0065\u0301trole,\u0045\u0301nergie\n0.25,0.75\n", "utf-8")
    assert read_weights(weights, assets=["\u00c9nergie", "P\u00e9trole"]).frame.to_numpy().tolist() == [[0.75, 0.25]]


@pytest.mark.parametrize("scale", [100.0, 1.0])
def test_percentages_and_prices_are_not_returns(file: Path, scale: float) -> None:
    returns = load_industry_returns().returns.iloc[:60]
    write_table(returns * scale if scale > 1 else 100.0 * (1.0 + returns).cumprod(), file)
    refused(read_returns, file, "percentages or prices", "0.01 for one per cent", "prices=True", "line 2")


def test_mild_percentages_are_found_by_an_impossible_loss(file: Path) -> None:
    file.write_text("date,A,B\n2020-01-31,0.4,0.5\n2020-02-29,0.9,-1.2\n")
    refused(read_returns, file, "line 3, column 'B'", "-1.2", "more than everything", "divide percentages by 100")


def test_large_but_possible_returns_pass(file: Path) -> None:
    file.write_text("date,A,B\n2020-01-31,1.5,-1\n2020-02-29,-0.9,2.0\n")
    assert read_returns(file).to_numpy().tolist() == [[1.5, -1.0], [-0.9, 2.0]]


def test_prices_become_simple_returns(file: Path) -> None:
    file.write_text("date,A,B\n2020-01-31,100,8\n2020-02-29,110,4\n2020-03-31,99,5\n")
    frame = read_returns(file, prices=True)
    np.testing.assert_allclose(frame.to_numpy(), [[0.1, -0.5], [-0.1, 0.25]], atol=1e-15)
    assert list(frame.index) == [pd.Timestamp("2020-02-29"), pd.Timestamp("2020-03-31")]
    assert frame.index.name == "date"


@pytest.mark.parametrize("price", ["0", "-3", "-0.0", "1e-400"])
def test_prices_are_above_zero(file: Path, price: str) -> None:
    file.write_text(f"date,A,B\n2020-01-31,100,8\n2020-02-29,110,{price}\n")
    refused(read_returns, file, "line 3, column 'B'", "expected above 0", prices=True)


def test_prices_need_two_rows_and_a_finite_ratio(file: Path) -> None:
    file.write_text("date,A\n2020-01-31,100\n")
    refused(read_returns, file, "1 row of prices", prices=True)
    file.write_text("date,A\n2020-01-31,1e-300\n2020-02-29,1e300\n")
    refused(read_returns, file, "line 3, column 'A'", "too far apart", prices=True)


def test_simple_returns_names_the_bad_price() -> None:
    prices = pd.DataFrame({"A": [1.0, 2.0], "B": [1.0, np.nan]}, index=["x", "y"])
    with pytest.raises(InputError, match="'B' at y is nan"):
        simple_returns(prices)
    with pytest.raises(InputError, match="at least 2"):
        simple_returns(prices.iloc[:1])


# ---- labels and encodings -------------------------------------------------------------------------------


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("last", [True, False])
def test_byte_order_mark_and_line_ends(file: Path, mark: bytes, line_end: str, last: bool) -> None:
    text = GOOD if last else GOOD.rstrip("\n")
    file.write_bytes(mark + text.replace("\n", line_end).encode())
    frame = read_returns(file)
    assert frame.index.name == "date"
    assert list(frame.columns) == ["A", "B"]
    assert frame.to_numpy().tolist() == [[0.01, -0.02], [0.03, 0.04]]


def test_quoted_and_foreign_labels_are_kept(file: Path) -> None:
    labels = ["Zürich, Ltd.", 'the "big" one', "日本株", "a;b", "x/y z"]
    frame = pd.DataFrame(
        [[0.1, 0.2, 0.3, 0.4, 0.5]], index=pd.DatetimeIndex(["2020-01-31"], name="jour"), columns=labels
    )
    write_table(frame, file)
    back = read_returns(file)
    assert list(back.columns) == labels
    assert back.index.name == "jour"


names = st.text(st.characters(exclude_categories=("Cs", "Cc")), min_size=1, max_size=8).map(str.strip).filter(bool)


@st.composite
def frames(draw: st.DrawFn, low: float, high: float) -> pd.DataFrame:
    columns = draw(st.lists(names.filter(lambda name: name != "date"), min_size=1, max_size=4, unique=True))
    days = draw(st.lists(st.dates(date(1800, 1, 1), date(2100, 1, 1)), min_size=2, max_size=6, unique=True))
    cells = st.floats(low, high, allow_nan=False)
    values = draw(
        st.lists(st.lists(cells, min_size=len(columns), max_size=len(columns)), min_size=len(days), max_size=len(days))
    )
    return pd.DataFrame(values, index=pd.DatetimeIndex(sorted(days), name="date"), columns=columns, dtype=float)


@same_folder
@given(frames(-1.0, 1.0))
def test_returns_survive_the_round_trip_bit_for_bit(tmp_path: Path, frame: pd.DataFrame) -> None:
    write_table(frame, tmp_path / "round.csv")
    back = read_returns(tmp_path / "round.csv")
    assert list(back.columns) == list(frame.columns)
    assert list(back.index) == list(frame.index)
    assert back.to_numpy().tobytes() == frame.to_numpy().tobytes()


@same_folder
@given(frames(0.01, 1000.0))
def test_prices_give_the_ratio_of_neighbours(tmp_path: Path, frame: pd.DataFrame) -> None:
    write_table(frame, tmp_path / "round.csv")
    back = read_returns(tmp_path / "round.csv", prices=True)
    for t in range(1, len(frame)):
        for name in frame.columns:
            expected = frame[name].iloc[t] / frame[name].iloc[t - 1] - 1.0
            assert back[name].iloc[t - 1] == expected


def test_the_embedded_returns_survive_the_round_trip(file: Path) -> None:
    returns = load_industry_returns().returns
    write_table(returns, file)
    pd.testing.assert_frame_equal(
        read_returns(file), returns, check_freq=False, check_index_type=False, check_exact=True
    )


# ---- beliefs -----------------------------------------------------------------------------------------


def test_rounded_beliefs_are_renormalised(file: Path) -> None:
    file.write_text("date,a,b,c\n2020-01,0.3333,0.3333,0.3333\n2020-02,0.2,0.3,0.5\n")
    frame = read_beliefs(file)
    np.testing.assert_allclose(frame.iloc[0], 1 / 3, rtol=1e-15)
    assert frame.iloc[1].tolist() == [0.2, 0.3, 0.5]


def test_beliefs_of_few_decimals_may_miss_one_by_what_rounding_explains(file: Path) -> None:
    file.write_text("date,a,b,c\n2020-01,0.33,0.33,0.33\n2020-02,0.335,0.335,0.335\n")
    refused(read_beliefs, file, "line 2", "sum to 0.99", "within 0.005")  # of three decimals
    file.write_text("date,a,b,c\n2020-01,0.33,0.33,0.33\n2020-02,0.34,0.34,0.33\n")
    np.testing.assert_allclose(read_beliefs(file).sum(axis=1), 1.0, rtol=1e-15)
    file.write_text("date,a,b,c\n2020-01,0.33,0.33,0.32\n")
    refused(read_beliefs, file, "line 2", "sum to 0.98", "within 0.015")
    file.write_text("date,a,b\n2020-01,0.5,0.6\n")  # five states of one decimal would explain it
    refused(read_beliefs, file, "line 2", "sum to 1.1", "within 0.05")


@pytest.mark.parametrize("off", [1.1, -1.1])
def test_beliefs_off_the_simplex(file: Path, off: float) -> None:
    last = 0.5 + off * tolerances.BELIEF_TABLE_SUM
    file.write_text(f"date,a,b\n2020-01,0.5,0.5\n2020-02,0.5,{last}\n")
    refused(read_beliefs, file, "line 3", f"sum to {0.5 + last:.10g}", "expected 1")


def test_negative_belief(file: Path) -> None:
    file.write_text("date,a,b\n2020-01,0.5,0.5\n2020-02,-0.001,1.001\n")
    refused(read_beliefs, file, "line 3, column 'a'", "-0.001", "at least 0")
    file.write_text("date,a,b\n2020-01,-1e-12,1.0\n")  # rounding, not a mistake
    assert read_beliefs(file).to_numpy().tolist() == [[0.0, 1.0]]


def test_percent_beliefs_and_zero_rows(file: Path) -> None:
    file.write_text("date,a,b\n2020-01,40,60\n")
    refused(read_beliefs, file, "line 2", "look like percentages")
    file.write_text("date,a,b\n2020-01,0,0\n")
    refused(read_beliefs, file, "line 2", "sum to 0")


def test_regimes_are_matched_by_label(file: Path) -> None:
    file.write_text("date,b,a\n2020-01,0.25,0.75\n")
    assert read_beliefs(file, names=["a", "b"]).to_dict("list") == {"a": [0.75], "b": [0.25]}
    refused(read_beliefs, file, "missing regime: 'c'", "unknown regime: 'b'", names=["a", "c"])
    with pytest.raises(InputError, match=r"twice: \['a'\]"):
        read_beliefs(file, names=["a", "a"])
    with pytest.raises(InputError, match="sequence of labels"):
        read_beliefs(file, names="ab")


@same_folder
@given(st.lists(st.lists(st.integers(0, 9999), min_size=3, max_size=3).filter(any), min_size=1, max_size=5))
def test_beliefs_of_four_digits_pass(tmp_path: Path, rows: list[list[int]]) -> None:
    lines = ["date,a,b,c"]
    for t, row in enumerate(rows):
        lines.append(f"{2000 + t}-01," + ",".join(f"{each / sum(row):.4f}" for each in row))
    (tmp_path / "b.csv").write_text("\n".join(lines))
    frame = read_beliefs(tmp_path / "b.csv")
    np.testing.assert_allclose(frame.sum(axis=1), 1.0, atol=1e-15)
    np.testing.assert_allclose(frame, [[each / sum(row) for each in row] for row in rows], atol=2.5e-4)


# ---- weights -----------------------------------------------------------------------------------------


def test_weights_are_aligned_and_left_as_written(file: Path) -> None:
    file.write_text("month,B,A\n2020-02,0.3334,0.6664\n2020-01,1,0\n")
    table = read_weights(file, assets=["A", "B"])
    assert list(table.frame.columns) == ["A", "B"]
    assert table.frame.to_numpy().tolist() == [[0.6664, 0.3334], [0.0, 1.0]]
    assert list(table.frame.index) == [pd.Timestamp("2020-02-29"), pd.Timestamp("2020-01-31")]
    assert table.frame.index.name == "month"
    assert table.decimals == 4
    assert "rounded to 4 decimals" in table.summary()
    file.write_text("A,B\n0.3,0.7\n")
    assert read_weights(file, assets=["A", "B"]).summary().endswith("rounded to 1 decimal")


def test_a_row_without_a_label_is_numbered(file: Path) -> None:
    file.write_text("A,B\n0.25,0.75\n0.5,0.5\n")
    assert list(read_weights(file, assets=["B", "A"]).frame.index) == [0, 1]


def test_labels_of_rows_may_be_anything(file: Path) -> None:
    file.write_text("fund,A,B\nZürich fund,0.25,0.75\n2020-01,0.5,0.5\n")
    assert list(read_weights(file, assets=["A", "B"]).frame.index) == ["Zürich fund", "2020-01"]


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("fund,A\nx,1\n", ["missing asset: 'B'", "Expected one column each for 'A', 'B'"]),
        ("fund,A,B,C,D\nx,1,0,0,0\n", ["unknown assets: 'C', 'D'"]),
        ("a,b\n0.5,0.5\n", ["missing assets: 'A', 'B'", "unknown asset: 'b'"]),
        ("A,fund,B\n1,x,0\n", ["unknown asset: 'fund'"]),
        ("fund,A,B\nx,0.5,0.5\nx,0.4,0.6\n", ["line 3, column 'fund'", "'x'", "duplicated", "line 2"]),
        ("fund,A,B\nx,0.5,0.5\n,0.4,0.6\n", ["line 3, column 'fund'", "missing"]),
        ("fund,A,B\nx,0.50,0.40\n", ["line 2", "sum to 0.9", "within 0.01"]),
        ("fund,A,B\nx,50,50\n", ["line 2", "look like percentages"]),
        ("day,A,B\n01/02/2020,0.5,0.5\n", ["day first or month first"]),
    ],
)
def test_bad_weights(file: Path, text: str, parts: list[str]) -> None:
    file.write_text(text, "utf-8")
    refused(read_weights, file, *parts, assets=["A", "B"])


def test_long_lists_of_missing_assets_are_cut(file: Path) -> None:
    file.write_text("A,B\n0.5,0.5\n")
    refused(read_weights, file, "and 32 more", assets=[f"asset {i}" for i in range(40)])


def test_assets_are_checked(file: Path) -> None:
    for assets in ([], ["A", "A"], "AB"):
        with pytest.raises(InputError, match="assets"):
            read_weights(file, assets=assets)


def test_short_positions_and_the_edge_of_the_sum(file: Path) -> None:
    file.write_text("A,B\n1.3,-0.3\n0.5,0.505\n0.5,0.495\n")
    assert read_weights(file, assets=["A", "B"]).frame.iloc[0].tolist() == [1.3, -0.3]


@pytest.mark.parametrize(
    ("first", "second", "decimals"),
    [
        ("1", "0", 0),
        ("0.5", ".5", 1),
        ("0.25", "0.750", 3),
        ("1.", "-0.0", 1),
        ("9.5e-1", "5E-2", 2),
        ("0.9999999", "1e-7", 7),
        ("0.99999999", "1e-8", None),
        ("0.3333333333333333", "0.6666666666666667", None),
    ],
)
def test_decimals_are_those_of_the_text(file: Path, first: str, second: str, decimals: int | None) -> None:
    file.write_text(f"fund 1.23456,A,B\n7.654321,{first},{second}\n")
    assert read_weights(file, assets=["A", "B"]).decimals == decimals


@same_folder
@given(st.integers(0, 7), st.lists(st.integers(0, 100), min_size=2, max_size=6).filter(any))
def test_rounded_weights_report_their_rounding(tmp_path: Path, digits: int, shares: list[int]) -> None:
    weights = [each / sum(shares) for each in shares]
    written = [f"{each:.{digits}f}" for each in weights]
    if abs(sum(map(float, written)) - 1.0) > tolerances.PUBLISHED_SUM:
        return
    labels = [f"a{i}" for i in range(len(shares))]
    (tmp_path / "w.csv").write_text(",".join(labels) + "\n" + ",".join(written) + "\n")
    table = read_weights(tmp_path / "w.csv", assets=labels)
    assert table.decimals == digits
    np.testing.assert_allclose(table.frame.iloc[0], weights, atol=0.5 * 10.0**-digits + 1e-15)


# ---- months that are missing --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dates", "named"),
    [
        (["2020-01", "2020-02", "2020-03", "2020-06", "2020-07"], "2020-04, 2020-05:"),
        (["2019-11", "2019-12", "2020-02", "2020-03", "2020-05", "2020-06"], "2020-01, 2020-04:"),
        (["2020-03-31", "2020-06-30", "2020-12-31", "2021-03-31"], "2020-09:"),
        (["1990-01", "1990-02", "1990-03", "1991-03"], "1990-11 and 3 more:"),
        (["2020-01", "2020-02", "2020-03", "2020-04"], None),
        (["2020-01-02", "2020-01-03", "2020-01-06", "2020-03-02"], None),
        (["2020-01", "2020-04", "2020-05", "2020-12"], "2020-02, 2020-03, 2020-06,"),
        (["2020-01", "2020-02", "2020-06"], "2020-03, 2020-04, 2020-05:"),
        (["2020-01", "2020-03", "2020-06"], None),
        (["2020-01", "2022-02"], None),
        (["2020-01"], None),
    ],
)
def test_months_without_a_row_are_named(
    file: Path, caplog: pytest.LogCaptureFixture, dates: list[str], named: str | None
) -> None:
    file.write_text("date,A,B\n" + "".join(f"{each},0.01,0.02\n" for each in dates))
    assert len(read_returns(file)) == len(dates)
    assert [message.partition(" has no row for ")[0] for message in caplog.messages] == ([str(file)] if named else [])
    assert named is None or named in caplog.text


def test_the_embedded_months_are_complete(caplog: pytest.LogCaptureFixture) -> None:
    load_industry_returns()
    assert not caplog.messages
