"""When decisions are disclosed: schedules, and the regulators' rules behind named disclosures."""

from __future__ import annotations

from collections.abc import Mapping
from math import gcd
from typing import NamedTuple


class Schedule(NamedTuple):
    """The steps s whose decision u_s is disclosed, s = offset (mod period), and the step of disclosure, s + lag."""

    period: int = 1
    offset: int = 0
    lag: int = 0

    def shows(self, step: int) -> bool:
        """Whether the decision of a step is ever shown."""
        return step % self.period == self.offset

    @property
    def is_immediate(self) -> bool:
        """Whether every decision is shown at its own step."""
        return self.period == 1 and self.lag == 0

    def moved(self, steps: int) -> Schedule:
        """Return the schedule delayed by a number of steps."""
        return self._replace(lag=self.lag + steps)

    def thinned(self, period: int, offset: int) -> Schedule | None:
        """Return the schedule restricted to steps = offset (mod period); None where no step is left."""
        asked = (offset - self.lag) % period
        shared = gcd(self.period, period)
        if (asked - self.offset) % shared:
            return None
        whole = self.period * period // shared
        first = next(s for s in range(self.offset, whole, self.period) if s % period == asked)
        return Schedule(whole, first, self.lag)


class Calendar(NamedTuple):
    """A regulator's rule behind a named disclosure: its content, as of which date, and its source."""

    rule: str
    as_of: str
    source: str


CALENDARS: Mapping[str, Calendar] = {
    "form_13f": Calendar(
        "Form 13F: long positions in listed securities at the end of a quarter, due within 45 days.",
        "February 2026",
        "17 CFR 240.13f-1(a)(1); checked against a copy of the rule.",
    ),
    "n_port": Calendar(
        "Form N-PORT: holdings at the end of a fiscal quarter, public 60 days later.",
        "February 2026",
        "17 CFR 270.30b1-9, 84 FR 7980; checked against the regulator's announcements. Monthly publication (89 FR 73764) is "
        "postponed to November 2027.",
    ),
}
"""The rules behind the named disclosures."""
