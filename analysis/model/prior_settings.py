"""The priors of the joint fit's nuisances, and the priors learnt by a calibration."""

from collections.abc import Collection
from typing import Literal, Self

from pydantic import BaseModel, Field

from analysis.model.strict_config import STRICT

#: Terms of the joint fit that a calibration can learn, since they are constant for a machine.
LearnableTerm = Literal[
    "const",
    "lag",
    "slip",
    "quadratic",
    "direction",
    "load_transfer",
    "wheel_slip",
    "gain",
    "speed_delay",
]


class LearntTerm(BaseModel):
    """A prior that a calibration learnt, in the term's unit."""

    model_config = STRICT

    mean: float = Field(allow_inf_nan=False, description="what its logs say together")
    std: float = Field(gt=0, allow_inf_nan=False, description="what differs from log to log")
    mean_u: float = Field(
        ge=0, allow_inf_nan=False, description="standard uncertainty of the mean: all logs share it"
    )


class PriorSettings(BaseModel):
    """Standard deviations of what the answer's fit allows besides mass and friction.

    A share is of the force that the log drives with (its 95 % quantile).
    """

    model_config = STRICT

    const_share: float = Field(0.05, gt=0, description="prior of a constant force, as a share")
    const_weight_share: float = Field(
        0.01, gt=0, description="and as a share of the machine's weight, both added in quadrature"
    )
    sag_weight_share: float = Field(
        0.03,
        gt=0,
        description="prior of the slope by which a body sags under a load as heavy as itself",
    )
    lag_s: float = Field(0.02, gt=0, description="prior of the force's delay")
    lag_drift_s: float = Field(0.01, gt=0, description="prior of that delay's change over the log")
    quadratic_share: float = Field(
        0.07, gt=0, description="prior of a quadratic resistance at top speed, as a share"
    )
    direction_share: float = Field(
        0.05, gt=0, description="prior of Coulomb friction where the log drives both ways, a share"
    )
    direction_weight_share: float = Field(
        0.02, gt=0, description="and as a share of the machine's weight"
    )
    viscous_weight_share_s_m: float = Field(
        0.001,
        gt=0,
        description="prior of viscous friction that is proportional to the weight (rolling "
        "resistance that grows with the speed), as a share of the weight per m/s",
    )
    ground_share: float = Field(
        0.01,
        gt=0,
        description="prior of the difference in ground between the places where loaded starts and "
        "empty ones do, as a share of the machine's weight",
    )
    ground_uneven_share: float = Field(
        0.01,
        gt=0,
        description=(
            "prior of the difference in ground force from start to start, as a share of the "
            "machine's weight"
        ),
    )
    ground_change_share: float = Field(
        0.005,
        gt=0,
        description=(
            "prior of the change in ground force over ten metres, as a share of the machine's "
            "weight"
        ),
    )
    ground_route_share: float = Field(
        0.01,
        gt=0,
        description="prior of the change of rolling resistance over ten metres of the route from "
        "loading to dumping, likewise",
    )
    grade_change_share: float = Field(
        0.002,
        gt=0,
        description="prior of the change of the grade over ten metres of that route, where neither "
        "accelerometer nor pitch measures it, likewise",
    )
    viscous_drift_share: float = Field(
        0.1,
        gt=0,
        description="prior of the change of viscous friction over the log, as a share of the force "
        "at top speed",
    )
    gain_drift: float = Field(
        0.03, gt=0, description="prior of the change of the force's gain over the log, as a share"
    )
    place_share: float = Field(
        0.3,
        gt=0,
        description="prior of a force that depends on the place on a short path that is driven to "
        "and fro (a spring, gravity), over the force",
    )
    hysteresis_share: float = Field(
        0.0,
        ge=0,
        description="prior of half the hysteresis loop of the force, as a share; 0: fitted only "
        "where the log shows one",
    )
    low_gear_share: float = Field(
        0.2,
        gt=0,
        description="prior of the rotating mass of the first gear beyond that of the top one, over "
        "the mass; vehicles that reach 11 m/s from less than 4",
    )
    gain: float = Field(0.005, gt=0, description="prior of the accelerometer's gain less 1")
    gain_by_load: float = Field(
        0.1,
        gt=0,
        description="prior of that gain's change for a load as heavy as the machine: a body that "
        "squats under its load",
    )
    speed_delay_s: float = Field(
        0.02, gt=0, description="prior std of the speed's delay after the accelerometer"
    )
    wheel_slip: float = Field(
        0.07, gt=0, description="prior of the wheels' slip at full force, as a share of the speed"
    )
    load_transfer_s2_m: float = Field(
        0.015,
        gt=0,
        description="prior of the change of the measured wheels' share with acceleration",
    )
    scrub_arm_m: float = Field(
        0.03,
        gt=0,
        description="prior of Coulomb friction of turning, as a torque over the machine's weight; "
        "tyres that scrub. `direction_share` of the yaw torque is added in quadrature",
    )
    scrub_share: float = Field(
        0.1,
        gt=0,
        description="prior of what friction of turning changes by under way and as tyres slide "
        "sideways, as a share of the yaw torque",
    )
    lateral_arm_m: float = Field(
        0.3,
        gt=0,
        description="prior of how far ahead of the origin the ground's sideways force acts",
    )
    yaw_rate_bias_rad_s: float = Field(
        0.005, gt=0, description="prior of the gyroscope's bias while the machine turns"
    )
    yaw_rate_gain: float = Field(0.005, gt=0, description="prior of the gyroscope's gain less 1")
    learnt: dict[LearnableTerm, LearntTerm] = Field(
        {},
        description="priors that a calibration learnt, instead: a table of `mean`, `std`, `mean_u` "
        "by term",
    )
    learnt_means: Literal["fixed", "told"] = Field(
        "fixed",
        description="whether a log of several loads tells what the means of learnt priors have "
        "wrong (`told`), as later logs do, or nothing does, as in the calibration's own logs",
    )

    def copy_without_learnt(self) -> Self:
        """The same, without the priors that a calibration learnt."""
        return self.model_copy(update={"learnt": {}})

    def copy_widened_by_learnt_mean_u(self, unchanged_terms: Collection[str]) -> Self:
        """The same, with learnt priors widened by the uncertainty of their means.

        Args:
            unchanged_terms: names of terms that stay as they are.
        """
        import numpy as np  # slow to import; math.hypot differs in the last bit

        learnt = {
            name: term
            if name in unchanged_terms
            else LearntTerm(mean=term.mean, std=float(np.hypot(term.std, term.mean_u)), mean_u=0.0)
            for name, term in self.learnt.items()
        }
        return self.model_copy(update={"learnt": learnt})

    def copy_with_multiplied_stds(self, factor: float) -> Self:
        """The same, with all standard deviations multiplied by a factor."""
        learnt = {
            name: term.model_copy(update={"std": term.std * factor})
            for name, term in self.learnt.items()
        }
        stds = {
            n: v * factor for n, v in self.model_dump(exclude={"learnt", "learnt_means"}).items()
        }
        return self.model_copy(update={**stds, "learnt": learnt})
