"""The table of views and stored columns, for writer, reader, blueprint and plots.

Which view of which tab draws which column (`TABS`), and what is stored but not drawn (`KEPT`).
"""

from collections.abc import Iterable
from typing import Final

from recordings.rrd.recording_views import (
    MethodLayout,
    Tab,
    View,
    ViewKind,
    ViewSeries,
    make_band_view,
    make_line_view,
    make_line_view_without_outliers,
    make_state_lanes_view,
)
from recordings.rrd.stored_names import split_frame_name_to_path

_FORCE = make_line_view("Force", "excitation", force_x_N="driving force")
_ACCELERATION = make_line_view(
    "Acceleration",
    "excitation",
    regressor_acc_x_m_s2="regressor of the mass",
    specific_force_x_m_s2="accelerometer",
    acc_x_m_s2="kinematic",
    speed_rate_x_m_s2="rate of the speed",
)
_SPEED = make_line_view("Speed", "excitation", speed_x_m_s="speed")
_YAW_TORQUE = make_line_view("Yaw torque", "excitation", torque_z_N_m="yaw torque")
_INDEX = make_line_view(
    "Information index",
    "gate",
    "gate.threshold_nat",
    mi_x_nat="index of the window",
    ksg_x_nat="mutual information by nearest neighbours",
    mi_z_nat="index of the window, yaw",
    ksg_z_nat="mutual information by nearest neighbours, yaw",
)
_LOADS = View(
    "Mass of each load",
    ViewKind.BANDS,
    (
        ViewSeries("loads", "mass_kg", "load ± u", "u_kg"),
        ViewSeries("manoeuvres", "mass_kg", "a manoeuvre by itself", "mass_std_kg"),
    ),
    clips_outliers=True,
)
_MASS = make_band_view("Mass", "estimates", "mass_kg", "mass_std_kg")
_FRICTION = make_band_view(
    "Viscous friction", "estimates", "friction_x_N_s_m", "friction_x_std_N_s_m"
)
_INERTIA = make_band_view("Yaw inertia", "estimates", "inertia_z_kg_m2", "inertia_z_std_kg_m2")
_YAW_FRICTION = make_band_view(
    "Viscous friction of turning", "estimates", "friction_z_N_m_s", "friction_z_std_N_m_s"
)
_COM = View(
    "Centre of mass",
    ViewKind.BANDS,
    (
        ViewSeries("planar", "com_x_m", "ahead", "com_x_std_m"),
        ViewSeries("planar", "com_y_m", "to the left", "com_y_std_m"),
    ),
)
_DECISIONS = make_state_lanes_view(
    "Gate and phase",
    ("gate", "reason_x", "gate"),
    ("gate", "reason_z", "yaw_gate"),
    ("excitation", "phase", "phase"),
)
_PAYLOAD = ("payload_kg", "payload_u_kg", "payload ± u")

TABS: Final = (
    Tab("Overview", (_FORCE, _SPEED, _INDEX, _DECISIONS, _LOADS, _MASS, _INERTIA), ("answer",)),
    Tab(
        "Findings",
        (make_state_lanes_view("Findings", ("findings", "cause", "finding")), _FORCE, _SPEED),
        ("findings",),
        events=True,
        context=(_FORCE, _SPEED),
    ),
    Tab(
        "Loads",
        (
            _LOADS,
            make_band_view("Payload of each load", "loads", *_PAYLOAD),
            _SPEED,
        ),
        context=(_SPEED,),
    ),
    Tab(
        "Cycles",
        (
            make_band_view("Payload of each cycle", "cycles", *_PAYLOAD),
            make_state_lanes_view("Cycle", ("cycles", "quality", "cycle")),
            _SPEED,
        ),
        context=(_SPEED,),
    ),
    Tab(
        "Motion",
        (
            _FORCE,
            _ACCELERATION,
            _SPEED,
            _YAW_TORQUE,
            make_state_lanes_view(
                "Phase and gaps", ("excitation", "phase", "phase"), ("aligned", "gap", "gap")
            ),
        ),
    ),
    Tab("Scatter", pictures=("scatter",)),
    Tab(
        "Gate",
        (
            _INDEX,
            make_line_view(
                "Correlation of acceleration and force", "gate", corr_x_1="along", corr_z_1="yaw"
            ),
            make_line_view(
                "Share of noise in the variance that the acceleration explains",
                "gate",
                "gate.noise_share_max",
                noise_share_x_1="along",
                noise_share_z_1="yaw",
            ),
            make_line_view_without_outliers(
                "Predicted standard deviation of the mass", "gate", "predicted_std_x", "predicted"
            ),
            make_line_view_without_outliers(
                "Predicted standard deviation of the inertia",
                "gate",
                "predicted_std_z",
                "predicted",
            ),
            _DECISIONS,
        ),
    ),
    Tab(
        "Estimates",
        (
            _MASS,
            _FRICTION,
            make_band_view("Coulomb friction", "estimates", "coulomb_x_N", "coulomb_x_std_N"),
        ),
        methods=MethodLayout.ROWS,
    ),
    Tab("Turning", (_INERTIA, _YAW_FRICTION), methods=MethodLayout.ROWS),
    Tab(
        "Residuals",
        (
            make_line_view_without_outliers("Residual r.m.s.", "estimates", "residual_rms_N"),
            make_line_view_without_outliers(
                "Residual r.m.s. of the yaw torque", "estimates", "residual_rms_N_m"
            ),
            make_line_view_without_outliers("Condition number", "estimates", "condition_1"),
        ),
        methods=MethodLayout.ROWS,
    ),
    Tab(
        "Manoeuvres",
        (
            make_band_view("Mass a manoeuvre", "segments", "mass_kg", "mass_std_kg", "mass"),
            make_band_view(
                "Viscous friction of each manoeuvre",
                "segments",
                "friction_x_N_s_m",
                "friction_x_std_N_s_m",
                "viscous friction",
            ),
            make_band_view(
                "Coulomb friction of each manoeuvre",
                "segments",
                "coulomb_x_N",
                "coulomb_x_std_N",
                "Coulomb friction",
            ),
            make_line_view("Residual r.m.s. a manoeuvre", "segments", residual_rms_N="residual"),
            make_band_view(
                "Yaw inertia of each manoeuvre",
                "segments",
                "inertia_z_kg_m2",
                "inertia_z_std_kg_m2",
                "yaw inertia",
            ),
            make_state_lanes_view(
                "Phase and outcome",
                ("segments", "phase", "manoeuvre_phase"),
                ("segments", "reason", "manoeuvre_outcome"),
            ),
        ),
    ),
    Tab(
        "Planar",
        (
            _YAW_TORQUE,
            make_line_view("Yaw rate", "excitation", yaw_rate_rad_s="yaw rate"),
            make_line_view(
                "Yaw acceleration, smoothed", "excitation", yaw_acc_rad_s2="yaw acceleration"
            ),
            make_line_view(
                "Lateral force / mass", "excitation", regressor_acc_y_m_s2="regressor, to the left"
            ),
            _DECISIONS,
            _COM,
            make_state_lanes_view("Outcome of arcs", ("planar", "reason", "arcs")),
        ),
        ("planar",),
    ),
    Tab(
        "Channels",
        (
            make_line_view(
                "Wheel torque",
                "aligned",
                torque_left_N_m="left",
                torque_right_N_m="right",
                torque_z_N_m="yaw",
            ),
            make_line_view("Force as aligned", "aligned", force_x_N="driving force"),
            make_line_view(
                "Speed as aligned",
                "aligned",
                speed_x_m_s="machine",
                speed_left_m_s="left wheels",
                speed_right_m_s="right wheels",
            ),
            make_line_view(
                "Acceleration as aligned",
                "aligned",
                acc_x_m_s2="kinematic",
                specific_force_x_m_s2="accelerometer x",
                specific_force_y_m_s2="accelerometer y",
            ),
            make_line_view(
                "Vertical specific force as aligned",
                "aligned",
                specific_force_z_m_s2="accelerometer z",
            ),
            make_line_view("Position", "aligned", position_x_m="travelled"),
        ),
    ),
    Tab(
        "Attitude",
        (
            make_line_view(
                "Angular rate",
                "aligned",
                roll_rate_rad_s="roll",
                pitch_rate_rad_s="pitch",
                yaw_rate_rad_s="yaw",
            ),
            make_line_view("Yaw acceleration", "aligned", yaw_acc_rad_s2="yaw"),
            make_line_view(
                "Angle",
                "aligned",
                pitch_rad="pitch, nose-up",
                roll_rad="roll",
                boom_rad="boom",
                bucket_rad="bucket",
            ),
            make_line_view("Fuel", "aligned", fuel_rate_L_h="fuel rate"),
            make_line_view("Gear", "aligned", gear_ratio_1="gear ratio"),
        ),
    ),
    Tab("Calibration", texts=("calibration",), pictures=("line", "errors")),
    Tab("Provenance", texts=("settings", "provenance")),
)

#: Views on the page of `plot`, from top to bottom.
PAGE: Final = (
    _FORCE,
    _ACCELERATION,
    _SPEED,
    _INDEX,
    _DECISIONS,
    _LOADS,
    _MASS,
    _FRICTION,
    _INERTIA,
    _COM,
)
#: Views that an explanation shows around a moment.
MOMENT: Final = (_FORCE, _ACCELERATION, _SPEED, _INDEX, _DECISIONS)
#: Declared columns that no view draws, by frame: time, tables that are shown as text, and the
#: smoothed copy of channels that "Channels" and "Attitude" draw as aligned.
KEPT: Final[dict[str, tuple[str, ...]]] = {
    frame: tuple(names.split())
    for frame, names in {
        "aligned": "t_ns latitude_deg longitude_deg direction_x_1",
        "excitation": (
            "t_ns direction_x_1 speed_left_m_s speed_right_m_s "
            "specific_force_y_m_s2 specific_force_z_m_s2 "
            "roll_rate_rad_s pitch_rate_rad_s pitch_rad roll_rad"
        ),
        "noise": "first second lag covariance source",
        "gate": "t_ns accepted_x accepted_z",
        "digging": "start_t_ns end_t_ns growth_N growth_std_N",
        "estimates": "t_ns axis",
        "segments": (
            "segment_id start_t_ns end_t_ns samples samples_accepted condition_1 "
            "friction_z_N_m_s friction_z_std_N_m_s residual_rms_N_m"
        ),
        "planar": (
            "kind start_t_ns end_t_ns samples speed_x_m_s yaw_rate_rad_s predicted_std_com_m "
            "mass_kg mass_std_kg friction_x_N_s_m friction_x_std_N_s_m "
            "inertia_z_kg_m2 inertia_z_std_kg_m2 friction_z_N_m_s friction_z_std_N_m_s "
            "first_moment_x_kg_m first_moment_x_std_kg_m "
            "first_moment_y_kg_m first_moment_y_std_kg_m residual_rms_N residual_rms_N_m "
            "condition_1 r_squared_x_1 r_squared_z_1 rank identifiable combinations "
            "scale_unknown com_scale_unknown withheld"
        ),
        "masses": (
            "method mass_kg mass_std_kg friction_x_N_s_m friction_x_std_N_s_m "
            "coulomb_x_N coulomb_x_std_N payload_kg inertia_z_kg_m2 inertia_z_std_kg_m2 "
            "friction_z_N_m_s friction_z_std_N_m_s rows rows_z withheld withheld_z"
        ),
        "loads": (
            "load_id start_t_ns end_t_ns manoeuvres u_random_kg u_common_kg "
            "payload_u_random_kg own_payload_kg own_payload_u_kg own_payload_u_random_kg "
            "payload_to empty scatter_kg scatter_known "
            "friction_x_N_s_m friction_x_std_N_s_m "
            "mass_halved_priors_kg mass_doubled_priors_kg mean_samples braking_left_out "
            "scale_unknown payload_scale_unknown withheld withheld_for said "
            "calibrated_kg calibrated_u_kg calibrated_low_kg calibrated_high_kg calibrated_reason "
            "calibrated_unlike_u_kg calibrated_said calibrated_payload_kg calibrated_payload_u_kg "
            "calibrated_payload_low_kg calibrated_payload_high_kg"
        ),
        "manoeuvres": "load_id start_t_ns end_t_ns",
        "nuisances": (
            "term unit prior_mean prior_std posterior posterior_std u_kg meaning "
            "prior_mean_u alone alone_std alone_prior_mean alone_prior_std"
        ),
        "responses": "of number term response_kg",
        "learnt_errors": "term other error_1 covariance_1 told",
        "cycles": (
            "cycle start_t_ns end_t_ns dig_t_ns dump_t_ns return_s load_s haul_s dump_s manoeuvres "
            "loaded_id loaded_kg loaded_u_kg empty_before_id empty_before_kg empty_before_u_kg "
            "empty_after_id empty_after_kg empty_after_u_kg tare_before_1 "
            "carry_back_kg carry_back_u_kg "
            "payload_u_random_kg payload_u_common_kg payload_u_shared_kg counted withheld_for "
            "scale_1 scale_from arriving_1 arriving_u_1 own_u_common_kg own_u_shared_kg"
        ),
        "shift": (
            "start_t_ns end_t_ns cycles cycles_counted cycles_rejected cycles_without_mass "
            "payload_kg payload_u_random_kg payload_u_common_kg payload_u_kg payload_mean_kg "
            "payload_std_kg arriving_1 arriving_u_1 carry_back_mean_kg carry_back_u_kg "
            "lost_cycles lost_cycles_u lost_kg lost_u_kg digs boom_dumps uncounted_cycles "
            "uncounted_cycles_u uncounted_kg uncounted_u_kg on_board_kg on_board_u_kg "
            "total_kg total_u_kg min_detectable_kg scale_from scale_unknown gain_1 gain_u_1 "
            "duration_s gap_s idle_s utilisation_1"
        ),
        "budget": "load_id cause kind u_kg share_1 meaning shrinks",
        "planar_budget": "quantity cause kind u unit share_1 meaning shrinks",
        "verdict": "check about value minimum maximum passed consequence remedy meaning",
        "findings": (
            "rank severity channel start_t_ns end_t_ns strength_1 evidence "
            "mass_change_kg mass_change_u_kg setting value alternatives"
        ),
        "calibration": (
            "method load_kg reference_kg runs estimate_kg estimate_std_kg "
            "alpha_1 beta_kg calibrated_kg error_kg error_left_out_kg"
        ),
        "line": "alpha_1 beta_kg valid_from_kg valid_to_kg line_u_kg coverage_k_1",
        "points": (
            "run_id load day reference_kg readings rejected mean_kg std_kg calibrated_kg "
            "error_kg error_left_out_kg studentised_1"
        ),
        "readings": (
            "run_id load day log reading start_s end_s mass_kg std_kg common_u_kg used left_out_for"
        ),
        "runs": "run_id log log_sha256 recording",
    }.items()
}


def list_frames_of_series(series: ViewSeries, frames: Iterable[str]) -> tuple[str, ...]:
    """List the frames of a run from which a series is drawn, in the run's order."""
    return tuple(name for name in frames if split_frame_name_to_path(name)[0] == series.frame)


def list_columns_needed_for_drawing(frame: str, columns: Iterable[str]) -> tuple[str, ...]:
    """List the columns of a frame that views draw, and those that order its rows."""
    family = split_frame_name_to_path(frame)[0]
    wanted = {"t_ns", "start_t_ns", "end_t_ns", "axis", "kind", "rank"} | {
        name
        for tab in TABS
        for view in tab.views
        for series in view.series
        if series.frame == family
        for name in (series.column, series.std_column)
    }
    if family not in _DRAWN_FRAMES:
        return ()
    return tuple(name for name in columns if name in wanted)


_DRAWN_FRAMES: Final = {s.frame for tab in TABS for view in tab.views for s in view.series}
