"""Exceptions of the package: one base class, one-line messages, and the data as attributes."""

from __future__ import annotations

import difflib
import inspect
import itertools
import json
import sys
import warnings
from collections import ChainMap
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, Self

if TYPE_CHECKING:
    import numpy as np


_LONGEST_LINE = 4000
_LONGEST_NAME, _MOST_NAMES = 100, 2000  # limits of the name comparison, whose cost is length^2 * count


class PartialRun(Protocol):
    """Motion until an error: a ``Trajectory``, or a ``Rollout`` if only kinematics was computed."""

    @property
    def time(self) -> np.ndarray:
        """Sample times (N,) [s]."""
        ...

    @property
    def q(self) -> np.ndarray:
        """Configurations (N, nq)."""
        ...


class PartialPlan(PartialRun, Protocol):
    """Plan that its verification does not confirm: a ``MotionPlan``, with the times and configurations of its nodes."""

    @property
    def verdict(self) -> object:
        """``Verdict`` of the verification."""
        ...

    def save(self, path: str | Path) -> None:
        """Write the plan to a file."""
        ...


class RncError(Exception):
    """Base class of all errors that this package raises on purpose.

    Attributes:
        trajectory: motion until the error, if a simulation or a roll-out raised it; else None.
        what: cause in words, of errors whose message says more; else None.
        time: time in a simulation [s], of these errors; else None.

    Example:
        >>> try:
        ...     rnc.Robot.from_urdf("space_robot.urdf").velocity_indices("jont_2")
        ... except rnc.RncError as error:
        ...     print(error)
        no joint 'jont_2' in robot 'space_robot'; did you mean 'joint_2'?
    """

    trajectory: PartialRun | None = None
    what: str | None = None
    time: float | None = None

    def __str__(self) -> str:
        return printable(self._words())

    def within(self, place: object) -> Self:
        """Prepend a place to the message, e.g. the key of a scenario. Return the error itself, with all its data."""
        if self.what is None:
            self.args = (f"{place}: {self._words()}",)
        else:
            self.what = f"{place}: {self.what}"
        return self

    @classmethod
    @contextmanager
    def at(cls, place: object) -> Iterator[None]:
        """Prepend a place to the messages of errors of this class inside, e.g. the key of a scenario."""
        try:
            yield
        except cls as error:
            # Without the cause: a reader needs the place, and not two tracebacks.
            raise error.within(place) from None

    def _words(self) -> str:
        """Return the message; it may contain unescaped names from files."""
        return super().__str__()

    def _when(self) -> str:
        return "" if self.time is None else f" at t = {self.time:.3f} s"

    def __reduce__(self) -> tuple[object, ...]:
        """Support pickling: a worker pool hangs if it cannot unpickle the error of a worker."""
        return _rebuilt, (type(self), self.args), self.__dict__


def _rebuilt(kind: type[RncError], arguments: tuple[object, ...]) -> RncError:
    return kind.__new__(kind, *arguments)


class ModelWarning(UserWarning):
    """The robot file has an entry that is ignored, corrected, or physically impossible.

    Example:
        >>> import warnings
        >>> with warnings.catch_warnings(action="error", category=rnc.ModelWarning):  # refuse such files
        ...     robot = rnc.Robot.from_urdf("space_robot.urdf")
    """


class ModelError(RncError):
    """A file, joint or frame does not exist, or a model cannot be simulated.

    Example:
        >>> try:
        ...     rnc.Robot.from_urdf("space_robot.urdf", base="planer")
        ... except rnc.ModelError as error:
        ...     print(error)
        base 'planer' is not known; did you mean 'planar'?
    """


class ConstraintError(RncError):
    """Constraints, outputs or actuators are inconsistent.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> try:
        ...     rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], ["platform"])
        ... except rnc.ConstraintError as error:
        ...     print(error)
        actuator 'platform' drives momentum(platform), which is declared as conserved
    """


class ConfigurationError(RncError):
    """A scenario file, option or argument is invalid. The message gives the place and the expected value.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> reduced = rnc.NonholonomicSystem(robot).reduce([rnc.JointPosition(name) for name in robot.joint_names])
        >>> try:
        ...     rnc.Task.of(reduced, primary=["joint_1"], redundant=["joint2"])
        ... except rnc.ConfigurationError as error:
        ...     print(error)
        no reducing output 'joint2'; did you mean 'joint_2'?
    """


class InfeasibleError(ConfigurationError):
    """The request is valid but infeasible: no suitable gains or plan exist, or the motion passes a singularity.

    Attributes:
        plan: best ``MotionPlan`` that ``rnc.optimal.plan`` found, whose verdict says what it violates; else None.
        q, time: configuration (nq,) of a motion that is the cause, and its time on the reference [s]; else None.
        rows: names of the constraint and output rows that are nearest to dependent there.
        singular_value: smallest singular value of ``E = [A; J2]`` there, of scaled rows; else None.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> try:
        ...     rnc.control.design_velocity_gains(system.reduce(), robot.configuration(), dt=0.5)
        ... except rnc.InfeasibleError as error:
        ...     print(str(error).partition(":")[0])
        no velocity gains suit this region
    """

    plan: PartialPlan | None = None
    q: np.ndarray | None = None
    time: float | None = None
    rows: tuple[str, ...] = ()
    singular_value: float | None = None


class InputError(RncError, ValueError):
    """An array has the wrong shape or holds values that are not finite.

    Example:
        >>> reduced = rnc.NonholonomicSystem(rnc.Robot.from_urdf("space_robot.urdf")).reduce()
        >>> try:
        ...     reduced.at(q=[0.1, 0.2, 0.3])
        ... except rnc.InputError as error:
        ...     print(error)
        q has shape (3,), expected (..., 4)
    """


class SimulationError(RncError):
    """A simulation cannot continue.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf", gravity=(0, -9.81, 0))
        >>> reduced = rnc.NonholonomicSystem(robot).reduce()
        >>> fast = rnc.SimulationOptions(rnc.Stop(speed=2.0))
        >>> try:
        ...     rnc.free_motion(reduced, robot.configuration(), np.zeros(4), duration=1.0, options=fast)
        ... except rnc.SimulationError as error:
        ...     print(error.trajectory.outcome, len(error.trajectory.time) > 0)  # the run so far
        diverged True
    """


class DivergenceError(SimulationError):
    """The state diverged: it is not finite, or it exceeds a limit.

    Attributes:
        what: the exceeded limit, in words.
        time: simulation time [s], or None outside a simulation.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf", gravity=(0, -9.81, 0))
        >>> reduced = rnc.NonholonomicSystem(robot).reduce()
        >>> fast = rnc.SimulationOptions(rnc.Stop(speed=2.0))
        >>> try:
        ...     rnc.free_motion(reduced, robot.configuration(), np.zeros(4), duration=1.0, options=fast)
        ... except rnc.DivergenceError as error:
        ...     print(error.time is not None, "reached" in str(error))
        True True
    """

    def __init__(self, what: str, *, time: float | None = None) -> None:
        self.what, self.time = what, time
        super().__init__(what)

    def _words(self) -> str:
        return f"diverged{self._when()}: {self.what}"


class LimitError(SimulationError):
    """A condition of ``Stop`` ended a run: a joint left its position range, or a contact would have to pull.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf")
        >>> reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()
        >>> rest = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([0.0, 0.0]))
        >>> controller, q0 = rnc.control.ComputedTorque(reduced, rest), robot.configuration({"joint_1": 63.0})
        >>> options = rnc.SimulationOptions(stop=rnc.Stop(position_limits=True))
        >>> try:
        ...     rnc.simulate(reduced, controller, q0, duration=1.0, options=options)
        ... except rnc.LimitError as error:
        ...     print(error)
        joint 'joint_1' left its range [-62.8319, 62.8319]: 63 at t = 0.000 s
    """


class SingularityError(SimulationError):
    """The stacked matrix ``E = [A; J2]`` is singular: the outputs do not parametrise the motion at this configuration.

    The same error tells that a row is undefined, such as that of a wheel that lies flat, or that redundant outputs
    cannot move the vertical ones of a controller.

    Attributes:
        what: the failed operation, in words.
        q: the configuration, (nq,).
        condition: 2-norm condition number of ``E`` with rows scaled by their typical length; what decides is the
            dependence of its rows (``singularity_limit``). In the other cases the one of the controller's matrix, or
            one over the length that vanishes.
        rows: names of the rows that are (nearly) linearly dependent, or undefined.
        time: time of the run [s], or None outside a run.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")])
        >>> try:
        ...     reduced.at(robot.configuration()).R  # a straight arm
        ... except rnc.SingularityError as error:
        ...     print(error.rows, error.condition > 1e8)
        ('tip_x',) True
    """

    def __init__(
        self, what: str, *, q: np.ndarray, condition: float, rows: Sequence[str], time: float | None = None
    ) -> None:
        self.what, self.q, self.time = what, q, time
        self.condition, self.rows = condition, tuple(rows)
        super().__init__(what)

    def _words(self) -> str:
        where = ", ".join(f"{value:.4g}" for value in self.q)
        return (
            f"{self.what}{self._when()}: rows {', '.join(self.rows)} are dependent "
            f"(condition {self.condition:.3g}) at q = [{where}]"
        )


def printable(text: str, longest: int = _LONGEST_LINE) -> str:
    """Return text as one line of bounded length with escaped control characters: names come from files."""
    if len(text) > longest:
        text = f"{text[: longest // 2]} ... {text[-longest // 2 :]}"
    line = " ".join(text.split())
    # Control characters of a file could rewrite the terminal.
    if line.isprintable():
        return line
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in line)


def closest(name: str, valid: Iterable[str], spelling: bool = True) -> str | None:
    """Return the most similar valid name, or None.

    A short word is often a remembered part of the name: ``wheel`` for ``wheel_left_joint``. So names that begin with it
    come first. With ``spelling``, names of similar spelling come next, then names that contain it, then the others.
    """
    # Names of a file may be long and many: the comparison would take minutes.
    choices = list(itertools.islice((each for each in valid if len(each) <= _LONGEST_NAME), _MOST_NAMES))
    if len(name) > _LONGEST_NAME:
        return None
    beginning = [choice for choice in choices if len(name) > 2 and choice.startswith(name)]
    part = [choice for choice in choices if len(name) > 2 and name in choice]
    alike = choices if spelling else []
    # 0.8 is a typing error of one or two letters; 0.5 is a similar word, which comes after parts of names.
    for some, cutoff in ((beginning, 0.0), (alike, 0.8), (part, 0.0), (alike, 0.5)):
        close = difflib.get_close_matches(name, some, n=1, cutoff=cutoff)
        if close:
            return close[0]
    return None


def nearest(name: str, valid: Iterable[str], ending: str = "") -> str:
    """Return a hint from an unknown name to the valid ones: ``; did you mean 'b'?``.

    The common ``ending`` of all names is shown but not compared, since it would make any two names similar.
    """
    choices = [str(choice) for choice in valid]
    if not choices:
        return "; there are none"
    close = closest(str(name), choices)
    if close is not None:
        return f"; did you mean '{close}{ending}'?"
    shown = ", ".join(choice + ending for choice in choices[:12]) + (", ..." if len(choices) > 12 else "")
    return f"; expected one of: {shown}"


def place_of(name: str, valid: Collection[str], what: str, error: type[RncError] = ConfigurationError) -> int:
    """Return the index of a name among the valid ones.

    Args:
        name: the name.
        valid: the valid names.
        what: beginning of the message about an unknown name, such as "no actuator".
        error: class of the error; by default ``ConfigurationError``.
    """
    if name not in valid:
        raise error(f"{what} '{name}'{nearest(name, valid)}")
    return list(valid).index(name)


def check_known(word: object, valid: Iterable[object], what: str, error: type[RncError] = ConfigurationError) -> None:
    """Raise an error with the nearest word if a word is none of the valid ones.

    Args:
        word: the word.
        valid: words that are valid.
        what: what it chooses, for the message.
        error: class of the error; by default ``ConfigurationError``.
    """
    choices = list(valid)
    if not isinstance(word, str) or word not in choices:  # an array has no truth value
        raise error(f"{what} '{word}' is not known{nearest(str(word), map(str, choices))}")


def check_unique(names: Sequence[str], what: str, error: type[RncError] = ConfigurationError) -> None:
    """Raise an error for the first name that occurs twice.

    Args:
        names: the names.
        what: beginning of the message, such as "duplicate channel".
        error: class of the error; by default ``ConfigurationError``.
    """
    for name in names:
        if names.count(name) > 1:
            raise error(f"{what} '{name}'")


def argument(name: str, value: object) -> str:
    """Return an argument of a robot as Python and as scenario files take it: ``base='free' (robot: {base: free})``."""
    return f"{name}={value!r} (robot: {{{name}: {json.dumps(value).replace(chr(34), '')}}})"


def few(names: Sequence[str], most: int = 3) -> str:
    """Return the first names and the number of the others: ``a, b, c and 4 more``."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def short_text(value: object) -> str:
    """Return a short text of a value for error messages."""
    if isinstance(value, dict):
        return f"a mapping with keys {', '.join(map(str, list(value)[:4]))}" if value else "an empty mapping"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


# ---------------------------------------------------------------------- packages that are not installed


_PACKAGES = {
    "control": ("python-control", "control"),
    "dask": ("Dask", "distributed"),
    "meshes": ("trimesh", "trimesh"),
    "mujoco": ("MuJoCo", "mujoco"),
    "ompl": ("OMPL", "ompl"),
    "video": ("Playwright", "playwright"),
}
"""Packages of extras: the name that people read, and the module."""


def missing_extra(extra: str) -> str:
    """Message about the missing package of an extra; it tells how to install it.

    The package is on no index, so the command is for the folder of the source.
    """
    return f"{_PACKAGES[extra][0]} is not installed: pip install '.[{extra}]' in the folder of rnc_pin's source"


def check_extra(extra: str, purpose: str) -> None:
    """Find the package of an extra without importing it.

    Args:
        extra: name of the extra.
        purpose: what needs the package, for the message.

    Raises:
        ConfigurationError: the package is not installed.
    """
    # Not imported: some of them take seconds, and may never be needed.
    if find_spec(_PACKAGES[extra][1]) is None:
        raise ConfigurationError(f"{purpose}: {missing_extra(extra)}")


def warn(text: str) -> None:
    """Give a ``ModelWarning`` at the line outside this package that led here."""
    # A warning about a model is read at the line of the user, however deep it arises here.
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).startswith("rnc_pin."):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, ModelWarning, stacklevel=level)


def check_classes(
    title: str, call: Callable[..., object], arguments: Sequence[object], named: Mapping[str, object]
) -> None:
    """Raise an error if an argument is no object of the class of this package that its annotation names.

    Args:
        title: name of the call in messages.
        call: a function with annotations.
        arguments, named: arguments of the call.

    Raises:
        ConfigurationError: names the argument.
    """
    # A module may import a class for type checkers alone.
    scopes = [vars(module) for name, module in list(sys.modules.items()) if name.startswith("rnc_pin.")]
    known = ChainMap({"None": type(None)}, vars(sys.modules[call.__module__]), *scopes)
    with suppress(TypeError):  # arguments that do not fit tell this themselves
        for name, value in inspect.signature(call).bind(*arguments, **named).arguments.items():
            words = str(call.__annotations__.get(name)).split(" | ")
            kinds = tuple(kind for word in words if isinstance(kind := known.get(word), type))
            own = any(kind.__module__.startswith("rnc_pin.") for kind in kinds) and len(kinds) == len(words)
            if own and not isinstance(value, (*kinds, tuple)):  # a tuple of *arguments
                # None is a way to omit an argument, and no class that a user would pass.
                expected = " or ".join(word for word in words if word != "None")
                raise ConfigurationError(f"{title}: {name}: expected {expected}, found {short_text(value)}")
