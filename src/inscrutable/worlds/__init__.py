"""Step 1, the world: hidden Markov models, their sensors, sampling and fitting."""

from inscrutable.worlds.emissions import CategoricalEmission, Emission, GaussianEmission
from inscrutable.worlds.gaussian_fit import FittedWorld, Restart, fit_gaussian_hmm
from inscrutable.worlds.hidden_markov import HiddenMarkovModel, Trajectory
from inscrutable.worlds.public import PublicPart

__all__ = [
    "CategoricalEmission",
    "Emission",
    "FittedWorld",
    "GaussianEmission",
    "HiddenMarkovModel",
    "PublicPart",
    "Restart",
    "Trajectory",
    "fit_gaussian_hmm",
]
