"""The settings of a replay, one part per stage, with the paper's values where it gives them."""

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, Field, model_validator

from analysis.model.methods import METHODS, MethodOptions
from analysis.model.prior_settings import PriorSettings
from analysis.model.strict_config import STRICT
from analysis.model.verdict_limits import VerdictLimits
from estimators.errors import suggest_choice


def _require_known_method(name: str) -> str:
    if name not in METHODS:
        raise ValueError(f"no method '{name}'; {suggest_choice(name, METHODS)}")
    return name


MethodName = Annotated[str, AfterValidator(_require_known_method)]


class FilterSettings(BaseModel):
    """The low-pass before a derivative is taken."""

    model_config = STRICT

    cutoff_hz: float = Field(
        20.0, gt=0, description="low-pass of every regressor channel where one is derived by d/dt"
    )
    causal: bool = Field(False, description="filter as on board: no look into the future")


class AlignSettings(BaseModel):
    """The common grid."""

    model_config = STRICT

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

    model_config = STRICT

    samples: int = Field(
        10, ge=1, description="samples of the trailing moving mean; not given: 0.1 s of them"
    )


class ForcesSettings(BaseModel):
    """Settings of the equation of straight motion (7)."""

    model_config = STRICT

    acceleration: Literal["specific_force", "kinematic"] = Field(
        "specific_force", description="which acceleration multiplies the mass"
    )
    coulomb: bool = Field(False, description="estimate a Coulomb friction term as well")
    direction_deadband_m_s: float = Field(
        0.0, ge=0, description="speeds up to this have no sign for the Coulomb term"
    )


class PhaseSettings(BaseModel):
    """The thresholds of the phases of motion."""

    model_config = STRICT

    speed_rate_span_s: float = Field(0.1, gt=0, description="span of the speed rate")
    standstill_speed_m_s: float = Field(0.02, ge=0, description="slower than this stands")
    steady_acc_m_s2: float = Field(0.15, gt=0, description="smaller speed rates are cruising")
    turning_rate_rad_s: float = Field(
        0.05, gt=0, description="yaw rate above which the machine turns"
    )
    steady_yaw_acc_rad_s2: float = Field(0.05, gt=0, description="smaller ones are steady arcs")


class GateSettings(BaseModel):
    """Which windows are estimated from."""

    model_config = STRICT

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

    model_config = STRICT

    force_N: float | None = Field(None, gt=0, description="noise of the force")
    acc_m_s2: float | None = Field(None, gt=0, description="noise of the acceleration")
    speed_m_s: float | None = Field(None, gt=0, description="noise of the speed")
    torque_z_N_m: float | None = Field(None, gt=0, description="noise of the yaw torque")
    yaw_acc_rad_s2: float | None = Field(None, gt=0, description="noise of the yaw acceleration")
    yaw_rate_rad_s: float | None = Field(None, gt=0, description="noise of the yaw rate")


class LoadSettings(BaseModel):
    """When the machine carried nothing, for the payload as a difference."""

    model_config = STRICT

    empty_from_s: float | None = Field(None, description="it is known to be empty from here on")
    empty_to_s: float | None = Field(None, description="up to here, in seconds from the start")
    single_load: bool = Field(
        default=False, description="it carries one load throughout, so that no other is sought"
    )

    @model_validator(mode="after")
    def _refuse_reversed_empty_spans(self) -> Self:
        first, last = self.empty_from_s, self.empty_to_s
        if (first is None) != (last is None):
            raise ValueError(
                "empty_from_s and empty_to_s must be given together; add the other one"
            )
        if self.single_load and first is not None:
            raise ValueError(
                "single_load and empty_from_s contradict each other: one load in the whole log, or "
                "an empty machine in a part of it; remove one"
            )
        if first is not None and last is not None and not first < last:
            raise ValueError(
                f"empty_from_s ({first:g}) is not before empty_to_s ({last:g}); correct one of them"
            )
        return self


class PlanarSettings(BaseModel):
    """Arcs and joint motion."""

    model_config = STRICT

    threshold_std_com_m: float = Field(
        0.05, gt=0, description="largest predicted std of an arc's centre of mass"
    )


def suggest_similar_setting(
    unknown_key: str, models_by_stage: Mapping[str, type[BaseModel]]
) -> str | None:
    """The setting, with its stage, whose name is most similar to an unknown key; else None."""
    stages = {name: stage for stage, part in models_by_stage.items() for name in part.model_fields}
    close = get_close_matches(unknown_key, stages, n=1)
    return f"{stages[close[0]]}.{close[0]}" if close else None


class Settings(BaseModel):
    """How a log is replayed. Every field can be overridden with `--set settings.STAGE.NAME=VALUE`.

    A part belongs to the stage that it is named after; later stages read it where they must know
    what was done (the gate's window, the grid's rate).
    """

    model_config = STRICT

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
    def _require_stage_of_values(cls, content: Any) -> Any:
        """Raise an error that names the stage if a value is given without one."""
        if not isinstance(content, Mapping):
            return content
        for key, value in content.items():
            if key in cls.model_fields or isinstance(value, Mapping | BaseModel):
                continue
            if meant := suggest_similar_setting(key, cls.list_stage_models()):
                raise ValueError(f"unknown key '{key}'; did you mean 'settings.{meant}'?")
        return content

    @classmethod
    def list_stage_models(cls) -> dict[str, type[BaseModel]]:
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

    def get_setting(self, dotted_name: str) -> Any:
        """The setting with a dotted name such as `gate.threshold_nat`."""
        part, _, key = dotted_name.partition(".")
        return getattr(getattr(self, part), key)

    def copy_with_changes(self, changes: Mapping[str, Any]) -> Self:
        """Copy the settings with changes by dotted name: `{"gate.window_samples": 400}`.

        Raises:
            ValidationError: unknown setting, or a value that is not valid for it.
        """
        # unset fields stay unset, so that the rate of the log can fill them
        content = self.model_dump(exclude_unset=True)
        for name, value in changes.items():
            part, _, key = name.partition(".")
            content.setdefault(part, {})[key] = value
        return type(self).model_validate(content)
