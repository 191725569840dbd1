"""How decisions come about."""

from __future__ import annotations

from enum import Enum

from inscrutable.saved import saved_choice


@saved_choice
class DecisionStatus(Enum):
    """How a decision came about; the text says what to do about it.

    Example:
        >>> DecisionStatus.OPTIMAL.value
        'optimal: the decision of least cost'
    """

    OPTIMAL = "optimal: the decision of least cost"
    POLISHED = "best candidate, polished by a local search: no proof that nothing better exists"
    PROVED = "proved: no affordable decision is more private"
    GAP_REACHED = "proved within the gap asked for: a smaller gap, or a finer search, may find a little more"
    BOUNDED = (
        "best bound after the limit of oracle calls, or where only less than min_slack of something mixed in would reach it: "
        "allow more calls or a smaller min_slack, or play on with the bound as it stands"
    )
    BEST_CANDIDATE = "best of the candidates: more of them may find better"
    LOCAL_OPTIMUM = "local optimum of a local search: more starts may find better"
    NO_AFFORDABLE_PRIVACY = (
        "nothing affordable reaches the goal, so the optimal is played: raise the budget; cheapest_privacy says how far"
    )
    NO_PLAUSIBLE_START = "no affordable start that a belief explains was found: use the global search"
    DRAWN = "drawn from a lottery: what is proved of the lottery is not proved of one decision"
    RULE_OF_THUMB = "a rule of thumb: nothing was searched, so the privacy is whatever the rule leaves"
    UNBOUNDED = (
        "unexplained decisions count as infinitely private and are affordable: the paper's letter has no optimum"
    )


OF_LOTTERIES = (DecisionStatus.PROVED, DecisionStatus.GAP_REACHED, DecisionStatus.BOUNDED)
"""What is proved of a lottery is not proved of one decision drawn from it."""
