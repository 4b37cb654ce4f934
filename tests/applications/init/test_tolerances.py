"""Drafts of files whose numbers are rounded, or noisy by a millionth: they are those of the exact files."""

import re

import numpy as np
import pytest
import yaml

from noisy import with_noise
from places import DIRT
from rnc_pin.applications.init import DraftOptions, draft, scenario_candidate
from rnc_pin.applications.init.trial import Trial
from rnc_pin.applications.scenario.builder import build_experiment
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.errors import ModelError
from rnc_pin.robots.robot_files import example_urdfs, find_urdf, shipped_directory
from urdf_parts import write

SHIPPED = sorted({path.name for path in shipped_directory().glob("*.urdf")})
SOME = ("double_pendulum", "iris")
ZOO = [pytest.param(name, marks=pytest.mark.long) for name in sorted({*example_urdfs()} - {*SOME})]
pytestmark = pytest.mark.filterwarnings("ignore::rnc_pin.ModelWarning")


@pytest.fixture(autouse=True)
def built_only(monkeypatch):
    """Drafts are built with their preflight here, and not run."""

    def build(self, chosen, settings, share):
        content = self._scenario(chosen, settings, share)
        content["simulation"]["duration"] = 0.1  # so that the roll-out is short
        build_experiment(validate(content, "draft"), self.source.folder)
        return Trial(0.0)

    monkeypatch.setattr(scenario_candidate.ScenarioCandidate, "_try_out", build)


def drafted(path, original, folder, base=None):
    """(what the base was taken for, the scenario), or of a file that is refused the kind of error."""
    folders = (original.parent, *original.parents[1:4])
    try:
        text = draft(str(path), folder, DraftOptions(base=base, package_dirs=folders))
    except ModelError as error:
        return type(error).__name__, {}
    kind = next(line for line in text.splitlines() if line.startswith("# base"))
    return re.sub(r"\d+ %", "", kind), yaml.safe_load(text)


def leaves(content, place=""):
    """Every value of a scenario, by where it stands."""
    if isinstance(content, dict):
        pairs = content.items()
    elif isinstance(content, list):
        pairs = enumerate(content)
    else:
        return {place: content}
    return {key: leaf for name, each in pairs for key, leaf in leaves(each, f"{place}.{name}").items()}


def assert_same_with_noise(path, folder, base=None):
    noisy = folder / path.name
    text = path.read_text(encoding="utf-8", errors="surrogateescape")
    noisy.write_text(with_noise(text, seed=0), encoding="utf-8", errors="surrogateescape")
    (kind, exact), (other, found) = drafted(path, path, folder, base), drafted(noisy, path, folder, base)
    assert other == kind
    exact.pop("robot", None), found.pop("robot", None)

    def near(leaf):
        return pytest.approx(leaf, rel=1e-3, abs=1e-3) if isinstance(leaf, float) else leaf

    assert leaves(found) == {key: near(leaf) for key, leaf in leaves(exact).items()}


@pytest.mark.parametrize("name", [*SHIPPED, *sorted(path.name for path in DIRT.glob("*.urdf")), *SOME, *ZOO])
def test_noise_changes_no_draft(name, tmp_path):
    strange = DIRT / name
    path = strange if strange.exists() else example_urdfs().get(name) or find_urdf(name, tmp_path)
    assert_same_with_noise(path, tmp_path)


FORK = (DIRT / "raked_fork.urdf").read_text()


def leaning(folder, text):
    return write(folder / "fork.urdf", text)


@pytest.mark.parametrize(("turned", "of"), [
    ("1.5708 0 0", "frame"), ("1.570796326 0 0", "rear_hub_link"),
    ("1.57 0 0", "fork"), ("0 0 1.5708", "front_hub_link"),
])  # fmt: skip
def test_the_frame_of_an_inertia_may_be_rounded(turned, of, tmp_path):
    path = leaning(tmp_path, re.sub(f'(<link name="{of}"><inertial><origin )', rf'\1rpy="{turned}" ', FORK))
    assert drafted(path, path, tmp_path)[0] == "# base free: 2 wheels in line: a bicycle, which leans"


@pytest.mark.parametrize(("base", "kind", "higher"), [
    (None, "free: 2 wheels in line: a bicycle, which leans", -8e-6),
    (None, "free: 2 wheels in line: a bicycle, which leans", 1e-4),
    ("planar", "planar: 2 wheels, steered like a car", 8e-6),
])  # fmt: skip
def test_a_wheel_may_be_off_the_ground_by_rounding(base, kind, higher, tmp_path):
    lean = 0.314159265
    below = (0.03 * np.sin(lean) + 0.75 - 0.3 - higher) / np.cos(lean)
    path = leaning(tmp_path, FORK.replace("-0.4737", f"{-below:.9f}"))
    found, content = drafted(path, path, tmp_path, base)
    assert found == f"# base {kind}"
    if base == "planar":  # a fork that leans would lift the base, which a planar one cannot do
        front = content["constraints"][1]["rolling_wheel"]
        assert front == {"frame": "front_hub_link", "radius": 0.3, "vertical": False}
