"""The limits of the checks, each with its meaning."""

from pydantic import BaseModel, Field

from analysis.model.strict_config import STRICT


class VerdictLimits(BaseModel):
    """Limits of the checks that decide whether a log is usable for weighing."""

    model_config = STRICT

    partial_correlation_min: float = Field(
        0.5, ge=-1, le=1, description="least correlation of acceleration and force given the speed"
    )
    relative_std_max: float = Field(0.25, gt=0, description="largest standard deviation over mass")
    r_squared_min: float = Field(
        0.5, le=1, description="least share of the force's variance explained"
    )
    opposing_share_min: float = Field(
        0.05, ge=0, le=1, description="least share of decelerating samples with opposing force"
    )
    driving_share_min: float = Field(
        0.6, ge=0, le=1, description="least share of accelerating samples with driving force"
    )
    acceleration_gain_min: float = Field(
        0.5, description="least slope of accelerometer on wheel acceleration"
    )
    acceleration_gain_max: float = Field(2.0, gt=0, description="largest such slope")
    spin_centre_max_m: float = Field(
        0.1, gt=0, description="farthest that spins may turn about from the origin"
    )
    force_sign_min: float = Field(
        -0.5, ge=-1, le=1, description="least such correlation of a force that is not inverted"
    )
    gated_max: float = Field(
        3.0, gt=0, description="largest deviations between gated and ungated pooled masses"
    )
    friction_t_min: float = Field(
        -4.0, description="least friction of the answer over its standard deviation"
    )
    channel_noise_max: float = Field(
        0.5, gt=0, le=1, description="largest share of noise in what the answer is fitted to"
    )
    lag_max_s: float = Field(0.1, gt=0, description="largest delay of the force, or of the speed")
    gain_max: float = Field(
        0.01, gt=0, description="largest disagreement of wheels and accelerometer that widens none"
    )
    filling_max: float = Field(
        3.0, gt=0, description="largest evidence, in deviations, of a load that grows as it drives"
    )
    beyond_prior_max: float = Field(
        3.5, gt=0, description="largest distance of a term from its prior's mean over its width"
    )
    wheels_max: float = Field(
        0.02,
        gt=0,
        description="largest disagreement of wheels and accelerometer, as a share of the speed",
    )
    scatter_max: float = Field(
        4.0, gt=1, description="largest deviation of the starts over what their noise explains"
    )
    misfit_max: float = Field(
        2.0,
        gt=1,
        description="largest misfit common to the starts, over its noise, that widens none",
    )
    curvature_t_max: float = Field(
        6.0, gt=0, description="largest t of a force in a·|a| that widens none"
    )
    braking_max: float = Field(
        0.01, gt=0, description="largest change of the mass by braking that counts as driving"
    )
    methods_max: int = Field(0, ge=0, description="most methods that the answer contradicts")
    term_t_max: float = Field(4.0, gt=0, description="largest t of a term that is not reported")
    frozen_max_s: float = Field(0.0, ge=0, description="longest time that channels may be frozen")
    clipped_max: float = Field(
        0.0, ge=0, le=1, description="largest share of a force channel's readings that clip"
    )
    sides_max: float = Field(
        0.07, gt=0, description="largest difference of left and right that is not reported"
    )
    one_sided_max: float = Field(
        0.4, gt=0, description="largest such difference of the torques that withholds nothing"
    )
    clocks_max_s: float = Field(
        0.1, gt=0, description="farthest that clocks may run apart over the log"
    )
    imu_tilt_max_deg: float = Field(
        20.0, gt=0, le=180, description="largest angle of gravity to the machine's upward axis"
    )
    accepted_stretches_min: int = Field(1, ge=0, description="fewest disjoint accepted stretches")
    empty_mass_ratio_min: float = Field(
        0.25, ge=0, description="least ungated mass over empty mass"
    )
    empty_mass_ratio_max: float = Field(
        4.0, gt=0, description="largest ungated mass over empty mass"
    )
    negative_payload_max_u: float = Field(
        3.0, gt=0, description="standard uncertainties that a mass may be below the empty mass"
    )
    empty_mass_max_u: float = Field(
        1.0, gt=0, description="largest distance from the empty mass, in u, that is not reported"
    )
    causes_max: int = Field(0, ge=0, description="most named causes that make a mass worthless")
