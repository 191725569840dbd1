"""The verb `inscrutable audit`: two files, no model."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from inscrutable.cli_console import Speech, replaced, show_table
from inscrutable.cli_values import AT_LEAST_0, DATA, Out, Seed, Whole, whole_numbers_of, writable_folder


def audit(
    *,
    secrets: Annotated[Path, Parameter(group=DATA)],
    published: Annotated[Path, Parameter(group=DATA)],
    lags: Annotated[str, Parameter(group=DATA, allow_leading_hyphen=True)] = "0",
    embargo: Annotated[Whole | None, Parameter(group=DATA), AT_LEAST_0] = None,
    kind: Annotated[Literal["classes", "numbers"] | None, Parameter(group=DATA)] = None,
    seed: Seed = 0,
    out: Out | None = None,
    speech: Speech = Speech(),  # noqa: B008  # frozen
) -> None:
    """Test whether published decisions depend on secrets, and how much they leak at least, from two files and no model.

    Learners (nearest neighbours, ridge regression, a tree) are trained on past pairs and tested on later ones; they need the
    extra `inscrutable[audit]`. A negative result does not prove that nothing leaks: the output states the size of a leak that
    the test finds with a power of about 80 %.

    Args:
        secrets: CSV of what should stay private, such as signals: dates or labels in the first column, then numbers or classes.
        published: CSV of decisions, such as weights: the same layout. Rows are joined by their dates or labels.
        lags: Rows from a secret to its decision, such as 0,1,2: at lag 1 the decision is one row later. The rows of both files
            count.
        embargo: Rows left out between training and test rows. Default: the length over which the secret is autocorrelated.
        kind: Whether all secrets are classes or numbers. Default: words are classes, and so are whole numbers of at most ten
            values.
        seed: The same seed gives the same numbers.
        out: Folder for the tables, summary.json and the figure; without it the results are only printed.
    """
    import numpy as np

    from inscrutable.datasets import read_records
    from inscrutable.experiments.audit import audit_pairs
    from inscrutable.reports.audit import audit_summary, audit_table, write_audit

    steps = whole_numbers_of(lags, "--lags")
    tables = read_records(secrets), read_records(published)
    folder = None if out is None else writable_folder(out, "audit")
    speech.log(f"{len(tables[0])} rows of secrets, {len(tables[1])} of decisions; learning forward in time")
    found = audit_pairs(*tables, lags=steps, embargo=embargo, kind=kind, rng=np.random.default_rng(seed))
    files = [] if folder is None else replaced(folder, "audit", partial(write_audit, found), speech)
    if speech.json:
        speech.summary(audit_summary(found))
        return
    show_table(audit_table(found), "Error of an observer who has only data: share wrong, or root mean square")
    speech.sentence(found.summary())
    speech.files(files)
