"""Runs for other programs: the files say with names and units what the run has, to the last digit."""

import csv
from dataclasses import replace

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario


@pytest.fixture(scope="module")
def run():
    """Fire truck: a planar base, continuous joints, quasi-velocities, forces and torques, bodies on the ground."""
    options = {"simulation.duration": 0.2, "simulation.dt": 0.02, "comparisons": {}}
    return execute(Scenario.load("fire-truck", options)).trajectory


def test_a_table_has_a_name_and_a_unit_for_each_column(run, tmp_path):
    run.export(tmp_path / "run.csv")
    with open(tmp_path / "run.csv", newline="") as file:
        header, *rows = csv.reader(file)
    values = np.array(rows, dtype=float)
    np.testing.assert_array_equal(values, np.column_stack([*run.arrays.values()]))
    assert len(set(header)) == len(header) == values.shape[1]
    for name, wanted in {
        "time [s]": run.time,
        "q.root_joint[cos] [-]": run.q[:, 2],
        "v.root_joint[2] [rad/s]": run.v[:, 2],
        "x1.tractor_x [m]": run.x1[:, 0],
        "v2.tractor_speed_x [m/s]": run.v2[:, 0],
        "x2.tractor_speed_x [m]": run.x2[:, 0],
        "F.front_steering [N m]": run.F[:, 1],
        "T.force(tractor.x) [N]": run.T[:, 0],
        "multipliers.no_side_slip(rear_axle.y) [N]": run.multipliers[:, 2],
        "slip.no_side_slip(rear_axle.y) [m/s]": run.slip[:, 2],
        "energy [J]": run.energy,
        "ground_poses.trailer.heading [rad]": run.ground_poses[:, 5],
    }.items():
        np.testing.assert_array_equal(values[:, header.index(name)], wanted, err_msg=name)


def test_chosen_arrays_are_written_after_the_time(run, tmp_path):
    run.export(tmp_path / "run.csv", ["T", "energy"])
    header = (tmp_path / "run.csv").read_text().splitlines()[0]
    assert header == "time [s],T.force(tractor.x) [N],T.front_steering [N m],T.rear_steering [N m],energy [J]"
    with pytest.raises(rnc.InputError, match="arrays: the run has no 'energi'; did you mean 'energy'"):
        run.export(tmp_path / "other.csv", ["energi"])
    with pytest.raises(rnc.ConfigurationError, match=r"run.xls: expected a name that ends in .csv"):
        run.export(tmp_path / "run.xls")
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]


def test_files_keep_the_names_and_those_without_have_numbers(run, tmp_path):
    run.save(tmp_path / "run.npz")
    assert rnc.Trajectory.load(tmp_path / "run.npz").info.outputs == run.info.outputs
    unnamed = replace(run, info=replace(run.info, outputs=replace(run.info.outputs, q=rnc.simulation.Columns())))
    unnamed.export(tmp_path / "run.csv", ["q"])
    header = (tmp_path / "run.csv").read_text().splitlines()[0]
    assert header == "time [s]," + ",".join(f"q.{k}" for k in range(7))


def test_the_command_replaces_no_file_unasked(run, tmp_path, call):
    run.save(tmp_path / "trajectory.npz")
    file = tmp_path / "run.csv"
    file.write_text("mine")
    status, _, error = call("export", tmp_path, file, "--array", "T")
    assert (status, file.read_text()) == (2, "mine")
    assert "exists; choose another name or add --force" in error
    assert call("export", tmp_path, file, "--array", "T", "--force")[0] == 0
    assert file.read_text().startswith("time [s],T.force(tractor.x) [N]")
