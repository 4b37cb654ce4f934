"""Refusals of the room: what is wrong, in one line."""

import coal
import numpy as np

import rnc_pin as rnc
import systems
from benchmarks.planned_models import car, tractor
from refusals import refused
from rnc_pin.model import Coordinates
from rnc_pin.motion import planning
from rnc_pin.motion.planning import MinimumJerk, WaySettings, find_way
from rnc_pin.references.reference import RelativeCircle, RelativeMinimumJerk
from systems import at_pose, knife_box, sleigh

WRONG, INPUT, NONE = rnc.ConfigurationError, rnc.InputError, rnc.InfeasibleError


def path(goal, **options):
    return planning.CarPath(**{"start": (0, 0, 0), "goal": goal, "duration": 5.0, "wheelbase": 1.0, **options})


def circle(*plane):
    return RelativeCircle(1.0, period=1.0, plane=plane).from_start(np.zeros(2), Coordinates([False] * 2, names="xy"))


def ik(targets, search=None, **options):
    reduced = systems.mobile_manipulator()
    q0 = reduced.robot.configuration()
    return rnc.solve_ik(reduced, q0, targets, search=rnc.IkSearch(**(search or {})), **options)


def way_beside(reduced, room):
    """From a start that has this room beyond the clearance and the tolerance of 1 mm."""
    q = reduced.robot.configuration()
    distance = rnc.collision.CollisionDistances(reduced.robot, [LEFT], q0=q).smallest(q, 0.0, 9.0).min()
    return way(reduced, obstacles=[LEFT], clearance=distance - 1e-3 - room)


def on_a_conveyor():
    robot, belt = rnc.Robot.from_urdf("unicycle.urdf", base="planar"), rnc.GroundPlane(velocity=(0.0, 0.3, 0.0))
    return rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle", ground=belt)]).reduce()


def way(reduced, start=(0.0, 0.0), goal=(3.0, 0.0), obstacles=(), settings=WaySettings(), **options):  # noqa: B008
    return find_way(reduced, at_pose(reduced, *start), at_pose(reduced, *goal), obstacles, settings=settings, **options)


INSIDE = {rnc.FramePosition("axle", "xy"): [1.5, 3.0], rnc.FrameYaw("axle"): 0.2}
LEFT = rnc.collision.Obstacle(coal.Box(0.2, 40.0, 1.0), position=(1.5, 20.25, 0.0), name="left")
CART = rnc.collision.Obstacle(coal.Box(0.6, 0.8, 1.0), name="cart", motion=MinimumJerk([0.0] * 4, [1.0] * 4, 2.0))
test_mistakes_are_refused_in_one_line = refused([
    (lambda: path((0, 0, 0)), NONE, r"no leg from \(0, 0, 0 deg\) to .* at least 1 m: allow more steering, give poses"),
    (lambda: path((-3, 0, 0), forward_only=True), NONE, r"no forward leg from \(0, 0, 0 deg\) to \(-3, 0, 0"),
    (lambda: path((1, 2)), WRONG, "goal of a path: expected x, y and heading"),
    (lambda: path((1, np.nan, 0)), WRONG, "goal of a path: expected x, y and heading"),
    (lambda: path((1, 0, 0), via=[(0, 1)]), WRONG, "via pose of a path"),
    (lambda: path((1, 0, 0), max_steering=np.pi / 2), WRONG, "between 0 and pi/2, found 5, 1 and 1.5708"),
    (lambda: path((1, 0, 0), max_steering=0.0), WRONG, "largest steering angle"),
    (lambda: path((1, 0, 0), max_steering=-0.5), WRONG, "largest steering angle"),
    (lambda: path((1, 0, 0), start=(0.0, 0.0)), WRONG, r"start of a path: expected x, y and .*, found \[0.0, 0.0\]"),
    (lambda: path((1, 0, 0), duration=0.0), WRONG, "found 0, 1 and 0.785398"),
    (lambda: path((1, 0, 0), wheelbase=0.0), WRONG, "found 5, 0 and 0.785398"),
    (lambda: planning.SteeringGeometry(sleigh(), sleigh().robot.configuration(), "sleigh", speed=0, steering=1,
        largest=1.0), WRONG, "moves while 'sleigh_yaw' turns and the vehicle stands"),
    (lambda: planning.Hold([np.inf]), INPUT, r"value of a constant reference has to be finite, found \[inf\]"),
    (lambda: planning.Hold(["far"]), INPUT, r"value of a constant reference is not an array of numbers: \['far'\]"),
    (lambda: planning.Hold({"tip": 1.0}), INPUT, "is not an array of numbers"),
    (lambda: MinimumJerk([0.0], [np.nan], 1.0), INPUT, "goal of a minimum-jerk reference has to be finite"),
    (lambda: MinimumJerk([np.nan], [0.0], 1.0), INPUT, "start of a minimum-jerk reference has to be finite"),
    (lambda: MinimumJerk([0.0], [1.0], 0.0), INPUT, "has to be positive, found 0.0"),
    (lambda: MinimumJerk([0.0], [1.0], "2"), INPUT, "has to be positive, found '2'"),
    (lambda: MinimumJerk(0.5, [1.0, 2.0], 1.0), INPUT, r"^start has shape \(1,\) but goal \(2,\)$"),
    (lambda: planning.ViaPoints([0.0, 1.0], [0.0]), INPUT, "at least two increasing times, and one point each"),
    (lambda: planning.ViaPoints([0.0, 2.0, 1.0], [0.0, 1.0, 2.0]), INPUT, "increasing"),
    (lambda: planning.ViaPoints([0.0, np.nan], [0.0, 1.0]), INPUT, "times of via points has to be finite"),
    (lambda: planning.ViaPoints([0.0, 1.0], [0.0, np.inf]), INPUT, "via points has to be finite"),
    (lambda: planning.Harmonic([0.0], [1.0, 2.0], 1.0), INPUT, "numbers or lists of 1"),
    (lambda: RelativeMinimumJerk(duration=1.0), WRONG, "expected one of 'to' and 'by'"),
    (lambda: RelativeMinimumJerk(duration=1.0, to=[1.0], by=[1.0]), WRONG, "expected one of 'to' and 'by'"),
    (lambda: RelativeCircle(1.0, period=1.0, speed=1.0), WRONG, "expected one of 'period' and 'speed'"),
    (lambda: circle("x", "z"), WRONG, "circle.plane: no output 'z'; expected one of: x, y"),
    (lambda: circle("x", "x"), WRONG, "a circle needs two outputs, found x, x"),
    (lambda: ik({"tip_xx": 1.0}), WRONG, "no output 'tip_xx'; did you mean 'tip_x'"),
    (lambda: ik({}), WRONG, "at least one output"),
    (lambda: ik({"base_speed_x": 1.0}), WRONG, "a speed has no value"),
    (lambda: ik({"tip_x": [1.0, 2.0]}), INPUT, r"target 'tip_x' has shape \(2,\), expected \(1,\)"),
    (lambda: ik({"tip_x": np.nan}), INPUT, "target 'tip_x' is not finite"),
    (lambda: ik({"tip_x": "far"}), INPUT, "target 'tip_x' is not an array of numbers"),
    (lambda: ik({3: 1.0}), WRONG, "name of an output or an output object, found 3"),
    (lambda: ik({rnc.FrameOrientation("tip"): 2 * np.eye(3)}), INPUT, "the matrix is not a rotation"),
    (lambda: ik({"tip_x": 1.0, rnc.FramePosition("tip", "x"): 1.0}), WRONG, "two targets for output"),
    (lambda: ik({"tip_x": 1.0}, search={"starts": 0}), WRONG, "starts of IkSearch has to be an integer, at least 1"),
    (lambda: ik({"tip_x": 1.0}, search={"tolerance": 0.0}), WRONG, "tolerance of IkSearch has to be at least"),
    (lambda: ik({"tip_x": 1.0}, collisions="all"), WRONG, "collisions: expected CollisionDistances, found 'all'"),
    (lambda: ik({"tip_x": 1.0}, hold=["jont_1"]), rnc.ModelError, "did you mean 'joint_1'"),
    (lambda: way(knife_box(), start=(1.5, 3.0), obstacles=[LEFT]), NONE, "start is too near: .*/ left are .* m apart"),
    (lambda: way(knife_box(), goal=(1.5, 3.0), obstacles=[LEFT]), NONE, "the goal is too near: .*/ left"),
    (lambda: find_way(knife_box(), at_pose(knife_box(), 0, 0), INSIDE, [LEFT]), NONE, "the goal is too near: .*/ left"),
    (lambda: way_beside(tractor(1), 4e-4), NONE, "the start is too near"),
    (lambda: find_way(car(), at_pose(car(), 0, 0), at_pose(car(), 1, 0, front_steering=1.5)), NONE,
        "beyond the position limit of joint 'front_steering' by 0.5"),
    (lambda: way(on_a_conveyor()), WRONG, "rows prescribe a motion"),
    (lambda: WaySettings(seconds=0.0), WRONG, "seconds of WaySettings has to be above 0"),
    (lambda: WaySettings(goals=0), WRONG, "goals of WaySettings has to be an integer, at least 1, found 0"),
    (lambda: WaySettings(motions=10.5), WRONG, "motions of WaySettings has to be an integer, at least 1, found 10.5"),
    (lambda: WaySettings(motions=0), WRONG, "motions of WaySettings has to be an integer, at least 1, found 0"),
    (lambda: way(knife_box(), clearance=-0.1), INPUT, "clearance: expected a number of at least 0"),
    (lambda: way(knife_box(), settings=WaySettings(area=[[0, 0], [1, 1]])), INPUT, "area"),
    (lambda: way(knife_box(), obstacles=[CART]), WRONG, r"obstacle 'cart' moves, .* \(obstacle.at_rest\(t\)\)"),
    (lambda: way(tractor(1), settings=WaySettings(hold=["hitch_1"])), WRONG, "hold needs an exact steering"),
    (lambda: planning.find_steering(tractor(1), tractor(1).robot.configuration()), WRONG, "no exact steering is known"),
])  # fmt: skip
