"""The worlds and decision problems of a study."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.optimize import brentq
from scipy.special import ndtr

from inscrutable import datasets
from inscrutable.datasets.power import load_ieee_30_bus
from inscrutable.errors import InputError
from inscrutable.experiments.backtest_inputs import BacktestSettings, checked_market
from inscrutable.experiments.backtest_public import PUBLIC_SYMBOLS
from inscrutable.experiments.random_markets import MarketLaw, random_market
from inscrutable.experiments.rivals import weight_limits
from inscrutable.experiments.studies.extensions import Extension
from inscrutable.experiments.studies.layout import FittedWorldSection, GivenWorld
from inscrutable.experiments.studies.own_calls import own_part
from inscrutable.files import reason
from inscrutable.problems import (
    DecisionProblem,
    MarkowitzProblem,
    PowerNetwork,
    dispatch_problem,
)
from inscrutable.validation import Array, real_array
from inscrutable.worlds import GaussianEmission, HiddenMarkovModel, PublicPart, fit_gaussian_hmm

EMBEDDED = "industries"
_EMBEDDED_FILE = "us_industries.csv.bz2"
_EMBEDDED_TRAINING = "1989-12"
_RESTARTS = 30
_FAR = 10.0  # standard deviations beyond which no return lies


class Regimes(NamedTuple):
    """The means (X,D) and covariances (X,D,D) of the regimes, and their world, if it is known."""

    means: Array
    covariances: Array
    world: HiddenMarkovModel | None


def given_world(section: GivenWorld) -> Regimes:
    """Return the regimes that a study gives; raise the library's error for numbers that do not fit."""
    try:
        means, covariances = np.array(section.means), np.array(section.covariances)
    except ValueError:
        raise InputError("the rows of means and covariances must have the same length") from None
    emission = GaussianEmission(means, covariances)
    if section.transition is None:
        return Regimes(emission.means, emission.covariances, None)
    return Regimes(emission.means, emission.covariances, HiddenMarkovModel(section.transition, emission))


def drawn_world(law: dict[str, Any], *, rng: np.random.Generator) -> Regimes:
    """Return regimes drawn from a law."""
    market = random_market(MarketLaw(**{name: value for name, value in law.items() if name != "kind"}), rng=rng)
    return Regimes(market.problem.means, market.problem.covariances, market.world)


def data_file(section: FittedWorldSection, folder: Path) -> Path | None:
    """Return the file of a study's returns; None for the embedded ones."""
    return None if section.data == EMBEDDED else folder / section.data


def hash_of_network(name: str, folder: Path) -> str:
    """Return the SHA-256 of a network's file, or raise `InputError`."""
    try:
        return hashlib.sha256((folder / name).read_bytes()).hexdigest()
    except (OSError, ValueError) as error:
        why = reason(error) if isinstance(error, OSError) else error
        raise InputError(
            f"the network {folder / name} cannot be read: {why}; expected a MATPOWER case, its place relative to the study file"
        ) from None


def plain_network(network: PowerNetwork) -> dict[str, Any]:
    """Return a network as plain data, which `network_of` reads."""
    values = {each.name: np.asarray(getattr(network, each.name)).tolist() for each in fields(network)}
    return values | {
        "loads": [[label, load] for label, load in zip(network.bus_labels, network.demand.tolist(), strict=True)]
    }


def network_of(data: Mapping[str, Any]) -> PowerNetwork:
    """Return the network of plain data."""
    loads = pd.Series(dict(data["loads"]))
    arrays = {name: value for name, value in data.items() if name != "loads"}
    if not data["line_ends"]:  # an empty list has lost its width
        arrays |= {"line_ends": np.zeros((0, 2), dtype=np.int64), "line_data": np.zeros((0, 4))}
    return PowerNetwork(loads=loads, **arrays)


def hash_of_data(section: FittedWorldSection, folder: Path) -> str:
    """Return the SHA-256 of the returns' file, or raise `InputError`."""
    path = data_file(section, folder)
    try:
        content = (
            resources.files("inscrutable.datasets").joinpath(_EMBEDDED_FILE).read_bytes()
            if path is None
            else path.read_bytes()
        )
    except (OSError, ValueError) as error:
        why = reason(error) if isinstance(error, OSError) else error
        raise InputError(
            f'the returns {path} cannot be read: {why}; expected "{EMBEDDED}" or a CSV file, its place '
            "relative to the study file"
        ) from None
    return hashlib.sha256(content).hexdigest()


def fitted_world(
    section: FittedWorldSection, chosen: Mapping[str, Any], folder: Path, *, rng: np.random.Generator
) -> dict[str, Any]:
    """Return a world fitted to returns as plain data, as `HiddenMarkovModel.to_dict` gives it."""
    restarts = _RESTARTS if section.restarts is None else section.restarts
    regimes, covariance = chosen["regimes"], chosen.get("covariance")
    training = training_of(section, regimes, covariance, folder)
    return fit_gaussian_hmm(training, regimes, rng=rng, n_restarts=restarts, covariance=covariance).world.to_dict()


def training_of(section: FittedWorldSection, regimes: int, covariance: str | None, folder: Path) -> pd.DataFrame:
    """Return the returns that a world is fitted to; raise an error if they or their last date are wrong."""
    path = data_file(section, folder)
    if path is None:
        if section.prices:
            raise InputError(f'prices = true is for a CSV file of prices; "{EMBEDDED}" holds returns')
        table, middle = datasets.load_industry_returns().returns, _EMBEDDED_TRAINING
    else:
        table = datasets.read_returns(path, prices=section.prices)
        middle = f"{table.index[(len(table) - 1) // 2]:%Y-%m-%d}"
    settings = BacktestSettings(regimes, train_until=section.train_until or middle, covariance=covariance)
    return checked_market(table, settings, None).training


def regimes_of(world: HiddenMarkovModel) -> Regimes:
    """Return the regimes of a fitted world."""
    emission = world.emission
    assert isinstance(emission, GaussianEmission)
    return Regimes(emission.means, emission.covariances, world)


def with_public(world: HiddenMarkovModel, public: str | int) -> tuple[HiddenMarkovModel, Array]:
    """Return a world with a public return, the assets' mean one or that of one asset by its number, and its quantiles.

    Raises:
        InputError: The world has no such returns.
    """
    emission = world.emission
    if not isinstance(emission, GaussianEmission):
        raise InputError(f"public = {public!r} needs a world of Gaussian returns, got {emission!r}")
    count = emission.means.shape[1]
    if isinstance(public, int) and public >= count:
        raise InputError(f"public = {public} is no asset: they are numbered from 0 to {count - 1}")
    weights = np.eye(count)[public] if isinstance(public, int) else np.full(count, 1.0 / count)
    read = HiddenMarkovModel(world.transition, emission, world.initial, public=PublicPart(weights[None]))
    return read, _quantiles(world, emission, weights)


def _quantiles(world: HiddenMarkovModel, emission: GaussianEmission, weights: Array) -> Array:
    """Return the cuts of a return of law Σ_x p_x N(w'μ_x, w'Σ_x w) into `PUBLIC_SYMBOLS` equally likely symbols."""
    centres = emission.means @ weights
    spreads = np.sqrt(np.einsum("xij,i,j->x", emission.covariances, weights, weights))
    law = HiddenMarkovModel(world.transition, emission).initial  # the long-run one
    low, high = (centres - _FAR * spreads).min(), (centres + _FAR * spreads).max()
    shares = np.arange(1, PUBLIC_SYMBOLS) / PUBLIC_SYMBOLS
    return np.array([brentq(lambda z, s=s: law @ ndtr((z - centres) / spreads) - s, low, high) for s in shares])


def own_world(extension: Extension, chosen: Mapping[str, Any]) -> Regimes:
    """Return the regimes of a user-defined observation model; its means and covariances, if any."""
    emission = own_part(extension, {}, chosen)
    world = HiddenMarkovModel(chosen["transition"], emission)
    nothing = np.zeros((world.n_states, 0))
    means = getattr(emission, "means", nothing)
    covariances = getattr(emission, "covariances", nothing[:, :, None])
    said = f"{extension.spec}:"
    return Regimes(real_array(means, f"{said} means"), real_array(covariances, f"{said} covariances"), world)


def own_problem(extension: Extension, chosen: Mapping[str, Any], regimes: Regimes) -> DecisionProblem:
    """Return a user-defined decision problem."""
    found: DecisionProblem = own_part(extension, {"means": regimes.means, "covariances": regimes.covariances}, chosen)
    return found


def problem_of(section: dict[str, Any], regimes: Regimes, network: PowerNetwork | None = None) -> DecisionProblem:
    """Return the decision problem in given regimes, on the network that the file names, if any."""
    if not regimes.means.shape[1]:
        raise InputError(
            f"a problem of kind {section['kind']} takes the means and covariances of the observations, and this observation "
            "model has neither: give it `means` and `covariances`, or name a problem of your own"
        )
    if section["kind"] == "dispatch":
        deviations = np.sqrt(np.diagonal(regimes.covariances, axis1=1, axis2=2))
        return dispatch_problem(
            load_ieee_30_bus() if network is None else network,
            section["wind_buses"],
            regimes.means,
            deviations,
            wind_capacities=section.get("wind_capacities"),
            penalty=section["penalty"],
        )
    limits = weight_limits(section, regimes.means.shape[1])
    return MarkowitzProblem(regimes.means, regimes.covariances, section["risk_aversion"], limits)
