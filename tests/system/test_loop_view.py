"""A loop of one's own in a real browser: states, pause, steps, sliders, and what is refused."""

import threading
import time

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from browsing import place, shape_place, visit
from patience import PATIENCE, eventually
from systems import space_robot, space_robot_in_joints

DT = 0.02


class Loop(threading.Thread):
    """Loop of a user: the arm turns at the rate of a slider until the page ends it."""

    def __init__(self, reduced, view):
        super().__init__(daemon=True)
        self.reduced, self.view, self.q, self.count = reduced, view, reduced.robot.configuration({"joint_2": 1.0}), 0

    def run(self):
        while self.view.running:
            v2 = np.array([0.0, 0.0, self.view.gains["rate"]])
            self.view.update(self.q, v2, t=DT * self.count)
            self.q = pin.integrate(self.reduced.robot.model, self.q, DT * np.array(self.reduced.at(self.q, v2).v))
            self.count += 1


def slide(page, name, value):
    page.evaluate(
        "([name, value]) => { const s = [...document.querySelectorAll('.slider')]"
        ".find(each => each.querySelector('span').title === name).querySelector('input');"
        "s.value = value; s.dispatchEvent(new Event('input')); }",
        [name, value],
    )


def test_a_page_pauses_steps_and_tunes_a_loop(browser):
    reduced = space_robot_in_joints()
    with rnc.show(reduced, gains={"rate": (-2.0, 2.0, 1.0)}, title="my loop", open_browser=False) as view:
        page, problems = visit(browser, view.url)
        loop = Loop(reduced, view)
        loop.start()
        page.wait_for_selector("#loop button", timeout=1000 * PATIENCE)
        assert eventually(lambda: loop.count > 5)
        page.click("#loop button:has-text('Pause')")
        assert eventually(lambda: view.paused)
        page.wait_for_selector("#loop button:has-text('Continue')", timeout=1000 * PATIENCE)
        time.sleep(5 * DT)
        count, q = loop.count, loop.q.copy()
        time.sleep(5 * DT)
        assert loop.count == count  # it stands
        expected = shape_place(reduced.robot, q, "tip_0")
        assert eventually(lambda: np.allclose(place(page, "robot", "visuals", "tip_0"), expected, atol=1e-4))
        # One step is one more state, which the page shows.
        page.click("#loop button:has-text('Step')")
        assert eventually(lambda: loop.count == count + 1)
        expected = shape_place(reduced.robot, loop.q, "tip_0")
        assert eventually(lambda: np.allclose(place(page, "robot", "visuals", "tip_0"), expected, atol=1e-4))
        # A slider changes the loop, a reloaded page shows its value, and messages out of range change nothing.
        slide(page, "rate", -1.5)
        assert eventually(lambda: view.gains["rate"] == pytest.approx(-1.5, abs=0.01))
        page.reload()
        page.wait_for_selector("#loop button:has-text('Continue')", timeout=1000 * PATIENCE)
        value = page.eval_on_selector("#loop .slider input", "each => each.value")
        assert float(value) == pytest.approx(-1.5, abs=0.01)
        page.evaluate(
            "panel.send({kind: 'gain', name: 'rate', value: 3.0}); panel.send({kind: 'gain', name: 'no', value: 1})"
        )
        before = loop.q[3]
        page.keyboard.press("Space")
        assert eventually(lambda: loop.count > count + 10)
        assert view.gains["rate"] == pytest.approx(-1.5, abs=0.01)
        assert loop.q[3] < before
        page.click("#loop button:has-text('End loop')")
        loop.join(PATIENCE)
        assert not loop.is_alive()
        assert problems == []
        page.context.close()
    assert view.problem is None


def test_a_state_that_is_not_drawn_says_why():
    """The outputs of a straight arm are dependent: the state is left out, and the next one is drawn."""
    reduced = space_robot()
    with rnc.show(reduced, speed=0.0, open_browser=False) as view:
        view.update(reduced.robot.configuration(), t=0.0)
        assert eventually(lambda: isinstance(view.problem, rnc.SingularityError))
        view.update(reduced.robot.configuration({"joint_1": 0.3, "joint_2": 1.0, "joint_3": 0.5}), t=1.0)
        assert eventually(lambda: view.problem is None)


def test_gains_that_a_controller_refuses_leave_the_last_one():
    def made(k):
        if k > 1.0:
            raise rnc.ConfigurationError("k is too large")
        return k

    with rnc.show(space_robot_in_joints(), gains={"k": (0.0, 2.0, 0.5)}, controller=made, open_browser=False) as view:
        view._receive({"kind": "gain", "name": "k", "value": 1.5})
        assert (view.controller, view.gains["k"]) == (0.5, 1.5)
        view._receive({"kind": "gain", "name": "k", "value": 0.75})
        assert view.controller == 0.75


def test_a_loop_does_not_wait_for_ever_for_a_page_that_is_gone(monkeypatch):
    monkeypatch.setattr("rnc_pin.visualization.loop_view._ABSENCE", 0.2)
    reduced = space_robot_in_joints()
    with rnc.show(reduced, open_browser=False) as view:
        view._receive({"kind": "pause", "value": True})
        assert view.paused
        view.update(reduced.robot.configuration())
        assert not view.paused


@pytest.mark.parametrize("message", [None, 3, [], {}, {"kind": "pause"}, {"kind": "gain", "name": "k", "value": "1"},
    {"kind": "gain", "name": "k", "value": float("nan")}, {"kind": "gain", "name": ["k"], "value": 1.0}, {"kind": {}},
    {"kind": "gain", "name": "k", "value": True}])  # fmt: skip
def test_other_messages_change_nothing(message):
    with rnc.show(space_robot_in_joints(), gains={"k": (0.0, 2.0, 0.5)}, open_browser=False) as view:
        view._receive(message)
        assert (view.paused, view.running, dict(view.gains)) == (False, True, {"k": 0.5})


def test_what_a_view_refuses():
    reduced = space_robot_in_joints()
    for values in ((1.0, 0.0, 0.5), (0.0, 1.0, 2.0), (0.0, np.inf, 1.0), (0.0, 1.0)):
        with pytest.raises(rnc.InputError, match="gain 'k'"):
            rnc.show(reduced, gains={"k": values}, open_browser=False)
    with rnc.show(reduced, open_browser=False) as view:
        q = reduced.robot.configuration()
        for arguments, words in (((q[:2],), r"q has shape \(2,\)"), ((q, [1.0]), r"v2 has shape \(1,\)"),
                                 ((q * np.nan,), "q holds values that are not finite")):  # fmt: skip
            with pytest.raises(rnc.InputError, match=words):
                view.update(*arguments)
        with pytest.raises(rnc.InputError, match="t has to be finite"):
            view.update(q, t=np.nan)
        with pytest.raises(rnc.InputError, match="no controller"):
            _ = view.controller
    with pytest.raises(rnc.InputError, match="the view is closed"):
        view.update(q)
    with rnc.show(reduced.robot, open_browser=False) as view, pytest.raises(rnc.InputError, match="without a reduced"):
        view.update(q, np.zeros(3))
