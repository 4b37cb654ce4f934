"""Output folder of a run: which files a run may replace, and how its results get there; output files of commands.

The manifest of a folder lists the files that runs wrote there, and may therefore replace and delete. It can come from
an untrusted archive or repository. So an entry counts only if its file has a name that runs use, is a regular file
on the folder's device, and has the recorded content. No link is followed.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import os.path
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from rnc_pin.errors import ConfigurationError, few
from rnc_pin.io import TEMPORARY_PREFIX, atomic_file, open_regular

MANIFEST = ".rnc_pin"
is_result = re.compile(
    r"trajectory(_\w+)?\.npz|plan\.npz|summary\.json|commands\.json|scenario\.yaml|animation\.html|[^/\0]+\.(png|pdf|svg)"
    r"|calibration\.json|comparison\.json|mapping\.yaml|robot\.urdf"
).fullmatch
"""Match of a file name; None if runs write no files of this name."""
_MAX_SIZE = 64_000_000  # [bytes]


class Manifest:
    """Files of an output folder that runs wrote, with the SHA-256 of their content.

    Args:
        folder: the output folder.
        digests: SHA-256 by name; several of a file that a run is just replacing.
    """

    def __init__(self, folder: Path, digests: Mapping[str, list[str]] | None = None) -> None:
        self.folder, self.digests = folder, dict(digests or {})

    @classmethod
    def read(cls, folder: Path) -> Manifest | None:
        """Read the manifest of a folder; None if there is none, empty if it is invalid.

        Args:
            folder: the output folder.
        """
        try:
            with open_regular(folder / MANIFEST, follow_links=False) as file:
                files = json.loads(file.read(_MAX_SIZE))["files"]
            # A manifest of a stranger may name any file: only names that runs use count, and only texts as digests.
            digests = {name: [each for each in files[name] if isinstance(each, str)] for name in files}
            return cls(folder, {name: found for name, found in digests.items() if is_result(name)})
        except OSError:
            return None
        except (ValueError, KeyError, TypeError, RecursionError):
            return cls(folder)  # it owns nothing, so that nothing is deleted

    def write(self) -> None:
        """Replace the manifest in the folder. A kill while it is written leaves the old one whole."""
        with atomic_file(self.folder / MANIFEST) as partial:
            partial.write_text(json.dumps({"files": self.digests}) + "\n", encoding="utf-8")

    def owns(self, name: str) -> bool:
        """True if a run wrote the file and it is unchanged.

        Args:
            name: name of the file.
        """
        path = self.folder / name
        try:
            return (
                name in self.digests
                and not self.folder.is_symlink()
                # A file on another device is a mount: a run never put it there.
                and path.lstat().st_dev == self.folder.stat().st_dev
                and digest(path) in self.digests[name]
            )
        except OSError:
            return False


def digest(path: Path) -> str:
    """Return the SHA-256 of a regular file.

    Args:
        path: path of the file.

    Raises:
        OSError: the file cannot be read, or is a link.
    """
    with open_regular(path, follow_links=False) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


class OutputFolder:
    """Folder for results, as a context.

    Results are written into a fresh folder inside, and ``keep`` moves them into place when they are complete. Earlier
    results remain until then. Only one run at a time can use the folder.

    A run may replace and delete the unchanged results of earlier runs, and nothing else. With ``force`` it may also
    replace files and links with the names of its results.

    Args:
        path: path of the folder.
        force: True to write into a folder that rnc_pin did not make, and to replace files of the same names.
        names: names of all files that the run can write.

    Attributes:
        path: path of the folder.
        fresh: folder for the results until they are in place; ``writing`` makes it again if it is gone.

    Raises:
        ConfigurationError: the path is a file, cannot be created, is a foreign folder, or contains a file that the run
            would write but may not replace; or another run writes there.
    """

    def __init__(self, path: str | Path, force: bool = False, names: Sequence[str] = ()) -> None:
        self.path, self._force = Path(path), force
        self._kept: dict[str, list[str]] = {}
        self._lock: int | None = None
        self._made_manifest = False
        self.fresh = self.path / f"{TEMPORARY_PREFIX}{secrets.token_hex(4)}"
        try:
            with one_line_errors(f"--out {self.path}"):
                self._created = not self.path.exists()
                # Locked before its content is read: another run may be writing.
                self._lock = lock_folder(self.path)
                earlier = self._admit(names)
                self._had_results = any(os.path.lexists(self.path / name) for name in (*earlier.digests, *names))
                self.fresh.mkdir()
                if not os.path.lexists(self.path / MANIFEST):
                    earlier.write()
                    self._made_manifest = True
        except BaseException:  # Ctrl-C too: a folder that was just made would stay locked and empty
            self.close()
            raise

    def _admit(self, names: Sequence[str]) -> Manifest:
        """Check the content of the folder before the run, and delete the fresh folders of killed runs."""
        manifest = Manifest.read(self.path)
        if manifest is None:
            if os.path.lexists(self.path / MANIFEST):
                raise ConfigurationError(f"--out {self.path}: its {MANIFEST} is no regular file; choose another folder")
            if not self._force and any(self.path.iterdir()):
                raise ConfigurationError(
                    f"--out {self.path}: exists and was not made by rnc-pin; choose another folder or add --force"
                )
            manifest = Manifest(self.path)
        if foreign := self._foreign(names, manifest):
            hint = "choose another folder or add --force"
            raise ConfigurationError(f"--out {self.path}: {foreign} changed or not written by rnc-pin; {hint}")
        # Only after the checks, and under the lock: no living run has such a folder here.
        for leftover in self.path.glob(f"{TEMPORARY_PREFIX}*"):  # of a run that was killed
            shutil.rmtree(leftover) if _is_folder(leftover) else leftover.unlink()
        return manifest

    def _foreign(self, names: Iterable[str], manifest: Manifest) -> str:
        """Names of files that are there and may not be replaced, with "was" or "were"; empty if there are none."""
        there = (name for name in names if os.path.lexists(self.path / name) and not manifest.owns(name))
        found = [name for name in there if not self._force or _is_folder(self.path / name)]
        return f"{few(found)} {'was' if len(found) == 1 else 'were'}" if found else ""

    @contextmanager
    def writing(self) -> Iterator[Path]:
        """Yield the fresh folder for results.

        Raises:
            ConfigurationError: instead of an OSError inside.
        """
        with one_line_errors(f"--out {self.path}"):
            self.fresh.mkdir(parents=True, exist_ok=True)  # again if somebody removed it meanwhile
            yield self.fresh

    # ------------------------------------------------------------------ putting into place

    def keep_so_far(self) -> None:
        """Move the results into place if the folder had no earlier ones; otherwise do nothing."""
        if not self._had_results:  # earlier results stay until the new ones are complete
            self._move()

    def keep(self) -> None:
        """Move the complete results into place, and delete other results of earlier runs.

        Raises:
            ConfigurationError: during the run, something that may not be replaced took the name of a result, or the
                disk is full. The folder is unchanged.
        """
        earlier = self._move()
        # Files that this run did not write are of an earlier one: beside the new results they would mislead.
        with self.writing():
            for name in earlier.digests.keys() - self._kept:
                if earlier.owns(name):
                    (self.path / name).unlink()
            Manifest(self.path, self._kept).write()

    def _move(self) -> Manifest:
        """Move the results into place. Return the manifest from before."""
        with self.writing() as fresh:
            staged = {path.name: path for path in sorted(fresh.iterdir())}
            new = {name: [digest(path)] for name, path in staged.items() if is_result(name)}
            # Read again: another program may have changed files during the run.
            earlier = Manifest.read(self.path) or Manifest(self.path)
            if foreign := self._foreign(new, earlier):
                # The run is over and may have taken hours: its results are kept under another name.
                aside = self.path / f"results_{fresh.name.removeprefix(TEMPORARY_PREFIX)}"
                fresh.rename(aside)
                raise ConfigurationError(
                    f"--out {self.path}: {foreign} changed during the run; the results are in {aside}"
                )
            # Further contents of the same files: it holds whether or not a kill interrupts the moves.
            both = {name: [*earlier.digests.get(name, ()), *found] for name, found in new.items()}
            Manifest(self.path, {**earlier.digests, **both}).write()
            for name in new:
                os.replace(staged[name], self.path / name)
            self._kept |= new
            return earlier

    # ------------------------------------------------------------------ the end

    def close(self) -> None:
        """Delete results that were not kept, and unlock the folder."""
        if self._lock is None:
            return
        shutil.rmtree(self.fresh, ignore_errors=True)
        # As it was before: a manifest without results would make a foreign folder ours.
        if self._made_manifest and not self._kept:
            (self.path / MANIFEST).unlink(missing_ok=True)
        if self._created:
            with suppress(OSError):  # not empty
                self.path.rmdir()
        os.close(self._lock)  # releases the lock
        self._lock = None

    def __enter__(self) -> OutputFolder:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def lock_folder(folder: Path) -> int:
    """Open and lock a folder until it is closed. The operating system releases the lock when the process ends.

    Args:
        folder: the folder, created with its parents.

    Raises:
        ConfigurationError: the path is a file, or another process has locked the folder.
    """
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(f"--out {folder}: is a file, expected a folder")
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise ConfigurationError(
            f"--out {folder}: another run is writing there; wait for it or choose another folder"
        ) from None
    except OSError:
        pass  # some network file systems cannot lock folders
    return descriptor


@contextmanager
def one_line_errors(place: str | None = None) -> Iterator[None]:
    """Raise ConfigurationError in place of an OSError inside, with its place; by default the file.

    Args:
        place: place for the message, such as an option with its path.
    """
    try:
        yield
    except OSError as error:
        if place is None and error.filename is None:
            print(flush=True)  # this fails again if standard output is full, and no file
        what = place or error.filename or "a file"
        raise ConfigurationError(f"{what}: cannot be written: {error.strerror}") from None


def check_new_file(option: str, path: Path, force: bool) -> None:
    """Check that a file can be written, before its content is computed.

    Args:
        option: option that names the file, for messages.
        path: path of the file.
        force: True to replace an existing file.

    Raises:
        ConfigurationError: the path is a folder, its folder does not exist, or the file exists without ``force``.
            Devices and pipes are never replaced.
    """
    if os.path.isdir(path) or not path.name:
        raise ConfigurationError(f"{option} {path}: is a folder, expected a file")
    if os.path.lexists(path) and not force:  # broken links count too
        raise ConfigurationError(f"{option} {path}: exists; choose another name or add --force")
    if os.path.exists(path) and not os.path.isfile(path):
        raise ConfigurationError(f"{option} {path}: is not a regular file; choose another name")
    if not os.path.isdir(path.absolute().parent):
        raise ConfigurationError(f"{option} {path}: folder {path.absolute().parent} does not exist")
