"""Contract checkers for user-written components: they raise an error where a component breaks a contract of the library."""

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
