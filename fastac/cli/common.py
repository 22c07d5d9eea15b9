"""What the commands share: groups whose errors are one line, options, the folders of builds."""

from pathlib import Path

import click


class Lanes(click.ParamType):
    """Numbers of pixels a clock, separated by commas."""

    name = "N,N,..."

    def convert(self, value, parameter, context):
        if isinstance(value, tuple):
            return value
        try:
            lanes = tuple(int(part) for part in value.split(","))
        except ValueError:
            self.fail(f"{value!r}: expected numbers separated by commas, such as 1,2,4", parameter, context)
        if len(set(lanes)) != len(lanes):
            self.fail(f"{value!r}: a number is there twice", parameter, context)
        return lanes


INPUT = click.Path(path_type=Path)
STATES = {"kept": "up to date", "running": "running", "waiting": "waiting: another process is at it"}
SPLITS = click.Choice(["train", "validation", "test", "all"])


class Group(click.Group):
    """Errors that users can mend end in one line, not in a traceback."""

    def invoke(self, context):
        try:
            return super().invoke(context)
        except (click.exceptions.Exit, click.Abort):  # RuntimeErrors too, but not failures: --help, Ctrl-C
            raise
        except (ValueError, OSError, RuntimeError) as error:
            raise click.ClickException(" ".join(str(error).split()) or repr(error)) from error


def progress_option(command):
    return click.option("--progress/--no-progress", default=True, help="Show progress bars on stderr.")(
        command
    )


def output_option(default: str, text: str):
    return click.option("-o", "--output", type=INPUT, default=None, help=f"{text} [default: {default}]")


def store_option(text: str):
    return click.option(
        "--store",
        type=INPUT,
        default=Path("build/store"),
        show_default=True,
        help=f"Folder of the step store, which keeps {text}.",
    )


def load_bundle(path: Path):
    """The bundle in a folder, or in a build folder's `bundle`."""
    from fastac.models.integer import bundle

    return bundle.load_bundle(path)


def build_folder(scene, output: Path | None) -> Path:
    return output or Path("build") / scene.name


def announce(name: str, state: str) -> None:
    """Say what becomes of a step: `kept`, `running`, or `waiting` for a process that performs it."""
    click.echo(f"{name:10s} {STATES[state]}", err=True)


def run_build(scene, folder: Path, data: Path | None, progress: bool, until: str | None) -> None:
    from fastac.flow.build import Build

    Build(scene, folder, data, progress).run(announce, until=until)


def cad_options(command):
    """The skin at rest, and where the machine has the sensor's origin."""
    options = [
        click.option(
            "--cad", type=INPUT, help="STL in mm, or height map .npy in mm. [default: the scene's skin]"
        ),
        click.option("--cad-pitch-mm", type=float, help="Distance of a height map's samples, mm."),
        click.option(
            "--origin-mm",
            type=float,
            nargs=3,
            default=(0.0, 0.0, 0.0),
            show_default=True,
            help="x, y, z of the sensor's origin in the machine's coordinates: the image's centre, the lowest"
            " corner of the skin.",
        ),
    ]
    for option in reversed(options):
        command = option(command)
    return command


def load_cad(scene, path: Path | None, pitch_mm: float | None):
    from fastac.sensor.importers import cad

    return cad.of_file(scene.sensor, path, pitch_mm) if path else cad.of_scene(scene.sensor)
