"""Social learning: agents who decide in turn and see each other's decisions, herding, and the cost of hiding to others."""

from inscrutable.experiments.herding.results import HerdStatus, SocialLearning
from inscrutable.experiments.herding.table import HerdingTable, herding_table
from inscrutable.experiments.herding.turns import social_learning

__all__ = ["HerdStatus", "HerdingTable", "SocialLearning", "herding_table", "social_learning"]
