"""Step 1, the world: hidden Markov models, their sensors, sampling and fitting; linear Gaussian worlds and their filter."""

from inscrutable.worlds.emissions import CategoricalEmission, Emission, GaussianEmission
from inscrutable.worlds.gaussian_fit import FittedWorld, Restart, fit_gaussian_hmm
from inscrutable.worlds.hidden_markov import HiddenMarkovModel, Trajectory
from inscrutable.worlds.kalman import KalmanResult, SteadyFilter, kalman_filter, steady_filter
from inscrutable.worlds.linear_gaussian import LinearGaussianWorld
from inscrutable.worlds.public import PublicPart

__all__ = [
    "CategoricalEmission",
    "Emission",
    "FittedWorld",
    "GaussianEmission",
    "HiddenMarkovModel",
    "KalmanResult",
    "LinearGaussianWorld",
    "PublicPart",
    "Restart",
    "SteadyFilter",
    "Trajectory",
    "fit_gaussian_hmm",
    "kalman_filter",
    "steady_filter",
]
