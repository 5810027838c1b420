"""What `init` proposes for the columns of a table, and what it asks."""

import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from analysis.model.machine import Machine
from analysis.model.physical_units import split_unit_from_name
from replay.init.guess_machine import draft_machine_file
from replay.logs import open_log
from replay.recognise.proposals import ChannelProposal
from replay.recognise.table import recognise_channels_of_table

T = np.arange(600) / 50
V = np.clip(np.sin(T), 0, None) * 3
A = np.gradient(V, T)


def proposed(tmp_path: Path, **columns: object) -> tuple[dict[str, ChannelProposal], list[str]]:
    """Channels by name, and questions, of a table with these columns behind its time."""
    path = tmp_path / "log.csv"
    names = {name.replace("__", " ["): name for name in columns}
    frame = pl.DataFrame({"time_s": T, **columns})
    frame.rename({old: f"{new}]" for new, old in names.items() if "__" in old}).write_csv(path)
    with open_log(path) as log:
        found = recognise_channels_of_table(log)
    return {each.column: each for each in found.channels}, found.questions


@pytest.mark.parametrize(
    ("name", "channel"),
    [
        *(("Force__kN", "force_x_N"), ("Zugkraft__N", "force_x_N"), ("effort__daN", "force_x_N")),
        *(("Fahrgeschwindigkeit__km/h", "speed_x_m_s"), ("left_velocity_m_s", "speed_left_m_s")),
        *(("left_Mz_Nm", "torque_left_N_m"), ("Boom angle__deg", "boom_rad")),
        *(("odometer__m", "position_x_m"), ("gyro_z__dps", "yaw_rate_rad_s")),
        *(("F7__kN", "force_x_N"), ("c2__km/h", "speed_x_m_s")),
        *(("/odom/twist/twist/linear/x", "speed_x_m_s"), ("twist.angular.z", "yaw_rate_rad_s")),
        ("imu.linear_acceleration.x", "specific_force_x_m_s2"),
        *(("imu_ax_mps2", "specific_force_x_m_s2"), ("imu_ay_ms2", "specific_force_y_m_s2")),
    ],
)
def test_a_column_is_recognised_by_its_name_and_unit(
    tmp_path: Path, name: str, channel: str
) -> None:
    channels, questions = proposed(tmp_path, **{name: V})
    assert list(channels) == [channel]
    assert not channels[channel].is_comment
    assert questions == []


@pytest.mark.parametrize(
    "name",
    ["/cmd_vel/linear/x", "twist.linear.y", "twist.angular.x", "boom.linear.x", "omega", "tick"],
)
def test_what_is_a_command_or_turns_or_counts_elsewhere_is_no_channel(
    tmp_path: Path, name: str
) -> None:
    assert proposed(tmp_path, **{name: V}) == ({}, [])


@pytest.mark.parametrize(
    "name",
    [
        "motor_temp__degC",
        "Force__mNm",
        "speed__m",
        "Lift force__N",
        "lateral_force_N",
        "Speed__MNm",
    ],
)
def test_a_column_of_another_quantity_is_not_taken(tmp_path: Path, name: str) -> None:
    channels, _ = proposed(tmp_path, **{name: V})
    assert not {"force_x_N", "speed_x_m_s"} & {c for c, p in channels.items() if not p.is_comment}


def test_a_force_goes_with_the_change_of_the_speed(tmp_path: Path) -> None:
    channels, questions = proposed(tmp_path, speed_m_s=V, force_N=1000 * A)
    assert "correlates with the change of speed_m_s, 0.99" in channels["force_x_N"].reason
    assert questions == []


def test_an_inverted_force_is_a_question(tmp_path: Path) -> None:
    _, questions = proposed(tmp_path, speed_m_s=V, force_N=-1000 * A)
    (asked,) = questions
    assert "which direction of 'force_N' is positive" in asked
    assert "scale = -1" in asked


def test_a_speed_is_the_slope_of_a_position(tmp_path: Path) -> None:
    place = np.cumsum(V) / 50
    channels, _ = proposed(tmp_path, distance_m=place, speed_m_s=V)
    assert "correlates with the change of distance_m, 1.00" in channels["speed_x_m_s"].reason


@pytest.mark.parametrize(("down", "unit"), [(9.81, None), (1.0, "standard_gravity")])
def test_gravity_tells_the_unit_of_an_accelerometer(
    tmp_path: Path, down: float, unit: str | None
) -> None:
    noise = np.random.default_rng(1).normal(0, 0.01, T.size)
    axes = {"acc_x": A * down / 9.81, "acc_y": noise, "acc_z": down + noise}
    channels, _ = proposed(tmp_path, **axes)
    assert channels["specific_force_x_m_s2"].unit == unit
    assert "gravity is on 'acc_z'" in channels["specific_force_x_m_s2"].reason


def test_an_acceleration_without_gravity_is_no_specific_force(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).normal(0, 0.01, T.size)
    axes = {"acc x__m/s2": A, "acc y__m/s2": noise, "acc z__m/s2": noise}
    channels, _ = proposed(tmp_path, **axes)
    assert set(channels) == {"acc_x_m_s2"}


def test_questions_come_in_the_order_of_need(tmp_path: Path) -> None:
    columns = {"Motor Torque__Nm": -A, "Motor Speed__rpm": V * 100}
    channels, questions = proposed(tmp_path, **columns)
    assert channels["force_x_N"].derive == "motor_torque_N_m * GEAR / wheel_radius_m"
    assert channels["speed_x_m_s"].derive == "motor_rpm / GEAR * wheel_radius_m"
    kinds = [
        next(w for w in ("gear", "radius", "positive") if w in question) for question in questions
    ]
    assert kinds == ["gear", "gear", "radius", "positive"]


def test_a_controllers_current_and_erpm_need_constants(tmp_path: Path) -> None:
    channels, questions = proposed(tmp_path, current_motor=A, erpm=V * 1000)
    assert "TORQUE_CONSTANT [N*m/A]" in str(channels["force_x_N"].derive)
    assert "POLE_PAIRS" in str(channels["speed_x_m_s"].derive)
    assert any("POLE_PAIRS" in question for question in questions)


def test_pressures_of_a_drive_need_its_displacement(tmp_path: Path) -> None:
    columns = {"Pressure A__bar": A, "Pressure B__bar": -A, "Boom pressure__bar": A}
    channels, questions = proposed(tmp_path, **columns)
    assert "DISPLACEMENT [m^3/turn]" in str(channels["force_x_N"].derive)
    assert any("which pressure drives forwards" in question for question in questions)


def test_two_ports_in_bar_that_no_name_calls_pressures_are_those_of_a_drive(tmp_path: Path) -> None:
    channels, questions = proposed(tmp_path, p_a_bar=A, p_b_bar=-A, oil_bar=A)
    assert "(pressure_high_bar - pressure_low_bar) * DISPLACEMENT" in str(
        channels["force_x_N"].derive
    )
    assert any("'p_a_bar' or 'p_b_bar'" in question for question in questions)


def test_an_oil_pressure_alone_drives_nothing(tmp_path: Path) -> None:
    channels, _ = proposed(tmp_path, oil_bar=A, tank_bar=A)
    assert "force_x_N" not in channels


def test_two_torques_without_a_side_are_a_question(tmp_path: Path) -> None:
    channels, questions = proposed(tmp_path, **{"Torque 1__Nm": A, "Torque 2__Nm": A})
    assert {"torque_left_N_m", "torque_right_N_m"} <= set(channels)
    assert any("which torque is the left one" in question for question in questions)


@pytest.mark.parametrize(
    ("columns", "channel"),
    [
        ({"Load cell 1__N": A, "Load cell 2__N": A}, "force_x_N"),
        ({"Left Wheel Torque 1__Nm": A, "Left Wheel Torque 2__Nm": A}, "torque_left_N_m"),
        ({"speed front__m/s": V, "speed rear__m/s": V + A}, "speed_x_m_s"),
    ],
)
def test_several_columns_of_one_channel_are_a_question(
    tmp_path: Path, columns: dict[str, object], channel: str
) -> None:
    channels, questions = proposed(tmp_path, **columns)
    assert channels[channel].is_comment
    assert any(f"is channels.{channel}" in question for question in questions)


def test_two_speeds_that_agree_are_no_question(tmp_path: Path) -> None:
    columns = {"GPS speed__km/h": 3.6 * V, "OBD speed__m/s": V + 0.01 * A}
    channels, questions = proposed(tmp_path, **columns)
    assert channels["speed_x_m_s"].field == "GPS speed [km/h]"
    assert questions == []


@pytest.mark.parametrize("word", ["setpoint", "soll", "max", "limit", "target", "Cmd"])
def test_what_was_wanted_or_allowed_is_no_reading(tmp_path: Path, word: str) -> None:
    columns = {f"force_{word}__N": 2 * A, "force__N": A, f"speed {word}__m/s": 2 * V}
    channels, _ = proposed(tmp_path, **columns)
    assert channels["force_x_N"].field == "force [N]"
    assert "speed_x_m_s" not in channels


def test_a_torque_that_brakes_and_is_never_negative_has_lost_its_sign(tmp_path: Path) -> None:
    columns = {"Motor Torque__Nm": np.abs(A), "Motor Speed__rpm": V * 100}
    _, questions = proposed(tmp_path, **columns)
    assert any("it is never negative" in question for question in questions)


def test_a_torque_that_does_not_brake_may_never_be_negative(tmp_path: Path) -> None:
    columns = {"Motor Torque__Nm": np.clip(A, 0, None), "Motor Speed__rpm": V * 100}
    _, questions = proposed(tmp_path, **columns)
    assert not any("negative" in question for question in questions)


def test_an_integer_that_jumps_by_all_of_its_bits_has_lost_its_sign(tmp_path: Path) -> None:
    force = np.rint(1000 * A).astype(int) % 65536
    _, questions = proposed(tmp_path, speed_m_s=V, force_N=force)
    assert any("it jumps by 2^16" in question for question in questions)


@pytest.mark.parametrize("name", ["Force (0.1 N)", "Force [x10 kN]", "Force / 10 N"])
def test_a_multiple_of_a_unit_is_not_the_unit(tmp_path: Path, name: str) -> None:
    channels, _ = proposed(tmp_path, **{name: A})
    assert channels["force_x_N"].unit == "?"


def test_currents_of_both_sides_are_those_of_their_motors(tmp_path: Path) -> None:
    channels, _ = proposed(tmp_path, left_current_A=A, right_current_A=A, omega_left_rad_s=V)
    derivation = channels["force_x_N"].derive
    assert derivation is not None
    assert derivation.startswith("(left_motor_current_A + right_motor_current_A)")
    assert channels["speed_x_m_s"].derive == "wheel_x_rpm * wheel_radius_m"


def test_wheels_in_turns_need_the_radius_alone(tmp_path: Path) -> None:
    columns = {"left wheel speed__rad/s": V, "right wheel speed__rad/s": V}
    channels, questions = proposed(tmp_path, **columns)
    assert channels["speed_left_m_s"].derive == "wheel_left_rpm * wheel_radius_m"
    assert questions == ["machine.wheel_radius_m"]


def test_ticks_of_encoders_are_a_position_once_the_ticks_of_a_turn_are_stated(
    tmp_path: Path,
) -> None:
    ticks = np.cumsum(V * 50).astype(int)
    names = ("left_encoder_ticks", "right_encoder_ticks")
    channels, questions = proposed(tmp_path, force_N=A, **dict.fromkeys(names, ticks))
    assert channels["position_x_m"].derive == (
        "(encoder_left_1 + encoder_right_1) / 2 / TICKS_PER_TURN * 6.283185 * wheel_radius_m"
    )
    assert [channels[f"encoder_{side}_1"].field for side in ("left", "right")] == [*names]
    assert channels["speed_x_m_s"].derive == "d/dt position_x_m"
    assert questions == [
        "the ticks of a turn of the wheel: TICKS_PER_TURN in channels.position_x_m.derive",
        "machine.wheel_radius_m",
    ]


@pytest.mark.parametrize("name", ["tick", "boom_encoder_ticks", "omega"])
def test_revolutions_of_a_motor_come_before_what_may_be_another_count(
    tmp_path: Path, name: str
) -> None:
    channels, _ = proposed(tmp_path, **{name: V, "motor_rpm": V * 100, "force_N": A})
    assert channels["speed_x_m_s"].derive == "motor_rpm / GEAR * wheel_radius_m"
    assert channels["motor_rpm"].field == "motor_rpm"


def test_a_motor_without_units_has_its_torque_asked_and_its_omega_in_rad_s(tmp_path: Path) -> None:
    channels, questions = proposed(tmp_path, motor_omega=V, motor_torque=A)
    assert (channels["motor_torque_N_m"].unit, channels["motor_rpm"].unit) == ("?", "rad/s")
    assert channels["force_x_N"].derive == "motor_torque_N_m * GEAR / wheel_radius_m"
    assert "the unit of 'motor_torque', in channels.motor_torque_N_m.unit" in questions


def test_every_column_is_in_the_draft_and_the_draft_says_what_is_missing(tmp_path: Path) -> None:
    frame = pl.DataFrame({"time_s": T, **{f"column_{k}": V for k in range(40)}})
    frame.write_csv(tmp_path / "log.csv")
    with open_log(tmp_path / "log.csv") as log:
        text, lacking = draft_machine_file(log, None)
    assert all(f"#   column_{k}, 50 Hz: 0 … " in text for k in range(40))
    assert lacking[0].startswith("a force")
    with pytest.raises(ValueError, match=r"no force channel: give channels\.force_x_N"):
        Machine.model_validate(tomllib.loads(text))


def test_a_power_over_the_speed_is_a_force(tmp_path: Path) -> None:
    channels, questions = proposed(tmp_path, battery_power__kW=A * V, speed__kmh=V)
    assert channels["force_x_N"].derive == (
        "where(abs(speed_x_m_s) > 0.3 [m/s], power_W * EFFICIENCY / speed_x_m_s)"
    )
    assert any("EFFICIENCY" in question for question in questions)


def test_what_flows_into_a_drive_is_no_motors_current(tmp_path: Path) -> None:
    columns = {"battery_current_A": A * V, "battery_voltage_V": A * 0 + 48, "speed_kmh": V}
    channels, _ = proposed(tmp_path, **columns)
    assert "motor_current_A" not in channels
    assert "supply_A * supply_V * EFFICIENCY" in str(channels["force_x_N"].derive)


def test_a_column_that_is_called_rpm_may_count_electrical_turns(tmp_path: Path) -> None:
    channels, questions = proposed(tmp_path, rpm=V * 1000, avg_motor_current=A)
    assert channels["speed_x_m_s"].derive == "motor_rpm / GEAR * wheel_radius_m"
    assert any("electrical turns" in question for question in questions)


def test_the_input_current_of_a_controller_is_not_its_motors(tmp_path: Path) -> None:
    columns = {"input_current": A * 0.6, "motor_current": A, "erpm": V * 1000}
    channels, _ = proposed(tmp_path, **columns)
    assert channels["motor_current_A"].field == "motor_current"


@pytest.mark.parametrize(
    "name",
    ["Wind speed__m/s", "Brake force__kN", "Wheel load__kN", "Pedal force__N", "Windkraft__N"],
)
def test_what_is_not_the_machines_is_not_taken(tmp_path: Path, name: str) -> None:
    channels, _ = proposed(tmp_path, **{name: V})
    assert not {"force_x_N", "speed_x_m_s"} & set(channels)


def test_a_force_that_does_not_go_with_the_speed_is_a_question(tmp_path: Path) -> None:
    noise = np.random.default_rng(3).normal(0, 100, T.size)
    _, questions = proposed(tmp_path, speed_m_s=V, force_N=noise)
    (asked,) = questions
    assert "whether 'force_N' moves the machine and 'speed_m_s' is its speed" in asked


def test_units_that_an_accelerometer_contradicts_are_a_question(tmp_path: Path) -> None:
    columns = {"speed_m_s": V, "Long. acceleration__m/s2": 10 * A, "force_N": 1000 * A}
    _, questions = proposed(tmp_path, **columns)
    (asked,) = questions
    assert "the change of 'speed_m_s' is 0.0" in asked
    assert "[log] time_unit" in asked


def test_the_type_of_a_variable_is_no_side(tmp_path: Path) -> None:
    channels, questions = proposed(tmp_path, **{"Plc.rSpeed__m/s": V, "Plc.rForce__N": 1000 * A})
    assert {"speed_x_m_s", "force_x_N"} <= set(channels)
    assert questions == []
    channels, _ = proposed(tmp_path, **{"rSpeed__m/s": V, "lSpeed__m/s": V})
    assert set(channels) == {"speed_left_m_s", "speed_right_m_s"}


def test_a_third_wheels_torque_is_a_question(tmp_path: Path) -> None:
    _, questions = proposed(tmp_path, speed_m_s=V, left_Nm=A, right_Nm=A, rear_torque_Nm=A)
    assert any("whether 'rear_torque_Nm' also drives the machine" in each for each in questions)


def test_a_torque_in_percent_needs_the_rated_one(tmp_path: Path) -> None:
    channels, questions = proposed(tmp_path, **{"Drehzahl__rpm": V, "Drehmoment__% Mn": 100 * A})
    assert channels["force_x_N"].derive is not None
    assert "torque_percent * RATED_TORQUE [N*m]" in channels["force_x_N"].derive
    assert any("RATED_TORQUE in N*m" in each for each in questions)


@pytest.mark.parametrize(
    ("name", "unit"),
    [("SpeedMetersPerSec", "m/s"), ("wheelRPM", "rpm"), ("torqueNm", "N*m"), ("torquekNm", None),
     ("motor_torque_%", "percent"), ("load %", "percent"),
     ("speedMin", None), ("TimeUS", None), ("Pull (mN)", None)],
)  # fmt: skip
def test_a_unit_behind_a_capital(name: str, unit: str | None) -> None:
    assert split_unit_from_name(name)[1] == unit


@pytest.mark.parametrize(
    ("name", "unit"),
    [("WheelBasedVehicleSpeed", "km/h"), ("Wheel-Based Vehicle Speed", "km/h")],
)
def test_a_signal_of_j1939_has_its_unit(tmp_path: Path, name: str, unit: str) -> None:
    channels, questions = proposed(tmp_path, **{name: V})
    assert channels["speed_x_m_s"].unit == unit
    assert not channels["speed_x_m_s"].is_comment
    assert questions == []


def test_motors_that_turn_against_one_another_are_asked_about(tmp_path: Path) -> None:
    sides = {"left_motor_torque__Nm": A, "right_motor_torque__Nm": -A}
    _, questions = proposed(tmp_path, speed__kmh=V, **sides)
    assert any("is positive: they correlate negatively" in each for each in questions)


def test_a_force_that_is_complete_asks_for_no_gears(tmp_path: Path) -> None:
    _, questions = proposed(tmp_path, speed__kmh=V, force__N=A, CurrentGear=np.round(V))
    assert not any("gear" in each for each in questions)


@pytest.mark.parametrize("name", ["TransmissionActualGearRatio", "gear_ratio", "Drive ratio"])
def test_a_gear_ratio_is_one_and_no_gear_is_asked_for(tmp_path: Path, name: str) -> None:
    channels, questions = proposed(
        tmp_path, speed__kmh=V, **{name: np.round(V) + 1.0}, TransmissionCurrentGear=np.round(V)
    )
    assert channels["gear_ratio_1"].field == name
    assert not any("gear_ratio_1" in each for each in questions)


@pytest.mark.parametrize(
    ("names", "derive"),
    [
        (
            ("motor_l_current_A", "motor_r_current_A"),
            "(left_motor_current_A + right_motor_current_A) * TORQUE_CONSTANT [N*m/A]",
        ),
        (
            ("left_motor_torque__Nm", "right_motor_torque__Nm"),
            "(left_motor_torque_N_m + right_motor_torque_N_m)",
        ),
    ],
)
def test_motors_of_both_sides_make_one_force(
    tmp_path: Path, names: tuple[str, str], derive: str
) -> None:
    channels, questions = proposed(tmp_path, speed__kmh=V, **dict.fromkeys(names, A))
    force = channels["force_x_N"]
    assert force.is_comment
    assert force.derive == f"{derive} * GEAR / wheel_radius_m"
    assert "the gear ratio between motor and wheel: GEAR in channels.force_x_N.derive" in questions


@pytest.mark.parametrize(
    "names", [("lForce_kN", "rForce_kN"), ("Left track force [kN]", "Right track force [kN]")]
)
def test_forces_of_both_tracks_are_one_force(tmp_path: Path, names: tuple[str, str]) -> None:
    channels, questions = proposed(tmp_path, speed__kmh=V, **dict.fromkeys(names, A))
    assert channels["force_x_N"].derive == "force_left_N + force_right_N"
    assert [channels[f"force_{side}_N"].field for side in ("left", "right")] == list(names)
    assert not any(channels[each].is_comment for each in ("force_x_N", "force_left_N"))
    assert not questions


def test_torques_of_both_sides_without_a_unit_are_asked_for_it(tmp_path: Path) -> None:
    channels, questions = proposed(tmp_path, speed__kmh=V, torque_left=A, torque_right=A)
    assert channels["torque_left_N_m"].is_comment
    assert channels["torque_left_N_m"].unit == "?"
    assert "the unit of 'torque_right', in channels.torque_right_N_m.unit" in questions
    assert "machine.wheel_radius_m" in questions


@pytest.mark.parametrize("side_behind", ["wheel_torque_Nm.{}", "torque_Nm_{}", "torque_Nm {}"])
def test_a_side_may_stand_behind_the_unit(tmp_path: Path, side_behind: str) -> None:
    names = [side_behind.format(side) for side in ("left", "right")]
    channels, _ = proposed(tmp_path, speed__kmh=V, **dict.fromkeys(names, A))
    found = [channels[f"torque_{side}_N_m"] for side in ("left", "right")]
    assert [each.field for each in found] == names
    assert not any(each.is_comment or each.unit for each in found)


@pytest.mark.parametrize(
    "names",
    [
        ("left_wheel_force_kN", "right_wheel_force_kN"),
        ("left_lift_force_kN", "right_lift_force_kN"),
        ("left_force_z_kN", "right_force_z_kN"),
    ],
)
def test_forces_that_do_not_drive_are_no_force_of_both_sides(
    tmp_path: Path, names: tuple[str, str]
) -> None:
    channels, _ = proposed(tmp_path, speed__kmh=V, **dict.fromkeys(names, A))
    assert "force_x_N" not in channels


def test_an_engine_gives_a_force_in_any_gear(tmp_path: Path) -> None:
    channels, questions = proposed(
        tmp_path,
        ActualEnginePercentTorque=50.0 + 40.0 * A,
        EngineSpeed=800.0 + 300.0 * V,
        WheelBasedVehicleSpeed=3.6 * V,
        TransmissionCurrentGear=np.round(V),
    )
    force = channels["force_x_N"]
    assert force.derive is not None
    assert "torque_percent * REFERENCE_TORQUE [N*m] * engine_rpm" in force.derive
    (gear,) = (each for each in questions if "TransmissionCurrentGear" in each)
    assert "channels.gear_ratio_1" in gear
    assert "motor_current_A" not in channels


@pytest.mark.parametrize(
    "wheels", [("Moment VL", "Moment HL", "Moment VR", "Moment HR"), ("fl", "rl", "fr", "rr")]
)
def test_torques_of_four_wheels_add_up_on_each_side(
    tmp_path: Path, wheels: tuple[str, ...]
) -> None:
    names = [wheel if " " in wheel else f"wheel_torque_{wheel}" for wheel in wheels]
    channels, questions = proposed(
        tmp_path, speed__kmh=V, **{f"{name}__Nm": A + i for i, name in enumerate(names)}
    )
    assert channels["torque_left_N_m"].derive == "torque_front_left_N_m + torque_rear_left_N_m"
    assert channels["torque_right_N_m"].derive == "torque_front_right_N_m + torque_rear_right_N_m"
    assert channels["torque_rear_left_N_m"].field == f"{names[1]} [Nm]"
    assert questions == []


def test_speeds_of_four_wheels_have_a_mean_on_each_side(tmp_path: Path) -> None:
    columns = {
        f"speed_{axle}_{side}__kmh": V * factor
        for axle, factor in (("front", 1.0), ("rear", 1.3))
        for side in ("left", "right")
    }
    channels, questions = proposed(tmp_path, force__N=A, **columns)
    assert channels["speed_left_m_s"].derive == "mean(speed_front_left_m_s, speed_rear_left_m_s)"
    assert channels["speed_right_m_s"].derive == "mean(speed_front_right_m_s, speed_rear_right_m_s)"
    assert questions == []


def test_motors_of_four_wheels_make_one_force(tmp_path: Path) -> None:
    places = ("front_left", "front_right", "rear_left", "rear_right")
    channels, _ = proposed(tmp_path, speed__kmh=V, **{f"{p}_motor_torque__Nm": A for p in places})
    derivation = channels["force_x_N"].derive or ""
    assert all(f"{place}_motor_torque_N_m" in derivation for place in places)


def test_two_torques_of_a_side_that_are_of_no_axle_are_a_question(tmp_path: Path) -> None:
    columns = {f"torque_{side}_{n}__Nm": A + n for side in ("left", "right") for n in (1, 2)}
    _, questions = proposed(tmp_path, speed__kmh=V, **columns)
    assert sum("if they act together, their sum" in question for question in questions) == 2


def test_a_side_with_two_wheels_beside_a_side_with_one_is_a_question(tmp_path: Path) -> None:
    columns = {"torque_left": A, "torque_front_right": A, "torque_rear_right": A}
    channels, _ = proposed(tmp_path, speed__kmh=V, **columns)
    assert not {"torque_left_N_m", "torque_front_left_N_m"} & set(channels)


def test_a_pitch_is_proposed_as_a_comment_since_no_log_shows_its_sign(tmp_path: Path) -> None:
    other = {"cmd_pitch__deg": A, "bucket_pitch__deg": A}
    columns = {"force__N": A, "speed__kmh": V, **other, "pitch__deg": A}
    channels, questions = proposed(tmp_path, **columns)
    assert channels["pitch_rad"].is_comment
    assert (channels["pitch_rad"].field, channels["pitch_rad"].unit) == ("pitch [deg]", "deg")
    assert "positive nose up" in channels["pitch_rad"].reason
    assert questions == []


@pytest.mark.parametrize(("name", "asks"), [("gnss_speed_m_s", True), ("speed_m_s", False)])
def test_a_speed_by_satellites_beside_that_of_a_wheel_is_a_question(
    tmp_path: Path, name: str, asks: bool
) -> None:
    columns = {name: V, "wheel_speed_rad_s": V / 0.4}
    channels, questions = proposed(tmp_path, force__N=A, **columns)
    assert channels["speed_x_m_s"].field == name
    assert any("negative in reverse" in question for question in questions) == asks
