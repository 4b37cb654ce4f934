"""Systems, the parts of a reduction, and how outputs are divided: each number and word beside a plain rewriting."""

import warnings
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg

import rnc_pin as rnc
from rnc_pin.model.actuation import Actuation
from rnc_pin.model.admission import Admission
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduction_data import ReductionData, VelocityRows, best_entries, row_scales
from rnc_pin.model.row_stack import OutputStack, RowStack
from rnc_pin.model.rows import Rows
from rnc_pin.model.system import _is_loose
from rnc_pin.robots.sources.description import Mimic
from textbook_systems import Bound, Flat, sliders


class Turning(Rows):
    """Rows (k, nv) of each configuration by a function; nobody asks for their rates."""

    def __init__(self, names, function, mu=None, units=None):
        self.names, self.units = tuple(names), units or ("m/s",) * len(names)
        self.affine, self._function, self._mu = mu is not None, function, mu

    def bind(self, robot):
        return self

    def jacobian(self, at):
        flat = [self._function(q) for q in at.q.reshape(-1, at.q.shape[-1])]
        return np.array(flat, dtype=float).reshape(*at.q.shape[:-1], len(self.names), at.q.shape[-1])

    def jacobian_dot(self, at):
        raise NotImplementedError

    def bias_acceleration(self, at):
        raise NotImplementedError

    def rate(self, at):
        return self._zeros(at) if self._mu is None else self._mu(at.q)


def warnings_of(*given, **settings):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        system = rnc.NonholonomicSystem(*given, **settings)
    assert all(each.category is rnc.ModelWarning for each in said)
    assert all(each.filename == __file__ for each in said)  # where the system was asked for
    return system, [str(each.message) for each in said]


def two_rows(angle, names="ab"):
    return Bound(Flat([[1.0, 0, 0], [np.cos(angle), np.sin(angle), 0]], names, holonomic=(False, False)))


# ---------------------------------------------------------------------- systems


def test_rows_that_are_nearly_dependent_are_warned_of_below_a_thousandth():
    """By their smallest singular value, ``sqrt(2) sin(a / 2)``."""
    for value in (1.05e-3, 0.95e-3, 2e-4):
        system, said = warnings_of(sliders(), [two_rows(2 * np.arcsin(value / np.sqrt(2)))])
        assert system.kept == [0, 1]
        words = (
            f"robot 'sliders': rows are nearly dependent (smallest singular value {value:.2g} at best), so the "
            "remaining motion may not be the intended one: a, b; check for rounded angles of wheels or loops"
        )
        assert said == [words] * (value < 1e-3)


def test_rows_that_rounding_leaves_are_named_with_the_worst_of_it():
    robot = sliders("XXXX", (2.0, 3.0, 5.0, 7.0))
    matrix = np.eye(4)[[0, 0, 1, 1]]
    matrix[[1, 3], [2, 2]] = 2e-6, 3e-6
    system, said = warnings_of(robot, [Bound(Flat(matrix, "abcd", holonomic=(False,) * 4))])
    assert (system.kept, system.m, system.r) == ([0, 2], 2, 2)
    assert said == [
        "robot 'sliders': rows that depend on others except for rounding (3e-06) are dropped: b, d; "
        "check for rounded angles of wheels or loops"
    ]
    assert {row.name: row.rounding for row in system.dropped_rows} == {
        "b": pytest.approx(2e-6, rel=1e-3),
        "d": pytest.approx(3e-6, rel=1e-3),
    }
    assert system.assembly.names == ()


def test_a_holonomic_row_follows_from_rows_that_are_not_but_for_rounding():
    """It is met to what rounding leaves of it, as the assembly alone could not have known."""
    robot = sliders()
    rates = Bound(Flat([[-2.0, 1.0, 0.0]], ["rates"], holonomic=(False,)))
    near = Bound(Flat([[-2.0 - 3e-6, 1.0, 0.0], [0.0, 0.0, 1.0]], ["near", "other"]))
    system, _ = warnings_of(robot, [rates, near])
    assert system.constraints.names == ("rates", "other")
    assert system.assembly.names == ("near", "other")
    assert system.assembly.following == ("near",)


def test_joints_that_should_mimic_others_are_told():
    robot = sliders()
    robot.mimics = (Mimic("b", "a", 2.0, 0.0), Mimic("c", "a", -1.0, 0.0))
    coupled, said = warnings_of(robot)
    assert coupled.constraints.names == ("coupling(b, a)", "coupling(c, a)")
    assert said == []
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


def test_a_row_is_loose_where_rows_of_some_sample_do_not_say_it():
    rows = np.array([[[1.0, 0, 0], [0, 2.0, 0]]] * 2)
    for scale in (3.0, 1e-5):
        for off, loose in ((0.9e-6, False), (1.1e-6, True), (0.0, False)):
            row = scale * np.array([0.6, -0.8, off])
            assert _is_loose(row, rows) == loose
    rows[1, 1] = 0.0
    assert _is_loose(np.array([0.6, -0.8, 0.0]), rows)
    assert not _is_loose(np.array([0.6, 0.0, 0.0]), rows)
    assert _is_loose(np.array([0.6, 0.0, 0.0]), np.zeros((1, 0, 3)))


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


def test_samples_are_seeded_and_end_with_the_neutral_configuration():
    """Where that can be assembled, and where rows of loops have the rank there that they have elsewhere."""
    robot = sliders()
    samples = rnc.NonholonomicSystem(robot, [])._samples
    generator = np.random.default_rng(0)
    expected = [robot.random_configuration(generator) for _ in range(12)]
    np.testing.assert_array_equal(samples, [*expected, np.zeros(3)])
    offset = rnc.NonholonomicSystem(robot, [rnc.JointCoupling("b", "a", 2.0, 0.3)])._samples
    np.testing.assert_allclose(offset[:, 1] - 2 * offset[:, 0], 0.3)
    assert len(offset) == 13

    class Flattened(Flat):
        def jacobian(self, at):
            lost = (np.abs(at.q[..., 2]) < 1e-9)[..., None, None]
            return np.where(lost, self.matrix[[0, 0]], self.matrix)

    flat = Flattened(np.eye(3)[:2], ["one", "two"], gap=lambda q: q[..., :2])
    assert len(rnc.NonholonomicSystem(robot, [Bound(flat)])._samples) == 12


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
    outputs.angular, outputs.quasi, outputs.rotation, outputs.value = (False,), True, False, None
    good = changing.reduce([rnc.JointPosition("a"), outputs])  # somewhere is enough
    assert good.r == 2


def test_without_outputs_the_entries_are_those_that_are_best_where_they_are_worst():
    """Of the candidates of single samples, by the smallest singular value of the null space in these entries."""
    generator = np.random.default_rng(0)
    W = generator.normal(size=(4, 2, 4))

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
    assert best_entries(rows, 2) == [0, 2]
    assert best_entries(np.zeros((0, 3)), 3) == [0, 1, 2]


def test_of_entries_that_do_equally_well_the_first_is_taken():
    """Whatever rounding says: joints that turn together, in any of many states."""
    generator = np.random.default_rng(2)
    found = set()
    for _ in range(200):
        rows = np.vstack([generator.normal(size=(2, 6)), [0.0, 0.0, 1.0, 0.0, -1.0, 0.0]])
        chosen = best_entries(rows, 3)
        found |= {(2 in chosen, 4 in chosen)}
    assert found == {(True, False), (False, False)}


def test_an_actuator_that_drives_what_is_conserved_is_named():
    """By any entry of the momentum, beyond rounding; a coupling of such a joint is, too."""
    model = pin.Model()
    model.name = "floater"
    base = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "base")
    arm = model.addJoint(base, pin.JointModelRZ(), pin.SE3.Identity(), "arm")
    for joint in (base, arm):
        model.appendBodyToJoint(joint, pin.Inertia(2.0, np.array([0.3, 0.1, 0.0]), np.eye(3)), pin.SE3.Identity())
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
    single = rnc.Robot.from_urdf("space_robot.urdf")
    words = (
        r"^constraint row coupling\(joint_1, platform\) acts on momentum\(platform\), which is declared as conserved: "
        r"omit the momentum \(the motion follows from the other constraints\) or what acts on it$"
    )
    with pytest.raises(rnc.ConstraintError, match=words):
        rnc.NonholonomicSystem(
            single, [rnc.MomentumConservation("platform"), rnc.JointCoupling("joint_1", "platform", 1.0)]
        )


@pytest.mark.parametrize("kinds", ["U", "XU", "UU"])
def test_angles_without_end_are_of_unit_length_to_a_millionth(kinds):
    admission = Admission(sliders(kinds))
    unit = np.concatenate([[0.6, -0.8] if kind == "U" else [7.0] for kind in kinds])
    for off, good in ((0.95e-6, True), (-0.95e-6, True), (1.05e-6, False), (-1.05e-6, False)):
        q = unit * np.where(np.arange(len(unit)) >= len(unit) - 2, 1 + off, 1.0)
        for given in (q, np.stack([unit, q]), np.stack([[q, unit], [unit, unit]])):
            if good:
                np.testing.assert_array_equal(admission.configuration(given), given)
            else:
                with pytest.raises(
                    rnc.InputError, match=r"^q holds a \(cos, sin\) pair or a quaternion that is not of"
                ):
                    admission.configuration(given)


# ---------------------------------------------------------------------- parts of a reduction


def test_a_row_is_naturally_as_long_as_in_the_median_or_where_most_are_zero_at_its_longest():
    robot = sliders()
    sizes = np.array([[3.0, 0.0, 0.0, 6e-12], [1.0, 0.0, 5.0, 0.0], [2.0, 0.0, 0.0, 8e-12], [7.0, 4.0, 6.0, 0.0]])

    def rows(q):
        size = sizes[int(q[0])]
        return np.outer(size, [0.6, 0.0, -0.8])

    outputs = OutputStack([VelocityRows(np.array([[0.0, 3.0, 4.0]]), ["v"], [""])])
    q = np.zeros((4, 3))
    q[:, 0] = range(4)
    found = row_scales(robot, RowStack([Turning("abcd", rows)]), outputs, q)
    # The longest of all is 7, so that what is below 7e-12 is zero: of row d one is left, so that it is its longest.
    np.testing.assert_allclose(found, [2.5, 4.0, 2.5, 8e-12, 5.0])

    def seldom(q):
        if q[0] != 2:
            raise rnc.SingularityError("undefined", q=q, condition=np.inf, rows=("a",))
        return np.eye(3)[:1] * 3

    found = row_scales(robot, RowStack([Turning("a", seldom)]), outputs, q)
    np.testing.assert_allclose(found, [3.0, 5.0])
    np.testing.assert_array_equal(row_scales(robot, RowStack([Turning("a", seldom)]), outputs, q[:2]), [0.0, 0.0])


def test_parts_are_put_together_once_and_again_in_other_velocities():
    robot = sliders("XXXX", (2.0, 3.0, 5.0, 7.0))
    rows = [Flat(np.arange(8.0).reshape(2, 4), "ab"), Flat([[1.0, 0, 0, -1.0]], "c")]
    outputs = OutputStack([VelocityRows(np.eye(4)[[1, 3]], ["x", "y"], ["m/s", "rad/s"])])
    vertical = OutputStack([rnc.JointPosition("c").bind(robot)])
    lengths = np.array([5.0, 7.0, 0.5, 2.0, 4.0])
    for limit, free, kept, quick in (
        (1e8, False, [0, 2], 1e6),
        (200.0, False, [0, 2], 4e4),
        (1e8, True, [1, 2], 1e6),
        (1e8, False, [0, 1, 2], 1e16),
        (1e8, True, [0, 1, 2], 1e6),
    ):
        parts = ReductionData(
            robot, RowStack(rows), kept, Actuation(["a"], robot), outputs, vertical, limit, lengths, free
        )
        assert (parts.n, parts.m, parts.r, parts.p) == (4, len(kept), 2, 1)
        assert (parts.singularity_limit, parts.fast_limit) == (limit, pytest.approx(quick))
        assert parts.fast_length == pytest.approx(((lengths[[*kept, 3, 4]]) ** 2).sum())
        assert (parts.kept, parts.has_alternatives) == (tuple(kept), free or len(kept) < 3)
        np.testing.assert_array_equal(parts.lengths, lengths[[*kept, 3, 4]])
        np.testing.assert_array_equal(parts.constraint_scales, lengths[:3])
        np.testing.assert_array_equal(parts.output_scales, lengths[3:])
        whole = np.vstack([rows[0].matrix, rows[1].matrix])
        np.testing.assert_array_equal(parts.template, np.vstack([whole[kept], np.eye(4)[[1, 3]]]))
        assert parts.constraints.names == tuple("abc"[k] for k in kept)
    parts = ReductionData(robot, RowStack(rows), [0, 2], Actuation(["a"], robot), outputs, vertical, 1e5, lengths)
    W = np.array([[0.6, 0, 0.8, 0], [0, 1.0, 0, 0]])
    for other, names, matrix, sizes, free in (
        (parts.in_velocities(W), ("w[0]", "w[1]"), W, [1.0, 1.0], False),
        (parts.in_velocities(W, ["u", "w"], free=True), ("u", "w"), W, [1.0, 1.0], True),
        (parts.in_entries([2, 0]), ("c", "a"), np.eye(4)[[2, 0]], [1.0, 1.0], False),
        (parts.in_entries((1, 3), free=True), ("b", "d"), np.eye(4)[[1, 3]], [1.0, 1.0], True),
    ):
        assert (other.reducing.names, other.free, other.kept) == (names, free, (0, 2))
        assert other.reducing.quasi.tolist() == [True, True]
        assert other.reducing.units == ("", "")
        np.testing.assert_array_equal(other.template[2:], matrix)
        np.testing.assert_array_equal(other.lengths, [5.0, 0.5, *sizes])
        assert (other.kinematics, other.singularity_limit) == (parts.kinematics, 1e5)
        assert (other.vertical, other.actuation, other.rows) == (vertical, parts.actuation, parts.rows)
    other = parts.keeping([1, 2])
    assert (other.kept, other.reducing, other.free) == ((1, 2), outputs, False)
    np.testing.assert_array_equal(other.lengths, [7.0, 0.5, 2.0, 4.0])


def test_velocity_rows_are_combinations_without_a_value():
    rows = VelocityRows(np.arange(6.0).reshape(2, 3), ["a", "b"], ["m/s", ""])
    assert (rows.names, rows.units, rows.angular, rows.quasi) == (("a", "b"), ("m/s", ""), (False, False), True)
    at = Kinematics(sliders()).position(np.zeros((5, 3)))
    np.testing.assert_array_equal(rows.value(at), np.zeros((5, 2)))
    assert rows.bias_acceleration_gradient(at).shape == (2, 3)


# ---------------------------------------------------------------------- tasks


def test_outputs_are_divided_by_name():
    robot = sliders("XXXX", (2.0, 3.0, 5.0, 7.0))
    outputs = [rnc.JointPosition(name) for name in "dabc"]
    reduced = SimpleNamespace(
        reducing=OutputStack([each.bind(robot) for each in outputs[:3]]),
        vertical=OutputStack([each.bind(robot) for each in (*outputs[3:], *outputs[:2])]),
        r=3,
    )
    task = rnc.Task.of(reduced, ["b", "d"], ["a"], ["a", "c"])
    assert (task.primary.tolist(), task.redundant.tolist(), task.vertical.tolist()) == ([2, 0], [1], [2, 0])
    assert (task.primary_names, task.redundant_names, task.vertical_names) == (("b", "d"), ("a",), ("a", "c"))
    assert task.r == 3
    everything = rnc.Task.of(reduced, ["b", "d", "a"], [])
    assert everything.vertical.tolist() == [0, 1, 2]
    assert everything.redundant.dtype == int
    for given, words in (
        ((["b", "x"], ["a"]), "^no reducing output 'x'"),
        ((["b", "d"], ["a"], ["b"]), "^no vertical output 'b'"),
        ((["b", "d"], ["b"]), "^duplicate output in primary and redundant$"),
        ((["b", "b", "d"], ["a"]), "^duplicate output in primary and redundant$"),
        ((["b"], ["d"]), "^reducing output 'a' is neither primary nor redundant$"),
        (([], []), "^reducing output 'd' is neither primary nor redundant$"),
    ):
        with pytest.raises(rnc.ConfigurationError, match=words):
            rnc.Task.of(reduced, *given)
