"""Situations in which an answer may be wrong, each as what a scenario file says of it.

Names say what is not as the model has it. A campaign is nine starts without load unless said
otherwise; what only the replay can do wrong (a derived acceleration, braking included) is not here.
Half loaded is 250 kg from the sixth start on; a bucket that fills does so by a part of 250 kg in
five seconds of every start.
"""

from typing import Any, Final


def _start_sections(**keys: Any) -> dict[str, Any]:
    rest = {"kind": "rest", "duration_s": 5.0}
    return {"campaign": {"manoeuvres": [rest, {"kind": "start", **keys}]}}


_BOTH_WAYS: Final = {"starts": {"directions": "alternating"}}
_HALF_LOADED: Final = {"loading": {"change_kg": 250.0, "change_before_start": 5}}
_ROLLING: Final = {
    f"rolling resistance {percent} %{said}": {
        "rolling": {"coefficient": percent / 100.0},
        **ways,
    }
    for said, ways in (("", {}), (", both ways", _BOTH_WAYS))
    for percent in (1, 2, 3)
}

#: Of the machine, its load and its ground.
MACHINE: Final[dict[str, dict[str, Any]]] = {
    "250 kg more halfway": {"loading": {"change_kg": 250.0, "change_before_start": 5}},
    "250 kg more at every second start": {"loading": {"change_kg": 250.0, "alternating": True}},
    "50 kg more halfway": {"loading": {"change_kg": 50.0, "change_before_start": 5}},
    "a bucket that fills": {"loading": {"fill_kg_s": 50.0}},
    "a bucket that fills by 25 %": {"loading": {"fill_kg_s": 12.5}},
    "a bucket that fills by 50 %": {"loading": {"fill_kg_s": 25.0}},
    "a load that spills": {"campaign": {"loads_kg": [250.0]}, "loading": {"spill_1_s": 0.015}},
    **_ROLLING,
    "rolling resistance of two grounds, half loaded": {
        "rolling": {"coefficient": 0.01, "second_ground_more": 0.02, "ground_length_m": 8.0},
        **_HALF_LOADED,
    },
    "rolling resistance 2 %, half loaded": {"rolling": {"coefficient": 0.02}, **_HALF_LOADED},
    "Coulomb friction 100 N": {"machine": {"coulomb_N": 100.0}},
    "Coulomb friction 300 N": {"machine": {"coulomb_N": 300.0}},
    "Coulomb friction 700 N": {"machine": {"coulomb_N": 700.0}},
    "friction random by start": {
        "machine": {"coulomb_N": 200.0},
        "starts": {"coulomb_std_N": 100.0},
    },
    "Coulomb friction, 0.05 m/s²": {
        "machine": {"coulomb_N": 300.0},
        **_start_sections(throttle=0.085, start_s=10.0),
    },
    "slip 80 kN": {"machine": {"slip_stiffness_N": 80_000.0}},
    "slip with relaxing tyres": {
        "machine": {"slip_stiffness_N": 80_000.0},
        "drivetrain": {"relaxation_length_m": 0.4},
    },
    "slope +3°": {"terrain": {"slope_deg": 3.0}},
    "slope -3°": {"terrain": {"slope_deg": -3.0}},
    "hills": {"terrain": {"hills_deg": 3.0, "hills_length_m": 20.0}},
    "squat 0.2°": {"chassis": {"squat_deg_s2_m": 0.2}},
    "squat 0.5°": {"chassis": {"squat_deg_s2_m": 0.5}},
    "squat 1°": {"chassis": {"squat_deg_s2_m": 1.0}},
    "squat 0.5° that swings": {"chassis": {"squat_deg_s2_m": 0.5, "squat_hz": 1.5}},
    "squat 0.5° with slip 80 kN": {
        "chassis": {"squat_deg_s2_m": 0.5},
        "machine": {"slip_stiffness_N": 80_000.0},
    },
    "squat under load, half loaded": {
        "chassis": {"squat_deg_s2_m_kg": 0.002, "pitch_deg_kg": -0.002},
        **_HALF_LOADED,
    },
    "friction that warms by 25 %": {"machine": {"friction_warming": 0.25, "warming_s": 30.0}},
    "gentle brakes unseen": {"brakes": {"gentle_m_s2": 0.1}},
    "brakes release in 0.15 s": {"brakes": {"release_s": 0.15, "release_N": 2000.0}},
    "brakes release in 0.5 s": {"brakes": {"release_s": 0.5, "release_N": 2000.0}},
    "brakes drag": {"brakes": {"drag_N": 200.0}},
    "stops at 0.1 m/s² that no sensor sees": {
        "campaign": {"braking_m_s2": 0.1, "brake_measured_share": 0.0}
    },
    "brakes seen to 90 %": {"campaign": {"brake_measured_share": 0.9}},
    "scrubbing in a turn": {"starts": {"turn_rad_s": 0.04, "scrub_N_s_rad": 5000.0}},
    "rotating parts": {"drivetrain": {"rotating_kg": 150.0}},
    "efficiency 90 %": {"drivetrain": {"efficiency": 0.9}},
    "surge resonance 2 Hz": {"drivetrain": {"resonance_hz": 2.0, "resonance_damping": 0.3}},
    "surge resonance 4 Hz": {"drivetrain": {"resonance_hz": 4.0, "resonance_damping": 0.3}},
    "power-limited motor": {"drivetrain": {"power_limit_W": 4000.0}},
    "voltage-limited motor": {"drivetrain": {"no_load_speed_m_s": 3.0}},
}
#: Of the instruments and their clocks.
INSTRUMENTS: Final[dict[str, dict[str, Any]]] = {
    "slope 1°, acceleration without gravity": {
        "terrain": {"slope_deg": 1.0},
        "defects": {"acc_without_gravity": True},
    },
    "force late 10 ms": {"sensors": {"force_delay_s": 0.01}},
    "force late 50 ms": {"sensors": {"force_delay_s": 0.05}},
    "force late 150 ms": {"sensors": {"force_delay_s": 0.15}},
    "speed late 30 ms": {"sensors": {"speed_delay_s": 0.03}},
    "speed late 100 ms": {"sensors": {"speed_delay_s": 0.1}},
    "force clock +200 ppm": {"sampling": {"torque_clock_ppm": 200.0}},
    "force clock +0.1 %": {"sampling": {"torque_clock_ppm": 1000.0}},
    "topics 9 ms out of phase": {
        "sampling": {"imu_phase_s": 0.0, "torque_phase_s": 0.009, "speed_phase_s": 0.0}
    },
    "force at 10 Hz": {"sampling": {"torque_rate_hz": 10.0}},
    "speed at 10 Hz": {"sampling": {"speed_rate_hz": 10.0}},
    "wheels 5 % larger": {"machine": {"wheel_radius_excess": 0.05}},
    "wheels 5 % smaller": {"machine": {"wheel_radius_excess": -0.05}},
    "force offset +300 N": {"sensors": {"force_bias_N": 300.0}},
    "force offset -300 N": {"sensors": {"force_bias_N": -300.0}},
    "accelerometer tilted 0.3°": {"defects": {"acc_tilt_deg": 0.3}},
    "accelerometer tilted 1°": {"defects": {"acc_tilt_deg": 1.0}},
    "accelerometer tilted 3°": {"defects": {"acc_tilt_deg": 3.0}},
    "accelerometer +0.1 m/s²": {"sensors": {"acc_bias_m_s2": 0.1}},
    "accelerometer -0.05 m/s²": {"sensors": {"acc_bias_m_s2": -0.05}},
    "force low-passed 50 ms": {"defects": {"force_lag_s": 0.05}},
    "force low-passed 200 ms": {"defects": {"force_lag_s": 0.2}},
    "vibration 0.3 m/s²": {"defects": {"vibration_m_s2": 0.3}},
    "share of 0.5 falls 0.02 a m/s²": {"defects": {"force_share_s2_m": 0.04}},
    "share grows with the load": {
        "defects": {"force_share_1_kg": 1.7e-4},
        "campaign": {"loads_kg": [250.0]},
    },
    "half loaded, force gain drifts 1 %": {
        "defects": {"force_gain_drift": 0.01},
        **_HALF_LOADED,
    },
    "force gain drifts 5 %": {"defects": {"force_gain_drift": 0.05}},
    "torque scale +10 %": {"sensors": {"force_gain": 1.1}},
    "torque scale -10 %": {"sensors": {"force_gain": 0.9}},
    "force clipped": {"defects": {"force_clip_N": 4500.0}},
    "frozen force": {"defects": {"frozen_topic": "torque", "frozen_every_s": 8.0}},
    "frozen speed": {"defects": {"frozen_topic": "speed", "frozen_every_s": 8.0}},
    "frozen IMU": {"defects": {"frozen_topic": "imu", "frozen_every_s": 8.0}},
}
#: Found harmless: within 1 % of the mass.
HARMLESS: Final[dict[str, dict[str, Any]]] = {
    "stamp jitter 5 ms": {"sampling": {"stamp_jitter_s": 0.005}},
    "stamp jitter 20 ms": {"sampling": {"stamp_jitter_s": 0.02}},
    "drops 10 %": {"log": {"dropout_share": 0.1}},
    "swapped messages": {"log": {"swapped_share": 0.1}},
    "speed quantised to 0.05 m/s": {"sensors": {"speed_lsb_m_s": 0.05}},
    "boom motion": {"chassis": {"boom_kg": 200.0}},
    "coasting": _start_sections(coast_s=2.0),
    "restless stick": {"starts": {"stick_share": 0.3}},
    "throttle and direction differ": {
        "starts": {"throttle_least": 0.5, "directions": "alternating"}
    },
    "one short start": {"campaign": {"runs": 1, "start_s": 1.0, "cruise_s": 0.5}},
    "sides swapped": {"defects": {"sides_swapped": True}},
}
#: Found to be rightly withheld.
WITHHELD: Final[dict[str, dict[str, Any]]] = {
    "one side's sign": {"defects": {"left_torque_gain": -1.0}},
    "cruise only": {
        "campaign": {
            "runs": 1,
            "manoeuvres": [
                {
                    "kind": "arc",
                    "speed_m_s": 1.0,
                    "yaw_rate_rad_s": 0.0,
                    "duration_s": 60.0,
                    "ramp_s": 100.0,
                }
            ],
        }
    },
    "standstill only": {"campaign": {"manoeuvres": [{"kind": "rest"}]}},
    # a pile lies before the bucket
    "digging": {
        **_start_sections(digging_N=3000.0, digging_s=3.0),
        "starts": {"directions": "as listed"},
    },
    "IMU low-passed 200 ms": {"defects": {"imu_lag_s": 0.2}},
    "force clock +1 %": {"sampling": {"torque_clock_ppm": 10_000.0}},
}
SITUATIONS: Final = {**MACHINE, **INSTRUMENTS, **HARMLESS, **WITHHELD}


def sections(name: str, **also: dict[str, Any]) -> dict[str, Any]:
    """The sections of a situation, nine starts without load unless it says otherwise.

    Args:
        name: of a situation.
        also: further keys by section, under those of the situation.
    """
    base: dict[str, dict[str, Any]] = {"campaign": {"loads_kg": [0.0], "runs": 9}}
    said = SITUATIONS[name]
    return {
        section: {**base.get(section, {}), **also.get(section, {}), **said.get(section, {})}
        for section in {**base, **also, **said}
    }
