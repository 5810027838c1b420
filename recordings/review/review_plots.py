"""Draw the figures of a review: payloads over time and against target, gate reasons, track."""

from typing import Final

import numpy as np
import polars as pl

from analysis.cycles.payload_target import TargetCheck
from recordings.report.svg_shapes import WIDTH, Axes, Drawing, shorten_text_to_width
from recordings.review.review_limits import LIMITS
from recordings.review.review_state import ReviewState

_BOX: Final = (48.0, 22.0, WIDTH - 16.0, 190.0)


def draw_pictures_of_loads(
    ledger: pl.DataFrame, state: ReviewState, payload_target: TargetCheck | None
) -> list[Drawing]:
    """Draw the figures of the counted loads; none without one, no distribution for a single one.

    Args:
        ledger: the ledger.
        state: state of the review with clock and gaps.
        payload_target: target check of the loads.
    """
    counted = ledger.filter("counted")
    if not counted.height:
        return []
    found = [_draw_payload_timeline(ledger, state)]
    return (
        [*found, _draw_payload_distribution(counted, payload_target)]
        if counted.height > 1
        else found
    )


def draw_pictures_of_shift(state: ReviewState, track: pl.DataFrame | None) -> list[Drawing]:
    """Draw the figures of friction, gate and track, if there are data.

    Args:
        state: state of the review.
        track: frame with `latitude_deg` and `longitude_deg`.
    """
    found: list[Drawing] = []
    if len(state.friction_parts) > 1:
        found.append(_draw_friction_over_time(state))
    if state.gate_shares:
        found.append(_draw_gate_reasons(state))
    if track is not None and track.height > 1:
        found.append(draw_position_track(track))
    return found


def _draw_payload_timeline(ledger: pl.DataFrame, state: ReviewState) -> Drawing:
    shown = ledger.filter(pl.col("payload_kg").is_not_null())
    clock = state.clock
    seconds = ((shown["end_unix_ns"] - state.t0_unix_ns) / 1e9).to_list()
    picture = Drawing(
        "timeline",
        "Payloads over time",
        f"{shown.height} payloads in kg over {clock.time_axis_label}, from "
        f"{shown['payload_kg'].min():,.0f} to {shown['payload_kg'].max():,.0f} kg; bars reach two "
        "standard uncertainties either way; shaded: nothing was recorded.",
        LIMITS.figure_height,
    )
    payload, u = shown["payload_kg"].to_list(), shown["payload_u_kg"].to_list()
    tops = [p + 2.0 * w for p, w in zip(payload, u, strict=True)]
    axes = Axes.from_data([0.0, state.duration_s, *seconds], [0.0, *tops], _BOX, 0.03)
    for start, end in state.gaps_s:
        (x0, _), (x1, _) = (axes.convert_to_drawing_units(t, 0.0) for t in (start, end))
        picture.fill_bar(x0, _BOX[1], max(x1 - x0, 1.0), _BOX[3] - _BOX[1], "band")
    axes.draw_grid_and_labels(
        picture, clock.time_axis_label, "payload in kg", clock.make_time_axis_ticks(*axes.x)
    )
    spans = zip(seconds, payload, u, strict=True)
    picture.draw_polylines(
        [
            [
                axes.convert_to_drawing_units(s, p - 2.0 * w),
                axes.convert_to_drawing_units(s, p + 2.0 * w),
            ]
            for s, p, w in spans
        ],
        "axis",
    )
    rows = zip(seconds, payload, u, shown["cycle"], shown["counted"], strict=True)
    for at_s, kg, u_kg, number, counts in rows:
        tip = f"cycle {number}, {clock.format_time(at_s)}: {kg:,.0f} ± {2.0 * u_kg:,.0f} kg"
        picture.draw_dot(
            *axes.convert_to_drawing_units(at_s, kg), "point" if counts else "rejected", tip
        )
    return picture


def _draw_payload_distribution(
    counted: pl.DataFrame, payload_target: TargetCheck | None
) -> Drawing:
    payload = counted["payload_kg"].to_numpy()
    marks = (
        []
        if payload_target is None
        else [payload_target.target_kg * share for share in (1.0, 1.1, 1.2)]
    )
    low, high = float(min(payload.min(), *marks, payload.max())), float(payload.max())
    high = max([high, *marks])
    count, edges = np.histogram(
        payload, bins=LIMITS.payload_bins, range=(low, high if high > low else low + 1.0)
    )
    against = (
        ""
        if payload_target is None
        else f" Dashed: the target, {payload_target.target_kg:,.0f} kg, 110 and 120 %."
    )
    # sample standard deviation, as in the frame `shift`
    std = float(payload.std(ddof=1))
    picture = Drawing(
        "distribution",
        "Distribution of payloads",
        f"{payload.size} payloads, mean {payload.mean():,.0f} kg, standard deviation "
        f"{std:,.0f} kg.{against}",
        LIMITS.figure_height,
    )
    axes = Axes.from_data(
        [low, high], [0.0, float(max(count.max(), LIMITS.scale_min_loads))], _BOX, 0.05
    )
    axes = Axes(axes.x, (0.0, axes.y[1]), _BOX)
    axes.draw_grid_and_labels(picture, "payload in kg", "loads")
    for number, first, last in zip(count.tolist(), edges[:-1], edges[1:], strict=True):
        x0, y0 = axes.convert_to_drawing_units(float(first), number)
        x1, y1 = axes.convert_to_drawing_units(float(last), 0.0)
        picture.fill_bar(x0 + 0.5, y0, max(x1 - x0 - 1.0, 0.5), y1 - y0, "bar")
    for mark in marks:
        x, _ = axes.convert_to_drawing_units(mark, 0.0)
        picture.draw_line(x, _BOX[1], x, _BOX[3], "ideal")
    return picture


def _draw_friction_over_time(state: ReviewState) -> Drawing:
    parts = state.friction_parts
    value = [part.friction_N_s_m for part in parts]
    std = [part.std_N_s_m for part in parts]
    clock = state.clock
    middles = [(part.start_s + part.end_s) / 2.0 for part in parts]
    low = min(v - 2.0 * s for v, s in zip(value, std, strict=True))
    high = max(v + 2.0 * s for v, s in zip(value, std, strict=True))
    first, last = parts[0], parts[-1]
    picture = Drawing(
        "friction",
        "Friction over the shift",
        f"Viscous friction in N·s/m in {len(parts)} parts of the shift, from "
        f"{first.friction_N_s_m:,.0f} ± {2.0 * first.std_N_s_m:,.0f} in the first to "
        f"{last.friction_N_s_m:,.0f} ± {2.0 * last.std_N_s_m:,.0f} in the last, with loads as "
        "weighed; bars reach two standard deviations either way, from the scatter of the starts "
        "in each part.",
        LIMITS.figure_height,
    )
    # at least 5 % on either side, so that small changes look small
    room = max(0.05 * abs(float(np.mean(value))), 1e-9)
    axes = Axes.from_data([0.0, last.end_s], [low - room, high + room], _BOX, 0.03)
    axes.draw_grid_and_labels(
        picture, clock.time_axis_label, "friction in N·s/m", clock.make_time_axis_ticks(*axes.x)
    )
    for at, friction, u, part in zip(middles, value, std, parts, strict=True):
        x, bottom = axes.convert_to_drawing_units(at, friction - 2.0 * u)
        _, top = axes.convert_to_drawing_units(at, friction + 2.0 * u)
        picture.draw_line(x, bottom, x, top, "axis")
        tip = (
            f"{clock.format_time(part.start_s)} to {clock.format_time(part.end_s)}: "
            f"{friction:,.0f} "
            f"± {2.0 * u:,.0f} N·s/m by {part.manoeuvres} starts"
        )
        picture.draw_dot(*axes.convert_to_drawing_units(at, friction), "point", tip)
    return picture


def _draw_gate_reasons(state: ReviewState) -> Drawing:
    rows = sorted(state.gate_shares.items(), key=lambda row: -row[1])[: LIMITS.max_reasons]
    words = ", ".join(f"{name.replace('_', ' ')} {share:.0%}" for name, share in rows)
    picture = Drawing(
        "reasons",
        "Share of time by the gate's reason",
        f"Decisions of the gate by share of the recorded time: {words}.",
        int(20 + LIMITS.bar_height * len(rows)),
    )
    start, room = 140.0, WIDTH - 140.0 - 44.0
    largest = max(share for _, share in rows)
    for number, (name, share) in enumerate(rows):
        y = 8.0 + LIMITS.bar_height * number
        picture.draw_text(
            start - 6, y + 10, shorten_text_to_width(name.replace("_", " "), start - 8), "end"
        )
        length = max(room * share / largest, 0.5)
        picture.fill_bar(start, y, length, 12, "bar" if name == "accepted" else "band")
        picture.draw_text(start + length + 5, y + 10, f"{share:.1%}", "start")
    return picture


def draw_position_track(track: pl.DataFrame) -> Drawing:
    """Draw the track in m, in the plane tangent to the earth at its middle."""
    latitude, longitude = (track[n].to_numpy() for n in ("latitude_deg", "longitude_deg"))
    middle = float(np.median(latitude))
    metre = 6_371_008.8 * np.pi / 180.0
    north = (latitude - latitude.min()) * metre
    east = (longitude - longitude.min()) * metre * np.cos(np.radians(middle))
    picture = Drawing(
        "track",
        "Track",
        f"Where the machine was, {np.ptp(east):,.0f} m from west to east and "
        f"{np.ptp(north):,.0f} m from south to north, by its positions.",
        LIMITS.figure_height,
    )
    axes = Axes.from_data(east.tolist(), north.tolist(), _BOX)
    axes.draw_grid_and_labels(picture, "m east", "m north")
    way = [
        axes.convert_to_drawing_units(float(x), float(y)) for x, y in zip(east, north, strict=True)
    ]
    picture.draw_polylines([way], "axis")
    return picture
