"""What holds of all classes of the core: descriptions cannot be changed, and what is left open is named."""

import importlib
import inspect
import pkgutil
from dataclasses import is_dataclass

import pytest

import rnc_pin as rnc
from rnc_pin.model.kinematics import PositionKinematics, RateKinematics, VelocityKinematics
from rnc_pin.model.rows import OutputRows, Rows
from rnc_pin.outputs.direction_angle import DirectionAngleRow

PACKAGES = ("model", "constraints", "outputs", "control", "planning", "analysis")
PLACES = {"jacobian", "joint_placement", "with_velocity", "placement", "rotation"}
MOTIONS = PLACES | {"acceleration", "joint_velocity", "rates", "velocity"}


def classes():
    for package in PACKAGES:
        whole = importlib.import_module(f"rnc_pin.{package}")
        for found in pkgutil.walk_packages(whole.__path__, f"{whole.__name__}."):
            module = importlib.import_module(found.name)
            yield from (
                each for _, each in inspect.getmembers(module, inspect.isclass) if each.__module__ == found.name
            )


def test_descriptions_cannot_be_changed():
    """Whoever holds one may keep it, and compare it: a system stays what it was made of."""
    described = [each for each in classes() if inspect.isclass(each) and is_dataclass(each)]
    assert len(described) > 40
    assert [each.__name__ for each in described if not each.__dataclass_params__.frozen] == []
    for kind in (rnc.FrameSpeed("base"), rnc.RollingWheel("wheel", 0.1), rnc.Caster("nose", 0.1)):
        with pytest.raises(AttributeError):
            kind.frame = "other"


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (Rows, {"bias_acceleration", "jacobian", "jacobian_dot"}),
        (OutputRows, {"bias_acceleration", "jacobian", "jacobian_dot"}),
        (DirectionAngleRow, {"_check_defined", "_form", "_form_rate", "_second"}),
        (PositionKinematics, PLACES),
        (VelocityKinematics, MOTIONS),
        (RateKinematics, MOTIONS | {"jacobian_dot"}),
    ],
)
def test_what_a_kind_leaves_open_has_to_be_written(kind, names):
    assert set(kind.__abstractmethods__) == names
