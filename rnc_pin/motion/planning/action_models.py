"""Action models of a reduced system: states, inputs and one step of the integrator with exact derivatives.

    kinematic       state q          input v2
    acceleration    state (q, v2)    input v2_dot
    dynamic         state (q, v2)    input T

One step of length h with constant input u is the exponential midpoint rule, of second order, in eight parts in the
dynamic form:

    q_m = q (+) h/2 v(x, u),   v2_m = v2 + h/2 v2_dot(x, u)
    q'  = q (+) h v(x_m, u),   v2'  = v2 + h v2_dot(x_m, u)

``(+)`` is the exponential map of the configuration manifold, so quaternions and planar bases keep their norm. All nodes
are evaluated in one block.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, NamedTuple, get_args

import numpy as np
import pinocchio as pin

from rnc_pin.analysis.derivatives import StateDerivatives, state_derivatives
from rnc_pin.array_shapes import Array, Bool, Float, Int
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.model.coordinates import ConfigurationManifold
from rnc_pin.model.reduced_model import ReducedModel

Form = Literal["kinematic", "acceleration", "dynamic"]
FORMS = get_args(Form)
"""Forms in the order in which the compiled kernel counts them."""


def _contiguous(values: Array) -> Array:
    """Floats one after the other in memory, as the kernel reads them."""
    return np.ascontiguousarray(values, dtype=float)


class StateManifold(ConfigurationManifold):
    """Exponential map, its inverse and their derivatives, for stacks of configurations.

    Derivatives are along tangent vectors at each configuration, as Pinocchio defines them. Those of a robot whose
    joints are all real numbers need no loop.

    Args:
        model: Pinocchio's model.
    """

    def __init__(self, model: pin.Model) -> None:
        super().__init__(model)
        self._real = model.nq == model.nv

    def displace_slopes(
        self, q: Float[Array, "n nq"], step: Float[Array, "n nv"], slopes: Float[Array, "n nv k"]
    ) -> None:
        """Turn derivatives of a tangent vector into those of ``integrate``, in place.

        The first nv columns are those by the configuration, which has derivatives of its own.
        """
        if self._real:
            slopes[:, range(self.nv), range(self.nv)] += 1.0
            return
        # Pinocchio has them for one configuration at a time; a stack of nodes needs a loop.
        both = self._each(pin.dIntegrate, q, step)
        slopes[:] = both[:, 1] @ slopes
        slopes[:, :, : self.nv] += both[:, 0]

    def difference_derivative(self, start: Float[Array, "n nq"], end: Float[Array, "n nq"]) -> Float[Array, "n nv nv"]:
        """Derivatives of ``difference`` by ``end``."""
        if self._real:
            return np.broadcast_to(np.eye(self.nv), (len(start), self.nv, self.nv))
        return self._each(pin.dDifference, start, end)[:, 1]

    def _each(self, function: Callable[..., object], first: Array, second: Array) -> Array:
        """Results of a function of Pinocchio for each pair of rows."""
        return np.array([function(self._model, *each) for each in zip(first, second, strict=True)])


class Nodes(NamedTuple):
    """States of n nodes."""

    q: Float[Array, "n nq"]
    w: Float[Array, "n nw"]
    """Reduced velocities; none, (n, 0), in the kinematic form."""


class StepDerivatives(NamedTuple):
    """Next states of n nodes, with derivatives along the tangent space: x (nv + nw), u, and the step h."""

    after: Nodes
    x: Float[Array, "n nx nx"]
    u: Float[Array, "n nx nu"]
    h: Float[Array, "n nx"]
    flow: StateDerivatives
    """Flow at the start of the steps."""


class ActionModel:
    """Action model of a reduced system.

    Args:
        reduced: the model.
        form: "kinematic", "acceleration" or "dynamic".

    Attributes:
        nv, nw, nx, nu: sizes of the tangent of q, of the velocity part of the state, of the whole state, and of the
            input.
        input_names: names of the inputs.
        parts: equal parts of a step, each by the midpoint rule.

    Example:
        >>> from rnc_pin.motion.planning.action_models import Nodes
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> model = rnc.optimal.ActionModel(reduced, "kinematic")
        >>> start = Nodes(robot.configuration()[None], np.empty((1, 0)))
        >>> model.step(start, np.array([[1.0, 0.0]]), np.array([0.5])).q[0]  # at 1 m/s for 0.5 s
        array([0.5, 0. , 1. , 0. ])
    """

    def __init__(self, reduced: ReducedModel, form: Form) -> None:
        self.reduced, self.form = reduced, form
        self.manifold = StateManifold(reduced.robot.model)
        self.nv, self.r = reduced.n, reduced.r
        self.nw = 0 if form == "kinematic" else reduced.r
        self.nx = self.nv + self.nw
        names = reduced.actuation.names if form == "dynamic" else reduced.reducing.names
        self.input_names = tuple(f"{name}_dot" if form == "acceleration" else name for name in names)
        self.nu = len(self.input_names)
        self.parts = 8 if form == "dynamic" else 1  # light links turn far while efforts are constant

    def flow(self, at: Nodes, u: Array) -> tuple[Array, Array]:
        """Velocity (n, nv) and acceleration (n, nw) at nodes."""
        v = self.reduced.at(at.q, self.velocity(at, u)).v
        return v, self.reduced.forward_dynamics(at.q, at.w, u) if self.form == "dynamic" else u[:, : self.nw]

    def flow_derivatives(self, at: Nodes, u: Array) -> StateDerivatives:
        """The same with derivatives; accelerations of the kinematic form mean nothing."""
        # Without efforts: the other forms read the derivatives of velocities alone.
        T = u if self.form == "dynamic" else np.zeros((len(at.q), self.reduced.p))
        return self._flow(state_derivatives(self.reduced, at.q, self.velocity(at, u), T), u)

    def _flow(self, found: StateDerivatives, u: Array) -> StateDerivatives:
        """Derivatives of the flow from those of the system."""
        if self.form != "acceleration":
            return found
        n, r, nv = found.v2_dot_q.shape
        by_u = np.broadcast_to(np.eye(r), (n, r, r))
        return replace(found, v2_dot=u, v2_dot_q=np.zeros((n, r, nv)), v2_dot_v2=np.zeros((n, r, r)), v2_dot_T=by_u)

    def velocity(self, at: Nodes, u: Array | None) -> Float[Array, "n r"]:
        """Reduced velocities at nodes."""
        if self.form != "kinematic":
            return at.w
        if u is None:
            raise ConfigurationError("form 'kinematic': the velocity is an input, so the last state has none")
        return u

    def step(self, at: Nodes, u: Array, h: Array) -> Nodes:
        """Next states of nodes after steps h (n,) [s]."""
        for _ in range(self.parts):
            at = self._midpoint_step(at, u, np.asarray(h) / self.parts)
        return at

    def rollout(self, at: Nodes, u: Float[Array, "n K nu"], h: float) -> tuple[Array, Array]:
        """Configurations (n, K + 1, nq) and velocities (n, K + 1, nw) of n motions from nodes.

        Args:
            at: starts.
            u: inputs, each for an equal time.
            h: this time [s].
        """
        found, times = [at], np.full(len(u), h)
        for inputs in np.swapaxes(u, 0, 1):
            found.append(self.step(found[-1], inputs, times))
        q, w = (np.stack(each, axis=1) for each in zip(*found, strict=True))
        return q, w

    def _midpoint_step(self, at: Nodes, u: Array, h: Array) -> Nodes:
        found = np.empty((len(at.q), at.q.shape[1] + at.w.shape[1]))
        calls, arrays = self.reduced.evaluator.calls, (*at, u, h)
        # The kernel has no errors of single nodes: where its numbers are not finite, the formulas name the singularity.
        if calls.planned_steps(FORMS.index(self.form), *map(_contiguous, arrays), found) and np.isfinite(found).all():
            return Nodes(found[:, : at.q.shape[1]], found[:, at.q.shape[1] :])
        h = h[:, None]
        v, a = self.flow(at, u)
        middle = Nodes(self.manifold.integrate(at.q, h / 2 * v), at.w + h / 2 * a)
        v, a = self.flow(middle, u)
        return Nodes(self.manifold.integrate(at.q, h * v), at.w + h * a)

    def during(self, nodes: Nodes, u: Array, h: float, t: float) -> tuple[Nodes, int]:
        """State (one node) of a motion with nodes (K + 1) and inputs (K, nu) at a time, and its interval.

        Args:
            nodes: states at the ends of the intervals.
            u: inputs.
            h: length of the intervals [s].
            t: time since the first node [s].
        """
        k = min(max(int(t / h + 1e-9), 0), len(u) - 1)  # at a node, rounding of t takes the interval that begins there
        start, since = Nodes(nodes.q[k : k + 1], nodes.w[k : k + 1]), t - k * h
        return self.step(start, u[k : k + 1], np.array([since])) if since > 1e-9 * h else start, k

    def step_derivatives(self, at: Nodes, u: Array, h: Array) -> StepDerivatives:
        """Next states of nodes after steps h (n,) [s], with derivatives."""
        found = self._midpoint_derivatives(at, u, np.asarray(h) / self.parts)
        # The chain rule over the parts; the input is constant, so that its derivatives add.
        for _ in range(1, self.parts):
            then = self._midpoint_derivatives(found.after, u, np.asarray(h) / self.parts)
            x, by_u, by_h = then.x @ found.x, then.x @ found.u + then.u, np.matvec(then.x, found.h) + then.h
            found = StepDerivatives(then.after, x, by_u, by_h, found.flow)
        return found._replace(h=found.h / self.parts)

    def _midpoint_derivatives(self, at: Nodes, u: Array, h: Array) -> StepDerivatives:
        nx, found = self.nx, self._compiled_derivatives(at, u, h)
        if found is not None:
            return found
        half, whole = h[:, None] / 2, h[:, None]
        first = self.flow_derivatives(at, u)
        shift = half * first.v
        middle = Nodes(self.manifold.integrate(at.q, shift), at.w + half * first.v2_dot[:, : self.nw])
        by_middle = self._displaced_slopes(at.q, shift, half, first, self._slopes(first))
        second = self.flow_derivatives(middle, u)
        by_state = self._slopes(second)
        slopes = by_state[:, :, :nx] @ by_middle
        slopes[:, :, nx:-1] += by_state[:, :, nx:-1]
        shift = whole * second.v
        out = self._displaced_slopes(at.q, shift, whole, second, slopes, 1.0)
        after = Nodes(self.manifold.integrate(at.q, shift), at.w + whole * second.v2_dot[:, : self.nw])
        return StepDerivatives(after, out[:, :, :nx], out[:, :, nx:-1], out[:, :, -1], first)

    def _compiled_derivatives(self, at: Nodes, u: Array, h: Array) -> StepDerivatives | None:
        """Derivatives of a step by one call of the kernel; None if the formulas have to decide."""
        kernel, (n, nq), nx = self.reduced.evaluator.kernel, at.q.shape, self.nx
        if kernel is None:
            return None
        flow, after = np.empty(n, kernel.derivatives), np.empty((n, nq + self.nw))
        out = np.empty((n, nx, nx + self.nu + 1))
        arrays = *map(_contiguous, (*at, u, h)), flow, after, out
        if not kernel.calls.planned_derivatives(FORMS.index(self.form), *arrays):
            return None
        names = kernel.derivatives.names or ()
        first = self._flow(StateDerivatives(**{name: flow[name] for name in names}, difference_error=0.0), u)
        states = Nodes(after[:, :nq], after[:, nq:])
        return StepDerivatives(states, out[:, :, :nx], out[:, :, nx:-1], out[:, :, -1], first)

    def _slopes(self, flow: StateDerivatives) -> Array:
        """Derivatives of velocity and acceleration (n, nx, nx + nu + 1) by state, input and step, which has none."""
        nv, nx = self.nv, self.nx
        out = np.zeros((len(flow.v), nx, nx + self.nu + 1))
        # In the kinematic form these are the columns of the input, in the others of the state: both follow those of q.
        columns = slice(nv, nv + self.r)  # of v2: a state, or the input
        out[:, :nv, :nv], out[:, :nv, columns] = flow.v_q, flow.v_v2
        if self.nw:
            out[:, nv:, :nv], out[:, nv:, columns] = flow.v2_dot_q, flow.v2_dot_v2
            out[:, nv:, nx:-1] = flow.v2_dot_T
        return out

    def _displaced_slopes(
        self, q: Array, shift: Array, h: Array, flow: StateDerivatives, slopes: Array, share: float = 0.5
    ) -> Array:
        """Derivatives of a state displaced by h times a flow, from those of the flow; h is a share of the step."""
        nv, nx = self.nv, self.nx
        slopes = h[:, :, None] * slopes
        slopes[:, :nv, -1] += share * flow.v
        slopes[:, nv:, -1] += share * flow.v2_dot[:, : self.nw]
        slopes[:, range(nv, nx), range(nv, nx)] += 1.0
        self.manifold.displace_slopes(q, shift, slopes[:, :nv])
        return slopes

    def difference(self, start: Nodes, end: Nodes) -> Float[Array, "n nx"]:
        """Tangent vectors that lead from some states to others."""
        return np.concatenate([self.manifold.difference(start.q, end.q), end.w - start.w], axis=1)

    def displaced(self, at: Nodes, by: Float[Array, "n nx"]) -> Nodes:
        """States displaced by tangent vectors."""
        return Nodes(self.manifold.integrate(at.q, by[:, : self.nv]), at.w + by[:, self.nv :])


def action_model(reduced: ReducedModel, form: str) -> ActionModel:
    """Return the action model of a form.

    Raises:
        ConfigurationError: unknown form, or the dynamic form of a system without actuators.
    """
    if form not in FORMS:
        raise ConfigurationError(f"form '{form}': expected one of {', '.join(FORMS)}{nearest(str(form), FORMS)}")
    if form == "dynamic" and not reduced.p:
        raise ConfigurationError("form 'dynamic': the system has no actuators; use 'acceleration' or 'kinematic'")
    return ActionModel(reduced, FORMS[FORMS.index(form)])


# ------------------------------------------------------------------ motions of the kinematic form


class Shots(NamedTuple):
    """Ends of motions from several starts, and derivatives of the tangent vectors there.

    Attributes:
        q: configurations (steps + 1, k, nq).
        by_start: derivatives (k, nv, nv) by the tangent vectors at the starts.
        by_input: derivatives (k, nv, r) by the inputs.
    """

    q: Float[Array, "n k nq"]
    by_start: Float[Array, "k nv nv"]
    by_input: Float[Array, "k nv r"]


class KinematicFlow:
    """Motions ``v = R(q) u``.

    Args:
        reduced: the model; no row prescribes a motion.
        planned: mask (nv,) of the velocities that u has in place of the reduced ones; all others follow from them.
    """

    def __init__(self, reduced: ReducedModel, planned: Bool[Array, " nv"] | None = None) -> None:
        self.reduced, self._model, self._planned = reduced, ActionModel(reduced, "kinematic"), planned
        self.manifold = self._model.manifold

    def step(self, q: Float[Array, "n nq"], u: Float[Array, "n k"]) -> Float[Array, "n nq"]:
        """Configurations after displacements u, by the commutator-free method of Celledoni, Marthinsen and Owren.

        Args:
            q: configurations.
            u: reduced velocities times durations.
        """
        move = self.manifold.integrate
        first = self.velocity(q, u)
        middle = move(q, 0.5 * first)
        second = self.velocity(middle, u)
        third = self.velocity(move(q, 0.5 * second), u)
        fourth = self.velocity(move(middle, third - 0.5 * first), u)
        both = 2.0 * (second + third)
        # Two exponentials in place of commutators: of fourth order on the manifold, so that fine steps can be long.
        halfway = move(q, (3.0 * first + both - fourth) / 12.0)
        return move(halfway, (-first + both + 3.0 * fourth) / 12.0)

    def along(self, q: Float[Array, "k nq"], u: Float[Array, "k r"], counts: Int[Array, " k"]) -> list[Array]:
        """Configurations (count + 1, nq) along each of k motions.

        Args:
            q: starts.
            u: displacements.
            counts: numbers of equal steps.
        """
        found, each = np.repeat(q[None], counts.max() + 1, axis=0), u / counts[:, None]
        for k in range(int(counts.max())):
            going = counts > k
            found[k + 1, going] = self.step(found[k, going], each[going])
        return [found[: count + 1, k] for k, count in enumerate(counts)]

    def shots(self, q: Float[Array, "k nq"], u: Float[Array, "k r"], steps: int) -> Shots:
        """Motions by the midpoint rule, with the exact derivatives of that rule.

        Args:
            q: starts.
            u: displacements.
            steps: number of equal steps.
        """
        each = u / steps
        places = np.swapaxes(self.coarse(q, np.repeat(each[:, None], steps, axis=1)), 0, 1)
        # Derivatives of all steps in one call; the product along each motion is cheap.
        starts = _standing(np.concatenate(places[:-1]))
        found = self._model.step_derivatives(starts, np.tile(each, (steps, 1)), np.ones(len(starts.q)))
        by_q, by_u = (part.reshape(steps, len(q), self.reduced.n, -1) for part in (found.x, found.u / steps))
        by_start, by_input = by_q[0], by_u[0]
        for k in range(1, steps):
            by_start, by_input = by_q[k] @ by_start, by_q[k] @ by_input + by_u[k]
        return Shots(places, by_start, by_input)

    def coarse(self, q: Float[Array, "n nq"], u: Float[Array, "n K r"]) -> Float[Array, "n K1 nq"]:
        """Configurations along displacements u one after the other, by the midpoint rule.

        Args:
            q: configurations.
            u: reduced velocities times durations.
        """
        return self._model.rollout(_standing(q), u, 1.0)[0]  # in one second, velocities are displacements

    def velocity(self, q: Float[Array, "n nq"], u: Float[Array, "n k"]) -> Float[Array, "n nv"]:
        """Velocities (n, nv) for u at configurations."""
        # Reduced velocities have their own basis; planned ones need a pseudoinverse, which costs more.
        if self._planned is None:
            return np.asarray(self.reduced.at(q, u).v)
        R = self.reduced.at(q).R
        return np.asarray(np.matvec(R @ np.linalg.pinv(R[:, self._planned]), u))


def _standing(q: Array) -> Nodes:
    """Nodes of the kinematic form."""
    return Nodes(q, np.empty((len(q), 0)))
