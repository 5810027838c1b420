"""Spikes: single readings far from both neighbours, such as error codes and bit errors."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.findings.cause import Symptom
from analysis.findings.channel_limits import LIMITS
from analysis.findings.finding_inputs import ACCELERATIONS, FORCES, FindingInputs
from analysis.findings.refit import compute_mass_change_by_refit_without_samples
from analysis.findings.sampling_causes import measure_repeat_fraction_and_resolution
from analysis.model.uncertainty_sources import STD_OF_MAD
from analysis.model.windows import flag_rows_near_flagged_rows
from analysis.stages.signals.filters import compute_median_period_ns
from estimators.arrays import Bools, Floats, Ints

#: Channels of force and acceleration, which a stop or a knock changes immediately.
_FELT: Final = (*FORCES, *ACCELERATIONS)


@dataclass(frozen=True, slots=True)
class ChannelSpikes:
    """The spikes of a channel.

    Attributes:
        unix_ns: (k,) Unix time of each spike.
        median_distance: median distance of a spike from the mean of its neighbours, in SI units.
        largest_distance_std: largest such distance, in standard deviations of the channel's noise.
        near: (n,) True for grid samples next to a spike.
    """

    unix_ns: Ints
    median_distance: float
    largest_distance_std: float
    near: Bools

    @property
    def strength(self) -> float:
        """Distance of the farthest spike over its threshold; larger for more spikes."""
        often = float(np.sqrt(min(self.unix_ns.size, 25)))
        return self.largest_distance_std / LIMITS.spike_std * often / LIMITS.single_spike_ratio


def find_spikes(inputs: FindingInputs) -> list[Symptom]:
    """Find single readings far from both neighbours, which agree with each other."""
    by_channel = get_spikes_by_channel(inputs)
    if not by_channel:
        return []
    channel, spikes = max(by_channel.items(), key=lambda each: each[1].strength)
    first_ns, last_ns = int(spikes.unix_ns[0]), int(spikes.unix_ns[-1])
    setting, value = inputs.propose_valid_range_settings(channel)
    return [
        Symptom(
            spikes.strength,
            f"{spikes.unix_ns.size} single readings differ from their neighbours by "
            f"{spikes.median_distance:.3g} (median), up to {spikes.largest_distance_std:.0f} "
            "standard deviations",
            channel=channel,
            span_ns=inputs.convert_unix_to_aligned_ns(first_ns, last_ns),
            setting=setting,
            value=value,
            change=lambda: compute_mass_change_by_refit_without_samples(inputs, spikes.near),
        )
    ]


def get_spikes_by_channel(inputs: FindingInputs) -> dict[str, ChannelSpikes]:
    """Spikes by channel; channels without spikes are absent."""
    if "spikes" not in inputs.cache:
        inputs.cache["spikes"] = _find_spikes_by_channel(inputs)
    return inputs.cache["spikes"]  # type: ignore[return-value]


def _find_spikes_by_channel(inputs: FindingInputs) -> dict[str, ChannelSpikes]:
    found: dict[str, ChannelSpikes] = {}
    for name in inputs.equation_channels_in_log:
        t, x = inputs.unfiltered_readings[name]
        if x.size < 3 * LIMITS.spike_block_readings:
            continue
        middle = x[1:-1] - (x[:-2] + x[2:]) / 2.0
        # a coarse channel deviates by one step now and then
        resolution = measure_repeat_fraction_and_resolution(inputs, name)[1]
        scale = np.maximum(estimate_robust_std_of_blocks(middle), resolution / np.sqrt(12.0))
        far = np.abs(middle) > LIMITS.spike_std * scale
        far &= np.abs(x[2:] - x[:-2]) < LIMITS.spike_neighbour_fraction * np.abs(middle)
        places = np.flatnonzero(far) + 1
        places = places[~mark_stamps_of_jolts(inputs, name, t[places], np.sign(middle[places - 1]))]
        if not places.size:
            continue
        size = np.abs(middle[places - 1])
        found[name] = ChannelSpikes(
            t[places],
            float(np.median(size)),
            min(float(np.max(size / scale[places - 1])), LIMITS.spike_max_std),
            mark_samples_near_stamps(inputs, t[places]),
        )
    return found


def mark_stamps_of_jolts(inputs: FindingInputs, channel: str, unix_ns: Ints, sign: Floats) -> Bools:
    """Whether force and acceleration jump together at each stamp, (k,), as at a knock."""
    topic = inputs.machine.channels[channel].topic
    felt = np.zeros(unix_ns.size, np.bool_)
    if channel not in _FELT or not unix_ns.size:
        return felt
    for other in inputs.select_measured_channels(*_FELT):
        t, x = inputs.unfiltered_readings[other]
        if (
            inputs.machine.channels[other].topic == topic
            or x.size < 3 * LIMITS.spike_block_readings
        ):
            continue
        scale = estimate_robust_std_of_blocks(x[1:-1] - (x[:-2] + x[2:]) / 2.0)
        near_ns = LIMITS.jolt_periods * max(
            map(compute_median_period_ns, (t, inputs.unfiltered_readings[channel][0]))
        )
        ends = np.searchsorted(t, unix_ns[:, None] + np.array([-near_ns, near_ns], np.int64))
        around = np.searchsorted(
            t, unix_ns[:, None] + np.array([-LIMITS.jolt_around_ns, LIMITS.jolt_around_ns])
        )
        for k, (here, about) in enumerate(zip(ends, around, strict=True)):
            if here[0] == here[1]:
                continue
            off = sign[k] * (x[slice(*here)] - np.median(x[slice(*about)]))
            felt[k] |= bool(np.max(off) > LIMITS.jolt_std * scale[min(here[0], scale.size - 1)])
    return felt


def estimate_robust_std_of_blocks(readings: Floats) -> Floats:
    """Robust std of the block around each sample, (n,), but at least that of all samples."""
    size = readings.size // LIMITS.spike_block_readings * LIMITS.spike_block_readings
    blocks = STD_OF_MAD * np.median(
        np.abs(readings[:size]).reshape(-1, LIMITS.spike_block_readings), axis=1
    )
    # include the adjacent blocks: a start is sharper than the samples around it
    around = np.maximum(blocks, np.maximum(np.append(blocks[1:], 0.0), np.append(0.0, blocks[:-1])))
    around = np.maximum(around, np.median(blocks))
    out = np.repeat(around, LIMITS.spike_block_readings)
    return np.append(out, np.full(readings.size - size, around[-1] if around.size else 0.0))


def mark_samples_near_stamps(inputs: FindingInputs, stamps_unix_ns: Ints) -> Bools:
    """Whether each grid sample is next to one of the given stamps, (n,)."""
    t = inputs.aligned["t_ns"].to_numpy() + inputs.check_inputs.t0_unix_ns
    at = np.zeros(t.size, np.bool_)
    at[np.clip(np.searchsorted(t, stamps_unix_ns), 0, t.size - 1)] = True
    return flag_rows_near_flagged_rows(at, LIMITS.spike_margin_samples)


def mark_samples_near_spikes(inputs: FindingInputs) -> Bools:
    """Whether each grid sample is next to a spike of any channel, (n,)."""
    near = np.zeros(inputs.aligned.height, np.bool_)
    for each in get_spikes_by_channel(inputs).values():
        near |= each.near
    return near
