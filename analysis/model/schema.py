"""Every column of every frame, declared once: name, unit, dtype, meaning, sign.

Missing values are null. `t_ns` counts from the first aligned sample. A frame contains some or all
of its declared columns, in the declared order; `raw/<topic>` contains the stamps and fields of its
topic.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from polars.datatypes import DataTypeClass

from analysis.model.column_arrays import ColumnArrays

PHASES: Final = ("standstill", "accelerating", "cruising", "braking", "spinning", "arc", "turning")
REASONS: Final = (
    "accepted",
    "warming_up",
    "gap",
    "no_variance",
    "low_information",
    "negative_dependence",
    "braking",
    "standstill",
    "turning",
    "translating",
    "saturated",
    "slip",
    "ill_conditioned",
    "noise_limited",
    "digging",
)
AXES: Final = ("x", "z")
#: Sources of a noise estimate: standstill; fast changes on the grid, or of the channels' own
#: samples; residuals of the equation, or spread of the column, where these are smaller; a setting.
NOISE_SOURCES: Final = (
    *("standstill", "differences", "samples", "residuals", "spread"),
    "setting",
)
#: The columns of each axis that have noise, the force last, and the settings that override it.
NOISE_COLUMNS: Final[Mapping[str, Mapping[str, str]]] = {
    "x": {
        "regressor_acc_x_m_s2": "acc_m_s2",
        "speed_x_m_s": "speed_m_s",
        "force_x_N": "force_N",
    },
    "z": {
        "yaw_acc_rad_s2": "yaw_acc_rad_s2",
        "yaw_rate_rad_s": "yaw_rate_rad_s",
        "torque_z_N_m": "torque_z_N_m",
    },
}
#: Subject of a row of `responses` that is about the scale instead of a learnt term.
SCALE: Final = "scale"
#: Quantities that respond: mass of a load, its payload relative to the empty loads, payload of a
#: cycle.
MASS_KINDS: Final = ("mass", "payload", "cycle")
#: Columns of `loads` that a calibration adds.
CALIBRATED: Final = (
    "calibrated_kg",
    "calibrated_u_kg",
    "calibrated_low_kg",
    "calibrated_high_kg",
    "calibrated_reason",
    "calibrated_unlike_u_kg",
    "calibrated_said",
    "calibrated_payload_kg",
    "calibrated_payload_u_kg",
    "calibrated_payload_low_kg",
    "calibrated_payload_high_kg",
)
#: Qualities of a cycle's payload.
QUALITIES: Final = ("good", "weak", "not dumped", "no mass")
QUALITY: Final = pl.Enum(QUALITIES)
PHASE: Final = pl.Enum(PHASES)
REASON: Final = pl.Enum(REASONS)


@dataclass(frozen=True, slots=True)
class Column:
    """One column, whose name ends in its unit; `unit` is the same unit ("1": dimensionless)."""

    name: str
    dtype: pl.DataType | DataTypeClass
    unit: str
    meaning: str


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame and its columns."""

    name: str
    meaning: str
    columns: tuple[Column, ...]

    @property
    def time_column(self) -> str | None:
        """Name of the column that orders rows in time (t_ns, start_t_ns, log_time_ns), or None."""
        names = {column.name for column in self.columns}
        return next((n for n in ("t_ns", "start_t_ns", "log_time_ns") if n in names), None)

    def column(self, name: str) -> Column | None:
        """Declaration of a column; None if not declared."""
        return next((column for column in self.columns if column.name == name), None)


def make_float_column(name: str, unit: str, meaning: str) -> Column:
    """Declare a column of float64 numbers."""
    return Column(name, pl.Float64, unit, meaning)


_T = Column("t_ns", pl.Int64, "ns", "time since the first aligned sample")

_FORCE = (
    make_float_column(
        "torque_left_N_m", "N·m", "wheel torque of the left side, positive drives forward"
    ),
    make_float_column(
        "torque_right_N_m", "N·m", "wheel torque of the right side, positive drives forward"
    ),
    make_float_column(
        "force_x_N", "N", "longitudinal force of all driven wheels (17), positive drives forward"
    ),
    make_float_column(
        "torque_z_N_m", "N·m", "yaw torque about the vertical (18), positive turns left"
    ),
)
_MOTION = (
    make_float_column("position_x_m", "m", "travelled position, positive forward"),
    make_float_column("speed_left_m_s", "m/s", "speed of the left wheels, positive forward"),
    make_float_column("speed_right_m_s", "m/s", "speed of the right wheels, positive forward"),
    make_float_column("speed_x_m_s", "m/s", "longitudinal speed, positive forward"),
    make_float_column(
        "acc_x_m_s2", "m/s²", "kinematic longitudinal acceleration (no gravity in it)"
    ),
    make_float_column("specific_force_x_m_s2", "m/s²", "accelerometer along x, gravity included"),
    make_float_column(
        "specific_force_y_m_s2", "m/s²", "accelerometer along y (left), gravity included"
    ),
    make_float_column("specific_force_z_m_s2", "m/s²", "accelerometer along z (up), +9.81 at rest"),
    make_float_column("roll_rate_rad_s", "rad/s", "gyroscope about x"),
    make_float_column("pitch_rate_rad_s", "rad/s", "gyroscope about y"),
    make_float_column("yaw_rate_rad_s", "rad/s", "gyroscope about z, positive turns left"),
    make_float_column("yaw_acc_rad_s2", "rad/s²", "yaw acceleration, positive turns left"),
    make_float_column("pitch_rad", "rad", "pitch, positive nose-up (REP-103 is the opposite)"),
    make_float_column("roll_rad", "rad", "roll, positive right side down"),
)
_HINTS = (
    make_float_column("boom_rad", "rad", "boom angle, positive up"),
    make_float_column("bucket_rad", "rad", "bucket angle, positive curled up"),
    make_float_column("latitude_deg", "°", "latitude"),
    make_float_column("longitude_deg", "°", "longitude"),
    make_float_column("fuel_rate_L_h", "L/h", "rate at which the engine burns fuel"),
    make_float_column(
        "gear_ratio_1", "1", "turns of the engine or turbine for one of the wheels, in any scale"
    ),
)
_DIRECTION = make_float_column(
    "direction_x_1",
    "1",
    "sign of the longitudinal speed at its own rate, gridded like the others: the Coulomb column",
)

#: Channels that no estimate needs, so that gaps or delays of them affect nothing else.
HINTS: Final = frozenset(column.name for column in _HINTS)
#: The columns that a machine file's channels may fill.
CHANNEL_COLUMNS: Final = (*_FORCE, *_MOTION, *_HINTS)

_THETA = (
    make_float_column("mass_kg", "kg", "estimated mass"),
    make_float_column(
        "mass_std_kg",
        "kg",
        "its standard deviation (sandwich, autocorrelation pooled over the log)",
    ),
    make_float_column("friction_x_N_s_m", "N·s/m", "estimated viscous friction"),
    make_float_column("friction_x_std_N_s_m", "N·s/m", "its standard deviation"),
    make_float_column(
        "coulomb_x_N", "N", "estimated Coulomb friction, where the setting asks for it"
    ),
    make_float_column("coulomb_x_std_N", "N", "its standard deviation"),
)
_SPIN = (
    make_float_column(
        "inertia_z_kg_m2", "kg·m²", "estimated inertia about the vertical through the origin"
    ),
    make_float_column("inertia_z_std_kg_m2", "kg·m²", "its standard deviation"),
    make_float_column("friction_z_N_m_s", "N·m·s", "estimated viscous friction of turning"),
    make_float_column("friction_z_std_N_m_s", "N·m·s", "its standard deviation"),
)
_FIT = (
    make_float_column("residual_rms_N", "N", "r.m.s. of the force residuals"),
    make_float_column("residual_rms_N_m", "N·m", "r.m.s. of the yaw torque residuals"),
    make_float_column(
        "condition_1", "1", "condition number of the regressor, columns scaled to unit norm"
    ),
)

FRAMES: Final[dict[str, Frame]] = {
    frame.name: frame
    for frame in (
        Frame(
            "aligned",
            "the channels on one grid, SI units, machine axes",
            (
                _T,
                *CHANNEL_COLUMNS,
                _DIRECTION,
                Column(
                    "gap",
                    pl.Boolean,
                    "1",
                    "true where a channel other than a hint has no near sample on both sides",
                ),
            ),
        ),
        Frame(
            "excitation",
            "force and motion after the trailing moving mean, and the phase of motion",
            (
                _T,
                make_float_column(
                    "force_x_N", "N", "longitudinal force of all driven wheels, smoothed"
                ),
                make_float_column("torque_z_N_m", "N·m", "yaw torque (18), smoothed"),
                make_float_column(
                    "regressor_acc_x_m_s2", "m/s²", "regressor of the mass in (7), gravity included"
                ),
                make_float_column(
                    "regressor_acc_y_m_s2", "m/s²", "specific force of the origin to the left"
                ),
                make_float_column("speed_x_m_s", "m/s", "longitudinal speed, smoothed"),
                _DIRECTION,
                make_float_column(
                    "speed_rate_x_m_s2", "m/s²", "rate of the longitudinal speed, for the phases"
                ),
                *(c for c in _MOTION if c.name not in ("position_x_m", "speed_x_m_s")),
                Column("phase", PHASE, "1", "phase of motion, from v·dv/dt and the yaw rate"),
            ),
        ),
        Frame(
            "noise",
            "noise of the columns of each axis before the moving mean: a row for each pair and lag",
            (
                Column("first", pl.String, "1", "column of `excitation` that comes first"),
                Column("second", pl.String, "1", "column that comes `lag` samples later"),
                Column("lag", pl.Int64, "1", "samples between the two"),
                make_float_column(
                    "covariance", "1", "covariance of the two, in the product of their units"
                ),
                Column("source", pl.Enum(NOISE_SOURCES), "1", "samples from which it is estimated"),
            ),
        ),
        Frame(
            "gate",
            "statistics of the window that ends here, and the gate's decision",
            (
                _T,
                make_float_column(
                    "corr_x_1", "1", "correlation of acceleration and force over the window"
                ),
                make_float_column("mi_x_nat", "nat", "information index (11) of the window"),
                make_float_column(
                    "ksg_x_nat", "nat", "mutual information by nearest neighbours (index = ksg)"
                ),
                make_float_column(
                    "predicted_std_x", "kg", "predicted standard deviation of the mass"
                ),
                make_float_column(
                    "noise_share_x_1",
                    "1",
                    "share of noise in the variance that the acceleration explains",
                ),
                Column("accepted_x", pl.Boolean, "1", "whether the window is used"),
                Column("reason_x", REASON, "1", "why, or why not"),
                make_float_column(
                    "corr_z_1", "1", "correlation of yaw acceleration and torque over the window"
                ),
                make_float_column("mi_z_nat", "nat", "information index (11) of the window, yaw"),
                make_float_column(
                    "ksg_z_nat", "nat", "the same by nearest neighbours, yaw (index = ksg)"
                ),
                make_float_column(
                    "predicted_std_z", "kg·m²", "predicted standard deviation of the inertia"
                ),
                make_float_column(
                    "noise_share_z_1",
                    "1",
                    "share of noise in the variance that the yaw acceleration explains",
                ),
                Column("accepted_z", pl.Boolean, "1", "whether the window is used for inertia"),
                Column("reason_z", REASON, "1", "why, or why not"),
            ),
        ),
        Frame(
            "digging",
            "a row for each start whose resistance grows: a bucket driven into a pile, not weighed",
            (
                Column("start_t_ns", pl.Int64, "ns", "its first sample that drives"),
                Column("end_t_ns", pl.Int64, "ns", "its last sample that drives"),
                make_float_column("growth_N", "N", "by how much the resistance grows"),
                make_float_column("growth_std_N", "N", "its standard deviation"),
            ),
        ),
        Frame(
            "estimates",
            "accepted windows only, a row for each window of one axis",
            (
                _T,
                Column("axis", pl.Enum(AXES), "1", "x: straight motion (7); z: spins (8)"),
                *_THETA,
                *_SPIN,
                *_FIT,
            ),
        ),
        Frame(
            "segments",
            "a row for each manoeuvre, pooled over its accepted samples",
            (
                Column("segment_id", pl.Int64, "1", "number of the manoeuvre in the log"),
                Column("start_t_ns", pl.Int64, "ns", "its first sample"),
                Column("end_t_ns", pl.Int64, "ns", "its last sample"),
                Column("phase", PHASE, "1", "its most informative phase"),
                Column("samples", pl.Int64, "1", "samples in it"),
                Column("samples_accepted", pl.Int64, "1", "samples in an accepted window"),
                *_THETA,
                *_SPIN,
                *_FIT,
                Column("reason", REASON, "1", "accepted, or why it has no mass"),
            ),
        ),
        Frame(
            "planar",
            "a row for each arc or joint fit: centre of mass, parameters the motion determines",
            (
                Column("kind", pl.String, "1", "arc, arcs (all of them together) or joint"),
                Column("start_t_ns", pl.Int64, "ns", "its first sample"),
                Column("end_t_ns", pl.Int64, "ns", "its last sample"),
                Column("samples", pl.Int64, "1", "samples in it"),
                make_float_column("speed_x_m_s", "m/s", "mean longitudinal speed"),
                make_float_column("yaw_rate_rad_s", "rad/s", "mean yaw rate"),
                make_float_column("com_x_m", "m", "centre of mass ahead of the origin"),
                make_float_column("com_x_std_m", "m", "its standard uncertainty"),
                make_float_column("com_y_m", "m", "centre of mass to the left of the origin"),
                make_float_column("com_y_std_m", "m", "its standard uncertainty"),
                make_float_column(
                    "predicted_std_com_m", "m", "predicted standard deviation of com_x_m"
                ),
                *_THETA[:4],
                *_SPIN,
                make_float_column(
                    "first_moment_x_kg_m", "kg·m", "mass times centre of mass, ahead"
                ),
                make_float_column("first_moment_x_std_kg_m", "kg·m", "its standard deviation"),
                make_float_column(
                    "first_moment_y_kg_m", "kg·m", "mass times centre of mass, to the left"
                ),
                make_float_column("first_moment_y_std_kg_m", "kg·m", "its standard deviation"),
                *_FIT,
                make_float_column("r_squared_x_1", "1", "share of the force's variance explained"),
                make_float_column(
                    "r_squared_z_1", "1", "share of the yaw torque's variance explained"
                ),
                Column("rank", pl.Int64, "1", "how many numbers the motion determines"),
                Column("identifiable", pl.String, "1", "the parameters it determines"),
                Column(
                    "combinations",
                    pl.String,
                    "1",
                    "combinations of the others that the motion determines",
                ),
                Column(
                    "scale_unknown",
                    pl.String,
                    "1",
                    "sources without an uncertainty in the machine file, of inertia and moments",
                ),
                Column(
                    "com_scale_unknown",
                    pl.String,
                    "1",
                    "sources without an uncertainty in the machine file, of the centre of mass",
                ),
                Column("withheld", pl.Boolean, "1", "true when the verdict withholds the numbers"),
                Column("reason", REASON, "1", "accepted, or why it has no number"),
            ),
        ),
        Frame(
            "planar_budget",
            "a row for each source of the uncertainty of each quantity that all motion "
            "determines, by size",
            (
                Column("quantity", pl.String, "1", "inertia, a first moment or a centre of mass"),
                Column("cause", pl.String, "1", "where it comes from"),
                Column("kind", pl.String, "1", "random, common or scale"),
                make_float_column(
                    "u", "1", "standard uncertainty in `unit` (null where it is not known)"
                ),
                Column("unit", pl.String, "1", "of the quantity"),
                make_float_column("share_1", "1", "share of the variance"),
                Column("meaning", pl.String, "1", "what it is"),
                Column("shrinks", pl.String, "1", "what would reduce it"),
            ),
        ),
        Frame(
            "masses",
            "a row for each method: the mass over the whole log (null where it is withheld)",
            (
                Column("method", pl.String, "1", "estimator"),
                *_THETA,
                make_float_column("payload_kg", "kg", "mass less the machine's empty mass"),
                *_SPIN,
                Column("rows", pl.Int64, "1", "estimates it summarises"),
                Column("rows_z", pl.Int64, "1", "estimates of spins that it summarises"),
                Column("withheld", pl.Boolean, "1", "true when the verdict withholds the mass"),
                Column(
                    "withheld_z", pl.Boolean, "1", "true when the verdict withholds the inertia"
                ),
            ),
        ),
        Frame(
            "loads",
            "the answer: a row for each load, with its uncertainty",
            (
                Column("load_id", pl.Int64, "1", "number of the load"),
                Column("start_t_ns", pl.Int64, "ns", "its first fitted sample"),
                Column("end_t_ns", pl.Int64, "ns", "its last fitted sample"),
                Column("manoeuvres", pl.Int64, "1", "manoeuvres that were fitted"),
                make_float_column(
                    "mass_kg", "kg", "mass by the joint fit (null where it is withheld)"
                ),
                make_float_column(
                    "u_kg", "kg", "its standard uncertainty: random, common and scale"
                ),
                make_float_column(
                    "u_random_kg", "kg", "the part that more starts would average out"
                ),
                make_float_column(
                    "u_common_kg",
                    "kg",
                    "the part shared by all loads of the log: nuisance terms, scale",
                ),
                make_float_column(
                    "payload_kg", "kg", "mass less that of an empty state, or the empty mass"
                ),
                make_float_column("payload_u_kg", "kg", "its standard uncertainty"),
                make_float_column(
                    "payload_u_random_kg", "kg", "the part that more starts would average out"
                ),
                make_float_column("own_payload_kg", "kg", "payload on the scale of the log alone"),
                make_float_column("own_payload_u_kg", "kg", "its standard uncertainty"),
                make_float_column(
                    "own_payload_u_random_kg", "kg", "the part that more starts would average out"
                ),
                Column(
                    "payload_to",
                    pl.Int64,
                    "1",
                    "load_id of the empty load that the payload is measured from (null: the stated "
                    "empty mass)",
                ),
                Column("empty", pl.Boolean, "1", "true when it is taken as empty"),
                make_float_column(
                    "scatter_kg", "kg", "standard deviation between manoeuvres of one load"
                ),
                Column("scatter_known", pl.Boolean, "1", "true if enough manoeuvres determine it"),
                make_float_column("friction_x_N_s_m", "N·s/m", "viscous friction by the joint fit"),
                make_float_column("friction_x_std_N_s_m", "N·s/m", "its standard deviation"),
                make_float_column(
                    "mass_halved_priors_kg", "kg", "the mass with priors half as wide"
                ),
                make_float_column(
                    "mass_doubled_priors_kg", "kg", "the mass with priors twice as wide"
                ),
                Column("mean_samples", pl.Int64, "1", "samples of the mean that was fitted"),
                Column("braking_left_out", pl.Boolean, "1", "true when braking disagreed"),
                Column(
                    "scale_unknown",
                    pl.String,
                    "1",
                    "sources without an uncertainty in the machine file",
                ),
                Column(
                    "payload_scale_unknown",
                    pl.String,
                    "1",
                    "the part of these that affects the payload; the empty machine determines "
                    "the rest",
                ),
                Column("withheld", pl.Boolean, "1", "true when the verdict withholds the mass"),
                Column(
                    "withheld_for", pl.String, "1", "why there is no mass; empty if there is one"
                ),
                Column("said", pl.String, "1", "notes on the loads"),
                make_float_column(
                    "calibrated_kg", "kg", "mass under the calibration, where one was given"
                ),
                make_float_column("calibrated_u_kg", "kg", "its standard uncertainty"),
                make_float_column("calibrated_low_kg", "kg", "lower end of its interval"),
                make_float_column("calibrated_high_kg", "kg", "upper end of its interval"),
                Column(
                    "calibrated_reason",
                    pl.String,
                    "1",
                    "why there is no calibrated mass; empty if there is one",
                ),
                make_float_column(
                    "calibrated_unlike_u_kg",
                    "kg",
                    "part of its u due to manoeuvres unlike the campaign's",
                ),
                Column("calibrated_said", pl.String, "1", "notes for the reader"),
                make_float_column("calibrated_payload_kg", "kg", "payload under the calibration"),
                make_float_column("calibrated_payload_u_kg", "kg", "its standard uncertainty"),
                make_float_column("calibrated_payload_low_kg", "kg", "lower end of its interval"),
                make_float_column("calibrated_payload_high_kg", "kg", "upper end of its interval"),
            ),
        ),
        Frame(
            "manoeuvres",
            "a row for each fitted manoeuvre: its mass after correction for the nuisances",
            (
                Column("load_id", pl.Int64, "1", "the load that it carries"),
                Column("start_t_ns", pl.Int64, "ns", "its first fitted sample"),
                Column("end_t_ns", pl.Int64, "ns", "its last fitted sample"),
                make_float_column("mass_kg", "kg", "mass by this manoeuvre alone"),
                make_float_column(
                    "mass_std_kg", "kg", "its standard deviation by this manoeuvre alone"
                ),
            ),
        ),
        Frame(
            "cycles",
            "a row for each cycle, from one dump to the next: payload and times",
            (
                Column("cycle", pl.Int64, "1", "number of the cycle, from 1"),
                Column("start_t_ns", pl.Int64, "ns", "the dump before, or where it is first seen"),
                Column("end_t_ns", pl.Int64, "ns", "its dump, or where it is last seen"),
                Column("dig_t_ns", pl.Int64, "ns", "first sample that digs (null: not seen)"),
                Column(
                    "dump_t_ns",
                    pl.Int64,
                    "ns",
                    "when it dumps, by boom or standstill (null: not seen)",
                ),
                make_float_column("return_s", "s", "from the previous dump to digging"),
                make_float_column("load_s", "s", "from digging to the first start with the load"),
                make_float_column("haul_s", "s", "from that start to the stop for dumping"),
                make_float_column("dump_s", "s", "duration of the stop for dumping"),
                Column("manoeuvres", pl.Int64, "1", "manoeuvres with the load that were fitted"),
                Column("loaded_id", pl.Int64, "1", "number of the loaded pass"),
                make_float_column("loaded_kg", "kg", "mass of the loaded pass"),
                make_float_column("loaded_u_kg", "kg", "its random standard uncertainty"),
                Column("empty_before_id", pl.Int64, "1", "number of the empty pass before"),
                make_float_column("empty_before_kg", "kg", "mass of the empty pass before"),
                make_float_column("empty_before_u_kg", "kg", "its random standard uncertainty"),
                Column("empty_after_id", pl.Int64, "1", "number of the next empty pass"),
                make_float_column("empty_after_kg", "kg", "mass of the next empty pass"),
                make_float_column("empty_after_u_kg", "kg", "its random standard uncertainty"),
                make_float_column(
                    "tare_before_1",
                    "1",
                    "weight of the empty pass before; the empty pass after has the rest",
                ),
                make_float_column(
                    "payload_kg", "kg", "dumped payload: loaded minus empty mass, after scaling"
                ),
                make_float_column(
                    "payload_u_random_kg", "kg", "the part that differs from cycle to cycle"
                ),
                make_float_column(
                    "payload_u_common_kg", "kg", "the part due to errors common to the whole log"
                ),
                make_float_column(
                    "payload_u_shared_kg",
                    "kg",
                    "part of payload_u_common_kg that all payloads share",
                ),
                make_float_column("payload_u_kg", "kg", "standard uncertainty, random and common"),
                make_float_column(
                    "scale_1", "1", "payload over loaded less empty, by the empty machine"
                ),
                make_float_column(
                    "arriving_1",
                    "1",
                    "share of the weighed load that is not spilled (null: all)",
                ),
                make_float_column("arriving_u_1", "1", "its standard uncertainty"),
                Column(
                    "scale_from",
                    pl.String,
                    "1",
                    "what determines the whole scale: machine file, empty machine, calibration; "
                    "or ''",
                ),
                make_float_column(
                    "own_u_common_kg", "kg", "u_common by the log alone, of loaded less empty"
                ),
                make_float_column("own_u_shared_kg", "kg", "u_shared by the log alone"),
                make_float_column(
                    "carry_back_kg", "kg", "next empty pass minus the cleanest empty passes"
                ),
                make_float_column(
                    "carry_back_u_kg",
                    "kg",
                    "its standard uncertainty, mostly from the cleanest passes",
                ),
                Column("quality", QUALITY, "1", "how usable the payload is"),
                Column("counted", pl.Boolean, "1", "whether it is in the sum of the shift"),
                Column(
                    "withheld_for", pl.String, "1", "why there is no mass, or what is wrong with it"
                ),
            ),
        ),
        Frame(
            "shift",
            "what the cycles add up to, one row",
            (
                Column("start_t_ns", pl.Int64, "ns", "first sample"),
                Column("end_t_ns", pl.Int64, "ns", "last sample"),
                Column("cycles", pl.Int64, "1", "cycles that were seen"),
                Column("cycles_counted", pl.Int64, "1", "cycles in the sum"),
                Column("cycles_rejected", pl.Int64, "1", "cycles that a reviewer rejected"),
                Column(
                    "cycles_without_mass",
                    pl.Int64,
                    "1",
                    "cycles without a start that determines the mass",
                ),
                make_float_column("payload_kg", "kg", "sum of payloads"),
                make_float_column(
                    "payload_u_random_kg", "kg", "its random part: averages out over cycles"
                ),
                make_float_column(
                    "payload_u_common_kg", "kg", "its common part: does not average out"
                ),
                make_float_column("payload_u_kg", "kg", "standard uncertainty, random and common"),
                make_float_column("payload_mean_kg", "kg", "mean payload"),
                make_float_column("payload_std_kg", "kg", "standard deviation of payloads"),
                make_float_column(
                    "arriving_1", "1", "mean share of the weighed load that is not spilled"
                ),
                make_float_column("arriving_u_1", "1", "its standard uncertainty"),
                make_float_column("carry_back_mean_kg", "kg", "mean carry-back"),
                make_float_column(
                    "carry_back_u_kg",
                    "kg",
                    "its standard uncertainty, mostly from the cleanest passes",
                ),
                make_float_column("lost_cycles", "1", "cycles expected where nothing was recorded"),
                make_float_column("lost_cycles_u", "1", "standard uncertainty of lost_cycles"),
                make_float_column("lost_kg", "kg", "payload that they would have carried"),
                make_float_column("lost_u_kg", "kg", "standard uncertainty of lost_kg"),
                Column("digs", pl.Int64, "1", "cycles whose digging was seen"),
                Column("boom_dumps", pl.Int64, "1", "dumps that the boom shows, if it does"),
                make_float_column(
                    "uncounted_cycles",
                    "1",
                    "expected number of cycles without a mass, from digging or the boom",
                ),
                make_float_column(
                    "uncounted_cycles_u", "1", "standard uncertainty of uncounted_cycles"
                ),
                make_float_column(
                    "uncounted_kg",
                    "kg",
                    "payload that they carried, by the mean of the counted cycles",
                ),
                make_float_column("uncounted_u_kg", "kg", "standard uncertainty of uncounted_kg"),
                make_float_column(
                    "on_board_kg", "kg", "load that is not dumped when the recording ends"
                ),
                make_float_column("on_board_u_kg", "kg", "standard uncertainty of on_board_kg"),
                make_float_column("total_kg", "kg", "dumped: counted, uncounted and lost loads"),
                make_float_column("total_u_kg", "kg", "standard uncertainty of total_kg"),
                make_float_column(
                    "min_detectable_kg",
                    "kg",
                    "smallest load that one start distinguishes from no load",
                ),
                Column(
                    "scale_from",
                    pl.String,
                    "1",
                    "what determines the scale, as in the frame cycles",
                ),
                Column(
                    "scale_unknown",
                    pl.String,
                    "1",
                    "sources of payload scale error without a stated uncertainty",
                ),
                make_float_column(
                    "gain_1", "1", "empty machine in the log over that of the machine file"
                ),
                make_float_column("gain_u_1", "1", "its standard uncertainty"),
                make_float_column("duration_s", "s", "from the first sample to the last"),
                make_float_column("gap_s", "s", "part of duration_s without a recording"),
                make_float_column(
                    "idle_s", "s", "part of duration_s in standstills of more than half a minute"
                ),
                make_float_column(
                    "utilisation_1", "1", "share of the recorded time without idling"
                ),
            ),
        ),
        Frame(
            "nuisances",
            "a row for each term of the joint fit besides mass and friction: prior and posterior",
            (
                Column("term", pl.String, "1", "its name"),
                Column("unit", pl.String, "1", "of its prior and posterior"),
                make_float_column("prior_mean", "1", "mean of its prior (in its unit)"),
                make_float_column(
                    "prior_std", "1", "standard deviation of its prior (in its unit)"
                ),
                make_float_column("posterior", "1", "posterior estimate by this log (in its unit)"),
                make_float_column(
                    "posterior_std", "1", "standard deviation of posterior (in its unit)"
                ),
                make_float_column(
                    "u_kg", "kg", "contribution of its prior to the mass' uncertainty"
                ),
                Column("meaning", pl.String, "1", "physical meaning of the term"),
                make_float_column(
                    "prior_mean_u", "1", "standard uncertainty of a learnt prior's mean"
                ),
                make_float_column("alone", "1", "estimate by this log without learnt priors"),
                make_float_column("alone_std", "1", "standard deviation of alone (in its unit)"),
                make_float_column(
                    "alone_prior_mean", "1", "mean of the unlearnt prior behind alone (in its unit)"
                ),
                make_float_column(
                    "alone_prior_std",
                    "1",
                    "standard deviation of the unlearnt prior behind alone (in its unit)",
                ),
            ),
        ),
        Frame(
            "responses",
            "under learnt priors: change of each result by one standard uncertainty of each mean",
            (
                Column("of", pl.String, "1", "mass or payload of a load, or payload of a cycle"),
                Column("number", pl.Int64, "1", "number of the load or cycle"),
                Column("term", pl.String, "1", "name of the term, or the scale"),
                make_float_column("response_kg", "kg", "change of the result"),
            ),
        ),
        Frame(
            "learnt_errors",
            "under learnt priors: estimates by this log of the errors of their means, a row for "
            "each pair",
            (
                Column("term", pl.String, "1", "term with this mean"),
                Column("other", pl.String, "1", "second term of the pair, or the same"),
                make_float_column(
                    "error_1", "1", "error of the term's mean, in its standard uncertainties"
                ),
                make_float_column("covariance_1", "1", "covariance of the two, as error_1"),
                Column(
                    "told", pl.Boolean, "1", "true where the masses are corrected for that error"
                ),
            ),
        ),
        Frame(
            "budget",
            "a row for each load and source of the uncertainty of its mass, the largest first",
            (
                Column("load_id", pl.Int64, "1", "number of the load"),
                Column("cause", pl.String, "1", "where it comes from"),
                Column("kind", pl.String, "1", "random, common or scale"),
                make_float_column(
                    "u_kg", "kg", "standard uncertainty (null where it is not known)"
                ),
                make_float_column("share_1", "1", "share of the variance"),
                Column("meaning", pl.String, "1", "what it is"),
                Column("shrinks", pl.String, "1", "what would reduce it"),
            ),
        ),
        Frame(
            "verdict",
            "a row for each check of the ungated log: can this log weigh the machine",
            (
                Column("check", pl.String, "1", "name of the check"),
                Column("about", pl.String, "1", "result that it may withhold: mass or inertia"),
                make_float_column("value", "1", "its number (null when it does not apply)"),
                make_float_column("minimum", "1", "smallest number that passes"),
                make_float_column("maximum", "1", "largest number that passes"),
                Column("passed", pl.Boolean, "1", "null when the check does not apply to this log"),
                Column(
                    "consequence",
                    pl.String,
                    "1",
                    "consequence of failing: withhold, widen, method, tell",
                ),
                Column("remedy", pl.String, "1", "the setting or change that would correct it"),
                Column("meaning", pl.String, "1", "meaning of the number, in a sentence"),
            ),
        ),
        Frame(
            "findings",
            "a row for each cause that this log shows, the likeliest first: its effect and "
            "its remedy",
            (
                Column("rank", pl.Int64, "1", "rank of the cause; 1 is the likeliest"),
                Column("cause", pl.String, "1", "its key in the table of causes"),
                Column("severity", pl.String, "1", "consequence: withhold, widen, tell"),
                Column("channel", pl.String, "1", "its channel (null: no single one)"),
                Column("start_t_ns", pl.Int64, "ns", "start of its stretch (null: the whole log)"),
                Column("end_t_ns", pl.Int64, "ns", "end of its stretch (null: the whole log)"),
                make_float_column(
                    "strength_1",
                    "1",
                    "its test statistic over the detection threshold; findings are ranked by it",
                ),
                Column("evidence", pl.String, "1", "what was measured, in a sentence"),
                make_float_column(
                    "mass_change_kg", "kg", "change of the mass if corrected (null: unknown)"
                ),
                make_float_column(
                    "mass_change_u_kg", "kg", "standard uncertainty of mass_change_kg"
                ),
                Column(
                    "setting",
                    pl.String,
                    "1",
                    "keys of the machine file, separated by commas (null: none)",
                ),
                Column(
                    "value",
                    pl.String,
                    "1",
                    "proposed value of each key in `setting`, as TOML, separated by commas",
                ),
                Column(
                    "alternatives",
                    pl.String,
                    "1",
                    "causes that it cannot be distinguished from, separated by commas",
                ),
            ),
        ),
        Frame(
            "calibration",
            "a row for each method and load: the points and the fit of (19)",
            (
                Column("method", pl.String, "1", "estimator"),
                make_float_column("load_kg", "kg", "reference load"),
                make_float_column("reference_kg", "kg", "machine and load"),
                Column("runs", pl.Int64, "1", "runs that gave an estimate"),
                make_float_column(
                    "estimate_kg", "kg", "mean estimate over the runs, not calibrated"
                ),
                make_float_column(
                    "estimate_std_kg", "kg", "standard deviation of one run's estimate"
                ),
                make_float_column("alpha_1", "1", "slope of the calibration line (19)"),
                make_float_column("beta_kg", "kg", "offset of the calibration line (19)"),
                make_float_column("calibrated_kg", "kg", "calibrated mean"),
                make_float_column(
                    "error_kg", "kg", "calibrated less reference, this load in the fit"
                ),
                make_float_column(
                    "error_left_out_kg", "kg", "the same with this load left out of the fit"
                ),
            ),
        ),
        Frame(
            "line",
            "in evidence: the calibration line, one row",
            (
                make_float_column("alpha_1", "1", "slope: calibrated mass over estimate"),
                make_float_column("beta_kg", "kg", "offset of the calibrated mass"),
                make_float_column("valid_from_kg", "kg", "lightest mass for which it is valid"),
                make_float_column("valid_to_kg", "kg", "heaviest mass for which it is valid"),
                make_float_column(
                    "line_u_kg", "kg", "standard uncertainty of a mass at valid_to_kg"
                ),
                make_float_column("coverage_k_1", "1", "coverage factor for line_u_kg"),
            ),
        ),
        Frame(
            "points",
            "in evidence: a row for each run",
            (
                Column("run_id", pl.String, "1", "name of the run"),
                Column("load", pl.String, "1", "masses on board"),
                Column("day", pl.String, "1", "day of the run"),
                make_float_column("reference_kg", "kg", "reference mass of the load"),
                Column("readings", pl.Int64, "1", "readings in use"),
                Column("rejected", pl.Int64, "1", "readings that were rejected"),
                make_float_column("mean_kg", "kg", "mean estimate, not calibrated"),
                make_float_column("std_kg", "kg", "standard deviation of a reading"),
                make_float_column("calibrated_kg", "kg", "calibrated mean"),
                make_float_column(
                    "error_kg", "kg", "calibrated less reference, this load in the fit"
                ),
                make_float_column(
                    "error_left_out_kg", "kg", "the same with this load left out of the fit"
                ),
                make_float_column("studentised_1", "1", "residual over its own standard deviation"),
            ),
        ),
        Frame(
            "readings",
            "in evidence: a row for each manoeuvre of a run",
            (
                Column("run_id", pl.String, "1", "name of the run"),
                Column("load", pl.String, "1", "masses on board"),
                Column("day", pl.String, "1", "day of the run"),
                Column("log", pl.String, "1", "its log"),
                Column("reading", pl.Int64, "1", "number of the reading in its run"),
                make_float_column(
                    "start_s", "s", "start of the manoeuvre, from the log's first aligned sample"
                ),
                make_float_column("end_s", "s", "end of the manoeuvre, from the same sample"),
                make_float_column("mass_kg", "kg", "estimate by this manoeuvre"),
                make_float_column("std_kg", "kg", "its standard deviation by this manoeuvre alone"),
                make_float_column(
                    "common_u_kg", "kg", "standard uncertainty in common with other readings"
                ),
                Column("used", pl.Boolean, "1", "whether it counts"),
                Column("left_out_for", pl.String, "1", "why it is not used (empty when it is)"),
            ),
        ),
        Frame(
            "runs",
            "in evidence: where each run's replay is recorded",
            (
                Column("run_id", pl.String, "1", "name of the run"),
                Column("log", pl.String, "1", "its log"),
                Column("log_sha256", pl.String, "1", "digests of the log's files"),
                Column("recording", pl.String, "1", "its recording (empty when none was kept)"),
            ),
        ),
    )
}


def find_frame_declaration(frame_name: str) -> Frame:
    """Declaration of a frame by its name in a run (`estimates/ls` → estimates).

    Raises:
        KeyError: the name is not in the table (`raw/...` has no fixed columns).
    """
    family = frame_name.partition("/")[0]
    if family not in FRAMES:
        raise KeyError(f"{frame_name}: no such frame; declare it in analysis/model/schema.py")
    return FRAMES[family]


def conform_frame_to_schema(frame_name: str, frame: pl.DataFrame) -> pl.DataFrame:
    """Convert a frame to the declared order and dtypes; undeclared columns raise an error."""
    return _make_declared_frame(
        frame_name, {each: frame.get_column(each) for each in frame.columns}
    )


def build_frame(frame_name: str, columns: Mapping[str, NDArray[Any] | pl.Series]) -> pl.DataFrame:
    """Make the frame `frame_name` from arrays; NaN becomes null."""
    return _make_declared_frame(
        frame_name, {each: _make_declared_series(each, column) for each, column in columns.items()}
    )


def _make_declared_frame(frame_name: str, columns: Mapping[str, pl.Series]) -> pl.DataFrame:
    """Frame of the given columns in declared order and dtypes."""
    declared = find_frame_declaration(frame_name)
    unknown = columns.keys() - {column.name for column in declared.columns}
    if unknown:
        raise KeyError(
            f"{frame_name}: columns without a declaration: {sorted(unknown)}; declare them in "
            "analysis/model/schema.py"
        )
    # column by column: a query, or a frame from a mapping, costs more than all casts together
    return pl.DataFrame(
        [
            series if series.dtype == column.dtype else series.cast(column.dtype)
            for column in declared.columns
            if (series := columns.get(column.name)) is not None
        ]
    )


def _make_declared_series(name: str, column: NDArray[Any] | pl.Series) -> pl.Series:
    if isinstance(column, np.ndarray):
        has_nan = column.dtype.kind == "f" and bool(np.isnan(column).any())
        return pl.Series(name, column, nan_to_null=has_nan)
    named = column.alias(name)
    # numpy shows nulls as NaN, and checks for them faster than a query of polars
    may_have_nan = named.dtype.is_float() and bool(np.isnan(named.to_numpy()).any())
    return named.fill_nan(None) if may_have_nan else named


def get_column_values(frame: pl.DataFrame | ColumnArrays, column: str) -> NDArray[np.float64]:
    """Column as floats, (rows,); NaN for nulls, or if the frame lacks the column."""
    if column not in frame.columns:
        return np.full(frame.height, np.nan)
    if isinstance(frame, ColumnArrays):
        return frame[column]
    series = frame.get_column(column)
    return (series if series.dtype == pl.Float64 else series.cast(pl.Float64)).to_numpy()
