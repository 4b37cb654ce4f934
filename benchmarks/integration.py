"""Honesty of the estimated integration error of runs, and what the estimate costs.

Each run is made with one integration step in a sample, with two, and with as many as the default tolerance asks for.
Its true error is the difference to the same run, with its feedback, with a tolerance of 1e-11 per second. The table
compares the largest true error of a configuration entry [m or rad] with the stated one, for all built-in scenarios on
plants that state an error, and for drawn systems of one to six joints under constant random inputs. Errors are not
judged below what the compared run may have itself, nor below what one unit in the last place in each sample makes. Of
the drawn systems, only misses have a row. The last column is the processor time of the estimate over that of the rest
of the run, each the least of three. Arguments, both optional: number of drawn systems, 200 by default, and names of
scenarios, all by default.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.sweep.scenario_runs import arguments_of
from rnc_pin.control.controller import Command
from rnc_pin.model.reduced_kinematics import Measurement
from rnc_pin.simulation.sampled_run import SampledRun
from rnc_pin.simulation.simulation_options import RunArguments
from rnc_pin.simulation.stop import complete_run

REFERENCE, FACTOR = 1e-11, 10.0
CHOICES: dict[str, int | None] = {"1": 1, "2": 2, "default": None}
REPEATED, LONG = 3, 200  # repetitions of a time, and samples from which a run is long


class Compared(NamedTuple):
    """True and stated error of a run [m or rad].

    Attributes:
        stated: NaN if the run says that its error is not known.
        how: of the estimate: propagated, with inputs as given, or unknown.
        samples: number of samples.
        floor: error that the compared run may have, or that rounding by one unit in the last place a sample makes.
        cost: processor time of the estimate over that of the run; NaN if it was not measured.
    """

    name: str
    choice: str
    true: float
    stated: float
    how: str
    samples: int
    floor: float
    cost: float

    @property
    def judged(self) -> bool:
        return max(self.true, self.stated) > self.floor

    @property
    def honest(self) -> bool:
        low, high = sorted((self.true, self.stated))
        return high <= FACTOR * low

    def __str__(self) -> str:
        word = "" if not self.judged or self.honest else "too small" if self.stated < self.true else "too large"
        cost = "" if np.isnan(self.cost) else f"{100 * self.cost:5.1f} %"
        return (
            f"{self.name:28} {self.choice:>8} {self.true:9.1e} {self.stated:9.1e} {self.how:>10} {cost:>7} {word}"
        ).rstrip()


class Constant:
    """Controller that gives constant inputs (p,)."""

    def __init__(self, T: np.ndarray) -> None:
        self.T = T

    def initial_state(self, measurement: Measurement) -> None:
        return None

    def step(self, t: float, measurement: Measurement, state: None) -> tuple[Command, None]:
        return Command(T=self.T), None


def timed(arguments: Callable[[], RunArguments], repeated: int = REPEATED) -> tuple[rnc.Trajectory, float]:
    """A run of one part, and the cost of its estimate."""
    runs, estimates = [], []
    for _ in range(repeated):
        given = arguments()
        run, start = SampledRun(given), time.process_time()
        try:
            found = complete_run(lambda progress: run.run_to(given.samples, progress), run.finish)  # noqa: B023
        except rnc.RncError as error:
            if not isinstance(error.trajectory, rnc.Trajectory):
                raise
            found = error.trajectory
        runs.append(time.process_time() - start)
    for _ in range(REPEATED):
        start = time.process_time()
        run.integration()
        estimates.append(time.process_time() - start)
    return found, min(estimates) / max(min(runs) - min(estimates), 1e-9)


def compared(
    name: str, choice: str, run: tuple[rnc.Trajectory, float], true: rnc.Trajectory, robot: rnc.Robot
) -> Compared:
    """True error of a run that states one, or says why it does not, beside the stated one."""
    found, cost = run
    stated = found.info.integration
    assert stated is not None
    pairs = zip(found.q, true.q, strict=False)  # an event may be one sample later
    error = max(float(np.abs(pin.difference(robot.model, *pair)).max()) for pair in pairs)
    how = "unknown" if stated.unknown else "propagated" if stated.linearized else "inputs"
    largest = np.nan if stated.unknown else max(stated.accumulated.get(unit, 0.0) for unit in ("m", "rad"))
    rounding = len(found.time) * float(np.spacing(np.abs(found.q).max()))
    floor = max(REFERENCE * max(1.0, float(found.time[-1])), rounding)
    return Compared(name, choice, error, largest, how, len(found.time), floor, cost)


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


def of_drawn(count: int) -> Iterator[Compared]:
    """Runs of drawn systems."""
    for seed in range(count):
        reduced, q, v, T, dt = drawn(seed)
        samples, v2 = max(20, round(0.5 / dt)) + 1, reduced.at(q, v=v).v2

        def run(substeps: int | None = None, **options: float) -> RunArguments:
            plant = rnc.ReducedPlant(reduced, substeps=substeps, **options)  # noqa: B023 (used at once)
            return RunArguments(reduced, Constant(T), q, dt, samples, v2, plant)  # noqa: B023

        try:
            true, _ = timed(lambda: run(tolerance=REFERENCE), 1)
        except rnc.RncError:
            continue
        if true.outcome is not rnc.Outcome.COMPLETED:
            continue  # a motion without an end, such as two links that swing through each other's axis
        for choice, substeps in CHOICES.items():
            found = timed(lambda: run(substeps))  # noqa: B023
            if found[0].outcome is rnc.Outcome.COMPLETED:  # otherwise it says that it diverged
                yield compared(f"drawn {seed}", choice, found, true, reduced.robot)


def of_scenarios(names: Sequence[str]) -> Iterator[Compared]:
    """Runs of built-in scenarios; prints the reasons of those without an estimate."""
    for name in names:

        def built(**options: float | None) -> Scenario:
            given = {f"simulation.{key}": value for key, value in options.items() if value is not None}
            return Scenario.load(name, {"plots": {}, "comparisons": {}, **given}).build()  # noqa: B023 (used at once)

        def run(scenario: Scenario) -> tuple[rnc.Trajectory, float]:
            if scenario.experiment.phases:
                return execute(scenario).trajectory, np.nan
            return timed(lambda: arguments_of(scenario), 1)

        scenario = built()
        first, robot = run(scenario), scenario.reduced.robot
        stated = first[0].info.integration
        if stated is None or stated.unknown:
            print(f"{name:28} {'the plant estimates no error' if stated is None else stated.unknown}", flush=True)
            continue
        true, _ = run(built(tolerance=REFERENCE))
        for choice, substeps in CHOICES.items():
            yield compared(name, choice, first if substeps is None else run(built(substeps=substeps)), true, robot)


def judged_group(group: str, found: Sequence[Compared]) -> str:
    """Number of honest runs, and the costs."""
    known = [each for each in found if each.how != "unknown"]
    judged = [each for each in known if each.judged]
    honest = sum(each.honest for each in judged)
    low = sum(not each.honest and each.stated < each.true for each in judged)
    words = [f"{group}: within a factor of {FACTOR:g} in {honest} of {len(judged)}, too small in {low}"]
    if len(known) < len(found):
        words.append(f"{len(found) - len(known)} say that it is not known")
    for name, runs in (
        ("long", [x for x in found if x.samples > LONG]),
        ("short", [x for x in found if x.samples <= LONG]),
    ):
        costs = [100 * each.cost for each in runs if not np.isnan(each.cost)]
        if costs:
            words.append(f"cost of {len(costs)} {name} runs {np.median(costs):.1f} % (largest {max(costs):.1f} %)")
    return "; ".join(words)


def main() -> None:
    count, names = int((sys.argv[1:] or ["200"])[0]), sys.argv[2:] or built_in_names()
    warnings.simplefilter("ignore", rnc.ModelWarning)
    found: list[Compared] = []
    print(f"{'run':28} {'substeps':>8} {'true':>9} {'stated':>9} {'estimate':>10}    cost")
    with np.errstate(over="ignore", invalid="ignore"):
        for each in of_scenarios(names):
            found.append(each)
            print(each, flush=True)
        for each in of_drawn(count):
            found.append(each)
            if each.how == "unknown" or (each.judged and not each.honest):
                print(each, flush=True)
    for group in ("scenarios", "drawn"):
        for choice in CHOICES:
            own = [x for x in found if x.choice == choice and x.name.startswith("drawn ") == (group == "drawn")]
            if own:
                print(judged_group(f"{group}, substeps {choice}", own))
    print(judged_group("all", found))


if __name__ == "__main__":
    main()
