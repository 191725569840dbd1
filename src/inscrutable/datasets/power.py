"""The public 30-bus network with six generators, as embedded data."""

from __future__ import annotations

import json
from importlib.resources import files

import numpy as np

from inscrutable.problems.power_network import PowerNetwork


def load_ieee_30_bus() -> PowerNetwork:
    """Return the IEEE 30-bus test case: 41 lines, six generators, 189.2 MW of load.

    Buses are numbered from 0, one less than in the publication. Provenance: `PROVENANCE.md` beside the data.

    Returns:
        A network for `dispatch_problem`.

    Cost: one small file. Source: Alsac and Stott, Optimal Load Flow with Steady State Security (IEEE Transactions on Power
    Apparatus and Systems 93, 1974); generators: Ferrero, Shahidehpour and Ramesh (IEEE Transactions on Power Systems 12, 1997).

    Example:
        >>> network = load_ieee_30_bus()
        >>> len(network.loads), len(network.line_ends), round(float(network.loads.sum()), 1)
        (30, 41, 189.2)
    """
    data = json.loads(files("inscrutable.datasets").joinpath("case30.json").read_text("utf-8"))
    generators, lines = data["generators"], data["lines"]
    return PowerNetwork(
        np.array(data["load_mw"]),
        np.array([each["bus"] - 1 for each in generators]),
        np.array([each["most_mw"] for each in generators]),
        np.array([each["quadratic_cost"] for each in generators]),
        np.array([each["linear_cost"] for each in generators]),
        np.array([[each["from_bus"] - 1, each["to_bus"] - 1] for each in lines]),
        np.array([[each["reactance"], each["limit_mw"]] for each in lines]),
    )
