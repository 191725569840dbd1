"""Step 5: how well a decision hides the belief behind it."""

from inscrutable.privacy.leaks import Leakage, leakage
from inscrutable.privacy.measures import (
    DesiredObfuscation,
    Infeasibility,
    MaximalObfuscation,
    NonExistence,
    NonUniqueness,
    PrivacyMeasure,
)

__all__ = [
    "DesiredObfuscation",
    "Infeasibility",
    "Leakage",
    "MaximalObfuscation",
    "NonExistence",
    "NonUniqueness",
    "PrivacyMeasure",
    "leakage",
]
