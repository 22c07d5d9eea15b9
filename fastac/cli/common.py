"""What the commands share: one-line errors, checks of output paths, options, folders of builds."""

import math
import os
from pathlib import Path

import click

from fastac.scenes.pace import PACES


class Listed(click.ParamType):
    """Values separated by commas, each once; `one` makes a value of its text or raises ValueError, which says
    what was expected."""

    name = "N,N,..."

    def one(self, text: str):
        raise NotImplementedError

    def convert(self, value, parameter, context):
        if isinstance(value, tuple):
            return value
        try:
            found = tuple(self.one(part) for part in value.split(","))
        except ValueError as error:
            self.fail(f"{value!r}: expected {error}", parameter, context)
        if len(set(found)) != len(found):
            self.fail(f"{value!r}: a number is there twice", parameter, context)
        return found


class Counts(Listed):
    """Numbers, such as of worker processes."""

    def one(self, text: str) -> int:
        try:
            return int(text)
        except ValueError:
            raise ValueError("numbers separated by commas, such as 1,2,4") from None


class Rates(Listed):
    """Positive numbers, such as frames a second."""

    name = "R,R,..."

    def one(self, text: str) -> float:
        try:
            rate = float(text)
        except ValueError:
            rate = 0.0
        if not 0 < rate < math.inf:
            raise ValueError("positive numbers such as 60,240")
        return rate


class Paces(Listed):
    """Values of `hardware.pixels_per_clock`: 1, 2, 4, or 1/2 and less."""

    def one(self, text: str) -> int | str:
        known = {str(pace.value): pace.value for pace in PACES}
        if text not in known:
            self.fail(f"{text!r}: expected some of {', '.join(known)}")
        return known[text]


INPUT = click.Path(path_type=Path)
STATES = {"kept": "up to date", "running": "running", "waiting": "waiting: another process is at it"}


class Output(click.ParamType):
    """A path that will be written: refused before any work if that cannot succeed.

    kind : "file" or "folder"; folders on the way to it need not exist yet
    """

    name = "path"

    def __init__(self, kind: str):
        self.kind = kind

    def convert(self, value, parameter, context):
        path = Path(value)
        if self.kind == "file" and path.is_dir():
            raise click.ClickException(f"{path}: is a folder; give the name of a file")
        if self.kind == "folder" and path.exists() and not path.is_dir():
            raise click.ClickException(f"{path}: is a file; give the name of a folder")
        folder = path if path.is_dir() else path.absolute().parent
        while not folder.exists():
            folder = folder.parent
        if not folder.is_dir():
            raise click.ClickException(f"{path}: {folder} is a file, not a folder")
        if not os.access(folder, os.W_OK | os.X_OK):
            raise click.ClickException(f"{path}: folder {folder} cannot be written")
        return path


OUTPUT_FILE, OUTPUT_FOLDER = Output("file"), Output("folder")


class Group(click.Group):
    """A group of commands whose expected errors are printed as one line instead of a traceback."""

    def invoke(self, context):
        try:
            return super().invoke(context)
        except (click.exceptions.Exit, click.Abort):  # RuntimeErrors too, but not failures: --help, Ctrl-C
            raise
        except (ValueError, OSError, RuntimeError) as error:
            raise click.ClickException(" ".join(str(error).split()) or repr(error)) from error


def progress_option(command):
    return click.option(
        "--progress/--no-progress",
        default=True,
        help="Show progress on standard error: bars on a terminal, a line a minute elsewhere.",
    )(command)


def output_option(text: str, kind: Output, default: str | None = None):
    """The option -o of a command: required unless the help names a default, which the command works out."""
    text += f" [default: {default}]" if default else ""
    return click.option("-o", "--output", type=kind, required=default is None, help=text)


def split_option(default: str):
    """Which samples of a dataset a command takes."""
    return click.option(
        "--split",
        type=click.Choice(["train", "validation", "test", "all"]),
        default=default,
        show_default=True,
        help="Samples of the dataset to take.",
    )


def store_option(text: str):
    return click.option(
        "--store",
        type=INPUT,
        default=Path("build/store"),
        show_default=True,
        help=f"Folder where results of expensive steps are kept and reused: {text}.",
    )


def load_bundle(path: Path):
    """The bundle in a folder, in a build folder's `bundle`, or in a single file."""
    from fastac.models.integer import bundle

    return bundle.load_bundle(path)


def bundle_folder(path: Path) -> Path:
    """Where the bundle is in a build folder, or `path` itself."""
    return path / "bundle" if (path / "bundle").is_dir() else path


def folder_of(path: Path) -> Path:
    """Where commands keep what they make of a bundle: in its folder, or beside a single file.

    For NAME.fastac that is NAME-files: a build folder NAME keeps its own.
    """
    return path.with_name(f"{path.stem}-files") if path.is_file() else path


def store_beside(path: Path) -> Path:
    """The step store of builds beside the one that the bundle in `path` belongs to."""
    if path.is_file():
        return path.absolute().parent / "store"
    return bundle_folder(path).absolute().parent.parent / "store"


def build_folder(scene, output: Path | None) -> Path:
    return output or Path("build") / scene.name


def load_scene(path: Path, data: Path | None):
    """The scene in a file, a recorded one with the size and the pitch of the recording in the file `data`;
    says what it takes from there."""
    from fastac.scenes import schema

    scene = schema.load(path)
    if data is None:
        return scene
    from fastac.sensor.recorded_scene import of_recording

    scene, changed = of_recording(scene, data)
    if changed:
        values = ", ".join(f"{key} = {there:g} instead of {here:g}" for key, (here, there) in changed.items())
        click.echo(f"scene {scene.name}: as {data} was recorded, sensor.{values}", err=True)
    return scene


def announce(name: str, state: str) -> None:
    """Say what becomes of a step: `kept`, `running`, or `waiting` for a process that performs it."""
    click.echo(f"{name:10s} {STATES[state]}", err=True)


def run_build(scene, folder: Path, data: Path | None, progress: bool, until: str | None) -> None:
    from fastac.flow.build import Build

    Build(scene, folder, data, progress).run(announce, until=until)


def cad_options(command):
    """Options for the surface of the sensor at rest and for its place in the machine's coordinates."""
    options = [
        click.option(
            "--cad",
            type=INPUT,
            help="Surface of the sensor at rest: STL or height map .npy, in mm. [default: the scene's skin]",
        ),
        click.option("--cad-pitch-mm", type=float, help="Distance between the samples of a height map, mm."),
        click.option(
            "--origin-mm",
            type=float,
            nargs=3,
            default=(0.0, 0.0, 0.0),
            show_default=True,
            help="Sensor's origin in the machine's coordinates, mm: x and y of the image's centre, z of the"
            " lowest corner of the skin.",
        ),
    ]
    for option in reversed(options):
        command = option(command)
    return command


def load_cad(scene, path: Path | None, pitch_mm: float | None):
    from fastac.sensor.importers import cad

    return cad.of_file(scene.sensor, path, pitch_mm) if path else cad.of_scene(scene.sensor)
