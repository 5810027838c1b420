"""What Figures 2 to 4 draw: the excitation, and the estimates under it."""

from typing import Final

import numpy as np
import polars as pl

from analysis.gate import gate
from analysis.reproduction import paper
from analysis.reproduction.campaign import Campaign, accepting
from analysis.reproduction.item import NAMES, NO_NUMBERS, Item, listed, percent
from analysis.schema import values
from analysis.settings import Settings
from estimators import fgls, ls, planar_rows, rls, tls
from estimators.estimate import Floats, Trace

#: The window that the text calls optimal.
WINDOW_S: Final = 10.0
_SHOWN_S: Final = 60.0
#: At the end of a log the machine stands: so long, noise is all that there is.
_STANDING_S: Final = 4.0
_EARLY_S: Final = 10.0
_NO_GATE: Final = "Every complete window is used: the paper does not say that it gates here."


def fig_2_item(campaign: Campaign) -> Item:
    """Force, acceleration and speed under the triangle, from a replay of `excited`."""
    series = _shown(campaign.replayed.frames["excitation"]).select(
        "t_s", "force_x_N", "regressor_acc_x_m_s2", "speed_x_m_s"
    )
    truth = campaign.runs.row(0, named=True)
    constant_s = truth["mass_kg"] / truth["friction_N_s_m"]
    return Item(
        "fig2",
        "Figure 2: force, acceleration and speed under the triangular force",
        (
            "0 to 6 kN with a period of 15 s, from standing, with the noise of Table 1 and the "
            "moving mean.",
        ),
        series,
        (
            f"The machine's time constant m/b is {constant_s:.2f} s; the paper's response time "
            f"T ≈ {paper.RESPONSE_S:g} s is where a step has settled to "
            f"{percent(np.exp(-paper.RESPONSE_S / constant_s))}, and its period 3 T lets it settle "
            "twice.",
            "The triangle as printed, (A/T)|t mod T - T/2| + f0, is highest at t = 0 and ranges "
            "over A/2, not A.",
            NO_NUMBERS,
        ),
    )


def fig_3_item(campaign: Campaign) -> Item:
    """Mass and friction over time under the triangular force."""
    rate_hz = campaign.settings.align.rate_hz
    settings = campaign.settings.changed(
        {
            "gate.window_samples": round(WINDOW_S * rate_hz),
            "trace.methods": paper.METHODS,
            # the drive itself slows the machine down
            "gate.exclude_braking": False,
        }
    )
    estimates = _driven(campaign, settings).replayed.frames
    truth = campaign.runs.row(0, named=True)
    series = pl.concat(
        _shown(estimates[f"estimates/{method}"]).select(
            "t_s",
            pl.lit(method).alias("method"),
            "mass_kg",
            "mass_std_kg",
            "friction_x_N_s_m",
            "friction_x_std_N_s_m",
            true_mass_kg=pl.lit(truth["mass_kg"]),
            true_friction_x_N_s_m=pl.lit(truth["friction_N_s_m"]),
        )
        for method in paper.METHODS
    )
    return Item(
        "fig3",
        "Figure 3: mass and friction in a linear motion, window of 10 s",
        (_NO_GATE,),
        series,
        (
            _within(series, "mass_kg", "true_mass_kg", "kg"),
            _converging(series, settings),
            NO_NUMBERS,
        ),
    )


def fig_4_item(campaign: Campaign) -> Item:
    """Yaw inertia and friction over time under a triangular torque, by the yaw row of (8)."""
    excitation = campaign.replayed.frames["excitation"]
    A = planar_rows.spin(values(excitation, "yaw_acc_rad_s2"), values(excitation, "yaw_rate_rad_s"))
    A, f = np.ascontiguousarray(A), values(excitation, "torque_z_N_m")
    rate_hz = campaign.settings.align.rate_hz
    window = round(WINDOW_S * rate_hz)
    known = np.isfinite(A).all(axis=1) & np.isfinite(f)
    # the brakes that end the drive are no part of (8)
    known &= excitation["t_ns"].to_numpy() <= round(_SHOWN_S * 1e9)
    complete = np.convolve(known, np.ones(window))[: f.size] > window - 0.5
    standing = np.flatnonzero(np.isfinite(f))[-round(_STANDING_S * rate_hz) :]
    noise = (*A[standing].std(axis=0), f[standing].std())
    truth = campaign.runs.row(0, named=True)
    series = pl.concat(
        _spin_series(method, _trace(method, A, f, window, complete, noise), excitation)
        for method in paper.METHODS
    ).with_columns(
        true_inertia_z_kg_m2=pl.lit(truth["inertia_z_kg_m2"]),
        true_friction_z_N_m_s=pl.lit(truth["friction_z_N_m_s"]),
    )
    return Item(
        "fig4",
        "Figure 4: yaw inertia and friction in a rotational motion, window of 10 s",
        (
            _NO_GATE,
            "The paper gives neither inertia nor torque: "
            f"{truth['inertia_z_kg_m2']:g} kg·m², {truth['friction_z_N_m_s']:g} N·m·s and 0 to "
            "3 kN·m are assumed. The yaw acceleration is the gyroscope's derivative; TLS takes "
            "its noise from the standstill at the end.",
            "The yaw row of (8) alone: its other two rows, as printed, hold for I13 = I23 = 0 "
            "only.",
        ),
        series,
        (
            _within(series, "inertia_z_kg_m2", "true_inertia_z_kg_m2", "kg·m²"),
            _attenuated(series),
            NO_NUMBERS,
        ),
    )


def _driven(campaign: Campaign, settings: Settings) -> Campaign:
    """Estimates from every complete window that the figure shows: the end of the drive is not."""
    gated = gate(campaign.replayed.frames["excitation"], settings)
    incomplete = pl.col("reason_x").cast(pl.String).is_in(("warming_up", "gap"))
    shown = ~incomplete & (pl.col("t_ns") <= round(_SHOWN_S * 1e9))
    return accepting(campaign, gated.with_columns(accepted_x=shown), settings)


def _trace(
    method: str, A: Floats, f: Floats, window: int, complete: np.ndarray, noise: tuple[float, ...]
) -> Trace:
    match method:
        case "ls":
            return ls.trace(A, f, window, complete)
        case "rls":
            return rls.trace(A, f, window, complete)
        case "fgls":
            return fgls.trace(A, f, window, complete)
        case _:
            return tls.trace(A, f, window, complete, tls.TlsOptions(noise[:-1], noise[-1]))


def _spin_series(method: str, traced: Trace, excitation: pl.DataFrame) -> pl.DataFrame:
    return _shown(
        pl.DataFrame(
            {
                "t_ns": excitation["t_ns"].to_numpy()[traced.index],
                "method": [method] * traced.index.size,
                "inertia_z_kg_m2": traced.theta[:, 0],
                "inertia_z_std_kg_m2": traced.std[:, 0],
                "friction_z_N_m_s": traced.theta[:, 1],
                "friction_z_std_N_m_s": traced.std[:, 1],
            }
        )
    ).drop("t_ns")


def _shown(frame: pl.DataFrame) -> pl.DataFrame:
    seconds = frame.with_columns(t_s=pl.col("t_ns") / 1e9)
    return seconds.filter(pl.col("t_s") <= _SHOWN_S)


def _within(series: pl.DataFrame, value: str, true: str, unit: str) -> str:
    """How far each method strays from the truth over the whole figure."""
    rms = series.group_by("method", maintain_order=True).agg(
        ((pl.col(value) - pl.col(true)) ** 2).mean().sqrt()
    )
    told = listed(f"{NAMES[method]} {error:.0f} {unit}" for method, error in rms.iter_rows())
    true_value = series[true][0]
    return f"R.m.s. over the figure about the true {true_value:g} {unit}: {told}."


def _attenuated(series: pl.DataFrame) -> str:
    """What the noise of the differentiated gyroscope does to LS."""
    biases = dict(
        series.group_by("method")
        .agg((pl.col("inertia_z_kg_m2") - pl.col("true_inertia_z_kg_m2")).mean())
        .iter_rows()
    )
    return (
        f"The noise of a differentiated gyroscope biases LS by {biases['ls']:+.0f} kg·m², and FGLS "
        f"with it; TLS, which knows that noise, by {biases['tls']:+.0f} kg·m²."
    )


def _converging(series: pl.DataFrame, settings: Settings) -> str:
    """How LS and RLS stray at first, and later."""
    squares = series.with_columns(
        square=(pl.col("mass_kg") - pl.col("true_mass_kg")) ** 2,
        early=pl.col("t_s") < pl.col("t_s").min() + _EARLY_S,
    )
    rms = {
        (method, early): float(np.sqrt(square))
        for method, early, square in squares.group_by("method", "early")
        .agg(pl.col("square").mean())
        .iter_rows()
    }
    memory = (1.0 + settings.trace.forgetting) / (1.0 - settings.trace.forgetting)
    later = rms["rls", False] / rms["ls", False]
    alike = 0.8 < later < 1.25
    told = "about as sensitive to noise as" if alike else "less sensitive to noise than"
    told = "more sensitive to noise than" if later >= 1.25 else told
    return (
        f"In the first {_EARLY_S:g} s after the first window RLS strays by "
        f"{rms['rls', True]:.0f} kg r.m.s., LS by {rms['ls', True]:.0f} kg; later by "
        f"{rms['rls', False]:.0f} and {rms['ls', False]:.0f} kg. RLS is slower to converge, as the "
        "paper says: it starts from the OLS estimate of the first window, but with P0 = I/σ² it "
        f"takes that for little more than a guess. Later it is {told} LS: its weights are worth "
        f"(1 + λ)/(1 - λ) = {memory:.0f} samples, a window of {WINDOW_S:g} s holds "
        f"{settings.gate.window_samples}."
    )
