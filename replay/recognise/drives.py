"""Propose a force derived from the outputs of a drive, for which the gear ratio is asked."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from replay.recognise.columns import TURN_UNITS
from replay.recognise.proposals import (
    SIDES,
    LogColumn,
    Recognition,
    find_columns_by_side_and_axle,
)
from replay.recognise.recognise_limits import LIMITS

GEAR_QUESTION: Final = "the gear ratio between motor and wheel: GEAR in channels.{}.derive"
_GEAR_RATIOS: Final = (
    "which ratio each gear of '{0}' has: the mass that engine or turbine add goes with its square; "
    "with '{0}' as channels.gear_1, set in channels.gear_ratio_1 "
    'derive = "where(gear_1 > 1.5, RATIO_2, RATIO_1)"'
)
RADIUS_QUESTION: Final = "machine.wheel_radius_m"
_EFFICIENCY: Final = "the EFFICIENCY from there to the wheels, in channels.force_x_N.derive"
#: Outputs of a motor: quantity, unit, name of the channel, and factor that gives the torque.
_MOTOR_OUTPUTS: Final = (
    ("torque", "N*m", "motor_torque_N_m", ""),
    ("torque", "percent", "torque_percent", " * RATED_TORQUE [N*m]"),
    ("current", "A", "motor_current_A", " * TORQUE_CONSTANT [N*m/A]"),
)


def propose_force_of_drives(columns: Sequence[LogColumn], recognition: Recognition) -> None:
    """Propose a force from motors or wheels if no column contains one."""
    if (
        "force_x_N" in recognition.filled_or_proposed_channels
        or recognition.has_channel_of_both_sides("torque_{}_N_m")
    ):
        return
    sketches = (
        add_forces_of_both_sides,
        propose_torques_without_unit,
        propose_wheel_torques_without_side,
        _propose_force_from_engine,
        propose_force_from_motors_of_both_sides,
        propose_force_from_motor,
        propose_force_from_pressures,
        _propose_force_from_power,
    )
    any(propose(columns, recognition) for propose in sketches)


def add_forces_of_both_sides(columns: Sequence[LogColumn], recognition: Recognition) -> bool:
    """Add the forces of left and right side, as of two tracks; return whether there are any."""
    driving = find_columns_by_side_and_axle(
        c
        for c in columns
        if c.quantity == "force"
        and c.has_dimension_of_channel("force_x_N")
        and c.name_meaning.axis in (None, "x")
        # the force of a wheel is more often its load than its traction
        and c.name_meaning.part != "wheel"
        and not (c.name_meaning.is_linkage or c.name_meaning.is_elsewhere)
    )
    if not driving:
        return False
    names = " and ".join(f"'{column.source_text}'" for column in driving.values())
    for place, column in driving.items():
        which = place.replace("_", " ")
        recognition.fill_channel_if_empty(column, f"force_{place}_N", f"the {which} of {names}")
    recognition.add_derived_channel(
        "force_x_N", " + ".join(f"force_{place}_N" for place in driving), names
    )
    return True


def propose_torques_without_unit(columns: Sequence[LogColumn], recognition: Recognition) -> bool:
    """Propose torques of both sides that state no unit; return whether there are any."""
    driving = find_columns_by_side_and_axle(
        c
        for c in columns
        if c.quantity == "torque" and c.unit is None and c.name_meaning.part != "motor"
    )
    if not driving:
        return False
    for place, column in driving.items():
        recognition.propose_channel_without_unit(column, f"torque_{place}_N_m")
    if len(driving) > len(SIDES):
        names = " and ".join(column.source_text for column in driving.values())
        for side in SIDES:
            recognition.propose_derived_channel_as_comment(
                f"torque_{side}_N_m", f"torque_front_{side}_N_m + torque_rear_{side}_N_m", names
            )
    recognition.add_question_of_subject("radius", RADIUS_QUESTION)
    return True


def propose_wheel_torques_without_side(
    columns: Sequence[LogColumn], recognition: Recognition
) -> bool:
    """Propose two wheel torques without a side as left and right; return whether there are any."""
    torques = [
        c
        for c in columns
        if c.quantity == "torque"
        and c.has_dimension_of_channel("torque_left_N_m")
        and c.name_meaning.part != "motor"
    ]
    wheels = [
        c
        for c in torques
        if c.name_meaning.side is None and c.name_meaning.axis in (None, "x", "y", "z")
    ]
    if len(wheels) != 2 or len(torques) != 2:
        return False
    names = " or ".join(f"'{column.source_text}'" for column in wheels)
    for side, column in zip(SIDES, wheels, strict=True):
        recognition.propose_source_of_derived_channel(
            column,
            f"torque_{side}_N_m",
            column.unit,
            f"{column.source_text}: one of two torques; its name has no side",
        )
    recognition.add_question_of_subject("radius", RADIUS_QUESTION)
    recognition.add_question_of_subject("side", f"which torque is the left one: {names}")
    return True


def is_drive_output(column: LogColumn, quantity: str, unit: str) -> bool:
    """Whether a column has this quantity and unit, and is not the supply of a drive."""
    # the supply current of a drive is power over voltage, and not a measure of torque
    is_supply = quantity == "current" and column.name_meaning.is_of_supply
    # a current without a unit is in amperes, as motor controllers write it; the unit of a torque is
    # asked for
    may_lack_unit = unit == "A" or (unit == "N*m" and column.name_meaning.part == "motor")
    has_unit = column.has_dimension_of_unit(unit) or (may_lack_unit and column.unit is None)
    return column.quantity == quantity and has_unit and not is_supply


def propose_motor_output(
    column: LogColumn, channel: str, reason: str, recognition: Recognition
) -> None:
    """Propose a motor's torque or current as a source; ask for the unit of a torque without one."""
    is_asked = column.unit is None and column.quantity == "torque"
    unit = "?" if is_asked else column.unit
    recognition.propose_source_of_derived_channel(column, channel, unit, reason)
    if is_asked:
        recognition.add_question_on_unit(column, channel)


def propose_force_from_motors_of_both_sides(
    columns: Sequence[LogColumn], recognition: Recognition
) -> bool:
    """Propose a force from torques or currents of two motors; return whether there are any."""
    for quantity, unit, name, factor in _MOTOR_OUTPUTS:
        driving = find_columns_by_side_and_axle(
            c
            for c in columns
            if is_drive_output(c, quantity, unit)
            # the current of a side is its motor's, but its torque is more often that of its wheels
            and c.name_meaning.part in (("motor", None) if quantity == "current" else ("motor",))
        )
        if not driving:
            continue
        names: list[str] = []
        reason = " and ".join(each.source_text for each in driving.values())
        reason += ": measured at the motors of both sides; needs the gear ratio"
        for place, column in driving.items():
            names.append(f"{place}_{name}")
            propose_motor_output(column, names[-1], reason, recognition)
        recognition.propose_derived_channel_as_comment(
            "force_x_N", f"({' + '.join(names)}){factor} * GEAR / wheel_radius_m", reason
        )
        add_questions_on_gear_and_motor_factor(recognition, factor)
        return True
    return False


def add_question_on_gear_ratios(columns: Sequence[LogColumn], recognition: Recognition) -> None:
    """Ask for the ratio of each gear if a column has the gear's number, but none has its ratio."""
    gear = next((each for each in columns if each.name_meaning.quantity == "gear"), None)
    in_front_of_gearbox = "force_x_N" not in recognition.recognised_channels
    if gear and in_front_of_gearbox and "gear_ratio_1" not in recognition.recognised_channels:
        recognition.add_question_of_subject("column", _GEAR_RATIOS.format(gear.source_text))


def add_questions_on_gear_and_motor_factor(recognition: Recognition, factor: str) -> None:
    """Ask for the gear ratio, the factor and the wheel radius that convert a motor's output.

    Args:
        recognition: recognition to add to.
        factor: factor that gives the torque, as in a derivation: " * NAME [unit]", or empty.
    """
    recognition.add_question_of_subject("gear", GEAR_QUESTION.format("force_x_N"))
    if factor:
        word, _, of = factor.removeprefix(" * ").partition(" ")
        recognition.add_question_of_subject(
            "gear", f"the motor's {word} in {of.strip('[]')}, in the same line"
        )
    recognition.add_question_of_subject("radius", RADIUS_QUESTION)


def propose_force_from_motor(columns: Sequence[LogColumn], recognition: Recognition) -> bool:
    """Propose a force from a motor's torque or current; return whether there is one."""
    for quantity, unit, name, factor in _MOTOR_OUTPUTS:
        fitting = [
            c for c in columns if is_drive_output(c, quantity, unit) and c.name_meaning.side is None
        ]
        fitting.sort(key=lambda c: c.name_meaning.part != "motor")
        if not fitting:
            continue
        column = fitting[0]
        alike = [c for c in fitting if c.name_meaning.part == column.name_meaning.part]
        if len(alike) > 1:
            names = ", ".join(f"'{each.source_text}'" for each in alike)
            recognition.add_question_of_subject(
                "column", f"which of {names} drive the machine: their torques are added"
            )
        if quantity == "torque" and column.name_meaning.part == "wheel":
            reason = f"{column.source_text}: at the wheels of both sides; needs their radius"
            recognition.propose_source_of_derived_channel(
                column, "wheel_torque_N_m", column.unit, reason
            )
            recognition.propose_derived_channel_as_comment(
                "force_x_N", "wheel_torque_N_m / wheel_radius_m", reason
            )
            recognition.add_question_of_subject("radius", RADIUS_QUESTION)
            return True
        reason = f"{column.source_text}: measured at the motor; needs the gear ratio"
        propose_motor_output(column, name, reason, recognition)
        recognition.propose_derived_channel_as_comment(
            "force_x_N", f"{name}{factor} * GEAR / wheel_radius_m", reason
        )
        add_questions_on_gear_and_motor_factor(recognition, factor)
        return True
    return False


def _propose_force_from_engine(columns: Sequence[LogColumn], recognition: Recognition) -> bool:
    """Propose a force from an engine's power over the speed, independent of the gear, if any."""
    engine = [c for c in columns if c.name_meaning.part == "motor"]
    torque = next((c for c in engine if (c.quantity, c.unit) == ("torque", "percent")), None)
    turns = next((c for c in engine if c.quantity == "speed" and c.unit in TURN_UNITS), None)
    if torque is None or turns is None:
        return False
    reason = (
        f"{torque.source_text}, {turns.source_text}: the engine's power; over the speed it is a "
        "force, in any gear; a converter that is open leaves little of it"
    )
    recognition.propose_source_of_derived_channel(torque, "torque_percent", torque.unit, reason)
    recognition.propose_source_of_derived_channel(turns, "engine_rpm", turns.unit, reason)
    watts = "torque_percent * REFERENCE_TORQUE [N*m] * engine_rpm"
    recognition.propose_derived_channel_as_comment(
        "force_x_N", _make_force_from_power_formula(watts), reason
    )
    recognition.add_question_of_subject("gear", _EFFICIENCY)
    recognition.add_question_of_subject(
        "gear", "the engine's REFERENCE_TORQUE in N*m, in the same line"
    )
    return True


def propose_force_from_pressures(columns: Sequence[LogColumn], recognition: Recognition) -> bool:
    """Propose a force from pressures of a hydrostatic drive; return whether there are any."""
    drive = [
        c for c in columns if c.quantity == "pressure" and c.unit and not c.name_meaning.is_linkage
    ] or find_pressure_port_pair(columns)
    if not drive or len(drive) > 2:
        return False
    names = ["pressure_high_bar", "pressure_low_bar"][: len(drive)]
    for name, column in zip(names, drive, strict=True):
        reason = f"{column.source_text}: a pressure; needs the motor's displacement and the gear"
        recognition.propose_source_of_derived_channel(column, name, column.unit, reason)
    torque = f"({' - '.join(names)})" if len(names) > 1 else names[0]
    recognition.propose_derived_channel_as_comment(
        "force_x_N",
        f"{torque} * DISPLACEMENT [m^3/turn] * GEAR / wheel_radius_m",
        "the drive's pressure times its displacement",
    )
    recognition.add_question_of_subject("gear", GEAR_QUESTION.format("force_x_N"))
    recognition.add_question_of_subject(
        "gear", "the motor's DISPLACEMENT in m³ a revolution, in the same line"
    )
    recognition.add_question_of_subject("radius", RADIUS_QUESTION)
    if len(names) > 1:
        recognition.add_question_of_subject(
            "side",
            f"which pressure drives forwards, '{drive[0].source_text}' or '{drive[1].source_text}'",
        )
    return True


def find_pressure_port_pair(columns: Sequence[LogColumn]) -> list[LogColumn]:
    """Find the only two columns in a unit of pressure whose names differ in a letter: p_a and p_b.

    Their names do not say that they are pressures; a single one may be that of a tyre or of oil.
    """
    unnamed = [c for c in columns if c.quantity is None and c.has_dimension_of_unit("Pa")]
    pairs = [
        [first, second]
        for first, second in pairwise(unnamed)
        if len(first.source_text) == len(second.source_text)
        and sum(a != b for a, b in zip(first.source_text, second.source_text, strict=True)) == 1
    ]
    return pairs[0] if len(pairs) == 1 else []


def _propose_force_from_power(columns: Sequence[LogColumn], recognition: Recognition) -> bool:
    """Propose a force from power, or current times voltage, over speed; return whether it can."""
    current = next(
        (c for c in columns if c.name_meaning.is_of_supply and c.has_dimension_of_unit("A")), None
    )
    voltage = next((c for c in columns if c.has_dimension_of_unit("V")), None)
    powers = [
        c
        for c in columns
        if c.quantity == "power" and (c.unit is None or c.has_dimension_of_unit("W"))
    ]
    power = min(powers, key=lambda c: c.unit is None, default=None)
    if power is not None and not (power.unit is None and current and voltage):
        reason = f"{power.source_text}: a power; over the speed it is a force; needs the efficiency"
        recognition.propose_source_of_derived_channel(power, "power_W", power.unit or "?", reason)
        if power.unit is None:
            recognition.add_question_on_unit(power, "power_W")
        watts = "power_W"
    else:
        if current is None or voltage is None:
            return False
        reason = (
            f"{current.source_text}, {voltage.source_text}: a power; over the speed it is a force"
        )
        recognition.propose_source_of_derived_channel(current, "supply_A", current.unit, reason)
        recognition.propose_source_of_derived_channel(voltage, "supply_V", voltage.unit, reason)
        watts = "supply_A * supply_V"
    recognition.propose_derived_channel_as_comment(
        "force_x_N", _make_force_from_power_formula(watts), reason
    )
    recognition.add_question_of_subject("gear", _EFFICIENCY)
    return True


def _make_force_from_power_formula(power_formula: str) -> str:
    """Make the formula of a force from power, with the drive's efficiency and the speed."""
    moving = f"abs(speed_x_m_s) > {LIMITS.power_min_speed_m_s} [m/s]"
    return f"where({moving}, {power_formula} * EFFICIENCY / speed_x_m_s)"
