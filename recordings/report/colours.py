"""Colours of methods, phases and reasons, the same in viewer and plots."""

from collections.abc import Mapping
from functools import cache
from typing import Final

from analysis.model.methods import METHODS

#: Okabe and Ito's palette, which the colour-blind can distinguish, on black and on white.
_PALETTE: Final = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#8c7ae6", "#b0a030")
_METHODS: Final = tuple(METHODS)

_GOOD: Final = "#2e9e5b"
_QUIET: Final = "#7f8c8d"
_BAD: Final = "#c0392b"
_WARM: Final = "#e69f00"
#: Colour of a state without one of its own.
OTHER: Final = "#b8bfc6"
#: States of a lane that a plot shades behind its lines.
SHADED: Final[dict[str, tuple[str, ...]]] = {
    "gate": ("accepted",),
    "phase": ("accelerating", "braking", "turning", "arc", "spinning"),
}
STATES: Final[dict[str, str]] = {
    "standstill": _QUIET,
    "accelerating": "#66bb6a",
    "cruising": "#3d7ea6",
    "braking": _BAD,
    "spinning": "#8e44ad",
    "arc": "#b38600",
    "turning": "#d35400",
    "accepted": _GOOD,
    "warming_up": "#95a5a6",
    "gap": "#5d4037",
    "no_variance": "#607d8b",
    "low_information": "#5c7cfa",
    "negative_dependence": "#6c5ce7",
    "translating": "#b38600",
    "saturated": "#e84393",
    "slip": "#ff7675",
    "ill_conditioned": "#a0522d",
    "noise_limited": "#00838f",
    "digging": "#8d6e63",
    "good": _GOOD,
    "weak": "#b38600",
    "not dumped": _QUIET,
    "no mass": _BAD,
}


@cache
def make_colour_by_state() -> Mapping[str, str]:
    """Make the colour of each state, and of each cause by its consequence."""
    # imported here, since the table of causes imports all detectors
    from analysis.findings import CAUSES

    return {**STATES, **{each.key: _BAD if each.withholds else _WARM for each in CAUSES}}


def choose_line_colour(line_index: int) -> str:
    """Choose the colour of the n-th line of a plot."""
    return _PALETTE[line_index % len(_PALETTE)]


def choose_method_colour(method: str) -> str:
    """Choose the colour of an estimator."""
    return choose_line_colour(_METHODS.index(method)) if method in _METHODS else _QUIET


def mix_colour_with_white(colour: str) -> str:
    """Mix a colour with white in equal parts."""
    parts = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
    return "#" + "".join(f"{(part + 255) // 2:02x}" for part in parts)


def pack_colour_as_rgba(colour: str, opacity: str = "ff") -> int:
    """Pack red, green, blue and opacity into the 32-bit integer 0xRRGGBBAA of the viewer."""
    return int(colour[1:] + opacity, 16)
