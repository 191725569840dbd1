"""Contract checkers for parts that a user writes: silent where they keep the promises that the library relies on."""

from inscrutable.testing.adversaries import check_adversary
from inscrutable.testing.decision_makers import check_decision_maker
from inscrutable.testing.emissions import check_emission
from inscrutable.testing.measures import check_privacy_measure
from inscrutable.testing.problems import check_decision_problem

__all__ = [
    "check_adversary",
    "check_decision_maker",
    "check_decision_problem",
    "check_emission",
    "check_privacy_measure",
]
