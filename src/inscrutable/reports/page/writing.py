"""Write a page: template, style sheet, script and data in one file that loads nothing from the network."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from inscrutable.errors import InputError
from inscrutable.experiments.backtest_results import Backtest
from inscrutable.experiments.comparison import Comparison
from inscrutable.experiments.comparison_study import comparison_of
from inscrutable.experiments.reproduction import Reproduction, ReproductionSettings, reproduction_of
from inscrutable.experiments.studies import Study
from inscrutable.experiments.studies.comparison_tasks import ComparisonFile
from inscrutable.files import PathLike, whole_file
from inscrutable.reports.page.backtest_page import backtest_content
from inscrutable.reports.page.comparison_page import comparison_content
from inscrutable.reports.page.content import PageContent
from inscrutable.reports.page.manifest import manifest_of
from inscrutable.reports.page.reproduction_page import reproduction_content
from inscrutable.reports.page.study_page import study_content

_ENGINE = "jinja2"
_TEMPLATE = "page.html"


def can_write_pages() -> bool:
    """Return whether the extra that pages need is installed."""
    return find_spec(_ENGINE) is not None


def write_page(
    result: Backtest | Comparison | Reproduction | Study,
    path: PathLike,
    *,
    title: str | None = None,
    manifest: Mapping[str, Any] | None = None,
    drawn: PathLike | None = None,
) -> Path:
    """Write a result as one HTML file that works offline: verdict, table, interactive figures, failures, manifest.

    Two sliders, over time and over the budget, control the belief simplex of a step, the frontier, privacy and cost over time,
    and the estimates of both observers. All positions are computed in advance, so no server is needed. A small script in the
    file draws SVG; a content security policy forbids loading anything. Equal results give equal bytes.

    Args:
        result: A backtest, a comparison, a reproduction, or a study after a run. A grid may be unfinished; a study of
            `inscrutable compare` or `reproduce` must be finished.
        path: The file to create or replace; its folder must exist.
        title: The heading; None: a default.
        manifest: More lines for the manifest, such as the seed of a comparison; values are written as text.
        drawn: For a reproduction: the folder of `write_reproduction`'s pictures; None: draw the pictures again.

    Returns:
        The file.

    Raises:
        InputError: The extra is missing, the result has no page, or the file cannot be written.

    Cost: for a backtest of 330 decisions some seconds, and about 2 MB.

    Example:
        >>> import tempfile
        >>> from inscrutable import MarkowitzProblem, uniform_prior
        >>> from inscrutable.experiments.comparison import ComparisonSettings, compare
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> settings = ComparisonSettings(budgets=(0.5,), repeats=(1,), draws=10)
        >>> found = compare(problem, uniform_prior(2, 4), settings, rng=np.random.default_rng(0))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_page(found, folder + "/report.html", manifest={"seed": 0}).read_text("utf-8")[:15]
        '<!DOCTYPE html>'
    """
    _engine()
    more = {key: str(value) for key, value in (manifest or {}).items()}
    if isinstance(result, Backtest):
        return write_content(backtest_content(result, title, more), path)
    if isinstance(result, Comparison):
        return write_content(comparison_content(result, title, more), path)
    if isinstance(result, Reproduction):
        return write_content(reproduction_content(result, title, more, None if drawn is None else Path(drawn)), path)
    if isinstance(result, Study):
        return write_content(content_of(result, title, more), path)
    raise InputError(
        f"there is no page for a {type(result).__name__}; expected a Backtest, a Comparison, a Reproduction or a Study"
    )


def write_content(content: PageContent, path: PathLike) -> Path:
    """Write the content of a page as one HTML file and return its path; arguments and errors as `write_page`."""
    page = _page(content)
    with whole_file(path) as temporary:
        temporary.write_bytes(page.encode("utf-8"))
    return Path(path)


def _page(content: PageContent) -> str:
    jinja2, markup = _engine()
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["as_source"] = _as_source
    environment.filters["clauses"] = _BETWEEN_CLAUSES.split
    style = _asset("page.css")
    script = "".join(_asset(name) for name in ("charts.js", content.script)) if content.script else ""
    # Texts of this package and HTML-free JSON stay unescaped; the template escapes everything else.
    asis = {
        "style": style,
        "script": script,
        "data": embedded(content.data),
        "positions": embedded({each.name: each.texts for each in content.sliders}),
    }
    return str(
        environment.from_string(_asset(_TEMPLATE)).render(
            content=content,
            style_hash=_hash(style),
            script_hash=_hash(script),
            **{name: markup(text) for name, text in asis.items()},
        )
    )


def _engine() -> tuple[Any, Any]:
    try:
        import jinja2
        from markupsafe import Markup
    except ImportError:
        raise InputError("a page needs Jinja2, which is not installed: pip install 'inscrutable[report]'") from None
    return jinja2, Markup


def _asset(name: str) -> str:
    return files("inscrutable.reports.page").joinpath("assets", name).read_text("utf-8")


_BETWEEN_CLAUSES = re.compile(r"; (?![^(]*\))")  # not within brackets


def _as_source(svg: str) -> str:
    """Return a picture as a data URL; a browser runs no script in it and follows no link."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode("utf-8")).decode("ascii")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")


def embedded(data: Any) -> str:
    """Return data as JSON for a script element, without `<`, `>` or `&`.

    Args:
        data: Numbers, text, lists, mappings, NumPy scalars and arrays; NaN and infinities become null.

    Example:
        >>> embedded({"a": "</script>", "b": float("nan")})
        '{"a":"\\\\u003c/script\\\\u003e","b":null}'
    """
    text = json.dumps(_finite(data), separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


def _finite(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return int(value) if value.is_integer() else value
    if isinstance(value, Mapping):
        return {str(key): _finite(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(each) for each in value]
    return value


def content_of(study: Study, title: str | None, manifest: Mapping[str, str]) -> PageContent:
    """Return the content of a study's page; `manifest` has further lines for the page's manifest.

    Raises:
        InputError: The study was not run; or it is not a grid and not finished.
    """
    if isinstance(study.plan, ComparisonFile):
        comparison, note = comparison_of(study)
        return _with_facts(comparison_content(comparison, title, {"market": note, **manifest}), study)
    if isinstance(study.plan, ReproductionSettings):
        return _with_facts(reproduction_content(reproduction_of(study), title, manifest), study)
    return study_content(study, title, manifest)


def _with_facts(content: PageContent, study: Study) -> PageContent:
    """Return the content with the versions that made the rows, not the current ones, and all the study's keys."""
    own = {key: value for key, value in content.manifest.items() if not key.startswith("version of ")}
    return replace(content, manifest={**manifest_of(study), **own})
