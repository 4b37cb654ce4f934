"""Unknown wheel radii and tracks, (14)-(21) for rolling rows, in models, controllers and scenarios."""

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from rnc_pin.applications.scenario.files import find_scenario, read_yaml, with_options
from rnc_pin.applications.scenario.scenario import Scenario


def wheels_of(unknown, folder):
    changes = {"controller.unknown": unknown, "comparisons": {}, "plots": {}, "simulation.duration": 1.0}
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(with_options(read_yaml(find_scenario("wheels-uncertain")), changes)))
    return Scenario.load(str(path)).experiment


def test_a_scenario_names_what_is_unknown(tmp_path):
    unknown = {
        "radii": [{"wheels": ["left_wheel"], "initial": 0.12}, {"wheels": ["right_wheel"], "initial": 0.09}],
        "tracks": [{"wheels": ["left_wheel", "right_wheel"], "initial": 0.3}],
    }
    experiment = wheels_of(unknown, tmp_path)
    np.testing.assert_array_equal(experiment.controller.estimator.initial, [0.12, 0.09, 0.3])
    record = experiment.provenance.to_json()
    names = ("radius of left_wheel", "radius of right_wheel", "track of left_wheel, right_wheel")
    assert record["estimates"] == dict.fromkeys(names, "m")
    assert record["predicted"] == {"rolling(left_wheel)": "m/s", "rolling(right_wheel)": "m/s"}


@pytest.mark.parametrize(("unknown", "words"), [
    ({}, "controller.unknown.base: is missing"),
    ({"radii": []}, "controller.unknown: name at least one radius or track"),
    ({"radii": [{"wheels": ["left_wheel"]}]}, r"controller.unknown.radii\[0\].initial: is missing"),
    ({"radii": [{"wheels": ["left_weel"], "initial": 0.1}]}, "controller.unknown: .*did you mean 'left_wheel'"),
    ({"tracks": [{"wheels": ["left_wheel"], "initial": 0.1}]}, "unknown track: expected two wheels"),
    ({"radii": [{"wheels": ["left_wheel"], "initial": 9}]}, "radius of left_wheel, 9, has to be within its bounds"),
    ({"radii": [{"wheels": ["left_wheel"], "initial": 9}], "base": "x"}, "controller.unknown: 'base' is not known"),
])  # fmt: skip
def test_a_scenario_with_unknown_nonsense_is_refused(unknown, words, tmp_path):
    with pytest.raises(rnc.ConfigurationError, match=words):
        wheels_of(unknown, tmp_path)
