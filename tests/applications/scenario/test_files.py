"""Scenario files: what they build, what options change, and one line for whatever is wrong in them."""

import math
import warnings

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from places import DIRT
from refusals import refusal
from rnc_pin.applications.scenario.files import built_in_names, find_scenario, parse_option, read_yaml, with_options
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.sweep.runs import draws_of
from urdf_parts import write

# Comparisons would build everything twice; a roll-out of one second is enough for gains.
QUICK = {"comparisons": {}, "simulation.duration": 1.0, "sweep": {}}
SPACE_ROBOT = with_options(read_yaml(find_scenario("space-robot")), QUICK)


def plan_of(changes, folder):
    """The plan of the space robot's scenario with values at dotted keys replaced."""
    return Scenario.load(str(write(folder / "mine.yaml", yaml.safe_dump(with_options(SPACE_ROBOT, changes))))).build()


CUT_SHORT = ("space-robot-uncertain", "wheels-uncertain")


# test_built_in_runs builds these.
PLANNED = [name for name in built_in_names() if "\nplanner:" in find_scenario(name).read_text()]


@pytest.mark.parametrize("name", sorted(set(built_in_names()) - set(PLANNED)))
def test_built_in_scenarios_can_run(name):
    """With their comparisons. Their whole length is planned here or in test_built_in_runs."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", rnc.ModelWarning)
        prepared = Scenario.load(name, {} if name in CUT_SHORT else {"simulation.duration": 0.4}).build()
    scenario = prepared.experiment.scenario
    assert prepared.name == name
    assert scenario.title
    assert scenario.plots
    assert (prepared.experiment.warnings, set(prepared.comparisons)) == ((), set(scenario.comparisons))


def test_what_the_file_says_is_what_is_built(tmp_path):
    experiment = plan_of({}, tmp_path).experiment
    assert experiment.reduced.robot.name == "space_robot"
    assert experiment.reduced.constraints.names == ("momentum(platform)",)
    assert experiment.reduced.reducing.names == ("tip_x", "tip_y", "joint_1")
    assert experiment.reduced.vertical.names == ("platform",)
    assert experiment.reduced.actuation.names == ("joint_1", "joint_2", "joint_3")
    np.testing.assert_array_equal(experiment.q0, [0.0, -0.4, 1.8, -1.1])
    assert (experiment.simulation.duration, experiment.simulation.dt) == (1.0, 0.002)


@pytest.mark.filterwarnings("ignore::rnc_pin.ModelWarning")  # its hinges are rounded
def test_loops_can_be_asked_for_and_are_closed_at_the_start(tmp_path):
    motors = ["right_motor_joint", "left_motor_joint"]
    ends = {"offset_a": [0, 0.005, 0.2], "offset_b": [0, 0.01, 0.2]}
    start = dict.fromkeys(motors, 1.4)
    changes = {
        "robot": {"urdf": str(DIRT / "five_bar.urdf")},
        "constraints": [{"loop_closure": {"frame_a": "right_shin", "frame_b": "left_shin", "kind": "point", **ends}}],
        "actuators": motors,
        "outputs": {"reducing": [{"joint": motor} for motor in motors], "vertical": []},
        "task": {},
        "initial": {"q": {**start, "right_knee": -2.0, "left_knee": -1.0}},
        "controller": {"type": "reducing_outputs", "preset": "paper"},
        "reference": {},
        "plots": {},
        "view": {},
    }
    stay = "; joints named in initial.q stay: .*right_knee"
    with pytest.raises(rnc.ConfigurationError, match=r"initial.q: .* has residual .*" + stay):
        plan_of(changes, tmp_path)  # all four cannot stay where they are
    experiment = plan_of({**changes, "initial": {"q": start}}, tmp_path).experiment
    reduced = experiment.reduced
    values = reduced.robot.joint_values(experiment.q0)
    assert [values[motor] for motor in motors] == pytest.approx([1.4, 1.4])
    assert np.abs(reduced.assembly.residual(experiment.q0)).max() < 1e-6  # of rounded hinges


def test_outputs_without_a_task_are_all_primary(tmp_path):
    experiment = plan_of({"task": {}, "controller.type": "reducing_outputs", "reference": {}}, tmp_path).experiment
    reduced = experiment.reduced
    v2 = np.zeros(reduced.r)
    measurement = reduced.at(experiment.q0, v2).measure(v2)
    command, _ = experiment.controller.step(0.0, measurement, experiment.controller.initial_state(measurement))
    # Without a reference every one of them stays where it is.
    np.testing.assert_array_equal(command.x2_desired, reduced.at(experiment.q0).outputs()[1])


def test_gains_by_hand_replace_those_of_the_preset(tmp_path):
    changes = {"controller.preset": "paper", "controller.k": [1.0, 2.0, 3.0], "controller.sigma": 0.5}
    gains = plan_of(changes, tmp_path).experiment.provenance.to_json()["controller"]["gains"]
    assert gains == {"k": [1.0, 2.0, 3.0], "beta": 10.0, "sigma": 0.5}


@pytest.mark.parametrize(("option", "expected"), [
    ("simulation.duration=5", ("simulation.duration", 5)),
    ("a.b=[1, 2.5]", ("a.b", [1, 2.5])),
    ("a={b: c}", ("a", {"b": "c"})),
    ("a=true", ("a", True)),
    ("a=", ("a", None)),
    ("a=b=c", ("a", "b=c")),
    (" a = b ", ("a", "b")),
])  # fmt: skip
def test_an_option_is_a_key_and_a_yaml_value(option, expected):
    assert parse_option(option) == expected


@pytest.mark.parametrize("option", [
    "", "simulation.duration", "=5", "a={b", "a=2020-13-45", "a={b: 1, b: 2}", "a=" + 1000 * "[",
], ids=["empty", "no value", "no key", "cut off", "no such day", "key twice", "deep"])  # fmt: skip
def test_an_option_that_is_none_is_refused(option):
    assert "option '" in refusal(lambda: parse_option(option))


def test_options_replace_values_in_a_copy():
    raw = {"a": {"b": 1, "c": [1, {"d": 2}]}}
    changed = with_options(raw, {"a.b": 5, "a.c.0": 6, "a.c.1.d": 7, "new.key": 8})
    assert changed == {"a": {"b": 5, "c": [6, {"d": 7}]}, "new": {"key": 8}}
    assert raw == {"a": {"b": 1, "c": [1, {"d": 2}]}}


@pytest.mark.parametrize(("key", "words"), [
    ("a.b.c", "'b' is 1, not a mapping"),
    ("a.list.2", "'2' is not an index into a list of 2"),
    ("a.list.-1", "'-1' is not an index"),
    ("a.list.x", "'x' is not an index"),
    ("a.list.²", "'²' is not an index"),
])  # fmt: skip
def test_an_option_that_leads_nowhere_is_refused(key, words):
    assert words in refusal(lambda: with_options({"a": {"b": 1, "list": [1, 2]}}, {key: 3}))


PRIMARY, FIRST = "reference.primary", "outputs.reducing.0"
TIP = {"frame_position": {"frame": "tip", "axes": "xy"}}

BROKEN = {
    "unknown key": ({"contoller": {}}, ["mine.yaml: 'contoller' is not known; did you mean 'controller'?"]),
    "robot is a name": ({"robot": "space_robot.urdf"}, ["robot: expected a mapping", "'space_robot.urdf'"]),
    "no robot": ({"robot": {"base": "fixed"}}, ["robot: expected one of 'urdf', 'mjcf' and 'example'"]),
    "misspelt URDF": ({"robot.urdf": "space_robt.urdf"}, ["did you mean 'space_robot.urdf'?"]),
    "unknown base": ({"robot.base": "plannar"}, ["robot.base: expected 'fixed', 'planar' or 'free'", "'plannar'"]),
    "short gravity": ({"robot.gravity": [0, 0]}, ["robot.gravity", "[0, 0]"]),
    "unknown locked joint": ({"robot.lock": {"platfrom": 0}}, ["'platfrom'", "did you mean 'platform'?"]),
    "unknown constraint": ({"constraints.0": {"momentom": "platform"}}, ["constraints[0]", "mean 'momentum'?"]),
    "constraint that is a word": ({"constraints.0": "momentum"}, ["constraints[0]", "'momentum'"]),
    "momentum without a joint": ({"constraints.0": {"momentum": {"momentum": 3}}},
        ["constraints[0].momentum.joint: is missing"]),
    "coupling to itself": ({"constraints.0": {"joint_coupling": {"joint": "joint_1", "driver": "joint_1"}}},
        ["joint 'joint_1' cannot be coupled to itself"]),
    "wheel of radius zero": ({"constraints.0": {"rolling_wheel": {"frame": "tip", "radius": 0}}},
        ["constraints[0].rolling_wheel.radius: expected greater than 0", "found 0"]),
    "unknown frame": ({f"{FIRST}.frame_position.frame": "tpi"}, ["frame 'tpi'", "did you mean 'tip'?"]),
    "output that is a name": ({FIRST: "joint_1"},
        ["outputs.reducing[0]", "'joint_1'; a joint is written {joint: joint_1}"]),
    "no reducing outputs": ({"outputs.reducing": []}, ["mine.yaml: outputs.reducing:"]),
    "too few outputs": ({"outputs.reducing": [TIP]}, ["2 reducing outputs (tip_x, tip_y)", "expected 3"]),
    "task of an unknown output": ({"task.primary": ["tip_x", "tip_z"]}, ["'tip_z'", "did you mean"]),
    "unknown initial joint": ({"initial.q": {"jiont_1": 1}}, ["'jiont_1'", "did you mean 'joint_1'?"]),
    "initial NaN": ({"initial.q.joint_1": math.nan}, ["initial.q.joint_1: expected a finite number", "nan"]),
    "reference that nothing follows": ({"reference.redundant": {"hold": {}}},
        ["is not followed by a controller of type 'redundancy'; controller.pos"]),
    "reference of another type": ({"controller": {"type": "jacobian_transpose", "active": ["joint_2", "joint_3"]}},
        ["reference.vertical: is not"]),
    "reference of an unknown part": ({"reference.primray": {}}, ["reference: 'primray'", "mean 'primary'?"]),
    "goal too short": ({f"{PRIMARY}.minimum_jerk.to": [1.0]}, [f"{PRIMARY}:", "1 value"]),
    "constant too long": ({"reference.vertical": {"hold": {"value": [1, 2]}}},
        ["reference.vertical:", "2 values for 1"]),
    "goal and step": ({f"{PRIMARY}.minimum_jerk.by": [1, 1]},
        [f"{PRIMARY}.minimum_jerk: expected one of 'to' and 'by'"]),
    "frequencies too many": ({PRIMARY: {"harmonic": {"amplitude": [1, 1], "frequency": [1, 2, 3]}}},
        [PRIMARY, "frequency"]),
    "unknown controller": ({"controller.type": "redundency"}, ["controller.type: expected 'inverse_dynamics', 'j"]),
    "gain in words": ({"controller.k": "high"}, ["controller.k: expected", "number", "'high'"]),
    "too few velocity gains": ({"controller.k": [1, 2]}, ["controller.k"]),
    "too many primary gains": ({"controller.k21": [1, 2, 3]}, ["controller.k21"]),
    "bandwidth of the paper": ({"controller": {"type": "redundancy", "preset": "paper", "bandwidth": 5}},
        ["controller.bandwidth", "'scaled'"]),
    "no simulation": ({"simulation": None}, ["simulation: is missing"]),
    "negative duration": ({"simulation.duration": -1}, ["simulation.duration: expected greater than 0", "-1"]),
    "plot of an unknown output": ({"plots.figure_4a.outputs": ["tipx"]}, ["plots.figure_4a.outputs", "mean 'tip_x'?"]),
    "plot outside of the folder": ({"plots": {"../stray": {"outputs": ["tip_x"]}}}, ["plots", "../stray"]),
    "unknown frame in view": ({"view.trail": ["tpi"]}, ["frame 'tpi'", "did you mean 'tip'?"]),
    "comparison of an unknown key": ({"comparisons": {"other": {"controller.typ": "x"}}},
        ["comparisons.other", "controller: 'typ'", "mean 'type'?"]),
    "range of one value": ({"sweep": {"initial.q.joint_1": [1]}}, ["sweep.initial.q.joint_1", "[1]"]),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "words"), BROKEN.values(), ids=BROKEN)
def test_a_mistake_is_named_in_one_line(changes, words, tmp_path):
    message = refusal(lambda: plan_of(changes, tmp_path))
    assert all(word in message for word in words), message


TEXTS = {
    "empty": ("", ["expected a mapping", "the file is empty"]),
    "list": ("- robot\n- task\n", ["expected a mapping", "['robot', 'task']"]),
    "bracket left open": ("seed: 1\nrobot: {urdf: a\ntask: b\n", ["line 3"]),
    "tab": ("robot:\n\turdf: a\n", ["line 2", "'\\t'"]),
    "key twice": ("seed: 1\nrobot: {}\nseed: 2\n", ["line 3", "duplicate key 'seed'"]),
    "contains itself": ("robot: &robot\n  urdf: *robot\n", ["line 1", "recursive"]),
    "unknown alias": ("robot: *nobody\n", ["line 1", "'nobody'"]),
    "Python object": ("robot: !!python/object/apply:os.getcwd []\n", ["line 1", "tag"]),
    "two documents": ("seed: 1\n---\nseed: 2\n", ["line 2", "document"]),
    "no such day": ("title: 2020-13-45\n", ["not YAML"]),
    "zero byte": ("title: \0\n", ["not YAML"]),
}


@pytest.mark.parametrize(("text", "words"), TEXTS.values(), ids=TEXTS)
def test_a_file_that_is_no_mapping_is_refused_with_its_line(text, words, tmp_path):
    message = refusal(lambda: Scenario.load(str(write(tmp_path / "mine.yaml", text))).build())
    assert all(word in message for word in ["mine.yaml", *words]), message


@pytest.mark.parametrize(("name", "words"), [
    ("space-robt", "did you mean 'space-robot'?"),
    ("nowhere/mine.yaml", "'nowhere/mine.yaml'"),
    ("space-robot.yaml", "no scenario file 'space-robot.yaml'; did you mean 'space-robot'?"),
    ("no\0where/mine.yaml", "no scenario file"),
    ("", "neither built in nor a file"),
    ("/", "neither built in nor a file"),
])  # fmt: skip
def test_a_scenario_that_is_not_there_is_refused(name, words):
    assert words in refusal(lambda: find_scenario(name))


def test_a_sweep_of_nothing_is_refused():
    assert "sweep: is missing" in refusal(lambda: draws_of("space-robot", {"sweep": {}}))
    words = refusal(lambda: draws_of("space-robot", {"sweep": {"initial.q.joint_2": [2.0, 1.0]}}))
    assert "sweep.initial.q.joint_2: minimum 2 is greater than maximum 1" in words


def presets_and_variants(folder, **more):
    raw = with_options(read_yaml(find_scenario("space-robot")), {"comparisons": {}, "plots": {}})
    raw["presets"] = {"paper": {"simulation.dt": 0.004, "simulation.duration": 3.0}}
    raw["variants"] = {"slow": {"controller.preset": "paper"}, "other": {}}
    return str(write(folder / "mine.yaml", yaml.safe_dump({**raw, **more})))


def test_a_preset_brings_what_goes_with_it_a_variant_its_preset_and_options_count_more(tmp_path):
    path = presets_and_variants(tmp_path)
    usual = Scenario.load(path).build()
    assert (usual.duration, usual.dt) == (read_yaml(find_scenario("space-robot"))["simulation"]["duration"], 0.002)
    for options in ({"controller.preset": "paper"}, {"variant": "slow"}):
        slow = Scenario.load(path, options).build()
        assert (slow.duration, slow.dt) == (3.0, 0.004)
        assert not {"variant", "presets"} & slow.raw.keys()  # a record says what was run, and runs again as it was
        shorter = Scenario.load(path, {**options, "simulation.duration": 2.0}).build()
        assert shorter.duration == 2.0
    assert Scenario.load(str(write(tmp_path / "again.yaml", yaml.safe_dump(shorter.raw)))).build().duration == 2.0
    assert Scenario.load(presets_and_variants(tmp_path, variant="slow")).build().duration == 3.0
    unknown = "no variant 'slwo'; did you mean 'slow'"
    wrongs = {"comparisons": ["slwo"]}, {"variant": "slwo"}, {"presets": {"papr": {}}}
    for wrong, words in zip(wrongs, (unknown, unknown, r"presets\.papr"), strict=True):
        with pytest.raises(rnc.ConfigurationError, match=words):
            Scenario.load(presets_and_variants(tmp_path, **wrong)).build()
