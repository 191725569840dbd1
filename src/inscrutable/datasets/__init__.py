"""Embedded data sets, readers of a user's files with precise errors, and atomic writers."""

from __future__ import annotations

from inscrutable.datasets.daily import load_daily_returns
from inscrutable.datasets.files import output_folder, write_json, write_table
from inscrutable.datasets.french import IndustryReturns, load_industry_returns
from inscrutable.datasets.holdings import read_holdings, read_map
from inscrutable.datasets.records import read_records
from inscrutable.datasets.suspicious import crowded_months, missing_steps, suspicious_entries
from inscrutable.datasets.tables import (
    WeightsTable,
    read_beliefs,
    read_labelled_matrix,
    read_returns,
    read_sectors,
    read_signals,
    read_weights,
    simple_returns,
)
from inscrutable.datasets.thirteen_f import dollars_13f, only_shares, read_13f
from inscrutable.datasets.written import replace_files
from inscrutable.files import whole_file

__all__ = [
    "IndustryReturns",
    "WeightsTable",
    "crowded_months",
    "dollars_13f",
    "load_daily_returns",
    "load_industry_returns",
    "missing_steps",
    "only_shares",
    "output_folder",
    "read_13f",
    "read_beliefs",
    "read_holdings",
    "read_labelled_matrix",
    "read_map",
    "read_records",
    "read_returns",
    "read_sectors",
    "read_signals",
    "read_weights",
    "replace_files",
    "simple_returns",
    "suspicious_entries",
    "whole_file",
    "write_json",
    "write_table",
]
