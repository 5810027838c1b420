"""Noise of every column of the equations, from standstill and motion of the log.

At standstill a column shows noise only, so all its covariances can be estimated. In motion,
vibration is added, and only fast changes are certain to be noise: where their power exceeds that at
standstill, the noise is scaled up by the ratio. The noise of a column that is constant at
standstill (a quantised speed) is estimated from fast changes alone; slow noise, which the motion
hides, follows from the channel's processing: white noise is level, a derivative's falls to 0 Hz.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from analysis.model.axes import YAW_COLUMNS
from analysis.model.machine import Machine
from analysis.model.schema import NOISE_COLUMNS, NOISE_SOURCES, build_frame, get_column_values
from analysis.model.settings import NoiseSettings
from analysis.stages.motion.forces import (
    compute_longitudinal_force,
    compute_regressor_acceleration,
    compute_yaw_torque,
)
from analysis.stages.noise.grid_noise import (
    ColumnProcessing,
    flag_columns_with_noise_hidden_by_grid,
    list_column_processing,
    simulate_noise_covariances_on_grid,
)
from analysis.stages.noise.noise_limits import LIMITS
from analysis.stages.noise.noise_spectra import (
    LAGS,
    RESIDUALS,
    SPREAD,
    average_over_neighbouring_frequencies,
    choose_overlapping_block_ends,
    choose_relative_noise_band,
    compute_cross_spectra,
    compute_mean_block_spectrum,
    compute_quantisation_covariances,
    convert_spectra_to_covariances,
    cut_into_detrended_pieces,
    estimate_lag_covariances,
    find_flagged_spans,
    find_resolution_of_column,
    limit_noise_covariances_in_place,
    list_block_frequencies_per_sample,
    list_spectrum_frequencies,
    trim_stretch_to_settled_rows,
)
from analysis.stages.signals.mounting import Series
from estimators.arrays import Bools, Floats, Ints

#: Description of each source of noise other than the grid itself.
_INSTEAD: Final[Mapping[str, str]] = {
    "samples": "estimated from the raw samples and propagated through filter and derivative, "
    "because the grid is too coarse to show it",
    RESIDUALS: "limited to the residual of force and motion, because its fast changes contain "
    "motion",
    SPREAD: "limited to the variation of the whole column, because its fast changes exceed that",
}


@dataclass(frozen=True, slots=True)
class NoiseSamples:
    """Columns of one axis on the grid, and the samples to analyse.

    Attributes:
        x: (rows, columns) values; NaN if missing.
        quiet: first and end row of each standstill, away from stops and starts.
        moving: (rows,) whether the machine moves.
        still_blocks: last rows of the blocks in `quiet`.
        moving_blocks: last rows of the blocks in motion.
        every_block: last rows of the blocks over all samples.
        rate_hz: rate of the grid.
    """

    x: Floats
    quiet: list[tuple[int, int]]
    moving: Bools
    still_blocks: Ints
    moving_blocks: Ints
    every_block: Ints
    rate_hz: float

    @property
    def min_relative_frequency(self) -> float:
        """Lowest frequency, over the rate, from which all changes are noise."""
        return choose_relative_noise_band(self.rate_hz)[0]

    @property
    def max_relative_frequency(self) -> float:
        """Upper end, over the rate, of the noise band whose level extends to lower frequencies."""
        return choose_relative_noise_band(self.rate_hz)[1]


def estimate_channel_noise(
    aligned: pl.DataFrame,
    excitation: pl.DataFrame,
    machine: Machine,
    channels: Mapping[str, Series] | None = None,
) -> pl.DataFrame:
    """Estimate the noise of each axis' columns, on the grid before the moving mean.

    Args:
        aligned: the grid.
        excitation: frame with the phases.
        machine: machine file with the columns' sources; its noise settings override the log.
        channels: raw readings by channel, for noise that the grid hides; None without them.

    Returns:
        `noise`: a row per pair of columns and lag.
    """
    rate_hz = machine.settings.align.rate_hz
    gap = aligned["gap"].to_numpy()
    columns = compute_equation_columns_by_name(aligned, machine)
    phase = excitation["phase"]
    stands = (phase == "standstill").fill_null(False).to_numpy()
    moves = phase.is_not_null().to_numpy() & ~stands
    tables: list[pl.DataFrame] = []
    for declared in NOISE_COLUMNS.values():
        axis = {name: setting for name, setting in declared.items() if name in columns}
        if not axis:
            continue
        x = np.column_stack([columns[name] for name in axis])
        known = np.isfinite(x).all(axis=1) & ~gap
        samples = _select_standing_and_moving_samples(
            x, stands & known, moves & known, known, rate_hz
        )
        made = list_column_processing(tuple(axis), machine)
        found, sources = estimate_covariances_and_sources(samples, made)
        if channels is not None:
            replace_noise_hidden_by_grid(found, sources, tuple(axis), machine, channels)
        limit_noise_covariances_in_place(
            found, sources, x, samples.moving, [each.derivative_of for each in made]
        )
        override_noise_by_settings(found, sources, axis, machine.settings.noise)
        tables.append(_make_noise_frame(tuple(axis), found, sources))
    return build_frame("noise", pl.concat(tables).to_dict())


def list_noise_source_notes(noise: pl.DataFrame) -> list[str]:
    """Notes on columns whose noise does not come from the grid, with the source used instead.

    Args:
        noise: frame from `estimate_channel_noise`.
    """
    own = noise.filter((pl.col("first") == pl.col("second")) & (pl.col("lag") == 0))
    said: list[str] = []
    for source, why in _INSTEAD.items():
        names = own.filter(pl.col("source") == source)["first"].to_list()
        if names:
            said.append(f"noise of {', '.join(names)}: {why}")
    return said


def replace_noise_hidden_by_grid(
    covariances: Floats,
    sources: list[str],
    column_names: tuple[str, ...],
    machine: Machine,
    channels: Mapping[str, Series],
) -> None:
    """Replace noise that the grid hides by that of the channels' own samples, in place."""
    beyond = [source == "differences" for source in sources]
    unseen = (
        np.array(
            flag_columns_with_noise_hidden_by_grid(
                [list_channels_of_column(name, machine) for name in column_names], machine, channels
            )
        )
        & beyond
    )
    if not unseen.any():
        return

    def grid_columns(aligned: pl.DataFrame) -> Floats:
        columns = compute_equation_columns_by_name(aligned, machine)
        x = np.column_stack([columns[name] for name in column_names])
        return np.where(aligned["gap"].to_numpy()[:, None], np.nan, x)

    simulated = simulate_noise_covariances_on_grid(channels, machine, grid_columns)
    if simulated is None:
        return
    for column in np.flatnonzero(unseen):
        covariances[column, :] = np.where(unseen[:, None], simulated[column, :], 0.0)
        covariances[:, column] = np.where(unseen[:, None], simulated[:, column], 0.0)
        sources[column] = "samples"


def list_channels_of_column(column_name: str, machine: Machine) -> tuple[str, ...]:
    """Channels that a column of the equations is computed from."""
    if column_name == "regressor_acc_x_m_s2":
        kinematic = machine.settings.forces.acceleration == "kinematic"
        return ("acc_x_m_s2",) if kinematic else ("specific_force_x_m_s2",)
    if column_name in machine.channels:
        return (column_name,)
    return ("torque_left_N_m", "torque_right_N_m")


def compute_equation_columns_by_name(aligned: pl.DataFrame, machine: Machine) -> dict[str, Floats]:
    """Columns of the force and yaw equations, (rows,) each, by name."""
    body = machine.machine
    columns = {
        "regressor_acc_x_m_s2": compute_regressor_acceleration(aligned, machine),
        "speed_x_m_s": get_column_values(aligned, "speed_x_m_s"),
        "force_x_N": compute_longitudinal_force(aligned, body),
    }
    torque = compute_yaw_torque(aligned, body)
    columns |= {} if torque is None else {"torque_z_N_m": torque}
    return columns | {
        name: get_column_values(aligned, name)
        for name in YAW_COLUMNS
        if name in aligned.columns and name not in columns
    }


def _select_standing_and_moving_samples(
    columns: Floats, standing: Bools, is_moving: Bools, is_known: Bools, rate_hz: float
) -> NoiseSamples:
    """Select the settled part of each standstill, and the samples in motion."""
    after = round(LIMITS.settle_after_stop_s * rate_hz)
    before = round(LIMITS.settle_before_start_s * rate_hz)
    quiet = [
        (a + after, b - before) for a, b in find_flagged_spans(standing) if b - before > a + after
    ]
    quiet = quiet[:: max(len(quiet) // LIMITS.max_standstills, 1)]
    quiet = [trim_stretch_to_settled_rows(columns, start, end) for start, end in quiet]
    still = np.zeros(standing.size, np.bool_)
    for start, end in quiet:
        still[start:end] = True
    return NoiseSamples(
        x=columns,
        quiet=quiet,
        moving=is_moving,
        still_blocks=choose_overlapping_block_ends(still),
        moving_blocks=choose_overlapping_block_ends(is_moving),
        every_block=choose_overlapping_block_ends(is_known),
        rate_hz=rate_hz,
    )


def estimate_covariances_and_sources(
    samples: NoiseSamples, column_processing: list[ColumnProcessing]
) -> tuple[Floats, list[str]]:
    """Covariances (columns, columns, LAGS), and the source of each column's noise."""
    p = samples.x.shape[1]
    cut = cut_into_detrended_pieces(samples.x, samples.quiet)
    found = estimate_lag_covariances(cut) if cut else np.zeros((p, p, LAGS))
    live = [bool(cut) and has_noise_at_standstill(samples, cut, column) for column in range(p)]
    powers = [
        compute_mean_block_spectrum(
            samples.x[:, column], samples.moving_blocks, samples.min_relative_frequency
        )
        for column in range(p)
    ]
    spectra = compute_cross_spectra(found)
    for column in np.flatnonzero(~np.array(live)):
        spectra[column, :] = 0.0
        spectra[:, column] = 0.0
    for column in range(p):
        if not live[column]:
            power = powers[column]
            if power is None:
                power = compute_mean_block_spectrum(
                    samples.x[:, column], samples.every_block, samples.min_relative_frequency
                )
            if power is not None:
                # a column whose reading mostly stays the same has at least the noise of rounding
                level = fit_spectrum_to_fast_band(power[0], column_processing[column], samples)
                spectra[column, column] = np.maximum(
                    level, estimate_rounding_variance(samples, column)
                )
    # a column and its derivative share one noise
    at = list_spectrum_frequencies()
    for column, how in enumerate(column_processing):
        of = how.derivative_of
        if of >= 0 and not (live[column] and live[of]):
            shared = np.sqrt(np.maximum(spectra[column, column] * spectra[of, of], 0.0))
            slope = how.compute_derivative_response(at)
            turn = slope / np.maximum(np.abs(slope), np.finfo(float).tiny)
            spectra[of, column] = shared * turn
            spectra[column, of] = shared * turn.conj()
    for column in range(p):
        step = find_resolution_of_column(samples.x[:, column], samples.moving)
        coarse = (
            step is not None
            and step**2 / 12.0 > convert_spectra_to_covariances(spectra)[column, column, 0]
        )
        if step is not None and coarse:
            own = compute_quantisation_covariances(samples.x[:, column], samples.moving, step)
            spectra[column, column] = compute_cross_spectra(own[None, None])[0, 0]
            live[column] = False
    grown = [
        estimate_noise_growth_in_motion(samples, column, powers[column])
        if live[column]
        else np.ones(at.size)
        for column in range(p)
    ]
    for i in range(p):
        for j in range(p):
            spectra[i, j] *= np.sqrt(grown[i] * grown[j])
    return convert_spectra_to_covariances(spectra), [
        "standstill" if alive else "differences" for alive in live
    ]


def estimate_rounding_variance(samples: NoiseSamples, column: int) -> float:
    """Variance up to which a column's changes count as rounding."""
    return (
        LIMITS.rounding_range_fraction * float(np.nanmax(np.abs(samples.x[:, column]), initial=0.0))
    ) ** 2


def has_noise_at_standstill(samples: NoiseSamples, pieces: list[Floats], column: int) -> bool:
    """Whether a column varies at standstill, with several values in most pieces."""
    least = estimate_rounding_variance(samples, column)
    noisy = [float((part[:, column] ** 2).mean()) > least for part in pieces]
    many = [
        np.unique(samples.x[start : min(end, start + LAGS), column]).size
        > LIMITS.constant_max_values
        for start, end in samples.quiet
        if end > start
    ]
    return float(np.mean(noisy)) > 0.5 and float(np.mean(many)) > 0.5


def fit_spectrum_to_fast_band(
    block_power: Floats, column_processing: ColumnProcessing, samples: NoiseSamples
) -> Floats:
    """Noise spectrum (frequencies,) of a column, at `list_spectrum_frequencies`.

    Below the fast band it is extrapolated from the level in the band.
    """
    at, wanted = list_block_frequencies_per_sample(), list_spectrum_frequencies()
    response = column_processing.compute_power_response(at)
    fast = samples.min_relative_frequency
    band = (at >= fast) & (at <= samples.max_relative_frequency) & (response > 0.0)
    level = float(np.mean(block_power[band] / response[band]))
    seen = np.interp(wanted, at[1:], average_over_neighbouring_frequencies(block_power, 1)[1:])
    return np.where(wanted < fast, level * column_processing.compute_power_response(wanted), seen)


def estimate_noise_growth_in_motion(
    samples: NoiseSamples, column: int, moving: tuple[Floats, int] | None
) -> Floats:
    """Ratio, at least 1, of power in motion to standstill, at `list_spectrum_frequencies`."""
    at, wanted = list_block_frequencies_per_sample(), list_spectrum_frequencies()
    resting = compute_mean_block_spectrum(
        samples.x[:, column], samples.still_blocks, samples.min_relative_frequency
    )
    if moving is None or resting is None:
        return np.ones(wanted.size)
    still = resting[0]
    told = (at >= samples.min_relative_frequency) & (
        still > LIMITS.growth_stop_band_fraction * np.nanmax(still)
    )
    ratio = np.where(told, moving[0] / np.where(told, still, 1.0), np.nan)
    # half-overlapping blocks count three quarters, and neighbouring frequencies two thirds
    error = np.sqrt((1.0 / moving[1] + 1.0 / resting[1]) / 0.75)
    band = told & (at <= samples.max_relative_frequency)
    below = float(np.median(ratio[band])) if band.any() else 1.0
    limit = 1.0 + LIMITS.growth_min_std * error * np.sqrt(1.5 / max(band.sum(), 1))
    below = below if below > limit else 1.0
    near = np.where(told, average_over_neighbouring_frequencies(ratio, 2), 1.0)
    near = np.where(near > 1.0 + LIMITS.growth_min_std * error * np.sqrt(1.5 / 5.0), near, 1.0)
    return np.where(wanted < samples.min_relative_frequency, below, np.interp(wanted, at, near))


def override_noise_by_settings(
    covariances: Floats, sources: list[str], axis: Mapping[str, str], settings: NoiseSettings
) -> None:
    """Replace the noise of each column whose standard deviation is set by white noise, in place."""
    for column, name in enumerate(axis.values()):
        std = getattr(settings, name)
        if std is not None:
            covariances[column, :] = 0.0
            covariances[:, column] = 0.0
            covariances[column, column, 0] = std**2
            sources[column] = "setting"


def _make_noise_frame(
    column_names: tuple[str, ...], covariances: Floats, sources: list[str]
) -> pl.DataFrame:
    p = len(column_names)
    rank = np.array([NOISE_SOURCES.index(source) for source in sources])
    first, second, lag = (axis.ravel() for axis in np.indices((p, p, LAGS)))
    return pl.DataFrame(
        {
            "first": np.array(column_names)[first],
            "second": np.array(column_names)[second],
            "lag": lag,
            "covariance": covariances.ravel(),
            # a pair of columns comes from the log if both do
            "source": np.array(NOISE_SOURCES)[np.maximum(rank[first], rank[second])],
        }
    )
