"""Reduced model ``F = H v2dot + V v2 + G`` of any system. Paper (2)-(3), (6)-(7).

``ReducedModel.at`` returns an evaluation with all quantities; other methods forward the most common ones. Formulas of
q, such as H, are in ``configuration_evaluation``; those of q and v, such as V, G and g*, in ``state_evaluation``. What
the compiled kernel has filled instead is in ``filled_arrays``, under the same names.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import overload

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import InputError
from rnc_pin.model.assembly import Assembly
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.evaluation_results import LagrangianTerms, ReducedRegressor, ReducedTerms
from rnc_pin.model.evaluator import Evaluator, evaluator_for
from rnc_pin.model.generalized_forces import Actuation, PassiveForces
from rnc_pin.model.independence import DroppedRow
from rnc_pin.model.input_validation import ArrayInput, admit_configurations, admit_numbers, admit_states, admit_times
from rnc_pin.model.rows import OutputStack, RowStack
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.printing import Item, Line, ObjectSummary, SummaryMixin, counted, items
from rnc_pin.robots.robot import Robot

_RECORDED = ("R_dot", "H", "V", "G", "input_matrix", "A_star", "A_star_dot", "v", "b", "b_dot")
"""Terms that the kernel records under their names; the others are parts of E and of its inverse."""


class ReducedModel(SummaryMixin):
    """Nonholonomic system in the velocities ``v2`` of its reducing outputs.

    ``NonholonomicSystem.reduce`` returns one. All methods take leading batch axes: q (..., nq), v2 (..., r).
    Threads may evaluate one model.

    Args:
        evaluator: evaluations of its rows, outputs and actuators.
        assembly: projection onto the holonomic rows.
        dropped_rows: redundant constraint rows, with the reasons.

    Attributes:
        reduction_data: rows, outputs, actuators and workspace, to construct other models from.
        evaluator: evaluations by the compiled kernel, or by NumPy alone.
        robot: robot of the system.
        n: number of degrees of freedom before the constraints, nv.
        m: number of independent constraint rows.
        r: number of reducing outputs, n - m.
        p: number of actuators.
        affine: True if the constraints are ``A v = mu`` with mu not zero, so that ``v = R v2 + b``.
        rheonomic: True if the constraints depend on time: ``A(q, t) v = mu(q, t)``.
        constraints: independent constraint rows, which form A.
        all_constraints: all constraint rows, dropped ones included.
        reducing: reducing outputs x2.
        vertical: vertical outputs x1.
        actuation: actuators and their matrix B(q).
        assembly: projection onto the holonomic rows.
        dropped_rows: redundant constraint rows, with the reasons.

    Raises (every method):
        InputError: an array has the wrong shape or is not finite.
        SingularityError: the outputs do not parametrise the motion at q.
        DivergenceError: a row is not finite at q.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce()
        >>> state = reduced.at(robot.configuration({"joint_2": 1.8}), v2=[0.1, 0.0, 0.2])
        >>> state.H.shape, state.v2_dot(np.zeros(3)).shape
        ((3, 3), (3,))
        >>> reduced.reducing.names
        ('joint_1', 'joint_2', 'joint_3')
    """

    def __init__(self, evaluator: Evaluator, assembly: Assembly, dropped_rows: Sequence[DroppedRow] = ()) -> None:
        data = evaluator.data
        self.evaluator, self.reduction_data, self.robot = evaluator, data, data.robot
        self.n, self.m, self.r, self.p = data.n, data.m, data.r, data.p
        self.affine, self.rheonomic = data.affine, data.rheonomic
        self.constraints, self.all_constraints = data.constraints, data.rows
        self.reducing, self.vertical, self.actuation = data.reducing, data.vertical, data.actuation
        self.assembly, self.dropped_rows = assembly, tuple(dropped_rows)

    def __setattr__(self, name: str, value: object) -> None:
        # Evaluations, controllers and plants would not follow.
        if "dropped_rows" in vars(self):  # the last attribute
            raise AttributeError(f"'{name}' of a ReducedModel is read-only: reduce the system anew")
        super().__setattr__(name, value)

    # ------------------------------------------------------------------ one evaluation

    @overload
    def at(self, q: ArrayInput, *, t: ArrayInput | None = None) -> ConfigurationEvaluation: ...

    @overload
    def at(self, q: ArrayInput, v2: ArrayInput, *, t: ArrayInput | None = None) -> StateEvaluation: ...

    @overload
    def at(self, q: ArrayInput, *, v: ArrayInput, t: ArrayInput | None = None) -> StateEvaluation: ...

    def at(
        self, q: ArrayInput, v2: ArrayInput | None = None, *, v: ArrayInput | None = None, t: ArrayInput | None = None
    ) -> ConfigurationEvaluation | StateEvaluation:
        """Evaluate the model at states. Each quantity is computed once, on first use, and is read-only.

        Without a velocity, the evaluation has only the quantities that depend on q alone.

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r).
            v: measured full velocities (..., nv), instead of v2; they need not satisfy the constraints.
            t: times (...) [s], one number or one for each state. States of rheonomic constraints need them, and
                configurations too if the rows depend on time. Other constraints ignore them.

        Raises:
            InputError: also for a rheonomic system without t.
        """
        q, data = admit_configurations(q, self.robot), self.reduction_data
        if t is not None and type(t) is not float:
            admit_numbers(t, "t")
        t = None if t is None or not self.rheonomic else admit_times(t, q.shape[:-1])
        if v2 is not None:
            if v is not None:
                raise InputError("at() takes v2 or v, not both")
            q, v2 = admit_states(q, v2, data.r, "v2", data.reducing.names)
            return StateEvaluation.at(self.evaluator, q, v2, t=t)
        if v is not None:
            q, v = admit_states(q, v, data.n, "v")
            return StateEvaluation.at(self.evaluator, q, v=v, t=t)
        return ConfigurationEvaluation(self.evaluator, q, t=t)

    def frozen(self, t: float) -> ReducedModel:
        """The same model at one time t [s]: its constraints have the rows, rates and positions of this time.

        It serves analyses of rheonomic systems at an instant. It does not follow the constraints over time.
        A model whose constraints do not depend on time is returned itself.

        Args:
            t: the time [s].
        """
        if not self.rheonomic:
            return self
        t = float(admit_times(t, ()))
        return ReducedModel(evaluator_for(self.reduction_data.frozen(t)), self.assembly.frozen(t), self.dropped_rows)

    def with_basis_at(self, q: ArrayInput) -> ReducedModel:
        """The same model with the constraint rows that are selected at q as default rows.

        If the system was reduced without named outputs, the reduced velocities are selected at q too.

        Args:
            q: one configuration (nq,).
        """
        state = self.at(q)
        # An error here, and not at the first use of the new model, if q is singular.
        _ = state.R
        # Only the default changes: at other states other rows may still be selected.
        parts = replace(self.reduction_data, kept=tuple(state.kept.tolist()))
        if self.reduction_data.free:
            # Rows of J2 are unit vectors then: each has its one at the entry that was selected.
            parts = parts.in_entries(np.argmax(state.J2, axis=1).tolist())
        return ReducedModel(evaluator_for(parts), self.assembly, self.dropped_rows)

    # ------------------------------------------------------------------ dynamics

    def forward_dynamics(
        self, q: ArrayInput, v2: ArrayInput, T: ArrayInput, *, t: ArrayInput | None = None
    ) -> Float[Array, "*batch r"]:
        """Reduced accelerations ``v2_dot`` (..., r) under actuator inputs.

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r) [rad/s or m/s].
            T: actuator inputs (..., p) [N or N m].
            t: times (...) of rheonomic constraints [s]; others ignore them.
        """
        found = self._called(self.evaluator.calls.forward_dynamics, (q, v2, T), t)
        return self._state(q, v2, t).v2_dot(T) if found is None else found

    def inverse_dynamics(
        self, q: ArrayInput, v2: ArrayInput, v2_dot: ArrayInput, *, t: ArrayInput | None = None
    ) -> Float[Array, "*batch r"]:
        """Reduced forces ``F = H v2_dot + V v2 + G``.

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r) [rad/s or m/s].
            v2_dot: reduced accelerations (..., r) [rad/s^2 or m/s^2].
            t: times (...) of rheonomic constraints [s]; others ignore them.
        """
        found = self._called(self.evaluator.calls.inverse_dynamics, (q, v2, v2_dot), t)
        return self._state(q, v2, t).inverse_dynamics(v2_dot) if found is None else found

    def _called(
        self, call: Callable[..., Array | None], arguments: tuple[ArrayInput, ...], t: ArrayInput | None
    ) -> Array | None:
        """Result of a call of the kernel; None if the formulas have to decide. Lists are converted first."""
        rates = None if t is None else self.evaluator.rates_at(t, arguments[0])
        try:
            found = call(*arguments, rates)
            if found is None and any(type(each) is not Array or each.dtype != float for each in arguments):
                with suppress(InputError):  # NumPy's path names what is wrong
                    found = call(*(np.ascontiguousarray(admit_numbers(each, "")) for each in arguments), rates)
            return found
        except ValueError:  # of Pinocchio
            self.robot.check_unchanged()
            raise

    def _state(self, q: ArrayInput, v2: ArrayInput, t: ArrayInput | None = None) -> StateEvaluation:
        # None for v2 would otherwise give an evaluation without a velocity, whose quantities fail one by one.
        if v2 is None:
            raise InputError("v2 is missing: expected the reduced velocity")
        return self.at(q, v2, t=t)

    def regressor(
        self, q: ArrayInput, v2: ArrayInput, v2_dot: ArrayInput, *, t: ArrayInput | None = None
    ) -> ReducedRegressor:
        """Matrix of ``F = matrix @ parameters`` with named columns, the inertial parameters of all bodies.

        Passive forces f of the system are not part of it: ``F + R^T f = matrix @ parameters`` then, with
        ``f = reduced.at(q, v2).passive_force``. Rheonomic constraints need the times t (...) [s].

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r).
            v2_dot: reduced accelerations (..., r).
            t: times (...) [s].
        """
        return self.at(q, v2, t=t).regressor(v2_dot)

    def allocate(self, q: ArrayInput, F: ArrayInput) -> Float[Array, "*batch p"]:
        """Actuator inputs T with ``R^T B T = F``; those of least norm if they are not unique.

        Args:
            q: configurations (..., nq).
            F: reduced forces (..., r) [N or N m].

        Raises:
            ConstraintError: the actuators cannot produce every F (rank of ``R^T B`` below r).
        """
        return self.at(q).allocate(F)

    def multipliers(self, q: ArrayInput, v2: ArrayInput, T: ArrayInput) -> Float[Array, "*batch m"]:
        """Constraint multipliers lambda of ``B T = H* vdot + C* v + g* + A^T lambda``; see ``StateEvaluation``.

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r) [rad/s or m/s].
            T: actuator inputs (..., p) [N or N m].
        """
        return self.at(q, v2).multipliers(T)

    def energy(self, q: ArrayInput, v2: ArrayInput) -> Float[Array, "*batch"] | float:
        """Kinetic plus potential energy [J].

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r) [rad/s or m/s].
        """
        return self.at(q, v2).energy

    # ------------------------------------------------------------------ matrices

    def terms(self, q: ArrayInput, v2: ArrayInput) -> ReducedTerms:
        """All matrices of the reduced system at (q, v2).

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r) [rad/s or m/s].
        """
        kernel, m = self.evaluator.kernel, self.m
        # Joints that were added to the model since do not fit the arrays of the kernel.
        self.robot.check_unchanged()
        numbers = None if kernel is None or not type(q) is type(v2) is Array else kernel.calls.terms(q, v2)
        if kernel is None or numbers is None:
            return self._state(q, v2).terms()
        numbers.setflags(write=False)
        record = np.ndarray(numbers.shape[:-1], kernel.terms, numbers)
        terms = object.__new__(ReducedTerms)  # its own constructor takes as long as all matrices of a small system
        A, A_dot = record["E"][..., :m, :], record["E_dot"][..., :m, :]
        recorded = {name: record[name] for name in _RECORDED}
        vars(terms).update(recorded, R=record["E_inverse"][..., m:], A=A, A_dot=A_dot)
        return terms

    def lagrangian_terms(self, q: ArrayInput, v2: ArrayInput) -> LagrangianTerms:
        """Matrices H*, C*, g* and B of the unreduced system (1), with C* at ``v = R v2 + b``.

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r) [rad/s or m/s].
        """
        state = self.at(q, v2)
        return LagrangianTerms(H=state.M, C=state.C, g=state.g, B=state.B)

    # ------------------------------------------------------------------ assembled configurations

    def assembled(self, q: ArrayInput, hold: Sequence[str] = ()) -> Float[Array, " nq"]:
        """Return a configuration near q that satisfies the holonomic rows: loops closed, wheels on the ground.

        Args:
            q: one configuration (nq,).
            hold: names of joints that keep their positions.

        Raises:
            ConstraintError: no such configuration was found.
        """
        return self.assembly.project(admit_configurations(q, self.robot), hold)

    def random_configuration(self, generator: np.random.Generator, spread: float = np.pi) -> Float[Array, " nq"]:
        """Random configuration from ``generator`` within ``spread`` of neutral, projected onto the holonomic rows.

        Args:
            generator: source of the random numbers.
            spread: largest distance from the neutral configuration before the projection [rad or m].
        """
        return self.assembly.random_configuration(generator, spread)

    # ------------------------------------------------------------------ print

    def _summary(self) -> ObjectSummary:
        lines = [
            ("reducing", output_items(self.reducing)),
            ("vertical", output_items(self.vertical)),
            *system_lines(self.constraints, self.dropped_rows, self.actuation, self.reduction_data.forces),
        ]
        return ObjectSummary(system_headline("ReducedModel", self.robot, self.constraints), lines)


def system_headline(kind: str, robot: Robot, constraints: RowStack) -> str:
    """Headline with the degrees of freedom before and after the constraints.

    Args:
        kind: name of the class.
        robot: the robot.
        constraints: independent rows.
    """
    rows = counted(constraints.size, "independent row")
    return f"{kind} of '{robot.name}': {robot.nv} degrees of freedom less {rows} leave {robot.nv - constraints.size}"


def system_lines(
    constraints: RowStack, dropped: Sequence[DroppedRow], actuation: Actuation, forces: PassiveForces
) -> list[Line]:
    """Lines with the kept rows, the dropped rows, the actuators and the passive forces.

    Args:
        constraints: independent rows.
        dropped: the other rows.
        actuation: actuators.
        forces: passive forces.
    """
    kept = items(constraints.names, ["holonomic" if flag else "" for flag in constraints.holonomic])
    lines: list[Line] = [("rows kept", kept)]
    if dropped:
        lines.append(("rows dropped", tuple(Item(row.name, row.reason) for row in dropped)))
    lines.append(("actuators", items(actuation.names)))
    return [*lines, ("forces", items(forces.names))] if forces else lines


def output_items(outputs: OutputStack) -> Sequence[Item]:
    """Names of outputs; quasi-velocities are marked.

    Args:
        outputs: the outputs.
    """
    return items(outputs.names, ["quasi-velocity" if flag else "" for flag in outputs.quasi])
