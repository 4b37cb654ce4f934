"""Output folder of a run: marked as a folder of rnc_pin, locked while in use, without changes to other files."""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import TracebackType

import yaml

from rnc_pin.errors import ConfigurationError, few
from rnc_pin.io.json import dump_json
from rnc_pin.scenario import kept_files
from rnc_pin.scenario.kept_files import MARK, STAGING, Mark


class OutputFolder:
    """Folder for results.

    A run writes its results into a temporary subfolder. ``keep`` moves them into place when they are complete; earlier
    results remain until then. ``keep`` replaces or deletes only unchanged files of earlier runs. Only one run at a time
    can use the folder. Use it as a context manager, or call ``close``.

    Args:
        path: path of the folder.
        force: True to write into a folder that rnc_pin did not make, and to replace files with the same names.
        names: names of the results; without ``force`` no foreign file may have one of these names.

    Raises:
        ConfigurationError: the path is a file, cannot be created, is a foreign folder, or contains a changed file with
            the name of a result; or another run writes there.
    """

    def __init__(self, path: str | Path, force: bool = False, names: Sequence[str] = ()) -> None:
        self.path, self._force = Path(path), force
        self._names: list[str] = []
        self._new = Mark()
        self._lock: int | None = None
        self._staging: Path | None = None
        try:
            self._made = not self.path.exists()
            if not self._made and not self.path.is_dir():
                raise ConfigurationError(f"--out {self.path}: is a file, expected a folder")
            self.path.mkdir(parents=True, exist_ok=True)
            self._lock = _locked(self.path)
            self._marked = self._open(names)
            self._staging = Path(tempfile.mkdtemp(prefix=STAGING, dir=self.path))
        except OSError as error:
            self.close()
            raise ConfigurationError(f"--out {self.path}: cannot be written: {error.strerror}") from None
        except BaseException:
            self.close()
            raise

    def _open(self, names: Sequence[str]) -> bool:
        """Check the content of the folder. Return True if this call wrote the mark."""
        before = Mark.read(self.path)
        if before is None:
            if os.path.lexists(self.path / MARK):
                raise ConfigurationError(f"--out {self.path}: its {MARK} is not a regular file; choose another folder")
            if any(self.path.iterdir()) and not self._force:
                raise ConfigurationError(
                    f"--out {self.path}: exists and was not made by rnc-pin; choose another folder or add --force"
                )
        elif not self._force:
            self._refuse(list(dict.fromkeys([*kept_files.changed(self.path), *kept_files.changed(self.path, names)])))
        self._refuse([name for name in names if _is_folder(self.path / name) and not kept_files.is_folder_name(name)])
        kept_files.remove_leftovers(self.path)
        self._before = before or Mark()
        self._nothing_before = not any(
            os.path.lexists(self.path / name) for name in (*self._before.files, *self._before.folders, *names)
        )
        if before is None:
            self._before.write(self.path)
        return before is None

    def _refuse(self, changed: list[str]) -> None:
        if changed:
            raise ConfigurationError(
                f"--out {self.path}: {few(changed)} {'was' if len(changed) == 1 else 'were'} changed or not written by "
                "rnc-pin; choose another folder or add --force"
            )

    # ------------------------------------------------------------------ writing

    def file(self, name: str) -> Path:
        """Return the temporary path of a result file. ``keep`` moves it into the folder."""
        if not kept_files.is_file_name(name):
            raise ValueError(f"'{name}' is not a file name of a result")
        return self._place(name)

    def folder(self, name: str) -> Path:
        """Return the temporary path of a run's subfolder."""
        if not kept_files.is_folder_name(name):
            raise ValueError(f"'{name}' is not a folder name of a run")
        return self._place(name)

    def _place(self, name: str) -> Path:
        if self._staging is None:
            raise ValueError(f"{self.path} is closed")
        if not self._staging.is_dir():
            self._staging = self._made_again()
        if name not in self._names:
            self._names.append(name)
        return self._staging / name

    def _made_again(self) -> Path:
        """Create the folder again if it was removed during the run, so that later results are not lost."""
        assert self._lock is not None
        os.close(self._lock)
        self._lock = None
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._lock = _locked(self.path)
            self._before = Mark.read(self.path) or Mark()
            self._before.write(self.path)
            self._new, self._names, self._nothing_before = Mark(), [], False
            return Path(tempfile.mkdtemp(prefix=STAGING, dir=self.path))
        except OSError as error:
            raise ConfigurationError(f"--out {self.path}: cannot be written: {error.strerror}") from None

    def write_json(self, name: str, content: Mapping[str, object]) -> Path:
        """Write JSON."""
        path = self.file(name)
        path.write_text(dump_json(content) + "\n", encoding="utf-8")
        return path

    def write_yaml(self, name: str, content: Mapping[str, object]) -> Path:
        """Write YAML."""
        path = self.file(name)
        path.write_text(yaml.safe_dump(dict(content), sort_keys=False), encoding="utf-8")
        return path

    # ------------------------------------------------------------------ putting into place

    def keep_so_far(self, without: Collection[str] = ()) -> None:
        """Move the written results into place if the folder has no earlier results; otherwise do nothing.

        Args:
            without: names of unfinished results.
        """
        if self._nothing_before:
            self._put_into_place(without, removing=False)

    def keep(self, without: Collection[str] = ()) -> None:
        """Move the complete results into place, and delete other results of earlier runs.

        Args:
            without: names of incomplete results, which are dropped.

        Raises:
            ConfigurationError: a foreign file took the name of a result during the run, or the disk is full. The
                folder is unchanged.
        """
        self._put_into_place(without, removing=True)

    def _put_into_place(self, without: Collection[str], removing: bool) -> None:
        assert self._staging is not None
        try:
            done = [name for name in self._names if name not in without]
            written = [name for name in done if os.path.lexists(self._staging / name)]
            self._check(self._staging, written)
            folders = [name for name in written if kept_files.is_folder_name(name)]
            files = {name: [kept_files.fingerprint(self._staging / name)] for name in written if name not in folders}
            record = Mark(files, folders)
            (self._before | self._new | record).write(self.path)  # complete even if this is interrupted
            for name in written:
                _move(self._staging / name, self.path / name)
            self._new = Mark({**self._new.files, **files}, list(dict.fromkeys([*self._new.folders, *folders])))
            if removing:
                earlier = [*self._before.files, *self._before.folders]
                kept_files.remove_kept(self.path, self._before, [name for name in earlier if name not in self._known()])
                self._before = Mark()
                self._new.write(self.path)
        except OSError as error:
            raise ConfigurationError(f"--out {self.path}: cannot be written: {error.strerror}") from None

    def _known(self) -> set[str]:
        return {*self._new.files, *self._new.folders}

    def _check(self, staging: Path, written: list[str]) -> None:
        """Refuse to replace foreign files that appeared during the run."""
        known = self._before | self._new
        for name in written:
            there = self.path / name
            inside = (Mark.read(staging / name) or Mark()).files if kept_files.is_folder_name(name) else {}
            if not os.path.lexists(there) or (
                kept_files.is_kept(self.path, name, known) and not kept_files.changed(there, inside)
            ):
                continue
            if not self._force or _is_folder(there) is not kept_files.is_folder_name(name):
                aside = self.path / f"results_{staging.name.removeprefix(STAGING)}"
                staging.rename(aside)
                self._staging = None
                raise ConfigurationError(
                    f"--out {self.path}: {name} was changed during the run; the results are in {aside}"
                )

    # ------------------------------------------------------------------ the end

    def close(self) -> None:
        """Delete results that were not kept, and unlock the folder."""
        if self._lock is None:
            return
        try:
            if self._staging is not None and self._staging.is_dir():
                kept_files.remove_staging(self._staging)
                if self._marked and not self._known():
                    (self.path / MARK).unlink(missing_ok=True)
                    if self._made and not any(self.path.iterdir()):
                        self.path.rmdir()
        finally:
            os.close(self._lock)
            self._lock = self._staging = None

    def __enter__(self) -> OutputFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _move(source: Path, target: Path) -> None:
    """Move a file or a run's folder into place. If the folder exists, move its files one by one."""
    if source.is_dir() and _is_folder(target):
        before, new = Mark.read(target) or Mark(), Mark.read(source) or Mark()
        (before | new).write(target)
        for name in new.files:
            os.replace(source / name, target / name)
        kept_files.remove_kept(target, before, [name for name in before.files if name not in new.files])
        new.write(target)
    else:
        if source.is_dir() and os.path.lexists(target):  # with force, the target is not a folder
            target.unlink()
        os.replace(source, target)


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _locked(folder: Path) -> int:
    """Open and lock a folder until it is closed. The operating system releases the lock when the process ends."""
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
