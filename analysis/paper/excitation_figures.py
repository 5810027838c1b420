"""Figures 2 to 4: the excitation, and the estimates obtained with it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from analysis.model.schema import get_column_values
from analysis.model.settings import Settings
from analysis.paper import printed_numbers
from analysis.paper.paper_limits import LIMITS
from analysis.paper.replayed_campaign import ReplayedCampaign, rerun_estimates_on_accepted_windows
from analysis.paper.simulated_sources import LINEAR, ROTATION, Extract
from analysis.stages.gating.gate import gate_windows
from estimators.arrays import Bools, Floats
from estimators.estimate import Trace
from estimators.methods import fgls, ls, rls, tls
from estimators.planar import planar_rows


@dataclass(frozen=True, eq=False)
class Figure2:
    """Motion, time constant of the machine, and relative remainder of a step response after T."""

    frame: pl.DataFrame
    constant_s: float
    unsettled_1: float


def make_figure_2_excitation_data(campaign: ReplayedCampaign) -> Figure2:
    """Force, acceleration and speed under the triangle."""
    truth = campaign.trials.row(0, named=True)
    constant_s = truth["mass_kg"] / truth["friction_N_s_m"]
    return Figure2(
        frame=_select_plotted_rows(campaign.replayed.frames["excitation"]).select(
            "t_s", "force_x_N", "regressor_acc_x_m_s2", "speed_x_m_s"
        ),
        constant_s=constant_s,
        unsettled_1=float(np.exp(-printed_numbers.RESPONSE_S / constant_s)),
    )


class EarlyAndLateRms(NamedTuple):
    """Root mean square errors of the mass in kg: in the first `converging_s`, and later."""

    early_kg: float
    later_kg: float


@dataclass(frozen=True, eq=False)
class Figure3:
    """Estimates over time in a linear motion.

    Attributes:
        frame: one row per instant and method, with the truth.
        true_mass_kg: true mass.
        rms_kg: r.m.s. error by method over the whole figure.
        converging: early and late errors of LS and RLS.
        memory_samples: effective number of samples in the memory of RLS.
        window_samples: window of the other methods.
    """

    frame: pl.DataFrame
    true_mass_kg: float
    rms_kg: Mapping[str, float]
    converging: Mapping[str, EarlyAndLateRms]
    memory_samples: float
    window_samples: int


def make_figure_3_convergence_data(campaign: ReplayedCampaign) -> Figure3:
    """Mass and friction over time under the triangular force."""
    rate_hz = campaign.settings.align.rate_hz
    settings = campaign.settings.copy_with_changes(
        {
            "gate.window_samples": round(LIMITS.optimal_window_s * rate_hz),
            "trace.methods": printed_numbers.METHODS,
            # here the drive slows the machine down, not the brakes
            "gate.exclude_braking": False,
        }
    )
    estimates = estimate_from_complete_windows(campaign, settings).replayed.frames
    truth = campaign.trials.row(0, named=True)
    series = pl.concat(
        _select_plotted_rows(estimates[f"estimates/{method}"]).select(
            "t_s",
            pl.lit(method).alias("method"),
            "mass_kg",
            "mass_std_kg",
            "friction_x_N_s_m",
            "friction_x_std_N_s_m",
            true_mass_kg=pl.lit(truth["mass_kg"]),
            true_friction_x_N_s_m=pl.lit(truth["friction_N_s_m"]),
        )
        for method in printed_numbers.METHODS
    )
    return Figure3(
        frame=series,
        true_mass_kg=truth["mass_kg"],
        rms_kg=compute_rms_error_by_method(series, "mass_kg", "true_mass_kg"),
        converging=compute_converging_and_later_rms_errors(series),
        memory_samples=(1.0 + settings.trace.forgetting) / (1.0 - settings.trace.forgetting),
        window_samples=settings.gate.window_samples,
    )


@dataclass(frozen=True, eq=False)
class Figure4:
    """Estimates over time in a rotation.

    Attributes:
        frame: one row per instant and method, with the truth.
        true_inertia_z_kg_m2: the yaw inertia.
        true_friction_z_N_m_s: true friction of turning.
        rms_kg_m2: r.m.s. error by method over the whole figure.
        bias_kg_m2: mean error by method, over the whole figure.
    """

    frame: pl.DataFrame
    true_inertia_z_kg_m2: float
    true_friction_z_N_m_s: float
    rms_kg_m2: Mapping[str, float]
    bias_kg_m2: Mapping[str, float]


def make_figure_4_spin_data(campaign: ReplayedCampaign) -> Figure4:
    """Yaw inertia and friction over time under a triangular torque, by the yaw row of (8)."""
    excitation = campaign.replayed.frames["excitation"]
    A = planar_rows.make_spin_regressor(
        get_column_values(excitation, "yaw_acc_rad_s2"),
        get_column_values(excitation, "yaw_rate_rad_s"),
    )
    A, f = np.ascontiguousarray(A), get_column_values(excitation, "torque_z_N_m")
    rate_hz = campaign.settings.align.rate_hz
    window = round(LIMITS.optimal_window_s * rate_hz)
    known = np.isfinite(A).all(axis=1) & np.isfinite(f)
    # without the brakes at the end, which (8) does not model
    known &= excitation["t_ns"].to_numpy() <= round(LIMITS.figure_s * 1e9)
    complete = np.convolve(known, np.ones(window))[: f.size] > window - 0.5
    standing = np.flatnonzero(np.isfinite(f))[-round(LIMITS.standing_s * rate_hz) :]
    noise = (*A[standing].std(axis=0), f[standing].std())
    truth = campaign.trials.row(0, named=True)
    series = pl.concat(
        _make_spin_series(
            method, _trace_estimates_of_method(method, A, f, window, complete, noise), excitation
        )
        for method in printed_numbers.METHODS
    ).with_columns(
        true_inertia_z_kg_m2=pl.lit(truth["inertia_z_kg_m2"]),
        true_friction_z_N_m_s=pl.lit(truth["friction_z_N_m_s"]),
    )
    biases = series.group_by("method").agg(
        (pl.col("inertia_z_kg_m2") - pl.col("true_inertia_z_kg_m2")).mean()
    )
    return Figure4(
        frame=series,
        true_inertia_z_kg_m2=truth["inertia_z_kg_m2"],
        true_friction_z_N_m_s=truth["friction_z_N_m_s"],
        rms_kg_m2=compute_rms_error_by_method(series, "inertia_z_kg_m2", "true_inertia_z_kg_m2"),
        bias_kg_m2=dict(biases.iter_rows()),
    )


def estimate_from_complete_windows(
    campaign: ReplayedCampaign, settings: Settings
) -> ReplayedCampaign:
    """Estimates from every complete window in the figure, without the end of the drive."""
    gated = gate_windows(campaign.replayed.frames["excitation"], settings)
    incomplete = pl.col("reason_x").cast(pl.String).is_in(("warming_up", "gap"))
    shown = ~incomplete & (pl.col("t_ns") <= round(LIMITS.figure_s * 1e9))
    return rerun_estimates_on_accepted_windows(
        campaign, gated.with_columns(accepted_x=shown), settings
    )


def _trace_estimates_of_method(
    method: str,
    A: Floats,
    f: Floats,
    window: int,
    is_complete_window: Bools,
    noise: tuple[float, ...],
) -> Trace:
    match method:
        case "ls":
            return ls.estimate_along_log(A, f, window, is_complete_window)
        case "rls":
            return rls.estimate_along_log(A, f, window, is_complete_window)
        case "fgls":
            return fgls.estimate_along_log(A, f, window, is_complete_window)
        case _:
            return tls.estimate_along_log(
                A, f, window, is_complete_window, tls.TlsOptions(noise[:-1], noise[-1])
            )


def _make_spin_series(method: str, spin_trace: Trace, excitation: pl.DataFrame) -> pl.DataFrame:
    return _select_plotted_rows(
        pl.DataFrame(
            {
                "t_ns": excitation["t_ns"].to_numpy()[spin_trace.index],
                "method": [method] * spin_trace.index.size,
                "inertia_z_kg_m2": spin_trace.theta[:, 0],
                "inertia_z_std_kg_m2": spin_trace.std[:, 0],
                "friction_z_N_m_s": spin_trace.theta[:, 1],
                "friction_z_std_N_m_s": spin_trace.std[:, 1],
            }
        )
    ).drop("t_ns")


def _select_plotted_rows(frame: pl.DataFrame) -> pl.DataFrame:
    seconds = frame.with_columns(t_s=pl.col("t_ns") / 1e9)
    return seconds.filter(pl.col("t_s") <= LIMITS.figure_s)


def compute_rms_error_by_method(
    series: pl.DataFrame, value: str, true_column: str
) -> dict[str, float]:
    """R.m.s. error of each method over the whole figure."""
    errors = series.group_by("method", maintain_order=True).agg(
        ((pl.col(value) - pl.col(true_column)) ** 2).mean().sqrt()
    )
    return dict(errors.iter_rows())


def compute_converging_and_later_rms_errors(series: pl.DataFrame) -> dict[str, EarlyAndLateRms]:
    """R.m.s. error of LS and RLS in the first `converging_s`, and later."""
    squares = series.with_columns(
        square=(pl.col("mass_kg") - pl.col("true_mass_kg")) ** 2,
        early=pl.col("t_s") < pl.col("t_s").min() + LIMITS.converging_s,
    )
    rms = {
        (method, early): float(np.sqrt(square))
        for method, early, square in squares.group_by("method", "early")
        .agg(pl.col("square").mean())
        .iter_rows()
    }
    return {
        method: EarlyAndLateRms(rms[method, True], rms[method, False]) for method in ("ls", "rls")
    }


FIGURE_2: Final = Extract(LINEAR, make_figure_2_excitation_data)
FIGURE_3: Final = Extract(LINEAR, make_figure_3_convergence_data)
FIGURE_4: Final = Extract(ROTATION, make_figure_4_spin_data)
