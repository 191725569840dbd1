"""Agents who decide in turn and see each other's decisions: learning, herding, and the cost of hiding to the others."""

from inscrutable.experiments.herding.results import HerdStatus, SocialLearning
from inscrutable.experiments.herding.table import HerdingTable, herding_table
from inscrutable.experiments.herding.turns import social_learning

__all__ = ["HerdStatus", "HerdingTable", "SocialLearning", "herding_table", "social_learning"]
