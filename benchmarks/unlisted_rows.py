"""Faults that the table of causes was not made for: each in three sizes, on logs in memory.

A log is drawn from its seed: even ones are driven by the project's simulator, odd ones by the
independent plant. A fault changes the topics, or the machine file.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import polars as pl

from analysis.model.machine import Channel, Machine
from benchmarks.findings_rows import AXES, design, simulated, without_causes
from benchmarks.independent.payload_plans import PayloadLog, Situation, payload_log
from benchmarks.independent.sensors import Readings
from benchmarks.weighed import machine as loader
from estimators.arrays import Floats
from replay.inputs.derived_logs import MemoryLog
from tests.trials.drawn_designs import join_designs

Frames = dict[str, pl.DataFrame]
Body = Mapping[str, float]
SIDES: Final = ("left", "right")
TORQUES: Final = tuple(f"torque_{side}_N_m" for side in SIDES)
SPEEDS: Final = tuple(f"speed_{side}_m_s" for side in SIDES)
X, Y, Z = (f"specific_force_{axis}_m_s2" for axis in "xyz")
_STARTS: Final = 5
_GRAVITY: Final = 9.80665


@dataclass(frozen=True, eq=False)
class DrawnLog:
    """Topics of a machine that was drawn, as `MemoryLog` reads them, and what is true of it.

    Attributes:
        topics: torque, speed and imu, columns named as channels.
        machine: its machine file.
        true_kg: mass without load, as the force moves it: what turns counts, and what the driveline
            loses.
        throttle_N: force at full throttle.
        load_kg: for the log's name.
    """

    topics: Frames
    machine: Machine
    true_kg: float
    throttle_N: float
    load_kg: float = 0.0

    @property
    def full_torque(self) -> float:
        """Torque of one side at full throttle, N m."""
        body = self.machine.machine
        return self.throttle_N * body.force_share * float(body.wheel_radius_m or 1.0) / 2.0


def drawn_log(seed: int, *, odd: bool = False, both_ways: bool = False) -> DrawnLog:
    """The log of a seed; an odd one of the simulator has what the model does not describe."""
    return _independent(seed) if seed % 2 else _simulated(seed, odd=odd, both_ways=both_ways)


def with_usual_sides(log: DrawnLog, seed: int) -> DrawnLog:
    """The log of a sound machine whose sides are unlike by up to 5 %, on a cross slope, in curves.

    The sums of both sides stay what they were.
    """
    dice = np.random.default_rng([seed, 28_002])
    of_torque, of_speed = dice.uniform(-0.05, 0.05, 2)
    across = dice.uniform(-0.03, 0.03) * log.full_torque
    width_m = float(log.machine.machine.track_width_m or 1.5)
    speed, torque, imu = (log.topics[name] for name in ("speed", "torque", "imu"))

    def seconds(frame: pl.DataFrame) -> Floats:
        return (frame["header_stamp_ns"].to_numpy() - begin_ns) * 1e-9

    begin_ns = int(speed["header_stamp_ns"][0])
    t_s = seconds(speed)
    left, right = (speed[name].to_numpy() for name in SPEEDS)
    mean = (left + right) / 2.0
    # gentle curves, another one every few seconds, up to a radius of 10 m
    number = (t_s.clip(0.0) / 5.0).astype(np.int64)
    bend = dice.uniform(-0.1, 0.1, int(number.max()) + 1) * (
        dice.random(int(number.max()) + 1) < 0.5
    )
    turn = bend[number] * mean
    apart = width_m * turn + of_speed * mean
    torque_s, imu_s = seconds(torque), seconds(imu)
    v, w = (np.interp(torque_s, t_s, x) for x in (mean, turn))
    moves = np.tanh(v / 0.05)
    push = (torque[TORQUES[0]].to_numpy() + torque[TORQUES[1]].to_numpy()) / 2.0
    resists = 0.05 * log.full_torque * np.tanh(w / 0.05)
    more = of_torque * push + across * moves + resists
    changed = {
        "speed": {SPEEDS[0]: left - apart / 2.0, SPEEDS[1]: right + apart / 2.0},
        "torque": {
            TORQUES[0]: torque[TORQUES[0]].to_numpy() - more / 2.0,
            TORQUES[1]: torque[TORQUES[1]].to_numpy() + more / 2.0,
        },
        "imu": {"yaw_rate_rad_s": imu["yaw_rate_rad_s"].to_numpy() + np.interp(imu_s, t_s, turn)},
    }
    topics = {
        name: log.topics[name].with_columns([pl.Series(n, x) for n, x in columns.items()])
        for name, columns in changed.items()
    }
    return replace(log, topics={**log.topics, **topics})


def _simulated(seed: int, *, odd: bool, both_ways: bool) -> DrawnLog:
    sections = design(seed, odd=odd)
    sections = without_causes(sections)
    if both_ways:
        sections = join_designs(sections, {"starts": {"directions": "alternating"}})
    (log,) = simulated(sections, [])[:1]
    body = log.scenario.machine
    known = {"empty_mass_kg": body.mass_kg, "force_share": body.force_share}
    drivetrain = sections.get("drivetrain", {})
    efficiency = float(drivetrain.get("efficiency", 1.0))
    return DrawnLog(
        dict(log.topics),
        _machine(known, AXES),
        (float(body.mass_kg) + float(drivetrain.get("rotating_kg", 0.0))) / efficiency,
        float(sections["campaign"]["throttle_force_N"]),
    )


def _independent(seed: int) -> DrawnLog:
    number = 0
    while True:
        log = payload_log(Situation(), _STARTS, seed + 100_000 * number)
        # a coarse speed is a fault of its own
        if log.instruments.two_sides and not log.instruments.speed_step_m_s:
            return _in_memory(log)
        number += 1


def _in_memory(log: PayloadLog) -> DrawnLog:
    """The starts without a load, as frames."""
    seen, end_ns = log.instruments, float((log.known.empty_s or (0.0, 0.0))[1]) * 1e9
    radius_m = seen.radius_m
    force, imu, speed = (log.topics[name] for name in ("force", "imu", "speed"))
    end = int(min(each.stamp_ns[0] for each in (force, imu, speed)) + end_ns)

    def frame(readings: Readings, columns: Mapping[str, Floats]) -> pl.DataFrame:
        stamps = {"log_time_ns": readings.log_ns, "header_stamp_ns": readings.stamp_ns}
        return pl.DataFrame({**stamps, **columns}).filter(pl.col("header_stamp_ns") < end)

    topics = {
        "torque": frame(force, {f"torque_{side}_N_m": force.values[side] for side in SIDES}),
        "speed": frame(
            speed, {f"speed_{side}_m_s": radius_m * speed.values[side] for side in SIDES}
        ),
        "imu": frame(
            imu,
            {
                **{f"specific_force_{axis}_m_s2": imu.values[axis] for axis in "xz"},
                "yaw_rate_rad_s": imu.values["yaw_rate"],
            },
        ),
    }
    known = {
        "empty_mass_kg": log.truth.empty_kg,
        "force_share": seen.share,
        "wheel_radius_m": radius_m,
    }
    return DrawnLog(topics, _machine(known, (Z,)), log.truth.empty_kg, log.truth.force_N)


def _machine(body: Body, axes: tuple[str, ...]) -> Machine:
    """The loader's machine file with another body, its channels read from the frames."""
    own = loader(('settings.trace.methods=["pooled"]',))
    topic_of = {"torque": "torque", "speed": "speed"}
    channels = {
        name: channel
        if channel.derive
        else Channel(topic=topic_of.get(name.partition("_")[0], "imu"), field=name)
        for name, channel in own.channels.items()
    }
    channels |= {name: Channel(topic="imu", field=name) for name in axes}
    return own.model_copy(
        update={"machine": own.machine.model_copy(update=dict(body)), "channels": channels}
    )


def memory_log(log: DrawnLog) -> MemoryLog:
    """The log as the pipeline reads it."""
    return MemoryLog(log)  # type: ignore[arg-type]  # it asks for load_kg and topics alone


Change = Callable[[DrawnLog, float, np.random.Generator], Frames]


@dataclass(frozen=True)
class Unlisted:
    """One fault.

    Attributes:
        name: in tables.
        causes: keys that name it: two at most, which a log of it does not tell apart.
        sizes: the three that are tried.
        topics: what it makes of the topics.
        body: factors of the machine file's numbers, by size.
        both_ways: whether it needs a drive in both directions.
    """

    name: str
    causes: tuple[str, ...]
    sizes: tuple[float, ...]
    topics: Change | None = None
    body: Callable[[float], Body] | None = None
    both_ways: bool = False

    def put_into(self, log: DrawnLog, size: float, seed: int) -> DrawnLog:
        """The log with the fault."""
        dice = np.random.default_rng([seed, 28_001])
        topics = log.topics if self.topics is None else self.topics(log, size, dice)
        machine = log.machine
        if self.body is not None:
            stated = machine.machine.model_dump()
            changed = {key: stated[key] * times for key, times in self.body(size).items()}
            if changed.get("force_share", 0.0) > 1.0:
                changed["force_share"] = 1.0
            machine = machine.model_copy(
                update={"machine": machine.machine.model_copy(update=changed)}
            )
        return DrawnLog(topics, machine, log.true_kg, log.throttle_N)


@dataclass(frozen=True)
class Column:
    """Replace columns of a topic by a function of each."""

    topic: str
    names: tuple[str, ...]
    of: Callable[[Floats, DrawnLog, float, np.random.Generator], Floats]

    def __call__(self, log: DrawnLog, size: float, dice: np.random.Generator) -> Frames:
        """The topics with those columns changed."""
        frame = log.topics[self.topic]
        names = [name for name in self.names if name in frame.columns]
        changed = [
            pl.Series(name, self.of(frame[name].to_numpy().astype(np.float64), log, size, dice))
            for name in names
        ]
        return {**log.topics, self.topic: frame.with_columns(changed)}


def times(topic: str, *names: str) -> Column:
    """Columns times the size."""
    return Column(topic, names, lambda x, _, size, __: x * size)


def throttle_share(log: DrawnLog, topic: str) -> Floats:
    """Share of the full throttle at the stamps of a topic."""
    torque = log.topics["torque"]
    both = sum(np.abs(torque[name].to_numpy()) for name in TORQUES) / (2.0 * log.full_torque)
    at = log.topics[topic]["header_stamp_ns"].to_numpy()
    return np.interp(at, torque["header_stamp_ns"].to_numpy(), np.asarray(both))


def slipping(*names: str, from_share: float) -> Change:
    """Wheels that turn faster by the size where the throttle is beyond a share."""

    def topics(log: DrawnLog, size: float, _: np.random.Generator) -> Frames:
        hard = np.clip((throttle_share(log, "speed") - from_share) / 0.1, 0.0, 1.0)
        hard = np.convolve(hard, np.ones(9) / 9.0, "same")
        frame = log.topics["speed"]
        changed = [pl.col(name) * pl.Series(1.0 + size * hard) for name in names]
        return {**log.topics, "speed": frame.with_columns(changed)}

    return topics


def late(topic: str, *names: str) -> Change:
    """Columns that say what was so many seconds ago, from the first such reading on."""

    def topics(log: DrawnLog, size: float, _: np.random.Generator) -> Frames:
        frame = log.topics[topic]
        t = frame["header_stamp_ns"].to_numpy()
        ago = (t - t[0]) * 1e-9 - size
        changed = [
            pl.Series(name, np.interp(ago, (t - t[0]) * 1e-9, frame[name].to_numpy()))
            for name in names
        ]
        return {**log.topics, topic: frame.with_columns(changed).filter(pl.Series(ago >= 0.0))}

    return topics


def _upside_down(log: DrawnLog, size: float, _: np.random.Generator) -> Frames:
    """1: rolled over; 2: pitched over; 3: rolled over, its x axis 20 degrees off."""
    imu = log.topics["imu"]
    turned = (X, Z, "roll_rate_rad_s") if size == 2.0 else (Y, Z, "pitch_rate_rad_s")
    share = float(np.cos(np.deg2rad(20.0))) if size == 3.0 else 1.0
    signs = [-pl.col(name) for name in (*turned, "yaw_rate_rad_s") if name in imu.columns]
    imu = imu.with_columns(signs).with_columns(pl.col(X) * share)
    return {**log.topics, "imu": imu}


def _loose(log: DrawnLog, size: float, _: np.random.Generator) -> Frames:
    """An IMU that rocks on its mount: so many degrees per m/s², at 4 Hz, hardly damped."""
    imu = log.topics["imu"]
    t = imu["header_stamp_ns"].to_numpy() * 1e-9
    x = imu[X].to_numpy()
    step = float(np.median(np.diff(t)))
    w, damping = 2.0 * np.pi * 4.0, 0.08
    angle, rate = 0.0, 0.0
    out = np.empty(x.size)
    still_x = float(np.median(x))
    for k in range(x.size):
        for _step in range(4):
            pull = np.deg2rad(size) * (x[k] - still_x) - angle
            rate += step / 4.0 * (w * w * pull - 2.0 * damping * w * rate)
            angle += step / 4.0 * rate
        out[k] = x[k] + _GRAVITY * np.sin(angle)
    return {**log.topics, "imu": imu.with_columns(pl.Series(X, out))}


def _runs_back(log: DrawnLog, size: float, dice: np.random.Generator) -> Frames:
    """The clock of the force is set back by so many seconds, in the middle."""
    torque = log.topics["torque"]
    stamps = torque["header_stamp_ns"].to_numpy().copy()
    stamps[int(stamps.size * dice.uniform(0.3, 0.7)) :] -= round(size * 1e9)
    return {**log.topics, "torque": torque.with_columns(pl.Series("header_stamp_ns", stamps))}


def over_log(of: Callable[[Floats, Floats, DrawnLog, float], Floats]) -> Callable[..., Floats]:
    """A column changed by how far the log is, from -1/2 to 1/2."""

    def changed(x: Floats, log: DrawnLog, size: float, _: np.random.Generator) -> Floats:
        return of(x, np.linspace(-0.5, 0.5, x.size), log, size)

    return changed


def _dry_friction(log: DrawnLog, size: float, _: np.random.Generator) -> Frames:
    """What the force must bear besides, along the motion, of the throttle's."""
    speed, torque = log.topics["speed"], log.topics["torque"]
    v = (speed[SPEEDS[0]].to_numpy() + speed[SPEEDS[1]].to_numpy()) / 2.0
    at = np.interp(torque["header_stamp_ns"].to_numpy(), speed["header_stamp_ns"].to_numpy(), v)
    more = size * log.full_torque * np.tanh(at / 0.03)
    changed = [pl.Series(name, torque[name].to_numpy() + more) for name in TORQUES]
    return {**log.topics, "torque": torque.with_columns(changed)}


def _in_another_unit(x: Floats, log: DrawnLog, size: float, _: np.random.Generator) -> Floats:
    """So many times as much; 1: the wheels' rad/s as m/s."""
    return x * (1.0 / float(log.machine.machine.wheel_radius_m or 1.0) if size == 1.0 else size)


UNLISTED: Final = (
    Unlisted(
        "gear not divided out",
        ("wrong_scale", "wrong_unit"),
        (1.5, 2.7, 3.9),
        times("torque", *TORQUES),
    ),
    Unlisted(
        "force too small",
        ("wrong_scale", "wrong_unit"),
        (0.65, 1 / 2.7, 1 / 3.9),
        times("torque", *TORQUES),
    ),
    Unlisted(
        "radius wrong",
        ("wrong_scale", "wheel_radius"),
        (1.6, 2.0, 2.5),
        body=lambda size: {"wheel_radius_m": size},
    ),
    Unlisted("left torque small", ("unlike_sides",), (0.9, 0.6, 0.2), times("torque", TORQUES[0])),
    Unlisted(
        "left torque dead",
        ("frozen", "unlike_sides"),
        (0.0, 0.02, -0.3),
        Column(
            "torque",
            TORQUES[:1],
            lambda x, log, size, _: np.full(x.size, size * log.full_torque),
        ),
    ),
    Unlisted(
        "left wheel high",
        ("unlike_sides", "wheel_radius"),
        (1.1, 1.15, 1.3),
        times("speed", SPEEDS[0]),
    ),
    Unlisted(
        "left wheel slips in hard starts",
        ("unlike_sides", "slip"),
        (0.1, 0.2, 0.4),
        slipping(SPEEDS[0], from_share=0.5),
    ),
    Unlisted("speed late", ("delay",), (0.3, 0.6, 1.0), late("speed", *SPEEDS)),
    Unlisted(
        "speed in another unit",
        ("wrong_unit",),
        (9.5493, 57.2958, 1.0),
        Column("speed", SPEEDS, _in_another_unit),
    ),
    Unlisted("IMU upside down", ("imu_misaligned", "sign_flipped"), (1.0, 2.0, 3.0), _upside_down),
    Unlisted("IMU loose", ("imu_loose", "wheel_radius"), (0.5, 1.0, 2.0), _loose),
    Unlisted("clock set back", ("clock_jump",), (1.0, 3.0, 10.0), _runs_back),
    Unlisted(
        "gain drifts",
        ("gain_drift", "load_changed_inside"),
        (0.05, 0.1, 0.2),
        Column("torque", TORQUES, over_log(lambda x, along, _, size: x * (1.0 + size * along))),
    ),
    Unlisted(
        "signed current as torque",
        ("wrong_scale", "wrong_unit"),
        (0.02, 0.1, 0.4),
        times("torque", *TORQUES),
    ),
    Unlisted("Coulomb friction", ("coulomb", "offset"), (0.05, 0.1, 0.2), _dry_friction),
    Unlisted("left torque late", ("delay",), (0.04, 0.1, 0.3), late("torque", TORQUES[0])),
)
