"""Step 5: how well a decision hides the belief behind it."""

from inscrutable.privacy.detection import Detectability, detectability
from inscrutable.privacy.leaks import Leakage, leakage
from inscrutable.privacy.losses import Loss, NamingError, RivalProblem, SquaredError
from inscrutable.privacy.measures import (
    DesiredObfuscation,
    Infeasibility,
    MaximalObfuscation,
    NonExistence,
    NonUniqueness,
    PrivacyMeasure,
)
from inscrutable.privacy.over_time import PathLeakage, path_leakage
from inscrutable.privacy.repeated import RepeatedLeakage, repeated_leakage

__all__ = [
    "DesiredObfuscation",
    "Detectability",
    "Infeasibility",
    "Leakage",
    "Loss",
    "MaximalObfuscation",
    "NamingError",
    "NonExistence",
    "NonUniqueness",
    "PathLeakage",
    "PrivacyMeasure",
    "RepeatedLeakage",
    "RivalProblem",
    "SquaredError",
    "detectability",
    "leakage",
    "path_leakage",
    "repeated_leakage",
]
