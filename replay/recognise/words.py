"""Interpret the words of column names: quantity, part, side, axle and axis."""

import re
from collections.abc import Collection
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Final

from replay.recognise.recognise_limits import LIMITS

#: First letters of words in a name, by quantity; the first match counts.
_QUANTITIES: Final = (
    ("erpm", ("erpm",)),
    ("gear ratio", ("gearratio", "driveratio", "übersetzung", "getriebeübersetzung")),
    ("gear", ("gear", "gears", "currentgear", "selectedgear", "gang")),
    ("force", ("force", "kraft", "drawbar", "pull", "traction", "drawbarpull", "fuerza", "thrust",
               "loadcell", "усилие", "сила", "тяга", "kuvvet", "força", "forza", "siła", "kracht",
               "voima", "forță", "vonóerő", "lựckéo", "gaya", "δύναμη", "牵引力", "견인력",
               "けん引力")),
    ("torque", ("torque", "drehmoment", "moment", "trq", "tq", "mz", "my", "couple", "effort", "nm",
                "момент", "tork", "koppel")),
    ("current", ("current", "strom", "amps", "amp", "iq", "courant", "corriente")),
    ("power", ("power", "leistung", "puissance", "watts", "мощность", "güç")),
    ("pressure", ("pressure", "druck", "press", "presion", "pression")),
    ("acceleration", ("acc", "accel", "acceleration", "beschleunigung", "longacc", "ax",
                      "ay", "az")),
    ("yaw rate", ("yawrate", "gyroz", "gierrate", "omegaz")),
    ("angular speed", ("omega", "angularspeed", "winkelgeschwindigkeit")),
    ("speed", ("speed", "velocity", "vel", "spd", "geschwindigkeit", "geschw", "velocidad",
               "vitesse", "drehzahl", "rpm", "kph", "kmh", "mph", "скорость", "hız", "velocidade",
               "velocità", "prędkość", "snelheid", "hastighet", "nopeus", "rychlost", "швидкість",
               "sebesség", "viteză", "vậntốc", "kecepatan", "brzina",
               "ταχύτητα", "速度",
               "车速", "속도")),
    ("position", ("position", "pos", "distance", "dist", "weg", "odometer", "travel",
                  "displacement", "stroke", "crosshead")),
    ("encoder", ("encoder", "encoders", "ticks", "tick", "encoderticks", "wheelticks")),
    ("steering", ("steer", "steering", "articulation", "lenk", "lenkwinkel")),
    ("boom", ("boom", "lift", "arm", "ausleger", "hub")),
    ("bucket", ("bucket", "tilt", "schaufel", "cuchara")),
    ("latitude", ("latitude", "lat")),
    ("longitude", ("longitude", "lon", "lng")),
)  # fmt: skip
_SIDES: Final = {
    "left": ("left", "l", "lh", "links", "izquierda", "gauche", "fl", "rl", "vl", "hl"),
    "right": ("right", "r", "rh", "rechts", "derecha", "droite", "fr", "rr", "vr", "hr"),
}
_AXLES: Final = {
    "front": ("front", "fl", "fr", "vl", "vr", "vorn", "vorne", "avant", "delantera"),
    "rear": ("rear", "rl", "rr", "hl", "hr", "hinten", "back", "arrière", "arriere", "trasera"),
}
_AXES: Final = {
    "x": ("x", "ax", "longitudinal", "long", "längs", "laengs"),
    "y": ("y", "ay", "lateral", "lat"),
    "z": ("z", "az", "vertical", "vert"),
}
_MOTOR: Final = ("motor", "engine", "eng", "drive", "mot", "shaft", "input", "spindle")
_SUPPLY: Final = ("battery", "batt", "input", "in", "supply", "bus", "dc", "pack", "batterie")
_WITHOUT_GRAVITY: Final = ("linear", "gps", "calculated", "calc", "derived", "without", "kinematic")
_WHEEL: Final = ("wheel", "rad", "hub", "axle", "tire", "tyre", "wheels")

#: Words for setpoints, limits and ends of intervals, which are not readings of a sensor.
_NO_READING: Final = frozenset((
    "goal", "setpoint", "setpt", "soll", "sollwert", "target", "demand", "demanded", "desired",
    "wanted", "command", "commands", "commanded", "cmd", "cmdvel",
    "setpoints", "targets", "request", "requested", "reference", "ref",
    "consigne", "limit", "limits", "min", "max", "minimum", "maximum", "peak", "threshold",
    "error", "std", "deviation", "covariance", "cov", "variance", "var", "sigma",
    "grenze", "grenzwert",
))  # fmt: skip
#: First letters of words for things other than the machine's motion and drive: wind, brakes, tools.
_ELSEWHERE: Final = re.compile(
    r"\b(?:wind|air\b|fan\b|lüfter|blower|pump|compressor|turbo|alternator|generator|brak|brems"
    r"|frein|fren[oa]|pedal|steer|lenk|vertical|normal\b|preload|spring|damper|suspension|seat|door"
    r"|valve|spool|piston|cylinder|zylinder|hubkraft|hubwerk|hoist|winch|crane|mast\b|belt|conveyor"
    r"|grip|clamp|drum|roller|auger|cutter|pto\b)"
)


def _compile_pattern_of_long_words(words: tuple[str, ...]) -> re.Pattern[str] | None:
    """Compile a pattern of the words that are long enough for parts of compounds, or None."""
    long = [word for word in words if len(word) > LIMITS.part_word_min_letters]
    return re.compile("|".join(long)) if long else None


_KNOWN: Final = tuple(
    (name, frozenset(words), _compile_pattern_of_long_words(words)) for name, words in _QUANTITIES
)

#: Prefix l or r before a capital, more often a variable's type (rSpeed is a REAL) than a side.
_PREFIX: Final = re.compile(r"(?:(?<=[^A-Za-z])|^)[lr](?=[A-Z])")


def is_side_prefix_confirmed(name: str, all_names: Collection[str]) -> bool:
    """Whether a prefix `l` or `r` of a name, if any, is a side: the other one must exist too.

    Args:
        name: name of a column.
        all_names: names of all columns.
    """
    match = _PREFIX.search(name)
    if match is None:
        return True
    other = "l" if match[0] == "r" else "r"
    return f"{name[: match.start()]}{other}{name[match.end() :]}" in all_names


def move_trailing_side_to_front(column_name: str) -> str:
    """Move a side at a name's end to its front, so that a unit is last, as in `torque_nm.left`."""
    *rest, last = re.split(r"[._ ](?=[^._ ]*$)", column_name)
    is_side = any(last.lower() in words for words in _SIDES.values())
    return f"{last}_{rest[0]}" if rest and rest[0] and is_side else column_name


@dataclass(frozen=True, slots=True)
class ColumnMeaning:
    """Meaning of a column's name; attributes that the name does not state are None."""

    quantity: str | None
    side: str | None
    axis: str | None
    part: str | None
    axle: str | None
    is_linkage: bool = False  #: of the boom or the bucket
    is_without_gravity: bool = False  #: an acceleration that a program or a GPS made
    is_of_supply: bool = False  #: of the battery or of what feeds a drive
    is_no_reading: bool = False  #: wanted or allowed, or the end of an interval
    is_elsewhere: bool = False  #: of the wind, the brakes, a tool: not of the machine's motion


@lru_cache(maxsize=1 << 12)
def interpret_column_name(column_name: str) -> ColumnMeaning:
    """Interpret the words of a column's name.

    Args:
        column_name: name without its unit.
    """
    spaced = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", column_name)
    words = [word for word in re.split(r"[\W\d_]+", spaced.lower()) if word]
    joined = ["".join(pair) for pair in pairwise(words)]
    own, text = frozenset((*words, *joined)), " ".join(words)
    quantity = next(
        (
            quantity
            for quantity, whole, part in _KNOWN
            if not own.isdisjoint(whole) or (part is not None and part.search(text))
        ),
        None,
    )
    side, axis, axle = (
        next((name for name, known in table.items() if any(w in known for w in words)), None)
        for table in (_SIDES, _AXES, _AXLES)
    )
    part = "motor" if any(w in _MOTOR or w.startswith("motor") for w in words) else None
    part = part or ("wheel" if any(w in _WHEEL for w in words) else None)
    linkage = any(
        word in starts for q, starts in _QUANTITIES if q in ("boom", "bucket") for word in words
    )
    without = any(word in _WITHOUT_GRAVITY for word in words)
    # the input of a gear is a shaft, but an input current is that of the supply
    of_motor = any(word.startswith("mot") for word in words)
    supply = not of_motor and any(word in _SUPPLY for word in words)
    no_reading = not own.isdisjoint(_NO_READING)
    elsewhere = _ELSEWHERE.search(text) is not None
    return ColumnMeaning(
        quantity, side, axis, part, axle, linkage, without, supply, no_reading, elsewhere
    )
