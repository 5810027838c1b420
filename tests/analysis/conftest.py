"""Synthetic straight drives: standstill, start, cruise, brake; with noise, from a seed."""

from dataclasses import dataclass, replace

import numpy as np
import polars as pl
import pytest

from analysis.model.machine import Machine
from analysis.stages.motion.forces import compute_excitation
from analysis.stages.motion.smooth import smooth_by_trailing_mean
from analysis.stages.signals.align import align_channels_on_grid
from analysis.stages.signals.derive import derive_channels_in_si, read_measured_channels
from analysis.stages.signals.rates import ChannelSamples
from analysis.stages.signals.timestamps import assign_timestamps
from tests.analysis.settings_by_name import staged

T0_NS = 1_700_000_000_000_000_000
RATE_HZ = 100
G = 9.80665


@dataclass(frozen=True)
class Drive:
    """What the sensors say at 100 Hz: every array is a row a sample."""

    force_x_N: np.ndarray
    speed_x_m_s: np.ndarray
    specific_force_x_m_s2: np.ndarray
    mass_kg: float
    friction_N_s_m: float

    @property
    def t_ns(self):
        return np.arange(self.force_x_N.size) * (1_000_000_000 // RATE_HZ)

    def but(self, **changes):
        """The same drive with some arrays replaced; a function is given the array."""
        return replace(
            self,
            **{
                name: change(getattr(self, name).copy()) if callable(change) else change
                for name, change in changes.items()
            },
        )


def make_drive(
    manoeuvres=("standstill", "start", "brake", "standstill"),
    seconds=(1.5, 5.0, 2.0, 1.5),
    mass_kg=3614.0,
    friction_N_s_m=2891.0,
    throttle_N=6000.0,
    direction=1.0,
    pitch_rad=0.0,
    noise=1.0,
    seed=1,
):
    """Drive the manoeuvres in their order; the force of a start rises steadily to the throttle."""
    samples = [round(s * RATE_HZ) for s in seconds]
    names = np.repeat(manoeuvres, samples)
    risen = np.concatenate([np.arange(n) / n for n in samples])
    speed = np.zeros(names.size)
    force = np.zeros(names.size)
    acc = np.zeros(names.size)
    v = 0.0
    for k, name in enumerate(names):
        push = {
            "start": throttle_N * risen[k],
            "cruise": friction_N_s_m * v,
            "brake": -throttle_N / 2 if v > 0.0 else 0.0,
            "standstill": 0.0,
        }[name]
        a = (push - friction_N_s_m * v) / mass_kg
        speed[k], acc[k], force[k] = v, a, push
        v = max(v + a / RATE_HZ, 0.0)
    slope = G * np.sin(pitch_rad)
    generator = np.random.default_rng(seed)
    sigma = noise * np.array([[60.0], [0.005], [0.01]])
    noises = sigma * generator.normal(size=(3, names.size))
    return Drive(
        direction * force + mass_kg * slope + noises[0],
        direction * speed + noises[1],
        direction * acc + slope + noises[2],
        mass_kg,
        friction_N_s_m,
    )


def make_machine(settings=None, body=None, **channels):
    """A machine that reads /can and /imu; a channel set to None is left out."""
    fields = {
        "force_x_N": {"topic": "/can", "field": "force"},
        "speed_x_m_s": {"topic": "/can", "field": "speed"},
        "specific_force_x_m_s2": {"topic": "/imu", "field": "x"},
        **channels,
    }
    return Machine.model_validate(
        {
            "machine": {"name": "loader", "empty_mass_kg": 3614.0, **(body or {})},
            "channels": {name: channel for name, channel in fields.items() if channel},
            "settings": staged(**(settings or {})),
        }
    )


def topic(t_ns, header="same", **fields):
    """A topic as a log reader gives it."""
    stamps = t_ns if isinstance(header, str) else header
    return pl.DataFrame(
        {"log_time_ns": t_ns, "header_stamp_ns": stamps, **fields},
        schema_overrides={"log_time_ns": pl.Int64, "header_stamp_ns": pl.Int64},
    )


def make_raw(drive):
    t_ns = T0_NS + drive.t_ns
    return {
        "/can": topic(t_ns, force=drive.force_x_N, speed=drive.speed_x_m_s),
        "/imu": topic(t_ns, x=drive.specific_force_x_m_s2),
    }


def make_channels(unix_ns=None, **columns):
    """Channels as `derive_channels_in_si` gives them, all at the same stamps."""
    channels = {}
    for name, x in columns.items():
        t, x = x if isinstance(x, tuple) else (unix_ns, x)
        channels[name] = ChannelSamples(np.asarray(t, np.int64), np.asarray(x, float))
    return channels


def make_excitation(drive, machine=None):
    """The drive through every stage up to `forces`."""
    machine = machine or make_machine()
    placed, _, _ = assign_timestamps(make_raw(drive))
    channels, _ = derive_channels_in_si(read_measured_channels(placed, machine)[0], machine)
    aligned, _ = align_channels_on_grid(channels, machine)
    return compute_excitation(smooth_by_trailing_mean(aligned, machine.settings.smooth), machine)


@pytest.fixture(scope="session")
def drive():
    return make_drive


@pytest.fixture(scope="session")
def machine():
    return make_machine


@pytest.fixture(scope="session")
def raw_topic():
    return topic


@pytest.fixture(scope="session")
def raw_of():
    return make_raw


@pytest.fixture(scope="session")
def channels_of():
    return make_channels


@pytest.fixture(scope="session")
def excitation_of():
    return make_excitation


@pytest.fixture(scope="module", autouse=True)
def without_fingerprint():
    """Nobody asks for it, and it takes a twentieth of a replay."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("analysis.model.run_record.Run.with_fingerprint", lambda run: run)
        yield
