"""Pictures and videos of a recording from a headless browser: Playwright, Chromium and, for videos, ffmpeg."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.extras import missing_extra
from rnc_pin.io.atomic_write import atomic_file, atomic_folder

if TYPE_CHECKING:
    from rnc_pin.visualization.recording import Recording

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_FLAGS = (
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    "--disable-background-networking",
)
VIDEOS = (".mp4", ".gif")
_LONGEST_WAIT = 180_000  # [ms], timeout for a browser and its pages on a busy processor


@contextmanager
def browser() -> Iterator[Any]:
    """Start a headless Chromium under Playwright.

    Raises:
        ConfigurationError: Chromium or Playwright is not installed.
    """
    executable = next(filter(None, map(shutil.which, BROWSERS)), None)
    if executable is None:
        raise ConfigurationError(f"no browser: none of {', '.join(BROWSERS)} is installed")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise ConfigurationError(missing_extra("video")) from None
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=executable, args=list(_FLAGS), timeout=_LONGEST_WAIT)
        try:
            yield launched
        finally:
            launched.close()


def take_pictures(
    recording: Recording, times: Iterable[float], size: tuple[int, int] = (1280, 720), kind: str = "png"
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
        page.set_default_timeout(_LONGEST_WAIT)
        page.goto(path.as_uri())
        page.wait_for_function("window.ready === true")
        page.evaluate("document.body.classList.add('still')")
        quality = {} if kind == "png" else {"quality": 92}
        for time in times:
            page.evaluate(f"viewer.animator.seek({float(time)!r})")
            page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
            yield page.screenshot(type=kind, **quality)


def write_frames(
    recording: Recording,
    folder: str | Path,
    rate: float = 25.0,
    size: tuple[int, int] = (1280, 720),
    replace: bool = True,
) -> list[Path]:
    """Write one PNG per frame (``frame_00000.png``, ...) into a new or existing folder, after all are complete.

    Args:
        recording: recording to draw.
        folder: folder of the pictures.
        rate: frames per second.
        size: width and height [pixels].
        replace: True replaces files of the same names.

    Raises:
        OSError: a file cannot be written.
    """
    folder, names = Path(folder), []
    with atomic_folder(folder, replace) as staging:
        for k, picture in enumerate(take_pictures(recording, _times(recording, rate), size)):
            names.append(f"frame_{k:05d}.png")
            (staging / names[-1]).write_bytes(picture)
    return [folder / name for name in names]


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
        raise ConfigurationError(f"{path}: a video needs ffmpeg, which is not installed; frames do not need it")
    with atomic_file(path, replace) as partial:
        _encode(ffmpeg, path, partial, take_pictures(recording, _times(recording, rate), size, "jpeg"), rate)
    return path


def _encode(ffmpeg: str, path: Path, partial: Path, pictures: Iterable[bytes], rate: float) -> None:
    command = [ffmpeg, "-loglevel", "error", "-y", "-f", "image2pipe", "-framerate", f"{rate:g}", "-i", "-"]
    command += [*_encoding(path.suffix), str(partial.absolute())]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdin is not None
    assert process.stderr is not None
    try:
        for picture in pictures:
            process.stdin.write(picture)
        process.stdin.close()
        complaint = process.stderr.read().decode(errors="replace")
        if process.wait():
            raise ConfigurationError(f"{path}: ffmpeg: {' '.join(complaint.split()) or 'failed'}")
    except BrokenPipeError:
        complaint = process.stderr.read().decode(errors="replace")
        raise ConfigurationError(f"{path}: ffmpeg: {' '.join(complaint.split())}") from None
    finally:
        process.kill()
        process.wait()


def _encoding(suffix: str) -> Sequence[str]:
    if suffix == ".gif":
        palette = "split[a][b];[a]palettegen=max_colors=128[p];[b][p]paletteuse=dither=bayer:bayer_scale=4"
        return ["-vf", palette, "-loop", "0"]
    return ["-c:v", "libx264", "-preset", "medium", "-crf", "22", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]


def _times(recording: Recording, rate: float) -> np.ndarray:
    return np.arange(0.0, recording.duration + 0.5 / rate, 1.0 / rate).clip(max=recording.duration)
