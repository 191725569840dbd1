"""Form 13F filings as weights: traps of the SEC's data sets and of spreadsheets are read rightly or named."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from inscrutable import InputError
from inscrutable.datasets import dollars_13f, only_shares, read_13f

ASSETS = ["Oil", "Food", "Tech"]


def table_13f(**columns):
    rows = {"CUSIP": ["037833100", "594918104"], "VALUE": [200, 100], "SSHPRNAMT": [1500, 400],
            "SSHPRNAMTTYPE": ["SH", "SH"], "PUTCALL": ["", ""]}  # fmt: skip
    return pd.DataFrame({**rows, **columns})


def test_13f_values_are_thousands_before_and_dollars_from_3_january_2023():
    thousands = dollars_13f(table_13f(), filed="2023-01-02")
    assert thousands["value"].tolist() == [200_000.0, 100_000.0]
    dollars = dollars_13f(table_13f(VALUE=[200_000, 100_000]), filed="03-JAN-2023")
    assert dollars["value"].tolist() == [200_000.0, 100_000.0]
    edgar = table_13f().set_axis(["Cusip", "Value", "SharesPrnAmount", "Type", "PutCall"], axis=1)
    edgar = edgar.assign(Ticker=["AAPL", "MSFT"], Issuer=["APPLE INC", "MICROSOFT CORP"], Type="Shares")
    assert dollars_13f(edgar, filed="2022-11-14")["ticker"].tolist() == ["AAPL", "MSFT"]
    twice = table_13f(CUSIP=["037833100", "37833100"])
    assert dollars_13f(twice, filed="2022-11-14")["value"].tolist() == [300_000.0]
    assert len(only_shares(table_13f(PUTCALL=["Put", ""]))) == 1


@pytest.mark.parametrize(
    ("columns", "filed", "message"),
    [
        ({"PUTCALL": ["Put", ""]}, "2022-11-14", "options"),
        ({"SSHPRNAMTTYPE": ["SH", "PRN"]}, "2022-11-14", "principal amounts"),
        ({"VALUE": [200, -1]}, "2022-11-14", "value -1 and shares"),
        ({"VALUE": ["200", "many"]}, "2022-11-14", "many"),
        ({}, "2023-02-14", "look like thousands"),
        ({"VALUE": [200_000_000, 100_000_000]}, "2022-11-14", "look like dollars"),
        ({"ACCESSION_NUMBER": ["1", "2"]}, "2022-11-14", "several filings"),
        ({}, "last year", "no day of filing"),
        ({}, pd.NaT, "the day of filing is missing"),
        ({}, "01-02-2023", "day first or month first"),
    ],
)
def test_traps_of_13f_are_named(columns, filed, message):
    with pytest.raises(InputError, match=message):
        dollars_13f(table_13f(**columns), filed=filed)


def test_13f_without_columns_or_rows():
    with pytest.raises(InputError, match="no column VALUE"):
        dollars_13f(table_13f().drop(columns="VALUE"), filed="2022-11-14")
    with pytest.raises(InputError, match="no rows"):
        dollars_13f(table_13f().iloc[:0], filed="2022-11-14")


def test_cusips_that_a_spreadsheet_made_numbers():
    assert dollars_13f(table_13f(CUSIP=[37833100.0, 594918104.0]), filed="2022-11-14").index.tolist() == [
        "037833100",
        "594918104",
    ]
    for wrong in ([37833100.0, np.nan], ["037833100", "5949 8104"], ["037833100", "5949181040"]):
        with pytest.raises(InputError, match="in row 1 is none: expected nine characters"):
            dollars_13f(table_13f(CUSIP=wrong), filed="2022-11-14")


def filings_13f(folder, filings, issuers=("APPLE INC", "MICROSOFT CORP", "ORACLE")):
    """Filings of one quarter: number, day, type, type of amendment, and dollars of three shares (0: not held)."""
    lines = {"SUBMISSION": ["ACCESSION_NUMBER\tFILING_DATE\tSUBMISSIONTYPE\tCIK\tPERIODOFREPORT"],
             "COVERPAGE": ["ACCESSION_NUMBER\tAMENDMENTTYPE"],
             "INFOTABLE": ["ACCESSION_NUMBER\tNAMEOFISSUER\tCUSIP\tVALUE\tSSHPRNAMT\tSSHPRNAMTTYPE\tPUTCALL"]}  # fmt: skip
    for number, day, kind, amendment, *held in filings:
        lines["SUBMISSION"].append(f"{number}\t{day}\t{kind}\t7\t31-MAR-2024")
        lines["COVERPAGE"].append(f"{number}\t{amendment}")
        for cusip, issuer, value in zip(CUSIPS, issuers, held, strict=True):
            lines["INFOTABLE"] += [f"{number}\t{issuer}\t{cusip}\t{value}\t{value // 100}\tSH\t"] * (value > 0)
    for name, rows in lines.items():
        (folder / f"{name}.tsv").write_text("\n".join(rows) + "\n")
    return read_13f(folder, cik=7, assets=ASSETS, names=dict(zip(CUSIPS, ASSETS, strict=True)))


def test_decimals_are_those_of_the_amounts_and_amendments_of_a_day_are_in_order(tmp_path):
    def decimals(day, *held):
        return filings_13f(tmp_path, [("b", day, "13F-HR", "", *held, 0)]).decimals

    # Of two rows of dollars: errors of at most .5 (1 + 2 · 2/3)/9000.
    assert decimals("14-MAY-2024", 6000, 3000) == 3
    assert decimals("14-MAY-2024", 6_000_000, 3_000_000) == 6
    for name, old, new in (("SUBMISSION", "14-MAY-2024", "14-NOV-2022"), ("INFOTABLE", "000000\t", "000\t")):
        file = tmp_path / f"{name}.tsv"
        file.write_text(file.read_text().replace(old, new))
    thousands = read_13f(tmp_path, cik=7, assets=ASSETS, names=dict(zip(CUSIPS, ASSETS, strict=True)))
    assert thousands.decimals == 3
    held = (("c", 1000, 0), ("a", 0, 1000))
    restated = [(number, "14-MAY-2024", "13F-HR/A", "RESTATEMENT", *values, 0) for number, *values in held]
    filings_13f(tmp_path, [FIRST, *restated])
    cover = tmp_path / "COVERPAGE.tsv"
    head, *rows = cover.read_text().splitlines()
    numbers = {"b": "", "c": "1", "a": "2"}
    cover.write_text("\n".join([f"{head}\tAMENDMENTNO", *(f"{row}\t{numbers[row[0]]}" for row in rows)]))
    last = read_13f(tmp_path, cik=7, assets=ASSETS, names=dict(zip(CUSIPS, ASSETS, strict=True)))
    assert last.frame.to_numpy().tolist() == [[0.0, 1.0, 0.0]]


CUSIPS = ("037833100", "594918104", "68389X105")
FIRST = ("b", "14-MAY-2024", "13F-HR", "", 6000, 3000, 0)


def test_names_of_issuers_have_quotation_marks(tmp_path):
    for issuers in (('"MS" CORP', '"ORACLE', 'B "'), ('"APPLE', "MS", 'ORACLE "A"')):
        found = filings_13f(tmp_path, [("b", "14-MAY-2024", "13F-HR", "", 6000, 3000, 1000)], issuers)
        np.testing.assert_allclose(found.frame.to_numpy(), [[0.6, 0.3, 0.1]])
        assert found.cautions() == []


def test_cusips_are_the_same_without_their_zeros_and_in_small_letters(tmp_path):
    filings_13f(tmp_path, [("b", "14-MAY-2024", "13F-HR", "", 6000, 3000, 1000)])
    names = {"37833100": "Oil", " 594918104": "Food", "68389x105": "Tech"}
    assert read_13f(tmp_path, cik=7, assets=ASSETS, names=names).left_out == 0.0
    with pytest.raises(InputError, match="names has a CUSIP twice"):
        read_13f(tmp_path, cik=7, assets=ASSETS, names={**names, "037833100": "Food"})
    left = read_13f(tmp_path, cik=7, assets=ASSETS, names=dict(list(names.items())[:2]))
    assert left.cautions() == [
        "Note: up to 10.0% of a row's value is left out; the weights are those of the rest, scaled to the sum 1."
    ]


def test_new_holdings_are_added_to_a_filing_that_must_be_there(tmp_path):
    added = ("a", "14-MAY-2024", "13F-HR/A", "NEW HOLDINGS", 0, 0, 1000)  # filed on the same day, with a smaller number
    np.testing.assert_allclose(filings_13f(tmp_path, [FIRST, added]).frame.to_numpy(), [[0.6, 0.3, 0.1]])
    with pytest.raises(
        InputError, match="amendment a adds holdings to a filing of 2024-03-31 that is not in this data"
    ):
        filings_13f(tmp_path, [added])


def test_rows_that_data_sets_share_count_once(tmp_path):
    added = ("c", "14-JUN-2024", "13F-HR/A", "NEW HOLDINGS", 0, 2000, 1000)
    once = filings_13f(tmp_path, [FIRST, added]).frame
    info = tmp_path / "INFOTABLE.tsv"
    first, *rows = info.read_text().splitlines()
    info.write_text("\n".join([f"{first}\tINFOTABLE_SK", *(f"{row}\t{k}" for k, row in enumerate(rows))]))
    names = dict(zip(CUSIPS, ASSETS, strict=True))
    changes = {
        "SUBMISSION": ("14-JUN", "15-JUN"),
        "COVERPAGE": ("NEW HOLDINGS", "RESTATEMENT"),
        "INFOTABLE": ("1000", "9000"),
    }
    for file, (old, new) in changes.items():
        path = tmp_path / f"{file}.tsv"
        text = path.read_text().rstrip("\n").splitlines()
        path.write_text("\n".join(text + text[1:]))
        pd.testing.assert_frame_equal(read_13f(tmp_path, cik=7, assets=ASSETS, names=names).frame, once)
        path.write_text("\n".join([*text, text[-1].replace(old, new)]))
        with pytest.raises(InputError, match=f"{file}.tsv has two rows with ACCESSION_NUMBER c.* that differ"):
            read_13f(tmp_path, cik=7, assets=ASSETS, names=names)
        path.write_text("\n".join(text))


def test_what_the_files_lack_is_named(tmp_path):
    filings_13f(tmp_path, [FIRST])
    names = dict(zip(CUSIPS, ASSETS, strict=True))
    for file, old, new, said in (
        ("COVERPAGE", "b\t", "c\t", "the filing b has no row in COVERPAGE.tsv"),
        ("SUBMISSION", "PERIODOFREPORT", "PERIOD", "has no column PERIODOFREPORT"),
        ("INFOTABLE", "ACCESSION_NUMBER", "NUMBER", "has no column ACCESSION_NUMBER"),
    ):
        path = tmp_path / f"{file}.tsv"
        text = path.read_text()
        path.write_text(text.replace(old, new))
        with pytest.raises(InputError, match=said):
            read_13f(tmp_path, cik=7, assets=ASSETS, names=names)
        path.write_text(text)


def test_quarters_of_a_manager_with_amendments(tmp_path):
    """A restatement replaces, new holdings are added, each in the unit of its own day of filing."""
    filings = [("1", "14-NOV-2022", "13F-HR", ""), ("2", "20-FEB-2023", "13F-HR/A", "RESTATEMENT"),
               ("3", "01-MAR-2023", "13F-HR/A", "NEW HOLDINGS")]  # fmt: skip
    submission = [(a, day, kind, "77", "30-SEP-2022") for a, day, kind, _ in filings]
    pd.DataFrame(
        submission, columns=["ACCESSION_NUMBER", "FILING_DATE", "SUBMISSIONTYPE", "CIK", "PERIODOFREPORT"]
    ).to_csv(tmp_path / "SUBMISSION.tsv", sep="\t", index=False)
    covers = pd.DataFrame([(a, kind) for a, _, _, kind in filings], columns=["ACCESSION_NUMBER", "AMENDMENTTYPE"])
    covers.to_csv(tmp_path / "COVERPAGE.tsv", sep="\t", index=False)
    rows = [("1", "A", 900, 9000), ("2", "A", 300_000, 3000), ("3", "B", 100_000, 2000), ("3", "C", 100_000, 2000)]
    holdings = pd.DataFrame(
        [(a, c.zfill(9), v, s, "SH", "") for a, c, v, s in rows],
        columns=["ACCESSION_NUMBER", "CUSIP", "VALUE", "SSHPRNAMT", "SSHPRNAMTTYPE", "PUTCALL"],
    )
    holdings.to_csv(tmp_path / "INFOTABLE.tsv", sep="\t", index=False)
    names = {"A".zfill(9): "Oil", "B".zfill(9): "Food"}
    found = read_13f(tmp_path, cik=77, assets=ASSETS, names=names)
    np.testing.assert_allclose(found.frame.to_numpy(), [[0.75, 0.25, 0.0]])
    assert found.left_out == pytest.approx(0.2)
    with pytest.raises(InputError, match="CIK 78 filed no holdings"):
        read_13f(tmp_path, cik=78, assets=ASSETS, names=names)
    with pytest.raises(InputError, match="names has 'Gold'"):
        read_13f(tmp_path, cik=77, assets=ASSETS, names={"A": "Gold"})
    covers.assign(AMENDMENTTYPE="").to_csv(tmp_path / "COVERPAGE.tsv", sep="\t", index=False)
    with pytest.raises(InputError, match="says neither RESTATEMENT nor NEW HOLDINGS"):
        read_13f(tmp_path, cik=77, assets=ASSETS, names=names)
