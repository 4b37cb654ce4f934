"""Recording of a trajectory as one HTML page that plays offline."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import Path

from rnc_pin.errors import InputError
from rnc_pin.io.atomic_write import atomic_file
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import significant
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import Trajectory
from rnc_pin.visualization.browser.drawing_commands import SceneWindow
from rnc_pin.visualization.drawn_model import DrawnModel
from rnc_pin.visualization.drawn_state import RATE, recorded_states
from rnc_pin.visualization.meshcat_scene import MeshcatScene
from rnc_pin.visualization.run_scene import RunScene, ShownRun
from rnc_pin.visualization.view import View


class Recording:
    """Animation that needs only a browser. A notebook shows it if it is the last line of a cell.

    Args:
        model: reduced model or robot; a reduced model also shows its constraints and null motion. A ``DrawnModel`` may
            have obstacles.
        trajectory: trajectory to play.
        view: view options.
        title: title of the page.
        comparisons: other runs of the same robot by label, shown as pale robots in the same place.
        aside: True places the compared runs beside the run, in their own colours.

    Raises:
        ModelError: the robot has no visual geometry, or a frame of the view does not exist.
        InputError: a run has fewer than two samples, or belongs to another robot.
    """

    def __init__(
        self,
        model: DrawnModel | ReducedModel | Robot,
        trajectory: Trajectory,
        view: View | None = None,
        title: str = "rnc_pin",
        comparisons: Mapping[str, Trajectory] | None = None,
        aside: bool = False,
    ) -> None:
        others = dict(comparisons or {})
        drawn_model = DrawnModel.of(model)
        robot = drawn_model.robot
        for label, each in {title: trajectory, **others}.items():
            if each.q.shape[1] != robot.nq:
                raise InputError(f"'{label}': q has {each.q.shape[1]} entries, but nq of the robot is {robot.nq}")
            if len(each.time) < 2:
                raise InputError(f"'{label}': too few samples to play: {len(each.time)}, expected at least 2")
        states = list(recorded_states(robot, trajectory, RATE, list(others.values())))
        shown = ShownRun(drawn_model, trajectory.info, trajectory.info.goals, trajectory, others, aside)
        self.duration = float(trajectory.time[-1])
        self._scene = MeshcatScene(SceneWindow(title), RATE)
        run_scene = RunScene(shown, view or View(), self._scene, states[0])
        frames, chips = [], []
        for self._scene.frame, state in enumerate(states):
            run_scene.update(state)
            values, colors = run_scene.overlay.values(state)
            frames.append([significant(value, 4) for value in values])
            chips.append(colors)
        heading = title if title != "rnc_pin" else ""
        self._scene.overlay(
            heading, run_scene.overlay.labels(), run_scene.legend(), frames=frames, chips=chips, rate=RATE
        )
        self._scene.play()

    def html(self, begin: float | None = None) -> str:
        """Return the HTML page.

        Args:
            begin: pause at this time [s]; by default the animation plays immediately.
        """
        return self._scene.window.page(begin)

    def save(self, path: str | Path, replace: bool = True) -> Path:
        """Write the HTML page. A failure leaves no partial file.

        Args:
            path: path of the page.
            replace: True replaces an existing file.

        Raises:
            OSError: the file cannot be written.
        """
        with atomic_file(Path(path), replace) as partial:
            partial.write_text(self.html(), encoding="utf-8")
        return Path(path)

    def _repr_html_(self) -> str:
        page = escape(self.html(), quote=True)
        return f'<iframe srcdoc="{page}" style="width: 100%; height: 480px; border: 0"></iframe>'
