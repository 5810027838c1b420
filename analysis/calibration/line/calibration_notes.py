"""What a reader of a calibration has to know besides its numbers."""

from analysis.calibration.line.calibration import Calibration
from analysis.calibration.line.lack_of_fit import LEVEL


def sentences(calibration: Calibration) -> tuple[str, ...]:
    """One sentence a matter, the heaviest first."""
    found = [*_about_days(calibration), *_about_line(calibration)]
    found += [
        f"{one.test}: {one.about} stands out (p = {one.p_1:.2g}); it is in the fit"
        for one in calibration.outliers
    ]
    return tuple(found)


def _about_days(calibration: Calibration) -> list[str]:
    days = len({point.day for point in calibration.points if point.readings})
    if calibration.day_freedom is None and calibration.day_kg is not None:
        return []
    if days == 1:
        common = (
            f"; the {calibration.common_kg / abs(calibration.c1_1):.3g} kg that priors and scale "
            "leave open count once instead"
            if calibration.common_kg
            else "; the intervals hold for that day"
        )
        return [f"day to day: unknown, all runs are of one day{common}"]
    if calibration.day_kg is None:
        return ["day to day: the runs do not tell it apart, so that run to run has it in it"]
    if calibration.day_freedom is not None and calibration.day_freedom < 4:
        return [
            f"day to day: {days} days tell it with {calibration.day_freedom} degrees of freedom; "
            "more days would narrow every interval"
        ]
    return []


def _about_line(calibration: Calibration) -> list[str]:
    found: list[str] = []
    middle_kg = sum(calibration.range_kg) / 2.0
    share = calibration.beta_kg / middle_kg if middle_kg else 0.0
    if abs(share) > 0.5:
        found.append(
            f"{share:.0%} of a calibrated mass is the offset beta: the estimate moves it "
            "by little, an error of beta stays whole, and outside the references the line "
            "says nothing"
        )
    if None in calibration.alpha_interval_1:
        found.append("the slope cannot be told from 0: no mass has an interval")
    test = calibration.lack_of_fit
    if test.p_1 is not None and test.p_1 < LEVEL:
        found.append(
            f"lack of fit: the loads' means are not on a line within their scatter (p = "
            f"{test.p_1:.2g}, against {test.against})"
        )
    if calibration.attenuation_1 is not None:
        found.append(
            "(19) fitted to single readings instead of load means would have alpha at "
            f"{calibration.attenuation_1:.3f} of its size"
        )
    return found
