"""Former names work for one version, and say what replaces them."""

import numpy as np
import pytest
from pydantic import ValidationError

import rnc_pin as rnc
from rnc_pin.loop import LoopState
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.output_gradients import kinematic_gradient, log_determinant_gradient
from rnc_pin.model.rows import Rows
from rnc_pin.scenario.execution import plan
from rnc_pin.scenario.files import read_yaml
from rnc_pin.scenario.loading import validate
from rnc_pin.scenario.schema.plant_settings import LoopSettings
from systems import random_states, space_robot


def test_former_names_warn_and_work():
    reduced = space_robot()
    (q, v2), *_ = random_states(reduced, 1)
    state = reduced.at(q, v2)
    with pytest.warns(DeprecationWarning, match="use 'reduction_data'"):
        assert reduced.parts is reduced.reduction_data
    with pytest.warns(DeprecationWarning, match="use 'with_basis_at'"):
        assert reduced.settled_at(q).r == reduced.r
    with pytest.warns(DeprecationWarning, match="use 'with_velocity'"):
        np.testing.assert_array_equal(state.moving(np.zeros(4)).v, 0.0)
    with pytest.warns(DeprecationWarning, match="use 'in_reduction'"):
        np.testing.assert_array_equal(state.as_seen_by(reduced.reduction_data).v, state.v)


def test_former_methods_of_a_reduced_model():
    reduced = space_robot()
    (q, v2), *_ = random_states(reduced, 1)
    state, T = reduced.at(q, v2), np.ones(3)
    former = {
        "flow": ((q, v2, T), state.flow(T)),
        "contact_forces": ((q, v2, T), state.contact_forces(T)),
        "inertia": ((q,), state.H),
        "input_matrix": ((q,), state.input_matrix),
        "drive_jacobian": ((q,), state.J2 @ state.B),
        "basis_rate": ((q, state.v), (state.R, state.R_dot)),
        "kinematic_gradient": ((q, [1]), kinematic_gradient(reduced.at(q), [1])),
        "log_determinant_gradient": ((q, [1]), log_determinant_gradient(reduced.at(q), [1])),
        "measure": ((q, v2), state.measure()),
        "measured": ((q, state.v), reduced.at(q, v=state.v).measure()),
        "outputs": ((q,), state.outputs()),
        "velocity": ((q, v2), state.v),
        "constraint_residual": ((q, state.v), reduced.at(q, v=state.v).residual),
        "condition": ((q,), state.condition),
        "smallest_singular_value": ((q,), state.smallest_singular_value),
        "stacked_rows": ((q,), state.E),
        "position_residual": ((q,), reduced.assembly.residual(q)),
    }
    for name, (arguments, expected) in former.items():
        with pytest.warns(DeprecationWarning, match=rf"ReducedModel\.{name}: renamed, use") as warned:
            found = getattr(reduced, name)(*arguments)
        assert warned[0].filename == __file__
        for one, other in zip(found, expected, strict=True) if isinstance(expected, tuple) else [(found, expected)]:
            if other is not None:
                np.testing.assert_array_equal(one, other, err_msg=name)


def test_former_options_of_a_loop():
    reduced = space_robot()
    controller = rnc.control.VelocityTracker(
        rnc.control.ReducingOutputController(reduced, rnc.planning.Hold(np.zeros(reduced.r)))
    )
    with pytest.warns(DeprecationWarning, match="ControlLoop: on_trouble: renamed, use 'fallback'") as warned:
        loop = rnc.ControlLoop(reduced, controller, 0.01, on_trouble="zero")
    assert warned[0].filename == __file__
    assert np.array_equal(loop.step(0.0, [np.nan], np.zeros(4)), np.zeros(reduced.p))
    with pytest.warns(DeprecationWarning, match="use 'fault'"):
        assert loop.state.trouble == loop.state.fault
    with pytest.raises(TypeError, match="'patience' is the former name of 'timeout', and both are given"):
        rnc.ControlLoop(reduced, controller, 0.01, patience=1.0, timeout=1.0)
    with pytest.warns(DeprecationWarning, match="loop: fastest: renamed, use 'max_speed'") as warned:
        run = rnc.simulate(
            reduced,
            controller,
            reduced.robot.configuration({"joint_1": 0.4, "joint_2": 0.7}),
            0.02,
            0.01,
            options=rnc.SimulationOptions(loop={"fastest": 1e9}),
        )
    assert warned[0].filename == __file__
    assert run.outcome is rnc.Outcome.COMPLETED


def test_former_scenario_keys():
    with pytest.warns(DeprecationWarning, match="LoopSettings: on_trouble: renamed, use 'fallback'"):
        settings = LoopSettings.model_validate({"on_trouble": "brake", "timeout": 0.1})
    assert (settings.fallback, settings.timeout) == ("brake", 0.1)
    with pytest.raises(ValidationError, match="'margin' is the former name of 'min_singular_value'"):
        LoopSettings.model_validate({"margin": 0.1, "min_singular_value": 0.1})


def test_named_tuples_take_former_names_of_their_fields():
    force, inputs = np.array([1.0]), np.array([2.0, 0.0])
    with pytest.warns(DeprecationWarning, match="Measurement: excess: renamed, use 'force_deficit'"):
        measurement = Measurement(excess=force)
    with pytest.warns(DeprecationWarning, match="use 'input_deficit'"):
        measurement = measurement._replace(missing=inputs)
    assert measurement.force_deficit is force
    assert measurement.input_deficit is inputs
    with pytest.warns(DeprecationWarning, match="use 'force_deficit'"):
        assert measurement.excess is force
    with pytest.warns(DeprecationWarning, match="LoopState: missing: renamed"):
        state = LoopState(missing=inputs)
    with pytest.warns(DeprecationWarning, match="use 'input_deficit'"):
        assert state.missing is state.input_deficit is inputs


def test_former_keywords_of_controllers():
    reduced = space_robot()
    target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold(np.zeros(reduced.r)))
    force = np.ones(reduced.r)
    with pytest.warns(DeprecationWarning, match="VelocityTracker: held: renamed, use 'gravity_compensation'"):
        tracker = rnc.control.VelocityTracker(target, held=force)
    with pytest.warns(DeprecationWarning, match="use 'gravity_compensation'"):
        assert tracker.held is tracker.gravity_compensation
    with pytest.warns(DeprecationWarning, match="use 'monitored'"):
        rnc.control.ReducingOutputController(reduced, rnc.planning.Hold(np.zeros(reduced.r)), watched=None)
    with pytest.warns(DeprecationWarning, match="ChainedStabilizer: fastest: renamed, use 'max_input'"):
        assert rnc.control.ChainedStabilizer(3, fastest=2.0).max_input == 2.0
    with pytest.warns(DeprecationWarning, match="use '(tolerance|ramp_time|max_speed)'") as warned:
        stabilizer = rnc.control.UnicycleStabilizer(np.zeros(3), np.arange(2), close=0.1, soft=0.5, fastest=(0.3, 0.4))
    assert len(warned) == 3
    assert (stabilizer.tolerance, stabilizer.ramp_time, stabilizer.max_speed) == (0.1, 0.5, (0.3, 0.4))


def test_former_key_of_a_controller():
    with pytest.warns(DeprecationWarning, match="held: renamed, use 'gravity_compensation'"):
        settings = plan("space-robot", {"comparisons": {}, "controller.held": True}).experiment.scenario.controller
    assert settings.gravity_compensation is True


def test_rows_with_former_names_are_rows():
    with pytest.warns(DeprecationWarning, match=r"Fixed\.drift: renamed, use 'bias_acceleration'"):

        class Fixed(Rows):
            names, units = ("fixed",), ("rad/s",)

            def jacobian(self, at):
                return np.eye(4)[:1]

            def jacobian_dot(self, at):
                return np.zeros((1, 4))

            def drift(self, at):
                return np.zeros(1)

    class Kind:
        def bind(self, robot):
            return Fixed()

    robot = rnc.Robot.from_urdf("space_robot.urdf")
    reduced = rnc.NonholonomicSystem(robot, [Kind()], robot.joint_names[1:]).reduce()
    assert reduced.forward_dynamics(robot.configuration(), np.ones(3), np.zeros(3)).shape == (3,)


def test_former_arguments_of_simulate():
    reduced = space_robot()
    q0 = reduced.robot.configuration({"joint_1": 0.4, "joint_2": 0.7})
    target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold(np.zeros(reduced.r)))
    controller = rnc.control.ComputedTorque(reduced, target)
    options = rnc.SimulationOptions(meta={"seed": 3}, stop=rnc.Stop(speed=50.0))
    plant = rnc.ReducedPlant(reduced, actuator_limits=True, substeps=2)
    run = rnc.simulate(reduced, controller, q0, 0.02, 0.01, plant=plant, options=options)
    with pytest.warns(DeprecationWarning, match="renamed, use") as warned:
        former = rnc.simulate(
            reduced, controller, q0, 0.02, 0.01, substeps=2, plant=rnc.Plant(actuator_limits=True),
            meta={"seed": 3}, stop=rnc.Stop(speed=50.0),
        )  # fmt: skip
    assert [str(each.message).split(": renamed")[0] for each in warned] == [
        "rnc_pin.Plant", "simulate(stop=...)", "simulate(meta=...)", "simulate(substeps=...)",
    ]  # fmt: skip
    assert {each.filename for each in warned} == {__file__}
    np.testing.assert_array_equal(former.q, run.q)
    assert former.info.provenance == run.info.provenance
    faulty = rnc.plants.FaultyPlant(plant, rnc.Faults(), reduced, 0.01)
    with pytest.warns(DeprecationWarning, match=r"simulate\(machine=...\): renamed, use 'plant=...'"):
        former = rnc.simulate(reduced, controller, q0, 0.02, 0.01, machine=faulty, loop=None)
    np.testing.assert_array_equal(former.q, run.q)
    with pytest.warns(DeprecationWarning, match="use 'rnc_pin.ReducedPlant"):
        damped = rnc.free_motion(reduced, q0, np.ones(reduced.r), 0.1, 0.1, plant=rnc.Plant(joint_damping=True))
    plant = rnc.ReducedPlant(reduced, joint_damping=True)
    present = rnc.free_motion(reduced, q0, np.ones(reduced.r), 0.1, 0.1, plant=plant)
    np.testing.assert_array_equal(damped.q, present.q)


def test_former_names_of_plants():
    with pytest.warns(DeprecationWarning, match="Machine: renamed, use 'Plant'"):
        assert rnc.plants.Machine is rnc.plants.Plant
    with pytest.warns(DeprecationWarning, match="FaultyMachine: renamed, use 'FaultyPlant'"):
        kind = rnc.plants.FaultyMachine
    reduced = space_robot()
    faulty = kind(rnc.ReducedPlant(reduced), rnc.Faults(), reduced, 0.01)
    with pytest.warns(DeprecationWarning, match="use 'plant'"):
        assert faulty.machine is faulty.plant
    with pytest.warns(DeprecationWarning, match="use 'rnc_pin.ReducedPlant"):
        assert rnc.simulation.Plant(joint_damping=True).joint_damping
    with pytest.raises(AttributeError, match="no attribute 'Machinery'"):
        _ = rnc.plants.Machinery


def test_frame_spin_keeps_the_names_of_its_outputs(tmp_path):
    """A task that names them is still valid, in Python and in a scenario file."""
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
    with pytest.warns(DeprecationWarning, match="FrameSpin .*: renamed, use 'FrameAngularVelocity"):
        output = rnc.FrameSpin("ball", "x")
    assert output.bind(robot).names == ("ball_spin_x",)
    file = tmp_path / "ball.yaml"
    outputs = "reducing: [{frame_spin: {frame: ball, axis: x}}]"
    file.write_text(f"robot: {{urdf: rolling_ball.urdf}}\nactuators: []\noutputs: {{{outputs}}}\n")
    with pytest.warns(DeprecationWarning, match="frame_angular_velocity"):
        scenario = validate(read_yaml(file), "ball")
    assert scenario.outputs.reducing[0].bind(robot).names == ("ball_spin_x",)


def test_former_names_of_a_friction_demand():
    with pytest.warns(DeprecationWarning, match="GripNeeded: renamed, use 'FrictionDemand'"):
        demand = rnc.simulation.GripNeeded(2.0, "wheel", 0.1, 1.5)
    with pytest.warns(DeprecationWarning, match="use 'time_scale'"):
        assert demand.slower == demand.time_scale == 1.5
