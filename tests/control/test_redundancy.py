"""The class-1 law (12) beside a plain rewriting, at numbers that no robot gives: partitions, offsets, batches."""

import numpy as np
import pytest

import rnc_pin as rnc
from controlled_tasks import Cubic, manipulator, task_at, wide
from rnc_pin.control import Posture, RedundancyController
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.motion.planning import Hold
from systems import random_states
from tolerances import ROUNDING

K3, K21 = np.array([1.7, 0.6]), np.array([0.9, 2.3])
PRIMARY, VERTICAL, ORDERS = [3, 0], [2, 0], np.random.default_rng(7).uniform(-1, 1, (2, 4, 2))


def seen(fields, t):
    """Motion that is linear in time, t away from a moment."""
    x1, x2, v1, v2, A, A_dot, b, b_dot, affine = fields
    offsets = (b + t * b_dot, b_dot) if affine else (None, None)
    return Measurement(None, None, v2, x1 + t * v1, x2 + t * v2, v1, A + t * A_dot, A_dot, *offsets)


def drawn(batch, r, affine, seed):
    generator = np.random.default_rng(seed)
    shapes = ((3,), (r,), (3,), (r,), (3, r), (3, r), (3,), (3,))
    return (*(generator.uniform(-1, 1, (*batch, *shape)) for shape in shapes), affine)


def whole(chosen, m, t, secondary):
    """(v21, v22) of one state by the first-order conditions of the cheapest v22."""
    first, base = (Cubic(*orders).at(t) for orders in ORDERS)
    v21 = first.velocity + K21 * (first.position - m.x2[PRIMARY])
    right = base.velocity + K3 * (base.position - m.x1[VERTICAL]) - m.A_star[VERTICAL][:, PRIMARY] @ v21
    if m.v1_offset is not None:
        right = right - m.v1_offset[VERTICAL]
    A4, n = m.A_star[VERTICAL][:, chosen.redundant], len(chosen.redundant)
    if n == 2:
        return v21, np.linalg.solve(A4, right)
    z = secondary(t, m)[0] if secondary else np.zeros(n)
    system = np.block([[np.eye(n), A4.T], [A4, np.zeros((2, 2))]])
    return v21, np.linalg.solve(system, np.concatenate([z, right]))[:n]


def objective(t, m):
    """Of time and outputs."""
    return np.array([0.3, -0.4, 1.1]) * t + m.x2[..., [1, 2, 4]], np.array([0.3, -0.4, 1.1]) + m.v2[..., [1, 2, 4]]


@pytest.mark.parametrize("affine", [False, True])
@pytest.mark.parametrize(
    ("redundant", "secondary"), [([2, 1], None), ([4, 1, 2], None), ([4, 1, 2], objective)], ids=["square", "wide", "z"]
)
def test_the_class_1_law_is_the_cheapest_way_to_its_vertical_rates(redundant, secondary, affine):
    chosen, r = task_at(PRIMARY, redundant, VERTICAL), 2 + len(redundant)
    law = RedundancyController(chosen, *(Cubic(*orders) for orders in ORDERS), K3, K21, secondary)
    fields, t, h = drawn((2, 3), r, affine, 4), 0.4, 1e-4
    target, state = law.step(t, seen(fields, 0.0))
    assert state is None
    for at in np.ndindex(2, 3):
        one = (*(each[at] for each in fields[:-1]), affine)
        parts = [whole(chosen, seen(one, s), t + s, secondary) for s in (-2 * h, -h, 0.0, h, 2 * h)]
        for place, k in ((chosen.primary, 0), (chosen.redundant, 1)):
            far, near, here, after, beyond = (part[k] for part in parts)
            np.testing.assert_allclose(target.v2[at][place], here, rtol=1e-9, atol=1e-10)
            slope = (far - 8 * near + 8 * after - beyond) / (12 * h)
            np.testing.assert_allclose(target.v2_dot[at][place], slope, atol=1e-7 * (1 + np.abs(slope).max()))
        alone, _ = law.step(t, seen(one, 0.0))
        steady, _ = law.step(t, seen(one, 0.0)._replace(v1_offset_dot=None))
        np.testing.assert_array_equal(steady.v2, alone.v2)  # an offset counts where nobody gave its rate
        np.testing.assert_allclose(alone.v2, target.v2[at], rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(alone.v2_dot, target.v2_dot[at], rtol=1e-9, atol=1e-9)
        first, base = (Cubic(*orders).at(t).position for orders in ORDERS)
        np.testing.assert_array_equal(alone.x2[PRIMARY], first)
        np.testing.assert_array_equal(target.x1[at][VERTICAL], base)
        assert np.isnan(np.delete(target.x2[at], PRIMARY)).all()
        assert np.isnan(np.delete(alone.x1, VERTICAL)).all()
        assert (alone.x1.shape, alone.x2.shape) == ((3,), (r,))


def test_the_class_1_law_gives_up_where_its_rates_exceed_what_it_has_to_do_a_hundred_million_times():
    """The condition is that of the worst A4, its rows scaled."""
    flat = RedundancyController(task_at([], [0, 1], [0, 1]), Cubic(*np.zeros((4, 0))), Hold([3.0, 1.0]))
    even, still = np.array([[1.0, 2.0], [2.0, 4.0 + 1e-14]]), np.zeros((3, 2))
    A = np.stack([np.eye(2), even, np.array([[3.0, 4.0], [0.0, 1.0]])])
    q = np.array([[0.4], [5.0], [6.0]])
    with pytest.raises(rnc.SingularityError, match="A4 is singular") as caught:
        flat.step(0.0, Measurement(q=q, v2=still, x1=still, x2=still, v1=still, A_star=A, A_star_dot=0 * A))
    unit = even / np.linalg.norm(even, axis=1, keepdims=True)
    assert caught.value.condition == pytest.approx(np.linalg.cond(unit), rel=0.5)
    assert caught.value.rows == ("c_0", "c_1", "b_0", "b_1")
    np.testing.assert_array_equal(caught.value.q, q[1])  # the first run that is singular
    assert not np.shares_memory(caught.value.q, q)


def test_the_class_1_law_says_which_outputs_are_too_few():
    nothing, one, two = Cubic(*np.zeros((4, 0))), Hold([0.0]), Hold([0.0, 0.0])
    words = "the class-1 controller needs as many redundant as vertical outputs, found "
    for places, counts in (
        (([0], [1], [0, 2]), "1 (b_1) and 2 (c_0, c_2)"),
        (([0, 1], [], [0]), "0 (none) and 1 (c_0)"),
        (([0], [2, 1], []), "2 (b_2, b_1) and 0 (none)"),
        (([0], [], []), "0 (none) and 0 (none)"),
    ):
        with pytest.raises(rnc.ConfigurationError) as caught:
            RedundancyController(task_at(*places), two, two)
        assert str(caught.value) == words + counts
    words = r"a secondary objective has no freedom left: .* found 1 \(b_1\) and 1 \(c_3\)"
    square = task_at([0], [1], [3])
    with pytest.raises(rnc.ConfigurationError, match=words):
        RedundancyController(square, one, one, secondary=Posture(square, one))
    plain = {"type": "RedundancyController", "k3": 2.0, "k21": 2.0}
    assert RedundancyController(task_at([], [2, 0, 1], [0]), nothing, one).describe() == plain
    for first, second, words in ((two, one, "primary reference has 2 values for 1"), (one, two, "vertical .* 2 .* 1 ")):
        with pytest.raises(rnc.ConfigurationError, match=words):
            RedundancyController(task_at([1], [0], [0]), first, second)


def test_a_posture_has_a_gain_for_each_output():
    reduced, task = manipulator()
    posture = Posture(task, Hold([0.2, -0.1]), np.array([0.0, 3.0]))
    (q, v2), *_ = random_states(reduced, 1, seed=6, condition=20.0)
    z, z_dot = posture(0.0, reduced.at(q, v2).measure())  # the speed has no integral, and no gain
    shoulder = reduced.at(q).outputs()[1][3]
    np.testing.assert_allclose(z, [0.0, 3.0 * np.angle(np.exp(1j * (-0.1 - shoulder)))], atol=ROUNDING)
    np.testing.assert_allclose(z_dot, [0.0, -3.0 * v2[3]], atol=ROUNDING)
    assert posture.describe() == {"type": "Posture", "k": [0.0, 3.0]}
    for k in ([1.0, 2.0, 3.0], -1.0):
        with pytest.raises(rnc.ConfigurationError, match="has to be a number or 2, not negative"):
            Posture(task, Hold([0.2, -0.1]), k)
    with pytest.raises(rnc.ConfigurationError, match="the redundant reference has 3 values for 2"):
        Posture(task, Hold(np.zeros(3)))


def test_posture_uses_the_freedom_that_is_left():
    ends = {}
    for posture in (False, True):
        reduced, kinematic, q0 = wide(posture=posture)
        _, path = rnc.kinematic_rollout(reduced, kinematic, q0, 5.0, 0.05)
        x1, x2 = reduced.at(path).outputs()
        np.testing.assert_allclose(x1[-1], kinematic.vertical.at(9.0).position, atol=1e-3)
        np.testing.assert_allclose(x2[-1, :2], kinematic.primary.at(9.0).position, atol=1e-3)
        ends[posture] = abs(x2[-1, 3] - x2[0, 3])
    assert ends[True] < 0.2 * ends[False]
