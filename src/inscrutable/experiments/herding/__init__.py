"""Agents who decide in turn and see each other's decisions: learning, herding, and what hiding costs the others."""

from inscrutable.experiments.herding.results import HerdStatus, SocialLearning
from inscrutable.experiments.herding.social_learning import social_learning
from inscrutable.experiments.herding.table import HerdingTable, herding_table

__all__ = ["HerdStatus", "HerdingTable", "SocialLearning", "herding_table", "social_learning"]
