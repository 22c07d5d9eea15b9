"""The command line as a user types it, for tests of its commands."""

from click.testing import CliRunner

from fastac.cli.main import main


def run(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments], prog_name="fastac")


def succeed(*arguments):
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    return result


def fail(*arguments) -> str:
    """The one line of an error that a user can mend."""
    result = run(*arguments)
    assert result.exit_code == 1, result.output
    assert isinstance(result.exception, SystemExit), result.exception
    errors = [line for line in result.stderr.splitlines() if not line.endswith(("running", "up to date"))]
    assert len(errors) == 1, result.stderr
    assert errors[0].startswith("Error: ")
    return errors[0].removeprefix("Error: ")
