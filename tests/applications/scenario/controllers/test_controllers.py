"""Each type of controller has settings of its own, and the schema knows whose they are."""

from functools import cache

import pytest

import rnc_pin as rnc
from refusals import refused
from rnc_pin.applications.scenario.controllers import TYPES
from rnc_pin.applications.scenario.files import find_scenario, read_yaml, with_options
from rnc_pin.applications.scenario.schema.scenario import schema, validate
from rnc_pin.control import OUTER_GAINS

jsonschema = pytest.importorskip("jsonschema", reason="reads schemas; comes with the test extra")

NEEDED = {
    "redundancy": {}, "reducing_outputs": {}, "steering": {},
    "jacobian_transpose": {"active": ["joint_2", "joint_3"]},
    "two_phase": {"platform": {"position": ["base_x", "base_y"], "to": [0, 0, 0], "begin": 1}},
    "state_feedback": {"state_cost": 1.0}, "plan_feedback": {},
    "qp": {"tasks": [{"damping": {"weight": 0.1}}, {"output": {"output": {"frame_position": {"frame": "tip"}}}}]},
    "inverse_dynamics": {"tasks": [{"damping": {"weight": 0.1}}]},
    "set_point": {"goal": {"joint_1": 0.5}, "duration": 4.0},
    "predictive": {"goal": {"joint_1": 0.5}, "horizon": 1.0}, "way": {"goal": {"joint_1": 0.5}}, "none": {},
}  # fmt: skip
VALUES = {  # of every setting that some type has
    "preset": "scaled", "gains": "plan", "tracker": "computed_torque", "gravity_compensation": False,
    "adaptation": 3.0, "bandwidth": 20.0, "delay": 0.01, "dead_zone": [0.1, 0.0, 0.2],
    "posture": {}, "unknown": {"base": "platform", "initial": {"joint_1": 1.0}},
    "coordinates": ["joint_1", {"joint": "joint_2"}], "rates": ["joint_1"],
    "input_cost": {"joint_1": 2.0}, "v2": {"joint_1": 0.1}, "hold": ["joint_1"], "cyclic": ["joint_1"],
    "limits": {"joint_velocity": {"limit": 2.0}, "joint_position": None,
        "regions": [{"frame": "tip", "box": {"x": [0, 1]}}]},
    "damping": 0.1, "frequency": 5.0, "velocity_gain": 10.0, "friction": 0.6, "bounds": {"input": {"joint_1": [-1, 1]}},
    "clearance": 0.1, "links": True, "acceleration": 1.0, "speed": 0.5, "seed": 3,
    "velocities": True, "equality": True, "nodes": 10, "seeds": 2, "tube": 0.1, "check": 0.5,
    "braking": 2.0, "tolerance": 0.01, "form": "acceleration", "period": 0.1, "iterations": 2, "budget": 0.02,
    "weight": 2.0, "velocity_weight": 2.0, "precision": 0.01, "effort": 0.1, "braking_time": 1.0,
    **{name: values[name] for values in NEEDED.values() for name in values},
    **dict.fromkeys(("k", "k1", "k2", "k3", "k4", "k21", "beta", "gamma", "sigma", "alpha"), 2.0),
}  # fmt: skip


def scenario(controller):
    return with_options(read_yaml(find_scenario("space-robot")), {"controller": controller, "comparisons": {}})


@cache
def validator():
    return jsonschema.Draft202012Validator(schema())


def test_every_setting_is_tried():
    assert set(TYPES) == set(NEEDED)
    assert set(VALUES) == {name for each in TYPES.values() for name in each.model_fields} - {"type"}


@pytest.mark.parametrize("kind", TYPES)
def test_a_type_takes_its_own_settings_and_no_other(kind):
    # What some mean nothing without.
    beside = {"alpha": {"unknown": VALUES["unknown"]}}
    of_a_file = {("set_point", "limits"): {"effort": None}}  # those of the robot's file
    for name, usual in VALUES.items():
        needed = {key: value for key, value in beside.get(name, {}).items() if key in TYPES[kind].model_fields}
        raw = scenario({"type": kind, **NEEDED[kind], **needed, name: of_a_file.get((kind, name), usual)})
        own = name in TYPES[kind].model_fields
        assert validator().is_valid(raw) == own, name
        if own:
            assert getattr(validate(raw, "mine").controller, name) is not None
            continue
        with pytest.raises(rnc.ConfigurationError) as caught:
            validate(raw, "mine")
        message = str(caught.value)
        assert message.startswith(f"mine: controller.{name}: does not belong to type '{kind}' (but to ")
        assert "did you mean" in message or "expected one of" in message
        assert "\n" not in message


def test_null_takes_a_setting_away_so_that_an_option_may_change_the_type():
    changes = {"controller.type": "reducing_outputs", "controller.posture": None}
    changed = with_options(scenario({"type": "redundancy", "posture": {}}), changes)
    assert isinstance(validate(changed, "mine").controller, TYPES["reducing_outputs"])


test_what_is_wrong_is_told_without_words_of_the_union = refused([
    ({"type": "jacobian_transpose"}, "controller.active: is missing; expected actuators that are on"),
    ({"type": "two_phase"}, "controller.platform: is missing; expected goal pose and start time"),
    ({"type": "two_phase", "preset": "paper", **NEEDED["two_phase"], "adaptation": 2}, "belongs to the preset"),
    ({"type": ["steering"]}, r"controller.type: expected 'inverse_dynamics', .* or 'way', found \['steering'\]"),
    ("steering", "controller: expected a mapping, found 'steering'"),
], lambda controller: validate(scenario(controller), "mine"), rnc.ConfigurationError)  # fmt: skip


@pytest.mark.parametrize("preset", OUTER_GAINS)
def test_a_stabiliser_rests_within_what_a_goal_allows(preset):
    allowed = rnc.Scenario.load("mobile-manipulator-two-phase").content.goal_tolerance
    assert OUTER_GAINS[preset].tolerance < 0.8 * allowed
