"""Commands that write models for other people and programs: one file with a card, and ONNX."""

import click

from fastac.cli.common import INPUT, OUTPUT_FILE, Group, load_bundle, output_option
from fastac.report.tables import text_table


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


@export.command()
@click.argument("bundle", type=INPUT)
@output_option("ONNX file to write.", OUTPUT_FILE)
@click.option(
    "--arithmetic",
    type=click.Choice(["integer", "float", "both"]),
    default="integer",
    show_default=True,
    help="integer: what the hardware computes. float: the models before quantisation. both: in one file, the"
    " outputs of the float models, which are named float_NAME.",
)
@click.option(
    "--background-input",
    is_flag=True,
    help="Make the background a second input of the model, instead of the bundle's own.",
)
@click.option(
    "--check/--no-check",
    default=True,
    show_default=True,
    help="Run extreme and random frames under onnxruntime and compare them with BUNDLE's own models.",
)
@force_option
def onnx(bundle, output, arithmetic, background_input, check, force):
    """Write the models of BUNDLE as ONNX, from frames (frames, H, W, C) uint8 to words, mm and N.

    The integers are equal to BUNDLE's on every value, which --check shows: black, white and noisy frames go
    through both, and nothing is written where a value differs. The float models differ by the rounding of
    float32; the largest differences are printed. Scenes whose force or slip follows from dots are refused.
    Needs the extra `onnx`: pip install -e '.[onnx]'.

    \b
    Example: fastac export onnx build/paper -o paper.onnx
    """
    from fastac.export.extra import require_onnx

    refuse_existing(output, force)
    require_onnx()
    from fastac.export import onnx_check, onnx_file

    model = load_bundle(bundle)
    made = onnx_file.model_of(model, arithmetic=arithmetic, background_input=background_input)
    lines = onnx_check.checked(model, made, arithmetic) if check else []
    onnx_file.write_onnx(made, output)
    click.echo(f"{output}: {output.stat().st_size / 1e6:.2f} MB, sha256 of the bundle {model.digest}")
    click.echo(text_table(["", "type", "shape", ""], onnx_file.rows(made)))
    for line in lines:
        click.echo(line)


@click.command()
@click.argument("bundle", type=INPUT)
def card(bundle):
    """Print the card of BUNDLE: its sensor, training data, errors and licence.

    \b
    Example: fastac card paper.fastac
    """
    from fastac.export.bundle_file import card_text

    click.echo(card_text(bundle), nl=False)
