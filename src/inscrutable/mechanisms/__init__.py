"""What a decision maker amounts to, as plain data: which decision it plays how often under which belief."""

from inscrutable.mechanisms.memory import MechanismRule, MemoryMechanism
from inscrutable.mechanisms.played import Mechanism, mechanism
from inscrutable.mechanisms.priors import Prior, filtered_prior, predicted_prior, stationary_prior, uniform_prior
from inscrutable.mechanisms.reachable import reachable_beliefs

__all__ = [
    "Mechanism",
    "MechanismRule",
    "MemoryMechanism",
    "Prior",
    "filtered_prior",
    "mechanism",
    "predicted_prior",
    "reachable_beliefs",
    "stationary_prior",
    "uniform_prior",
]
