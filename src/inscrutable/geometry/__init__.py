"""Geometry: grids on the simplex, cones of multipliers, and sets of beliefs."""

from inscrutable.geometry.belief_set import BeliefSet
from inscrutable.geometry.grids import simplex_grid

__all__ = ["BeliefSet", "simplex_grid"]
