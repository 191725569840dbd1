"""Networks from MATPOWER cases, and from tables of other packages in the same layout."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from pandas import Series

from inscrutable import tolerances
from inscrutable.axes import few
from inscrutable.datasets._matlab import CaseTable, read_case
from inscrutable.errors import InputError, ModelError
from inscrutable.files import PathLike
from inscrutable.problems.power_network import PowerNetwork
from inscrutable.validation import Array

Convention = Literal["powermodels", "matpower"]
"""The linear approximation of lines: that of PowerModels.jl or that of MATPOWER."""

_NEEDED = {"version": 1, "baseMVA": 1, "bus": 5, "gen": 10, "branch": 11, "gencost": 5, "dcline": 3}
_UNSUPPORTED = ("A", "l", "u", "N", "H", "Cw", "fparm", "reserves", "softlims", "if", "iflims")
"""Parts of a case that this dispatch problem does not support."""
_ISOLATED = 4
_PIECES, _POLYNOMIAL = 1, 2
_WIDEST = np.radians(60.0)
"""Default limit of angle differences in PowerModels.jl, where a case has none, or 90 degrees and more."""
_RIGHT_ANGLE, _FULL_TURN = 90.0, 360.0


def load_matpower(path: PathLike, *, convention: Convention = "powermodels") -> PowerNetwork:
    """Return the network of a MATPOWER case file, version 2.

    Formula: the flow of a line is linear in the bus angles θ, by convention:

    - "powermodels": b (θ_f − θ_t), b = x/(r² + x²). Taps and shifts are ignored; a line without reactance has no flow; angles
      differ by at most 60° where the case has no limit, or one of 90° and more. Parallel transformers of opposite orientation
      get the orientation of the last one; r and x of a reversed one are multiplied by its squared tap.
    - "matpower": (θ_f − θ_t − φ)/(x·tap). Angles are limited only where the case has limits: −360° and below, and 360° and
      above, are none.

    Elements out of service and isolated buses are left out. Shunt conductances Gs are loads. A limit of 0 MW or Inf is none,
    and so are two angle limits of 0; one of 0 beside another is a limit.
    Labels of buses are the case's numbers. A generator with piecewise linear costs becomes one unit per piece at the same bus.

    Args:
        path: The file, as `savecase` writes it: numbers only. Code in it raises an error and is not run.
        convention: "powermodels" or "matpower".

    Returns:
        A network for `dispatch_problem`.

    Raises:
        InputError: The file cannot be read, or contains code, DC lines in service or user-defined constraints, or a table is
            malformed; the message names the line.
        ModelError: A cost is not convex, or of a degree above two.

    Cost: O(size of the file). Source: MATPOWER's manual, appendix B and section 6.2; Coffrin et al., PowerModels.jl (Power
    Systems Computation Conference 2018).

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from inscrutable import dispatch_problem
        >>> case = '''function mpc = two
        ... mpc.version = '2';
        ... mpc.baseMVA = 100;
        ... mpc.bus = [1 3 0 0 0; 7 1 50 0 0];
        ... mpc.gen = [1 0 0 0 0 1 100 1 80 10; 7 0 0 0 0 1 100 1 40 0];
        ... mpc.gencost = [2 0 0 3 0.02 1 5; 2 0 0 3 0.01 2 5];
        ... mpc.branch = [1 7 0 0.1 0 30 0 0 0 0 1 0 0];
        ... '''
        >>> with TemporaryDirectory() as folder:
        ...     _ = (Path(folder) / "two.m").write_text(case)
        ...     network = load_matpower(Path(folder) / "two.m")
        >>> print(network)
        2 buses, 1 lines, 2 generators of 10 to 120 MW, a load of 50 MW
        >>> print(dispatch_problem(network).solve([1.0]))
        [30. 20.]
    """
    checked_convention(convention)
    tables, others = read_case(path, _NEEDED)
    refused = sorted(others & set(_UNSUPPORTED))
    if refused:
        raise InputError(f"{path} has {few(refused)}: constraints and costs of a user's own are not read")
    missing = [name for name in ("baseMVA", "bus", "gen", "branch", "gencost") if name not in tables]
    if missing:
        raise InputError(
            f"{path} has no {few(missing)}; expected a MATPOWER case of version 2 with mpc.{missing[0]} = ..."
        )
    version = tables.get("version")
    if version is not None and version.values[:1, :1].tolist() != [[2.0]]:
        raise InputError(f"{path} is a case of another version than 2; MATPOWER's savecase writes version 2")
    lines = tables.get("dcline")
    if lines is not None and (lines.values[:, 2] > 0).any():
        raise InputError(
            f"{path}, line {lines.lines[0]}: dcline has lines of direct current in service, which are not read"
        )
    return CaseTables(str(path), tables).network(convention)


def checked_convention(convention: str) -> None:
    """Raise `InputError` for an unknown convention."""
    if convention not in get_args(Convention):
        raise InputError(f"convention must be one of {few(get_args(Convention))}, got {convention!r}")


@dataclass(frozen=True)
class CaseTables:
    """The tables baseMVA, bus, gen, branch and gencost in MATPOWER's layout.

    Args:
        source: Name of the source in messages.
        tables: The tables by name.
    """

    source: str
    tables: dict[str, CaseTable]

    def network(self, convention: Convention) -> PowerNetwork:
        """Return the network, or raise the error of a row with its line."""
        base = self._base()
        labels, loads = self._buses()
        generators = self._in_service("gen", 7, (0,), labels)
        branches = self._in_service("branch", 10, (0, 1), labels)
        units = np.array([unit for row in generators for unit in self._units(row)]).reshape(-1, 6)
        ends, data = self._lines(branches, convention, base)
        try:
            return PowerNetwork(
                Series(loads, index=labels),
                units[:, 0].astype(np.int64),
                units[:, 1:3],
                units[:, 3],
                units[:, 4:],
                ends,
                data,
            )
        except InputError as error:
            raise InputError(f"{self.source}: {error}") from None

    def _at(self, name: str, row: int) -> str:
        """Return the place of a row, for messages."""
        lines = self.tables[name].lines
        return f"{self.source}, line {lines[row]}" if lines else f"{self.source}, {name} row {row}"

    def _base(self) -> float:
        values = self.tables["baseMVA"].values
        if values.shape != (1, 1) or not np.isfinite(values).all() or values[0, 0] <= 0:
            raise InputError(f"{self.source}: baseMVA must be one number above 0, MVA")
        return float(values[0, 0])

    def _buses(self) -> tuple[list[int], Array]:
        """Labels and loads of the buses that are not isolated."""
        bus = self.tables["bus"].values
        if not len(bus):
            raise InputError(f"{self.source}: bus has no rows")
        self._check_numbers("bus", range(len(bus)), (0, 1, 2, 4))
        seen: set[float] = set()
        for row, label in enumerate(bus[:, 0]):
            if label != round(label) or label in seen:
                what = "stands twice" if label in seen else "is no whole number"
                raise InputError(f"{self._at('bus', row)}: the bus {label:g} {what}")
            seen.add(label)
        kept = bus[bus[:, 1] != _ISOLATED]
        if not len(kept):
            raise InputError(f"{self.source}: every bus is isolated (type {_ISOLATED})")
        return [int(label) for label in kept[:, 0]], kept[:, 2] + kept[:, 4]

    def _in_service(self, name: str, status: int, ends: tuple[int, ...], labels: list[int]) -> list[int]:
        """Return the indices of rows that are in service and at no isolated bus."""
        values = self.tables[name].values
        isolated = {row[0] for row in self.tables["bus"].values if row[1] == _ISOLATED}
        known = set(labels)
        kept = []
        for row in map(int, np.flatnonzero(~(values[:, status] <= 0))):
            if np.isnan(values[row, status]):
                raise InputError(f"{self._at(name, row)}: the status of a {name} is NaN; expected 0 or 1")
            unknown = [values[row, end] for end in ends if values[row, end] not in known | isolated]
            if unknown:
                raise InputError(
                    f"{self._at(name, row)}: a {name} is at bus {unknown[0]:g}, which is not in the table bus"
                )
            if not any(values[row, end] in isolated for end in ends):
                kept.append(row)
        return kept

    def _check_numbers(self, name: str, rows: range | list[int], columns: tuple[int, ...]) -> None:
        values = self.tables[name].values[list(rows)][:, list(columns)]
        bad = np.argwhere(~np.isfinite(values))
        if bad.size:
            row, column = bad[0]
            raise InputError(
                f"{self._at(name, list(rows)[row])}: column {columns[column] + 1} of {name} is {values[row, column]}; "
                "expected a number"
            )

    def _units(self, row: int) -> list[tuple[float, ...]]:
        """Return a generator, or its blocks: bus, minimum and maximum output, cost coefficients."""
        self._check_numbers("gen", [row], (8, 9))
        values, costs = self.tables["gen"].values[row], self.tables["gencost"].values
        bus, most, least = int(values[0]), float(values[8]), float(values[9])
        if least > most:
            raise InputError(f"{self._at('gen', row)}: Pmin {least:g} MW is above Pmax {most:g} MW")
        if len(costs) not in (len(self.tables["gen"].values), 2 * len(self.tables["gen"].values)):
            raise InputError(
                f"{self.source}: gencost has {len(costs)} rows, expected one per generator: {len(self.tables['gen'].values)}"
            )
        kind, size = costs[row, 0], costs[row, 3]
        width = size * (2 if kind == _PIECES else 1)
        if kind not in (_PIECES, _POLYNOMIAL) or size != round(size) or not size > 0 or 4 + width > costs.shape[1]:
            raise InputError(
                f"{self._at('gencost', row)}: the cost has model {kind:g} and {size:g} numbers; expected model 1 (points) or 2 "
                f"(coefficients) and numbers that the {costs.shape[1]} columns hold"
            )
        given = costs[row, 4 : 4 + int(width)]
        if not np.isfinite(given).all():
            raise InputError(f"{self._at('gencost', row)}: a cost is no finite number")
        if kind == _POLYNOMIAL:
            high, (a, b, c) = given[:-3], np.concatenate([np.zeros(3), given])[-3:]
            if high.any() or a < 0:
                what = "of a degree above two" if high.any() else f"not convex: {a:g} per MW²"
                raise ModelError(f"{self._at('gencost', row)}: the cost is {what}; expected a convex quadratic")
            return [(bus, least, most, float(a), float(b), float(c))]
        return self._blocks(row, (bus, least, most), given.reshape(-1, 2))

    def _blocks(self, row: int, unit: tuple[int, float, float], points: Array) -> list[tuple[float, ...]]:
        """Return a generator with piecewise linear costs as blocks: minimum output plus first piece, then other pieces."""
        bus, least, most = unit
        if len(points) < 2 or (np.diff(points[:, 0]) <= 0).any():
            raise InputError(
                f"{self._at('gencost', row)}: the points of a cost must be two or more with outputs that rise"
            )
        slopes = np.diff(points[:, 1]) / np.diff(points[:, 0])
        if (np.diff(slopes) < -tolerances.SYMMETRY * np.abs(slopes).max()).any():
            raise ModelError(f"{self._at('gencost', row)}: the cost is not convex: its slopes are {few(slopes)} per MW")
        inner = np.clip(points[1:-1, 0], least, most)
        starts, ends = np.concatenate([[least], inner]), np.concatenate([inner, [most]])
        kept = np.flatnonzero(ends > starts)
        first = int(kept[0]) if kept.size else int(np.searchsorted(points[1:-1, 0], least))
        cost = points[first, 1] - slopes[first] * points[first, 0]
        found: list[tuple[float, ...]] = [
            (bus, least, float(ends[first]) if kept.size else most, 0.0, float(slopes[first]), float(cost))
        ]
        return found + [(bus, 0.0, float(ends[k] - starts[k]), 0.0, float(slopes[k]), 0.0) for k in kept[1:]]

    def _lines(self, rows: list[int], convention: Convention, base: float) -> tuple[np.ndarray, Array]:
        """Return ends (L,2), and reactance, minimum and maximum flow and shift flow (L,4)."""
        values = self.tables["branch"].values
        said = (2, 3, 8, 9) if values.shape[1] < 13 else (2, 3, 8, 9, 11, 12)
        self._check_numbers("branch", rows, said)
        angles = np.zeros((len(values), 2)) if values.shape[1] < 13 else values[:, 11:13]
        pointing = {
            frozenset(values[row, :2]): values[row, 0] for row in rows
        }  # start bus of the last of parallel ones
        ends, data = [], []
        for row in rows:
            start, end, r, x, rate, tap, shift = values[row, [0, 1, 2, 3, 5, 8, 9]]
            if not rate >= 0 or start == end:
                what = f"a limit of {rate:g} MW" if not rate >= 0 else f"bus {start:g} at both ends"
                raise InputError(f"{self._at('branch', row)}: a branch has {what}")
            low, high = angles[row]
            if low > high:
                raise InputError(
                    f"{self._at('branch', row)}: the angle limits of a branch, {low:g} and {high:g} degrees, exclude each other"
                )
            if x == 0 and (r == 0 or convention == "matpower"):
                raise InputError(f"{self._at('branch', row)}: a branch has no reactance; expected one that is not 0")
            if x == 0:
                continue
            if convention == "powermodels" and tap and start != pointing[frozenset((start, end))]:
                r, x = r * tap**2, x * tap**2
            ends.append((int(start), int(end)))
            data.append(_line((r, x, rate, tap or 1.0, shift), angles[row], convention, base))
            if data[-1][1] > data[-1][2]:
                raise InputError(
                    f"{self._at('branch', row)}: no flow of the branch keeps its limit of {rate:g} MW and its angle limits, "
                    f"{low:g} and {high:g} degrees, at a phase shift of {shift:g} degrees"
                )
        return np.array(ends, dtype=np.int64).reshape(-1, 2), np.array(data).reshape(-1, 4)


def _line(values: tuple[float, ...], degrees: Array, convention: Convention, base: float) -> tuple[float, ...]:
    """Return reactance, minimum and maximum flow, and shift flow of one line."""
    r, x, rate, tap, shift = values
    least, most = np.radians(degrees)
    if convention == "powermodels":
        reactance, turned, widest, turn = (r * r + x * x) / x, 0.0, _WIDEST, _RIGHT_ANGLE
    else:
        reactance, turned, widest, turn = x * tap, float(np.radians(shift)), np.inf, _FULL_TURN
    unsaid = not degrees.any()
    least = -widest if unsaid or degrees[0] <= -turn else least
    most = widest if unsaid or degrees[1] >= turn else most
    flows = sorted(base * (side - turned) / reactance for side in (least, most))
    limit = rate if rate > 0 else np.inf
    return reactance, max(flows[0], -limit), min(flows[1], limit), -base * turned / reactance
