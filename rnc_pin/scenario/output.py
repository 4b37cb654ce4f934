"""The folder a run writes: marked as ours, locked while it is written, and nothing of anybody else's touched."""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import TracebackType

import yaml

from rnc_pin.errors import ConfigurationError, few
from rnc_pin.plain import json_text
from rnc_pin.scenario import kept_files
from rnc_pin.scenario.kept_files import MARK, STAGING, Mark


class OutputFolder:
    """A folder for results.

    Results are written into a fresh folder inside and put into place when they are complete; until then what was there
    before stays. Then what an earlier run wrote and nobody changed since is replaced or deleted, and nothing else is.
    One run at a time has the folder. Use it as a context, or call ``close``.

    Args:
        path: of the folder.
        force: write into a folder that is not ours, and replace files of the same names.
        names: of what will be written; without ``force`` nothing of somebody else's may stand there.

    Raises:
        ConfigurationError: the path is a file, cannot be made, is somebody else's folder, holds a changed file in the
            place of a result, or another run is writing there.
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
        """Look at what is there; whether a mark was made."""
        before = Mark.read(self.path)
        if before is None:
            if os.path.lexists(self.path / MARK):
                raise ConfigurationError(f"--out {self.path}: its {MARK} is no plain file; choose another folder")
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
                f"--out {self.path}: {few(changed)} {'is' if len(changed) == 1 else 'are'} not as a run of rnc-pin "
                "left it; choose another folder or add --force"
            )

    # ------------------------------------------------------------------ writing

    def file(self, name: str) -> Path:
        """Where to write a file of this name; it stands in the folder once it is kept."""
        if not kept_files.is_file_name(name):
            raise ValueError(f"'{name}' is no name of a result")
        return self._place(name)

    def folder(self, name: str) -> Path:
        """Where a run inside this one may write."""
        if not kept_files.is_folder_name(name):
            raise ValueError(f"'{name}' is no name of a run's folder")
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
        """Where to write if somebody removed the folder meanwhile: what a run has reached is not lost by that."""
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
        path.write_text(json_text(content) + "\n", encoding="utf-8")
        return path

    def write_yaml(self, name: str, content: Mapping[str, object]) -> Path:
        """Write YAML."""
        path = self.file(name)
        path.write_text(yaml.safe_dump(dict(content), sort_keys=False), encoding="utf-8")
        return path

    # ------------------------------------------------------------------ putting into place

    def keep_so_far(self, without: Collection[str] = ()) -> None:
        """Put into place what is written, where that replaces nothing; else it waits for ``keep``.

        Args:
            without: names of what is still being written.
        """
        if self._nothing_before:
            self._put_into_place(without, removing=False)

    def keep(self, without: Collection[str] = ()) -> None:
        """Put the results into place: they are complete. What an earlier run wrote and this one did not is deleted.

        Args:
            without: names of what was not completed, and is dropped.

        Raises:
            ConfigurationError: somebody put something in the place of a result meanwhile, or there is no room; the
                folder is as it was.
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
            (self._before | self._new | record).write(self.path)  # whatever ends this half-way, all of it is known
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
        """See to it that nothing of anybody else's is replaced, which may have come while the run went on."""
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
                    f"--out {self.path}: {name} is somebody else's by now; the results are in {aside}"
                )

    # ------------------------------------------------------------------ the end

    def close(self) -> None:
        """Delete what was not kept, and let others have the folder."""
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
    """Put a file or a run's folder into place; into a folder that is there, file by file."""
    if source.is_dir() and _is_folder(target):
        before, new = Mark.read(target) or Mark(), Mark.read(source) or Mark()
        (before | new).write(target)
        for name in new.files:
            os.replace(source / name, target / name)
        kept_files.remove_kept(target, before, [name for name in before.files if name not in new.files])
        new.write(target)
    else:
        if source.is_dir() and os.path.lexists(target):  # by force: no folder
            target.unlink()
        os.replace(source, target)


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _locked(folder: Path) -> int:
    """The folder, open and ours alone until it is closed; the system lets go of it however a process ends."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise ConfigurationError(
            f"--out {folder}: another run is writing there; wait for it or choose another folder"
        ) from None
    except OSError:
        pass  # some network file systems lock no folders
    return descriptor
