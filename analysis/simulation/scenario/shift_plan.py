"""A shift of a loader: repeated cycles from pile to dump and back, with interruptions."""

from typing import Literal, Self, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, model_validator

ShiftTopic: TypeAlias = Literal["boom", "odometry", "gnss"]


class SimulatedShift(BaseModel):
    """A shift instead of a campaign: cycles of digging, hauling and dumping, and breaks.

    `[starts]` and `[campaign]` (throttle, valves, brakes) define the starts. The machine turns on
    the spot and drives back along the same line, on which the ground may slope.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    duration_h: float = Field(
        default=1.0, ge=0.01, le=12, description="duration of the shift; the last cycle is finished"
    )
    logs: int = Field(
        default=1,
        ge=1,
        le=100,
        description="number of logs of about the same length: the recorder restarts",
    )
    restart_s: float = Field(
        default=5.0, ge=0, le=600, description="longest gap between two logs, uniform"
    )
    damaged_logs: int = Field(
        default=0,
        ge=0,
        le=100,
        description=("number of logs that are truncated: the end of the file is missing"),
    )
    damage_share: float = Field(
        default=0.02,
        gt=0,
        lt=1,
        description="largest share of its length that a truncated log loses, uniform",
    )
    load_kg: float = Field(
        default=700.0, gt=0, le=1e5, description="mean load in the bucket when it is hauled"
    )
    load_std_kg: float = Field(
        default=120.0, ge=0, le=1e5, description="standard deviation of loads, normal"
    )
    load_least_kg: float = Field(default=200.0, gt=0, le=1e5, description="smallest load")
    load_most_kg: float = Field(default=1100.0, gt=0, le=1e5, description="largest load")
    carry_back_kg: float = Field(
        default=10.0,
        ge=0,
        le=1e4,
        description="mean carry-back left in the bucket after a dump; exponentially distributed",
    )
    carry_back_most_kg: float = Field(default=60.0, ge=0, le=1e4, description="largest carry-back")
    spill_1_s: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="part of a load that falls off per second of driving in its haul",
    )
    pour_cycles: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="share of cycles in which part of the load is poured out at a stop on the way",
    )
    pour_share: float = Field(
        default=0.2, gt=0, lt=1, description="share of the load that is poured out at that stop"
    )
    haul_m: float = Field(
        default=40.0,
        ge=12,
        le=1000,
        description="distance from the dump to the pile, uphill on a slope",
    )
    haul_starts_most: int = Field(
        default=3,
        ge=1,
        le=20,
        description="largest number of starts in a loaded haul, uniform from one",
    )
    empty_starts_most: int = Field(
        default=2,
        ge=1,
        le=20,
        description="largest number of starts in an empty drive, uniform from one",
    )
    reverse_share: float = Field(
        default=0.2,
        ge=0,
        le=1,
        description="share of hauls that are driven backwards, without a turn",
    )
    pause_s: float = Field(
        default=2.5,
        ge=0.2,
        le=60,
        description="mean pause between starts; pauses are uniform from 0.5 to 1.5 times this",
    )
    dig_s: float = Field(
        default=4.0, ge=1, le=60, description="duration of open throttle in the pile"
    )
    digging_N: float = Field(
        default=4000.0, ge=0, le=1e6, description="resistance of the pile, growing while digging"
    )
    back_m: float = Field(
        default=5.0, ge=2, le=5.5, description="distance backwards out of pile and dump"
    )
    turn_rad_s: float = Field(
        default=0.5, gt=0, le=3, description="highest yaw rate of a half turn on the spot"
    )
    dump_s: float = Field(default=6.0, ge=2, le=60, description="duration of the stop for dumping")
    idle_share: float = Field(
        default=0.05, ge=0, le=1, description="share of cycles after which the machine idles"
    )
    idle_s: float = Field(
        default=90.0,
        gt=0,
        le=3600,
        description="mean duration of idling, exponential, at least 10 s",
    )
    break_after_h: float = Field(
        default=0.0, ge=0, le=12, description="time after which the operator takes a break; 0: none"
    )
    break_s: float = Field(default=1800.0, gt=0, le=7200, description="duration of the break")
    fuel_tank_kg: float = Field(
        default=60.0, ge=0, le=1e4, description="fuel in machine.mass_kg when the shift begins"
    )
    fuel_kg_h: float = Field(default=8.0, ge=0, le=1e3, description="fuel burnt per hour")
    refuel_share: float = Field(
        default=0.25, ge=0, lt=1, description="share of the tank at which the machine refuels"
    )
    refuel_s: float = Field(default=300.0, ge=0, le=7200, description="duration of refuelling")
    topics: tuple[ShiftTopic, ...] = Field(
        default=("boom",), description="additional topics: boom, odometry, gnss"
    )
    boom_noise_rad: float = Field(
        default=0.003, ge=0, le=1, description="noise of the angles of boom and bucket"
    )
    gnss_rate_hz: float = Field(default=10.0, gt=0, le=1000, description="rate of positions")
    gnss_noise_m: float = Field(
        default=0.5, ge=0, le=100, description="noise of each horizontal axis"
    )
    latitude_deg: float = Field(default=49.0, ge=-85, le=85, description="latitude of the dump")
    longitude_deg: float = Field(default=8.4, ge=-180, le=180, description="longitude of the dump")
    bearing_deg: float = Field(
        default=30.0,
        ge=-360,
        le=360,
        description="bearing from the dump to the pile, clockwise from north",
    )

    @model_validator(mode="after")
    def _refuse_inconsistent_shift(self) -> Self:
        if not self.load_least_kg <= self.load_kg <= self.load_most_kg:
            raise ValueError(
                "'load_kg' is not between 'load_least_kg' and 'load_most_kg'; correct one of them"
            )
        if self.carry_back_most_kg >= self.load_least_kg:
            raise ValueError(
                "'carry_back_most_kg' is not less than 'load_least_kg'; correct one of them"
            )
        if self.logs > 1 and self.restart_s > 0.3 * self.duration_h * 3600.0 / self.logs:
            raise ValueError(
                "'restart_s' is nearly as long as a log; give fewer 'logs' or a shorter 'restart_s'"
            )
        if self.damaged_logs > self.logs:
            raise ValueError(f"'damaged_logs' is larger than 'logs'; set it to {self.logs} or less")
        if len(set(self.topics)) < len(self.topics):
            raise ValueError("a topic of 'topics' appears twice; remove one")
        if self.fuel_kg_h * self.duration_h > self.fuel_tank_kg and not self.refuel_share:
            raise ValueError("'fuel_tank_kg' runs empty before the shift ends; give 'refuel_share'")
        return self
