"""The table of methods: a row per estimator, with its inputs and summary.

All code that runs, steps, summarises, colours or tests estimators iterates over it. A new estimator
needs a file in `estimators` and a row here, and a field of `MethodOptions` for each option.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from importlib import import_module
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final, Protocol, cast

from pydantic import BaseModel, Field

from analysis.model.strict_config import STRICT

if TYPE_CHECKING:
    from estimators.arrays import Floats
    from estimators.estimate import Trace
    from estimators.methods.fgls import FglsOptions
    from estimators.methods.huber import HuberOptions
    from estimators.methods.ls import LsOptions
    from estimators.methods.pooled import PooledOptions
    from estimators.methods.rls import RlsOptions
    from estimators.methods.rtls import RtlsOptions
    from estimators.methods.tls import TlsOptions


class FeedKind(Enum):
    """Kind of samples that a method is fed."""

    WINDOWS = "every accepted window"
    SETTLED = "each sample once, of the accepted windows that no braking follows within sight"
    SEGMENTS = "the accepted samples of each manoeuvre"


class SummaryRule(Enum):
    """How a method's estimates are summarised for a log."""

    MEAN = "the mean of its windows, weighted by 1/std²"
    LAST = "its last state, which holds all samples before it"
    POOL = "one fit over every accepted sample"


class MethodOptions(BaseModel):
    """Options of the estimators, as in `[settings.trace]`."""

    model_config = STRICT

    forgetting: float = Field(
        0.998, gt=0.5, le=1, description="λ of the recursive estimators: half forgotten in 3.5 s"
    )
    directional_forgetting: bool = Field(
        False, description="forget only along the direction of each new sample"
    )
    fgls_floor: float = Field(0.05, ge=0.05, le=1, description="κ: smallest |residual| over rms")
    huber_bend: float = Field(
        1.345, gt=0, description="c: residuals up to c robust deviations weigh fully"
    )


@dataclass(frozen=True, slots=True)
class AxisNoise:
    """Noise of an axis.

    Attributes:
        ratios: noise ratios of the columns and the force or torque, for total least squares.
        moving_mean_covariance: (p + 1, p + 1) covariance in a row of [A f] after the moving mean;
            None if unknown.
        long_sum_variance: (p + 1, p + 1) variance per sample of long sums; None if unknown.
    """

    ratios: "TlsOptions"
    moving_mean_covariance: "Floats | None"
    long_sum_variance: "Floats | None"


class EstimatorModule(Protocol):
    """Interface of an estimator module."""

    @property
    def estimate_along_log(self) -> "Callable[..., Trace]":
        """Estimates over a log, with inputs according to `Feed`."""
        ...


@dataclass(frozen=True, slots=True)
class Method:
    """An estimator, whose module is imported and compiled on first use.

    Attributes:
        name: name in settings, frames and recordings; its module in `estimators` has
            `estimate_along_log`, and `fit` for a windowed method, or `start` and `step` for a
            recursive one.
        title: description in a sentence.
        feed: input of `estimate_along_log`.
        summary: how the estimates of a log are summarised.
        on_board: module and function in `estimators` for use on board; depending on `feed`, it
            takes the current window, the samples since the last window, or those of a manoeuvre.
        options: function that makes the options from the settings and the noise of the axis.
        takes_noise_off: whether the method corrects for noise in the regressor. Others treat the
            regressor as exact, like (6), and their estimates are attenuated by its noise.
    """

    name: str
    title: str
    feed: FeedKind
    summary: SummaryRule
    on_board: str
    options: Callable[[MethodOptions, AxisNoise], Any]
    takes_noise_off: bool = False

    @property
    def estimator(self) -> EstimatorModule:
        """The imported module."""
        return cast("EstimatorModule", import_module(f"estimators.methods.{self.name}"))

    @property
    def step(self) -> Callable[..., Any]:
        """The function for use on board."""
        module, _, name = self.on_board.partition(".")
        return attrgetter(name)(import_module(f"estimators.methods.{module}"))


def _make_ls_options(_options: MethodOptions, _noise: AxisNoise) -> "LsOptions":
    from estimators.methods.ls import LsOptions

    return LsOptions()


def _make_rls_options(chosen: MethodOptions, _noise: AxisNoise) -> "RlsOptions":
    from estimators.methods.rls import RlsOptions

    return RlsOptions(chosen.forgetting, chosen.directional_forgetting)


def _make_fgls_options(chosen: MethodOptions, _noise: AxisNoise) -> "FglsOptions":
    from estimators.methods.fgls import FglsOptions

    return FglsOptions(chosen.fgls_floor)


def _make_tls_options(_options: MethodOptions, noise: AxisNoise) -> "TlsOptions":
    return noise.ratios


def _make_pooled_options(_options: MethodOptions, noise: AxisNoise) -> "PooledOptions":
    from estimators.methods.pooled import PooledOptions

    return PooledOptions(noise.moving_mean_covariance)


def _make_huber_options(chosen: MethodOptions, _noise: AxisNoise) -> "HuberOptions":
    from estimators.methods.huber import HuberOptions

    return HuberOptions(chosen.huber_bend)


def _make_rtls_options(chosen: MethodOptions, noise: AxisNoise) -> "RtlsOptions":
    from estimators.methods.rtls import RtlsOptions

    return RtlsOptions(noise.ratios, chosen.forgetting)


def _index_methods_by_name(*rows: Method) -> Mapping[str, Method]:
    return {row.name: row for row in rows}


_WINDOWED: Final = (FeedKind.WINDOWS, SummaryRule.MEAN)
_RECURSIVE: Final = (FeedKind.SETTLED, SummaryRule.LAST)
METHODS: Final = _index_methods_by_name(
    Method("ls", "LS", *_WINDOWED, "incremental.estimate_by_ls", _make_ls_options),
    Method("rls", "RLS", *_RECURSIVE, "incremental.estimate_by_rls", _make_rls_options),
    Method("fgls", "FGLS", *_WINDOWED, "incremental.estimate_by_fgls", _make_fgls_options),
    Method(
        "tls",
        "TLS",
        *_WINDOWED,
        "incremental.estimate_by_tls",
        _make_tls_options,
        takes_noise_off=True,
    ),
    Method(
        "pooled",
        "pooled LS",
        FeedKind.SEGMENTS,
        SummaryRule.POOL,
        "incremental.Pool.estimate",
        _make_pooled_options,
        takes_noise_off=True,
    ),
    Method(
        "huber",
        "Huber's regression",
        *_WINDOWED,
        "incremental.estimate_by_huber",
        _make_huber_options,
    ),
    Method(
        "rtls",
        "recursive TLS",
        *_RECURSIVE,
        "incremental.estimate_by_rtls",
        _make_rtls_options,
        takes_noise_off=True,
    ),
)
#: Names of methods whose estimate at a time is based on all samples before it.
RECURSIVE_METHODS: Final = tuple(
    name for name, method in METHODS.items() if method.summary is SummaryRule.LAST
)
