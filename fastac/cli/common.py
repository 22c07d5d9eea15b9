"""What the commands share: groups whose errors are one line, options, the folders of builds."""

from pathlib import Path

import click

INPUT = click.Path(path_type=Path)
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


def cache_option(text: str):
    return click.option(
        "--cache", type=INPUT, default=Path("build/cache"), show_default=True, help=f"Folder of {text}."
    )


def load_bundle(path: Path):
    """The bundle in a folder, or in a build folder's `bundle`."""
    from fastac.models.integer import bundle

    inside = path / "bundle"
    return bundle.load(inside if (inside / "bundle.json").exists() else path)


def build_folder(scene, output: Path | None) -> Path:
    return output or Path("build") / scene.name


def announce(name: str, current: bool) -> None:
    click.echo(f"{name:10s} {'up to date' if current else 'running'}", err=True)


def run_build(scene, folder: Path, data: Path | None, progress: bool, until: str | None) -> None:
    from fastac.flow.build import Build

    Build(scene, folder, data, progress).run(announce, until=until)
