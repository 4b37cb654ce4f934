"""Recording of a trajectory: one HTML page that plays offline, pictures and videos."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Literal

from rnc_pin.errors import ConfigurationError, InputError, missing_extra
from rnc_pin.io.json import atomic_file
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import ObjectSummary, SummaryMixin, items, significant
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import Trajectory
from rnc_pin.visualization.browser.scene_server import SceneWindow
from rnc_pin.visualization.drawn_state import RATE, DrawnModel, View, even_times, recorded_states
from rnc_pin.visualization.meshcat_scene import MeshcatScene
from rnc_pin.visualization.run_scene import RunScene

if TYPE_CHECKING:
    from playwright.sync_api import Browser


class Recording(SummaryMixin):
    """Animation that needs only a browser. A notebook shows it if it is the last line of a cell.

    Args:
        model: reduced model or robot; a reduced model also shows its constraints. A ``DrawnModel`` may
            have obstacles.
        trajectory: trajectory to play.
        view: view options.
        title: title of the page.
        comparisons: other runs of the same robot by label, shown as pale robots in the same place.

    Raises:
        ModelError: the robot has no geometry, or a frame of the view does not exist.
        InputError: a run has fewer than two samples, or belongs to another robot.
    """

    def __init__(
        self,
        model: DrawnModel | ReducedModel | Robot,
        trajectory: Trajectory,
        view: View | None = None,
        title: str = "rnc_pin",
        comparisons: Mapping[str, Trajectory] | None = None,
    ) -> None:
        others = dict(comparisons or {})
        drawn_model = DrawnModel.of(model)
        robot = drawn_model.robot
        for label, each in {title: trajectory, **others}.items():
            if each.q.shape[1] != robot.nq:
                raise InputError(f"'{label}': q has {each.q.shape[1]} entries, but nq of the robot is {robot.nq}")
            if len(each.time) < 2:
                raise InputError(f"'{label}': too few samples to play: {len(each.time)}, expected at least 2")
        # At the rate of the page and not of the run: a page holds 25 states for each second.
        states = list(recorded_states(robot, trajectory, RATE, list(others.values())))
        self.duration = float(trajectory.time[-1])
        self._scene = MeshcatScene(SceneWindow(title), RATE)
        run_scene = RunScene(drawn_model, trajectory.info, view or View(), self._scene, states[0], trajectory, others)
        frames, chips = [], []
        for self._scene.frame, state in enumerate(states):
            run_scene.update(state)
            values, colors = run_scene.overlay.values(state)
            # As many digits as the page shows.
            frames.append([significant(value, 4) for value in values])
            chips.append(colors)
        heading = title if title != "rnc_pin" else ""
        rows, legend = run_scene.overlay.labels(), run_scene.legend()
        self._scene.overlay(heading, rows, legend, frames=frames, chips=chips, rate=RATE)
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

    def _summary(self) -> ObjectSummary:
        title = f"Recording '{self._scene.window.title}': {self.duration:g} s at {RATE:g} pictures per second"
        use = "save(path) writes a page for a browser; a notebook shows it"
        return ObjectSummary(title, [("to see it", items([use]))])

    def _repr_html_(self) -> str:
        page = escape(self.html(), quote=True)
        return f'<iframe srcdoc="{page}" style="width: 100%; height: 480px; border: 0"></iframe>'


# ---------------------------------------------------------------------- pictures and videos


BROWSERS = ("chromium", "chromium-browser", "google-chrome")
VIDEOS = (".mp4", ".gif")
_TIMEOUT = 180_000  # [ms], timeout for a browser and its pages on a busy processor


@contextmanager
def browser() -> Iterator[Browser]:
    """Start a headless Chromium under Playwright.

    Raises:
        ConfigurationError: Chromium or Playwright is not installed.
    """
    # An installed browser is used, because Playwright's own download takes hundreds of megabytes.
    executable = next(filter(None, map(shutil.which, BROWSERS)), None)
    if executable is None:
        raise ConfigurationError(f"no browser: none of {', '.join(BROWSERS)} is installed")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise ConfigurationError(missing_extra("video")) from None
    # Software rendering: servers have no graphics processor, and pictures are equal on all computers.
    flags = (
        *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
        "--disable-background-networking",
    )
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=executable, args=list(flags), timeout=_TIMEOUT)
        try:
            yield launched
        finally:
            launched.close()


def take_pictures(
    recording: Recording,
    times: Iterable[float],
    size: tuple[int, int] = (1280, 720),
    kind: Literal["png", "jpeg"] = "png",
) -> Iterator[bytes]:
    """Take pictures of a recording at given times.

    Args:
        recording: recording to draw.
        times: times of the pictures [s].
        size: width and height [pixels].
        kind: "png" or "jpeg".

    Raises:
        ConfigurationError: Chromium or Playwright is not installed.
    """
    with TemporaryDirectory() as scratch, browser() as launched:
        path = Path(scratch) / "page.html"
        path.write_text(recording.html(begin=0.0), encoding="utf-8")
        page = launched.new_page(viewport={"width": size[0], "height": size[1]})
        page.set_default_timeout(_TIMEOUT)
        page.goto(path.as_uri())
        # Meshes are decoded by the page, which takes seconds for a large robot.
        page.wait_for_function("window.ready === true")
        page.evaluate("document.body.classList.add('still')")
        for time in times:
            page.evaluate(f"viewer.animator.seek({float(time)!r})")
            # Two frames: the first call runs before the scene is drawn, the second after it.
            page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
            yield page.screenshot(type=kind, quality=None if kind == "png" else 92)


def write_video(
    recording: Recording,
    path: str | Path,
    rate: float = 25.0,
    size: tuple[int, int] = (1280, 720),
    replace: bool = True,
) -> Path:
    """Write an MP4 or a GIF. A failure leaves no partial file.

    Args:
        recording: recording to draw.
        path: file name that ends in ``.mp4`` or ``.gif``.
        rate: frames per second.
        size: width and height [pixels], even numbers.
        replace: True replaces an existing file.

    Raises:
        ConfigurationError: the file name has another suffix, or ffmpeg, Chromium or Playwright is not installed.
        OSError: the file cannot be written.
    """
    path = Path(path)
    if path.suffix not in VIDEOS:
        raise ConfigurationError(f"{path}: expected a name that ends in {' or '.join(VIDEOS)}")
    ffmpeg = shutil.which("ffmpeg")
    if ffmpeg is None:
        raise ConfigurationError(f"{path}: a video needs ffmpeg, which is not installed")
    # A file that exists is replaced by a whole video only.
    with atomic_file(path, replace) as partial:
        pictures = take_pictures(recording, even_times(recording.duration, rate), size, "jpeg")
        _encode(ffmpeg, path, partial, pictures, rate)
    return path


def _encode(ffmpeg: str, path: Path, partial: Path, pictures: Iterable[bytes], rate: float) -> None:
    # Pictures go through a pipe: a long video needs no room for thousands of files.
    command = [ffmpeg, "-loglevel", "error", "-y", "-f", "image2pipe", "-framerate", f"{rate:g}", "-i", "-"]
    command += [*_encoding(path.suffix), str(partial.absolute())]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdin is not None
    try:
        # If ffmpeg ends early, its own message says why.
        with suppress(BrokenPipeError):
            for picture in pictures:
                process.stdin.write(picture)
        complaint = process.communicate()[1].decode(errors="replace")
    finally:
        # After the last byte it does nothing; an interrupted recording must not leave a process behind.
        process.kill()
        process.wait()
    if process.returncode:
        raise ConfigurationError(f"{path}: ffmpeg: {' '.join(complaint.split()) or 'failed'}")


def _encoding(suffix: str) -> Sequence[str]:
    if suffix == ".gif":
        # A GIF has 256 colours: a palette of this video in place of a general one.
        palette = "split[a][b];[a]palettegen=max_colors=128[p];[b][p]paletteuse=dither=bayer:bayer_scale=4"
        return ["-vf", palette, "-loop", "0"]
    # Browsers and most players read colours in this format only; with faststart a page plays before it has all bytes.
    return ["-c:v", "libx264", "-preset", "medium", "-crf", "22", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
