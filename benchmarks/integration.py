"""Honesty of the estimated integration error of runs, and what the estimate costs.

Each run is made with one integration step in a sample, with two, and with as many as the default tolerance asks for.
Its true error is the difference to the same run, with its feedback, with a tolerance of 1e-11 per second. The table
compares the largest true error of a configuration entry [m or rad] with the stated one, for all built-in scenarios on
plants that state an error, and for drawn systems of one to six joints under constant random inputs. Errors below 1e-11
are rounding, and not judged. The last column is the processor time of the estimate over that of the run. Arguments,
both optional: number of drawn systems, 200 by default, and names of scenarios, all by default.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control.controller import Command
from rnc_pin.model.measurement import Measurement
from rnc_pin.simulation.error_propagation import ErrorHistory

REFERENCE, JUDGED, FACTOR = 1e-11, 1e-11, 10.0
CHOICES: dict[str, int | None] = {"1": 1, "2": 2, "default": None}


class Compared(NamedTuple):
    """True and stated error of a run [m or rad]; ``linearized`` and ``cost`` of the estimate."""

    name: str
    choice: str
    true: float
    stated: float
    linearized: bool
    cost: float

    @property
    def judged(self) -> bool:
        return max(self.true, self.stated) > JUDGED

    @property
    def honest(self) -> bool:
        low, high = sorted((self.true, self.stated))
        return high <= FACTOR * low

    def __str__(self) -> str:
        word = "" if not self.judged or self.honest else "too small" if self.stated < self.true else "too large"
        kind = "linearized" if self.linearized else "inputs"
        return (
            f"{self.name:28} {self.choice:>8} {self.true:9.1e} {self.stated:9.1e} {kind:>10} {100 * self.cost:5.1f} % "
            f"{word}"
        ).rstrip()


class Constant:
    """Controller that gives constant inputs (p,)."""

    def __init__(self, T: np.ndarray) -> None:
        self.T = T

    def initial_state(self, measurement: Measurement) -> None:
        return None

    def step(self, t: float, measurement: Measurement, state: None) -> tuple[Command, None]:
        return Command(T=self.T), None


class Timed:
    """Clock of the estimates: processor time of the propagation since the start [s]."""

    def __init__(self) -> None:
        self.spent, largest = 0.0, ErrorHistory.largest

        def timed(history: ErrorHistory, *arguments: object) -> np.ndarray | None:
            start = time.process_time()
            try:
                return largest(history, *arguments)  # type: ignore[arg-type]
            finally:
                self.spent += time.process_time() - start

        ErrorHistory.largest = timed  # type: ignore[method-assign]

    def cost(self, run: Callable[[], rnc.Trajectory]) -> tuple[rnc.Trajectory, float]:
        """A run, and the share of its estimate."""
        start, before = time.process_time(), self.spent
        found = run()
        spent = self.spent - before
        return found, spent / max(time.process_time() - start - spent, 1e-9)


def compared(
    name: str, choice: str, timed: tuple[rnc.Trajectory, float], true: rnc.Trajectory, robot: rnc.Robot
) -> Compared | None:
    run, cost = timed
    if run.info.integration is None or run.info.integration.unknown:
        return None
    pairs = zip(run.q, true.q, strict=False)  # an event may be one sample later
    error = max(float(np.abs(pin.difference(robot.model, *pair)).max()) for pair in pairs)
    stated = max(run.info.integration.accumulated.get(unit, 0.0) for unit in ("m", "rad"))
    return Compared(name, choice, error, stated, run.info.integration.linearized, cost)


def drawn(seed: int) -> tuple[rnc.ReducedModel, np.ndarray, np.ndarray, np.ndarray, float]:
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
    return reduced, q, v, generator.normal(size=reduced.p), dt


def of_drawn(count: int, clock: Timed) -> Iterator[Compared]:
    for seed in range(count):
        reduced, q, v, T, dt = drawn(seed)
        duration, v2 = max(20, round(0.5 / dt)) * dt, reduced.at(q, v=v).v2

        def run(**options: Any) -> rnc.Trajectory:
            plant = rnc.ReducedPlant(reduced, **options)  # noqa: B023 (used at once)
            return rnc.simulate(reduced, Constant(T), q, duration, dt, v2_0=v2, plant=plant)  # noqa: B023

        try:
            true = run(tolerance=REFERENCE)
        except rnc.RncError:
            continue  # a motion without an end, such as two links that swing through each other's axis
        for choice, substeps in CHOICES.items():
            try:
                timed = clock.cost(partial(run, substeps=substeps))
            except rnc.DivergenceError:
                continue  # it says so
            found = compared(f"drawn {seed}", choice, timed, true, reduced.robot)
            assert found is not None
            yield found


def of_scenarios(names: Sequence[str], clock: Timed) -> Iterator[Compared]:
    for name in names:

        def run(**options: object) -> rnc.Trajectory:
            given = {f"simulation.{key}": value for key, value in options.items() if value is not None}
            loaded = Scenario.load(name, {"plots": {}, "comparisons": {}, **given})  # noqa: B023 (used at once)
            return execute(loaded.build()).trajectory

        robot = Scenario.load(name, {"plots": {}, "comparisons": {}}).build().reduced.robot
        first = clock.cost(run)
        if first[0].info.integration is None or first[0].info.integration.unknown:
            print(f"{name:28} no estimate")
            continue
        true = run(tolerance=REFERENCE)
        for choice, substeps in CHOICES.items():
            timed = first if substeps is None else clock.cost(partial(run, substeps=substeps))
            found = compared(name, choice, timed, true, robot)
            if found is not None:
                yield found


def main() -> None:
    count, names = int((sys.argv[1:] or ["200"])[0]), sys.argv[2:] or built_in_names()
    warnings.simplefilter("ignore", rnc.ModelWarning)
    found: list[Compared] = []
    clock = Timed()
    print(f"{'run':28} {'substeps':>8} {'true':>9} {'stated':>9} {'estimate':>10}    cost")
    for each in of_scenarios(names, clock):
        found.append(each)
        print(each, flush=True)
    for each in of_drawn(count, clock):
        found.append(each)
        if each.judged and not each.honest:
            print(each, flush=True)
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
