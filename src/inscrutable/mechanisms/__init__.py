"""Decision makers as plain data: the probability of each decision under each belief."""

from inscrutable.mechanisms.disclosures import (
    Disclosure,
    at_least,
    bus_prices,
    delayed,
    every,
    form_13f,
    grouped,
    long_only,
    n_port,
    only,
    portfolio_return,
    rounded,
    top,
)
from inscrutable.mechanisms.memory import MechanismRule, MemoryMechanism
from inscrutable.mechanisms.played import Mechanism, mechanism
from inscrutable.mechanisms.priors import Prior, filtered_prior, predicted_prior, stationary_prior, uniform_prior
from inscrutable.mechanisms.reachable import reachable_beliefs

__all__ = [
    "Disclosure",
    "Mechanism",
    "MechanismRule",
    "MemoryMechanism",
    "Prior",
    "at_least",
    "bus_prices",
    "delayed",
    "every",
    "filtered_prior",
    "form_13f",
    "grouped",
    "long_only",
    "mechanism",
    "n_port",
    "only",
    "portfolio_return",
    "predicted_prior",
    "reachable_beliefs",
    "rounded",
    "stationary_prior",
    "top",
    "uniform_prior",
]
