"""Commands that write models for other people and programs: one file with a card, and ONNX."""

import click

from fastac.cli.common import INPUT, OUTPUT_FILE, Group, output_option


@click.group(cls=Group)
def export():
    """Write a trained model for other people and other programs: one file with a card, or ONNX."""


def refuse_existing(path, force: bool) -> None:
    """Raise ClickException for an output that exists, unless it may be replaced."""
    if path.exists() and not force:
        raise click.ClickException(f"{path}: exists already; --force replaces it")


force_option = click.option("--force", is_flag=True, help="Replace the output file if it exists.")


@export.command()
@click.argument("bundle", type=INPUT)
@output_option("File to write; its name ends in .fastac.", OUTPUT_FILE)
@click.option("--licence", metavar="SPDX", help="Licence of the model, for its card. [default: not stated]")
@force_option
def bundle(bundle, output, licence, force):
    """Write BUNDLE as one file that can be shared: a zip archive with hashes and a card.

    Every command that takes a BUNDLE takes the file too, and so does fastac.load; it is never unpacked. The
    card says what the sensor is, what it was trained on, how large its errors are (if BUNDLE is a build
    folder that was evaluated) and the licence; `fastac card FILE` prints it. The same bundle gives the same
    bytes.

    \b
    Example: fastac export bundle build/paper -o paper.fastac --licence CC-BY-4.0
    """
    from fastac.export.bundle_file import write_bundle_file

    refuse_existing(output, force)
    digest = write_bundle_file(bundle, output, licence=licence)
    click.echo(f"{output}: {output.stat().st_size / 1e6:.2f} MB, sha256 of the bundle {digest}")


@click.command()
@click.argument("bundle", type=INPUT)
def card(bundle):
    """Print the card of BUNDLE: its sensor, training data, errors and licence.

    \b
    Example: fastac card paper.fastac
    """
    from fastac.export.bundle_file import card_text

    click.echo(card_text(bundle), nl=False)
