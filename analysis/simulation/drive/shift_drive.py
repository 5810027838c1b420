"""Drive a shift cycle by cycle, with an operator drawn from the seed.

The way runs from the dump (at 0) to the pile (at `haul_m`). A machine that faces along it faces the
pile. Cycles: drive to the pile, dig, back out, turn, haul, dump, back out, turn; with hauls in
reverse there are no turns.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from analysis.simulation.drive.machine_driver import MachineDriver, StartOrder
from analysis.simulation.motion.body import RigidBody
from analysis.simulation.motion.solved_motion import ManoeuvreTimes
from analysis.simulation.motion.timeline import DrivenManoeuvre
from analysis.simulation.scenario.scenario import Scenario
from analysis.simulation.scenario.shift_plan import SimulatedShift
from analysis.simulation.scenario.simulation_limits import LIMITS
from analysis.simulation.sensors.random_streams import make_random_generator

#: Angles of boom and bucket, positive up: to drive, dig, carry and dump.
_DRIVE, _DIG, _CARRY, _DUMP = (0.15, -0.3), (0.0, 0.0), (0.25, -0.6), (0.95, 0.8)


class Cycle(NamedTuple):
    """True data of a cycle; times in s since the shift began, masses in kg.

    `load_kg` is the mass that was dug; part of it may have fallen off or been poured on the way.
    `payload_kg` is the mass that was dumped: the rest, minus the carry-back.
    """

    cycle: int
    start_s: float
    dig_s: float
    haul_s: float
    dump_s: float
    end_s: float
    load_kg: float
    carry_back_before_kg: float
    carry_back_kg: float
    payload_kg: float
    machine_kg: float
    reverse: bool
    starts: int
    spilled_kg: float
    poured_kg: float


class Dump(NamedTuple):
    """Material that left the bucket: kind is dump, pour (at a stop on the way) or spill.

    A spill is spread along the way; the others are at one place.
    """

    cycle: int
    kind: str
    start_s: float
    end_s: float
    from_m: float
    to_m: float
    mass_kg: float


class Standstill(NamedTuple):
    """A standstill of the machine; kind is idle, break or refuelling."""

    kind: str
    start_s: float
    end_s: float


class BoomAngle(NamedTuple):
    """Angles of boom and bucket at a time, interpolated linearly to the next."""

    time_s: float
    boom_rad: float
    bucket_rad: float


class ShiftDriver(MachineDriver):
    """Machine and operator during a shift.

    Args:
        scenario: scenario with machine, ground and starts.
        shift: section of the shift.
    """

    def __init__(self, scenario: Scenario, shift: SimulatedShift) -> None:
        super().__init__(scenario, 0.0, 0)
        self.shift = shift
        self.cycles: list[Cycle] = []
        self.dumps: list[Dump] = []
        self.stands: list[Standstill] = []
        self.driven: list[DrivenManoeuvre] = []
        self.angles: list[BoomAngle] = []
        self._carried_kg = 0.0
        self._load_kg = 0.0
        self._burnt_kg = 0.0
        self._burnt_until_s = 0.0
        self._had_break = not shift.break_after_h
        self._cycle, self._number = 0, 0
        self._record_boom_angles(_DRIVE, at_s=0.0)

    @property
    def is_shift_over(self) -> bool:
        """Whether the duration of the shift has passed."""
        return self.time_s >= self.shift.duration_h * 3600.0

    def drive_cycle(self) -> None:
        """Drive one cycle, and the breaks that are due after it."""
        shift, number = self.shift, len(self.cycles)
        self._cycle, self._number = number, 0
        start_s, starts, before_kg = self.time_s, self.starts, self._carried_kg
        operator = self._make_cycle_random_generator("shift_operator")
        self._rest_between_cycles(operator)
        pours = bool(self._make_cycle_random_generator("shift_pour").random() < shift.pour_cycles)
        self._drive_to_position_in_starts(
            1.0, shift.haul_m - LIMITS.pile_reach_m, shift.empty_starts_most, operator
        )
        dig_s = self.time_s
        self._dig_into_pile(operator)
        load_kg, machine_kg = self._load_kg, self.scenario.machine.mass_kg - self._burnt_kg
        haul_s = self.time_s
        reverse = bool(operator.random() < shift.reverse_share)
        self._drive_start_and_stand(-1.0, shift.back_m, operator)
        if not reverse:
            self._turn_machine_around(operator)
        self._drive_to_position_in_starts(
            -1.0, LIMITS.pile_reach_m, shift.haul_starts_most, operator, is_pouring=pours
        )
        dump_s = self._dump_load_at_standstill()
        if not reverse:
            self._drive_start_and_stand(1.0, shift.back_m, operator)
            self._turn_machine_around(operator)
        lost = [each for each in self.dumps if each.cycle == number and each.kind != "dump"]
        spilled_kg = sum((each.mass_kg for each in lost if each.kind == "spill"), 0.0)
        poured_kg = sum((each.mass_kg for each in lost if each.kind == "pour"), 0.0)
        self.cycles.append(
            Cycle(
                cycle=number,
                start_s=start_s,
                dig_s=dig_s,
                haul_s=haul_s,
                dump_s=dump_s,
                end_s=self.time_s,
                load_kg=load_kg,
                carry_back_before_kg=before_kg,
                carry_back_kg=self._carried_kg,
                payload_kg=load_kg - spilled_kg - poured_kg - self._carried_kg,
                machine_kg=machine_kg,
                reverse=reverse,
                starts=self.starts - starts,
                spilled_kg=spilled_kg,
                poured_kg=poured_kg,
            )
        )
        self._take_breaks_due_after_cycle()

    def _make_body_with_load(self) -> RigidBody:
        """Body of the machine with its present fuel and load."""
        body = RigidBody.make_loaded_body(self.scenario, self._load_kg)
        mass_kg = body.mass_kg - self._burnt_kg
        return replace(
            body,
            mass_kg=mass_kg,
            rolling_x_N=self.compute_rolling_resistance_here_newtons(mass_kg),
        )

    def _make_cycle_random_generator(self, stream: str) -> np.random.Generator:
        """Random generator of a stream for the present cycle."""
        return make_random_generator(self.scenario.sensors.seed, 0, len(self.cycles), stream)

    def _drive_to_position_in_starts(
        self,
        direction: float,
        target_m: float,
        max_starts: int,
        operator: np.random.Generator,
        *,
        is_pouring: bool = False,
    ) -> None:
        """Drive along the way (1) or against it (-1) to a position, in a few starts.

        With `is_pouring`, part of the load is poured out at the first stop.
        """
        count = max(int(operator.integers(1, max_starts + 1)), 1 + is_pouring)
        parts = operator.uniform(0.7, 1.3, count)
        for number in range(count):
            left_m = direction * (target_m - self.position_m)
            share = parts[number] / parts[number:].sum()
            if left_m > 2.0:
                self._drive_start_and_stand(direction, float(left_m * share), operator)
                if is_pouring and number == 0:
                    self._pour_part_of_load()

    def _drive_start_and_stand(
        self, direction: float, distance_m: float, operator: np.random.Generator
    ) -> None:
        """Drive one start along the way (1) or against it (-1), and stand afterwards."""
        sign = direction * self.facing
        body = replace(
            self._make_body_with_load(), coulomb_x_N=self.draw_coulomb_friction_newtons()
        )
        throttle = self.draw_throttle_fraction()
        open_s = (
            LIMITS.haul_throttle_s
            if distance_m > 2.0 * self.shift.back_m
            else LIMITS.short_throttle_s
        )
        # the carry-back sticks in the bucket and does not fall off
        spill_1_s = self.shift.spill_1_s if self._load_kg > self._carried_kg else 0.0
        order = StartOrder(
            sign,
            throttle,
            open_s,
            load_kg=self._load_kg,
            spill_1_s=spill_1_s,
            distance_m=distance_m,
        )
        from_m, begin_kg = self.position_m, self._load_kg
        times, _, spilled_kg = self.drive_one_start(order, body)
        if spilled_kg:
            self._load_kg -= spilled_kg
            self._record_spill("spill", spilled_kg, times.start_s, from_m)
        self._record_manoeuvre(times, body, sign, throttle, begin_kg)
        self._rest_between_cycles(operator)

    def _record_spill(
        self, spill_kind: str, mass_kg: float, start_s: float, start_m: float
    ) -> None:
        """Record material that has left the bucket since a time and a position."""
        lost = Dump(
            self._cycle, spill_kind, start_s, self.time_s, start_m, self.position_m, mass_kg
        )
        self.dumps.append(lost)

    def _pour_part_of_load(self) -> None:
        """Stand, and pour out part of the load halfway through the standstill."""
        half_s, loaded = self.shift.dump_s / 2.0, self._make_body_with_load()
        times = self.stand_still(half_s, loaded.mass_kg)
        self._record_boom_angles(_CARRY, at_s=times.start_s)
        self._record_boom_angles(LIMITS.pour_angles_rad, at_s=self.time_s)
        self._record_manoeuvre(times, loaded)
        poured_kg = self._load_kg * self.shift.pour_share
        self._load_kg -= poured_kg
        self._record_spill("pour", poured_kg, self.time_s, self.position_m)
        left = self._make_body_with_load()
        self._record_manoeuvre(self.stand_still(half_s, left.mass_kg), left)
        self._record_boom_angles(_CARRY, at_s=self.time_s)

    def _dig_into_pile(self, operator: np.random.Generator) -> None:
        """Drive into the pile, which fills the bucket until the machine stands."""
        shift = self.shift
        drawn = self._make_cycle_random_generator("shift_load").normal(
            shift.load_kg, shift.load_std_kg
        )
        wanted_kg = float(np.clip(drawn, shift.load_least_kg, shift.load_most_kg))
        body = replace(
            self._make_body_with_load(), coulomb_x_N=self.draw_coulomb_friction_newtons()
        )
        self._record_boom_angles(_DIG, at_s=self.time_s)
        digging_s = shift.dig_s + LIMITS.digging_cruise_s
        order = StartOrder(
            1.0,
            1.0,
            shift.dig_s,
            LIMITS.digging_cruise_s,
            digging_N=shift.digging_N,
            digging_s=digging_s,
            fill_kg_s=(wanted_kg - self._carried_kg) / digging_s,
        )
        times, filled_kg, _ = self.drive_one_start(order, body)
        begin_kg, self._load_kg = self._load_kg, self._load_kg + filled_kg
        self._record_manoeuvre(times, body, 1.0, 1.0, begin_kg)
        self._record_boom_angles(_CARRY, at_s=self.time_s + LIMITS.lift_s)
        self._rest_between_cycles(operator)

    def _turn_machine_around(self, operator: np.random.Generator) -> None:
        body, side = self._make_body_with_load(), 1.0 if operator.random() < 0.5 else -1.0
        self._record_manoeuvre(self.turn_around(side * self.shift.turn_rad_s, body.mass_kg), body)
        self._rest_between_cycles(operator)

    def _dump_load_at_standstill(self) -> float:
        """Stand, dump halfway through the standstill, and return the time of the dump in s."""
        shift, loaded = self.shift, self._make_body_with_load()
        drawn = self._make_cycle_random_generator("shift_carry_back").exponential(
            shift.carry_back_kg
        )
        times = self.stand_still(shift.dump_s / 2.0, loaded.mass_kg)
        self._record_boom_angles(_CARRY, at_s=times.start_s)
        self._record_boom_angles(_DUMP, at_s=self.time_s)
        self._record_manoeuvre(times, loaded)
        dumped_s, load_kg = self.time_s, self._load_kg
        self._load_kg = self._carried_kg = float(min(drawn, shift.carry_back_most_kg, load_kg))
        self._record_spill("dump", load_kg - self._load_kg, dumped_s, self.position_m)
        empty = self._make_body_with_load()
        self._record_manoeuvre(self.stand_still(shift.dump_s / 2.0, empty.mass_kg), empty)
        self._record_boom_angles(_DRIVE, at_s=self.time_s)
        return dumped_s

    def _rest_between_cycles(self, operator: np.random.Generator) -> None:
        body = self._make_body_with_load()
        self._record_manoeuvre(
            self.stand_still(float(self.shift.pause_s * operator.uniform(0.5, 1.5)), body.mass_kg),
            body,
        )

    def _take_breaks_due_after_cycle(self) -> None:
        """Idle, take a break and refuel if due after this cycle."""
        shift, idles = (
            self.shift,
            make_random_generator(self.scenario.sensors.seed, 0, len(self.cycles), "shift_idle"),
        )
        self._subtract_fuel_of_cycle()
        if idles.random() < shift.idle_share:
            self._stand_and_record(
                "idle", max(float(idles.exponential(shift.idle_s)), LIMITS.min_idle_s)
            )
        if not self._had_break and self.time_s >= shift.break_after_h * 3600.0:
            self._had_break = True
            self._stand_and_record("break", shift.break_s)
        if shift.fuel_tank_kg - self._burnt_kg < shift.refuel_share * shift.fuel_tank_kg:
            self._stand_and_record("refuelling", shift.refuel_s)
            self._burnt_kg = 0.0

    def _subtract_fuel_of_cycle(self) -> None:
        """Subtract the fuel burnt in the cycle; breaks burn none."""
        hours = (self.time_s - self._burnt_until_s) / 3600.0
        self._burnt_until_s = self.time_s
        self._burnt_kg = min(self._burnt_kg + hours * self.shift.fuel_kg_h, self.shift.fuel_tank_kg)

    def _stand_and_record(self, standstill_kind: str, duration_s: float) -> None:
        """Stand for a while, and record it; only idling burns fuel."""
        body, start_s = self._make_body_with_load(), self.time_s
        self._record_manoeuvre(self.stand_still(duration_s, body.mass_kg), body)
        self.stands.append(Standstill(standstill_kind, start_s, self.time_s))
        if standstill_kind != "idle":
            self._burnt_until_s = self.time_s

    def _record_boom_angles(self, angles: tuple[float, float], at_s: float) -> None:
        """Append the angles that boom and bucket reach at `at_s`, or later if others precede."""
        after_s = self.angles[-1].time_s if self.angles else 0.0
        self.angles.append(BoomAngle(max(at_s, after_s), *angles))

    def _record_manoeuvre(
        self,
        times: ManoeuvreTimes,
        body: RigidBody,
        sign: float = 0.0,
        throttle: float | None = None,
        load_kg: float | None = None,
    ) -> None:
        """Record a manoeuvre; `load_kg` is the load at its start, by default the present one."""
        directions = {0.0: None, 1.0: "forward", -1.0: "reverse"}
        begin_kg = self._load_kg if load_kg is None else load_kg
        self.driven.append(
            DrivenManoeuvre(
                self._cycle,
                self._number,
                times,
                self.make_body_with_cold_friction(body, times.start_s),
                begin_kg,
                self._load_kg,
                directions[math.copysign(1.0, sign) if sign else 0.0],
                throttle,
            )
        )
        self._number += 1
