"""Compiled kernel of a reduction: its tables, and the records that it fills; ``_kernel/kernel.c`` has the formulas."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin._kernel.kernel_rows import INTEGERS, NUMBERS, AttachedFrame, Form, KernelForce, KernelRow, Value, attached
from rnc_pin.math.linear_algebra import Component
from rnc_pin.model.cached_property import once_per_model
from rnc_pin.model.kinematics import Kinematics, moving_entries
from rnc_pin.model.reduction_data import ReductionData
from rnc_pin.model.rows import OutputRows, OutputStack, Place, RowStack

_ROW = np.dtype([("integers", np.int64, 3 + INTEGERS), ("numbers", float, NUMBERS)])  # as the kernel stores them
_FRAME = np.dtype([("joint", np.int64), ("placement", float, 12)])
_CURVED = {"JointModelPlanar": 0, "JointModelSpherical": 1, "JointModelFreeFlyer": 2}


class _Workspace:
    """Pinocchio data with views of its memory, and tables of the joints, for all evaluators of one ``Kinematics``.

    Each call of the kernel sets the state first, so evaluators can share the data.
    """

    def __init__(self, model: pin.Model) -> None:
        n, joints = model.nv, model.njoints
        pinocchio = model.createData()
        # Columns of a joint's Jacobian that are not zero; the kernel skips the others.
        moved = [moving_entries(model, joint) for joint in range(joints)]
        q, v, acceleration = pin.neutral(model), np.zeros(n), np.zeros(n)
        matrices = (pinocchio.M, (n, n)), (pinocchio.J, (6, n)), (pinocchio.nle, (n,)), (pinocchio.C, (n, n))
        by_rows = (each.reshape((n, n)).T for each in (pinocchio.dtau_dq, pinocchio.dtau_dv))
        placed = _placements(pinocchio, joints)
        self.views = (*(_view(*each) for each in matrices), placed, q, v, acceleration, *by_rows)
        # In the order in which the kernel stores them.
        state = model, pinocchio, q, v, pin.Convention.WORLD
        functions = pin.crba, pin.nonLinearEffects, pin.computeCoriolisMatrix, pin.isNormalized, 1e-6
        self.references = (*state, *functions, np.empty, pin.integrate, acceleration, pin.computeRNEADerivatives)
        self.ends = np.cumsum([0, *map(len, moved)], dtype=np.int64)
        self.entries = np.array([entry for entries in moved for entry in entries], np.int64)
        curved = curved_joints(model)
        kinds = [(_CURVED[kind], where.start) for kind, where in curved or ()]
        self.curved = None if curved is None else np.array(kinds, dtype=np.int64).reshape(-1, 2)


@once_per_model  # views of Pinocchio's memory take as long to make as the rest of a kernel
def _workspace(kinematics: Kinematics) -> _Workspace:
    return _Workspace(kinematics.model)


def _described(stack: RowStack, model: pin.Model) -> tuple[RowStack, list[KernelRow]]:
    """Rows that Python evaluates, and the descriptions of all rows of a stack for the kernel."""
    external: list[Place] = []
    rows: list[KernelRow] = []
    count = 0
    for place in stack.places:
        found = place.block.kernel_rows(model)
        chosen = place.of(np.arange(len(place.block.names)))
        if found is None:
            # Python writes these rows one after the other into the array that the call gets.
            external.append(place)
            rows += [KernelRow(Form.EXTERNAL, (), (count + k,)) for k in range(len(chosen))]
            count += len(chosen)
        else:
            rows += [found[k] for k in chosen]
    return RowStack.of(external), rows


def _valued_by_python(stack: OutputStack, rows: Sequence[KernelRow]) -> list[tuple[OutputRows, slice]]:
    """Blocks of outputs whose values Python evaluates, from the descriptions of all rows."""
    blocks = ((block, where) for block, where, _ in stack.places if isinstance(block, OutputRows) and not block.quasi)
    return [(block, where) for block, where in blocks if rows[where.start].value[0] == Value.NONE]


def _tables(rows: Sequence[KernelRow]) -> tuple[Array, Array]:
    """Rows and their frames as the kernel stores them."""
    table = np.zeros(len(rows), _ROW)
    table["integers"][:, 2] = -1  # no second frame
    frames: dict[AttachedFrame, int] = {}
    for row, integers, numbers in zip(rows, table["integers"], table["numbers"], strict=True):
        integers[0], integers[1] = row.form, row.joint
        integers[7], integers[6] = row.value
        integers[3 : 3 + len(row.integers)], numbers[: len(row.numbers)] = row.integers, row.numbers
        for place, frame in enumerate(row.frames):
            # Rows of one wheel share its frame: the kernel computes its Jacobian once.
            integers[1 + place] = frames.setdefault(frame, len(frames))
    return table, np.array(list(frames), _FRAME)


def curved_joints(model: pin.Model) -> list[tuple[str, slice]] | None:
    """Kind and entries of v of each joint with curved coordinates; None if the exponential of a joint is unknown.

    Args:
        model: Pinocchio's model of the robot.
    """
    found = []
    for joint in list(model.joints)[1:]:
        if joint.shortname() in _CURVED:
            found.append((joint.shortname(), slice(joint.idx_v, joint.idx_v + joint.nv)))
        # Of translations and single joints the coordinates are the tangent space itself. Other joints, such as
        # universal ones, are left to Pinocchio.
        elif joint.nv > 1 and joint.shortname() != "JointModelTranslation":
            return None
    return found


def _view(array: Array, shape: tuple[int, ...]) -> Array:
    """Pinocchio's memory in a shape; Pinocchio returns matrices with one column as vectors."""
    # The kernel reads addresses: a copy would never change with the state.
    view = array.reshape(shape, order="F")
    if not np.shares_memory(view, array):
        raise ValueError("Pinocchio's matrices are not stored by columns")
    return view


def _placements(data: pin.Data, joints: int) -> Array:
    """Placements of all joints (12, joints): rotation by columns, then translation."""
    first = data.oMi[0].rotation
    for joint in range(joints):
        place = data.oMi[joint]
        rotation, translation = place.rotation, place.translation
        # Twelve doubles each, one after the other: rotation by columns, then translation.
        where = first.ctypes.data + 96 * joint
        if rotation.strides != (8, 24) or (rotation.ctypes.data, translation.ctypes.data) != (where, where + 72):
            raise ValueError("Pinocchio's placements are not stored one after the other")
    return np.lib.stride_tricks.as_strided(first, (12, joints), (8, 96))


class ReductionKernel:
    """Kernel for the rows, outputs and actuators of a reduction.

    Args:
        data: the reduction.

    Raises:
        ValueError: Pinocchio's data have a memory layout that the kernel does not know.

    Attributes:
        calls: evaluator of the library; each call returns False or None if NumPy has to evaluate the states.
        external, external_vertical: rows of E and of J1 that Python evaluates.
        python_rows: True if there are some.
        python_values: blocks of reducing and of vertical outputs whose values Python evaluates.
        measures: True if one call evaluates all rows and values.
        fused: True if the kernel knows all rows of E, all inputs and all forces.
        kinematics, inverse, rows, biases, rates, terms, sample, derivatives: types of records.
    """

    def __init__(self, data: ReductionData) -> None:
        self.data, model = data, data.robot.model
        self.external, stacked = _described(data.stack, model)
        self.external_vertical, vertical = _described(data.vertical, model)
        self.python_rows = bool(self.external.size or self.external_vertical.size)
        self._mu = [row.rate for row in stacked[: data.m]]
        timed = [place for place in data.constraints.places if place.block.rheonomic]
        self._driven = [place for place in timed if place.block.kernel_rows(model) is not None]
        self.has_inputs, passive = data.actuation.parts is not None, data.forces.kernel_forces()
        self.fused = self.has_inputs and not self.external.size and passive is not None
        self.calls = self._evaluator([*stacked, *vertical], passive if self.fused and passive is not None else [])
        n, r, k, p = data.n, data.r, data.vertical.size, data.p
        kinematics = {"M": (n, n), "J": (6, n), "placements": (data.robot.model.njoints, 12)}
        inverse = {"E": (n, n), "E_inverse": (n, n)}
        rows = {"J1": (k, n), "A_star": (k, r)}
        biases = {"nonlinear_effects": (n,), "gamma": (n,), "E_inverse_gamma": (n,), "motion_force": (n,), "H": (r, r)}
        velocities = {"row_velocities": (n,), "v1": (k,)}
        rates = {"E_dot": (n, n), "R_dot": (n, r), **rows, "J1_dot": (k, n), "A_star_dot": (k, r), **velocities}
        coriolis = {"C": (n, n), "V": (r, r), "g": (n,), "G": (r,)}
        forces = {"bias": (n,), "H": (r, r), "B": (n, p), "input_matrix": (r, p), "b": (n,), "b_dot": (n,)}
        self.kinematics, self.inverse, self.rows = _record(**kinematics), _record(**inverse), _record(**rows)
        self.biases, self.rates = _record(**biases), _record(**rates)
        self.terms = _record(**kinematics, **inverse, v=(n,), **rates, **coriolis, **forces)
        states = [(f"{name}{end}", getattr(self, name)) for end in ("", "_end") for name in ("kinematics", "inverse")]
        motion = {"q": (data.robot.nq,), "q_end": (data.robot.nq,), **biases, "v": (n,), "v2": (r,), "B": (n, p)}
        numbers = {**motion, "effects": (r, p), "adverse": (r,), "inputs": (p, p)}
        self.sample = np.dtype([*states, *((name, float, shape) for name, shape in numbers.items())])
        by = {"v_q": (n, n), "v_v2": (n, r), "v2_dot_q": (r, n), "v2_dot_v2": (r, r), "v2_dot_T": (r, p)}
        self.derivatives = _record(v=(n,), v2_dot=(r,), **by)
        outputs = (data.reducing, stacked[data.m :]), (data.vertical, vertical)
        self.python_values = tuple(_valued_by_python(*each) for each in outputs)
        self.measures = not (self.python_rows or any(self.python_values))

    def _evaluator(
        self, rows: Sequence[KernelRow], passive: Sequence[tuple[KernelRow, KernelForce]]
    ) -> _kernel.library.Evaluator:
        """The kernel's object, for rows of E and J1 and for passive forces."""
        data, robot, workspace = self.data, self.data.robot, _workspace(self.data.kinematics)
        constant, inputs = data.actuation.parts or (np.zeros((data.n, data.p)), [])
        # A force along an own axis of a frame is a wrench on it, as that of a constraint row.
        units = np.eye(6)
        forces = [KernelRow(Form.OWN, (attached(robot.model, frame),), (), units[row]) for _, frame, row in inputs]
        every = [*rows, *forces, *(row for row, _ in passive)]
        self._rows, frames = _tables(every)
        sizes = robot.nq, data.n, data.m, data.vertical.size, data.p, robot.model.njoints, len(frames)
        external = self.external.size, self.external_vertical.size, len(every), len(workspace.entries)
        layout = (*sizes, *external, robot.nq != robot.nv, self.fused, data.rheonomic, len(passive))
        columns = np.array([column for column, _, _ in inputs], dtype=np.int64)
        tables = self._rows, columns, frames, workspace.ends, workspace.entries
        zero = np.zeros(data.n)
        constants = np.array([zero if row.constant is None else row.constant for row in every])
        # At the time of a frozen model.
        rates = self.rates_over_time([data.kinematics.time or 0.0]) if data.affine else None
        matrices = constants, np.ascontiguousarray(constant), rates, np.ascontiguousarray(data.lengths)
        laws = np.array([law for _, law in passive], dtype=float).reshape(-1, len(KernelForce._fields))
        limits = data.fast_length, data.fast_limit
        shared = workspace.references, workspace.views
        return _kernel.library.Evaluator(layout, *shared, *tables, *matrices, workspace.curved, laws, *limits)

    def refresh(self) -> None:
        """Read the numbers of the constraint rows again, after a parameter of one changed."""
        _, rows = _described(self.data.constraints, self.data.robot.model)
        numbers = np.array(self._rows["numbers"])
        for row, each in zip(rows, numbers, strict=False):  # they come first
            each[: len(row.numbers)] = row.numbers
        self.calls.set_numbers(numbers)

    def rates_over_time(self, times: Sequence[float]) -> Array:
        """Right-hand sides mu at times (s,), then their rates over time, (s, 2 m); zero for moving ground.

        Args:
            times: times (s,) [s].
        """
        found = np.zeros((len(times), 2, self.data.m))
        found[:, 0] = self._mu
        for t, rates in zip(times, found, strict=True):
            for place in self._driven:
                for rate, values in zip(rates, place.block.rates_over_time(t), strict=True):
                    rate[place.where] = place.of(values)
        return found.reshape(len(times), -1)

    def rates_at(self, t: Component | None, batch: tuple[int, ...] = ()) -> Array | None:
        """Argument (..., 2 m) of a call: ``rates_over_time`` of states (...) at times t; None without such rows.

        Args:
            t: times (...) [s].
            batch: leading axes of the states.
        """
        if t is None or not self._driven:
            return None
        # One time for all states is evaluated once.
        rates = self.rates_over_time(np.ravel(t).tolist()).reshape(*np.shape(t), -1)
        return np.ascontiguousarray(np.broadcast_to(rates, (*batch, rates.shape[-1])))


@lru_cache(maxsize=256)  # NumPy takes long to make one, and each chart of a run has the same
def _record(**fields: tuple[int, ...]) -> np.dtype[np.void]:
    """Type of a record of arrays, one after the other."""
    return np.dtype([(name, float, shape) for name, shape in fields.items()])
