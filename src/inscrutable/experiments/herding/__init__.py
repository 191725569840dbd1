"""Agents who decide in turn and see each other's decisions: learning, herding, and what hiding costs the others."""

from inscrutable.experiments.herding.results import HerdStatus, SocialLearning
from inscrutable.experiments.herding.social_learning import social_learning

__all__ = ["HerdStatus", "SocialLearning", "social_learning"]
