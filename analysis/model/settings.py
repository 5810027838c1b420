"""The settings of a replay, a part a stage: the paper's values where the paper gives one."""

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Annotated, Any, Final, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from analysis.model.methods import METHODS, MethodOptions
from estimators.errors import nearest


def _check_method(name: str) -> str:
    if name not in METHODS:
        raise ValueError(f"no method '{name}'; {nearest(name, METHODS)}")
    return name


MethodName = Annotated[str, AfterValidator(_check_method)]

_PART: Final = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class FilterSettings(BaseModel):
    """The low-pass before a derivative is taken."""

    model_config = _PART

    cutoff_hz: float = Field(
        20.0, gt=0, description="low-pass of every regressor channel where one is derived by d/dt"
    )
    causal: bool = Field(False, description="filter as on board: no look into the future")


class AlignSettings(BaseModel):
    """The common grid."""

    model_config = _PART

    rate_hz: float = Field(
        100.0,
        gt=0,
        le=10_000,
        description="rate of the common grid; not given: that of the regressor's slowest channel, "
        "at most this",
    )
    gap_periods: float = Field(3.0, gt=1, description="periods without a sample that make a gap")
    latency_s: float | None = Field(
        None,
        ge=0,
        le=60,
        description="filter.causal: how far back a row looks, so that the samples on both sides "
        "have come; none: as long as the regressor's slowest channel takes",
    )


class SmoothSettings(BaseModel):
    """The moving mean."""

    model_config = _PART

    samples: int = Field(
        10, ge=1, description="samples of the trailing moving mean; not given: 0.1 s of them"
    )


class ForcesSettings(BaseModel):
    """What the equation of straight motion (7) is made of."""

    model_config = _PART

    acceleration: Literal["specific_force", "kinematic"] = Field(
        "specific_force", description="which acceleration multiplies the mass"
    )
    coulomb: bool = Field(False, description="estimate a Coulomb friction term as well")
    direction_deadband_m_s: float = Field(
        0.0, ge=0, description="speeds up to this have no sign for the Coulomb term"
    )


class PhaseSettings(BaseModel):
    """The thresholds of the phases of motion."""

    model_config = _PART

    speed_rate_span_s: float = Field(0.1, gt=0, description="span of the speed rate")
    standstill_speed_m_s: float = Field(0.02, ge=0, description="slower than this stands")
    steady_acc_m_s2: float = Field(0.15, gt=0, description="smaller speed rates are cruising")
    turning_rate_rad_s: float = Field(
        0.05, gt=0, description="yaw rate above which the machine turns"
    )
    steady_yaw_acc_rad_s2: float = Field(0.05, gt=0, description="smaller ones are steady arcs")


class GateSettings(BaseModel):
    """Which windows are estimated from."""

    model_config = _PART

    window_samples: int = Field(
        320,
        ge=4,
        description="samples in a window; not given: 3.2 s of them, at least 20 readings of the "
        "regressor's slowest channel",
    )
    index: Literal["information", "gaussian", "ksg", "variance"] = Field(
        "information",
        description="what accepts a window: the index (11), the mutual information (10) of normal "
        "variables, that by nearest neighbours, or the predicted standard deviation of the mass",
    )
    threshold_nat: float = Field(
        0.7, description="smallest index (11), (10) or ksg of an accepted window"
    )
    threshold_std_kg: float = Field(
        30.0, gt=0, description="index = variance: largest predicted std of the mass"
    )
    threshold_std_kg_m2: float = Field(
        30.0, gt=0, description="index = variance: largest predicted std of the inertia"
    )
    ksg_neighbours: int = Field(4, ge=1, le=50, description="index = ksg: neighbours k")
    exclude_braking: bool = Field(
        True, description="refuse windows that contain a braking sample, of travel or of a spin"
    )
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
    noise_share_max: float = Field(
        0.3, gt=0, description="largest share of noise in what the acceleration alone explains"
    )


class TraceSettings(MethodOptions):
    """The estimators and their options."""

    methods: tuple[MethodName, ...] = Field(
        ("ls", "rls", "fgls", "tls", "pooled"),
        min_length=1,
        description=f"estimators to run, of {', '.join(METHODS)}",
    )


class NoiseSettings(BaseModel):
    """Standard deviation of one sample of each column, before the moving mean; None: from the log.

    A value stands for white noise.
    """

    model_config = _PART

    force_N: float | None = Field(None, gt=0, description="noise of the force")
    acc_m_s2: float | None = Field(None, gt=0, description="noise of the acceleration")
    speed_m_s: float | None = Field(None, gt=0, description="noise of the speed")
    torque_z_N_m: float | None = Field(None, gt=0, description="noise of the yaw torque")
    yaw_acc_rad_s2: float | None = Field(None, gt=0, description="noise of the yaw acceleration")
    yaw_rate_rad_s: float | None = Field(None, gt=0, description="noise of the yaw rate")


#: Terms of the answer's fit that a calibration learns: what lasts as long as the machine does.
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

    model_config = _PART

    mean: float = Field(allow_inf_nan=False, description="what its logs say together")
    std: float = Field(gt=0, allow_inf_nan=False, description="what differs from log to log")
    mean_u: float = Field(
        ge=0, allow_inf_nan=False, description="standard uncertainty of the mean: all logs share it"
    )


class PriorSettings(BaseModel):
    """Standard deviations of what the answer's fit allows besides mass and friction.

    A share is of the force that the log drives with (its 95 % quantile).
    """

    model_config = _PART

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
        0.02, gt=0, description="and as a share of the machine's weight, likewise"
    )
    ground_share: float = Field(
        0.01,
        gt=0,
        description="prior of what differs between the ground where loaded starts begin and where "
        "empty ones do, as a share of the machine's weight",
    )
    ground_uneven_share: float = Field(
        0.01,
        gt=0,
        description="prior of how the ground's force differs from start to start, likewise",
    )
    ground_change_share: float = Field(
        0.005,
        gt=0,
        description="prior of the change of the ground's force over ten metres, likewise",
    )
    ground_route_share: float = Field(
        0.01,
        gt=0,
        description="prior of the change of rolling resistance over ten metres of the route from "
        "loading to dumping, likewise",
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


class LoadSettings(BaseModel):
    """When the machine carried nothing, for the payload as a difference."""

    model_config = _PART

    empty_from_s: float | None = Field(None, description="it is known to be empty from here on")
    empty_to_s: float | None = Field(None, description="up to here, in seconds from the start")

    @model_validator(mode="after")
    def _check_empty_span(self) -> Self:
        first, last = self.empty_from_s, self.empty_to_s
        if (first is None) != (last is None):
            raise ValueError("empty_from_s and empty_to_s go together")
        if first is not None and last is not None and not first < last:
            raise ValueError(f"empty_from_s is {first:g}, not before empty_to_s {last:g}")
        return self


class PlanarSettings(BaseModel):
    """Arcs and joint motion."""

    model_config = _PART

    threshold_std_com_m: float = Field(
        0.05, gt=0, description="largest predicted std of an arc's centre of mass"
    )


class VerdictLimits(BaseModel):
    """Limits of the checks that decide whether a log can weigh (on its ungated moving samples)."""

    model_config = _PART

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


def nearest_setting(key: str, parts: Mapping[str, type[BaseModel]]) -> str | None:
    """The setting, with its stage, whose name is most like a key that is none."""
    stages = {name: stage for stage, part in parts.items() for name in part.model_fields}
    close = get_close_matches(key, stages, n=1)
    return f"{stages[close[0]]}.{close[0]}" if close else None


class Settings(BaseModel):
    """How a log is replayed. Every field can be overridden with `--set settings.STAGE.NAME=VALUE`.

    A part belongs to the stage that it is named after; later stages read it where they must know
    what was done (the gate's window, the grid's rate).
    """

    model_config = _PART

    filter: FilterSettings = FilterSettings.model_validate({})
    align: AlignSettings = AlignSettings.model_validate({})
    smooth: SmoothSettings = SmoothSettings.model_validate({})
    forces: ForcesSettings = ForcesSettings.model_validate({})
    phases: PhaseSettings = PhaseSettings.model_validate({})
    gate: GateSettings = GateSettings.model_validate({})
    trace: TraceSettings = TraceSettings.model_validate({})
    noise: NoiseSettings = NoiseSettings.model_validate({})
    priors: PriorSettings = PriorSettings.model_validate({})
    loads: LoadSettings = LoadSettings.model_validate({})
    planar: PlanarSettings = PlanarSettings.model_validate({})
    verdict: VerdictLimits = VerdictLimits.model_validate({})

    @model_validator(mode="before")
    @classmethod
    def _values_are_in_a_stage(cls, content: Any) -> Any:
        """Name the stage of a value that was given without one."""
        if not isinstance(content, Mapping):
            return content
        for key, value in content.items():
            if key in cls.model_fields or isinstance(value, Mapping | BaseModel):
                continue
            if meant := nearest_setting(key, cls.stage_models()):
                raise ValueError(f"unknown key '{key}'; did you mean 'settings.{meant}'?")
        return content

    @classmethod
    def stage_models(cls) -> dict[str, type[BaseModel]]:
        """The model of each part, by its name."""
        return {
            name: field.annotation
            for name, field in cls.model_fields.items()
            if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)
        }

    def to_flat_dict(self) -> dict[str, Any]:
        """Every value by its dotted name, as plain JSON values."""
        return {
            f"{stage}.{name}": value
            for stage, part in self.model_dump(mode="json").items()
            for name, value in part.items()
        }

    def value(self, name: str) -> Any:
        """The setting of a dotted name, as `gate.threshold_nat`."""
        part, _, key = name.partition(".")
        return getattr(getattr(self, part), key)

    def with_changes(self, changes: Mapping[str, Any]) -> Self:
        """The same settings but for `changes`, by dotted name: `{"gate.window_samples": 400}`.

        Raises:
            ValidationError: no such setting, or a value that it does not take.
        """
        # what was not set stays so: a log's own rate fills it in
        content = self.model_dump(exclude_unset=True)
        for name, value in changes.items():
            part, _, key = name.partition(".")
            content.setdefault(part, {})[key] = value
        return type(self).model_validate(content)
