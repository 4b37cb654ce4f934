"""Constraints, outputs and actuators: what they mean, and what is refused."""

import warnings

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg

import rnc_pin as rnc
import urdf_parts
from bodies import add_body
from refusals import refused
from rnc_pin.model.reduction_data import best_entries
from rnc_pin.robots.sources.description import Mimic
from systems import rolling_base, space_robot, tiago
from textbook_systems import Bound, Flat, Turning, coupling, sliders


def space(**changes):
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    given = {"constraints": [rnc.MomentumConservation("platform")], "actuators": ["joint_1", "joint_2", "joint_3"]}
    return rnc.NonholonomicSystem(robot, **{**given, **changes})


def test_tiago_has_six_contact_rows_of_rank_three():
    reduced = tiago()
    assert reduced.m == 3
    assert [row.name.split("(")[0] for row in reduced.dropped_rows] == ["vertical", "lateral", "vertical"]
    reasons = [row.reason for row in reduced.dropped_rows]
    assert reasons[0] == reasons[2] == "zero at every configuration"
    assert reasons[1] == "a combination of lateral(wheel_left_link)"


test_what_does_not_fit_is_refused_in_one_line = refused([
    (lambda: space(constraints=[rnc.MomentumConservation("platfrm")]), rnc.ModelError, "did you mean 'platform'"),
    (lambda: space(constraints=[rnc.MomentumConservation("joint_2")]), rnc.ConstraintError, "depends on its position"),
    (lambda: space(constraints=[rnc.NoSideSlip("tipp")]), rnc.ModelError, "did you mean 'tip'"),
    (lambda: space(constraints=[rnc.NoSideSlip("tip", "w")]), rnc.ConfigurationError, "axis 'w' is not known"),
    (lambda: space(constraints=[rnc.RollingWheel("tip", 0.0)]), rnc.ConstraintError, "has to be positive"),
    (lambda: space(constraints=[rnc.MomentumConservation("platform")] * 2), rnc.ConstraintError,
        "duplicate constraint row"),
    (lambda: space(actuators=["platform", "joint_2"]), rnc.ConstraintError, "'platform' drives momentum"),
    (lambda: space(actuators=[rnc.FrameForce("tip", "x")]), rnc.ConstraintError, "drives momentum"),
    (lambda: space(constraints=[rnc.Pfaffian(lambda q: np.zeros((1, 3)), lambda q, v: np.zeros((1, 3)))]),
        rnc.InputError, r"shape \(1, 3\), expected \(1, 4\)"),
    (lambda: space(constraints=[rnc.Pfaffian(lambda q: np.eye(4)[:1] * (q[1] > 0), lambda q, v: np.zeros((1, 4)))]),
        rnc.ConstraintError, "rank of the constraints changes with the configuration, from 0 to 1"),
    (lambda: space().reduce([rnc.FramePosition("tip", "xx")]), rnc.ConfigurationError, "at most once"),
    (lambda: rnc.NonholonomicSystem(rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar"),
        [rnc.RollingWheel("axle", 0.2)]), rnc.ConstraintError, "has no single axis: give the axle with axis="),
    (lambda: space(constraints=rnc.NoSideSlip("tip")), rnc.ConstraintError, "constraints: expected a list, found"),
    (lambda: space(constraints=[rnc.NoSideSlip]), rnc.ConstraintError, r"constraints\[0\]: expected an object with"),
    (lambda: space().reduce(rnc.JointPosition("joint_1")), rnc.ConstraintError,
        "reducing outputs: expected a list, found JointPosition"),
    (lambda: space().reduce([rnc.JointPosition("joint_1"), "yaw"]), rnc.ConstraintError,
        r"reducing outputs\[1\]: expected an object with bind\(robot\), found 'yaw'"),
    (lambda: space().reduce(vertical=3), rnc.ConstraintError, "vertical outputs: expected a list, found 3"),
])  # fmt: skip


def test_rank_counts_where_a_robot_stands_and_not_upside_down(tmp_path):
    """A car before a curb, a cylinder below its front wheels, can only roll on. On its roof, the rank differs."""
    sides = (("l", 0.2), ("r", -0.2))
    places = {f"{end}_{side}": (x, y, 0) for end, x in (("f", 0.3), ("r", -0.3)) for side, y in sides}
    wheels = (urdf_parts.wheel(name, "base", at) for name, at in places.items())
    parts = [urdf_parts.link("base", 10.0, urdf_parts.BOX), *wheels]
    file = urdf_parts.write(tmp_path / "car.urdf", urdf_parts.robot(*parts))
    curb = rnc.CylindricalGround(0.05, axis=(0, 1, 0), point=(0.6, 0, 0), inside=False)
    wheels = [rnc.RollingWheel(name, 0.1, ground=curb if name[0] == "f" else None) for name in places]
    system = rnc.NonholonomicSystem(rnc.Robot.from_urdf(file, base="free"), wheels)
    assert (system.n, system.m) == (10, 9)


def test_next_to_a_singular_configuration_the_answer_is_still_right():
    """No silent regularisation: right down to the limit the KKT residual is at the level of rounding."""
    reduced = space_robot()
    q, v2, T = reduced.robot.configuration({"joint_2": 1e-5, "joint_3": 2e-5}), np.array([0.0, 1e-3, 0.1]), np.ones(3)
    t = reduced.terms(q, v2)
    assert np.abs(t.A @ t.R).max() < 1e-6 * np.abs(t.R).max()
    F = t.input_matrix @ T
    back = reduced.inverse_dynamics(q, v2, reduced.forward_dynamics(q, v2, T))
    assert np.linalg.norm(back - F) < 1e-5 * np.linalg.norm(F)


@pytest.mark.parametrize(("joint", "units"), [
    (pin.JointModelPX(), ("kg m/s",)),
    (pin.JointModelRZ(), ("N m s",)),
    (pin.JointModelPlanar(), ("kg m/s", "kg m/s", "N m s")),
    (pin.JointModelSpherical(), ("N m s",) * 3),
    (pin.JointModelTranslation(), ("kg m/s",) * 3),
    (pin.JointModelFreeFlyer(), ("kg m/s",) * 3 + ("N m s",) * 3),
], ids=lambda value: value.shortname() if isinstance(value, pin.JointModel) else "")  # fmt: skip
def test_momentum_has_the_unit_of_the_motion_that_it_belongs_to(joint, units):
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    add_body(model, "arm", "RZ", 1.0, add_body(model, "base", joint, 2.0), com=(0.3, 0.0, 0.0))
    assert rnc.MomentumConservation("base").bind(rnc.Robot(model)).units == units


@pytest.mark.parametrize(("line", "words"), [(0.0, None), (9.0, "row are undefined at every sampled configuration")])
def test_rows_may_be_undefined_at_some_configurations(line, words):
    def right_of_the_line(q):
        if q[0] < line:
            raise rnc.SingularityError("undefined", q=q, condition=np.inf, rows=("row",))
        return np.eye(3)[1:2]

    given = sliders(), [Turning(["row"], right_of_the_line)]
    if words is None:
        assert rnc.NonholonomicSystem(*given).r == 2
    else:
        with pytest.raises(rnc.ConstraintError, match=words):
            rnc.NonholonomicSystem(*given)


def test_a_system_says_what_there_is_too_much_or_too_little_of():
    free = rnc.NonholonomicSystem(sliders(), [coupling("b", "a")], ["a"])
    assert (free.n, free.m, free.p, free.r) == (3, 1, 1, 2)
    base = rnc.Robot(rolling_base({"left": (0.0, 0.3), "right": (0.0, -0.3)}, 0.1))
    rolling = rnc.NonholonomicSystem(base, [rnc.RollingWheel(name, 0.1) for name in ("left", "right")])
    assert (rolling.n, rolling.m, rolling.p, rolling.r) == (5, 3, 0, 2)
    joints = [rnc.JointPosition(name) for name in "abc"]
    for outputs, words in (
        (joints, r"3 reducing outputs \(a, b, c\), expected 2: 3 degrees of freedom less 1 of the constraints"),
        ([], r"0 reducing outputs \(none\), expected 2"),
        (joints[:1] * 2, "duplicate output 'a'"),
        (joints[:2], "the reducing outputs do not parametrise the motion: at every sampled configuration the rows"),
    ):
        with pytest.raises(rnc.ConstraintError, match=words):
            free.reduce(outputs)
    with pytest.raises(rnc.ConstraintError, match="duplicate output 'c'"):
        free.reduce([joints[0], joints[2]], [joints[2]])
    assert free.reduce([joints[0], joints[2]], [joints[1]]).r == 2
    with pytest.raises(rnc.ConstraintError, match=r"^1 independent constraint rows leave no motion of 1 degrees of"):
        rnc.NonholonomicSystem(sliders("X"), [Bound(Flat([[1.0]], ["stop"]))])


def warnings_of(*given, **settings):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        system = rnc.NonholonomicSystem(*given, **settings)
    assert all(each.category is rnc.ModelWarning for each in said)
    assert all(each.filename == __file__ for each in said)  # where the system was asked for
    return system, [str(each.message) for each in said]


def test_rows_that_are_nearly_dependent_are_warned_of_below_a_thousandth():
    """By their smallest singular value, ``sqrt(2) sin(a / 2)``."""
    for value in (1.05e-3, 0.95e-3, 2e-4):
        angle = 2 * np.arcsin(value / np.sqrt(2))
        rows = Flat([[1.0, 0, 0], [np.cos(angle), np.sin(angle), 0]], "ab", holonomic=(False, False))
        system, said = warnings_of(sliders(), [Bound(rows)])
        assert system.kept == [0, 1]
        words = (
            f"robot 'sliders': rows are nearly dependent (smallest singular value {value:.2g} at best), so the "
            "remaining motion may not be the intended one: a, b; check for rounded angles of wheels or loops"
        )
        assert (said, list(system.nearly_dependent_rows)) == (([words], ["a", "b"]) if value < 1e-3 else ([], []))


def test_rows_that_rounding_leaves_are_named_with_the_worst_of_it():
    robot, matrix = sliders("XXXX", (2.0, 3.0, 5.0, 7.0)), np.eye(4)[[0, 0, 1, 1]]
    matrix[[1, 3], [2, 2]] = 2e-6, 3e-6
    system, said = warnings_of(robot, [Bound(Flat(matrix, "abcd", holonomic=(False,) * 4))])
    assert (system.kept, system.m, system.r) == ([0, 2], 2, 2)
    assert said == [
        "robot 'sliders': rows that depend on others except for rounding (3e-06) are dropped: b, d; "
        "check for rounded angles of wheels or loops"
    ]
    dropped = {row.name: (row.reason, row.rounding) for row in system.dropped_rows}
    assert dropped == {
        "b": ("a combination of a except for rounding (2e-06)", pytest.approx(2e-6, rel=1e-3)),
        "d": ("a combination of c except for rounding (3e-06)", pytest.approx(3e-6, rel=1e-3)),
    }
    assert system.assembly.names == ()


def test_a_holonomic_row_follows_from_rows_that_are_not_but_for_rounding():
    """It is met to what rounding leaves of it, as the assembly alone could not have known."""
    robot = sliders()
    rates = Bound(Flat([[-2.0, 1.0, 0.0]], ["rates"], holonomic=(False,)))
    near = Bound(Flat([[-2.0 - 3e-6, 1.0, 0.0], [0.0, 0.0, 1.0]], ["near", "other"]))
    system, _ = warnings_of(robot, [rates, near])
    assert (system.constraints.names, system.assembly.names) == (("rates", "other"), ("near", "other"))
    assert np.array(system.assembly.names)[~system.assembly.leading].tolist() == ["near"]


def test_joints_that_should_mimic_others_are_told():
    robot = sliders()
    robot.mimics = (Mimic("b", "a", 2.0, 0.0), Mimic("c", "a", -1.0, 0.0))
    coupled, said = warnings_of(robot)
    assert (coupled.constraints.names, said) == (("coupling(b, a)", "coupling(c, a)"), [])
    words = (
        "robot 'sliders': joints that should mimic others move independently: {}; couple them (mimic=True, "
        "JointCoupling), or lock them together with the joints that they follow"
    )
    free, said = warnings_of(robot, mimic=False)
    assert (free.m, said) == (0, [words.format("b (of a), c (of a)")])
    said_by_rows = Bound(Flat([[-2.0, 1.0, 0.0]], ["mine"], holonomic=(False,)))
    half, said = warnings_of(robot, [said_by_rows], mimic=False)
    assert (half.m, said) == (1, [words.format("c (of a)")])
    rest, said = warnings_of(robot, [said_by_rows])
    assert (rest.constraints.names, said) == (("mine", "coupling(c, a)"), [])
    with pytest.raises(rnc.ConstraintError, match=r"^duplicate constraint row 'coupling\(c, a\)'$"):
        rnc.NonholonomicSystem(robot, [Bound(Flat([[0.0, 1.0, 0.0]], ["coupling(c, a)"], holonomic=(False,)))])


def test_a_row_that_is_no_number_is_named_with_the_configuration():
    robot = sliders()

    def spoilt(q):
        matrix = np.array([[1.0, 0, 0], [0, 1.0, 0], [1.0, 1.0, 0]])
        matrix[1, 2] = np.nan
        return matrix

    for rows, name in (
        (Turning("abc", spoilt), "b"),
        (Turning("abc", lambda q: np.eye(3)[[0, 1, 0]], lambda q: 0 * q + [0.0, 0.0, np.inf]), "c"),
    ):
        first = rnc.NonholonomicSystem(robot, [])._samples[0]
        with pytest.raises(rnc.ConstraintError) as told:
            rnc.NonholonomicSystem(robot, [rows])
        assert str(told.value) == f"constraint row '{name}' is not finite at q = {np.round(first, 4).tolist()}"


def test_outputs_that_are_dependent_everywhere_are_named():
    system = rnc.NonholonomicSystem(sliders(), [rnc.JointCoupling("b", "a", 2.0, 0.3)])
    words = (
        "^the reducing outputs do not parametrise the motion: at every sampled configuration the rows "
        r"coupling\(b, a\), a, b are dependent$"
    )
    with pytest.raises(rnc.ConstraintError, match=words):
        system.reduce([rnc.JointPosition("a"), rnc.JointPosition("b")])
    assert system.reduce([rnc.JointPosition("a"), rnc.JointPosition("c")]).reduction_data.singularity_limit == 1e8
    assert system.reduce().reduction_data.singularity_limit == 1e8
    assert system.reduce(singularity_limit=1e5).reduction_data.singularity_limit == 1e5
    assert system.rows.places[0].block.kind == rnc.JointCoupling("b", "a", 2.0, 0.3)

    def often(q):
        return np.eye(3)[[0 if abs(q[0]) < 2.9 else 2]]

    changing = rnc.NonholonomicSystem(sliders(), [Bound(Flat([[0, 1.0, 0]], ["b"], holonomic=(False,)))])
    places = changing._samples[:, 0]
    assert 0 < (np.abs(places) > 2.9).sum() < len(places)
    outputs = Turning(["x"], often)
    outputs.angular, outputs.quasi, outputs.rotation, outputs.generalized = (False,), True, False, False
    good = changing.reduce([rnc.JointPosition("a"), outputs])  # somewhere is enough
    assert good.r == 2


def test_without_outputs_the_entries_are_those_that_are_best_where_they_are_worst():
    """Of the candidates of single samples, by the smallest singular value of the null space in these entries."""
    W = np.random.default_rng(0).normal(size=(4, 2, 4))

    def turning(q):
        return np.tensordot(np.cos(q), W, axes=1) + 0.2 * W[0]

    system = rnc.NonholonomicSystem(sliders("XXXX", (2.0, 3.0, 5.0, 7.0)), [Turning("xy", turning)])
    bases = [scipy.linalg.null_space(turning(q)) for q in system._samples]
    worst = {
        pair: min(np.linalg.svd(basis[list(pair)], compute_uv=False)[-1] for basis in bases)
        for pair in {tuple(best_entries(turning(q), 2)) for q in system._samples}
    }
    first = tuple(best_entries(turning(system._samples[0]), 2))
    chosen = tuple("abcd".index(name) for name in system.reduce().reducing.names)
    assert worst[chosen] == max(worst.values())
    assert first != chosen
    assert system.reduce().reducing.units == ("m/s", "m/s")
    assert rnc.NonholonomicSystem(sliders(), []).reduce().reducing.names == ("a", "b", "c")


def test_best_entries_leave_the_rest_moderate():
    rows = np.array([[1.0, 10.0, 0.1, 0.0], [0.0, 0.0, 1.0, 9.0]])
    assert (best_entries(rows, 2), best_entries(np.zeros((0, 3)), 3)) == ([0, 2], [0, 1, 2])


def test_of_entries_that_do_equally_well_the_first_is_taken():
    """Whatever rounding says: joints that turn together, in any of many states."""
    generator, last = np.random.default_rng(2), [0.0, 0.0, 1.0, 0.0, -1.0, 0.0]
    chosen = [best_entries(np.vstack([generator.normal(size=(2, 6)), last]), 3) for _ in range(200)]
    assert {(2 in each, 4 in each) for each in chosen} == {(True, False), (False, False)}


def test_an_actuator_that_drives_what_is_conserved_is_named():
    """By any entry of the momentum, beyond rounding; a coupling of such a joint is, too."""
    model = pin.Model()
    for parent, (name, kind) in enumerate((("base", "Planar"), ("arm", "RZ"))):
        add_body(model, name, kind, 2.0, parent, com=(0.3, 0.1, 0.0))
    robot, momentum = rnc.Robot(model), [rnc.MomentumConservation("base")]
    words = r"^actuator 'T\[{}\]' drives momentum\(base\)\[0\], which is declared as conserved$"
    for entry, column in ((0, 0), (1, 1), (2, 1)):
        B = np.zeros((4, 2))
        B[3] = 1.0, -2.0
        B[entry, column] = -0.5e-12
        assert rnc.NonholonomicSystem(robot, momentum, B).r == 1
        B[entry, column] = -2e-12
        with pytest.raises(rnc.ConstraintError, match=words.format(column)):
            rnc.NonholonomicSystem(robot, momentum, B)
    assert rnc.NonholonomicSystem(robot, momentum).p == 0
    assert rnc.NonholonomicSystem(robot, [], np.ones((4, 2))).p == 2
    words = (
        r"^constraint row coupling\(joint_1, platform\) acts on momentum\(platform\), which is declared as conserved: "
        r"omit the momentum \(the motion follows from the other constraints\) or what acts on it$"
    )
    with pytest.raises(rnc.ConstraintError, match=words):
        space(constraints=[rnc.MomentumConservation("platform"), rnc.JointCoupling("joint_1", "platform", 1.0)])


WHEELS = [rnc.RollingWheel("left_wheel", 0.2), rnc.RollingWheel("right_wheel", 0.2)]
LETS_IT_MOVE = r"the base of robot '{}' is fixed; base='planar' \(robot: {{base: planar}}\) or 'free' lets it move"


@pytest.mark.parametrize(("file", "build", "still"), [
    ("mobile_manipulator", lambda robot: rnc.NonholonomicSystem(robot).reduce([rnc.FrameSpeed("base"),
        rnc.FrameYaw("base"), rnc.JointPosition("joint_1")]), "no joint moves base_speed_x, base_yaw: "),
    ("mobile_manipulator", lambda robot: rnc.NonholonomicSystem(robot).reduce([rnc.FrameSpeed("base"),
        rnc.JointPosition("joint_1")]), "no joint moves base_speed_x: "),
    ("differential_drive", lambda robot: rnc.NonholonomicSystem(robot, WHEELS), r"lateral\(left_wheel\).*: "),
    ("space_robot", lambda robot: robot.configuration({"root_joint": [0, 0, 0]}),
        "no joint 'root_joint' in robot .*: "),
])  # fmt: skip
def test_a_base_that_is_fixed_by_mistake_is_named(file, build, still):
    """It was explained by counts of outputs and rows."""
    with pytest.raises(rnc.RncError, match=still + LETS_IT_MOVE.format(file)):
        build(rnc.Robot.from_urdf(f"{file}.urdf"))


@pytest.mark.parametrize("apart", [1e-3, 1.0, 1e3])
def test_a_small_model_has_the_margin_of_a_large_one(apart):
    """Two blades of a sleigh: with lengths in units of their distance, their rows are 45 degrees apart."""
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    blades = [rnc.NoSideSlip("sleigh"), rnc.NoSideSlip("sleigh", at=(apart, 0.0, 0.0))]
    assert rnc.NonholonomicSystem(robot, blades).row_margin == pytest.approx(np.sqrt(2) * np.sin(np.pi / 8), rel=1e-9)
