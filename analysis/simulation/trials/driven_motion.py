"""SolvedMotion under commands, with friction that grips and lets go.

Drive and brakes follow their commands with the valve's first-order lag. With Coulomb friction an
axis that comes to rest stays there until more than the friction pulls at it; without, it passes
through rest unnoticed. Braking ends each axis where it first stands.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from analysis.simulation.motion.body import RigidBody
from analysis.simulation.motion.solved_motion import MotionPhase
from analysis.simulation.scenario.waveforms import Floats
from analysis.simulation.trials.stiction import LEAST_GRIP, RATES, Commands, Stiction
from estimators.errors import DataError

#: Far beyond any stop: a scenario keeps below 50 m/s and brakes with at least 0.1 m/s².
_LONGEST_STOP_S: Final = 86_400.0
#: Friction that changes so often in no time has no motion that obeys it.
_MOST_CHANGES_AT_ONCE: Final = 20


@dataclass(frozen=True)
class DrivenMotion:
    """The machine under commands; an axis that is not free is kept still by the drive."""

    body: RigidBody
    valve_lag_s: float
    free: tuple[bool, bool]

    def move(
        self, name: str | None, start_s: float, end_s: float, state: Floats, asked: Commands
    ) -> tuple[list[MotionPhase], Floats]:
        """Follow the commands until `end_s`.

        Args:
            name: of the phases.
            start_s: since the trial began.
            end_s: likewise.
            state: (7,) v, drive and brake force, ω, drive and brake torque, heading.
            asked: the commands.

        Returns:
            The phases and the last state.

        Raises:
            DataError: Coulomb friction on both axes finds no grip that fits.
        """
        phases: list[MotionPhase] = []
        machine = self._apply_stiction(state, self.free)
        for stage_s in [*(k for k in sorted(asked.kinks_s) if start_s < k < end_s), end_s]:
            while start_s < stage_s:
                phase, state, changed = machine.integrate(name, start_s, stage_s, state, asked)
                phases.append(phase)
                start_s = phase.end_s
                if changed:
                    _check_progress(phases)
                    state[[RATES[axis] for axis in changed]] = 0.0
                    loose = [axis for axis in changed if machine.grip[axis] is None]
                    machine = self._apply_stiction(state, self.free, loose)
        return phases, state

    def stop(
        self, name: str | None, start_s: float, state: Floats, asked: Commands
    ) -> list[MotionPhase]:
        """Follow the commands from `state` (7,) until both axes have come to rest."""
        phases: list[MotionPhase] = []
        moving = [axis for axis in (0, 1) if self.free[axis] and state[RATES[axis]] != 0.0]
        while moving:
            machine = self._apply_stiction(state, free=(0 in moving, 1 in moving))
            last_s = start_s + _LONGEST_STOP_S
            phase, state, stood = machine.integrate(name, start_s, last_s, state, asked, stop=True)
            phases.append(phase)
            start_s = phase.end_s
            state[[RATES[axis] for axis in stood]] = 0.0
            moving = [axis for axis in moving if axis not in stood]
        return phases

    def _apply_stiction(
        self, state: Floats, free: tuple[bool, bool], loose: Sequence[int] = ()
    ) -> Stiction:
        """The grip of friction in `state`; it has just let go of the `loose` axes."""
        choices: list[tuple[float | None, ...]] = []
        for axis in (0, 1):
            rate = float(state[RATES[axis]])
            if not free[axis] or rate != 0.0 or self.body.gripping[axis] <= LEAST_GRIP:
                choices.append((float(np.sign(rate)),))
            else:
                choices.append((1.0, -1.0) if axis in loose else (None, 1.0, -1.0))
        grips = product(choices[0], choices[1])
        machines = [Stiction(self.body, self.valve_lag_s, free, grip) for grip in grips]
        return min(machines, key=lambda machine: machine.contradiction(state))


def _check_progress(phases: Sequence[MotionPhase]) -> None:
    recent = phases[-_MOST_CHANGES_AT_ONCE:]
    if len(recent) == _MOST_CHANGES_AT_ONCE and recent[-1].end_s - recent[0].start_s < 1e-9:
        raise DataError(
            f"Coulomb friction finds no grip at {recent[-1].end_s:g} s of the run; "
            "change machine.coulomb_N or machine.coulomb_z_N_m a little"
        )
