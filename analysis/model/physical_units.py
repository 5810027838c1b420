"""Conversion of units that users write to the SI unit of a column."""

import re
from collections import Counter
from collections.abc import Mapping
from functools import cache
from tokenize import TokenError
from typing import Any, Final

from analysis.expressions.parse import format_unit_for_pint
from analysis.model.model_limits import LIMITS
from estimators.errors import MachineError

#: Nanoseconds in a second, as a float for durations and as an integer for stamps.
NS_PER_S: Final = 1e9
NS: Final = 10**9
#: Seconds in an hour, for rates per hour.
SECONDS_PER_HOUR: Final = 3600.0
#: Exceptions that pint's tokenizer and evaluation raise for a text that is no unit.
_UNREADABLE = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    SyntaxError,
    TokenError,
    TypeError,
    ValueError,
)


@cache
def _make_unit_registry() -> Any:
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


def get_unit_registry() -> Any:
    """Unit registry of pint."""
    return _make_unit_registry()


@cache
def find_gain_and_offset_to_si(unit: str, si_unit: str) -> tuple[float, float]:
    """Gain and offset that convert a number from `unit` to `si_unit`, a unit of the schema.

    Raises:
        MachineError: an unknown unit, or one of another dimension.
    """
    target = format_unit_for_pint(si_unit)
    if unit in (si_unit, target):
        return 1.0, 0.0  # pint takes half a second to load its units
    import pint

    registry = _make_unit_registry()
    try:
        zero, one = (registry.Quantity(x, unit).to(target).magnitude for x in (0.0, 1.0))
    except pint.DimensionalityError as error:
        raise MachineError(
            f"unit {unit!r} cannot be converted to {si_unit}; correct the unit"
        ) from error
    except (pint.PintError, *_UNREADABLE) as error:
        raise MachineError(
            f"no unit {unit!r}; write for example 'km/h', 'deg/s' or 'kN'"
        ) from error
    return float(one - zero), float(zero)


#: Usual spellings of units, by pint's name of each.
_SPELLINGS: Final[Mapping[str, str]] = {
    "m/s": "m/s m/sec mps meterspersec meterspersecond m_s m*s^-1 ms-1 м/с м/сек m/giây 米/秒",
    "km/h": "km/h kmh kph km/hr kmph km_h км/ч км/год km/jam km/sa km/u km/t 公里/小时 千米/时",
    "mph": "mph mi/h",
    "knot": "kn knot knots kt kts",
    "ft/s": "ft/s ft/sec ft_s fps",
    "inch/s": "in/s in/sec ips",
    "mm/s": "mm/s mm_s",
    "cm/s": "cm/s cm_s",
    "m/min": "m/min m_min",
    "m/s**2": "m/s2 m/s^2 m/s/s m/sec2 m/sec^2 mps2 ms2 m_s2 m/s**2 m*s^-2 ms-2 м/с2 м/с^2",
    "ft/s**2": "ft/s2 ft/s^2 ft/s/s ft/sec2 ft/sec^2 ft_s2 fps2",
    "mm/s**2": "mm/s2 mm/s^2 mm_s2",
    "cm/s**2": "cm/s2 cm/s^2 cm_s2",
    "standard_gravity": "g G g_n gee g's gs",
    "rad/s": "rad/s rad_s rad/sec",
    "deg/s": "deg/s deg_s dps °/s degree/s degrees/s deg/sec °/sec",
    "rpm": "rpm 1/min u/min r/min min-1 min^-1 rev/min tr/min 1_min "
    "об/мин dev/dak obr/min ot/min giri/min 转/分",
    "rad/s**2": "rad/s2 rad/s^2 rad_s2",
    "deg/s**2": "deg/s2 deg/s^2 deg_s2 °/s^2",
    "rad": "rad radian radians",
    "deg": "deg ° degree degrees grad",
    "N": "N newton newtons Н 牛",
    "kN": "kN кН 千牛",
    "daN": "daN",
    "lbf": "lbf",
    "kip": "klbf kip kips",
    "kgf": "kgf кгс",
    "N*m": "Nm N*m N-m N.m N_m newton-meter newtonmeter Нм Н*м Н.м",
    "kN*m": "kNm kN*m kN-m kN_m кНм кН*м",
    "mN*m": "mNm mN*m",
    "ft*lbf": "ft-lb ft*lb ft*lbf ftlb lb-ft lb*ft lbft lbf*ft lbf-ft ft-lbf",
    "in*lbf": "in-lb in*lb in*lbf inlb lb-in lb*in lbin lbf*in lbf-in in-lbf",
    "W": "W watt watts Вт",
    "kW": "kW кВт",
    "horsepower": "hp",
    "metric_horsepower": "PS",
    "A": "A amp amps ampere А",
    "mA": "mA",
    "V": "V volt volts В",
    "mV": "mV",
    "kV": "kV",
    "bar": "bar bars",
    "mbar": "mbar",
    "Pa": "Pa",
    "kPa": "kPa",
    "MPa": "MPa",
    "psi": "psi",
    "degC": "°C degC celsius C",
    "percent": "% percent pct",
    "m": "m meter meters metre metres",
    "mm": "mm",
    "cm": "cm",
    "km": "km",
    "ft": "ft feet",
    "inch": "in inch inches",
    "s": "s sec secs second seconds с сек detik sn giây 秒 초",
    "ms": "ms msec msecs millisecond milliseconds мс 毫秒",
    "us": "us µs usec usecs microsecond microseconds мкс 微秒",
    "ns": "ns nsec nsecs nanosecond nanoseconds",
    "min": "min minute minutes мин dk",
    "h": "h hr hour hours ч",
    "Hz": "Hz hertz",
    "kHz": "kHz",
    "kg": "kg",
    "t": "t ton tonne tonnes",
}
_EXACT: Final = {each: unit for unit, text in _SPELLINGS.items() for each in text.split()}
#: Lower-case spellings, for units that capitals do not distinguish.
_FOLDED: Final = {(each.lower(), unit) for each, unit in _EXACT.items()}
_UNITS_OF_FOLDED: Final = Counter(each for each, _ in _FOLDED)
_LOWER: Final[Mapping[str, str]] = {
    each: unit for each, unit in _FOLDED if _UNITS_OF_FOLDED[each] == 1
}
_MILLI_OR_MEGA: Final = frozenset({"mN*m", "mA", "mV", "MPa"})
_SIGNS: Final = str.maketrans(
    {"·": "*", "⋅": "*", "×": "*", "²": "^2", "μ": "µ", "º": "°", "⁻": "-", "¹": "1"}
)


def find_pint_unit_name(text: str) -> str | None:
    """Pint's name of a unit as users write it; None if unknown.

    Args:
        text: `Nm`, `km/h`, `[m/s²]`, `U/min`, `dps`.
    """
    bare = text.strip().strip("[](){}<>").strip().translate(_SIGNS).replace(" ", "")
    if unit := _EXACT.get(bare):
        return unit
    if bare.startswith("%"):
        # percent of the quantity that follows: % Mn, %FLA
        return "percent"
    # a single v or a is more often the name of a column than volts or amperes
    unit = _LOWER.get(bare.lower()) if len(bare) > 1 else None
    # milli or mega: only a capital distinguishes them, so without it neither is assumed
    return None if unit in _MILLI_OR_MEGA else unit


#: Words at the end of a name that are not units: a serial number, not a Turkish second; "in" as a
#: direction, not an inch.
_WORDS_BEHIND: Final = ("sn", "in")
#: Places where a capital begins a new word: speedKmh, SpeedMetersPerSec. speedMin is not split,
#: being a minimum; a letter before a short unit may be its prefix (torquekNm); TimeUS is one word.
_HUMP: Final = re.compile(r"(?<=[a-z]{2})(?=[A-Z](?:[a-z0-9]|\w\w))")
_PREFIXES: Final = "cdhkmnpu"


def split_unit_from_name(name: str) -> tuple[str, str | None]:
    """Split a unit from the end of a name: `speed_kmh`, `left_Mz_Nm`, `motor_rpm`."""
    words = re.split(r"[_\s.]+", name)
    for count in range(min(LIMITS.suffix_words, len(words) - 1), 0, -1):
        is_word = words[-1].lower() in _WORDS_BEHIND
        unit = None if is_word else find_pint_unit_name("_".join(words[-count:]))
        # a single letter at the end is more often an axis or a side than tonnes
        if unit and (count > 1 or len(words[-1]) > 1 or words[-1] in "sNAVWmg%"):
            return "_".join(words[:-count]), unit
    for hump in _HUMP.finditer(name):
        last = name[hump.start() :]
        if len(last) < LIMITS.clear_unit_letters and name[hump.start() - 1] in _PREFIXES:
            continue
        if last.isalnum() and last not in ("Min", "In") and (unit := find_pint_unit_name(last)):
            return name[: hump.start()], unit
    return name, None
