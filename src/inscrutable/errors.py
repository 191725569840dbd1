"""The library's own errors, by what the reader can do about them.

===============  ======================================  =========
error            what to do                              exit code
===============  ======================================  =========
``InputError``   correct the data or the argument        3
``DiskError``    make room, or choose another disk; it   3
                 is an ``InputError`` as well
``ModelError``   change the model: it has no answer      4
``SolverError``  report it: a solver failed on valid     1
                 input
===============  ======================================  =========

A message says what was passed, what was expected, the offending number and where it stands.
"""

from __future__ import annotations


class InscrutableError(Exception):
    """Base of all errors raised on purpose by this library."""

    exit_code = 1


class InputError(InscrutableError, ValueError):
    """An argument is malformed: wrong shape, not a number, off the simplex, unreadable file."""

    exit_code = 3


class DiskError(InputError):
    """The arguments are right, but the disk is full, failing or read-only."""


class ModelError(InscrutableError, ValueError):
    """The input is well formed but has no answer: an infeasible or unbounded set, an indefinite covariance."""

    exit_code = 4


class SolverError(InscrutableError, RuntimeError):
    """A numerical method did not reach its stated accuracy on valid input."""

    exit_code = 1
