"""The pairs of stations as rows of one table: what became of each, how well it fits, how strong it is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from schemas.results.network import Network, NetworkLink
from schemas.results.registration_result import Pair
from service.names.messages.catalogue import Messages
from service.use_cases.reports.setups_drawing import CARRYING, LINK_STYLES, SetupLink

MOST_LINKS = 200
"""Rows of the table; pairs that carry something come first."""
OFTEN = 5.0
"""From so many times the standard deviation on, the rms beside it is explained."""


@dataclass(frozen=True, slots=True)
class LinkRow:
    """One pair of stations."""

    target: str
    source: str
    state: str
    """What became of it, a key of `LINK_STYLES`."""
    reason: str | None
    """Why it carries nothing, as the computation says."""
    overlap: float | None
    rms_m: float | None
    """Of the surfaces, point to plane."""
    sigma0: float | None
    stds_m: tuple[float | None, float | None, float | None]
    """Of the shift where the features lie, along x, y and z of the target."""
    turn_gon: float | None
    """Largest standard deviation of an angle."""
    worst_m: float | None
    """Standard deviation of the worst determined motion."""
    undetected_m: float | None
    """Largest shift by an error that stays undetected."""

    @property
    def carries(self) -> bool:
        """Tell whether a pose rests on it."""
        return self.state in CARRYING

    @property
    def drawn(self) -> SetupLink:
        """Give what a plan shows of it."""
        return SetupLink(self.target, self.source, self.state, self.worst_m)


States = Mapping[tuple[str, str], NetworkLink]
"""What became of the registration of a pair (target, source) in its network."""


def link_rows(pairs: Sequence[Pair], network: Network | None) -> list[LinkRow]:
    """Give all pairs that were tried, those that carry a pose first."""
    states = states_of_links(network)
    return sorted((link_row(pair, states, network) for pair in pairs), key=lambda row: not row.carries)


def states_of_links(network: Network | None) -> States:
    """Give what became of registrations in a network; nothing where there is none."""
    return {} if network is None else {(link.target, link.source): link for link in network.links}


def link_row(pair: Pair, states: States, network: Network | None) -> LinkRow:
    """Describe a pair by the figures of one row.

    Parameters
    ----------
    pair
        With its pose and adjustment.
    states
        Of the network, as `states_of_links` gives them.
    network
        None: there are two stations.
    """
    link = states.get((pair.target, pair.source))
    state = link.state if link is not None else _state_alone(pair, network)
    reason = (link.reason if link is not None else None) or "; ".join(pair.reasons[:2]) or None
    return _row(pair, state, None if state in CARRYING else reason)


def _state_alone(pair: Pair, network: Network | None) -> str:
    """Name the state of a pair that the network does not list."""
    if pair.status == "accepted":
        return "uncontrolled" if network is None else "not-connected"
    return pair.status if pair.status in LINK_STYLES else "rejected"


def _row(pair: Pair, state: str, reason: str | None) -> LinkRow:
    pose, adjustment, rank = pair.target_from_source, pair.adjustment, pair.rank_report
    std = None if pose is None else pose.std
    shift = None if pose is None else pose.std_at_centroid_m
    turns = [] if std is None else [std.omega_gon, std.phi_gon, std.kappa_gon]
    known = [value for value in turns if value is not None]
    motions = [motion.std_m for motion in rank.determined] if rank is not None else []
    axes = [axis for axis in (shift.tx_m, shift.ty_m, shift.tz_m) if axis is not None] if shift is not None else []
    effects = None if adjustment is None else adjustment.largest_external_effects
    return LinkRow(
        target=pair.target,
        source=pair.source,
        state=state,
        reason=reason,
        overlap=None if pair.overlap is None else pair.overlap.fraction_0_5m,
        rms_m=None if pair.overlap is None else pair.overlap.rms_m,
        sigma0=None if adjustment is None else adjustment.sigma0,
        stds_m=(None, None, None) if shift is None else (shift.tx_m, shift.ty_m, shift.tz_m),
        turn_gon=max(known) if len(known) == 3 else None,
        worst_m=max([*motions, *axes], default=None),
        undetected_m=None if effects is None else effects.centroid_shift_m,
    )


def rms_explained(rows: Sequence[LinkRow], messages: Messages) -> str | None:
    """Say why the rms of surfaces may be many times the standard deviation of a pose; None where it is not.

    Links that carry nothing are passed over: of a wrong pose a large rms is no wonder.
    """
    seen = [row for row in rows if row.carries and row.rms_m and row.worst_m and row.rms_m > OFTEN * row.worst_m]
    if not seen:
        return None
    most = max(seen, key=lambda row: (row.rms_m or 0.0) / (row.worst_m or 1.0))
    return messages("explained.rms", rms=messages.milli(most.rms_m, 1), std=messages.milli(most.worst_m, 2))
