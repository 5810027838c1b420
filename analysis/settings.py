"""The settings of a replay: the paper's values where the paper gives one."""

from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field

Method = Literal["ls", "rls", "fgls", "tls", "rtls", "huber", "pooled"]

#: Methods whose last state stands for all before it; the others give an estimate a window.
RECURSIVE: Final = frozenset({"rls", "rtls"})
#: Methods that take the regressor for exact, as (6) does; noise in it draws them towards zero.
EXACT: Final = frozenset({"ls", "rls", "fgls", "huber"})


class VerdictLimits(BaseModel):
    """Limits of the checks that decide whether a log can weigh (on its ungated moving samples)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

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
    accepted_stretches_min: int = Field(1, ge=0, description="fewest disjoint accepted stretches")
    empty_mass_ratio_min: float = Field(
        0.25, ge=0, description="least ungated mass over empty mass"
    )
    empty_mass_ratio_max: float = Field(
        4.0, gt=0, description="largest ungated mass over empty mass"
    )


class Settings(BaseModel):
    """How a log is replayed. Every field can be overridden with `--set settings.NAME=VALUE`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    rate_hz: float = Field(100.0, gt=0, le=10_000, description="rate of the common grid")
    smooth_samples: int = Field(10, ge=1, description="samples of the trailing moving mean")
    window_samples: int = Field(320, ge=4, description="samples in a window (3.2 s)")
    gate: Literal["information", "ksg", "variance"] = Field(
        "information",
        description="what accepts a window: the index (11), the mutual information by nearest "
        "neighbours, or the predicted deviation of the mass",
    )
    threshold_nat: float = Field(0.7, description="smallest index (or ksg) of an accepted window")
    threshold_std_kg: float = Field(
        30.0, gt=0, description="gate = variance: largest predicted deviation of the mass"
    )
    threshold_std_kg_m2: float = Field(
        30.0, gt=0, description="gate = variance: largest predicted deviation of the inertia"
    )
    threshold_std_com_m: float = Field(
        0.05, gt=0, description="largest predicted deviation of an arc's centre of mass"
    )
    ksg_neighbours: int = Field(4, ge=1, le=50, description="gate = ksg: neighbours k")
    acceleration: Literal["specific_force", "kinematic"] = Field(
        "specific_force", description="which acceleration multiplies the mass"
    )
    exclude_braking: bool = Field(
        True, description="refuse windows that contain a braking sample, of travel or of a spin"
    )
    coulomb: bool = Field(False, description="estimate a Coulomb friction term as well")
    methods: tuple[Method, ...] = Field(
        ("ls", "rls", "fgls", "tls", "pooled"),
        min_length=1,
        description="estimators to run; also rtls, huber",
    )
    forgetting: float = Field(
        0.998, gt=0.5, le=1, description="λ of the recursive estimators: half forgotten in 3.5 s"
    )
    direction_deadband_m_s: float = Field(
        0.0, ge=0, description="speeds up to this have no sign for the Coulomb term"
    )
    directional_forgetting: bool = Field(
        False, description="forget only along the direction of each new sample"
    )
    fgls_floor: float = Field(0.05, ge=0.05, le=1, description="κ: smallest |residual| over rms")
    huber_bend: float = Field(
        1.345, gt=0, description="c: residuals up to c robust deviations weigh fully"
    )
    tls_noise_force_N: float = Field(60.0, gt=0, description="noise of the force, before the mean")
    tls_noise_acc_m_s2: float = Field(0.01, gt=0, description="noise of the acceleration")
    tls_noise_speed_m_s: float = Field(0.005, gt=0, description="noise of the speed")
    tls_noise_torque_z_N_m: float = Field(
        45.0, gt=0, description="noise of the yaw torque, before the mean"
    )
    tls_noise_yaw_acc_rad_s2: float = Field(
        0.026, gt=0, description="noise of the yaw acceleration, as derived of such a yaw rate"
    )
    tls_noise_yaw_rate_rad_s: float = Field(0.001, gt=0, description="noise of the yaw rate")
    derivative_cutoff_hz: float = Field(
        20.0, gt=0, description="low-pass of every regressor channel where one is derived by d/dt"
    )
    causal: bool = Field(False, description="filter as on board: no look into the future")
    gap_periods: float = Field(3.0, gt=1, description="periods without a sample that make a gap")
    speed_rate_span_s: float = Field(0.1, gt=0, description="span of the speed rate for the phases")
    standstill_speed_m_s: float = Field(0.02, ge=0, description="slower than this stands")
    steady_acc_m_s2: float = Field(0.15, gt=0, description="smaller speed rates are cruising")
    turning_rate_rad_s: float = Field(0.05, gt=0, description="faster yaw rates are turning")
    steady_yaw_acc_rad_s2: float = Field(0.05, gt=0, description="smaller ones are steady arcs")
    saturation_force_N: float | None = Field(None, gt=0, description="force where a sensor clips")
    saturation_torque_z_N_m: float | None = Field(
        None, gt=0, description="yaw torque where a sensor clips"
    )
    slip_acc_m_s2: float | None = Field(
        None,
        gt=0,
        description="disagreement of wheels and IMU that means slip (slopes need pitch_rad)",
    )
    condition_max: float = Field(1000.0, gt=1, description="larger condition numbers are refused")
    verdict: VerdictLimits = VerdictLimits.model_validate({})
