"""Inner loops: arrays in, arrays out, nothing checked. Only this package imports Numba, and only when a loop is run."""

from inscrutable.kernels.compiling import listen
from inscrutable.kernels.stamp import forget_other_sources

forget_other_sources()
listen()
