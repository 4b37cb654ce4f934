"""Changed URDFs are still the same robot, and their drafts keep the kind of base."""

from collections import Counter

import numpy as np
import pinocchio as pin
import pytest

import perturbed_urdf as perturbed
from benchmarks import perturbations
from rnc_pin.robots.robot_files import shipped_directory

pytestmark = pytest.mark.filterwarnings("ignore::rnc_pin.ModelWarning")


@pytest.mark.parametrize("name", ["noise", "names", "order", "mirrored"])
def test_a_changed_robot_turns_as_heavily(name):
    """Eigenvalues of the mass matrix of the revolute joints of an arm."""
    urdf = (shipped_directory() / "space_robot.urdf").read_text()
    models = [pin.buildModelFromXML(each) for each in (urdf, perturbed.PERTURBATIONS[name](urdf, 1))]
    M, changed = (pin.crba(model, model.createData(), pin.neutral(model)) for model in models)
    found = np.linalg.eigvalsh(changed)
    np.testing.assert_allclose(found, np.linalg.eigvalsh(M), rtol=2e-2 if name == "noise" else 1e-9)
    assert urdf != perturbed.PERTURBATIONS[name](urdf, 1) != perturbed.PERTURBATIONS["noise"](urdf, 2)


def test_trials_of_a_robot(brief):
    found = list(perturbations.trials("dirt/wide_wheels", draws=2))
    expected = {name: 1 + (name in perturbed.DRAWN) for name in perturbed.PERTURBATIONS if name != "no drives"}
    assert Counter(each.perturbation for each in found) == expected
    assert {each.after for each in found} == {"planar skid-steered, 4 wheels, 4 inputs"}
    assert perturbations.share(found) == 1


@pytest.mark.long  # a quarter of an hour
def test_drafts_keep_the_kind_of_base():
    found = [trial for name in perturbations.sources() for trial in perturbations.trials(name)]
    assert perturbations.share(found) >= 0.99, [str(trial) for trial in found if not trial.kept]
