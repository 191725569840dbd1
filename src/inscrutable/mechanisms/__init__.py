"""What a decision maker amounts to, as plain data: which decision it plays how often under which belief."""

from inscrutable.mechanisms.played import Mechanism, mechanism
from inscrutable.mechanisms.priors import Prior, stationary_prior, uniform_prior

__all__ = ["Mechanism", "Prior", "mechanism", "stationary_prior", "uniform_prior"]
