"""Entries of scenario files are derived from dataclasses: what those have, files have, and it is described."""

import dataclasses
import inspect
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import pytest
from annotated_types import Gt, Len
from pydantic import TypeAdapter, ValidationError

import rnc_pin as rnc
from rnc_pin.applications.scenario.controllers import feedback, whole_body
from rnc_pin.applications.scenario.files import find_scenario, read_yaml, with_options
from rnc_pin.applications.scenario.schema import motions, run_settings, scenario, world
from rnc_pin.applications.scenario.schema.derived import ClassReader, one_of
from rnc_pin.applications.scenario.schema.kinds import ConstraintItem
from rnc_pin.applications.scenario.schema.scenario import schema, validate
from rnc_pin.collision import Obstacle
from rnc_pin.control.loop import LoopSettings
from rnc_pin.lab.mujoco import MuJoCoSettings
from rnc_pin.motion import optimal
from rnc_pin.motion.planning import CarPath
from rnc_pin.motion.whole_body import InverseDynamicsQP, VelocityQP, tasks
from rnc_pin.motion.whole_body.limits import CollisionAvoidance
from rnc_pin.plants import ContactPlant, Faults, ReducedPlant
from rnc_pin.visualization.drawn_state import View

KINDS = [getattr(package, name) for package in (rnc.constraints, rnc.outputs) for name in package.__all__]
KINDS = [kind for kind in KINDS if dataclasses.is_dataclass(kind)]
TAKE_FUNCTIONS = {rnc.Pfaffian, rnc.Output}  # which no file can say
KINDS = [kind for kind in KINDS if kind not in TAKE_FUNCTIONS] + [rnc.FrameForce, rnc.FrameTorque]
PARTS = schema()["$defs"]


def said_default(value):
    """A default as JSON has it: null for what is infinite, lists for tuples."""
    if isinstance(value, float) and np.isinf(value):
        return None
    return list(value) if isinstance(value, tuple) else value


def check_fields(kind, part):
    assert list(part["properties"]) == [each.name for each in dataclasses.fields(kind)]
    for each, (name, field) in zip(dataclasses.fields(kind), part["properties"].items(), strict=True):
        assert field["description"], name
        optional = each.default is not dataclasses.MISSING
        assert (name in part.get("required", [])) is not optional
        if optional:
            assert field["default"] == said_default(each.default)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_every_dataclass_that_files_know_has_an_entry_with_its_fields(kind):
    entry = PARTS[f"{kind.__name__}Entry"]
    assert entry["description"] == " ".join(kind.__doc__.split("\n\n")[0].split())
    (value,) = entry["properties"].values()
    assert f"#/$defs/{kind.__name__}" in str(value)
    check_fields(kind, PARTS[kind.__name__])


def test_the_view_is_declared_once():
    check_fields(View, PARTS["View"])
    raw = with_options(read_yaml(find_scenario("space-robot")), {"view": {"camera": [1, 2, 3], "ground": None}})
    assert validate(raw, "mine.yaml").view == View(camera=[1.0, 2.0, 3.0], ground=None)


def test_a_default_of_a_file_is_that_of_its_class():
    elsewhere = {"bounds", "limits", "fallback", "form", "name"}  # in another form, or with a default of its own
    for settings, kind in [
        (scenario.PlantSettings, MuJoCoSettings), (scenario.FaultSettings, Faults),
        (scenario.ControlLoopSettings, LoopSettings), (run_settings.SimulationSettings, ReducedPlant),
        (run_settings.SimulationSettings, ContactPlant), (world.BoxObstacle, Obstacle),
        (motions.OutputCostSettings, optimal.OutputCost), (motions.OptimalPlanner, optimal.SolverSettings),
        (motions.VehiclePath, CarPath), (feedback.WayFollowerSettings, optimal.WayFollower),
        (feedback.PredictiveSettings, optimal.UpdateSchedule), (feedback.PredictiveSettings, optimal.SetPointCost),
        (feedback.SetPointSettings, optimal.SetPointController), (feedback.PlanFeedbackSettings, optimal.PlanFeedback),
        (whole_body.OutputTaskSettings, tasks.OutputTask), (whole_body.BasePoseSettings, tasks.BasePoseTask),
        (whole_body.CenterOfMassSettings, tasks.CenterOfMassTask), (whole_body.VelocityProgramSettings, VelocityQP),
        (whole_body.CollisionSettings, CollisionAvoidance), (whole_body.InverseDynamicsSettings, InverseDynamicsQP),
    ]:  # fmt: skip
        in_files, given = settings.model_json_schema()["properties"], inspect.signature(kind).parameters
        stated = {name: each.default for name, each in given.items() if each.default is not each.empty}
        shared = in_files.keys() & stated.keys() - elsewhere
        assert {in_files[name].get("default", name) == said_default(stated[name]) for name in shared} == {True}, kind


@dataclass(frozen=True)
class Spring:
    """A spring between two frames.

    It was not there when entries were written.

    Args:
        frame_a, frame_b: where it is
            fixed.
        stiffness: of the spring [N/m].
        kind: what it is made of.
        ends: where it stops [m]; None for nowhere.
        limit: largest force [N].

    Example:
        >>> Spring("a", "b", 2.0)
    """

    frame_a: str
    frame_b: str
    stiffness: Annotated[float, Gt(0)]
    kind: Literal["steel", "rubber"] = "steel"
    ends: Annotated[Sequence[float], Len(2, 2)] | np.ndarray | None = None
    limit: float = np.inf

    def __post_init__(self):
        if self.frame_a == self.frame_b:
            raise rnc.ConfigurationError(f"spring from '{self.frame_a}' to itself")


ITEM = TypeAdapter(Annotated[object, one_of(True, spring=Spring)])
SPRING = {"frame_a": "a", "frame_b": "b", "stiffness": 2}


def test_a_new_dataclass_takes_one_line():
    assert ITEM.validate_python({"spring": SPRING}) == Spring("a", "b", 2.0)
    assert ITEM.validate_python("a name") == "a name"
    told = {**SPRING, "kind": "rubber", "ends": [0, 1], "limit": 3}
    assert ITEM.validate_python({"spring": told}) == Spring("a", "b", 2.0, "rubber", [0.0, 1.0], 3.0)
    assert ITEM.validate_python({"spring": {**SPRING, "limit": None}}).limit == np.inf
    part = ITEM.json_schema()["$defs"]["Spring"]
    assert part["description"] == "A spring between two frames."
    check_fields(Spring, part)
    texts = {name: field["description"] for name, field in part["properties"].items()}
    assert (texts["frame_b"], texts["ends"]) == ("Where it is fixed.", "Where it stops [m]; null for nowhere.")


def test_an_entry_tells_what_a_file_says_otherwise():
    momentum = TypeAdapter(Annotated[object, ClassReader(rnc.MomentumConservation, short="joint")])
    assert momentum.validate_python("platform") == momentum.validate_python({"joint": "platform"})
    with pytest.raises(ValidationError, match="expected a joint's name or a mapping with joint and momentum, found 3"):
        momentum.validate_python(3)


def test_a_rolling_body_is_written_with_its_shape_and_ground():
    reader = TypeAdapter(ConstraintItem)
    said = {"frame": "egg", "shape": {"ellipsoid": {"semi_axes": [0.2, 0.2, 0.3]}}, "ground": {"plane": {"spin": 2}}}
    expected = rnc.RollingBody("egg", rnc.Ellipsoid([0.2, 0.2, 0.3]), ground=rnc.GroundPlane(spin=2.0))
    assert reader.validate_python({"rolling_body": said}) == expected
    with pytest.raises(ValidationError, match="normal of the ground has no length"):
        reader.validate_python({"rolling_body": {**said, "ground": {"plane": {"normal": [0, 0, 0]}}}})
