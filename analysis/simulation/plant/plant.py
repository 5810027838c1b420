"""The machine on a straight line, integrated in fixed steps: Runge-Kutta of the fourth order.

Wheels and body are two masses with a torsional spring between them, or one mass if the driveline is
rigid; motor and brakes follow their commands with a first-order lag; the body pitches. The x row of
`body`, with the terms of a drivetrain:

    F η = (m_w + m_r) dv_w/dt + m_w g_x + b v_w + F_c sign(v_w) + S,   S = m_b (dv_b/dt + g_x)

Friction sticks: wheels at rest are held until the force on them exceeds the largest holding force.
If they come to rest within a step, the step is shortened to end there.
"""

import math
from typing import Final

import numpy as np

from analysis.simulation.plant.plant_inputs import DriveStage, MachineAndGround
from analysis.simulation.plant.resistance import (
    compute_cold_friction_fraction,
    compute_coulomb_friction_newtons,
    compute_gentle_brake_force_newtons,
    compute_rolling_resistance_newtons,
)
from estimators.arrays import Floats
from estimators.compiled import compiled, compiled_inline

#: The state: position, speed of wheels and body, elongation between them, forces, pitch.
POSITION, WHEEL, BODY, STRETCH, DRIVE, BRAKE, PITCH, PITCH_RATE = range(8)
#: Length of the state.
STATES: Final = 8
#: Outputs after the derivatives of the state: present forces, mass and yaw rate.
_PULL, _CAPACITY, _FORCE, _GROUND, _BRAKED, _MASS, _YAW_RATE = range(8, 15)
#: Length of the derivatives with these outputs.
_OUT: Final = 15
#: Columns of a recorded row: time, the state (in between), and further values.
TIME, ACCELERATION, FORCE, GROUND, BRAKED, MASS, YAW_RATE, STANDS = (0, *range(9, 16))
#: Number of columns of a row.
COLUMNS: Final = 16
#: Smaller friction, in N, is lost in rounding and holds nothing.
_LEAST_GRIP: Final = 1e-6
#: Speed in m/s above which a turning start has its full yaw rate.
_TURNS_AT: Final = 0.1
_HALVINGS: Final = 60


@compiled_inline
def limit_motor_force(commanded_N: float, speed_m_s: float, machine: MachineAndGround) -> float:
    """Force of the motor in N: the commanded force, limited in power and speed while it drives."""
    force_N = commanded_N
    if force_N * speed_m_s > 0.0:
        fast = abs(speed_m_s)
        if machine.no_load_m_s > 0.0:
            force_N *= max(0.0, 1.0 - fast / machine.no_load_m_s)
        if machine.power_W > 0.0 and abs(force_N) * fast > machine.power_W:
            force_N = math.copysign(machine.power_W / fast, force_N)
    return force_N


@compiled_inline
def compute_force_or_speed_command(
    time_s: float, stage: DriveStage, wave: Floats, wave_step_s: float
) -> float:
    """Commanded drive force in N or, for a pedal, the target speed in m/s."""
    since_s = time_s - stage.start_s
    if wave.size:
        place = since_s / wave_step_s
        first = min(max(int(place), 0), wave.size - 2)
        return wave[first] + (wave[first + 1] - wave[first]) * (place - first)
    if stage.stick_share > 0.0:
        back = 0.5 - 0.5 * math.cos(stage.stick_rad_s * since_s)
        return stage.drive_N * (1.0 - stage.stick_share * back)
    return stage.drive_N


@compiled_inline
def compute_pedal_and_brake_force(
    target_m_s: float, speed_m_s: float, stage: DriveStage
) -> tuple[float, float]:
    """Drive force and brake force in N that a pedal commands."""
    ahead_N = stage.way * stage.pedal_N_s_m * (target_m_s - speed_m_s)
    if ahead_N >= 0.0:
        return stage.way * min(ahead_N, stage.most_drive_N), 0.0
    slowing_N = stage.way * min(-ahead_N, stage.most_brake_N)
    return (-slowing_N, 0.0) if stage.motor_brakes > 0.0 else (0.0, slowing_N)


@compiled_inline
def _rotating_mass_kg(speed_m_s: float, machine: MachineAndGround) -> float:
    """Equivalent rotating mass in kg in the gear at a speed."""
    for gear in range(machine.gears.shape[0]):
        if abs(speed_m_s) < machine.gears[gear, 0]:
            return machine.rotating_kg + machine.gears[gear, 1]
    return machine.rotating_kg


@compiled_inline
def compute_total_mass_kg(time_s: float, stage: DriveStage) -> float:
    """Mass of machine and load in kg at a time in s, while material fills in or falls off."""
    mass = stage.mass_kg + stage.fill_kg_s * (time_s - stage.start_s)
    if stage.spill_1_s > 0.0:
        mass += stage.load_kg * math.expm1(-stage.spill_1_s * (time_s - stage.start_s))
    return mass


@compiled_inline
def compute_pitch_acceleration_rad_s2(
    y: Floats, acc_m_s2: float, load_kg: float, machine: MachineAndGround
) -> float:
    """Pitch acceleration on springs under load and acceleration."""
    squat = (machine.squat_s2_m + machine.squat_s2_m_kg * load_kg) * acc_m_s2
    squat += machine.pitch_1_kg * load_kg
    return machine.squat_rad_s * (
        machine.squat_rad_s * (squat - y[PITCH]) - 2.0 * machine.squat_damping * y[PITCH_RATE]
    )


@compiled_inline
def _fill_state_rates(  # noqa: PLR0913, PLR0915 - compiled: what changes, and what does not
    time_s: float,
    state: Floats,
    direction: float,
    one_way: float,
    machine: MachineAndGround,
    stage: DriveStage,
    wave: Floats,
    wave_step_s: float,
    out: Floats,
) -> None:
    """Compute the derivatives of the state, and the forces, into `out`."""
    wheel, body = state[WHEEL], state[BODY]
    mass = compute_total_mass_kg(time_s, stage)
    slope = machine.slope_rad + machine.hills_rad * math.sin(
        machine.hills_wavenumber_rad_m * state[POSITION] + machine.hills_phase_rad
    )
    gravity = stage.facing * machine.gravity_m_s2 * math.sin(slope)
    boom = machine.boom_N * math.sin(machine.boom_rad_s * time_s)
    force = limit_motor_force(state[DRIVE], wheel, machine)
    ground = force / machine.efficiency if force * wheel < 0.0 else force * machine.efficiency
    turn = stage.turn_rad_s * -math.expm1(-abs(wheel) / _TURNS_AT)
    capacity = compute_coulomb_friction_newtons(time_s, turn, machine, stage)
    capacity += compute_rolling_resistance_newtons(
        state[POSITION], wheel, turn, mass, slope, machine
    ) + compute_gentle_brake_force_newtons(time_s, direction, mass, gravity, machine, stage)
    # material that was at rest is accelerated to the speed of the body
    filling = stage.fill_kg_s * body
    soft = machine.resonance_rad_s > 0.0
    share = machine.wheel_share if soft else 1.0
    wheel_kg = share * mass + _rotating_mass_kg(wheel, machine)
    body_kg = (1.0 - share) * mass
    friction = machine.friction_N_s_m * compute_cold_friction_fraction(
        time_s, machine.friction_warming, machine.warming_s
    )
    pull = ground - friction * wheel - share * mass * gravity
    pull -= machine.air_N_s2_m2 * abs(wheel) * wheel
    pull -= stage.facing * machine.spring_N_m * state[POSITION]
    spring = 0.0
    if soft:
        reduced = wheel_kg * body_kg / (wheel_kg + body_kg)
        spring = (
            machine.resonance_rad_s
            * reduced
            * (machine.resonance_rad_s * state[STRETCH] + 2.0 * machine.damping * (wheel - body))
        )
        pull -= spring
    else:
        pull += boom - filling
    brake = state[BRAKE]
    if stage.holds > 0.0:
        brake = pull
    elif one_way != 0.0:
        brake = one_way * min(one_way * pull, 0.0)
    pull -= brake
    wheel_acc = (pull - direction * capacity) / wheel_kg if direction != 0.0 else 0.0
    body_acc = wheel_acc
    if soft:
        body_acc = (spring + boom - filling) / body_kg - gravity
    out[POSITION] = stage.facing * wheel
    out[WHEEL] = wheel_acc
    out[BODY] = body_acc
    out[STRETCH] = wheel - body if soft else 0.0
    asked, braking = compute_force_or_speed_command(time_s, stage, wave, wave_step_s), stage.brake_N
    if stage.pedal_N_s_m > 0.0:
        asked, braking = compute_pedal_and_brake_force(asked, wheel, stage)
    out[DRIVE] = (asked - state[DRIVE]) / machine.lag_s
    out[BRAKE] = (braking - state[BRAKE]) / machine.lag_s
    out[PITCH] = state[PITCH_RATE]
    out[PITCH_RATE] = compute_pitch_acceleration_rad_s2(
        state, body_acc, mass - machine.empty_kg, machine
    )
    out[_PULL] = pull
    out[_CAPACITY] = capacity
    out[_FORCE] = force
    out[_GROUND] = ground
    out[_BRAKED] = brake
    out[_MASS] = mass
    out[_YAW_RATE] = turn


@compiled_inline
def _write_state_row(row: Floats, t: float, y: Floats, out: Floats, stands: float) -> None:
    row[TIME] = t
    for i in range(STATES):
        row[1 + i] = y[i]
    row[ACCELERATION] = out[BODY]
    row[FORCE] = out[_FORCE]
    row[GROUND] = out[_GROUND]
    row[BRAKED] = out[_BRAKED]
    row[MASS] = out[_MASS]
    row[YAW_RATE] = out[_YAW_RATE]
    row[STANDS] = stands


@compiled
def integrate_runge_kutta_step(  # noqa: PLR0913 - compiled, as above
    time_s: float,
    step_s: float,
    state: Floats,
    direction: float,
    one_way: float,
    machine: MachineAndGround,
    stage: DriveStage,
    wave: Floats,
    wave_step_s: float,
    k: Floats,
    next_state: Floats,
) -> None:
    """Take a Runge-Kutta step from `state` to `next_state`; `k[0]` holds the rates at `time_s`."""
    for at in range(1, 4):
        ahead_s = step_s if at == 3 else 0.5 * step_s
        for i in range(STATES):
            next_state[i] = state[i] + ahead_s * k[at - 1, i]
        _fill_state_rates(
            time_s + ahead_s,
            next_state,
            direction,
            one_way,
            machine,
            stage,
            wave,
            wave_step_s,
            k[at],
        )
    for i in range(STATES):
        next_state[i] = state[i] + step_s / 6.0 * (k[0, i] + 2.0 * (k[1, i] + k[2, i]) + k[3, i])


@compiled
def integrate_stage_until_end_or_standstill(  # noqa: PLR0913, PLR0915 - one loop, whose grip changes within a step
    end_s: float,
    steps: int,
    ends_at_standstill: bool,
    state: Floats,
    machine: MachineAndGround,
    stage: DriveStage,
    wave: Floats,
    wave_step_s: float,
    rows: Floats,
) -> tuple[float, int, bool]:
    """Integrate a stage, at most until `end_s`.

    Args:
        end_s: latest end of the stage, since the log began.
        steps: number of steps until then.
        ends_at_standstill: whether it ends when the wheels first stand.
        state: (8,) state, changed in place.
        machine: machine and ground.
        stage: the commands.
        wave: (m,) commanded drive force or target speed every `wave_step_s`; empty uses the stage's
            own.
        wave_step_s: step of `wave`.
        rows: (2 steps + 4, 16) output rows.

    Returns:
        End of the stage, number of rows, and whether the wheels moved.
    """
    k = np.zeros((4, _OUT))
    made = np.zeros(STATES)
    t = stage.start_s
    step = (end_s - t) / steps
    direction = float(np.sign(state[WHEEL]))
    one_way = stage.one_way if direction == 0.0 else 0.0
    moved = direction != 0.0
    kept, number, blocked = 0, 0, False
    while number < steps and kept + 2 < rows.shape[0]:
        _fill_state_rates(t, state, direction, one_way, machine, stage, wave, wave_step_s, k[0])
        if direction == 0.0 and stage.holds == 0.0 and not blocked:
            pull = k[0, _PULL]
            if abs(pull) > max(k[0, _CAPACITY], _LEAST_GRIP):
                direction = math.copysign(1.0, pull)
                if one_way != 0.0:
                    state[BRAKE] = 0.0
                one_way = 0.0
                moved = True
                _fill_state_rates(
                    t, state, direction, one_way, machine, stage, wave, wave_step_s, k[0]
                )
        stands = 1.0 if direction == 0.0 and (one_way != 0.0 or stage.holds > 0.0) else 0.0
        _write_state_row(rows[kept], t, state, k[0], stands)
        kept += 1
        dt = stage.start_s + (number + 1) * step - t
        integrate_runge_kutta_step(
            t, dt, state, direction, one_way, machine, stage, wave, wave_step_s, k, made
        )
        crosses = direction != 0.0 and made[WHEEL] * direction < 0.0
        if crosses and not ends_at_standstill and k[0, _CAPACITY] <= _LEAST_GRIP:
            direction = -direction
            crosses = False
        blocked = False
        if crosses:
            least, most = 0.0, dt
            for _ in range(_HALVINGS):
                middle = 0.5 * (least + most)
                integrate_runge_kutta_step(
                    t, middle, state, direction, one_way, machine, stage, wave, wave_step_s, k, made
                )
                if made[WHEEL] * direction < 0.0:
                    most = middle
                else:
                    least = middle
            integrate_runge_kutta_step(
                t, least, state, direction, one_way, machine, stage, wave, wave_step_s, k, made
            )
            if machine.resonance_rad_s == 0.0:
                made[BODY] = 0.0
            made[WHEEL] = 0.0
            t += least
            # no progress: friction sticks for the rest of this step
            blocked = least <= 1e-9 * step
            state[:] = made
            _fill_state_rates(t, state, direction, one_way, machine, stage, wave, wave_step_s, k[0])
            _write_state_row(rows[kept], t, state, k[0], 0.0)
            kept += 1
            if ends_at_standstill:
                return t, kept, moved
            direction = 0.0
        else:
            number += 1
            t = stage.start_s + number * step
            state[:] = made
    _fill_state_rates(t, state, direction, one_way, machine, stage, wave, wave_step_s, k[0])
    stands = 1.0 if direction == 0.0 and (one_way != 0.0 or stage.holds > 0.0) else 0.0
    _write_state_row(rows[kept], t, state, k[0], stands)
    return t, kept + 1, moved


def make_state_at_rest() -> Floats:
    """State (8,) of a standing machine."""
    return np.zeros(STATES)
