"""Made-up runs with every frame of the schema: straight drives, a gap, five methods."""

from collections.abc import Callable
from functools import cache

import numpy as np
import polars as pl
import pytest

from analysis import InputFile, Loss, Provenance, Run, Settings
from analysis.model.schema import FRAMES, PHASE, REASON, conform_frame_to_schema

MASS_KG, FRICTION_N_S_M = 3500.0, 420.0
METHODS = ("ls", "rls", "fgls", "tls", "pooled")
T0_UNIX_NS = 1_700_000_000_123_456_789


@pytest.fixture(scope="session")
def drives() -> Callable[..., Run]:
    """A run of straight drives, with every frame: made once, to be looked at."""
    return cache(straight_drives)


def straight_drives(
    duration_s: float = 120.0,
    *,
    passed: bool = True,
    calibration: bool = True,
    accepted: bool = True,
) -> Run:
    """A machine of 3500 kg that starts, cruises, brakes and stands, to and fro."""
    rng = np.random.default_rng(7)
    t_s = np.arange(0.0, duration_s, 0.01)
    in_cycle = t_s % 12.0
    direction = np.where((t_s // 12.0) % 2 == 0, 1.0, -1.0)
    acc = direction * np.select(
        [in_cycle < 3.0, in_cycle < 6.0, in_cycle < 8.0], [0.6, 0.0, -0.9], 0.0
    )
    speed = direction * np.interp(in_cycle, [0, 3, 6, 8, 12], [0, 1.8, 1.8, 0, 0])
    force = MASS_KG * acc + FRICTION_N_S_M * speed + rng.normal(0, 60, t_s.size)
    gap = (t_s > 0.42 * duration_s) & (t_s < 0.47 * duration_s)
    t_ns = np.round(t_s * 1e9).astype(np.int64)
    phase = np.select(
        [in_cycle < 3.0, in_cycle < 6.0, in_cycle < 8.0],
        ["accelerating", "cruising", "braking"],
        "standstill",
    )
    noisy = {
        "regressor_acc_y_m_s2": rng.normal(0, 0.02, t_s.size),
        "regressor_acc_x_m_s2": acc + rng.normal(0, 0.02, t_s.size),
        "acc_x_m_s2": acc + rng.normal(0, 0.03, t_s.size),
        "specific_force_x_m_s2": acc + 0.05 + rng.normal(0, 0.02, t_s.size),
        "specific_force_y_m_s2": rng.normal(0, 0.02, t_s.size),
        "specific_force_z_m_s2": 9.81 + rng.normal(0, 0.02, t_s.size),
        "speed_rate_x_m_s2": acc,
        "yaw_acc_rad_s2": rng.normal(0, 0.01, t_s.size),
        "torque_z_N_m": rng.normal(0, 20, t_s.size),
        "roll_rate_rad_s": rng.normal(0, 0.01, t_s.size),
        "pitch_rate_rad_s": rng.normal(0, 0.01, t_s.size),
        "yaw_rate_rad_s": rng.normal(0, 0.01, t_s.size),
        "pitch_rad": 0.02 * np.sin(t_s / 9),
        "roll_rad": 0.01 * np.sin(t_s / 7),
        "boom_rad": 0.3 + 0.2 * np.sin(t_s / 20),
        "bucket_rad": 0.1 + 0.2 * np.sin(t_s / 20),
        "fuel_rate_L_h": 12.0 + 2.0 * np.sin(t_s / 20),
        "gear_ratio_1": np.where(t_s % 30 < 15, 12.0, 5.0),
        "latitude_deg": -33.0 + 1e-6 * t_s,
        "longitude_deg": -70.0 + 1e-6 * t_s,
        "force_x_N": force,
        "torque_left_N_m": force * 0.25,
        "torque_right_N_m": force * 0.25 + 10,
        "position_x_m": np.cumsum(speed) * 0.01,
        "speed_x_m_s": speed,
        "speed_left_m_s": speed * 1.01,
        "speed_right_m_s": speed * 0.99,
        "direction_x_1": np.sign(speed),
    }
    grid = pl.DataFrame({"t_ns": t_ns, **noisy}).with_columns(
        pl.when(~pl.Series(gap)).then(pl.exclude("t_ns")), gap=pl.Series(gap)
    )
    motion = grid.with_columns(phase=pl.when(~pl.Series(gap)).then(pl.Series(phase)).cast(PHASE))
    reason = np.select(
        [t_s < 3.2, gap, in_cycle > 6.0, in_cycle > 1.0],
        ["warming_up", "gap", "braking", "accepted" if accepted else "low_information"],
        "standstill",
    )
    gate = pl.DataFrame(
        {
            "t_ns": t_ns,
            "corr_x_1": 0.4 + 0.5 * np.sin(in_cycle / 4),
            "mi_x_nat": 0.2 + 0.9 * (reason == "accepted") + 0.05 * np.sin(t_s),
            "ksg_x_nat": 0.1 + 0.8 * (reason == "accepted"),
            "predicted_std_x": 30.0 + 400.0 * (reason != "accepted"),
            "noise_share_x_1": 0.01 + 0.4 * (reason != "accepted"),
            "accepted_x": reason == "accepted",
            "reason_x": reason,
            "corr_z_1": 0.3 * np.sin(t_s),
            "mi_z_nat": 0.1 + 0.05 * np.sin(t_s),
            "ksg_z_nat": 0.1 + 0.05 * np.cos(t_s),
            "predicted_std_z": np.full(t_s.size, 40.0),
            "noise_share_z_1": np.full(t_s.size, 0.6),
            "accepted_z": np.zeros(t_s.size, bool),
            "reason_z": ["translating"] * t_s.size,
        }
    ).with_columns(
        pl.col("reason_x", "reason_z").cast(REASON),
        pl.when(pl.col("reason_x") != "warming_up").then(pl.col("^(corr|mi|ksg|pred|noise).*$")),
    )
    frames = {
        "raw//torque": _raw(t_ns, force),
        "aligned": _declared("aligned", grid),
        "excitation": _declared("excitation", motion),
        "noise": _noise(),
        "gate": conform_frame_to_schema("gate", gate),
        **{f"estimates/{m}": _estimates(m, gate, rng) for m in METHODS},
        "segments": _segments(duration_s, accepted, rng),
        "planar": _planar(passed),
        "loads": _loads(accepted, passed),
        "nuisances": _nuisances(),
        "budget": _budget(),
        "masses": _masses(rng, accepted, passed),
        "verdict": _verdict(passed),
        "findings": _findings(),
    }
    if calibration:
        frames["calibration"] = _calibration(rng)
    return Run(frames, _provenance())


def _declared(name: str, frame: pl.DataFrame) -> pl.DataFrame:
    known = [column.name for column in FRAMES[name].columns]
    return conform_frame_to_schema(name, frame.select(c for c in frame.columns if c in known))


def _raw(t_ns: np.ndarray, force: np.ndarray) -> pl.DataFrame:
    stamps = T0_UNIX_NS + t_ns[::2]
    effort = np.where(np.arange(stamps.size) % 97 == 0, np.nan, force[::2])
    return pl.DataFrame(
        {
            "log_time_ns": stamps,
            "header_stamp_ns": stamps - 2_000_000,
            "effort[left]": effort,
            "header.frame_id": ["base"] * stamps.size,
        }
    )


def _theta(rng: np.random.Generator, n: int, std: float) -> dict[str, np.ndarray]:
    return {
        "mass_kg": MASS_KG + rng.normal(0, std, n),
        "mass_std_kg": np.full(n, std) * rng.uniform(0.8, 1.2, n),
        "friction_x_N_s_m": FRICTION_N_S_M + rng.normal(0, std / 5, n),
        "friction_x_std_N_s_m": np.full(n, std / 5),
        "coulomb_x_N": rng.normal(0, 10, n),
        "coulomb_x_std_N": np.full(n, 12.0),
        "inertia_z_kg_m2": 4200 + rng.normal(0, std, n),
        "inertia_z_std_kg_m2": np.full(n, std),
        "friction_z_N_m_s": 1500 + rng.normal(0, std / 2, n),
        "friction_z_std_N_m_s": np.full(n, std / 2),
        "residual_rms_N": rng.uniform(40, 80, n),
        "residual_rms_N_m": rng.uniform(20, 40, n),
        "condition_1": rng.uniform(2, 9, n),
    }


def _findings() -> pl.DataFrame:
    """A delay of the whole log, and a frozen channel in a part of it."""
    return conform_frame_to_schema(
        "findings",
        pl.DataFrame(
            {
                "rank": [1, 2],
                "cause": ["delay", "frozen"],
                "severity": ["widen", "withhold"],
                "channel": ["force_x_N", "speed_x_m_s"],
                "start_t_ns": [None, 7 * 10**9],
                "end_t_ns": [None, 9 * 10**9],
                "strength_1": [6.0, 2.0],
                "evidence": ["it is 42 ± 3 ms late", "the channel repeats one reading for 2.0 s"],
                "mass_change_kg": [123.4, None],
                "mass_change_u_kg": [10.0, None],
                "setting": ["channels.force_x_N.delay_s", None],
                "value": ["0.042", None],
                "alternatives": ["imu_low_passed", ""],
            }
        ),
    )


def _noise():
    return conform_frame_to_schema(
        "noise",
        pl.DataFrame(
            {
                "first": ["force_x_N"] * 2,
                "second": ["force_x_N", "speed_x_m_s"],
                "lag": [0, 1],
                "covariance": [3600.0, 0.0],
                "source": ["standstill", "setting"],
            }
        ),
    )


def _estimates(method: str, gate: pl.DataFrame, rng: np.random.Generator) -> pl.DataFrame:
    rows = gate.filter("accepted_x").select("t_ns")
    if method == "pooled":  # a row a manoeuvre, so every row stands alone
        rows = rows.filter(pl.col("t_ns").diff().fill_null(0) > 5e8)
    std = {"ls": 60.0, "rls": 30.0, "fgls": 40.0, "tls": 80.0, "pooled": 20.0}[method]
    theta = _theta(rng, rows.height, std)
    if method == "tls" and rows.height:
        theta["mass_kg"][:: max(rows.height // 10, 1)] = 2.5e6  # a few are wild
    rows = rows.with_columns(axis=pl.lit("x"))
    return conform_frame_to_schema(
        "estimates", rows.with_columns(**{k: pl.Series(v) for k, v in theta.items()})
    )


def _segments(duration_s: float, accepted: bool, rng: np.random.Generator) -> pl.DataFrame:
    starts = np.arange(0.0, duration_s - 8.0, 12.0)
    n = starts.size
    weighed = pl.Series(np.arange(n) % 4 != 3) & accepted
    theta = {
        k: pl.select(pl.when(weighed).then(pl.Series(v))).to_series()
        for k, v in _theta(rng, n, 25.0).items()
    }
    start_ns = np.round(starts * 1e9).astype(np.int64)
    frame = pl.DataFrame(
        {
            "segment_id": np.arange(n),
            "start_t_ns": start_ns,
            "end_t_ns": start_ns + 6_000_000_000,
            "phase": ["accelerating"] * n,
            "samples": [600] * n,
            "samples_accepted": [500] * n,
            **theta,
            "reason": ["accepted" if w else "low_information" for w in weighed],
        }
    )
    return conform_frame_to_schema("segments", frame)


def _planar(passed: bool) -> pl.DataFrame:
    """Two arcs, the fit of both, and the fit of all motion."""
    told = dict.fromkeys(("com_y_m", "com_y_std_m"))
    n = 4
    numbers = {
        column.name: [float(3 + i) if passed else None for i in range(n)]
        for column in FRAMES["planar"].columns
        if column.dtype.is_float()
    }
    rows = {
        **numbers,
        **{name: [None, None, None, 0.01 if passed else None] for name in told},
        "com_x_m": [0.13 if passed else None] * n,
        "com_x_std_m": [0.004 if passed else None] * n,
        "kind": ["arc", "arc", "arcs", "joint"],
        "start_t_ns": [5 * 10**9, 15 * 10**9, 5 * 10**9, 0],
        "end_t_ns": [9 * 10**9, 19 * 10**9, 19 * 10**9, 50 * 10**9],
        "samples": [400, 400, 800, 5000],
        "rank": [1, 1, 1, 5],
        "identifiable": ["first_moment_x_kg_m"] * n,
        "combinations": ["", "", "", "mass_kg - 5 first_moment_y_kg_m"],
        "withheld": [not passed] * n,
        "reason": ["accepted"] * n,
    }
    return conform_frame_to_schema("planar", pl.DataFrame(rows))


def _masses(rng: np.random.Generator, accepted: bool, passed: bool) -> pl.DataFrame:
    n = len(METHODS)
    theta = _theta(rng, n, 22.0)
    if not (accepted and passed):
        theta = {k: [None] * n for k in theta}
    known = {c.name for c in FRAMES["masses"].columns}
    columns = {
        "method": METHODS,
        **{k: v for k, v in theta.items() if k in known},
        "rows": [1200] * n,
        "rows_z": [0] * n,
        "withheld": [not passed] * n,
        "withheld_z": [not passed] * n,
    }
    others = ("method", "rows", "rows_z", "withheld", "withheld_z")
    frame = pl.DataFrame(columns).with_columns(pl.exclude(others).cast(pl.Float64))
    return conform_frame_to_schema(
        "masses", frame.with_columns(payload_kg=pl.col("mass_kg") - 2850.0)
    )


def _loads(accepted: bool, passed: bool) -> pl.DataFrame:
    """One load, the whole log's."""
    numbers = {
        "mass_kg": MASS_KG,
        "u_kg": 41.0,
        "u_random_kg": 9.0,
        "u_common_kg": 40.0,
        "payload_kg": MASS_KG - 2850.0,
        "payload_u_kg": 41.0,
        "friction_x_N_s_m": FRICTION_N_S_M,
        "friction_x_std_N_s_m": 60.0,
        "mass_halved_priors_kg": MASS_KG + 3.0,
        "mass_doubled_priors_kg": MASS_KG - 4.0,
    }
    told = accepted and passed
    reason = "" if told else "relative_std" if accepted else "no manoeuvre was informative enough"
    rows = {
        "load_id": [0],
        "start_t_ns": [0],
        "end_t_ns": [110 * 10**9],
        "manoeuvres": [9 if accepted else 0],
        **{name: [value if told else None] for name, value in numbers.items()},
        "mean_samples": [20],
        "braking_left_out": [False],
        "scale_unknown": ["force_gain"],
        "withheld": [not told],
        "withheld_for": [reason],
    }
    return conform_frame_to_schema("loads", pl.DataFrame(rows))


def _nuisances() -> pl.DataFrame:
    return conform_frame_to_schema(
        "nuisances",
        pl.DataFrame(
            {
                "term": ["const", "lag"],
                "unit": ["N", "s"],
                "prior_std": [300.0, 0.02],
                "posterior": [120.0, -0.003],
                "posterior_std": [40.0, 0.001],
                "u_kg": [12.0, 1.5],
                "meaning": ["a constant force", "how late the force is"],
            }
        ),
    )


def _budget() -> pl.DataFrame:
    return conform_frame_to_schema(
        "budget",
        pl.DataFrame(
            {
                "cause": ["const", "noise", "force_gain"],
                "kind": ["common", "random", "scale"],
                "u_kg": [40.0, 9.0, None],
                "share_1": [0.95, 0.05, None],
                "meaning": ["a constant force", "noise of this log", "gain of the force sensors"],
                "shrinks": ["starts in both directions", "more starts", "known loads"],
            }
        ),
    )


def _verdict(passed: bool) -> pl.DataFrame:
    frame = pl.DataFrame(
        {
            "check": ["partial_correlation", "relative_std", "acceleration_gain"],
            "about": ["mass", "mass", "mass"],
            "value": [0.93 if passed else 0.12, 0.02 if passed else 0.8, None],
            "minimum": [0.5, None, 0.5],
            "maximum": [None, 0.25, 2.0],
            "passed": [passed, passed, None],
            "meaning": [
                "how well acceleration explains force once speed is accounted for",
                "standard deviation of the mass over the mass, all moving samples",
                "wheel acceleration over IMU acceleration",
            ],
            "consequence": ["withhold"] * 3,
            "remedy": ["", "more starts", ""],
        },
        schema_overrides={"value": pl.Float64, "passed": pl.Boolean},
    )
    return conform_frame_to_schema("verdict", frame)


def _calibration(rng: np.random.Generator) -> pl.DataFrame:
    loads = np.array([0.0, 260.0, 640.0, 910.0])
    parts = []
    for number, method in enumerate(METHODS):
        reference = 2850.0 + loads
        estimate = reference * (1.05 + 0.01 * number) - 90 + rng.normal(0, 12, loads.size)
        alpha, beta = np.polyfit(estimate, reference, 1)
        error = alpha * estimate + beta - reference
        parts.append(
            pl.DataFrame(
                {
                    "method": [method] * loads.size,
                    "load_kg": loads,
                    "reference_kg": reference,
                    "runs": [5] * loads.size,
                    "estimate_kg": estimate,
                    "estimate_std_kg": rng.uniform(10, 30, loads.size),
                    "alpha_1": [alpha] * loads.size,
                    "beta_kg": [beta] * loads.size,
                    "calibrated_kg": reference + error,
                    "error_kg": error,
                    "error_left_out_kg": error * 1.8,
                }
            )
        )
    return conform_frame_to_schema("calibration", pl.concat(parts))


def _provenance() -> Provenance:
    return Provenance(
        inputs=(InputFile(name="shift.bag", sha256="ab" * 32, size_bytes=123_456_789),),
        machine={
            "machine": {
                "name": "CAT 262C",
                "timezone": "America/Santiago",
                "empty_mass_kg": 2850.0,
            },
            "channels": {"force_x_N": {"topic": "/torque", "field": "effort[left]"}},
        },
        settings=Settings(),
        versions={"payscope": "0.1.0", "polars": pl.__version__},
        t0_unix_ns=T0_UNIX_NS,
        stamps={"/torque": "header"},
        losses=(Loss(source="shift.bag", topic="/imu", what="3 messages could not be decoded"),),
        notes=("The force share of the measured wheels is assumed to be 1.",),
    )
