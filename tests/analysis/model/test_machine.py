"""The machine file's models: what they refuse, and in which words."""

import pytest
from pydantic import ValidationError

from analysis.model.machine import Channel, LogSection, Machine
from analysis.model.machine_body import Body

FORCE = {"force_x_N": {"topic": "/can", "field": "force"}}
SPEED = {"speed_x_m_s": {"topic": "/can", "field": "speed"}}
IMU = {"specific_force_x_m_s2": {"topic": "/imu", "field": "x"}}
TORQUES = {
    "torque_left_N_m": {"topic": "/can", "field": "left"},
    "torque_right_N_m": {"topic": "/can", "field": "right"},
}


def load(channels=None, body=None, settings=None, **sections):
    return Machine.model_validate(
        {
            "machine": {"name": "loader", **(body or {})},
            "channels": FORCE | SPEED | IMU if channels is None else channels,
            "settings": settings or {},
            **sections,
        }
    )


def refusal(*args, **kwargs):
    with pytest.raises(ValidationError) as error:
        load(*args, **kwargs)
    return "; ".join(e["msg"].removeprefix("Value error, ") for e in error.value.errors())


def test_a_name_and_three_channels_are_enough():
    machine = load()
    assert machine.machine.force_share == 1.0
    assert machine.machine.gravity_m_s2 == 9.80665
    assert str(machine.machine.time_zone) == "UTC"
    assert machine.settings.gate.window_samples == 320
    assert machine.log == LogSection()


@pytest.mark.parametrize(
    "sections",
    [
        {"body": {"wheel_radius": 0.4}},
        {"settings": {"xyz": 3}},
        {"settings": {"gate": {"windows": 3}}},
        {"fleet": {}},
        {"log": {"times": "t"}},
        {"channels": FORCE | SPEED | IMU | {"pitch_rad": {"field": "p", "units": "deg"}}},
        {"body": {"imu": {"roll": 1.0}}},
        {"settings": {"verdict": {"r2": 0.5}}},
    ],
)
def test_an_unknown_key_is_refused_in_every_section(sections):
    assert "Extra inputs are not permitted" in refusal(**sections)


def test_a_setting_outside_its_stage_is_refused_with_the_stage():
    assert refusal(settings={"windows": 3}) == (
        "unknown key 'windows'; did you mean 'settings.gate.window_samples'?"
    )


@pytest.mark.parametrize(
    "body",
    [
        {"empty_mass_kg": 0.0},
        {"empty_mass_kg": -3.0},
        {"empty_mass_u_kg": -1.0},
        {"wheel_radius_m": 0.0},
        {"wheel_radius_m": 350.0},
        {"force_gain_u": 5.0},
        {"wheel_radius_u_m": -0.1},
        {"track_width_m": -1.0},
        {"track_width_u_m": -0.1},
        {"force_share": 0.0},
        {"force_share": 1.1},
        {"force_share_u": -0.1},
        {"gravity_m_s2": 1.62},
        {"gravity_m_s2": 9.95},
        {"empty_mass_kg": float("nan")},
        {"empty_mass_kg": float("inf")},
        {"imu": {"yaw_deg": float("nan")}},
        {"imu": {"position_m": [1.0, 2.0]}},
    ],
    ids=str,
)
def test_a_body_that_cannot_be_is_refused(body):
    assert refusal(body=body)


def test_a_time_zone_must_exist():
    assert str(load(body={"timezone": "America/Santiago"}).machine.time_zone) == "America/Santiago"
    assert refusal(body={"timezone": "Santiago"}) == (
        "no time zone 'Santiago'; use a name like 'America/Santiago' or 'UTC'"
    )


@pytest.mark.parametrize(
    ("channel", "fault"),
    [
        ({}, "give either 'field' (with 'topic') or 'derive'"),
        (
            {"field": "x", "derive": "d/dt speed_x_m_s"},
            "give either 'field' (with 'topic') or 'derive'",
        ),
        (
            {"derive": "integral speed_x_m_s"},
            "cannot derive 'integral speed_x_m_s': 'integral speed_x_m_s': expected an operator, "
            "found 'speed_x_m_s'",
        ),
        (
            {"derive": "mean(a, b, c)"},
            "channels.acc_x_m_s2: 'a' is neither a channel nor a key of [machine]; "
            "known: acc_x_m_s2, empty_mass_kg, force_share, force_x_N, gravity_m_s2, "
            "specific_force_x_m_s2, speed_x_m_s, track_width_m, wheel_radius_m",
        ),
        (
            {"derive": "0.3 [m/s^2]"},
            'cannot derive \'0.3 [m/s^2]\'; use "d/dt NAME", "mean(NAME, NAME)", arithmetic as '
            '"torque_N_m / 0.35 [m]", or "pitch(FIELD)" and "roll(FIELD)" of a quaternion',
        ),
        (
            {"derive": "d/dt speed_x_m_s", "topic": "/can"},
            "a derived channel takes no 'topic' and no 'unit'; remove it",
        ),
        (
            {"derive": "d/dt speed_x_m_s", "unit": "m/s"},
            "a derived channel takes no 'topic' and no 'unit'; remove it",
        ),
        (
            {"derive": "d/dt speed_x_m_s", "delay_s": 0.1},
            "a derived channel takes no 'delay_s'; set delay_s of its source channels",
        ),
        (
            {"derive": "pitch(q)", "topic": "/imu"},
            "channels.acc_x_m_s2: 'pitch(q)' computes pitch_rad; rename the channel to that",
        ),
        (
            {"derive": "pitch(q)", "topic": "/imu", "scale": 2.0},
            "an angle of a quaternion takes no 'unit', 'scale' or 'offset'; remove it",
        ),
        ({"field": "x", "delay_s": float("inf")}, "Input should be a finite number"),
        ({"field": "x", "scale": float("nan")}, "Input should be a finite number"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_a_channel_that_cannot_be_is_refused(channel, fault):
    assert refusal(FORCE | SPEED | IMU | {"acc_x_m_s2": channel}) == fault


def test_derivations_are_read_with_any_spacing():
    rate = Channel(derive="  d/dt   speed_x_m_s ")
    assert (rate.differentiated_channel, rate.averaged_channels) == ("speed_x_m_s", None)
    assert rate.direct_source_channels == ("speed_x_m_s",)
    mean = Channel(derive="mean( speed_left_m_s ,speed_right_m_s)")
    assert (mean.differentiated_channel, mean.averaged_channels) == (
        None,
        ("speed_left_m_s", "speed_right_m_s"),
    )
    assert Channel(field="x").direct_source_channels == ()


@pytest.mark.parametrize(
    ("channels", "fault"),
    [
        (
            FORCE | SPEED | IMU | {"speed_x_ms": {"field": "x"}},
            "channels.speed_x_ms: there is no channel of this name; did you mean 'speed_x_m_s'?",
        ),
        (
            FORCE | SPEED | IMU | {"acc_x_m_s2": {"derive": "d/dt speed_left_m_s"}},
            "channels.acc_x_m_s2: 'speed_left_m_s' is not a channel; add it",
        ),
        (
            FORCE
            | IMU
            | {
                "speed_x_m_s": {"derive": "d/dt position_x_m"},
                "position_x_m": {"derive": "d/dt speed_x_m_s"},
            },
            "these channels cannot be computed, since some are derived from each other in a "
            "circle: speed_x_m_s, position_x_m; give one of them a field",
        ),
        (
            FORCE | IMU | {"speed_x_m_s": {"derive": "d/dt speed_x_m_s"}},
            "these channels cannot be computed, since some are derived from each other in a "
            "circle: speed_x_m_s; give one of them a field",
        ),
        (
            SPEED | IMU,
            "no force channel: give channels.force_x_N, or channels.torque_left_N_m and "
            "channels.torque_right_N_m",
        ),
        (
            SPEED | IMU | {"torque_left_N_m": {"field": "x"}},
            "no force channel: give channels.force_x_N, or channels.torque_left_N_m and "
            "channels.torque_right_N_m",
        ),
        (
            TORQUES | SPEED | IMU,
            "wheel torques need machine.wheel_radius_m to become a force (equation 17 of the "
            "paper)",
        ),
        (
            FORCE | IMU,
            "no speed channel: give channels.speed_x_m_s, or derive it, for example "
            'derive = "d/dt position_x_m" or "mean(speed_left_m_s, speed_right_m_s)"',
        ),
        (
            FORCE | SPEED,
            "settings.forces.acceleration is 'specific_force', which needs "
            "channels.specific_force_x_m_s2; give that channel, or set "
            'settings.forces.acceleration = "kinematic"',
        ),
    ],
    ids=[
        "unknown column",
        "unknown source",
        "circle",
        "itself",
        "no force",
        "one torque",
        "no radius",
        "no speed",
        "no acceleration",
    ],
)
def test_channels_that_do_not_make_a_regressor_are_refused_with_the_remedy(channels, fault):
    assert refusal(channels) == fault


def test_kinematic_acceleration_needs_its_own_channel():
    assert "channels.acc_x_m_s2" in refusal(settings={"forces": {"acceleration": "kinematic"}})
    derived = FORCE | SPEED | {"acc_x_m_s2": {"derive": "d/dt speed_x_m_s"}}
    assert load(derived, settings={"forces": {"acceleration": "kinematic"}})


def test_wheel_torques_with_a_radius_are_a_force():
    assert load(TORQUES | SPEED | IMU, {"wheel_radius_m": 0.4})


def test_channels_are_derived_after_their_sources():
    chain = FORCE | {
        "acc_x_m_s2": {"derive": "d/dt speed_x_m_s"},
        "speed_x_m_s": {"derive": "mean(speed_left_m_s, speed_right_m_s)"},
        "speed_right_m_s": {"field": "r"},
        "speed_left_m_s": {"field": "l"},
    }
    order = load(
        chain, settings={"forces": {"acceleration": "kinematic"}}
    ).order_channels_by_derivation()
    assert sorted(order) == sorted(chain)
    for name in order:
        for source in Channel.model_validate(chain[name]).direct_source_channels:
            assert order.index(source) < order.index(name)


def test_nothing_of_a_machine_changes_once_made():
    machine = load()
    with pytest.raises(ValidationError, match="frozen"):
        machine.machine.force_share = 0.5
    assert isinstance(machine.machine, Body)


ANGULAR = {
    f"speed_{side}_m_s": {"topic": "/wheels", "field": side, "scale": "wheel_radius_m"}
    for side in ("left", "right")
}
WHEELS = (
    TORQUES | ANGULAR | IMU | {"speed_x_m_s": {"derive": "mean(speed_left_m_s, speed_right_m_s)"}}
)


def scaled(scale, **more):
    channels = {name: {**channel, "scale": scale, **more} for name, channel in ANGULAR.items()}
    return WHEELS | channels


def test_the_radius_is_the_scale_of_wheels_in_rad_s():
    machine = load(WHEELS, {"wheel_radius_m": 0.42})
    assert machine.channels["speed_left_m_s"].scale == 0.42
    assert Machine.model_validate(machine.model_dump()) == machine


def test_a_scale_by_a_radius_that_is_not_stated_is_refused():
    said = refusal(FORCE | IMU | {"speed_x_m_s": ANGULAR["speed_left_m_s"]})
    assert said == 'channels.speed_x_m_s: scale = "wheel_radius_m" needs machine.wheel_radius_m'


@pytest.mark.parametrize("scale", [0.42, -0.42, 0.84 / 1.1, 0.5])
def test_two_radii_of_one_wheel_are_refused_with_both_keys(scale):
    said = refusal(scaled(scale), {"wheel_radius_m": 0.84 if abs(scale) != 0.5 else 0.42})
    assert "channels.speed_left_m_s.scale" in said
    assert "machine.wheel_radius_m" in said
    assert 'scale = "wheel_radius_m"' in said


@pytest.mark.parametrize("scale", [0.40, 0.44, -0.42, 1.0, 0.05, 0.1047])
def test_a_worn_tyre_a_gear_and_a_speed_in_m_s_are_no_second_radius(scale):
    load(scaled(scale), {"wheel_radius_m": 0.42})


def test_a_scale_in_a_stated_unit_is_no_radius():
    load(scaled(0.5, unit="km/h"), {"wheel_radius_m": 0.42})


@pytest.mark.parametrize("scale", [0.27778, 0.44704, -0.3048])
def test_a_scale_that_is_a_unit_of_speed_is_no_radius(scale):
    load(scaled(scale), {"wheel_radius_m": 0.42 if scale != 0.44704 else 0.6})


@pytest.mark.parametrize(
    ("derive", "sources", "expected"),
    [
        (
            "motor_torque_N_m * gear_ratio / wheel_radius_m",
            ("motor_torque_N_m", "gear_ratio"),
            ("motor_torque_N_m",),
        ),
        (
            "(pressure_a_Pa - pressure_b_Pa) * displacement_percent * 0.001 [m**2]",
            ("pressure_a_Pa", "pressure_b_Pa", "displacement_percent"),
            ("pressure_a_Pa", "pressure_b_Pa"),
        ),
        (
            "where(abs(speed_x_m_s) > 0.3 [m/s], torque_percent * 800 [N*m] / speed_x_m_s)",
            ("torque_percent",),
            ("torque_percent",),
        ),
    ],
)
def test_a_force_is_made_of_recorded_forces_and_not_of_gears_and_speeds(derive, sources, expected):
    channels = {name: {"topic": "/can", "field": name} for name in sources}
    made = load(SPEED | IMU | channels | {"force_x_N": {"derive": derive}}, {"wheel_radius_m": 0.4})
    assert made.recorded_force_channels == expected


def test_a_copy_with_other_channels_has_a_force_of_its_own():
    machine = load()
    assert machine.recorded_force_channels == ("force_x_N",)
    torques = {name: Channel.model_validate(each) for name, each in TORQUES.items()}
    copied = machine.model_copy(update={"channels": torques})
    assert copied.recorded_force_channels == tuple(TORQUES)
