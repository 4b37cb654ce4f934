"""Lines of the status: limits by importance, and goals without progress."""

import numpy as np

from rnc_pin.applications.drive.controls import DriveControls, DrivenBase
from rnc_pin.applications.drive.goals import PlacedGoal, initial_goals
from rnc_pin.applications.drive.run import DriveStatus, ProgressMonitor
from rnc_pin.control.whole_body import LimitReport

CONTROLS = DriveControls(frames={"tip": (True, True, False)}, joints={}, base=DrivenBase("base", True, False))
GOALS = initial_goals(CONTROLS)


def test_limits_that_gave_way_come_first_and_accelerations_are_counted():
    report = LimitReport(("a velocity", "b / c distance", "a acceleration"), {"b / c distance": 0.0123}, {})
    status = DriveStatus(0.0, 1.0, GOALS, report, {"tip": 0.5}, "no frame 'x'")
    assert status.limits == ["b / c distance: exceeded by 0.012", "a velocity", "acceleration of 1 motion"]
    assert status.messages == ["tip: goal not reachable, 0.50 m away", "refused: no frame 'x'"]
    assert status._replace(parking="no motion").messages[1:] == ["base: no motion", "refused: no frame 'x'"]
    assert status._replace(report=LimitReport((), {}, {}), stuck={}, refused="").messages == []


def test_a_goal_is_stuck_after_a_second_without_progress_along_the_axes_that_move():
    monitor = ProgressMonitor(CONTROLS)
    wanted = GOALS._replace(frames=(PlacedGoal((1.0, 0.0, 9.0), None),), base_goal=(5.0, 0.0))
    base = np.array([0.0, 0.0, 0.3])
    found = {}
    for k in range(31):  # comes closer for a second, and the base never
        t = 0.1 * k
        points = {"tip": np.array([min(0.05 * k, 0.5), 0.0, 0.0]), "base": base}
        found[k] = monitor.update(t, wanted, points)
    assert found[9] == {}
    assert found[12] == {"base": 5.0}
    assert found[19] == {"base": 5.0}
    assert found[30] == {"base": 5.0, "tip": 0.5}  # the height, which it cannot change, does not count
    near = {"tip": np.array([0.995, 0.0, 0.0]), "base": base}
    assert monitor.update(3.1, wanted, near) == {"base": 5.0}
    assert monitor.update(9.0, wanted, near) == {"base": 5.0}  # there
    assert monitor.update(9.1, GOALS, near) == {}  # no goals
