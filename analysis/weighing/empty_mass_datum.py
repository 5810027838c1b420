"""The empty mass as a datum: a weighbridge mass calibrates the scale of the log's masses.

The gain of the force, the share of the measured wheels and their radius scale every mass alike.
If the log weighs the empty machine as m0, and a weighbridge as M0, the payload p of the log becomes
p + K (M0 - m0). K is the gain of a Kalman update with the fit's own covariances. If the scale is
unknown, K is p/m0, so that the payload is M0 p/m0; if the machine file states it, K is smaller, and
p + K (M0 - m0) is the estimate of the smallest variance. An error of m0 enters the payload K times,
together with the error that the same cause has in p.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime
from functools import cached_property
from typing import Final

import numpy as np

from analysis.model.machine import Machine
from analysis.model.machine_body import Body
from analysis.model.uncertainty_sources import (
    SCALES,
    UncertaintySource,
    combine_u,
    sort_sources_largest_first,
)
from analysis.weighing.mass_budget import make_mass_budget
from analysis.weighing.motion_samples import Floats
from analysis.weighing.weigh import Weighing
from analysis.weighing.weighing_limits import LIMITS

#: Factors that an empty machine does not determine, since they change with the load.
_BY_LOAD: Final = frozenset(scale.name for scale in SCALES if scale.by_load)
#: The times of a log that begins earlier count from 0, so that its date is unknown.
_CLOCKS_FROM: Final = date(1980, 1, 1)
_TICKET: Final = UncertaintySource(
    "empty_mass",
    "scale",
    0.0,
    "mass of the empty machine, with its fuel, operator and mud, as the machine file states it",
    "weighing the empty machine again, on the day; machine.empty_mass_u_kg",
)
_CARRIED: Final = UncertaintySource(
    "empty_bucket",
    "common",
    0.0,
    "material that stays in the bucket of the empty machine",
    "a clean bucket in some empty passes",
)


def list_notes_on_outdated_tickets(body: Body, start_ns: int) -> list[str]:
    """Notes on a weighbridge ticket whose date differs from the log's.

    Args:
        body: body of the machine file, with the date of the ticket if known.
        start_ns: start of the log in Unix ns.
    """
    weighed = body.empty_mass_day
    if weighed is None or body.empty_mass_u_kg is None:
        return []
    today = datetime.fromtimestamp(start_ns // 10**9, body.time_zone).date()
    days = (today - weighed).days
    if days == 0 or today < _CLOCKS_FROM:
        return []
    apart = f"{abs(days)} day{'s' * (abs(days) > 1)} {'before' if days > 0 else 'after'} this log"
    return [
        f"the empty machine was weighed on {weighed}, {apart}: include changes of fuel, operator, "
        "mud and attachment between the two days in machine.empty_mass_u_kg"
    ]


def list_factors_without_uncertainty(sources: Sequence[UncertaintySource]) -> list[str]:
    """Names of the factors of unknown uncertainty that an empty machine determines."""
    return [s.name for s in sources if s.u is None and s.name not in _BY_LOAD]


@dataclass(frozen=True)
class EmptyMachine:
    """The empty machine as weighed by a log.

    Attributes:
        weighing: the joint fit.
        machine: machine file.
        weights: (masses,) weights of the empty states, with sum 1.
        carried_kg: mean mass left in the bucket in the empty states, and its standard uncertainty.
        fuel_kg: mean mass of fuel in excess of the ticket's, and its standard uncertainty.
    """

    weighing: Weighing
    machine: Machine
    weights: Floats
    carried_kg: tuple[float, float] = (0.0, 0.0)
    fuel_kg: tuple[float, float] = (0.0, 0.0)

    @property
    def _body(self) -> Body:
        return self.machine.machine

    @cached_property
    def mass_with_rotating_parts_kg(self) -> float:
        """Weighed empty mass including rotating mass, in kg."""
        return float(self.weights @ self.weighing.fit.masses_kg) - self.carried_kg[0]

    @cached_property
    def uncertainty_sources(self) -> list[UncertaintySource]:
        """Sources of the uncertainty of the weighed empty mass."""
        found = make_mass_budget(self.weighing, self.machine, self.weights)
        return [*found, replace(_CARRIED, u=self.carried_kg[1])]

    @cached_property
    def _stated_empty_mass_kg(self) -> float | None:
        """Empty mass stated in the machine file, with fuel and rotating mass, in kg."""
        empty_kg = self._body.empty_mass_kg
        if empty_kg is None:
            return None
        return empty_kg + self.fuel_kg[0] + self._body.rotating_mass_kg

    @property
    def _stated_empty_mass_u_kg(self) -> float | None:
        """Standard uncertainty of the stated empty mass and of the fuel on board, in kg."""
        u_kg = self._body.empty_mass_u_kg
        return None if u_kg is None else float(np.hypot(u_kg, self.fuel_kg[1]))

    @property
    def empty_mass_contradiction_text(self) -> str:
        """Why the weighed and the stated empty mass contradict each other; "" if they do not."""
        stated_kg = self._stated_empty_mass_kg
        if stated_kg is None:
            return ""
        scale_kg = (
            LIMITS.unknown_scale_u * self.mass_with_rotating_parts_kg
            if list_factors_without_uncertainty(self.uncertainty_sources)
            else 0.0
        )
        u_kg = float(np.hypot(combine_u(self.uncertainty_sources), scale_kg))
        allowed_kg = LIMITS.empty_mass_agreement_u * float(
            np.hypot(u_kg, self._stated_empty_mass_u_kg or 0.0)
        )
        if abs(self.mass_with_rotating_parts_kg - stated_kg) <= allowed_kg:
            return ""
        here_kg = self.mass_with_rotating_parts_kg - self._body.rotating_mass_kg
        return (
            f"empty_mass: the empty machine weighs {here_kg:,.0f} ± {u_kg:,.0f} kg here, but "
            f"{self._body.empty_mass_kg:,.0f} kg in its machine file"
        )

    @property
    def weighed_to_stated_ratio_and_u(self) -> tuple[float, float] | None:
        """Weighed over stated empty mass, and its standard uncertainty; None if none is stated."""
        stated_kg, stated_u_kg = self._stated_empty_mass_kg, self._stated_empty_mass_u_kg
        if stated_kg is None or stated_u_kg is None:
            return None
        u_kg = combine_u(self.uncertainty_sources, "random", "common")
        turns_u_kg = self._body.rotating_mass_u_kg
        u_1 = float(np.linalg.norm([u_kg, stated_u_kg, turns_u_kg])) / stated_kg
        return self.mass_with_rotating_parts_kg / stated_kg, u_1

    def make_payload_datum(self, mass_coefficients_of_payload: Floats) -> "EmptyDatum | None":
        """Calibrate payloads by the empty mass; None if that does not reduce their uncertainty.

        Args:
            mass_coefficients_of_payload: (masses,) weights of the sum of payloads whose variance is
                minimised.
        """
        stated_kg, stated_u_kg = self._stated_empty_mass_kg, self._stated_empty_mass_u_kg
        sum_kg = float(mass_coefficients_of_payload @ self.weighing.fit.masses_kg)
        if (
            stated_kg is None
            or stated_u_kg is None
            or sum_kg <= 0.0
            or self.mass_with_rotating_parts_kg <= 0.0
        ):
            return None
        in_ratio = 1.0 / self.mass_with_rotating_parts_kg

        def make_datum(gain_per_kg: float) -> EmptyDatum:
            return EmptyDatum(
                self,
                gain_per_kg,
                1.0 + gain_per_kg * (stated_kg - self.mass_with_rotating_parts_kg),
                gain_per_kg * stated_u_kg,
            )

        if list_factors_without_uncertainty(self.uncertainty_sources):
            found = make_datum(in_ratio)
            # rounding may leave no ratio of very different masses
            return found if found.scale_1 > 0.0 else None
        own_kg2 = self._variance_of_weighted_sum(mass_coefficients_of_payload)
        empty_kg2 = combine_u(self.uncertainty_sources) ** 2
        ratio_kg2 = self._variance_of_weighted_sum(
            mass_coefficients_of_payload - in_ratio * sum_kg * self.weights
        )
        together_kg2 = (
            own_kg2
            + (in_ratio * sum_kg) ** 2 * self._variance_of_weighted_sum(self.weights)
            - ratio_kg2
        )
        together_kg2 /= 2.0 * in_ratio * sum_kg
        gain_per_kg = together_kg2 / (empty_kg2 + stated_u_kg**2) / sum_kg
        found = make_datum(float(np.clip(gain_per_kg, 0.0, in_ratio)))
        if (
            found.scale_1 <= 0.0
            or combine_u(found.list_payload_sources(mass_coefficients_of_payload)) ** 2 >= own_kg2
        ):
            return None
        return found

    def _variance_of_weighted_sum(self, coefficients: Floats) -> float:
        """Variance of a weighted sum of masses, in kg²."""
        return combine_u(make_mass_budget(self.weighing, self.machine, coefficients)) ** 2


@dataclass(frozen=True)
class EmptyDatum:
    """Payloads calibrated by the stated empty mass.

    Attributes:
        empty: the empty machine.
        gain_per_kg: Kalman gain K of a payload divided by the payload, in 1/kg.
        scale_1: factor that all payloads are multiplied by.
        stated_mass_u_1: standard uncertainty of the factor due to the stated mass.
    """

    empty: EmptyMachine
    gain_per_kg: float
    scale_1: float
    stated_mass_u_1: float

    def compute_payload_sensitivities(self, payload: Floats) -> Floats:
        """(masses,) sensitivities of a payload to errors of the masses, divided by `scale_1`.

        Args:
            payload: (masses,) weights of the uncalibrated payload.
        """
        payload_kg = float(payload @ self.empty.weighing.fit.masses_kg)
        return payload - self.gain_per_kg * payload_kg * self.empty.weights

    def list_payload_sources(self, payload: Floats) -> list[UncertaintySource]:
        """Uncertainty sources of a payload, in kg, the largest first.

        Args:
            payload: (masses,) weights of the uncalibrated payload.
        """
        empty = self.empty
        payload_kg = abs(float(payload @ empty.weighing.fit.masses_kg))
        found = make_mass_budget(
            empty.weighing, empty.machine, self.compute_payload_sensitivities(payload)
        )
        known = list_factors_without_uncertainty(found)
        kept = [
            replace(each, u=None if each.u is None else each.u * abs(self.scale_1))
            for each in found
            if each.name not in known
        ]
        bucket_kg = self.gain_per_kg * payload_kg * empty.carried_kg[1]
        return sort_sources_largest_first(
            [
                *kept,
                replace(_TICKET, u=self.stated_mass_u_1 * payload_kg),
                replace(_CARRIED, u=bucket_kg * abs(self.scale_1)),
            ]
        )


def list_payload_uncertainties(
    weighing: Weighing, machine: Machine, datum: EmptyDatum | None, coefficients: Floats
) -> list[UncertaintySource]:
    """Uncertainty sources of a sum of masses, in kg, using the datum if there is one.

    Args:
        weighing: joint fit of the log.
        machine: machine file, with the scale's uncertainties.
        datum: calibration by the empty mass, or None.
        coefficients: (masses,) weights in the sum.
    """
    if datum is None:
        return make_mass_budget(weighing, machine, coefficients)
    return datum.list_payload_sources(coefficients)
