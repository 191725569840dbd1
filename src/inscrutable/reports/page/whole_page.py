"""The page of a study of any kind: a grid's own, or that of the comparison or reproduction which its rows make."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from inscrutable.experiments.comparison_study import comparison_of
from inscrutable.experiments.reproduction import ReproductionSettings, reproduction_of
from inscrutable.experiments.studies import Study
from inscrutable.experiments.studies.comparison_tasks import ComparisonFile
from inscrutable.reports.page.comparison_page import comparison_content
from inscrutable.reports.page.content import PageContent
from inscrutable.reports.page.manifest import manifest_of
from inscrutable.reports.page.reproduction_page import reproduction_content
from inscrutable.reports.page.study_page import study_content


def content_of(study: Study, title: str | None, manifest: Mapping[str, str]) -> PageContent:
    """Return the content of a study's page; `manifest` are further lines of its own.

    Raises:
        InputError: The study was not run; or it is no grid, and not finished.
    """
    if isinstance(study.plan, ComparisonFile):
        comparison, note = comparison_of(study)
        return _with_facts(comparison_content(comparison, title, {"market": note, **manifest}), study)
    if isinstance(study.plan, ReproductionSettings):
        return _with_facts(reproduction_content(reproduction_of(study), title, manifest), study)
    return study_content(study, title, manifest)


def _with_facts(content: PageContent, study: Study) -> PageContent:
    """The content with the versions that the rows were made by, not those that read them, and all the study's keys."""
    own = {key: value for key, value in content.manifest.items() if not key.startswith("version of ")}
    return replace(content, manifest={**manifest_of(study), **own})
