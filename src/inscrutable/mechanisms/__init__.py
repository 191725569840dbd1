"""What a decision maker amounts to, as plain data: which decision it plays how often under which belief."""

from inscrutable.mechanisms.played import Mechanism, mechanism
from inscrutable.mechanisms.priors import Prior, stationary_prior, uniform_prior
from inscrutable.mechanisms.reachable import reachable_beliefs

__all__ = ["Mechanism", "Prior", "mechanism", "reachable_beliefs", "stationary_prior", "uniform_prior"]
