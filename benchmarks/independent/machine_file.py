"""What the machine's owner knows of it, as a machine file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from benchmarks.independent.sensors import Instruments

_CHANNEL: Final = '[channels.{name}]\ntopic = "{topic}"\nfield = "{field}"\n'
_SIDES: Final = ("left", "right")


class Known(NamedTuple):
    """What is stated besides the channels.

    Attributes:
        empty_mass_kg: of the machine, as its owner weighed it,
        empty_mass_u_kg: with this standard uncertainty; None: not stated.
        force_gain_u: likewise, relative.
        radius_u_m: likewise.
        kinematic: acceleration from the wheels, without an accelerometer.
        spillage: share of a load that pours on the haul and its standard uncertainty, as a check
            weighing at the dump tells it; None where nothing is said.
        empty_s: when it was empty, seconds from the start; None where it is not said.
    """

    empty_mass_kg: float
    empty_mass_u_kg: float | None = None
    force_gain_u: float = 0.0
    radius_u_m: float = 0.0
    kinematic: bool = False
    empty_s: tuple[float, float] | None = None
    spillage: tuple[float, float] | None = None


def machine_file(seen: Instruments, known: Known) -> str:
    """The machine file, TOML.

    Args:
        seen: which topics there are, and the share that the force sensors measure.
        known: what else is stated.
    """
    body = {
        "name": '"independent loader"',
        "empty_mass_kg": known.empty_mass_kg,
        "empty_mass_u_kg": known.empty_mass_u_kg,
        "wheel_radius_m": seen.radius_m,
        "wheel_radius_u_m": known.radius_u_m,
        "wheel_radius_by_load_u": 0.0,
        "force_share": seen.share,
        "force_share_u": 0.0,
        "force_gain_u": known.force_gain_u,
        "track_width_m": 1.5 if seen.two_sides else None,
        "haul_spillage_share": known.spillage and known.spillage[0],
        "haul_spillage_u": known.spillage and known.spillage[1],
    }
    head = "[machine]\n" + _keys(body)
    settings = {"trace": {"methods": '["pooled"]'}}
    settings["forces"] = {
        "acceleration": '"kinematic"' if known.kinematic else '"specific_force"',
    }
    if known.empty_s is not None:
        begin, end = known.empty_s
        settings["loads"] = {"empty_from_s": f"{begin:.3f}", "empty_to_s": f"{end:.3f}"}
    tables = [f"[settings.{stage}]\n{_keys(keys)}" for stage, keys in settings.items()]
    return "\n".join([head, *_channels(seen, kinematic=known.kinematic), *tables])


def _keys(values: Mapping[str, object]) -> str:
    return "".join(f"{key} = {value}\n" for key, value in values.items() if value is not None)


def _channels(seen: Instruments, *, kinematic: bool) -> list[str]:
    found: list[tuple[str, str, str]] = []
    if seen.two_sides:
        for side in _SIDES:
            found.append((f"torque_{side}_N_m", "/drive/torque", f"effort[{side}]"))
            found.append((f"speed_{side}_m_s", "/drive/wheels", f"velocity[{side}]"))
        found.append(("yaw_rate_rad_s", "/imu/raw", "angular_velocity.z"))
    else:
        found.append(("force_x_N", "/drive/force", "wrench.force.x"))
        found.append(("speed_x_m_s", "/drive/speed", "twist.linear.x"))
    if not kinematic:
        found.append(("specific_force_x_m_s2", "/imu/raw", "linear_acceleration.x"))
    if seen.pitch_hz:
        found.append(("pitch_rad", "/inclinometer", "vector.y"))
    if seen.boom_hz:
        found.append(("boom_rad", "/boom", "position[angle]"))
    texts: list[str] = []
    for name, topic, field in found:
        text = _CHANNEL.format(name=name, topic=topic, field=field)
        texts.append(text + f"scale = {seen.radius_m}\n" if field.startswith("vel") else text)
    if seen.two_sides:
        mean = "mean(speed_left_m_s, speed_right_m_s)"
        texts.append(f'[channels.speed_x_m_s]\nderive = "{mean}"\n')
    if kinematic:
        texts.append('[channels.acc_x_m_s2]\nderive = "d/dt speed_x_m_s"\n')
    return texts


def write_machine_file(path: Path, seen: Instruments, known: Known) -> None:
    """Write `machine_file` at path."""
    path.write_text(machine_file(seen, known), encoding="utf-8")
