"""The build folder: which step's results are there, and whether they are up to date.

A step is up to date if its key (the settings and source code it depends on, and the keys of the steps before
it) and its output files are those of the last complete run. A step that is interrupted leaves no stamp, so it
runs again; files appear whole or not at all.
"""

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fastac.store.files import write_json
from fastac.store.sources import digest_sources


@dataclass(frozen=True)
class Step:
    """One step of the build.

    settings : what of the scene (or of the caller) it depends on, as JSON
    sources : patterns of the source files that it depends on
    needs : names of the steps before it
    outputs : files or folders in the build folder that it writes
    """

    name: str
    run: Callable[[], None]
    settings: object
    sources: tuple[str, ...]
    outputs: tuple[str, ...]
    needs: tuple[str, ...] = ()


class Workspace:
    """A build folder and its stamps."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._keys: dict[str, str] = {}

    def _stamp(self, step: Step) -> Path:
        return self.folder / ".stamps" / f"{step.name}.json"

    def _files(self, step: Step) -> list | None:
        """Names, sizes and times of a step's outputs; None if one is missing."""
        found = []
        for output in step.outputs:
            path = self.folder / output
            if not path.exists():
                return None
            for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
                if file.is_file():
                    state = file.stat()
                    found.append([str(file.relative_to(self.folder)), state.st_size, state.st_mtime_ns])
        return found

    def key(self, step: Step) -> str:
        content = {
            "settings": step.settings,
            "sources": digest_sources(step.sources),
            "needs": [self._keys[name] for name in step.needs],
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def is_current(self, step: Step) -> bool:
        try:
            stamp = json.loads(self._stamp(step).read_text())
        except (OSError, json.JSONDecodeError):
            return False
        current = {"key": self.key(step), "files": self._files(step)}
        return isinstance(stamp, dict) and current == {name: stamp.get(name) for name in current}

    def stamped_key(self, name: str) -> str:
        """The key of a step when it last ran. Raises RuntimeError where it never did."""
        try:
            return str(json.loads((self.folder / ".stamps" / f"{name}.json").read_text())["key"])
        except (OSError, ValueError, KeyError, TypeError):
            raise RuntimeError(f"{self.folder}: step {name}: never performed") from None

    def seconds(self, name: str) -> float | None:
        """How long a step took when it last ran; None if that is not known."""
        try:
            return float(json.loads((self.folder / ".stamps" / f"{name}.json").read_text())["seconds"])
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def perform(self, step: Step, announce: Callable[[str, bool], None]) -> None:
        """Run a step unless it is up to date; `announce(name, current)` is called first."""
        current = self.is_current(step)
        announce(step.name, current)
        if not current:
            self._stamp(step).unlink(missing_ok=True)
            start = time.monotonic()
            step.run()
            seconds = time.monotonic() - start
            files = self._files(step)
            if files is None:
                raise RuntimeError(f"step {step.name}: an output is missing: {', '.join(step.outputs)}")
            write_json(self._stamp(step), {"key": self.key(step), "files": files, "seconds": seconds})
        self._keys[step.name] = self.key(step)
