"""Studies: grids of markets, decision makers, budgets and observers, resumable and distributed."""

from inscrutable.experiments.studies.runner import StudyProgress, resume_study, run_study
from inscrutable.experiments.studies.study import Study, StudyStatus

__all__ = ["Study", "StudyProgress", "StudyStatus", "resume_study", "run_study"]
