"""The one table of methods: a row an estimator, and what it is fed and summarised by.

Every place that runs, steps, summarises, colours or tests estimators iterates over it. A new
estimator is a file in `estimators` and a row here; an option of its own is a field of
`MethodOptions` as well.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from types import ModuleType
from typing import Any, Final

from pydantic import BaseModel, ConfigDict, Field

from estimators import fgls, huber, incremental, ls, pooled, rls, rtls, tls
from estimators.estimate import Floats


class Feed(Enum):
    """What a method is fed."""

    WINDOWS = "every accepted window"
    SETTLED = "each sample once, of the accepted windows that no braking follows within sight"
    SEGMENTS = "the accepted samples of each manoeuvre"


class Summary(Enum):
    """How a method's estimates become one for the log."""

    MEAN = "the mean of its windows, weighted by 1/std²"
    LAST = "its last state, which stands for all before it"
    POOL = "one fit over every accepted sample"


class MethodOptions(BaseModel):
    """The options of the estimators, as `[settings.trace]` has them."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

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
    """The noise of an axis.

    Attributes:
        raw: of one sample of each column and of the force or torque, before the moving mean.
        columns: (p,) r.m.s. of the regressor's columns after it; None where it is negligible.
    """

    raw: tls.TlsOptions
    columns: Floats | None


@dataclass(frozen=True, slots=True)
class Method:
    """One estimator.

    Attributes:
        name: in settings, frames and recordings.
        title: in a sentence.
        estimator: its module: `trace`; `fit` of a windowed one; `start` and `step` of a recursive.
        feed: what `trace` is fed.
        summary: how a log is summarised.
        step: its form on board, in `estimators.incremental`: by `feed`, of the window that ends
            now, of the samples since the window before, or of the samples of a manoeuvre.
        options: its options from the settings and the noise of the axis.
        takes_noise_off: whether it knows of noise in the regressor. The others take the regressor
            for exact, as (6) does, and that noise draws their estimates towards zero.
    """

    name: str
    title: str
    estimator: ModuleType
    feed: Feed
    summary: Summary
    step: Callable[..., Any]
    options: Callable[[MethodOptions, AxisNoise], Any]
    takes_noise_off: bool = False


def _by_name(*rows: Method) -> Mapping[str, Method]:
    return {row.name: row for row in rows}


METHODS: Final = _by_name(
    Method(
        "ls",
        "LS",
        ls,
        Feed.WINDOWS,
        Summary.MEAN,
        incremental.ls,
        lambda _, __: ls.LsOptions(),
    ),
    Method(
        "rls",
        "RLS",
        rls,
        Feed.SETTLED,
        Summary.LAST,
        incremental.rls,
        lambda chosen, _: rls.RlsOptions(chosen.forgetting, chosen.directional_forgetting),
    ),
    Method(
        "fgls",
        "FGLS",
        fgls,
        Feed.WINDOWS,
        Summary.MEAN,
        incremental.fgls,
        lambda chosen, _: fgls.FglsOptions(chosen.fgls_floor),
    ),
    Method(
        "tls",
        "TLS",
        tls,
        Feed.WINDOWS,
        Summary.MEAN,
        incremental.tls,
        lambda _, noise: noise.raw,
        takes_noise_off=True,
    ),
    Method(
        "pooled",
        "pooled LS",
        pooled,
        Feed.SEGMENTS,
        Summary.POOL,
        incremental.Pool.estimate,
        lambda _, noise: pooled.PooledOptions(noise.columns),
        takes_noise_off=True,
    ),
    Method(
        "huber",
        "Huber's regression",
        huber,
        Feed.WINDOWS,
        Summary.MEAN,
        incremental.huber,
        lambda chosen, _: huber.HuberOptions(chosen.huber_bend),
    ),
    Method(
        "rtls",
        "recursive TLS",
        rtls,
        Feed.SETTLED,
        Summary.LAST,
        incremental.rtls,
        lambda chosen, noise: rtls.RtlsOptions(noise.raw, chosen.forgetting),
        takes_noise_off=True,
    ),
)
