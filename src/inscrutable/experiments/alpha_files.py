"""Files that say how a private mean moves."""

from __future__ import annotations

import json
from typing import Any

import pandas as pd
from pydantic import ValidationError

from inscrutable.errors import InputError
from inscrutable.experiments.sections import Matrix, Section, shortened
from inscrutable.files import PathLike, path_of
from inscrutable.worlds import LinearGaussianWorld


class LinearWorldFile(Section):
    """A linear Gaussian world as JSON: matrices row by row, and names of the states in their order."""

    states: list[str] | None = None
    transition: Matrix
    process: Matrix
    sensor: Matrix
    noise: Matrix
    public_sensor: Matrix | None = None
    public_noise: Matrix | None = None


def read_linear_world(path: PathLike) -> LinearGaussianWorld:
    """Read a world from a JSON file with the keys of `LinearGaussianWorld`'s arguments, and `states` for their names.

    What everybody reads is under `public_sensor` and `public_noise`, both or none.

    Raises:
        InputError: With the file and the place in it: a key is missing or unknown, a value is of another kind.
        ModelError: A covariance is indefinite.
    """
    source = path_of(path, "a world")
    try:
        found = LinearWorldFile.model_validate(json.loads(source.read_text("utf-8")))
    except OSError as error:
        raise InputError(f"{source} cannot be read: {error.strerror or error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(f"{source}, {place}: {first['msg']}; got {shortened(first['input'])}") from None
    except ValueError as error:
        raise InputError(f"{source} is no JSON: {error}") from None
    if (found.public_sensor is None) != (found.public_noise is None):
        raise InputError(f"{source}: public_sensor and public_noise go together, and one is missing")
    transition: Any = found.transition
    if found.states is not None:
        names = pd.Index(found.states)
        try:
            transition = pd.DataFrame(found.transition, index=names, columns=names)
        except ValueError as error:
            raise InputError(f"{source}, states: {error}") from None
    public: Any = None if found.public_sensor is None else (found.public_sensor, found.public_noise)
    return LinearGaussianWorld(transition, found.process, found.sensor, found.noise, public=public)
