"""Honesty of the estimated integration error of plants.

Each motion runs with one integration step in a sample, with two, and with as many as the default tolerance asks for.
Its true error is the difference to the same plant under the same inputs with a tolerance of 1e-11 per second. The
table compares the largest true error of a configuration entry [m or rad] with the stated one, for all built-in
scenarios on a reduced plant, for at most two seconds, and for drawn systems of one to six joints under constant random
inputs. Errors below 1e-11 are rounding, and not judged. An optional argument is the number of drawn systems, 200 by
default.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.simulation import IntegrationAccuracy

REFERENCE, JUDGED, FACTOR, LONGEST = 1e-11, 1e-11, 10.0, 2.0
CHOICES: dict[str, int | None] = {"1": 1, "2": 2, "default": None}


class Compared(NamedTuple):
    """True and stated error of a motion [m or rad]."""

    name: str
    choice: str
    true: float
    stated: float

    @property
    def judged(self) -> bool:
        return max(self.true, self.stated) > JUDGED

    @property
    def honest(self) -> bool:
        low, high = sorted((self.true, self.stated))
        return high <= FACTOR * low


class Motion(NamedTuple):
    """Start and inputs (N, p) of a motion."""

    q: np.ndarray
    v: np.ndarray
    T: np.ndarray
    dt: float


def moved(plant: rnc.plants.Plant, motion: Motion) -> np.ndarray:
    """Configurations (N, nq) of a plant after each sample."""
    plant.reset(motion.q, motion.v)
    found = []
    for T in motion.T:
        plant.apply(T)
        plant.advance(motion.dt)
        found.append(plant.read()[0])
    return np.array(found)


def compared(name: str, choice: str, plant: rnc.plants.Plant, motion: Motion, true: np.ndarray) -> Compared:
    robot = plant.reduced.robot  # type: ignore[attr-defined]
    q = moved(plant, motion)
    error = max(np.abs(pin.difference(robot.model, a, b)).max() for a, b in zip(q, true, strict=True))
    stated = IntegrationAccuracy.of(plant, robot.velocity_units)
    assert stated is not None
    return Compared(name, choice, float(error), max(stated.accumulated.get(unit, 0.0) for unit in ("m", "rad")))


def drawn(seed: int) -> tuple[rnc.ReducedModel, Motion]:
    """A tree of one to six joints, a random motion of it, and a sampling period of 1 to 20 ms."""
    generator = np.random.default_rng(seed)
    model = pin.Model()
    for k in range(generator.integers(1, 7)):
        kinds = [pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ(), pin.JointModelPX()]
        if k == 0:
            kinds += [pin.JointModelFreeFlyer(), pin.JointModelPlanar(), pin.JointModelSpherical()]
        above = int(generator.choice(list(model.supports[k])))
        place = pin.SE3(pin.exp3(generator.normal(size=3)), generator.uniform(-0.4, 0.4, 3))
        joint = model.addJoint(above, kinds[generator.integers(len(kinds))], place, f"joint_{k}")
        inertia = pin.Inertia.FromBox(generator.uniform(0.2, 3.0), *generator.uniform(0.05, 0.4, 3))
        model.appendBodyToJoint(joint, inertia, pin.SE3(np.eye(3), generator.uniform(-0.2, 0.2, 3)))
        model.addFrame(pin.Frame(f"link_{k}", joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    robot = rnc.Robot(model)
    reduced = rnc.NonholonomicSystem(robot).reduce()
    q = pin.integrate(model, pin.neutral(model), generator.normal(size=model.nv))
    v = 10.0 ** generator.uniform(-0.5, 1.0) * generator.normal(size=model.nv)
    dt = 10.0 ** generator.uniform(-3.0, np.log10(0.02))
    T = np.tile(generator.normal(size=reduced.p), (max(20, round(0.5 / dt)), 1))
    return reduced, Motion(q, v, T, dt)


def of_drawn(count: int) -> Iterator[Compared]:
    for seed in range(count):
        reduced, motion = drawn(seed)
        try:
            true = moved(rnc.ReducedPlant(reduced, tolerance=REFERENCE), motion)
        except rnc.RncError:
            continue  # a motion without an end, such as two links that swing through each other's axis
        for choice, substeps in CHOICES.items():
            try:
                yield compared(f"drawn {seed}", choice, rnc.ReducedPlant(reduced, substeps=substeps), motion, true)
            except rnc.DivergenceError:
                continue  # it says so


def of_scenarios() -> Iterator[Compared]:
    for name in built_in_names():
        short = {"plots": {}, "comparisons": {}}
        plant = Scenario.load(name, short).build().experiment.plant
        if not isinstance(plant, rnc.ReducedPlant | rnc.ContactPlant):
            continue
        run = execute(Scenario.load(name, short).build()).trajectory
        count = min(len(run.time) - 1, round(LONGEST / run.info.dt))
        motion = Motion(run.q[0], run.v[0], run.T[:count], run.info.dt)

        def plant_with(**options: object) -> rnc.plants.Plant:
            given = {f"simulation.{key}": value for key, value in options.items() if value is not None}
            return Scenario.load(name, {**short, **given}).build().experiment.plant  # noqa: B023 (used at once)

        true = moved(plant_with(tolerance=REFERENCE), motion)
        for choice, substeps in CHOICES.items():
            yield compared(name, choice, plant_with(substeps=substeps), motion, true)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    warnings.simplefilter("ignore", rnc.ModelWarning)
    found: list[Compared] = []
    print(f"{'motion':28} {'substeps':>8} {'true':>9} {'stated':>9}")
    for each in of_scenarios():
        found.append(each)
        print(f"{each.name:28} {each.choice:>8} {each.true:9.1e} {each.stated:9.1e}", flush=True)
    found += of_drawn(count)
    for group in ("scenarios", "drawn"):
        for choice in CHOICES:
            own = [x for x in found if x.choice == choice and x.name.startswith("drawn ") == (group == "drawn")]
            judged = [each for each in own if each.judged]
            honest = sum(each.honest for each in judged)
            low = sum(not each.honest and each.stated < each.true for each in judged)
            print(
                f"{group}, substeps {choice}: within a factor of {FACTOR:g} in {honest} of {len(judged)}, "
                f"too small in {low}"
            )
    judged = [each for each in found if each.judged]
    print(f"all: {100 * sum(each.honest for each in judged) / len(judged):.1f} % of {len(judged)}")


if __name__ == "__main__":
    main()
